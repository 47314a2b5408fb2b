"""From axis positions to the ball-bar reading, with every geometric error of the catalogue.

The chain is w-C'A'Y'bXZ-t: the table ball goes through C (and its error motions), C's location errors, A and A's
location errors; the spindle ball is at (X, Y, Z) because Y is the command of the spindle relative to the table.

The X slide carries Z and the spindle, the Y slide carries both rotary axes. Their angular errors turn what they carry
about their functional points, which are at the origin while all axes are at 0. That of Z lies in the spindle ball, so
that the angles of Z move nothing. To first order: an angle of 50 µrad squared is nothing.

Units: m and rad. ``position`` is (n, 5) in the order X, Y, Z, A, C.
"""

from __future__ import annotations

import numpy as np

AXES = "XYZAC"
MICRO = 1e-6
DEG = np.pi / 180.0


def turn_x(angle, p: np.ndarray) -> np.ndarray:
    """Points (n, 3) turned about x by ``angle`` rad (scalar or (n,))."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([p[:, 0] + 0.0 * c, c * p[:, 1] - s * p[:, 2], s * p[:, 1] + c * p[:, 2]], axis=1)


def turn_y(angle, p: np.ndarray) -> np.ndarray:
    """Points (n, 3) turned about y by ``angle`` rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * p[:, 0] + s * p[:, 2], p[:, 1] + 0.0 * c, -s * p[:, 0] + c * p[:, 2]], axis=1)


def turn_z(angle, p: np.ndarray) -> np.ndarray:
    """Points (n, 3) turned about z by ``angle`` rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2] + 0.0 * c], axis=1)


def location(effects: dict, name: str) -> float:
    """One of C's or A's location errors, m or rad."""
    e = effects.get(f"axis_location.{name}", {})
    return MICRO * (e.get("value_um", 0.0) + e.get("value_urad", 0.0))


def table_ball(position: np.ndarray, ball: np.ndarray, effects: dict, extra: np.ndarray | None = None) -> np.ndarray:
    """Table ball in the machine frame, (n, 3).

    Args:
        position: load-side axis positions. ball: in the work frame at A = C = 0, m.
        effects: id -> parameters. extra: (n, 3) displacement of the ball in the cradle frame by a cause outside the
            catalogue.
    """
    a, c = position[:, 3], position[:, 4]
    p = turn_z(c, np.broadcast_to(np.asarray(ball, float), (len(position), 3)))
    if e := effects.get("radial_error_motion.C"):
        arg = e["order"] * c + e.get("phase_deg", 0.0) * DEG
        p = p + MICRO * e["amplitude_um"] * np.stack([np.cos(arg), np.sin(arg), 0.0 * arg], axis=1)
    if e := effects.get("tilt_error_motion.C"):
        arg, size = e["order"] * c + e.get("phase_deg", 0.0) * DEG, MICRO * e["amplitude_urad"]
        p = turn_x(size * np.cos(arg), turn_y(size * np.sin(arg), p))
    if extra is not None:
        p = p + extra
    p = p + np.outer(axial(effects, "C", c), [0.0, 0.0, 1.0])
    p = turn_y(location(effects, "EB0C"), turn_x(location(effects, "EA0C"), p))
    p = p + np.array([location(effects, "EX0C"), location(effects, "EY0C"), 0.0])
    p = turn_x(a, p) + np.outer(axial(effects, "A", a), [1.0, 0.0, 0.0])
    p = turn_z(location(effects, "EC0A"), turn_y(location(effects, "EB0A"), p))
    p = p + np.array([0.0, location(effects, "EY0A"), location(effects, "EZ0A")])
    return p + np.cross(slide_angles(effects, "Y", position[:, 1]), p)


def spindle_ball(position: np.ndarray, effects: dict, shift: np.ndarray | None = None) -> np.ndarray:
    """Spindle ball in the machine frame, (n, 3). ``shift`` is its offset in the spindle, m."""
    p = position[:, :3] if shift is None else position[:, :3] + shift
    on_slide = p - position[:, [0]] * [1.0, 0.0, 0.0] - position[:, [1]] * [0.0, 1.0, 0.0]
    return p + np.cross(slide_angles(effects, "X", position[:, 0]), on_slide)


def slide_angles(effects: dict, axis: str, x: np.ndarray) -> np.ndarray:
    """Roll, pitch and yaw of a slide at its positions ``x`` (n,) m: about X, Y and Z, (n, 3) rad."""
    out = np.zeros((len(x), 3))
    for i, about in enumerate("ABC"):
        if e := effects.get(f"angular_error.E{about}{axis}"):
            u = x / 0.1
            out[:, i] = MICRO * (e["linear_urad"] * u + e.get("quadratic_urad", 0.0) * u**2)
    return out


def axial(effects: dict, axis: str, angle: np.ndarray) -> np.ndarray:
    """Axial error motion of a rotary axis at its positions ``angle`` (n,) rad, m."""
    e = effects.get(f"axial_error_motion.{axis}")
    if not e:
        return np.zeros(len(angle))
    return MICRO * e["amplitude_um"] * np.cos(e["order"] * angle + e.get("phase_deg", 0.0) * DEG)


def bar_reading(
    position: np.ndarray,
    ball: np.ndarray,
    length: float,
    effects: dict,
    spindle_shift: np.ndarray | None = None,
    extra: np.ndarray | None = None,
) -> np.ndarray:
    """Change of the bar's length |spindle ball − table ball| − L, m, (n,). ``spindle_shift`` is the spindle ball's
    offset, m.
    """
    spindle = spindle_ball(position, effects, spindle_shift)
    return np.linalg.norm(spindle - table_ball(position, ball, effects, extra), axis=1) - length


def axis_command(a: np.ndarray, c: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Axis commands (n, 5) that bring the spindle ball to the work-frame points (n, 3), equation A.9."""
    return np.column_stack([turn_x(a, turn_z(c, point)), a, c])
