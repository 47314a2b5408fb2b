"""One typical hidden effect per catalogue id, its shape drawn, its size left to be scaled; and where each shows.

Shapes (orders, positions, time constants) are assumed, in the range of machine-tool practice.
"""

from __future__ import annotations

import numpy as np

from .kinematics import AXES
from .machines import by_id, nominal
from .unlisted import (
    CoolerCycle,
    Crosstalk,
    EccentricPlay,
    EncoderStep,
    LooseGib,
    ReversalCreep,
    ScrewWobble,
    SideThrow,
    SlideFloat,
    SuddenShift,
    TableEgg,
    TableLift,
    ToothPatch,
    TorqueDeflection,
    Unlisted,
)

_DRIVE = (
    "friction",
    "sticking",
    "viscous_friction",
    "servo_gain",
    "velocity_gain",
    "servo_delay",
    "torque_ripple",
    "velocity_feedforward",
)
#: (kind, subject) of every single; ``sticking`` is friction with a static level, ``pitch_error_directed`` one that acts
#: one way only.
SINGLES: tuple[tuple[str, str], ...] = (
    *(
        (kind, axis)
        for kind in (*_DRIVE, "drive_compliance", "backlash", "pitch_error")
        for axis in AXES
        if (kind, axis) != ("sticking", "Z")
    ),
    *((kind, axis) for kind in ("pitch_error_directed", "worm_wear") for axis in "AC"),
    ("gravity_windup", "A"),
    *((kind, axis) for kind in ("scale_error", "thermal_drift", "vibration") for axis in "XYZ"),
    *(("straightness", name) for name in ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ")),
    *(("squareness", name) for name in ("XY", "YZ", "ZX")),
    *(("axis_location", name) for name in ("EX0C", "EY0C", "EA0C", "EB0C", "EY0A", "EZ0A", "EB0A", "EC0A")),
    ("radial_error_motion", "C"),
    ("tilt_error_motion", "C"),
)
#: Largest sensible target, µm RMS, by kind or id, of effects that stay small whatever is wrong; others take any.
LARGEST = {
    "friction": 0.25,
    "sticking": 0.15,
    "viscous_friction": 0.12,
    "velocity_gain": 0.08,
    "drive_compliance": 0.2,
    "vibration": 1.5,
    "servo_delay": 2.5,
    "torque_ripple": 0.5,
    "gravity_windup": 0.6,
    "thermal_drift": 2.0,
    "friction.Z": 0.12,
    "torque_ripple.Z": 0.2,
    "straightness.EZX": 0.6,
    "straightness.EZY": 0.6,
    "axis_location.EB0C": 0.25,
}
#: Singles that hardly show in any layout at any sensible size, or that the set-up errors hide: not to be counted as
#: misses.
FAINT = {
    *(f"viscous_friction.{a}" for a in AXES),
    *(f"sticking.{a}" for a in "XYC"),
    *("friction.C", "velocity_gain.C", "axis_location.EX0C", "axis_location.EY0A", "axis_location.EZ0A"),
}


def largest(kind: str, subject: str) -> float:
    """The largest target to ask of an effect, µm RMS."""
    return LARGEST.get(f"{kind}.{subject}", LARGEST.get(kind, 9.0))


def single(kind: str, subject: str, machine: str, rng: np.random.Generator) -> dict:
    """A hidden effect of about typical size on a machine."""
    model = nominal(machine)
    known, rotary = by_id(model["effect"]), subject in ("A", "C")
    name = f"{ {'sticking': 'friction', 'pitch_error_directed': 'pitch_error'}.get(kind, kind) }.{subject}"
    sign, phase = float(rng.choice([-1.0, 1.0])), float(rng.integers(-18, 18) * 10)
    teeth = float(model["drive"][subject].get("worm_teeth", 1.0)) if subject in model["drive"] else 1.0
    if kind in ("friction", "sticking"):
        coulomb = known[name]["coulomb_Nm"]
        if kind == "friction":
            return {"id": name, "coulomb_Nm": coulomb * 1.4}
        slow = 0.1 if not rotary else 0.5
        return {
            "id": name,
            "static_ratio": 1.6 + 0.1 * (known[name].get("static_ratio", 1.0) - 1.0),
            "stribeck_velocity_rad_per_s": slow,
        }
    if kind == "pitch_error" and rotary:
        first = [teeth, 0.001, phase]
        second = [float(rng.choice([1.0, 2.0, 2.0 * teeth])), 0.0005, float(rng.integers(0, 36) * 10)]
        taken = {c[0] for c in known.get(name, {}).get("components", [])}
        return {"id": name, "components": [c for c in (first, second) if c[0] not in taken]}
    if kind == "pitch_error_directed":
        return {"id": name, "components": [[teeth, 0.001, phase]], "direction": str(rng.choice(["CW", "CCW"]))}
    location = "value_um" if subject in ("EX0C", "EY0C", "EY0A", "EZ0A") else "value_urad"
    feedforward = known.get(f"velocity_feedforward.{subject}", {}).get("ratio", 0.0)
    stiffness = {"stiffness_Nm_per_urad": 0.05} if rotary else {"stiffness_N_per_um": 60.0}
    return {
        "id": name,
        **{
            "viscous_friction": lambda: {"ratio": 2.0},
            "servo_gain": lambda: {"ratio": 1.0 + 0.02 * sign},
            "velocity_gain": lambda: {"ratio": 0.8},
            "servo_delay": lambda: {"delay_ms": 0.5 * sign},
            "torque_ripple": lambda: {
                "amplitude_Nm": 0.05,
                "order": float(rng.choice([1.0, 2.0, 3.0, 6.0])),
                "phase_deg": phase,
            },
            "velocity_feedforward": lambda: {"ratio": feedforward + 0.05},
            "drive_compliance": lambda: {**stiffness, "damping_ratio": round(float(rng.uniform(0.03, 0.1)), 3)},
            "backlash": lambda: {"width_deg": 0.001} if rotary else {"width_um": 2.0},
            "pitch_error": lambda: {"components": [[1.0, 1.0, phase], [float(rng.choice([2.0, 3.0])), 0.4, 60.0]]},
            "worm_wear": lambda: {
                "depth_deg": 0.002,
                "centre_deg": round(float(rng.uniform(14.0, 22.0) if subject == "A" else rng.uniform(30.0, 330.0)), 1),
                "width_deg": round(float(rng.uniform(3.0, 6.0) if subject == "A" else rng.uniform(6.0, 25.0)), 1),
            },
            "gravity_windup": lambda: {"amplitude_deg": 0.001, "phase_deg": phase},
            "scale_error": lambda: {"ppm": 10.0 * sign},
            "thermal_drift": lambda: {
                "amplitude_um": 10.0 * sign,
                "time_constant_s": float(rng.choice([200.0, 400.0, 900.0])),
            },
            "vibration": lambda: {"amplitude_um": 0.3, "frequency_Hz": float(rng.choice([13.0, 27.0, 38.0, 61.0]))},
            "straightness": lambda: (
                {"quadratic_um": 2.0 * sign} if rng.uniform() < 0.6 else {"quadratic_um": 1.0, "cubic_um": 2.0 * sign}
            ),
            "squareness": lambda: {"angle_urad": 30.0 * sign},
            "axis_location": lambda: {location: 20.0 * sign},
            "radial_error_motion": lambda: {
                "amplitude_um": 2.0,
                "order": float(rng.choice([2.0, 3.0])),
                "phase_deg": phase,
            },
            "tilt_error_motion": lambda: {
                "amplitude_urad": 10.0,
                "order": float(rng.choice([2.0, 3.0])),
                "phase_deg": phase,
            },
        }[kind](),
    }


def unlisted(number: int, machine: str, rng: np.random.Generator) -> tuple[str, Unlisted]:
    """One of the causes outside the catalogue, shapes drawn, and the layout family on which it shows."""
    drive = nominal(machine)["drive"]
    phase, sign = float(rng.integers(0, 36) * 10), float(rng.choice([-1.0, 1.0]))
    begin = float(rng.uniform(-20.0, 150.0))
    makers = (
        lambda: ("C", EncoderStep("C", sign, from_deg=begin, to_deg=begin + float(rng.uniform(40.0, 120.0)))),
        lambda: ("A", EncoderStep("A", sign, from_deg=11.0, to_deg=float(rng.uniform(17.0, 21.0)))),
        lambda: ("X", LooseGib("X", from_mm=float(rng.uniform(-40.0, 0.0)), to_mm=float(rng.uniform(70.0, 90.0)))),
        lambda: ("Y", LooseGib("Y", from_mm=-130.0, to_mm=float(rng.uniform(-90.0, -60.0)))),
        lambda: ("X", Crosstalk("X", sign, moves="Y")),
        lambda: ("Y", Crosstalk("Y", sign, moves="X")),
        lambda: ("X", ReversalCreep("X", sign, time_constant_s=float(rng.uniform(0.6, 1.6)))),
        lambda: ("Y", ReversalCreep("Y", sign, time_constant_s=float(rng.uniform(0.6, 1.6)))),
        lambda: ("A", ReversalCreep("A", sign, time_constant_s=float(rng.uniform(0.6, 1.6)))),
        lambda: ("X", CoolerCycle("X", period_s=float(rng.uniform(60.0, 150.0)), phase_deg=phase)),
        lambda: ("Y", CoolerCycle("Y", period_s=float(rng.uniform(60.0, 150.0)), phase_deg=phase)),
        lambda: ("Z", CoolerCycle("Z", period_s=float(rng.uniform(60.0, 150.0)), phase_deg=phase)),
        lambda: ("X", SlideFloat("X", sign, moves="Y")),
        lambda: ("Y", SlideFloat("Y", sign, moves="X")),
        lambda: ("Z", SlideFloat("Y", sign, moves="Z")),
        lambda: ("lift", TableLift("C", sign, moves="Z")),
        lambda: ("X", TorqueDeflection("X", sign, moves="Y")),
        lambda: ("Y", TorqueDeflection("Y", sign, moves="X")),
        lambda: ("X", ScrewWobble("X", moves="Y", lead_mm=drive["X"]["lead_mm"], phase_deg=phase)),
        lambda: ("Y", ScrewWobble("Y", moves="X", lead_mm=drive["Y"]["lead_mm"], phase_deg=phase)),
        lambda: (
            "C",
            ToothPatch(
                "C", order=float(drive["C"]["worm_teeth"]), centre_deg=begin, width_deg=float(rng.uniform(12.0, 30.0))
            ),
        ),
        lambda: (
            "A",
            ToothPatch(
                "A", order=float(drive["A"]["worm_teeth"]), centre_deg=16.0, width_deg=float(rng.uniform(2.5, 4.0))
            ),
        ),
        lambda: ("X", SideThrow("X", sign, moves="Y")),
        lambda: ("Y", SideThrow("Y", sign, moves="X")),
        lambda: ("C", TableEgg("C", phase_deg=phase)),
        lambda: ("C", EccentricPlay("C", centre_deg=phase)),
        lambda: ("X", SuddenShift("X", sign)),
    )
    return makers[number % len(makers)]()


#: How many different causes ``unlisted`` knows.
UNLISTED = 27
