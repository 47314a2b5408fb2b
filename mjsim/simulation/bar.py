"""The ball-bar reading of a whole motion, compiled: the equations of :mod:`mjsim.machine.kinematics`, in one pass for
the search.

``tests/test_kinematics.py`` holds the difference to the written-out reference.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numba import njit

from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import Axis, Chain
from mjsim.machine.kinematics import Geometry, read_along

#: How an axis of a side acts: about a coordinate through the origin, about any centreline, or along a line.
_TURN, _TILTED, _SLIDE = range(3)
#: Most error motions of one axis: three tilts and two displacements of a slide, or the five of a rotary axis.
_MOTIONS = 5
# A row of numbers for each axis: how it acts, its column, the coordinate of its letter, its unit vector and centre; the
# shift and the rotation matrix of its frame; the direction of a slide; then of its error motions the sign of what is
# moved, their columns (-1: none), their coordinates, and how they act; last the sense of a rotary axis. The centre of a
# slide is its functional point.
_HOW, _COLUMN, _ALONG, _UNIT, _CENTRE, _SHIFT, _MATRIX, _LINE = 0, 1, 2, 3, 6, 9, 12, 21
_SIGN, _MOTION, _MOTION_ALONG, _MOTION_HOW = 24, 25, 25 + _MOTIONS, 25 + 2 * _MOTIONS
#: How an error motion acts: along a coordinate, about one, or along the centreline.
_DISPLACE, _TILT, _AXIAL = range(3)
_CCW = 25 + 3 * _MOTIONS
_SIZE = _CCW + 1


def reading_in(test: BallBarTest, q: np.ndarray, geometry: Geometry) -> np.ndarray:
    """Reading (n,) m of a test whose axes stand at ``q`` (n, axes), or with error motions behind, m and rad."""
    return reading(test.chain, q, np.asarray(test.table_ball), test.length, geometry, test.component)


def reading(
    chain: Chain, q: np.ndarray, point: np.ndarray, length: float, geometry: Geometry, component: str = ""
) -> np.ndarray:
    """As :func:`mjsim.machine.kinematics.reading`: (n,) m for motions (n, axes), or with error motions behind."""
    square = np.zeros((3, 3))
    for error in chain.squareness:
        square[error.along, chain.index(error.axis)] = error.sign * geometry.squareness.get(error.name, 0.0)
    width, out = q.shape[1], np.empty(len(q))
    on_ground = np.array([0.0 if a in chain.carried or chain.slides_turn(width) else 1.0 for a in chain.linear])
    work, tool = (_side(chain, side, width).copy() for side in (False, True))
    _displace(work, chain, False, width, geometry)
    _displace(tool, chain, True, width, geometry)
    _reading(
        np.ascontiguousarray(q), np.asarray(point, float), length, square, on_ground, _crosswise(chain, width),
        len(work), np.vstack([work, tool]), read_along(component), out,
    )  # fmt: skip
    return out


def _axes(chain: Chain, tool: bool, width: int) -> list[Axis]:
    """What turns on one side, from its far end to the bed, for motions of ``width`` columns."""
    side = reversed(chain.tool) if tool else chain.work
    return [a for a in side if a.rotary or a.letter in chain.carried or chain.slides_turn(width)]


@cache
def _side(chain: Chain, tool: bool, width: int) -> np.ndarray:
    """Rows of the axes of one side, (axes, _SIZE), without errors, for motions of ``width`` columns."""
    axes = _axes(chain, tool, width)
    out = np.zeros((len(axes), _SIZE))
    out[:, _MOTION : _MOTION + _MOTIONS] = -1.0
    for row, a in zip(out, axes, strict=True):
        row[_HOW] = _SLIDE if not a.rotary else _TILTED if a.tilted or any(a.point) else _TURN
        row[[_COLUMN, _ALONG]] = chain.index(a.letter), a.along
        centre = a.point if a.rotary else chain.functional_point(a.letter)
        row[_UNIT : _UNIT + 3], row[_CENTRE : _CENTRE + 3] = a.unit, centre
        row[_CCW] = a.ccw
        row[_SIGN] = 1.0 if a.rotary or tool else -1.0  # a slide moves the table, the error the spindle ball
        mine = [m for m in chain.motions[: width - chain.count] if m.axis == a.letter]
        for k, m in enumerate(mine):
            how = _TILT if m.rotation else _AXIAL if m.axial else _DISPLACE
            row[[_MOTION + k, _MOTION_ALONG + k, _MOTION_HOW + k]] = chain.columns.index(m.name), m.along, how
    return out


def _displace(rows: np.ndarray, chain: Chain, tool: bool, width: int, geometry: Geometry) -> None:
    """Give the ``rows`` of one side their location errors and directions."""
    for row, a in zip(rows, _axes(chain, tool, width), strict=True):
        if a.rotary:
            shift, turn = geometry.displacement(chain, a.letter)
            row[_SHIFT : _SHIFT + 3], row[_MATRIX : _MATRIX + 9] = shift, turn.ravel()
        else:
            row[_LINE : _LINE + 3] = row[_SIGN] * geometry.slide(chain, a.letter)


@cache
def _crosswise(chain: Chain, width: int) -> np.ndarray:
    """Column and coordinate of straightness errors that have a column of their own and stand on the ground, (n, 2)."""
    rows = [
        (chain.columns.index(m.name), m.along)
        for m in chain.motions[: width - chain.count]
        if m.axis in chain.linear and m.axis not in chain.carried and not chain.slides_turn(width)
    ]
    return np.array(rows, int).reshape(-1, 2)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _turned(along, angle, x, y, z):
    """A point turned about coordinate ``along``."""
    c, s = math.cos(angle), math.sin(angle)
    if along == 0:
        return x, c * y - s * z, s * y + c * z
    if along == 1:
        return s * z + c * x, y, c * z - s * x
    return c * x - s * y, s * x + c * y, z


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _about(u, v, w, angle, x, y, z):
    """A point turned about the unit vector (u, v, w) (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    along = (u * x + v * y + w * z) * (1.0 - c)
    return (
        c * x + s * (v * z - w * y) + u * along,
        c * y + s * (w * x - u * z) + v * along,
        c * z + s * (u * y - v * x) + w * along,
    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _moved(along, by, x, y, z):
    """A point moved along a coordinate."""
    if along == 0:
        return x + by, y, z
    if along == 1:
        return x, y + by, z
    return x, y, z + by


# One loop, and helpers that take numbers alone: arrays that are handed on cost more than the arithmetic.
@njit(cache=True, nogil=True, error_model="numpy")
def _reading(q, point, length, square, on_ground, crosswise, on_work, axes, sensor, out):
    """The loop of :func:`reading`; of the ``axes`` (k, _SIZE) the first ``on_work`` carry the table. ``sensor`` (3,) is
    zero where the distance is read.
    """
    distance = sensor[0] == 0.0 and sensor[1] == 0.0 and sensor[2] == 0.0
    for n in range(len(q)):
        x, y, z = point[0], point[1], point[2]
        px, py, pz = x, y, z
        for k in range(len(axes)):
            if k == on_work:
                px, py, pz = x, y, z
                x, y, z = 0.0, 0.0, 0.0
            how, at, sign = axes[k, _HOW], q[n, int(axes[k, _COLUMN])], axes[k, _SIGN]
            cx, cy, cz = axes[k, _CENTRE], axes[k, _CENTRE + 1], axes[k, _CENTRE + 2]
            if how == _SLIDE:  # a linear axis that stands on a rotary one, or turns what it carries
                for i in range(_MOTIONS - 1, -1, -1):
                    if axes[k, _MOTION + i] >= 0.0 and axes[k, _MOTION_HOW + i] == _TILT:
                        angle, along = q[n, int(axes[k, _MOTION + i])], axes[k, _MOTION_ALONG + i]
                        x, y, z = _turned(along, angle, x - cx, y - cy, z - cz)
                        x, y, z = x + cx, y + cy, z + cz
                x, y, z = x + at * axes[k, _LINE], y + at * axes[k, _LINE + 1], z + at * axes[k, _LINE + 2]
            elif how == _TURN:
                x, y, z = _turned(axes[k, _ALONG], axes[k, _CCW] * at, x, y, z)
            else:
                u, v, w = axes[k, _UNIT], axes[k, _UNIT + 1], axes[k, _UNIT + 2]
                x, y, z = _about(u, v, w, at, x - cx, y - cy, z - cz)
            if axes[k, _MOTION] >= 0.0:  # error motions: displacements, then tilts, the first one outermost
                for i in range(_MOTIONS):
                    if axes[k, _MOTION + i] >= 0.0 and axes[k, _MOTION_HOW + i] == _DISPLACE:
                        moved, along = sign * q[n, int(axes[k, _MOTION + i])], axes[k, _MOTION_ALONG + i]
                        x, y, z = _moved(along, moved, x, y, z)
                    elif axes[k, _MOTION + i] >= 0.0 and axes[k, _MOTION_HOW + i] == _AXIAL:
                        moved = axes[k, _CCW] * q[n, int(axes[k, _MOTION + i])]
                        x, y, z = (
                            x + moved * axes[k, _UNIT],
                            y + moved * axes[k, _UNIT + 1],
                            z + moved * axes[k, _UNIT + 2],
                        )
                for i in range(_MOTIONS - 1, -1, -1):
                    if how != _SLIDE and axes[k, _MOTION + i] >= 0.0 and axes[k, _MOTION_HOW + i] == _TILT:
                        x, y, z = _turned(axes[k, _MOTION_ALONG + i], q[n, int(axes[k, _MOTION + i])], x, y, z)
            if how != _SLIDE:
                m = _MATRIX
                x, y, z = (
                    axes[k, m] * x + axes[k, m + 1] * y + axes[k, m + 2] * z + axes[k, _SHIFT] + cx,
                    axes[k, m + 3] * x + axes[k, m + 4] * y + axes[k, m + 5] * z + axes[k, _SHIFT + 1] + cy,
                    axes[k, m + 6] * x + axes[k, m + 7] * y + axes[k, m + 8] * z + axes[k, _SHIFT + 2] + cz,
                )
        if len(axes) == on_work:
            px, py, pz = x, y, z
            x, y, z = 0.0, 0.0, 0.0
        a, b, c = q[n, 0] * on_ground[0], q[n, 1] * on_ground[1], q[n, 2] * on_ground[2]
        x += a + square[0, 1] * b + square[0, 2] * c - px
        y += b + square[1, 2] * c + square[1, 0] * a - py
        z += c + square[2, 0] * a + square[2, 1] * b - pz
        for k in range(len(crosswise)):
            x, y, z = _moved(crosswise[k, 1], q[n, crosswise[k, 0]], x, y, z)
        if distance:
            out[n] = math.sqrt(x * x + y * y + z * z) - length
        else:
            out[n] = x * sensor[0] + y * sensor[1] + z * sensor[2]
