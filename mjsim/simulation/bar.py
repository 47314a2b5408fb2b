"""The ball-bar reading of a whole motion, compiled: the equations of :mod:`mjsim.machine.kinematics`, in one pass for
the search.

``tests/test_kinematics.py`` holds the difference to the written-out reference.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit

from mjsim.machine.chain import Axis, Chain
from mjsim.machine.kinematics import Geometry

#: How an axis of a side acts: about a coordinate through the origin, about any centreline, or along a line.
_TURN, _TILTED, _SLIDE = range(3)
#: Most error motions of one axis.
_MOTIONS = 4


class _Side(NamedTuple):
    """What turns on one side, from its far end to the bed, as arrays with one row an axis: how it acts, its column,
    the coordinate of its letter, its unit vector and centre, and the columns of its error motions (−1: none) with their
    coordinates and whether they are tilts.
    """

    how: np.ndarray
    column: np.ndarray
    along: np.ndarray
    unit: np.ndarray
    centre: np.ndarray
    motion: np.ndarray
    motion_along: np.ndarray
    tilts: np.ndarray


def reading(chain: Chain, q: np.ndarray, point: np.ndarray, length: float, geometry: Geometry) -> np.ndarray:
    """As :func:`mjsim.machine.kinematics.reading`: (n,) m for motions (n, axes), or with error motions behind."""
    square = np.zeros((3, 3))
    for error in chain.squareness:
        square[error.along, chain.index(error.axis)] = error.sign * geometry.squareness.get(error.name, 0.0)
    on_ground = np.array([0.0 if a in chain.carried else 1.0 for a in chain.linear])
    work, tool = _side(chain, False, q.shape[1]), _side(chain, True, q.shape[1])
    out = np.empty(len(q))
    _reading(
        np.ascontiguousarray(q), np.asarray(point, float), length, square, on_ground, _crosswise(chain, q.shape[1]),
        *work, *_errors(chain, False, geometry), *tool, *_errors(chain, True, geometry), out,
    )  # fmt: skip
    return out


def _axes(chain: Chain, tool: bool) -> list[Axis]:
    side = reversed(chain.tool) if tool else chain.work
    return [a for a in side if a.rotary or a.letter in chain.carried]


@cache
def _side(chain: Chain, tool: bool, width: int) -> _Side:
    """One side of a chain, for motions of ``width`` columns."""
    axes = _axes(chain, tool)
    n = len(axes)
    motion, along, tilts = (np.full((n, _MOTIONS), -1) for _ in range(3))
    for i, a in enumerate(axes):
        mine = [m for m in chain.motions[: width - chain.count] if m.axis == a.letter]
        for k, m in enumerate(mine):
            motion[i, k], along[i, k], tilts[i, k] = chain.columns.index(m.name), m.along, m.rotation
    return _Side(
        np.array([_SLIDE if not a.rotary else _TILTED if a.tilted or any(a.point) else _TURN for a in axes], int),
        np.array([chain.index(a.letter) for a in axes], int),
        np.array([a.along for a in axes], int),
        np.array([a.unit for a in axes]).reshape(n, 3),
        np.array([a.point for a in axes]).reshape(n, 3),
        motion,
        along,
        tilts,
    )


def _errors(chain: Chain, tool: bool, geometry: Geometry) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shifts (axes, 3), rotations (axes, 3, 3) and directions of slides (axes, 3) of one side."""
    axes = _axes(chain, tool)
    shifts, turns, slides = np.zeros((len(axes), 3)), np.zeros((len(axes), 3, 3)), np.zeros((len(axes), 3))
    for i, a in enumerate(axes):
        if a.rotary:
            shifts[i], turns[i] = geometry.displacement(chain, a.letter)
        else:
            slides[i] = geometry.slide(chain, a.letter)
    return shifts, turns, slides


