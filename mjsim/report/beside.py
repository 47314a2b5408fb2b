"""What the page says of instruments other than the ball bar: recordings and their pictures; of axis logs also findings,
ladder and data sheet.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

import numpy as np

from mjsim.commands.any_instrument import PlainTest
from mjsim.commands.axis_log.compare import ComparedAxis
from mjsim.commands.axis_log.diagnosis import MORE_IS_LEFT, LogDiagnosis
from mjsim.commands.comparison import ComparedChannel, ComparedPart, ComparedTest
from mjsim.commands.diagnosis import AtRest, Diagnosis
from mjsim.commands.finding import DiagnosedEffect
from mjsim.digits import decimals_of, estimate, expanded, fixed, interval, wave_ends
from mjsim.inference.budget import Budget
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.model import sheet_name
from mjsim.plots.comparison import titled_figures
from mjsim.report.page import data_uri
from mjsim.units import DEG, UM, percent, unit_of

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
        "effects": [],
        "unexplained": None,
        "ladders": [],
        "sheet": [],
        "not_separable": [],
        "not_testable": [],
        "provenance": [["mjsim", version("mjsim")], ["mujoco", version("mujoco")], ["numpy", version("numpy")]],
    }


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
        "not_separable": [
            f"{i['axis']}: only a combination of {', '.join(i['numbers'])} is known; {i['remedy']}."
            for i in data["not_separable"]
        ],
        "not_testable": data["not_testable"],
    }


def _finding(e: DiagnosedEffect, row: dict) -> dict:
    rows = []
    for name, value in row["parameters"].items():
        ends = row["ci95"].get(name)
        if name == "components":
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
        "found": estimate(row["found"], row["ci95"]),
        "ends": interval(row["ci95"]),
        "source": row["source"] if row["known"] else "the data sheet",
    }
