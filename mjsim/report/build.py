"""The report of a diagnosis, or of a comparison alone: its numbers and figures brought into the page's content."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np

from mjsim.campaign.machine_file import machine_document
from mjsim.commands.ball_bar.compare import BarComparison, ComparedBarTest
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.finding import DiagnosedEffect
from mjsim.commands.saved import saved_of
from mjsim.compensation.compensate import compensate
from mjsim.digits import decimals_of, half_of, rounded_um, wave_ends
from mjsim.effects import registry
from mjsim.effects.registry import kinds
from mjsim.inference.problem import Problem
from mjsim.inference.unexplained import Unexplained
from mjsim.inference.variables import VARIABLES
from mjsim.instruments.ball_bar.iso230 import BidirectionalFigures, CircularFigures
from mjsim.instruments.ball_bar.program import Program
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.chain import COORDINATES, is_linear, is_rotary
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.plots.output import conditions, polar_traces, residual_trace
from mjsim.plots.part import part_figure
from mjsim.plots.polar import centre_of
from mjsim.plots.residual import reversal_angles
from mjsim.prediction.part_run import PartRun
from mjsim.progress import Progress, silent
from mjsim.report.causes import calibration_rows, waterfall
from mjsim.report.content import (
    BidirectionalRow,
    Finding,
    ModelRow,
    NotTestable,
    ParameterRow,
    PartSection,
    Rejected,
    ReportContent,
    SetUpRow,
    TestSection,
    WhatIf,
    fixed,
)
from mjsim.report.whatif import Model, basis, ladder, prepared, what_if
from mjsim.units import DEG, MM, UM, percent, unit_of

# -- the answer in the report's first box ------------------------------------------------------------------------------

#: Ends of names that have no article: one says "backlash of X", but "a command delay of X".
_WITHOUT_ARTICLE = ("backlash", "friction", "inertia", "presliding", "wear", "wind-up under gravity")


def headlines(result: Diagnosis) -> list[str]:
    """One line per missing effect, such as ``C axis: position gain about 3 % too high, or a command delay of C.``"""
    lines = [_line(e, result.before.machine) for e in result.effects[:_MOST]]
    if len(result.effects) > _MOST:
        lines.append(f"And {len(result.effects) - _MOST} smaller causes, each with its share in the table.")
    if result.unexplained:
        lines.append(_unknown(result.unexplained))
    return lines or ["No effect is missing from the machine's model."]


#: Causes that the first box names; the table below has the others.
_MOST = 4


def _unknown(rest: Unexplained) -> str:
    axes, on = " and ".join(rest.axes), VARIABLES[rest.variable].its
    return f"{axes} axis: an unknown error of {_short(rest.rms / UM)} µm RMS that depends on {on}."


def _line(found: DiagnosedEffect, given: Machine) -> str:
    effect = found.effect
    cause = f"{_place(effect.subject)}: {sized(effect, given.effect(effect.key), found.ci95)}"
    others = [_named(effect_id) for effect_id in found.alternatives]
    if others and found.probability is not None:
        cause += f" ({percent(found.probability)})"
        others = [f"{o} ({percent(found.others[i])})" for o, i in zip(others, found.alternatives, strict=True)]
    return f"{cause}{''.join(f', or {other}' for other in others)}."


def _place(subject: str) -> str:
    return f"{subject} axis" if is_linear(subject) or is_rotary(subject) else subject


def _named(effect_id: str) -> str:
    """An effect of which no size is known, such as ``a command delay of C``."""
    name, _, one_of_many = effect_id.removesuffix("]").partition("[")
    kind, _, subject = name.partition(".")
    known = kinds().get(kind)
    name = noun(known) if known else kind.replace("_", " ")
    if known is not None and known.follows_sensor(subject):
        subject += f" by the sensor {one_of_many}"
    if name.endswith("gain"):
        name = f"wrong {name}"
    if name.endswith(_WITHOUT_ARTICLE):
        return f"{name} of {subject}"
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name} of {subject}"


def noun(effect: Effect | type[Effect]) -> str:
    """Name of an effect in a sentence."""
    return effect.noun or effect.kind.replace("_", " ")


def sized(effect: Effect, former: Effect | None = None, intervals: Mapping[str, Any] | None = None) -> str:
    """An effect with its size in words, such as ``position gain about 3 % too high``.

    Args:
        effect: the effect as it was fitted.
        former: the same effect as the machine file has it, if it does.
        intervals: 95 % intervals by parameter. Two digits are said, fewer where an interval knows fewer.
    """
    name = noun(effect)
    direction = f" while it turns {effect.values['direction']}" if "direction" in effect.values else ""
    if effect.follows_sensor(effect.subject):
        direction = f" by the sensor {effect.values['sensor']}"
    leading = [p for p in effect.parameters_of(effect.subject) if p.leading]
    if not leading:
        return name + direction
    # of a straightness, the larger of its two shapes
    parameter = leading[0] if len(leading) == 1 else max(leading, key=lambda p: abs(effect.values[p.name]))
    value, ends = effect.values[parameter.name], (intervals or {}).get(parameter.name)
    if parameter.kind == "components":
        return f"{name} {_components(value, '°' if is_rotary(effect.subject) else 'µm', ends)}{direction}"
    if parameter.neutral == 1.0:
        return f"{name} {_percent(value, ends)}{direction}"
    old = former.values.get(parameter.name) if former else None
    change = ""
    if isinstance(old, float) and old:
        change = f" ({_percent(value / old, _times(ends, 1.0 / old), 'above', 'below')} the machine file's)"
    unit = unit_of(parameter.name)[1]
    if parameter.name.endswith("ratio"):
        size = f"{_short(100.0 * value, _times(ends, 100.0))} %"
    else:
        size = f"{_short(value, ends)} {unit}".replace(" °", "°").rstrip()
    return f"{name} {'with a stiffness ' if parameter.inverse else ''}of about {size}{direction}{change}"


def _components(rows: list, unit: str, intervals: list | None) -> str:
    i = max(range(len(rows)), key=lambda k: abs(rows[k][1]))
    order, amplitude, _ = rows[i]
    more = f" and {len(rows) - 1} more" if len(rows) > 1 else ""
    size = f"{_short(abs(amplitude), wave_ends(intervals, i, 1))} {unit}".replace(" °", "°")
    return f"of about {size} at order {order:g}{more}"


def _percent(ratio: float, ends: Sequence[float] | None, above: str = "too high", below: str = "too low") -> str:
    change = 100.0 * (ratio - 1.0)
    return f"about {_short(abs(change), _times(ends, 100.0))} % {above if change > 0 else below}"


def _times(ends: Sequence[float] | None, factor: float) -> list[float] | None:
    return None if ends is None else [factor * x for x in ends]


def _short(value: float, ends: Sequence[float] | None = None) -> str:
    """Two significant digits, such as 0.0020, 3.1 or 4100; fewer where its 95 % interval knows fewer."""
    decimals = 1 - int(f"{value:.1e}".partition("e")[2])
    return fixed(value, min(decimals, decimals_of(value, ends)) if half_of(ends) else decimals)


def explained(result: Diagnosis) -> str:
    """How sure the answer is, and what to do next, in short sentences."""
    tests = len(result.before.tests)
    many = f"These {tests} tests" if tests != 1 else "This one test"
    if result.verdict == "ambiguous":
        return f"{many} cannot decide. {_next(result.next_test)}".strip()
    if result.verdict == "identified":
        also = " The unknown error comes on top of that." if result.unexplained else ""
        return f"No other effect of the catalogue explains the measurement as well.{also}"
    if result.verdict == "unknown":
        return "The error repeats. No effect of the catalogue explains it."
    return "The measurement shows no error larger than the data sheet and the machine's class allow."


def _next(following: dict | None) -> str:
    if following is None:
        return ""
    minutes, short = round(following["minutes"]), short_test(following["test"])
    if following["decides"]:
        return f"Next: one {minutes}-minute test ({short})."
    return f"No test within reach decides. The best is one of {minutes} minutes ({short})."


def short_test(table: dict) -> str:
    """A test's table as in campaign.toml, in a few words: kind, plane or axis, place of the ball, feed."""
    kind = "R-test" if "sphere_mm" in table else table["kind"].partition("_")[0]
    ball = table["sphere_mm"] if "sphere_mm" in table else table["table_ball_mm"]
    words = [" ".join(str(x) for x in (kind, table.get("plane"), table.get("axis")) if x)]
    words += [f"{axis} {value:g} mm" for axis, value in zip(COORDINATES[:2], ball[:2], strict=True) if value]
    return ", ".join([*words, f"{table['feed_mm_min']:g} mm/min"])


