"""The campaigns of a fleet: where they are, what they consist of, and the diagnosis of one as plain data.

Run as a module, it is a process that diagnoses one campaign after another: a folder and the options on each line of its
input, the result on a line of its output. To the workers of a cluster a campaign travels as its files.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mjsim.batch.tables import versions
from mjsim.batch.targets import DRIVERS
from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_of
from mjsim.campaign.temperature import FILE
from mjsim.commands.diagnose import diagnose
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.finding import DiagnosedEffect
from mjsim.errors import InputError, SimulationError, shortened
from mjsim.io.cache import code
from mjsim.io.files import finite
from mjsim.machine.chain import is_rotary
from mjsim.report.causes import CalibrationRow, calibration_rows
from mjsim.report.content import plain
from mjsim.units import unit_of

_CAMPAIGN = "campaign.toml"


@dataclass(frozen=True)
class Options:
    """How every campaign is diagnosed.

    Attributes:
        max_effects: At most so many missing effects are looked for; without it as many as the data prove.
        as_is: Do not look for a wrong unit, sign or direction first.
    """

    max_effects: int | None = None
    as_is: bool = False


@dataclass(frozen=True)
class Job:
    """One campaign.

    Attributes:
        folder: Where it is.
        key: Hash of its files, of the versions and of the options: the same key, the same result.
    """

    folder: Path
    key: str


def campaigns_in(folders: Sequence[Path]) -> list[Path]:
    """Folders with a ``campaign.toml``, in order and each once: the given ones, and what lies below them.

    What lies below a campaign, such as its held-out tests, belongs to it and is not looked at.

    Raises:
        InputError: A folder is missing, or has no campaign.
    """
    out: dict[Path, None] = {}
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; allowed: a campaign's folder, or one with campaigns below it")
        found = False
        for place, below, files in os.walk(folder):
            below[:] = sorted(name for name in below if not name.startswith("."))
            if _CAMPAIGN in files:
                out.setdefault(Path(place).resolve())
                below.clear()
                found = True
        if not found:
            raise InputError(f"{folder}: has no campaign.toml, and no folder below it has one")
    return list(out)


def job_of(folder: Path, options: Options) -> Job:
    """A campaign as a job."""
    digest = hashlib.sha256(json.dumps([versions(), vars(options), code()]).encode())
    for name, content in sorted(files_of(folder).items()):
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return Job(folder, digest.hexdigest()[:32])


def files_of(folder: Path) -> dict[str, bytes]:
    """What a campaign consists of: its files by their path relative to the folder. What is missing is left out."""
    folder = folder.resolve()
    names = {_CAMPAIGN, FILE}
    campaign = _table(folder / _CAMPAIGN)
    machine = str(campaign.get("machine", "machine.toml"))
    names.add(machine)
    for test in _tables(campaign.get("test")):
        names |= {str(test[key]) for key in ("trace", *DRIVERS) if key in test}
    beside = os.path.dirname(machine)
    for effect in _tables(_table(folder / machine).get("effect")):
        if "file" in effect:
            names.add(os.path.join(beside, str(effect["file"])))
    out = {}
    for name in names:
        try:
            out[Path(os.path.relpath(folder / name, folder)).as_posix()] = (folder / name).read_bytes()
        except (OSError, ValueError):
            continue
    return out


def unpack(files: dict[str, bytes], into: Path) -> Path:
    """Write the files of a campaign below ``into``; the campaign's folder there."""
    up = max((name.split("/").count("..") for name in files), default=0)
    folder = into.joinpath(*(f"level{i}" for i in range(up)), "campaign")
    for name, content in files.items():
        place = Path(os.path.normpath(folder / name))
        if not place.is_relative_to(into):
            raise InputError(f"{name}: lies outside of the campaign; allowed: paths relative to it")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
    return folder


def _table(file: Path) -> dict:
    """A TOML file as it is; empty where it cannot be read, which the diagnosis says."""
    try:
        return tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError):
        return {}


def _tables(value: object) -> list[dict]:
    return [row for row in value if isinstance(row, dict)] if isinstance(value, list) else []


# -- diagnosis ---------------------------------------------------------------------------------------------------------


def diagnosed(folder: Path, options: Options) -> dict:
    """The diagnosis of one campaign as plain data; what goes wrong is part of it.

    Args:
        folder: Of the campaign.
        options: How it is diagnosed.
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
        result = diagnose(campaign, machine, options.max_effects, threads=1)
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
