"""Numbers as the report prints them: fixed decimals per quantity, true minus signs, estimates rounded by their
interval.
"""

from __future__ import annotations

import math

from mjsim.report.content import ParameterRow

NONE = "–"


def um(value: float | None, decimals: int = 2) -> str:
    """An error in µm, without its unit; a dash for None and NaN."""
    return fixed(value, decimals)


def fixed(value: float | None, decimals: int) -> str:
    """A number with that many decimals; a dash for None and NaN; no negative zero."""
    if value is None or not math.isfinite(value):
        return NONE
    return _minus(f"{round(value, decimals) + 0.0:.{decimals}f}")


def decimals_of(parameter: ParameterRow) -> int:
    """Decimals that show the 95 % interval to two significant digits; four significant digits of the value without
    an interval.
    """
    width = None if parameter.low is None or parameter.high is None else 0.5 * abs(parameter.high - parameter.low)
    if width and math.isfinite(width):
        return min(max(1 - math.floor(math.log10(width)), 0), 12)
    if not parameter.value or not math.isfinite(parameter.value):
        return 0
    return min(max(3 - math.floor(math.log10(abs(parameter.value))), 0), 12)


def estimate(parameter: ParameterRow) -> str:
    """The estimate, as finely as its interval deserves."""
    return fixed(parameter.value, decimals_of(parameter))


def interval(parameter: ParameterRow) -> str:
    """The 95 % interval ``low to high``; a dash when there is none."""
    if parameter.low is None or parameter.high is None:
        return NONE
    decimals = decimals_of(parameter)
    return f"{fixed(parameter.low, decimals)} to {fixed(parameter.high, decimals)}"


def percent_removed(before: float | None, after: float | None) -> str:
    """How much of an RMS is gone, of its square (the error's power), in percent; a dash when it cannot be said."""
    if before is None or after is None or not before > 0.0 or not math.isfinite(after):
        return NONE
    return fixed(100.0 * (1.0 - (after / before) ** 2), 1) + " %"


def _minus(text: str) -> str:
    return text.replace("-", "−")
