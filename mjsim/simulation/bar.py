"""The ball-bar reading of a whole motion, compiled: the same equations as :mod:`mjsim.machine.chain`, in one pass for the search.

``tests/test_kinematics.py`` holds the difference to the written-out reference.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mjsim.machine.chain import Geometry, rotation

_LOCATION = ("EX0C", "EY0C", "EA0C", "EB0C", "EY0A", "EZ0A", "EB0A", "EC0A")


def reading(q: np.ndarray, point: np.ndarray, length: float, geometry: Geometry) -> np.ndarray:
    """As :func:`mjsim.machine.chain.reading`: (n,) m for motions (n, 5) or (n, 9)."""
    e = {k: geometry.location.get(k, 0.0) for k in _LOCATION}
    sq = np.array([geometry.squareness.get(k, 0.0) for k in ("XY", "YZ", "ZX")])
    table = rotation("y", e["EB0C"]) @ rotation("x", e["EA0C"])
    cradle = rotation("z", e["EC0A"]) @ rotation("y", e["EB0A"])
    out = np.empty(len(q))
    shifts = np.array([e["EX0C"], e["EY0C"], e["EY0A"], e["EZ0A"]])
    _reading(np.ascontiguousarray(q), np.asarray(point, float), length, sq, table, cradle, shifts, out)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _reading(q, point, length, sq, table, cradle, shifts, out):
    moving = q.shape[1] > 5
    for n in range(q.shape[0]):
        c, s = math.cos(q[n, 4]), math.sin(q[n, 4])
        x, y, z = c * point[0] - s * point[1], s * point[0] + c * point[1], point[2]
        if moving:
            x += q[n, 5]
            y += q[n, 6]
            c, s = math.cos(q[n, 8]), math.sin(q[n, 8])
            x, z = c * x + s * z, -s * x + c * z
            c, s = math.cos(q[n, 7]), math.sin(q[n, 7])
            y, z = c * y - s * z, s * y + c * z
        u = table[0, 0] * x + table[0, 1] * y + table[0, 2] * z + shifts[0]
        v = table[1, 0] * x + table[1, 1] * y + table[1, 2] * z + shifts[1]
        w = table[2, 0] * x + table[2, 1] * y + table[2, 2] * z
        c, s = math.cos(q[n, 3]), math.sin(q[n, 3])
        v, w = c * v - s * w, s * v + c * w
        dx = q[n, 0] - sq[0] * q[n, 1] + sq[2] * q[n, 2] - (cradle[0, 0] * u + cradle[0, 1] * v + cradle[0, 2] * w)
        dy = q[n, 1] - sq[1] * q[n, 2] - (cradle[1, 0] * u + cradle[1, 1] * v + cradle[1, 2] * w + shifts[2])
        dz = q[n, 2] - (cradle[2, 0] * u + cradle[2, 1] * v + cradle[2, 2] * w + shifts[3])
        out[n] = math.sqrt(dx * dx + dy * dy + dz * dz) - length
