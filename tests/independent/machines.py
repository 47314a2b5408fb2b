"""Nominal machines (what machine.toml says) and the true machine that differs from it inside the data sheet.

Numbers are assumed, in the range of small and medium five-axis machining centres; M1 and M2 are also the machines of
the examples. A machine is a dict as read from machine.toml: ``name``, ``configuration``, ``drive`` (by axis),
``effect`` (list).
"""

from __future__ import annotations

import copy
from collections.abc import Iterable

import numpy as np

from .kinematics import AXES

#: Data-sheet tolerance, one standard deviation, relative; settings of the control are nearly exact.
TOLERANCE = {
    "position_gain_per_s": 0.0003,
    "integral_time_s": 0.005,
    "velocity_gain_Nms_per_rad": 0.02,
    "inertia_kgm2": 0.03,
    "viscous_Nms_per_rad": 0.10,
}
FRICTION_TOLERANCE = {"coulomb_Nm": 0.05, "presliding_rad": 0.10}
#: An effect that is planted with an exact size fixes the drive's number that it acts on.
FIXES = {
    "servo_gain": "position_gain_per_s",
    "velocity_gain": "velocity_gain_Nms_per_rad",
    "viscous_friction": "viscous_Nms_per_rad",
}

# Per axis: lead mm or teeth, Kpp, Kvp, Ti, J, viscous, gravity, Coulomb, presliding
_ROWS = {
    "M1": (
        (10.0, 45.0, 4.0, 0.012, 0.0100, 0.010, 0.0, 1.00, 0.0030),
        (10.0, 45.0, 5.0, 0.012, 0.0130, 0.012, 0.0, 1.20, 0.0030),
        (10.0, 45.0, 4.0, 0.012, 0.0105, 0.010, 3.0, 0.90, 0.0030),
        (60, 45.0, 1.6, 0.012, 0.0042, 0.004, 0.0, 0.40, 0.0060),
        (72, 45.0, 1.4, 0.012, 0.0036, 0.004, 0.0, 0.35, 0.0060),
    ),
    "M2": (
        (16.0, 60.0, 5.5, 0.010, 0.0120, 0.015, 0.0, 1.60, 0.0022),
        (16.0, 60.0, 6.0, 0.010, 0.0135, 0.015, 0.0, 2.00, 0.0022),
        (12.0, 60.0, 5.0, 0.010, 0.0110, 0.012, 4.5, 1.40, 0.0025),
        (90, 60.0, 1.2, 0.010, 0.0026, 0.003, 0.0, 0.30, 0.0080),
        (120, 60.0, 1.1, 0.010, 0.0022, 0.003, 0.0, 0.25, 0.0080),
    ),
    "M3": (  # a heavy machine with soft position loops, matched between the axes
        (20.0, 32.0, 9.0, 0.018, 0.0320, 0.030, 0.0, 3.20, 0.0040),
        (20.0, 32.0, 11.0, 0.018, 0.0400, 0.035, 0.0, 3.80, 0.0040),
        (12.0, 32.0, 7.0, 0.018, 0.0240, 0.020, 7.5, 2.10, 0.0045),
        (120, 32.0, 2.4, 0.018, 0.0075, 0.006, 0.6, 0.55, 0.0070),
        (144, 32.0, 2.2, 0.018, 0.0070, 0.006, 0.0, 0.50, 0.0070),
    ),
    "M4": (  # a fast small machine with feedforward on every axis
        (12.0, 80.0, 3.2, 0.008, 0.0048, 0.006, 0.0, 0.70, 0.0035),
        (12.0, 80.0, 3.6, 0.008, 0.0056, 0.006, 0.0, 0.80, 0.0035),
        (10.0, 80.0, 3.0, 0.008, 0.0045, 0.005, 2.0, 0.60, 0.0035),
        (72, 80.0, 0.9, 0.008, 0.0015, 0.002, 0.0, 0.18, 0.0090),
        (90, 80.0, 0.8, 0.008, 0.0013, 0.002, 0.0, 0.15, 0.0090),
    ),
    "K": (  # the paper's machine as far as it is known: 60 and 72 teeth; a C axis 0.7 % faster makes its Fig. 8b
        (10.0, 45.0, 4.0, 0.012, 0.0100, 0.010, 0.0, 1.00, 0.0030),
        (10.0, 45.0, 5.0, 0.012, 0.0130, 0.012, 0.0, 1.20, 0.0030),
        (10.0, 45.0, 4.0, 0.012, 0.0105, 0.010, 3.0, 0.90, 0.0030),
        (60, 45.0, 1.6, 0.012, 0.0042, 0.004, 0.0, 0.40, 0.0060),
        (72, 45.3, 1.4, 0.012, 0.0036, 0.004, 0.0, 0.35, 0.0060),
    ),
    "M5": (  # gains that differ between the axes, a gravity torque on A, sticking slides
        (10.0, 50.0, 5.0, 0.014, 0.0130, 0.012, 0.0, 1.50, 0.0028),
        (12.0, 48.0, 6.0, 0.014, 0.0150, 0.014, 0.0, 1.70, 0.0028),
        (8.0, 50.0, 4.2, 0.012, 0.0095, 0.010, 2.6, 1.00, 0.0030),
        (90, 46.0, 1.8, 0.012, 0.0046, 0.004, 0.3, 0.42, 0.0060),
        (60, 49.0, 1.9, 0.012, 0.0052, 0.005, 0.0, 0.45, 0.0055),
    ),
}
_KEYS = (*TOLERANCE, "gravity_Nm")
_EXTRA = {
    "M4": [{"id": f"velocity_feedforward.{a}", "ratio": 0.6} for a in AXES],
    "K": [{"id": "backlash.A", "width_deg": 0.003}],
    "M5": [{"id": "pitch_error.C", "components": [[60.0, 0.0006, 25.0]]}],
}
_STICKING = {"M5": {"X": (1.25, 0.35), "Y": (1.2, 0.4)}}


