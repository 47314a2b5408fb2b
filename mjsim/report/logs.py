"""The page of a campaign of axis logs: findings, ladder, data sheet, and the pictures of every recording."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.estimation.mistakes.checked_problem import checked_problem
from mjsim.machine.model import Machine
from mjsim.machine.model import build as build_plant
from mjsim.machine.sheet_names import sheet_name
from mjsim.plots.logs import axis_figure, circle_figure
from mjsim.progress import Progress, silent
from mjsim.report import build
from mjsim.report.page import VERDICTS, data_uri, finite, page, render
from mjsim.units import DEG, UM
from mjsim.workflow.compare import compare
from mjsim.workflow.joint_diagnose import bars_of, diagnose_jointly, logs_of
from mjsim.workflow.log_compare import LogComparison, compare_logs
from mjsim.workflow.log_diagnose import diagnose_logs
from mjsim.workflow.log_diagnosis import LogDiagnosis, LogEffect

_SENTENCES = {
    "identified": "These effects are missing from the model, and nothing else explains the logs as well.",
    "ambiguous": "Some of these effects cannot be told from others by these logs.",
    "unknown": "Something is left that no effect of the catalogue explains.",
    "nothing_found": "The model explains the logs within the tolerances of the data sheet.",
}
#: Findings that the first box names.
_NAMED = 3


def log_report(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None = None,
    diagnosed: bool = True,
    threads: int = 2,
    progress: Progress = silent,
) -> tuple[str, dict]:
    """The report of a campaign of axis logs: its page, and the page's numbers as plain data.

    Args:
        campaign: With at least one recording.
        machine: As given.
        max_effects: At most so many causes on each axis.
        diagnosed: Look for missing effects; otherwise compare only.
        threads: Simulations side by side.
        progress: Called as work gets on.

    Raises:
        InputError: No log has a recording, or a controller is missing.
    """
    if diagnosed:
        result = diagnose_logs(campaign, machine, max_effects or 8, threads, progress)
        data, shown = _of_diagnosis(result), result.after
    else:
        shown = compare_logs(campaign, machine, threads, progress)
        data = _of_comparison(shown)
    progress("writing the page", 0, 1)
    verdict = VERDICTS.get(data["verdict"] or "")
    return page("logs.html", data, None, (), verdict=verdict, images=log_images(shown)), finite(data)


def joint_report(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None = None,
    diagnosed: bool = True,
    threads: int = 2,
    progress: Progress = silent,
) -> tuple[str, dict]:
    """The report of a campaign with ball-bar tests and axis logs: the page of the ball bar, and the logs below it.

    Args:
        campaign: With both.
        machine: As given.
        max_effects: At most so many causes.
        diagnosed: Look for missing effects; otherwise compare only.
        threads: Simulations side by side.
        progress: Called as work gets on.
    """
    day = campaign.measured_on.isoformat() if campaign.measured_on else ""
    if diagnosed:
        result = diagnose_jointly(campaign, machine, max_effects, threads, progress)
        content = build.diagnosed(result.as_diagnosis(), threads, progress, day)
        shown = result.logs.after
        said = [f"{e.effect.id}: {e.sentence}" for e in result.effects]
        logs = _of_diagnosis(result.logs) | {"said": said}
    else:
        problem = checked_problem(bars_of(campaign), build_plant(machine), threads)
        bars = compare(bars_of(campaign), machine, threads, progress, problem)
        content = build.compared(problem, bars, threads, progress, day)
        shown = compare_logs(logs_of(campaign), machine, threads, progress)
        logs = _of_comparison(shown) | {"said": []}
    progress("writing the page", 0, 1)
    return render(content, logs, log_images(shown)), finite(content.to_json() | {"axis_logs": logs})


def log_images(shown: LogComparison) -> list[list[tuple[str, str]]]:
    """Names and data URIs of the pictures of every log."""
    images = []
    for t in shown.tests:
        mine = [(f"{t.test.name}, axis {a.axis}", data_uri(axis_figure(t, a))) for a in t.axes.values()]
        if t.circle is not None:
            mine.append((f"{t.test.name}, radial deviation on the circle", data_uri(circle_figure(t))))
        images.append(mine)
    return images


def _of_comparison(result: LogComparison) -> dict:
    said = result.to_json()
    tests = []
    for t in said["tests"]:
        axes = []
        for a in t["axes"]:
            unit = "um" if "rms_um" in a else "deg"
            symbol = {"um": "µm", "deg": "°"}[unit]
            names = {"following": "following_error", "rms": "rms", "max": "max", "noise": "noise"}
            axes.append({"axis": a["axis"]} | {k: f"{a[f'{v}_{unit}']:.4g} {symbol}" for k, v in names.items()})
        tests.append({"name": t["name"], "axes": axes})
    return {
        "title": result.campaign.name,
        "machine": result.machine.name,
        "axes": list(result.campaign.logs.axes),
        "verdict": None,
        "rms_before_um": None,
        "rms_after_um": said["rms_um"],
        "noise_um": said["noise_um"],
        "noise_source": said["noise_source"],
        "tests": tests,
        "effects": [],
        "unexplained": None,
        "ladders": [],
        "sheet": [],
        "not_separable": [],
        "not_testable": [],
        "provenance": [["mjsim", version("mjsim")], ["mujoco", version("mujoco")], ["numpy", version("numpy")]],
    }


def _of_diagnosis(result: LogDiagnosis) -> dict:
    said = result.to_json()
    nouns = [e.effect.noun or e.effect.kind.replace("_", " ") for e in result.effects[:_NAMED]]
    names = [f"{noun} of {e.effect.subject}" for noun, e in zip(nouns, result.effects, strict=False)]
    more = len(result.effects) - len(names)
    answer = ", ".join(names) + (f", and {more} smaller" if more > 0 else "")
    return _of_comparison(result.after) | {
        "verdict": result.verdict,
        "answer": f"{answer[:1].upper()}{answer[1:]}." if names else "No effect is missing from the machine's model.",
        "sentence": _SENTENCES[result.verdict],
        "rms_before_um": said["rms_before_um"],
        "effects": [_finding(e, row) for e, row in zip(result.effects, said["effects"], strict=True)],
        "unexplained": said["unexplained"]["summary"] if said["unexplained"] else None,
        "ladders": _ladders(result),
        "sheet": [_sheet_row(row) for row in said["data_sheet"]],
        "not_separable": [
            f"{i['axis']}: only a combination of {', '.join(i['numbers'])} is known; {i['remedy']}."
            for i in said["not_separable"]
        ],
        "not_testable": said["not_testable"],
    }


def _finding(e: LogEffect, row: dict) -> dict:
    rows = []
    for name, value in row["parameters"].items():
        ends = row["ci95"].get(name)
        if name == "components":
            for (order, size, _), low, high in zip(value, *(ends or (value, value)), strict=True):
                rows.append([f"amplitude of order {order:g}, N·m", f"{size:.3g}", f"{low[1]:.3g} to {high[1]:.3g}"])
        elif ends:
            rows.append([name, f"{value:.4g}", f"{ends[0]:.4g} to {ends[1]:.4g}"])
        else:
            rows.append([name, f"{value:.4g}", "–"])
    if "rms_before_deg" in row:
        size = f"{row['rms_before_deg']:.3g} → {row['rms_after_deg']:.3g} °"
    else:
        size = f"{row['rms_before_um']:.2f} → {row['rms_after_um']:.2f} µm"
    keys = ("id", "alternatives", "tests")
    return (
        {k: row[k] for k in keys}
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
        steps = [("as given", s.given), ("data sheet fitted", s.ladder[0])]
        steps += [(f"+ {key}", fit) for key, fit in zip(s.order, s.ladder[1:], strict=False)]
        steps.append(("final model", s.fit))
        rows = [[name, [float(v) / unit for v in np.sqrt(fit.mean_squares)]] for name, fit in steps]
        symbol = "°" if rotary else "µm"
        form = "%.3g" if rotary else "%.2f"
        rows = [[name, [form % v for v in values]] for name, values in rows]
        out.append({"axis": axis, "unit": symbol, "tests": names, "rows": rows})
    return out


def _sheet_row(row: dict) -> dict:
    where = f" ({row['controller']})" if row["controller"] else ""
    low, high = row["ci95"]
    name, unit = sheet_name(row["name"])
    return {
        "name": f"{row['axis']} {name}{where}, {unit}".rstrip(", "),
        "stated": f"{row['stated']:.4g}",
        "found": f"{row['found']:.4g}",
        "ends": f"{low:.4g} to {high:.4g}",
        "source": row["source"] if row["known"] else "the data sheet",
    }
