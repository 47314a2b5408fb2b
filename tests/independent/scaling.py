"""Scales a hidden cause until its signature has a wanted RMS."""

from __future__ import annotations

from .drives import gear, load_inertia
from .signatures import Bench

#: Leading parameter and its neutral value; for the rest of an effect's parameters see the catalogue.
LEADING = {
    "servo_gain": ("ratio", 1.0),
    "velocity_gain": ("ratio", 1.0),
    "viscous_friction": ("ratio", 1.0),
    "velocity_feedforward": ("ratio", 0.0),
    "servo_delay": ("delay_ms", 0.0),
    "torque_ripple": ("amplitude_Nm", 0.0),
    "worm_wear": ("depth_deg", 0.0),
    "gravity_windup": ("amplitude_deg", 0.0),
    "scale_error": ("ppm", 0.0),
    "squareness": ("angle_urad", 0.0),
    "radial_error_motion": ("amplitude_um", 0.0),
    "tilt_error_motion": ("amplitude_urad", 0.0),
    "thermal_drift": ("amplitude_um", 0.0),
    "vibration": ("amplitude_um", 0.0),
}
#: Smallest and largest sensible value of the leading parameters; what a machine can have and still work.
_RANGE = {
    "servo_gain": (0.7, 1.4),
    "velocity_gain": (0.45, 2.0),
    "viscous_friction": (0.2, 8.0),
    "velocity_feedforward": (0.0, 1.0),
    "servo_delay": (-5.0, 5.0),
    "torque_ripple": (0.0, 1.0),
    "worm_wear": (0.0, 0.02),
    "gravity_windup": (0.0, 0.02),
    "scale_error": (-150.0, 150.0),
    "squareness": (-300.0, 300.0),
    "radial_error_motion": (0.0, 20.0),
    "tilt_error_motion": (0.0, 100.0),
    "thermal_drift": (-60.0, 60.0),
    "vibration": (0.0, 5.0),
}
_SIZE_RANGE = {
    "width_deg": (0.0, 0.02),
    "width_um": (0.0, 30.0),
    "value_um": (-100.0, 100.0),
    "value_urad": (-300.0, 300.0),
    "quadratic_um": (-30.0, 30.0),
    "cubic_um": (-30.0, 30.0),
}
#: The slowest mode of the load on an elastic transmission, rad/s (20 Hz); a softer axis would not have been
#: commissioned.
_SLOWEST = 125.0
#: Iterations for effects that are not linear in their size, and where to stop.
TURNS, CLOSE = 4, 0.03


def scaled(bench: Bench, cause, factor: float):
    """The cause with ``factor`` times its departure from neutral."""
    if not isinstance(cause, dict):
        return cause.scaled(factor)
    kind, subject = cause["id"].split(".")
    out = dict(cause)
    if kind == "pitch_error":
        largest = 0.02 if subject in ("A", "C") else 20.0
        out["components"] = [[n, min(w * factor, largest), p] for n, w, p in cause["components"]]
    elif kind == "friction":
        known = bench.model.get(cause["id"], {})
        for key, neutral in (
            ("coulomb_Nm", known.get("coulomb_Nm", 0.0)),
            ("static_ratio", known.get("static_ratio", 1.0)),
        ):
            if key in cause:
                out[key] = min(max(neutral + (cause[key] - neutral) * factor, 0.05 * neutral), 2.5 * neutral)
    elif kind == "drive_compliance":
        key = next(k for k in cause if k.startswith("stiffness"))
        drive = bench.drive[subject]
        softest = _SLOWEST**2 * load_inertia(subject, drive) * gear(drive) ** 2 * 1e-6
        out[key] = max(cause[key] / factor, softest)
    elif kind in LEADING:
        key, neutral = LEADING[kind]
        neutral = bench.model.get(cause["id"], {}).get(key, neutral)
        out[key] = _limited(neutral + (cause[key] - neutral) * factor, _RANGE[kind])
    else:
        for key in _SIZE_RANGE.keys() & cause.keys():
            out[key] = _limited(cause[key] * factor, _SIZE_RANGE[key])
    return {k: _rounded(v) for k, v in out.items()}


def _limited(value: float, bounds: tuple[float, float]) -> float:
    return min(max(value, bounds[0]), bounds[1])


def _rounded(value):
    if isinstance(value, float):
        return float(f"{value:.5g}")
    return [_rounded(v) for v in value] if isinstance(value, list) else value


def scaled_to(bench: Bench, cause, target_um: float):
    """The cause at the size whose projected signature has an RMS of ``target_um``, or as large as a machine can
    have it.
    """
    for _ in range(TURNS):
        now = bench.rms(cause)
        if now < 1e-9:
            return cause
        factor = target_um / now
        # small steps keep ratios positive and loops stable where the effect is far from linear
        cause = scaled(bench, cause, min(max(factor, 0.02), 50.0))
        if abs(factor - 1.0) < CLOSE:
            break
    return cause
