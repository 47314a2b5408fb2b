"""The report of a diagnosis, or of a comparison alone: its numbers and figures brought into the page's content."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import Any

from mjsim.campaign.machine_file import machine_document
from mjsim.commands.ball_bar.compare import BarComparison, ComparedBarTest
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.saved import saved_of
from mjsim.compensation.compensate import compensate
from mjsim.inference.problem import Problem
from mjsim.instruments.ball_bar.iso230 import BidirectionalFigures, CircularFigures
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.model import Machine
from mjsim.plots.output import conditions, polar_traces, residual_trace
from mjsim.plots.part import part_figure
from mjsim.prediction.part_run import PartRun
from mjsim.progress import Progress, silent
from mjsim.report.answer import explained, headlines
from mjsim.report.causes import calibration_rows, waterfall
from mjsim.report.content import BidirectionalRow, ModelRow, PartSection, ReportContent, SetUpRow, TestSection, WhatIf
from mjsim.report.evidence import findings, next_test_sentence, rest_percent, untestable
from mjsim.report.models import Model, basis, ladder, prepared
from mjsim.report.traces import test_traces
from mjsim.report.whatif import what_if
from mjsim.units import DEG, UM


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
    rest = rest_percent(result)
    return ReportContent(
        **{
            **base,
            "title": f"{result.campaign.name}: {_noun(result.before)} diagnosis",
            "verdict": result.verdict,
            "answer": headlines(result),
            "verdict_sentence": explained(result),
            "findings": findings(result),
            "unexplained": result.unexplained.summary if result.unexplained else _rest(rest),
            "curve": (*u.curve, u.labels, u.summary, u.period) if (u := result.unexplained) else None,
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
            ModelRow(x.label, _um(x.comparison.rms), [_um(t.rms) for t in x.comparison.tests], x.what,
                x.how) for x in models
        ],
        "start": start,
        "tests": [_section(b, a, before.noise, changed=before is not after) for b, a in zip(before.tests, after.tests,
        strict=True)],
        "noise_um": _um(before.noise),
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


def _um(x: float) -> float:
    return round(float(x / UM), 4)


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
        rms_before_um=_um(before.rms),
        rms_after_um=_um(after.rms) if changed else None,
        measured=_circular(before.iso.get("measured")),
        simulated_before=_circular(before.iso.get("simulated")),
        simulated_after=_circular(after.iso.get("simulated")) if changed else None,
        trigger_ms=round(after.trigger * 1e3, 2),
        setup=before.test.setup,
        left_out=int((~before.valid).sum()),
        worst=f"{after.worst_phi / DEG % 360.0:.0f}°, {after.worst_event}",
    )
