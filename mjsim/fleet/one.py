"""One campaign of a fleet: its diagnosis as plain data. Run as a module, it is a process that diagnoses one campaign
after another: a folder and the options on each line of its input, the result on a line of its output.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_of
from mjsim.errors import InputError, SimulationError, shortened
from mjsim.fleet.jobs import Options, unpack
from mjsim.io.files import finite
from mjsim.machine.chain import is_rotary
from mjsim.report.causes import CalibrationRow, calibration_rows
from mjsim.report.content import plain
from mjsim.units import unit_of
from mjsim.workflow.diagnose import diagnose
from mjsim.workflow.diagnosis import Diagnosis
from mjsim.workflow.finding import DiagnosedEffect


def diagnosed(folder: Path, options: Options, threads: int = 1) -> dict:
    """The diagnosis of one campaign as plain data; what goes wrong is part of it.

    Args:
        folder: Of the campaign.
        options: How it is diagnosed.
        threads: Tests that are worked on side by side.
    """
    begun = time.monotonic()
    row: dict = {"folder": str(folder), "campaign": folder.name, "machine": "", "configuration": "", "date": None}
    try:
        campaign = read_campaign(folder, as_is=options.as_is)
        machine = machine_of(campaign)
        row |= {
            "campaign": campaign.name,
            "machine": machine.name,
            "configuration": machine.configuration,
            "date": campaign.measured_on.isoformat() if campaign.measured_on else None,
            "tests": len(campaign.measured),
        }
        result = diagnose(campaign, machine, options.max_effects, threads)
        found = finite(plain(_found(result)))  # plain numbers, which JSON has
        return row | found | {"error": None, "seconds": round(time.monotonic() - begun, 2)}
    except (InputError, SimulationError) as error:
        what = str(error)
    except MemoryError:
        what = "not enough memory"
    except Exception as error:  # one campaign must not end the fleet
        what = shortened(f"a fault of mjsim itself: {type(error).__name__}: {error}", 400)
    return row | {"error": what, "seconds": round(time.monotonic() - begun, 2)}


def diagnosed_elsewhere(files: dict[str, bytes], options: Options) -> dict:
    """The same for a campaign that has travelled here as its files."""
    with tempfile.TemporaryDirectory(prefix="mjsim-") as scratch:
        try:
            folder = unpack(files, Path(scratch))
        except InputError as error:
            return {"error": str(error), "seconds": 0.0}
        return diagnosed(folder, options)


def _found(result: Diagnosis) -> dict:
    data, rows = result.to_json(), calibration_rows(result)
    limits = {(r.effect_id, r.name): r for r in rows if r.finding}
    return {
        "verdict": result.verdict,
        "noise_um": data["noise_um"],
        "rms_before_um": data["rms_before_um"],
        "rms_after_um": data["rms_after_um"],
        "unexplained": data["unexplained"]["summary"] if data["unexplained"] else None,
        "findings": [row for e in result.effects for row in _sizes(e, result, limits)],
        "calibration": [_number(r) for r in rows if not r.finding],
    }


def _sizes(e: DiagnosedEffect, result: Diagnosis, limits: dict[tuple[str, str], CalibrationRow]) -> list[dict]:
    """One row for each size of a finding; most have one."""
    base = {
        "effect": e.effect.key,
        "title": e.effect.title,
        "share": round(result.explained_shares.get(e.effect.key, 0.0), 5),
        "alternatives": list(e.alternatives),
    }
    out = []
    for p in e.effect.parameters_of(e.effect.subject):
        if p.name not in e.free or not p.leading:
            continue
        value, ends = e.effect.values[p.name], e.ci95.get(p.name)
        if p.kind == "components":
            unit = "°" if is_rotary(e.effect.subject) else "µm"
            for i, (order, amplitude, _) in enumerate(value):
                low, high = (ends[0][i][1], ends[1][i][1]) if ends else (None, None)
                out.append(base | _size(f"order {order:g}", unit, amplitude, low, high))
        else:
            out.append(base | _size(p.name, unit_of(p.name)[1], value, *(ends or (None, None))))
    for row in out:
        known = limits.get((row["effect"], row["number"]))
        row |= {"expected": known.expected, "limit": known.limit} if known else {"expected": None, "limit": None}
    return out or [base | _size("", "", None, None, None) | {"expected": None, "limit": None}]


def _size(number: str, unit: str, value, low, high) -> dict:
    return {"number": number, "unit": unit, "value": value, "low": low, "high": high}


def _number(r: CalibrationRow) -> dict:
    return {
        "effect": r.effect_id,
        "title": r.title,
        **_size(r.name, r.unit, r.value, r.low, r.high),
        "expected": r.expected,
        "limit": r.limit,
        "used_percent": r.used_percent,
        "observable": r.observable,
        "rms_um": r.rms_um,
    }


def serve() -> None:
    """Diagnose what each line of the standard input names, until it ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever prints meanwhile does not get between the answers
    for line in sys.stdin:
        order = json.loads(line)
        row = diagnosed(Path(order["folder"]), Options(**order["options"]))
        answers.write(json.dumps(row) + "\n")
        answers.flush()


if __name__ == "__main__":
    serve()
