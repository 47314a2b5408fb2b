"""Axis positions for a wanted pose of the tool relative to the workpiece: ball in the work frame, tool direction.

Two rotary axes bring the tool into a wanted direction in at most two ways, which is a closed form for any directions of
the two axes (Paden and Kahan's second subproblem: Murray, Li, Sastry, A Mathematical Introduction to Robotic
Manipulation, 1994, section 3.3). The linear axes follow.
"""

from __future__ import annotations

import numpy as np

from mjsim.errors import InputError
from mjsim.machine.chain import Axis, Chain
from mjsim.machine.kinematics import carried_by, grounded, tool_side, turn_about, work_to_machine

#: How far a wanted direction may lie outside what the axes reach, as a cosine: rounding.
_ROUNDING = 1e-9
#: The first rotary axis is arbitrary where the direction is closer to it than this, rad.
_POLE = 1e-12
#: A path is refused, where the user says so, if it comes closer to a singular direction: 1° (assumed), as a sine.
_SINGULAR = float(np.sin(np.radians(1.0)))
#: Least volume of the three directions in which the slides move, where some stand on rotary axes: 3° from a plane.
_FLAT = 0.05


def aim(chain: Chain, direction: np.ndarray) -> np.ndarray:
    """Rotary positions that bring work-frame directions onto the spindle; eq. A.6 and A.7 for the paper's machine.

    Of the two ways there are, a table that tilts about a horizontal axis never tilts clockwise. Any other machine
    begins the way that turns its axes least and goes on without a jump. Where the first axis' position is arbitrary,
    the neighbour's value is kept.

    Args:
        chain: the machine's axes.
        direction: (n, 3) unit vectors, from the tool's tip to the spindle.

    Returns:
        (n, axes) axis positions, rad; the linear ones are 0, the rotary ones are continuous.

    Raises:
        InputError: the axes do not reach a direction.
    """
    direction = np.asarray(direction, float)
    if chain.singular == "refuse":
        _keep_away(chain, direction)
    if is_tilting_table(chain):
        return _tilting_table(chain, direction)
    order = serial(chain)
    q = np.zeros((len(direction), chain.count))
    if len(order) < 2:
        return _one_axis(chain, order, direction, q)
    both = solutions(chain, direction)
    columns = [chain.index(a.letter) for a, _ in order]
    q[:, columns] = _continuous(both)
    return q


def _keep_away(chain: Chain, direction: np.ndarray) -> None:
    """Refuse directions close to the first rotary axis, which would have to turn very fast.

    Raises:
        InputError: there is one.
    """
    order = serial(chain)
    if len(order) < 2:
        return
    first = order[0][0]
    near = np.linalg.norm(np.cross(direction, first.direction), axis=1)
    # a tool that rests parallel to the axis needs no turn of it
    if near.min(initial=1.0) < _SINGULAR and np.ptp(direction, axis=0).max() > _POLE:
        raise InputError(
            f"configuration {chain.configuration!r}: the tool comes within {np.degrees(near.min()):.2f}° of the "
            f"{first.letter} axis, which would have to turn very fast; allowed: {np.degrees(_SINGULAR):.0f}° or more, "
            'or singular_pass = "cross"'
        )


def is_tilting_table(chain: Chain) -> bool:
    """Whether the chain turns a table about the vertical on a cradle that tilts about X or Y, as the paper's."""
    if chain.swivelling or len(chain.turning) != 2:
        return False
    table, tilt = chain.turning
    return table.vertical and not table.tilted and not tilt.tilted and not tilt.vertical


def _tilting_table(chain: Chain, direction: np.ndarray) -> np.ndarray:
    """The table turns the direction into the plane that the cradle sweeps, which raises it."""
    x, y, z = direction.T
    turning, tilting = chain.turning
    # what tilts upwards lies horizontally at a right angle to the tilting axis: vertical × tilting axis
    ahead = np.cross([0.0, 0.0, 1.0], tilting.ccw * tilting.direction)
    table = np.arctan2(ahead[1] * x, ahead[1] * y) if ahead[1] else np.arctan2(-ahead[0] * y, ahead[0] * x)
    pole = np.hypot(x, y) < _POLE
    if pole.any() and not pole.all():
        at = np.flatnonzero(~pole)
        table = table[at[np.searchsorted(at, np.arange(len(table))).clip(0, len(at) - 1)]]
    q = np.zeros((len(x), chain.count))
    q[:, chain.index(tilting.letter)] = tilting.ccw * np.arccos(np.clip(z, -1.0, 1.0))
    q[:, chain.index(turning.letter)] = turning.ccw * np.unwrap(table)
    return q


