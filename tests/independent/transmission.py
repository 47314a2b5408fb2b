"""From the motor's position to the load side's, in the catalogue's order of effects.

pitch error, worm wear, backlash, scale error, gravity wind-up (each of its own axis), then straightness, squareness,
thermal drift and vibration, which displace the spindle ball against the table. A wild machine also has errors of single
teeth, play that varies along the axis, and a drift that is no exponential. Units: m, rad, s; amplitudes in the unit
that the parameter's name ends with.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.interpolate import PchipInterpolator

from .drives import gear
from .kinematics import AXES, DEG, MICRO

#: Travel over which a direction-dependent pitch error comes in after a reversal, rad.
BLEND = 0.05 * DEG
#: Displaced axis, sign and the axis whose position causes it, for each squareness error.
SQUARENESS = {"XY": (0, -1.0, 1), "YZ": (1, -1.0, 2), "ZX": (0, 1.0, 2)}


def _play(x: np.ndarray, width: float | np.ndarray) -> np.ndarray:
    """Where play of a width, (n,) or the same everywhere, lets the load side of ``x`` stay."""
    return _played(x, np.full(len(x), width) if np.isscalar(width) else width)


@njit(cache=True, nogil=True)
def _played(x, width):
    y = np.empty_like(x)
    last = x[0]
    for i in range(len(x)):
        last = min(max(last, x[i] - width[i] / 2.0), x[i] + width[i] / 2.0)
        y[i] = last
    return y


@njit(cache=True, nogil=True)
def _growing(x, travel):
    """1 where x has been growing for more than ``travel``, 0 where it has been falling for as long or never moved,
    a ramp between.
    """
    w = np.empty_like(x)
    last = 0.0
    for i in range(len(x)):
        if i > 0:
            last = min(max(last + (x[i] - x[i - 1]) / travel, 0.0), 1.0)
        w[i] = last
    return w


def _pitch(x: np.ndarray, axis: str, drive: dict, e: dict) -> np.ndarray:
    rotary = axis in "ABC"
    size, wave = (DEG, 1.0) if rotary else (MICRO, gear(drive))
    error = np.zeros_like(x)
    for order, amplitude, phase in e["components"]:
        error += size * amplitude * np.sin(order * wave * x + phase * DEG)
    if way := e.get("direction"):
        error *= _growing(x if way == "CCW" else -x, BLEND)
    return error


def _wear(x: np.ndarray, e: dict) -> np.ndarray:
    away = (x / DEG - e["centre_deg"] + 180.0) % 360.0 - 180.0
    depth = e["depth_deg"] * DEG * np.exp(-0.5 * (away / e["width_deg"]) ** 2)
    return depth * _growing(x if e["direction"] == "CCW" else -x, BLEND) if "direction" in e else depth


def interpolate_teeth(x: np.ndarray, error_deg: list[float]) -> np.ndarray:
    """Error of a worm wheel whose teeth have errors of their own, rad; a tooth hands over to the next by half a cosine.

    Args:
        x: angle of the wheel, rad. error_deg: of every tooth, in degrees.
    """
    teeth = np.asarray(error_deg) * DEG
    at = np.mod(x * (len(teeth) / (2.0 * np.pi)), len(teeth))
    tooth = np.floor(at).astype(int) % len(teeth)
    share = 0.5 - 0.5 * np.cos(np.pi * (at - np.floor(at)))
    return teeth[tooth] + share * (teeth[(tooth + 1) % len(teeth)] - teeth[tooth])


def vary_play(x: np.ndarray, width: float, varying: dict | None) -> float | np.ndarray:
    """Play along an axis: ``width`` times 1 + share · cos(wave number · x + phase), never negative."""
    if varying is None:
        return width
    wave = np.cos(varying["wave_number"] * x + varying["phase_deg"] * DEG)
    return width * np.maximum(1.0 + varying["share"] * wave, 0.0)


def _axis(x: np.ndarray, axis: str, drive: dict, effects: dict) -> np.ndarray:
    waves = [
        effects[k] for k in (f"pitch_error.{axis}", f"pitch_error.{axis}@CW", f"pitch_error.{axis}@CCW") if k in effects
    ]
    if waves:
        x = x + sum(_pitch(x, axis, drive, e) for e in waves)
    worn = [effects[k] for k in (f"worm_wear.{axis}", f"worm_wear.{axis}@CW", f"worm_wear.{axis}@CCW") if k in effects]
    if worn:
        x = x - sum(_wear(x, e) for e in worn)
    if e := effects.get(f"tooth_errors.{axis}"):
        x = x + interpolate_teeth(x, e["error_deg"])
    if e := effects.get(f"backlash.{axis}"):
        width = e["width_deg"] * DEG if axis in "ABC" else e["width_um"] * MICRO
        x = _play(x, vary_play(x, width, effects.get(f"varying_play.{axis}")))
    if e := effects.get(f"scale_error.{axis}"):
        x = x * (1.0 + e["ppm"] * 1e-6)
    if e := effects.get(f"gravity_windup.{axis}"):
        x = x + e["amplitude_deg"] * DEG * np.sin(x + e.get("phase_deg", 0.0) * DEG)
    return x


def vibration(time: np.ndarray, effects: dict, phases: dict[str, float]) -> np.ndarray:
    """Structural vibration (n, 5), m; ``phases`` are this test's, rad by axis."""
    out = np.zeros((len(time), 5))
    for i, axis in enumerate("XYZ"):
        if e := effects.get(f"vibration.{axis}"):
            out[:, i] = e["amplitude_um"] * MICRO * np.sin(2.0 * np.pi * e["frequency_Hz"] * time + phases[axis])
    return out


def slides(motor: np.ndarray, drives: dict, effects: dict, axes: str = AXES) -> np.ndarray:
    """How far each axis has gone along its own way, (n, 5), from the motor side's positions: what others displace is
    left out.

    Args:
        motor: (n, 5), in time order and fine enough for backlash. axes: of the columns.
    """
    return np.column_stack([_axis(motor[:, i], a, drives[a], effects) for i, a in enumerate(axes)])


def load_side(motor: np.ndarray, clock: np.ndarray, drives: dict, effects: dict, axes: str = AXES) -> np.ndarray:
    """Load-side positions (n, 5) from the motor side's, without the vibration; arguments as of its two parts."""
    return displaced(slides(motor, drives, effects, axes), clock, effects, axes)


def displaced(q: np.ndarray, clock: np.ndarray, effects: dict, axes: str = AXES) -> np.ndarray:
    """Positions (n, 5) with what axes displace one another by, and what time does; without the vibration.

    Args:
        q: of the :func:`slides`. clock: campaign clock, s. axes: of the columns.
    """
    out = q.copy()
    for name, e in effects.items():
        kind, subject = name.split(".")
        if kind == "straightness":
            moved, along = axes.index(subject[1]), q[:, axes.index(subject[2])] / 0.1
            out[:, moved] += MICRO * (e.get("quadratic_um", 0.0) * along**2 + e.get("cubic_um", 0.0) * along**3)
        elif kind == "squareness":
            moved, sign, cause = SQUARENESS[subject]
            out[:, moved] += sign * MICRO * e["angle_urad"] * q[:, cause]
        elif kind == "thermal_drift":
            out[:, axes.index(subject)] += e["amplitude_um"] * MICRO * (1.0 - np.exp(-clock / e["time_constant_s"]))
        elif kind == "drift":
            walk = PchipInterpolator(e["clock_s"], e["um"])
            out[:, axes.index(subject)] += MICRO * walk(np.clip(clock, e["clock_s"][0], e["clock_s"][-1]))
    return out