# -- the evidence for what a diagnosis found ---------------------------------------------------------------------------

#: Sensitivity (m/m, m/rad) below which the bar does not see an axis.
_SEEN = (0.02, 1e-3)


def findings(result: Diagnosis) -> list[Finding]:
    """One entry per effect, in the diagnosis' order."""
    data = result.to_json()["effects"]
    explainable = result.before.rms**2 - result.noise**2
    return [
        _finding(e, row, explainable, result.shares.get(e.effect.key), i < result.own_rungs)
        for i, (e, row) in enumerate(zip(result.effects, data, strict=True))
    ]


def _finding(e: DiagnosedEffect, data: dict, explainable: float, known: float | None, own: bool) -> Finding:
    share = 100.0 * (e.rms_before**2 - e.rms_after**2) / explainable if explainable > 0.0 else None
    if known is not None:
        share = 100.0 * known
    rejected = next((Rejected(i, round(100.0 * reached, 1)) for i, reached in e.reached.items()), None)
    return Finding(
        e.effect.key,
        e.effect.title,
        parameter_rows(e),
        data["rms_before_um"] if own else None,
        data["rms_after_um"] if own else None,
        e.alternatives,
        f"{e.effect.signature} {'' if e.tests else 'No single test shows it above a quarter of the noise.'}".strip(),
        e.tests,
        None if share is None else round(share, 1),
        None if e.probability is None else round(100.0 * e.probability, 1),
        e.how_probable,
        rejected,
    )