def serial(chain: Chain) -> list[tuple[Axis, float]]:
    """Rotary axes from the workpiece to the tool, with the sign in which each turns the tool against the workpiece."""
    return [(a, -1.0) for a in chain.turning] + [(a, 1.0) for a in reversed(chain.swivelling)]


def _one_axis(chain: Chain, order: list[tuple[Axis, float]], direction: np.ndarray, q: np.ndarray) -> np.ndarray:
    """A chain with one rotary axis or none reaches few directions."""
    up = np.array([0.0, 0.0, 1.0])
    reached = np.tile(up, (len(direction), 1))
    if order and not order[0][0].vertical:
        (axis, sign) = order[0]
        d = axis.direction
        flat, wanted = up - d[2] * d, direction - (direction @ d)[:, None] * d
        angle = np.unwrap(sign * np.arctan2(np.cross(flat, wanted) @ d, wanted @ flat))
        q[:, chain.index(axis.letter)] = angle
        reached = np.column_stack(turn_about(axis, list(reached.T), sign * angle))
    off = np.linalg.norm(reached - direction, axis=1)
    if off.max(initial=0.0) > _ROUNDING:
        refuse(chain, direction[int(np.argmax(off))])
    return q


def refuse(chain: Chain, direction: np.ndarray) -> None:
    """Say that the axes do not reach a direction.

    Raises:
        InputError: always.
    """
    turning = " and ".join(chain.rotary)
    able = f"what {turning} can do" if turning else "the spindle's own direction, as no axis turns"
    wanted = ", ".join(f"{d:.4f}" for d in direction)
    raise InputError(f"configuration {chain.configuration!r}: the tool cannot point along ({wanted}); allowed: {able}")


def solutions(chain: Chain, direction: np.ndarray) -> np.ndarray:
    """Both ways in which two rotary axes bring the tool into a direction.

    Args:
        chain: the machine's axes; two of them turn.
        direction: (n, 3) unit vectors in the work frame, from the tool's tip to the spindle.

    Returns:
        (2, n, 2) rad: way, instant, rotary axis from the workpiece to the tool. Not a number where the position of an
        axis is arbitrary.

    Raises:
        InputError: the axes do not reach a direction.
    """
    (first, s1), (second, s2) = serial(chain)
    # counted counter-clockwise, so that both ways come in one order whatever the sense of the axes is
    d1, d2 = (s * a.ccw * a.direction for s, a in ((s1, first), (s2, second)))
    up = np.array([0.0, 0.0, 1.0])
    # direction = exp(θ1 d1) v and v = exp(θ2 d2) up: v lies on both circles, so on a line across d1 and d2
    c, reach, wanted = float(d1 @ d2), float(d2 @ up), direction @ d1
    normal = np.cross(d1, d2)
    if normal @ normal < _ROUNDING:
        refuse(chain, direction[0])
    a = (c * reach - wanted) / (c * c - 1.0)
    b = (c * wanted - reach) / (c * c - 1.0)
    square = (1.0 - a * a - b * b - 2.0 * a * b * c) / (normal @ normal)
    if square.min(initial=0.0) < -_ROUNDING:
        refuse(chain, direction[int(np.argmin(square))])
    out = np.zeros((2, len(direction), 2))
    along = np.sqrt(np.maximum(square, 0.0))
    for way, sign in enumerate((1.0, -1.0)):
        v = a[:, None] * d1 + b[:, None] * d2 + (sign * along)[:, None] * normal
        out[way, :, 1] = second.ccw * _angle(d2, np.tile(up, (len(v), 1)), v)
        out[way, :, 0] = first.ccw * _angle(d1, v, direction)
    return out


