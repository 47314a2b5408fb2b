"""How far and how fast the axes of an ordinary machine of this size go (assumed: a machine file does not say)."""

from __future__ import annotations

import numpy as np

from mjsim.machine.chain import Axis, Chain
from mjsim.units import DEG

#: Travel of linear axes across and along the spindle, m; of a rotary axis that tilts the table, of one that swivels the
#: head, and of one that goes round, rad.
_ACROSS, _ALONG_SPINDLE = (-0.3, 0.3), (-0.1, 0.5)
#: The same where a head swivels: the slides follow the swivelling tool.
_ACROSS_HEAD, _ALONG_HEAD = (-0.5, 0.5), (-0.4, 0.5)
_TILT, _SWIVEL, _ROUND = (-30 * DEG, 110 * DEG), (-110 * DEG, 110 * DEG), (-50.0, 50.0)
#: Speed of linear axes, m/s (20 m/min); of an axis that tilts or swivels and of one that goes round, rad/s.
_LINEAR_SPEED, _TILT_SPEED, _ROUND_SPEED = 0.33, 1.0, 2.0


def usual_travel(chain: Chain) -> np.ndarray:
    """Lowest and highest position of every axis, (axes, 2) m and rad."""
    return np.array([_travel(chain, a) for a in chain.axes])


def _travel(chain: Chain, axis: Axis) -> tuple[float, float]:
    if not axis.rotary:
        if any(not a.vertical for a in chain.swivelling):
            return _ALONG_HEAD if axis.along == 2 else _ACROSS_HEAD
        return _ALONG_SPINDLE if axis.along == 2 else _ACROSS
    if axis.letter in chain.round_axes:
        return _ROUND
    return axis.ends(*(_SWIVEL if axis in chain.tool or axis.tilted else _TILT))


def usual_speed(chain: Chain) -> np.ndarray:
    """Highest speed of every axis, (axes,) m/s and rad/s."""
    return np.array(
        [
            _LINEAR_SPEED if not a.rotary else _ROUND_SPEED if a.letter in chain.round_axes else _TILT_SPEED
            for a in chain.axes
        ]
    )
