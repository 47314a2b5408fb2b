"""The figures of one reading, compiled: what thousands of runs need without numpy's temporaries.

The same numbers as :func:`mjsim.instruments.ball_bar.iso230.circular_figures` gives (``tests/test_batch.py`` holds the
difference); the angles of a test are the same in every run, so their sines and the normal equations of the
least-squares circle are made once per test.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.iso230 import least_squares_circle
from mjsim.units import UM

#: Names of the figures, in the order in which :meth:`Circle.figures` returns them.
FIGURES = (
    "circular_error_um",
    "radial_max_um",
    "radial_min_um",
    "centre_phi0_um",
    "centre_phi90_um",
    "rms_um",
    "max_um",
    "min_um",
)


class Circle:
    """Angles of one test's measured part, prepared for the figures of many readings.

    Args:
        phi: (n,) rad. full: whether the path is a circle, which has ISO 230-4 figures.
    """

    def __init__(self, phi: np.ndarray, full: bool) -> None:
        self._basis = np.column_stack([np.cos(phi), np.sin(phi)])
        self._normal = np.full((3, 3), np.nan)
        if full:
            try:
                least_squares_circle(phi, np.zeros(len(phi)))
            except InputError:
                return
            basis = np.column_stack([self._basis, np.ones(len(phi))])
            self._normal = np.linalg.inv(basis.T @ basis)

    def figures(self, deviation: np.ndarray) -> np.ndarray:
        """:data:`FIGURES` of a reading (n,) m, in µm; NaN for what only a full circle has."""
        out = np.empty(len(FIGURES))
        _figures(deviation, self._basis, self._normal, out)
        return out / UM


@njit(cache=True, nogil=True, error_model="numpy")
def _figures(deviation, basis, normal, out):
    n = len(deviation)
    a = b = c = square = 0.0
    top, bottom = -math.inf, math.inf
    for i in range(n):
        d = deviation[i]
        a += basis[i, 0] * d
        b += basis[i, 1] * d
        c += d
        square += d * d
        top, bottom = max(top, d), min(bottom, d)
    x = normal[0, 0] * a + normal[0, 1] * b + normal[0, 2] * c
    y = normal[1, 0] * a + normal[1, 1] * b + normal[1, 2] * c
    out[3], out[4], out[5], out[6], out[7] = x, y, math.sqrt(square / n), top, bottom
    out[:3] = math.nan
    if math.isnan(x):
        return
    outer, inner = -math.inf, math.inf
    for i in range(n):
        r = deviation[i] - (x * basis[i, 0] + y * basis[i, 1])
        outer, inner = max(outer, r), min(inner, r)
    out[0], out[1], out[2] = outer - inner, outer, inner


@njit(cache=True, nogil=True, error_model="numpy")
def distance(sensors, first, second, length, out):
    """Distance of two sensed points less the bar's length, (n,) m: ``sensors`` (n, m), ``first`` and ``second`` their
    columns.

    Returns whether every value is finite.
    """
    good = True
    for i in range(len(out)):
        x = sensors[i, first] - sensors[i, second]
        y = sensors[i, first + 1] - sensors[i, second + 1]
        z = sensors[i, first + 2] - sensors[i, second + 2]
        out[i] = math.sqrt(x * x + y * y + z * z) - length
        good = good and math.isfinite(out[i])
    return good