@cache
def _crosswise(chain: Chain, width: int) -> np.ndarray:
    """Column and coordinate of straightness errors that have a column of their own and stand on the ground, (n, 2)."""
    rows = [
        (chain.columns.index(m.name), m.along)
        for m in chain.motions[: width - chain.count]
        if m.axis in chain.linear and m.axis not in chain.carried
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
def _about(u, angle, x, y, z):
    """A point turned about the unit vector ``u`` (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    along = (u[0] * x + u[1] * y + u[2] * z) * (1.0 - c)
    return (
        c * x + s * (u[1] * z - u[2] * y) + u[0] * along,
        c * y + s * (u[2] * x - u[0] * z) + u[1] * along,
        c * z + s * (u[0] * y - u[1] * x) + u[2] * along,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _moved(row, p, motion, along, tilts, sign):
    """``p`` (3,) after an axis' error motions, in place: displacements, then tilts, the first one outermost."""
    for k in range(_MOTIONS):
        if motion[k] >= 0 and tilts[k] == 0:
            p[along[k]] += sign * row[motion[k]]
    for k in range(_MOTIONS - 1, -1, -1):
        if motion[k] >= 0 and tilts[k] == 1:
            p[0], p[1], p[2] = _turned(along[k], row[motion[k]], p[0], p[1], p[2])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _through(row, p, how, column, along, unit, centre, motion, motion_along, tilts, shifts, turns, slides, sign):
    """``p`` (3,) from the far end of a side to the bed, in place."""
    for k in range(len(how)):
        at = row[column[k]]
        x, y, z = p[0], p[1], p[2]
        if how[k] == _SLIDE:  # a linear axis that stands on a rotary one
            p[0], p[1], p[2] = x + sign * at * slides[k, 0], y + sign * at * slides[k, 1], z + sign * at * slides[k, 2]
            if motion[k, 0] >= 0:
                _moved(row, p, motion[k], motion_along[k], tilts[k], sign)
            continue
        if how[k] == _TURN:
            x, y, z = _turned(along[k], at, x, y, z)
        else:
            x, y, z = _about(unit[k], at, x - centre[k, 0], y - centre[k, 1], z - centre[k, 2])
        if motion[k, 0] >= 0:
            p[0], p[1], p[2] = x, y, z
            _moved(row, p, motion[k], motion_along[k], tilts[k], 1.0)
            x, y, z = p[0], p[1], p[2]
        m, d = turns[k], shifts[k]
        p[0], p[1], p[2] = (
            m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + d[0] + centre[k, 0],
            m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + d[1] + centre[k, 1],
            m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + d[2] + centre[k, 2],
        )


@njit(cache=True, nogil=True, error_model="numpy")
def _reading(
    q, point, length, square, on_ground, crosswise,
    w_how, w_column, w_along, w_unit, w_centre, w_motion, w_motion_along, w_tilts, w_shifts, w_turns, w_slides,
    t_how, t_column, t_along, t_unit, t_centre, t_motion, t_motion_along, t_tilts, t_shifts, t_turns, t_slides,
    out,
):  # fmt: skip
    """Arguments of the two sides as in :class:`_Side` and :func:`_errors`."""
    p, s = np.empty(3), np.zeros(3)
    for n in range(q.shape[0]):
        row = q[n]
        p[0], p[1], p[2] = point[0], point[1], point[2]
        _through(row, p, w_how, w_column, w_along, w_unit, w_centre, w_motion, w_motion_along, w_tilts, w_shifts,
                 w_turns, w_slides, -1.0)  # fmt: skip
        a, b, c = q[n, 0] * on_ground[0], q[n, 1] * on_ground[1], q[n, 2] * on_ground[2]
        dx = a + square[0, 1] * b + square[0, 2] * c - p[0]
        dy = b + square[1, 2] * c + square[1, 0] * a - p[1]
        dz = c + square[2, 0] * a + square[2, 1] * b - p[2]
        if len(t_how) > 0:
            s[0], s[1], s[2] = 0.0, 0.0, 0.0
            _through(row, s, t_how, t_column, t_along, t_unit, t_centre, t_motion, t_motion_along, t_tilts, t_shifts,
                     t_turns, t_slides, 1.0)  # fmt: skip
            dx, dy, dz = dx + s[0], dy + s[1], dz + s[2]
        for k in range(len(crosswise)):
            value = q[n, crosswise[k, 0]]
            if crosswise[k, 1] == 0:
                dx += value
            elif crosswise[k, 1] == 1:
                dy += value
            else:
                dz += value
        out[n] = math.sqrt(dx * dx + dy * dy + dz * dz) - length
