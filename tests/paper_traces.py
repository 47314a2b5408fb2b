"""Traces of the paper's tests and what is measured on them, for the tests that hold the simulator to the paper.

Angles are the paper's plot angles (φ + 180°). Where the paper speaks of one cause alone, the trace is the difference
between the simulations with and without it; as measured traces, deflections are taken about the least-squares circle.
Offsets of 200 mm are the paper's own.
"""

import numpy as np
from scipy.signal import find_peaks

UM = 1e-6
CENTRE, X200, X_200, Y200, Y_200 = ((0, 0, 155), (200, 0, 155), (-200, 0, 155), (0, 200, 155), (0, -200, 155))
OFFSETS = (X200, X_200, Y200, Y_200)
ANGLE = np.arange(3600) / 10.0  # plot angle, degrees


def centred(trace):
    """About the least-squares circle."""
    a = np.radians(ANGLE)
    basis = np.column_stack([np.ones(len(a)), np.cos(a), np.sin(a)])
    return trace - basis @ np.linalg.lstsq(basis, trace, rcond=None)[0]


def at(trace, angle):
    return trace[round(angle * 10) % 3600]


def step(trace, angle):
    """Height of the step at an angle: from 5° before to 5° past it."""
    return at(trace, angle + 5) - at(trace, angle - 5)


def within(low, high):
    """Mask of plot angles from ``low`` to ``high`` (through 360° where low > high)."""
    return (ANGLE >= low) & (ANGLE <= high) if low < high else (ANGLE >= low) | (ANGLE <= high)


def glitches(trace):
    """Angles at which a projection of more than 0.3 µm peaks."""
    peaks, _ = find_peaks(np.tile(np.abs(trace), 3), height=0.3, distance=50, prominence=0.3)
    return ANGLE[sorted({p % 3600 for p in peaks if 3600 <= p < 7200})]


def nearest(found, angle):
    return np.abs((found - angle + 180) % 360 - 180).min()
