"""Which catalogue effects a campaign cannot tell from a hidden one: signatures that point the same way once set-up
errors had their share.

An alternative is a set of columns (sine and cosine for a free phase, quadratic and cubic for a straightness); its
cosine with the hidden signature is that of the best combination. Combinations that need an absurd size are no
explanation.
"""

from __future__ import annotations

import numpy as np

from .kinematics import AXES
from .signatures import Bench

#: Cosine from which two causes count as the same, and the largest size in units of the typical one.
SAME, LIMIT = 0.97, 25.0
#: Typical size of the leading parameter; (key, value, neutral) per drive effect.
_DRIVE = {
    "servo_gain": {"ratio": 1.02},
    "velocity_gain": {"ratio": 1.1},
    "viscous_friction": {"ratio": 1.5},
    "servo_delay": {"delay_ms": 0.3},
    "velocity_feedforward": {"ratio": 0.02},
}
#: Kinds whose size cannot be negative; feedforward may shrink only where the machine has some.
_ONE_SIDED = ("backlash", "velocity_feedforward", "drive_compliance")
_LOCATION = {
    "EX0C": "um",
    "EY0C": "um",
    "EA0C": "urad",
    "EB0C": "urad",
    "EY0A": "um",
    "EZ0A": "um",
    "EB0A": "urad",
    "EC0A": "urad",
}
_STRAIGHT = ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ")


def _waves(axis: str, drive: dict, cause: dict) -> dict[str, set[float]]:
    """Orders to try of the periodic kinds: those of the hidden effect in each kind's own unit, and low ones."""
    kind, subject = cause["id"].split(".")
    teeth = drive.get("worm_teeth", 1) if axis in "AC" else 1
    table = set()
    if subject == axis and kind == "pitch_error":
        table = {c[0] for c in cause["components"]}
    elif subject == axis and kind == "torque_ripple":
        table = {cause["order"] * teeth}
    elif axis == "C" and kind in ("radial_error_motion", "tilt_error_motion"):
        table = {cause["order"] + d for d in (-1, 0, 1)} - {0}
    low = {1.0, 2.0, 3.0} if axis in "AC" else set()
    near = {abs(n + d) for n in table for d in (-1, 0, 1)}
    return {
        "pitch_error": table | low,
        "torque_ripple": {n / teeth for n in table} | {1.0},
        "table": near | {1.0, 2.0} if axis == "C" else set(),
    }


def alternatives(bench: Bench, cause: dict) -> list[tuple[str, list[dict]]]:
    """Catalogue effects to hold against a hidden one: id and the effects whose signatures span it."""
    out: list[tuple[str, list[dict]]] = []

    def add(name: str, *columns: dict) -> None:
        if name != cause["id"]:
            out.append((name, [{"id": name, **c} for c in columns]))

    hidden_kind = cause["id"].split(".")[0]
    for axis in AXES:
        rotary, drive = axis in "AC", bench.drive[axis]
        for kind, size in _DRIVE.items():
            known = bench.model.get(f"{kind}.{axis}", {})
            add(
                f"{kind}.{axis}",
                {k: v + known.get(k, 0.0) if kind == "velocity_feedforward" else v for k, v in size.items()},
            )
        if friction := bench.model.get(f"friction.{axis}"):
            add(f"friction.{axis}", {"coulomb_Nm": 1.2 * friction["coulomb_Nm"]})
        stiffness = {"stiffness_Nm_per_urad": 0.3} if rotary else {"stiffness_N_per_um": 300.0}
        add(f"drive_compliance.{axis}", {**stiffness, "damping_ratio": cause.get("damping_ratio", 0.05)})
        add(f"backlash.{axis}", {"width_deg": 0.0005} if rotary else {"width_um": 2.0})
        orders = _waves(axis, drive, cause)
        size = 0.0005 if rotary else 1.0
        known = {c[0] for c in bench.model.get(f"pitch_error.{axis}", {}).get("components", [])}
        for n in sorted(orders["pitch_error"] - known):
            add(f"pitch_error.{axis}", *({"components": [[n, size, phase]]} for phase in (0.0, 90.0)))
        for n in sorted(orders["torque_ripple"]):
            add(
                f"torque_ripple.{axis}",
                *({"amplitude_Nm": 0.05, "order": n, "phase_deg": phase} for phase in (0.0, 90.0)),
            )
        for n in sorted(orders["table"]):
            for kind, key in (("radial_error_motion.C", "amplitude_um"), ("tilt_error_motion.C", "amplitude_urad")):
                add(kind, *({key: 2.0, "order": n, "phase_deg": phase} for phase in (0.0, 90.0)))
        if not rotary:
            add(f"scale_error.{axis}", {"ppm": 10.0})
            for tau in {cause.get("time_constant_s", 600.0), 240.0, 1200.0}:
                add(f"thermal_drift.{axis}", {"amplitude_um": 5.0, "time_constant_s": tau})
            if hidden_kind == "vibration":
                add(f"vibration.{axis}", {"amplitude_um": 0.3, "frequency_Hz": cause["frequency_Hz"]})
    add("gravity_windup.A", *({"amplitude_deg": 0.0005, "phase_deg": phase} for phase in (0.0, 90.0)))
    for name in _STRAIGHT:
        add(f"straightness.{name}", {"quadratic_um": 1.0}, {"cubic_um": 1.0})
    for name in ("XY", "YZ", "ZX"):
        add(f"squareness.{name}", {"angle_urad": 10.0})
    for name, unit in _LOCATION.items():
        add(f"axis_location.{name}", {f"value_{unit}": 10.0})
    return out


def cosine(bench: Bench, signature: np.ndarray, columns: list[np.ndarray]) -> tuple[float, np.ndarray]:
    """Cosine of a signature with the best combination of columns, and that combination."""
    size = float(signature @ bench.project(signature))
    live = [c for c in columns if float(c @ bench.project(c)) > 1e-8 * bench.size]
    if size <= 0.0 or not live:
        return 0.0, np.array([np.inf])
    basis = np.column_stack(live)
    projected = bench.project(basis)
    coefficient, *_ = np.linalg.lstsq(basis.T @ projected, projected.T @ signature, rcond=1e-10)
    explained = float(coefficient @ (projected.T @ signature)) / size
    return float(np.sqrt(min(max(explained, 0.0), 1.0))), coefficient


def ranked(bench: Bench, cause, signature: np.ndarray | None = None) -> list[tuple[float, str]]:
    """Alternatives with their cosine, the most similar first; sizes that are absurd are left out."""
    signature = bench.signature(cause) if signature is None else signature
    best: dict[str, float] = {}
    asked = cause if isinstance(cause, dict) else {"id": "unlisted.-"}
    for name, columns in alternatives(bench, asked):
        value, size = cosine(bench, signature, [bench.signature(c) for c in columns])
        impossible = name.startswith(_ONE_SIDED) and name not in bench.model and size[0] < 0.0
        if np.abs(size).max() < LIMIT and not impossible:
            best[name] = max(best.get(name, 0.0), value)
    return sorted(((v, k) for k, v in best.items()), reverse=True)


def equivalent(bench: Bench, cause: dict) -> list[str]:
    """Ids of the effects that these tests cannot tell from the hidden one."""
    return [name for value, name in ranked(bench, cause) if value > SAME]
