"""The report of a diagnosis: its numbers and figures brought into the page's content."""

from __future__ import annotations

import hashlib
import platform
from importlib.metadata import version

from mjsim.compare import TestComparison
from mjsim.diagnose import DiagnosedEffect, Diagnosis
from mjsim.effects import registry
from mjsim.ladder import Step
from mjsim.machine.files import machine_document
from mjsim.measure.iso230 import BidirectionalFigures, CircularFigures
from mjsim.output import conditions, polar_traces, residual_trace
from mjsim.report.content import BidirectionalRow, Finding, LadderRow, NotTestable, ParameterRow, ReportContent, SetUpRow, TestSection
from mjsim.report.page import render
from mjsim.units import UM, unit_of

_SENTENCE = {
    "identified": "The effects below are missing from the machine's model; no other effect of the catalogue explains the data as well.",
    "ambiguous": "Effects are missing from the machine's model, but these tests cannot tell all of them from their rivals.",
    "unknown": "Something repeatable is left that no effect of the catalogue explains.",
    "nothing_found": "The model explains the measurement down to the noise and the data sheet's tolerances.",
}


def build_report(result: Diagnosis, steps: list[Step], date: str = "") -> str:
    """The HTML page of a diagnosis and its ladder; ``date`` is printed as it is."""
    return render(content(result, steps, date))


def content(result: Diagnosis, steps: list[Step], date: str = "") -> ReportContent:
    """Everything the page says."""
    c, m = result.campaign, result.before.machine
    setups = [
        SetUpRow(
            name,
            [float(x / UM) for x in v[:3]],
            [float(x / UM) for x in v[3:]],
            [t.test.name for t in result.after.tests if t.test.setup == name],
        )
        for name, v in result.after.setups.items()
    ]
    text = machine_document(result.machine, m.path) if m.path else repr(result.machine)
    return ReportContent(
        title=f"{c.name}: ball-bar diagnosis",
        summary=[
            ("Machine", f"{m.name}, configuration {m.configuration}"),
            ("Campaign", f"{len(result.before.tests)} measured tests in {len(setups)} set-ups"),
            (
                "Instrument",
                f"ball bar, resolution {c.instrument.resolution / UM:g} µm, range ±{c.instrument.range * 1e3:g} mm, "
                f"{c.instrument.rate:g} Hz",
            ),
            ("Effects in the model as given", ", ".join(e.id for e in m.effects) or "none"),
        ],
        verdict=result.verdict,
        verdict_sentence=_SENTENCE[result.verdict],
        ladder=[LadderRow(s.label, s.rms_um, s.tests) for s in steps],
        findings=[_finding(e) for e in result.effects],
        tests=[_section(b, a, result) for b, a in zip(result.before.tests, result.after.tests, strict=True)],
        noise_um=result.noise / UM,
        noise_source=result.before.noise_source,
        setups=setups,
        length_offset_um=result.after.length / UM,
        bidirectional=[
            BidirectionalRow((b["ccw"], b["cw"]), _both(b["measured"]), _both(b["simulated"]), _both(a["simulated"]))
            for b, a in zip(result.before.bidirectional, result.after.bidirectional, strict=True)
        ],
        unexplained=result.unexplained.summary if result.unexplained else "",
        not_testable=[NotTestable(i, registry.effect_class(i)[0].title) for i in result.not_testable],
        provenance=[
            ("mjsim", version("mjsim")),
            ("MuJoCo", version("mujoco")),
            ("numpy", version("numpy")),
            ("Python", platform.python_version()),
            ("random numbers", "none are drawn"),
            ("fitted machine, SHA-256", hashlib.sha256(text.encode()).hexdigest()),
        ],
        date=date,
    )


def _both(figures: dict) -> BidirectionalFigures:
    return BidirectionalFigures(**{k: tuple(v) if isinstance(v, list) else v for k, v in figures.items()})


def _circular(figures: dict | None) -> CircularFigures | None:
    return CircularFigures(**{k: tuple(v) if isinstance(v, list) else v for k, v in figures.items()}) if figures else None


def _finding(e: DiagnosedEffect) -> Finding:
    rows = []
    for name in e.free:
        value, ci = e.effect.values[name], e.ci95.get(name)
        if name == "components":
            unit = "°" if e.effect.subject in ("A", "C") else "µm"
            for i, (order, amplitude, phase) in enumerate(value):
                rows.append(ParameterRow(f"order {order:g}, amplitude", amplitude, ci[0][i][1], ci[1][i][1], unit))
                rows.append(ParameterRow(f"order {order:g}, phase", phase, ci[0][i][2], ci[1][i][2], "°"))
        else:
            rows.append(ParameterRow(name, value, ci[0] if ci else None, ci[1] if ci else None, unit_of(name)[1]))
    where = "" if e.tests else "Shows in no single test above a quarter of the noise."
    return Finding(
        e.effect.id,
        e.effect.title,
        rows,
        e.rms_before / UM,
        e.rms_after / UM,
        e.alternatives,
        f"{e.effect.signature} {where}".strip(),
        e.tests,
    )


def _section(before: TestComparison, after: TestComparison, result: Diagnosis) -> TestSection:
    changed = bool(result.effects)
    return TestSection(
        name=before.test.name,
        conditions=conditions(before.test),
        before=polar_traces(before),
        after=polar_traces(after) if changed else (),
        residual=residual_trace(after, result.noise),
        rms_before_um=before.rms / UM,
        rms_after_um=after.rms / UM if changed else None,
        measured=_circular(before.iso.get("measured")),
        simulated_before=_circular(before.iso.get("simulated")),
        simulated_after=_circular(after.iso.get("simulated")) if changed else None,
        trigger_ms=after.trigger * 1e3,
        setup=before.test.setup,
    )