def parameter_rows(e: DiagnosedEffect) -> list[ParameterRow]:
    """The fitted parameters of an effect with their 95 % intervals, components one by one."""
    rows = []
    for name in e.free:
        value, ci = e.effect.values[name], e.ci95.get(name)
        if name == "components":
            unit = "°" if is_rotary(e.effect.subject) else "µm"
            for i, (order, amplitude, phase) in enumerate(value):
                rows.append(ParameterRow(f"order {order:g}, amplitude", amplitude, *_ends(ci, i, 1), unit))
                rows.append(ParameterRow(f"order {order:g}, phase", phase, *_ends(ci, i, 2), "°"))
        else:
            low, high = ci or (None, None)
            rows.append(ParameterRow(name, value, low, high, unit_of(name)[1]))
    return rows


def _ends(ci, i: int, column: int) -> tuple[float | None, float | None]:
    return (ci[0][i][column], ci[1][i][column]) if ci else (None, None)


def untestable(ids: tuple[str, ...], problem: Problem) -> list[NotTestable]:
    """Effects that the campaign cannot show, each with its title and the reason."""
    chain = problem.chain
    moves, seen = {}, {}
    for i, a in enumerate(chain.letters):
        moves[a] = any(np.ptp(m.commands[:, i]) > 0.0 for m in problem.motions)
        seen[a] = any(np.abs(s.axes[:, i]).max() > _SEEN[chain.is_rotary(a)] for s in problem.sensitivity)
    out = []
    for effect_id in ids:
        cls, subject = registry.effect_class(effect_id, chain)
        if subject in chain.letters and not moves[subject]:
            why = f"{subject} does not move in any test"
        elif subject in chain.letters and not seen[subject]:
            why = f"the bar is at right angles to the motion of {subject} in every test"
        elif cls.search.quasi_static:
            why = "the fitted ball offsets, bar length and trigger shifts look the same here"
        else:
            why = "it hardly changes the reading at these feeds, or the fitted set-up and data sheet look the same"
        out.append(NotTestable(effect_id, f"{cls.title}: {why}."))
    return out


def next_test_sentence(following: dict | None) -> str:
    """The diagnosis' ``next_test`` in one sentence; empty where there is none."""
    if following is None:
        return ""
    a, b = following["between"]
    decides = "" if following["decides"] else " This is not enough to decide."
    test, minutes = following["test"], following["minutes"]
    return (
        f"To tell {a} from {b}, measure {test['name']} ({short_test(test)}). It takes {minutes:g} min with mounting. "
        f"The two differ by {following['difference_um']:.2f} µm RMS there.{decides} "
        "mjsim plan prints this test as a table for campaign.toml."
    )


