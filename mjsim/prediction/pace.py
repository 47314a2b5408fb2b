"""How fast a control runs a program: no axis accelerates more than it can, so corners are taken slowly."""

from __future__ import annotations

import numpy as np
from numba import njit

from mjsim.instruments.ball_bar.commanded import Commanded

#: Acceleration of a linear and of a rotary axis, m/s² and rad/s² (assumed: an ordinary machine of this size).
LINEAR, ROTARY = 2.0, 20.0
#: Block time between looks ahead, s.
_LOOK = 2e-3


def paced(motion: Commanded, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Set-points of a program on the control's clock.

    The program is run at its own feed where every axis' acceleration allows it, and more slowly elsewhere; it begins
    and ends at rest.

    Args:
        motion: The program.
        step: Between set-points, s.

    Returns:
        Time (n,) s, and block time (n,) s at these instants, as :meth:`Commanded.at` takes it.
    """
    count = max(8, int(np.ceil(motion.duration / _LOOK)))
    u = np.linspace(0.0, motion.duration, count + 1)
    q = motion.at(u)
    most = np.array([ROTARY if a.rotary else LINEAR for a in motion.chain.axes])
    du = u[1] - u[0]
    rate = np.diff(q, axis=0) / du / most  # share of the acceleration limit per unit of du/dt
    bend = np.zeros(count + 1)
    bend[2:-2] = np.abs(rate[3:] - rate[:-3]).max(axis=1) / du  # a corner between two looks belongs to both
    v2 = np.minimum(1.0, 0.5 / np.maximum(bend, 1e-12))
    v2[0] = v2[-1] = 0.0
    _passes(v2, np.maximum(np.abs(rate).max(axis=1), 1e-12), du)
    v = np.sqrt(v2)
    seconds = np.concatenate([[0.0], np.cumsum(2.0 * du / np.maximum(v[1:] + v[:-1], 1e-6))])
    time = np.arange(int(np.ceil(seconds[-1] / step)) + 1) * step
    return time, _at(time, seconds, u, v)


def _at(time: np.ndarray, seconds: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Block time at ``time``: constant acceleration of the block time between two looks."""
    k = np.clip(np.searchsorted(seconds, time, side="right") - 1, 0, len(u) - 2)
    t = np.clip(time - seconds[k], 0.0, seconds[k + 1] - seconds[k])
    whole = np.maximum(seconds[k + 1] - seconds[k], 1e-12)
    return np.minimum(u[k] + v[k] * t + 0.5 * (v[k + 1] - v[k]) / whole * t * t, u[-1])


@njit(cache=True, nogil=True)
def _passes(v2, rate, du):
    """Limit the squares of the pace ``v2`` so that no step asks for more than half the acceleration along the path."""
    for i in range(1, len(v2)):
        v2[i] = min(v2[i], v2[i - 1] + du / rate[i - 1])
    for i in range(len(v2) - 2, -1, -1):
        v2[i] = min(v2[i], v2[i + 1] + du / rate[i])