def _drawn(name: str) -> tuple[tuple[float, ...], ...]:
    """A data sheet drawn by chance around M1 to M4, for names such as R17."""
    rng = np.random.default_rng([77, int(name[1:])])
    base = _ROWS[("M1", "M2", "M3", "M4")[int(rng.integers(4))]]
    kpp = round(float(rng.uniform(0.8, 1.2)), 2)  # the same on all axes: position loops of one machine are matched
    rows = []
    for row in base:
        travel, gain, *rest = row
        teeth = isinstance(travel, int)
        travel = int(travel * rng.choice([0.75, 1.0, 1.25])) if teeth else travel
        scale = rng.uniform(0.75, 1.3, len(rest))
        rows.append(
            (travel, float(f"{gain * kpp:.3g}"), *(float(f"{v * s:.3g}") for v, s in zip(rest, scale, strict=True)))
        )
    return tuple(rows)


def nominal(name: str) -> dict:
    """A machine as its user knows it; ``R17`` and the like have a data sheet drawn by chance."""
    drive, effects = {}, []
    rows = _ROWS[name] if name in _ROWS else _drawn(name)
    for axis, (travel, kpp, kvp, ti, inertia, viscous, gravity, coulomb, presliding) in zip(AXES, rows, strict=True):
        values = dict(zip(_KEYS, (kpp, ti, kvp, inertia, viscous, gravity), strict=True))
        drive[axis] = {"lead_mm" if axis in "XYZ" else "worm_teeth": travel, **values}
        effect = {"id": f"friction.{axis}", "coulomb_Nm": coulomb, "presliding_rad": presliding}
        if axis in _STICKING.get(name, {}):
            effect["static_ratio"], effect["stribeck_velocity_rad_per_s"] = _STICKING[name][axis]
        effects.append(effect)
    effects += copy.deepcopy(_EXTRA.get(name, []))
    return {"name": name, "configuration": "w-C'A'Y'bXZ-t", "drive": drive, "effect": effects}


#: The machines of the bank.
MACHINES = ("M1", "M2", "M3", "M4", "M5")


def by_id(effects: Iterable[dict]) -> dict[str, dict]:
    """Effects as a mapping id -> parameters; a pitch error that acts one way only is an effect of its own, id@CW or
    id@CCW.
    """
    return {
        e["id"] + (f"@{e['direction']}" if "direction" in e else ""): {k: v for k, v in e.items() if k != "id"}
        for e in effects
    }


def with_hidden(model: dict[str, dict], hidden: Iterable[dict]) -> dict[str, dict]:
    """The model's effects with the planted ones: new ones are added, known ones take the planted parameters."""
    out = {k: dict(v) for k, v in model.items()}
    for name, parameters in by_id(hidden).items():
        known = out.get(name, {})
        if "components" in known and "components" in parameters:
            both = [*known["components"], *parameters["components"]]
            orders = [c[0] for c in both]
            if len(set(orders)) < len(orders):
                raise ValueError(f"{name}: an order is both known and planted")
            parameters = {**parameters, "components": both}
        out[name] = {**known, **parameters}
    return out


def true_machine(machine: dict, hidden: Iterable[dict], rng: np.random.Generator) -> tuple[dict, dict[str, dict]]:
    """Drives and effects as they really are: data-sheet tolerances drawn, hidden effects planted."""
    drives, effects = copy.deepcopy(machine["drive"]), by_id(machine["effect"])
    hidden = list(hidden)
    fixed = {(FIXES.get(kind), axis) for kind, axis in (e["id"].split(".") for e in hidden)}
    for axis in AXES:
        for key, sd in TOLERANCE.items():
            factor = 1.0 + sd * rng.standard_normal()
            drives[axis][key] *= 1.0 if (key, axis) in fixed else factor
        for key, sd in FRICTION_TOLERANCE.items():
            factor = 1.0 + sd * rng.standard_normal()
            if f"friction.{axis}" in effects:
                effects[f"friction.{axis}"][key] *= factor
    return drives, with_hidden(effects, hidden)