def rest_percent(result: Diagnosis) -> float | None:
    """Share of the squared error above the noise that stays, in per cent; None where there was none."""
    explainable = result.before.rms**2 - result.noise**2
    return (
        100.0 * max(result.after.rms**2 - result.noise**2, 0.0) / explainable
        if explainable > (0.02 * UM) ** 2
        else None
    )


# -- traces for the interactive plots ----------------------------------------------------------------------------------

#: Samples per turn that are kept, about; axis positions are given at this many instants, in between they are
#: interpolated.
PER_TURN, POSITIONS = 1000, 181


def test_traces(models: list[ComparedBarTest], start: int, noise: float) -> dict:
    """One test under every model of the ladder.

    Args:
        models: the test's comparison per model. start: place of the machine as given. noise: RMS of one sample [m].

    Returns:
        ``phi`` (n,) in 0.01°; ``measured`` (n,) and ``models`` (k, n) in 0.001 µm, measured with None where a sample is
        left out; ``centre``: the eccentricity [a, b, c] in 0.001 µm of the measured trace, a cos φ + b sin φ + c, that
        is taken out of all; ``full``: a whole circle; ``events``
        [axis, angle °]; ``axes``: φ in 0.01° and the commanded positions of the axes [0.01 mm or 0.01°]; ``noise``
        [µm]. The long lists are :func:`steps`.
    """
    t = models[start]
    keep = kept(t.phi, t.residual)
    trace = residual_trace(t, noise)
    measured = [round(v / UM * 1e3) if ok else None for v, ok in zip(t.measured[keep], t.valid[keep], strict=True)]
    return {
        "name": t.test.name,
        "phi": steps(_whole(t.phi[keep] / DEG, 100.0)),
        "measured": steps(measured),
        "models": [steps(_whole(m.simulated[keep] / UM, 1e3)) for m in models],
        "centre": _whole(centre_of(t.test, t.phi[t.valid], t.measured[t.valid]) / UM, 1e3),
        "full": bool(trace.full_circle()),
        "events": [[axis, round(angle, 2)] for axis, angle in reversal_angles(trace)],
        "axes": _positions(t),
        "noise": round(noise / UM, 4),
    }


def kept(phi: np.ndarray, signal: np.ndarray, per_turn: int = PER_TURN) -> np.ndarray:
    """Indices of about ``per_turn`` samples per turn: the smallest and the largest ``signal`` of each stretch, and
    both ends.
    """
    turns = max(float(np.ptp(phi)) / (2.0 * np.pi), 0.8)
    stretch = int(np.ceil(2.0 * len(phi) / (turns * per_turn)))
    if stretch < 3:
        return np.arange(len(phi))
    keep = {0, len(phi) - 1}
    for begin in range(0, len(phi), stretch):
        part = signal[begin : begin + stretch]
        keep |= {begin + int(np.argmin(part)), begin + int(np.argmax(part))}
    return np.array(sorted(keep))


def _positions(t: ComparedBarTest) -> dict:
    program = Program(t.test)
    time = np.linspace(*program.measured_span, POSITIONS)
    axes = t.test.chain.letters
    q = program.commands(time) / [DEG if is_rotary(a) else MM for a in axes]
    return {
        "phi": steps(_whole(program.phi(time) / DEG, 100.0)),
        **{a: steps(_whole(q[:, i], 100.0)) for i, a in enumerate(axes)},
    }


def _whole(x: np.ndarray, factor: float) -> list[int]:
    return np.round(np.asarray(x) * factor).astype(int).tolist()


def steps(values: Sequence[int | None]) -> list[int | None]:
    """Every number less the one before it, which takes half the characters; the first as it is, None where there is
    none.
    """
    out, before = [], 0
    for value in values:
        out.append(None if value is None else value - before)
        before = before if value is None else value
    return out


