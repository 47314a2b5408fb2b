"""How fast a control runs a program: no axis accelerates more than it can, so corners are taken slowly."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numba import njit

from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.machine.chain import Chain
from mjsim.machine.plant import AxisPlant
from mjsim.units import DEG

#: Acceleration of a linear and of a rotary axis, m/s² and rad/s² (assumed: an ordinary machine of this size).
LINEAR, ROTARY = 2.0, 20.0
#: Block time between looks ahead, s.
_LOOK = 2e-3


#: Followed so closely, the axes are taken to be in position at an exact stop, m and rad (Sinumerik's MD36010
#: STOP_LIMIT_FINE: 0.01 mm, 0.01°).
_IN_POSITION, _IN_POSITION_ROTARY = 10e-6, 0.01 * DEG


def rest_at_stops(axes: dict[str, AxisPlant], chain: Chain) -> float:
    """How long the set-points rest at an exact stop until all axes are in position, s.

    While an axis brakes with the acceleration a, it lags by a/K² behind at the stop, K being its position gain; from
    there the lag falls as exp(-K t).

    Args:
        axes: Drives by letter.
        chain: The machine's axes.
    """
    rests = [0.0]
    for axis in chain.axes:
        drive = axes[axis.letter]
        gain, most = drive.position_gain, ROTARY if axis.rotary else LINEAR
        lag = (1.0 - min(drive.feedforward, 1.0)) * most / gain**2
        window = _IN_POSITION_ROTARY if axis.rotary else _IN_POSITION
        rests.append(float(np.log(max(lag / window, 1.0))) / gain)
    return max(rests)


def paced(motion: Commanded, step: float, rest: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Set-points of a program on the control's clock.

    The program is run at its own feed where every axis' acceleration allows it, and more slowly elsewhere; it begins
    and ends at rest, and rests at its exact stops.

    Args:
        motion: The program.
        step: Between set-points, s.
        rest: At each exact stop, s.

    Returns:
        Time (n,) s, and block time (n,) s at these instants, as :meth:`Commanded.at` takes it.
    """
    stops = [] if motion.stops is None else motion.knots[1:][motion.stops]
    ends = np.unique(np.concatenate([[0.0], stops, [motion.duration]]))
    ends = ends[np.concatenate([[True], np.diff(ends) > 1e-12])]
    pieces = [np.linspace(a, b, max(8, int(np.ceil((b - a) / _LOOK))) + 1)[:-1] for a, b in pairwise(ends)]
    still = np.concatenate([[0], np.cumsum([len(p) for p in pieces])])
    u = np.concatenate([*pieces, [motion.duration]])
    q, du = motion.at(u), np.diff(u)
    most = np.array([ROTARY if a.rotary else LINEAR for a in motion.chain.axes])
    rate = np.diff(q, axis=0) / du[:, None] / most  # share of the acceleration limit per unit of du/dt
    bend = np.zeros(len(u))
    bend[2:-2] = np.abs(rate[3:] - rate[:-3]).max(axis=1) / du[1:-2]  # a corner between two looks belongs to both
    for k in (-1, 0, 1):  # what bends at a stop does so at rest
        bend[np.clip(still + k, 0, len(u) - 1)] = 0.0
    v2 = np.minimum(1.0, 0.5 / np.maximum(bend, 1e-12))
    v2[still] = 0.0
    _passes(v2, np.maximum(np.abs(rate).max(axis=1), 1e-12), du)
    v = np.sqrt(v2)
    seconds = np.concatenate([[0.0], np.cumsum(2.0 * du / np.maximum(v[1:] + v[:-1], 1e-6))])
    if rest > 0.0 and len(still) > 2:
        inner = still[1:-1]
        seconds = seconds + rest * np.searchsorted(inner, np.arange(len(u)), side="left")
        u, v = np.insert(u, inner + 1, u[inner]), np.insert(v, inner + 1, 0.0)
        seconds = np.insert(seconds, inner + 1, seconds[inner] + rest)
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
        v2[i] = min(v2[i], v2[i - 1] + du[i - 1] / rate[i - 1])
    for i in range(len(v2) - 2, -1, -1):
        v2[i] = min(v2[i], v2[i + 1] + du[i] / rate[i])
