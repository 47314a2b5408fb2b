"""The ball-bar reading of a whole motion, compiled: the equations of :mod:`mjsim.machine.kinematics`, in one pass for
the search.

``tests/test_kinematics.py`` holds the difference to the written-out reference.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import Geometry


def reading(chain: Chain, q: np.ndarray, point: np.ndarray, length: float, geometry: Geometry) -> np.ndarray:
    """As :func:`mjsim.machine.kinematics.reading`: (n,) m for motions (n, axes), or with the table's error motion
    behind.
    """
    square = np.zeros((3, 3))
    for error in chain.squareness:
        square[error.along, chain.index(error.axis)] = error.sign * geometry.squareness.get(error.name, 0.0)
    columns = np.array([chain.index(a.letter) for a in chain.turning])
    along = np.array([a.along for a in chain.turning])
    shifts, turns = (
        np.stack(x) for x in zip(*(geometry.displacement(chain, a.letter) for a in chain.turning), strict=True)
    )
    moving = chain.count if q.shape[1] > chain.count else 0
    out = np.empty(len(q))
    _reading(
        np.ascontiguousarray(q), np.asarray(point, float), length, square, columns, along, shifts, turns, moving, out
    )
    return out


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _turned(along, angle, x, y, z):
    """A point turned about coordinate ``along``."""
    c, s = math.cos(angle), math.sin(angle)
    if along == 0:
        return x, c * y - s * z, s * y + c * z
    if along == 1:
        return s * z + c * x, y, c * z - s * x
    return c * x - s * y, s * x + c * y, z


@njit(cache=True, nogil=True, error_model="numpy")
def _reading(q, point, length, square, columns, along, shifts, turns, moving, out):
    """``columns`` and ``along`` (rotary axes,) from the workpiece to the bed; ``moving``: first column of the
    table's error motion.
    """
    first, second = min((along[0] + 1) % 3, (along[0] + 2) % 3), max((along[0] + 1) % 3, (along[0] + 2) % 3)
    p = np.empty(3)
    for n in range(q.shape[0]):
        x, y, z = point[0], point[1], point[2]
        for k in range(len(columns)):
            x, y, z = _turned(along[k], q[n, columns[k]], x, y, z)
            if k == 0 and moving > 0:
                p[0], p[1], p[2] = x, y, z
                p[first] += q[n, moving]
                p[second] += q[n, moving + 1]
                x, y, z = _turned(second, q[n, moving + 3], p[0], p[1], p[2])
                x, y, z = _turned(first, q[n, moving + 2], x, y, z)
            m, d = turns[k], shifts[k]
            x, y, z = (
                m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + d[0],
                m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + d[1],
                m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + d[2],
            )
        a, b, c = q[n, 0], q[n, 1], q[n, 2]
        dx = a + square[0, 1] * b + square[0, 2] * c - x
        dy = b + square[1, 2] * c + square[1, 0] * a - y
        dz = c + square[2, 0] * a + square[2, 1] * b - z
        out[n] = math.sqrt(dx * dx + dy * dy + dz * dz) - length