def _angle(axis: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Angle about ``axis`` (3,) from ``start`` to ``stop`` (n, 3); not a number where either lies on the axis."""
    a, b = (v - (v @ axis)[:, None] * axis for v in (start, stop))
    angle = np.arctan2(np.cross(a, b) @ axis, np.einsum("ni,ni->n", a, b))
    return np.where(np.minimum(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)) < _POLE, np.nan, angle)


def _continuous(both: np.ndarray) -> np.ndarray:
    """One way through ``both`` (2, n, 2) without jumps, (n, 2) rad; it begins the way that turns the axes least."""
    both = np.stack([np.column_stack([_held(column) for column in way.T]) for way in both])
    n = both.shape[1]
    way = np.zeros(n, int)
    way[0] = now = int(np.argmin(np.abs(both[:, 0]).sum(axis=1)))
    # where the nearest neighbour of a way lies on the other one, which happens where the two meet
    step = np.abs(_wrapped(both[None, :, 1:] - both[:, None, :-1])).sum(axis=3)
    after = np.argmin(step, axis=1)
    begin = 1
    for change in np.flatnonzero((after != [[0], [1]]).any(axis=0)) + 1:
        way[begin:change] = now
        way[change] = now = after[now, change - 1]
        begin = change + 1
    way[begin:] = now
    return np.unwrap(both[way, np.arange(n)], axis=0)


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """Angles within half a turn of 0."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _held(column: np.ndarray) -> np.ndarray:
    """``column`` (n,) with a neighbour's value where it is not a number; 0 where none is one."""
    known = np.flatnonzero(~np.isnan(column))
    if not len(known):
        return np.zeros_like(column)
    return column[known[(np.searchsorted(known, np.arange(len(column)), side="right") - 1).clip(0)]]


def linear_positions(chain: Chain, q: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Positions of the linear axes that bring the spindle ball to work-frame points.

    Args:
        chain: the machine's axes.
        q: (n, axes) axis positions; the rotary ones count, rad.
        points: (n, 3) or (3,) of the spindle ball in the work frame, m.

    Returns:
        (n, 3) m.

    Raises:
        InputError: a slide that stands on a rotary axis has been turned along another one.
    """
    q = np.array(q, float)
    q[:, chain.linear_columns] = 0.0
    wanted = work_to_machine(chain, q, points)
    if chain.swivelling:
        wanted = wanted - carried_by(chain, tool_side(chain), q, np.zeros(3), 1.0)
    if not chain.carried:
        return wanted
    directions = np.stack([_direction(chain, letter, q) for letter in chain.linear], axis=2)
    if np.abs(np.linalg.det(directions)).min(initial=1.0) < _FLAT:
        raise InputError(
            f"configuration {chain.configuration!r}: {', '.join(chain.carried)} is turned along another linear axis, "
            "so that no position of the axes is the only one"
        )
    return np.linalg.solve(directions, wanted[:, :, None])[:, :, 0]


def _direction(chain: Chain, letter: str, q: np.ndarray) -> np.ndarray:
    """In which direction a linear axis moves the spindle ball against the table, in machine axes, (n, 3)."""
    one = np.zeros_like(q)
    one[:, chain.rotary_columns] = q[:, chain.rotary_columns]
    zero = one.copy()
    one[:, chain.index(letter)] = 1.0

    def ball(at: np.ndarray) -> np.ndarray:
        tool = carried_by(chain, tool_side(chain), at, np.zeros(3), 1.0)
        return grounded(chain, at) + tool - work_to_machine(chain, at, np.zeros(3))

    return ball(one) - ball(zero)


def pose(chain: Chain, points: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Axis positions that bring the spindle ball to ``points`` with the tool in ``direction``.

    Args:
        chain: the machine's axes.
        points: (n, 3) of the spindle ball in the work frame, m.
        direction: (n, 3) unit vectors in the work frame, from the tool's tip to the spindle.

    Returns:
        (n, axes) m and rad, continuous.

    Raises:
        InputError: the axes do not reach a direction.
    """
    q = aim(chain, direction)
    q[:, chain.linear_columns] = linear_positions(chain, q, points)
    return q
