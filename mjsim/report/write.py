"""``mjsim.report``: one campaign, or several of one machine over time, as one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from importlib.metadata import version
from typing import Any

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.campaign.temperature import in_campaign, remarks_on
from mjsim.commands.any_instrument import PlainTest
from mjsim.commands.axis_log.compare import ComparedAxis
from mjsim.commands.axis_log.diagnosis import MORE_IS_LEFT, LogDiagnosis, little_known
from mjsim.commands.ball_bar.compare import BarComparison, compare_bars
from mjsim.commands.compare import compare
from mjsim.commands.comparison import ComparedChannel, ComparedPart, ComparedTest
from mjsim.commands.diagnose import diagnosable, diagnose
from mjsim.commands.diagnosis import AtRest, Diagnosis
from mjsim.commands.finding import DiagnosedEffect
from mjsim.digits import decimals_of, estimate, expanded, fixed, interval, wave_ends
from mjsim.errors import InputError
from mjsim.inference.budget import Budget
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io.extras import need
from mjsim.io.files import finite
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine, sheet_name
from mjsim.plots.comparison import titled_figures
from mjsim.plots.temperatures import temperature_figure
from mjsim.prediction.part_run import PartRun
from mjsim.progress import Progress, silent
from mjsim.report import build, page, trend
from mjsim.report.page import data_uri
from mjsim.units import DEG, UM, percent, unit_of

# -- what the page says of instruments other than the ball bar ---------------------------------------------------------

_SENTENCES = {
    "identified": "These effects are missing from the model, and nothing else explains the logs as well.",
    "ambiguous": "Some of these effects cannot be told from others by these logs.",
    "unknown": f"{MORE_IS_LEFT.capitalize()}.",
    "nothing_found": "The model explains the logs within the tolerances of the data sheet.",
}
_OF_POINTS = {
    "identified": "These effects are larger than a machine of its class may have.",
    "ambiguous": "Some of these effects cannot be told from others by these measurements.",
    "unknown": "More is left than the noise, and no effect of the catalogue explains it.",
    "nothing_found": "The measurements agree with a machine of its class.",
}
#: Findings that the first box names.
_NAMED = 3


def section_of_points(found: Diagnosis, rest: AtRest) -> dict:
    """What the page says of an instrument that measures at rest, with what was found, as plain data."""
    said, instrument = rest.to_json(), INSTRUMENTS[rest.after.instrument]
    mine = [e for e in found.effects if {t.test.name for t in rest.after.tests} & set(e.tests)]
    fitted = {c.effect.effect.id: (c.effect.effect.values, c.ci95) for c in found.calibration}
    fitted |= {e.effect.id: (e.effect.values, e.ci95) for e in found.effects}
    located = []
    for row in said["classical"]:
        values, ends = fitted.get(row["id"], ({}, {}))
        for name, own in list(ends.items())[:1]:
            told = [estimate(values[name], own, "+"), interval(own, sign="+")]
            located.append([row["id"], unit_of(name)[1], *told, fixed(row["value"], decimals_of(None, own), "+")])
    # it is one of everything that was measured, and stands on the page once
    is_first = not found.has_bars and rest is found.at_rest[0]
    budget = [_budget_row(b) for b in found.budget] if is_first else []
    left = (
        f"{said['left_um']:.2f} µm are in no model; the probability that this is more than the noise is "
        f"{100 * said['misfit']:.0f} %."
    )
    return compared_section(rest.after) | {
        "rms_before_um": said["rms_before_um"],
        "noise_source": said["noise_source"],
        "effects": [_finding(e, e.to_json(found.machine)) for e in mine],
        "located": located,
        "by_itself": [instrument.by_itself_noun, instrument.by_itself_note],
        "points": True,
        "budget": budget,
        "said": [text for text in (left, said["joint"]) if text and rest is found.at_rest[0]],  # common to all
    }


def answer_of(found: Diagnosis) -> dict:
    """What the first box of the page says where no ball bar has measured, as plain data: of all instruments."""
    names = [f"{e.effect.noun or e.effect.kind.replace('_', ' ')} {e.effect.subject}" for e in found.effects[:_NAMED]]
    left = len(found.effects) - len(names)
    answer = ", ".join(names) + (f", and {left} smaller" if left > 0 else "")
    return {
        "verdict": found.verdict,
        "answer": f"{answer[:1].upper()}{answer[1:]}."
        if names
        else "Nothing is larger than a machine of its class may have.",
        "sentence": _OF_POINTS[found.verdict],
        "not_testable": list(found.not_testable),
    }


def _budget_row(b: Budget) -> list[str]:
    ends = b.value - 2.0 * b.standard, b.value + 2.0 * b.standard
    value = f"{estimate(b.value, ends)} {expanded(ends)} {b.unit}".rstrip()
    chance = "–" if b.beyond is None else percent(b.beyond)
    return [f"{b.effect_id} {b.number}", value, chance, b.decision or "–", b.sentence]


def images_of(part: ComparedPart) -> list[list[tuple[str, str]]]:
    """Names and data URIs of the pictures of every test."""
    return [[(name, data_uri(figure)) for name, figure in titled_figures(t)] for t in part.tests]


def compared_section(result: ComparedPart) -> dict:
    """What the page says of the tests of an instrument that is no ball bar, as plain data.

    Args:
        result: The tests, as compared with the final machine.
    """
    said = result.to_json()
    tests = [
        {"name": t.test.name, "axes": [_channel_row(c) for c in t.channels], "figures": _figure_rows(t)}
        for t in result.tests
    ]
    return {
        "said": [],
        "located": [],
        "points": False,
        "budget": [],
        "title": result.campaign.name,
        "machine": result.machine.name,
        "instrument": INSTRUMENTS[result.instrument].test_noun,
        "axes": list(dict.fromkeys(c.channel.name for t in result.tests for c in t.channels)),
        "verdict": None,
        "rms_before_um": None,
        "rms_after_um": said.get("rms_um"),
        "noise_um": said.get("noise_um"),
        "noise_source": said.get("noise_source", "as the instrument states it"),
        "tests": tests,
        "model": [_model_row(e) for e in result.machine.effects],
        "effects": [],
        "unexplained": None,
        "ladders": [],
        "sheet": [],
        "not_separable": [],
        "not_testable": [],
        "provenance": [["mjsim", version("mjsim")], ["mujoco", version("mujoco")], ["numpy", version("numpy")]],
    }


def _model_row(e: Effect) -> list[str]:
    """An effect of the model: id, what it is, and its values."""

    def said(value: Any) -> str:
        if isinstance(value, (list, tuple)):
            return f"{len(value)} waves"
        return f"{value:.4g}" if isinstance(value, float) else str(value)

    return [e.key, e.title, ", ".join(f"{name} = {said(value)}" for name, value in e.values.items())]


def _figure_rows(t: ComparedTest) -> list[list[str]]:
    """Figures of a standard: name with its unit, of measured and of simulated."""
    figures = t.figures if isinstance(t, PlainTest) else {}
    measured, simulated = (figures.get(who, {}) for who in ("measured", "simulated"))
    return [
        [name, f"{value:.4g}", f"{simulated[name]:.4g}" if name in simulated else "–"]
        for name, value in measured.items()
    ]


def _channel_row(c: ComparedChannel) -> dict:
    """Errors of one channel with their units."""
    numbers = {"rms": c.rms, "max": c.maximum, "noise": c.noise}
    if isinstance(c, ComparedAxis):
        numbers = {"following": c.following} | numbers
    return {"axis": c.channel.name} | {k: f"{v / c.channel.size:.4g} {c.channel.unit}" for k, v in numbers.items()}


def diagnosed_section(result: LogDiagnosis, said: Sequence[str]) -> dict:
    """What the page says of axis logs that were diagnosed, as plain data.

    Args:
        result: The diagnosis.
        said: Sentences above the tables.
    """
    data = result.to_json()
    nouns = [e.effect.noun or e.effect.kind.replace("_", " ") for e in result.effects[:_NAMED]]
    names = [f"{noun} of {e.effect.subject}" for noun, e in zip(nouns, result.effects, strict=False)]
    more = len(result.effects) - len(names)
    answer = ", ".join(names) + (f", and {more} smaller" if more > 0 else "")
    return compared_section(result.after) | {
        "said": list(said),
        "verdict": result.verdict,
        "answer": f"{answer[:1].upper()}{answer[1:]}." if names else "No effect is missing from the machine's model.",
        "sentence": _SENTENCES[result.verdict],
        "rms_before_um": data["rms_before_um"],
        "effects": [_finding(e, row) for e, row in zip(result.effects, data["effects"], strict=True)],
        "unexplained": data["unexplained"]["summary"] if data["unexplained"] else None,
        "ladders": _ladders(result),
        "budget": [_budget_row(b) for b in result.budget],
        "sheet": [_sheet_row(row) for row in data["data_sheet"]],
        "not_separable": [f"{little_known(i['axis'], i['numbers'])}; {i['remedy']}." for i in data["not_separable"]],
        "not_testable": data["not_testable"],
    }


def _finding(e: DiagnosedEffect, row: dict) -> dict:
    rows = []
    for name, value in row["parameters"].items():
        ends = row["ci95"].get(name)
        if name in row["undetermined"]:
            rows.append([name, "not determined", "–"])
        elif name == "components":
            for i, (order, size, _) in enumerate(value):
                own = wave_ends(ends, i, 1)
                rows.append([f"amplitude of order {order:g}, N·m", estimate(size, own), interval(own)])
        elif isinstance(value, str):
            rows.append([name, value, "–"])
        else:
            rows.append([name, estimate(value, ends), interval(ends)])
    if "rms_before_deg" in row:
        size = f"{row['rms_before_deg']:.3g} → {row['rms_after_deg']:.3g} °"
    else:
        size = f"{row['rms_before_um']:.2f} → {row['rms_after_um']:.2f} µm"
    return (
        {"id": e.effect.key, "alternatives": row["alternative_ids"], "tests": row["tests"]}
        | {"change": size}
        | {"together": e.together.sentence if e.together else None}
        | {"title": e.effect.title, "remedy": e.effect.remedy.on(e.effect.subject).text, "rows": rows}
    )


def _ladders(result: LogDiagnosis) -> list[dict]:
    out = []
    for axis, s in result.selections.items():
        names = [t.test.name for t in result.after.tests if axis in t.axes]
        rotary = result.machine.chain.is_rotary(axis)
        unit = DEG if rotary else UM
        steps = [("as given", s.given), ("data sheet fitted", s.sheet), *s.rungs]
        steps.append(("final model", s.fit))
        rows = [[name, [float(v) / unit for v in np.sqrt(fit.mean_squares)]] for name, fit in steps]
        symbol = "°" if rotary else "µm"
        form = "%.3g" if rotary else "%.2f"
        rows = [[name, [form % v for v in values]] for name, values in rows]
        out.append({"axis": axis, "unit": symbol, "tests": names, "rows": rows})
    return out


def _sheet_row(row: dict) -> dict:
    where = f" ({row['controller']})" if row["controller"] else ""
    name, unit = sheet_name(row["name"])
    return {
        "name": f"{row['axis']} {name}{where}, {unit}".rstrip(", "),
        "stated": f"{row['stated']:.4g}",
        "found": estimate(row["found"], row["ci95"]) if row["known"] else "not determined",
        "ends": interval(row["ci95"]) if row["known"] else "–",
        "source": row["source"] if row["known"] else "the data sheet",
    }


@dataclass(frozen=True)
class Report:
    """A report: ``html`` is the whole page, ``data`` its numbers and texts as plain JSON data (the page carries the
    same).
    """

    html: str
    data: dict


def need_report() -> None:
    """Refuse to begin where the page's packages are missing.

    Raises:
        InputError: the extra "report" is not installed.
    """
    need("report", "report", "jinja2", "PIL")


def report(
    campaigns: Campaign | Sequence[Campaign],
    machines: Machine | Sequence[Machine],
    max_effects: int | None = None,
    diagnosed: bool = True,
    threads: int = 2,
    progress: Progress = silent,
    parts: Sequence[PartRun] = (),
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Report:
    """The report of a campaign; of several campaigns of one machine the trend.

    Nothing is written, neither here nor into the campaigns' folders.

    Args:
        campaigns: one, or at least two; those with a day of measuring come in its order, where all have one, otherwise
            as given.
        machines: the model of each.
        max_effects: at most so many missing effects are looked for; without it as many as the data prove.
        diagnosed: look for missing effects; otherwise compare only.
        threads: tests simulated side by side.
        progress: called as work gets on.
        parts: programs whose error the page of one campaign predicts.
        settings: what decides.

    Raises:
        InputError: no measured test, campaigns of different machines, or the extra is not installed.
    """
    need_report()
    if isinstance(campaigns, Campaign) or len(campaigns) == 1:
        campaign = campaigns if isinstance(campaigns, Campaign) else campaigns[0]
        machine = machines if isinstance(machines, Machine) else machines[0]
        return _single(campaign, machine, max_effects, diagnosed, threads, progress, parts, settings)
    pairs = list(
        zip(campaigns, [machines] * len(campaigns) if isinstance(machines, Machine) else machines, strict=True)
    )
    check_same_machine(pairs)
    if all(c.measured_on is not None for c, _ in pairs):
        pairs.sort(key=lambda pair: pair[0].measured_on or date.min)
    results: list[Diagnosis | BarComparison] = []
    for i, (c, m) in enumerate(pairs):

        def told(stage: str, done: int, total: int, place: str = f"{i + 1}/{len(pairs)}: ") -> None:
            progress(place + stage, done, total)

        if diagnosed:
            results.append(diagnose(c, m, max_effects, threads, told, settings).of_bars())
        else:
            results.append(compare_bars(c, m, threads, told))
    content = trend.content(results)
    return Report(page.render_trend(content), finite(content.to_json()))


def _single(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None,
    diagnosed: bool,
    threads: int,
    progress: Progress,
    parts: Sequence[PartRun],
    settings: DiagnosisSettings,
) -> Report:
    campaign.need_traces("a report needs at least one measured test")
    machine = in_campaign(machine, campaign)
    bars = bool(campaign.in_motion.measured)
    if parts and not bars:
        raise InputError(f"{campaign.folder / 'campaign.toml'}: the error of a part follows from ball-bar tests only")
    day = campaign.measured_on.isoformat() if campaign.measured_on else ""
    content, answer, sections = None, {}, {}
    able = campaign.of(*diagnosable())
    if diagnosed and able.measured:
        found = diagnose(able, machine, max_effects, threads, progress, settings)
        final = found.machine
        if bars:
            content = build.diagnosed(found.of_bars(), threads, progress, day, parts=parts)
        for rest in found.at_rest:
            sections[rest.after.instrument] = (section_of_points(found, rest), images_of(rest.after))
            answer = answer_of(found)
        if found.logs is not None:
            said = [f"{e.effect.id}: {e.evidence}" for e in found.effects if e.evidence]
            sections[LogTest.instrument] = (diagnosed_section(found.logs, said), images_of(found.logs.after))
    else:
        final = machine
        if bars:
            problem = checked_problem(campaign, machine, threads)
            compared = compare_bars(campaign, machine, threads, progress, problem)
            content = build.compared(problem, compared, threads, progress, day, parts)
    left = [n for n in campaign.measured_parts if n not in sections and not INSTRUMENTS[n].in_motion]
    if left:
        for part in compare(campaign.of(*left), final, threads, progress).parts:
            sections[part.instrument] = (compared_section(part), images_of(part))
    progress("writing the page", 0, 1)
    ordered = {INSTRUMENTS[n].beside: sections[n] for n in INSTRUMENTS if n in sections}
    warming = {} if campaign.temperatures is None else {"temperature": remarks_on(campaign)}
    picture = page.data_uri(temperature_figure(campaign)) if campaign.temperatures is not None else None
    if content is not None:
        html = page.render(content, ordered, (picture, warming.get("temperature", [])))
        return Report(html, finite(page.data_of(content, ordered) | warming))
    (data, images), *others = ordered.values()
    data = data | answer | warming | {key: section for (key, (section, _)) in list(ordered.items())[1:]}
    verdict = page.VERDICTS.get(data["verdict"] or "")
    html = page.page(
        "recordings.html", data, None, (), verdict=verdict, images=images, beside=others, temperature_image=picture
    )
    return Report(html, finite(data))


def check_same_machine(pairs: Sequence[tuple[Campaign, Machine]]) -> None:
    """Refuse campaigns of different machines: another name, configuration, or lead or number of worm teeth.

    Raises:
        InputError: names both campaigns and what differs.
    """
    for c, _ in pairs:
        c.in_motion.need_traces("a trend needs ball-bar tests")
    (first, one), *others = pairs
    for c, m in others:
        if (m.name, m.configuration) != (one.name, one.configuration):
            what = f"machine {one.name!r} ({one.configuration}) and {m.name!r} ({m.configuration})"
        elif axes := [a for a in one.chain.letters if m.drives[a].gear != one.drives[a].gear]:
            what = f"another lead or number of worm teeth of {', '.join(axes)}"
        else:
            continue
        raise InputError(
            f"{c.folder}: not of the same machine as {first.folder}: {what}; a trend needs campaigns of one machine"
        )
