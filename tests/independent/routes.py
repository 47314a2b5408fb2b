"""One machine of the typical class, measured in every way: ball bar, probe and sphere, a laser along X, axis logs.

Every instrument sees the same errors. No code of mjsim.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomlkit

from . import campaign, layouts, machine_logs, machines, positions, real_machines, sphere
from .kinematics import DEG, MICRO

#: The laser's line: nine targets, three runs from either side.
LINE = {"name": "laser-x", "axis": "X", "ends": (0.0, 300.0), "count": 9, "runs": 3}
#: Axes whose moves the control records.
LOGGED = ("X", "C")
#: Limit of the play of a linear axis, m.
_PLAY = 0.8e-6
#: Kinds of faults and what of the machine may have one.
FAULTS = {
    "axis_location": ("EX0C", "EY0C", "EY0A", "EZ0A", "EA0C", "EB0C", "EB0A", "EC0A"),
    "squareness": ("XY", "YZ", "ZX"),
    "scale_error": ("X", "Y", "Z"),
    "straightness": ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"),
    "backlash": ("X", "A", "C"),
    "friction": ("X", "C"),
}
_KEYS = {"axis_location": "location", "squareness": "square", "scale_error": "scale"}


def draw(seed: int, faulty: bool) -> tuple[dict, list[dict], dict | None]:
    """Errors of a machine as :func:`sphere.draw` makes them, causes in its drives, and the fault, a table.

    A fault is two to five times as large as its limit.
    """
    rng = np.random.default_rng([seed, 41])
    errors = sphere.draw(rng)
    errors["play"] |= {a: abs(float(rng.normal(0.0, 0.5 * _PLAY))) for a in "XYZ"}
    if not faulty:
        return errors, [], None
    kind = str(rng.choice(list(FAULTS)))
    subject = str(rng.choice(FAULTS[kind]))
    fault = real_machines.beyond(kind, subject, machines.nominal("M1"), rng, (2.0, 5.0))
    size = next(v for k, v in fault.items() if k != "id")
    if kind == "friction":
        return errors, [fault], fault
    if kind == "straightness":
        errors["straight"][subject] = np.array([MICRO * size, 0.0])
        fault = fault | {"cubic_um": 0.0}
    elif kind == "backlash":
        errors["play"][subject] = size * (DEG if subject in "ABC" else MICRO)
    else:
        errors[_KEYS[kind]][subject] = MICRO * size
    return errors, [], fault


def write(folder: Path | str, seed: int, faulty: bool = False, layout: str = "standard", logged=LOGGED, **how) -> dict:
    """Writes the campaign: tests of the ball bar, ``points``, ``laser-x``, and a log of each of some axes.

    Args:
        folder: Made where it is not there.
        seed: Of everything that is drawn.
        faulty: Whether one error is beyond its limit.
        layout: Of the ball-bar tests, in :mod:`.layouts`; empty: none.
        logged: Letters of the axes whose moves are recorded.
        how: ``drawn``, what :func:`draw` gives, in the place of what it would give.

    Returns:
        ``effects``: the errors as ``[[effect]]`` tables; ``fault``: the one that is beyond its limit, or ``None``.
    """
    errors, causes, fault = how.get("drawn") or draw(seed, faulty)
    folder, small = Path(folder), sphere.tables(errors)
    sphere.write(folder, seed, errors)
    parts = {"probe": _read(folder)}
    bars = tuple(layouts.layout(layout)) if layout else ()
    more = {"hidden": tuple(causes), "within": tuple(small), "tolerance_stated": True}
    case = campaign.Case("routes", "M1", bars, seed=seed, **more)
    campaign.write_files(case, folder)
    if bars:
        parts["bar"] = _read(folder)
    lead = {a: machines.nominal("M1")["drive"][a]["lead_mm"] * 1e-3 for a in "XYZ"}
    waves = {a: [(lead[a] / n, c, s) for n, c, s in errors["waves"][a]] for a in "XYZ"}
    positions.write(folder / "laser", seed, errors | {"waves": waves}, [LINE])
    (folder / "laser" / "traces" / "laser-x.csv").rename(folder / "traces" / "laser-x.csv")
    parts["laser"] = _read(folder / "laser")
    if logged:
        parts["control"] = {"instrument": _CONTROL, "test": [_log(case, folder, axis) for axis in logged]}
    whole = {"name": "routes", "machine": "machine.toml"}
    whole["instrument"] = {name: part["instrument"] for name, part in parts.items()}
    whole["test"] = [test for part in parts.values() for test in part["test"]]
    (folder / "campaign.toml").write_text(tomlkit.dumps(whole))
    return {"effects": real_machines.with_causes(small, causes) + causes, "fault": fault}


_CONTROL = {
    "kind": "axis_log",
    "sample_rate_Hz": 1000.0,
    "resolution_um": 0.1,
    "resolution_deg": machine_logs.STEP[True] / DEG,
}


def _log(case: campaign.Case, folder: Path, axis: str) -> dict:
    """Writes the log of an axis; its ``[[test]]`` table."""
    command, name = machine_logs.strokes(axis), f"strokes-{axis.lower()}"
    text = machine_logs.csv(axis, command, *machine_logs.recorded(case, axis, command))
    (folder / "traces" / f"{name}.csv").write_text(text)
    return {"name": name, "kind": "log", "trace": f"traces/{name}.csv", "axes": [axis]}


def _read(folder: Path) -> dict:
    return tomlkit.parse((folder / "campaign.toml").read_text()).unwrap()
