"""How far and how fast the axes of an ordinary machine of this size go (assumed: a machine file does not say)."""

from __future__ import annotations

import numpy as np

from mjsim.machine.chain import Chain
from mjsim.units import DEG

#: Travel of linear axes across and along the spindle, m; of the axis that tilts the table and of the table, rad.
_ACROSS, _ALONG_SPINDLE = (-0.3, 0.3), (-0.1, 0.5)
_TILT, _TABLE = (-30 * DEG, 110 * DEG), (-50.0, 50.0)
#: Speed of linear axes, m/s (20 m/min); of the axis that tilts the table and of the table, rad/s.
_LINEAR_SPEED, _TILT_SPEED, _TABLE_SPEED = 0.33, 1.0, 2.0


def usual_travel(chain: Chain) -> np.ndarray:
    """Lowest and highest position of every axis, (axes, 2) m and rad."""
    ends = {chain.tilt_axis: _TILT, chain.table_axis: _TABLE}
    return np.array([ends.get(a.letter, _ALONG_SPINDLE if a.along == 2 else _ACROSS) for a in chain.axes])


def usual_speed(chain: Chain) -> np.ndarray:
    """Highest speed of every axis, (axes,) m/s and rad/s."""
    speeds = {chain.tilt_axis: _TILT_SPEED, chain.table_axis: _TABLE_SPEED}
    return np.array([speeds.get(a.letter, _LINEAR_SPEED) for a in chain.axes])