def diagnosed(
    result: Diagnosis,
    threads: int = 2,
    progress: Progress = silent,
    date: str = "",
    thorough: bool = True,
    parts: Sequence[PartRun] = (),
) -> ReportContent:
    """Everything the page says about a diagnosed campaign.

    Args:
        result: the diagnosis.
        threads: tests simulated side by side.
        progress: told what is being done.
        date: printed as it is.
        thorough: simulate every step of the ladder and the three best repairs in the multibody model. Otherwise the
            last effect shares its step with the calibrated data sheet and only the best repair is simulated in full.
        parts: programs whose error is predicted.
    """
    problem = prepared(result, threads)
    models, start = ladder(result, problem, threads, progress, apart=thorough)
    keys = {e.effect.key for e in result.effects}
    inside = {c.effect.effect.key for c in result.calibration}
    full = 3 if thorough else 1
    repairs = what_if(problem, result.after, result.before.machine, keys, threads, progress, full, inside)
    repairs = _opened(repairs, {e.effect.key: e.alternatives for e in result.effects})
    base = _content(models, start, result.machine, repairs, date)
    rest, u = rest_percent(result), result.unexplained
    return ReportContent(
        **{
            **base,
            "title": f"{result.campaign.name}: {_noun(result.before)} diagnosis",
            "verdict": result.verdict,
            "answer": headlines(result),
            "verdict_sentence": explained(result),
            "findings": findings(result),
            "unexplained": " ".join(
                filter(None, [u.summary if u else _rest(rest), _further(result), *result.told_beside])
            ),
            "curve": (*u.curve, u.labels, u.summary, u.period) if u else None,
            "not_testable": untestable(result.not_testable, problem),
            "next_test": next_test_sentence(result.next_test),
            "calibration": calibration_rows(result),
            "waterfall": waterfall(result),
            "diagnosis": result.to_json(),
            "instrument_source": "; ".join(
                f"{INSTRUMENTS[n].noun}: {data.source}" for n, data in result.campaign.in_motion.instruments.items()
            )
            if len(result.campaign.in_motion.instruments) > 1
            else result.campaign.in_motion.instrument.source,
            "compensation": _correctable(result, threads, progress) if thorough else None,
            "parts": part_sections(parts, result.machine, result, progress),
        }
    )


def _noun(comparison: BarComparison) -> str:
    """What was measured, as the title says it."""
    return INSTRUMENTS[comparison.instrument].noun.replace(" ", "-")


def _correctable(result: Diagnosis, threads: int, progress: Progress) -> dict | None:
    """What a control without limits could correct, with the forecast; ``None`` where that is nothing."""
    if result.posterior is None:
        return None
    made = compensate(result.campaign, result.before.machine, "csv", None, None, threads, progress, saved_of(result))
    return None if made.corrections.empty else made.to_json()


def _opened(repairs: WhatIf | None, alternatives: dict[str, tuple[str, ...]]) -> WhatIf | None:
    """The repairs, each with the effects that the tests cannot tell from its cause."""
    if repairs is None:
        return None
    return replace(repairs, rows=[replace(r, instead=alternatives.get(r.cause, ())) for r in repairs.rows])


def _further(result: Diagnosis) -> str:
    """Curves of unknown causes that the model has beside the one that is described in full."""
    return " ".join(f"Also in the model: {c.summary[0].lower()}{c.summary[1:]}" for c in result.further)


def _rest(percent: float | None) -> str:
    if percent is None:
        return ""
    size = "Less than 0.1" if percent < 0.1 else f"{percent:.1f}"
    return f"{size} % of the squared error above the noise is left. It does not point to a cause."


def compared(
    problem: Problem,
    given: BarComparison,
    threads: int = 2,
    progress: Progress = silent,
    date: str = "",
    parts: Sequence[PartRun] = (),
) -> ReportContent:
    """Everything the page says about a campaign that was compared with its machine and not diagnosed."""
    models = basis(problem, given, threads, progress)
    repairs = what_if(problem, given, given.machine, (), threads, progress)
    base = _content(models, len(models) - 1, given.machine, repairs, date)
    return ReportContent(
        **base,
        title=f"{given.campaign.name}: {_noun(given)} comparison",
        verdict=None,
        verdict_sentence="The campaign was compared with the machine as given. It was not diagnosed.",
        findings=[],
        parts=part_sections(parts, given.machine, None, progress),
    )


