"""How a measured number is printed: with two significant digits of its expanded uncertainty, value and ends rounded
alike (JCGM 100, 7.2.6).

The expanded uncertainty is half the width of the 95 % interval. JSON keeps all digits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from mjsim.units import UM

#: Significant digits of a number that has no interval.
_WITHOUT_INTERVAL = 4
#: Most decimals of a printed number.
_MOST = 12


def decimals_of(value: float | None, ends: Sequence[float] | None) -> int:
    """Decimals with which a number is printed; below zero where its last known digit stands before the point.

    Args:
        value: The number.
        ends: Low and high end of its 95 % interval; ``None`` where it has none. One without a width counts as none.
    """
    half = half_of(ends)
    if half:
        return min(1 - int(f"{half:.1e}".partition("e")[2]), _MOST)
    if not value or not math.isfinite(value):
        return 0
    return min(max(_WITHOUT_INTERVAL - 1 - math.floor(math.log10(abs(value))), 0), _MOST)


def half_of(ends: Sequence[float] | None) -> float | None:
    """Half the width of an interval; ``None`` where there is none that ends."""
    half = None if ends is None else 0.5 * abs(ends[1] - ends[0])
    return half if half is not None and math.isfinite(half) else None


def fixed(value: float, decimals: int, sign: str = "") -> str:
    """A number rounded to some decimals, without a negative zero; ``sign`` is ``+`` where every number has one."""
    return f"{round(value, decimals) + 0.0:{sign}.{max(decimals, 0)}f}"


def estimate(value: float, ends: Sequence[float] | None, sign: str = "") -> str:
    """A number as its interval allows; arguments as of :func:`decimals_of` and :func:`fixed`.

    Without an interval it is as it was stated: zeros at its end say nothing.
    """
    text = fixed(value, decimals_of(value, ends), sign)
    return text if half_of(ends) or "." not in text else text.rstrip("0").rstrip(".")


def interval(ends: Sequence[float] | None, between: str = " to ", sign: str = "") -> str:
    """The 95 % interval, rounded as its number; a dash where there is none."""
    if ends is None:
        return "–"
    return between.join(estimate(x, ends, sign) if half_of(ends) else estimate(x, None, sign) for x in ends)


def expanded(ends: Sequence[float] | None) -> str:
    """The expanded uncertainty, such as ``± 0.35``; empty where there is none."""
    half = half_of(ends)
    return f"± {fixed(half, decimals_of(None, ends))}" if half else ""


def with_interval(value: float, ends: Sequence[float] | None, unit: str = "") -> str:
    """A number with its unit and its interval, such as ``3.10 µm [2.95, 3.25]``."""
    text = f"{estimate(value, ends)} {unit}".rstrip().replace(" °", "°")
    return text if ends is None else f"{text} [{interval(ends, ', ')}]"


def wave_ends(intervals: Sequence | None, wave: int, column: int) -> tuple[float, float] | None:
    """Interval of one number of a wave, from the two tables that stand for the intervals of ``components``.

    Args:
        intervals: Lower and upper table; ``None`` where there are none.
        wave: Row.
        column: 1 for the amplitude, 2 for the phase.
    """
    return None if intervals is None else (intervals[0][wave][column], intervals[1][wave][column])


def rounded_um(value: float) -> float:
    """A length (m) in µm with four decimals, as JSON has it."""
    return round(float(value / UM), 4)
