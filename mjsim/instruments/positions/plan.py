"""Targets of an axis by ISO 230-2:2014, clause 5.3."""

from __future__ import annotations

import math

import numpy as np

from mjsim.units import DEG

#: Fewest targets of a linear axis, and of one metre of it.
_FEWEST, _PER_METRE = 5, 5
#: Fewest targets of a rotary axis by its range, rad.
_ROTARY = ((90.0 * DEG, 3), (180.0 * DEG, 5), (math.inf, 8))
#: Parts of a period by which one target after the other is moved: the golden ratio meets every phase.
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


def fewest_targets(rotary: bool, way: float) -> int:
    """How many targets the standard asks for.

    Args:
        rotary: Whether the axis turns.
        way: Range of the test, m or rad.
    """
    if rotary:
        return next(n for end, n in _ROTARY if way <= end + 1e-9)
    return max(_FEWEST, math.ceil(_PER_METRE * way - 1e-9))


def targets_over(low: float, high: float, count: int, period: float) -> np.ndarray:
    """Targets P_i = (i − 1) p + r from one end to the other, none in step with a periodic error.

    Args:
        low: First end, m or rad.
        high: Other end.
        count: How many.
        period: Of a periodic error, such as the lead of a screw, m or rad.

    Returns:
        (count,) m or rad, growing.
    """
    even = np.linspace(low, high, count)
    step = min(period, 0.8 * (even[1] - even[0]))
    phase = np.mod(_GOLDEN * np.arange(count), 1.0) - 0.5
    phase[0], phase[-1] = max(phase[0], 0.0), min(phase[-1], 0.0)
    return np.clip(even + step * phase, low, high)