def part_sections(
    parts: Sequence[PartRun], machine: Machine, result: Diagnosis | None = None, progress: Progress = silent
) -> list[PartSection]:
    """One section per program.

    Args:
        parts: The programs.
        machine: Where they run, unless a diagnosis says so.
        result: Diagnosis of the machine.
        progress: Told what is being done.

    Raises:
        InputError: A program cannot be read or does not fit the machine.
    """
    saved = saved_of(result) if result is not None and result.posterior is not None else None
    out = []
    for k, part in enumerate(parts):
        progress("predicting parts", k, len(parts))
        predicted = part.on(machine if saved is None else saved.machine, saved)
        out.append(PartSection(predicted.to_json(blocks=False), part_figure(predicted)))
    return out


def _content(models: list[Model], start: int, final: Machine, repairs: WhatIf | None, date: str) -> dict:
    before, after = models[start].comparison, models[-1].comparison
    c, m = before.campaign, before.machine
    text = machine_document(final, m.path) if m.path else repr(final)
    setups = [
        SetUpRow(
            name,
            [round(float(x / UM), 2) for x in v[:3]],
            [round(float(x / UM), 2) for x in v[3:]],
            [t.test.name for t in after.tests if t.test.setup == name],
        )
        for name, v in after.setups.items()
    ]
    return {
        "summary": [
            ("Machine", f"{m.name}, configuration {m.configuration}"),
            *([("Sense of the rotary axes (ISO 841)", m.chain.senses)] if m.chain.rotary else []),
            ("Campaign", f"{c.name}: {len(before.tests)} measured tests in {len(setups)} set-ups"),
            *(
                (
                    "Instrument",
                    f"{INSTRUMENTS[n].noun}, resolution {data.resolution / UM:g} µm, range ±{data.range * 1e3:g} mm, "
                    f"{data.rate:g} Hz",
                )
                for n, data in c.instruments.items()
            ),
            ("Effects in the model as given", ", ".join(e.key for e in m.effects) or "none"),
        ],
        "models": [
            ModelRow(x.label, rounded_um(x.comparison.rms), [rounded_um(t.rms) for t in x.comparison.tests], x.what,
                x.how) for x in models
        ],
        "start": start,
        "tests": [_section(b, a, before.noise, changed=before is not after) for b, a in zip(before.tests, after.tests,
        strict=True)],
        "noise_um": rounded_um(before.noise),
        "noise_source": before.noise_source,
        "setups": setups,
        "length_offset_um": round(after.length / UM, 2) if any(not t.test.component for t in after.tests) else None,
        "acceptance": before.acceptance,
        "bidirectional": [
            BidirectionalRow((b["ccw"], b["cw"]), _both(b["measured"]), _both(b["simulated"]), _both(a["simulated"]))
            for b, a in zip(before.bidirectional, after.bidirectional, strict=True)
        ],
        "what_if": repairs,
        "provenance": [
            ("mjsim", version("mjsim")),
            ("MuJoCo", version("mujoco")),
            ("numpy", version("numpy")),
            ("Python", platform.python_version()),
            ("seed", "none: no random numbers are drawn"),
            ("final machine, SHA-256", hashlib.sha256(text.encode()).hexdigest()),
        ],
        "date": date,
        "traces": [
            test_traces([x.comparison.tests[k] for x in models], start, before.noise) for k in range(len(before.tests))
        ],
    }  # fmt: skip


def _both(figures: dict) -> BidirectionalFigures:
    return BidirectionalFigures(**_tuples(figures))


def _circular(figures: dict | None) -> CircularFigures | None:
    return CircularFigures(**_tuples(figures)) if figures else None


def _tuples(figures: dict) -> dict[str, Any]:
    return {k: tuple(v) if isinstance(v, list) else v for k, v in figures.items()}


def _section(before: ComparedBarTest, after: ComparedBarTest, noise: float, changed: bool) -> TestSection:
    return TestSection(
        name=before.test.name,
        conditions=conditions(before.test),
        before=polar_traces(before),
        after=polar_traces(after) if changed else (),
        residual=residual_trace(after, noise),
        rms_before_um=rounded_um(before.rms),
        rms_after_um=rounded_um(after.rms) if changed else None,
        measured=_circular(before.iso.get("measured")),
        simulated_before=_circular(before.iso.get("simulated")),
        simulated_after=_circular(after.iso.get("simulated")) if changed else None,
        trigger_ms=round(after.trigger * 1e3, 2),
        setup=before.test.setup,
        left_out=int((~before.valid).sum()),
        worst=f"{after.worst_phi / DEG % 360.0:.0f}°, {after.worst_event}",
    )
