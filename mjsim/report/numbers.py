"""Numbers as the report prints them: as :mod:`mjsim.digits` rounds them, with true minus signs."""

from __future__ import annotations

import math

from mjsim import digits
from mjsim.report.content import ParameterRow

NONE = "–"


def um(value: float | None, decimals: int = 2) -> str:
    """An error in µm, without its unit; a dash for None and NaN."""
    return fixed(value, decimals)


def fixed(value: float | None, decimals: int) -> str:
    """A number with that many decimals; a dash for None and NaN; no negative zero."""
    if value is None or not math.isfinite(value):
        return NONE
    return _minus(digits.fixed(value, decimals))


def ends_of(parameter: ParameterRow) -> tuple[float, float] | None:
    """The 95 % interval; None when there is none."""
    return None if parameter.low is None or parameter.high is None else (parameter.low, parameter.high)


def estimate(parameter: ParameterRow) -> str:
    """The estimate, as finely as its interval allows."""
    return _minus(digits.estimate(parameter.value, ends_of(parameter)))


def interval(parameter: ParameterRow) -> str:
    """The 95 % interval ``low to high``; a dash when there is none."""
    return _minus(digits.interval(ends_of(parameter)))


def percent_removed(before: float | None, after: float | None) -> str:
    """How much of an RMS is gone, of its square (the error's power), in percent; a dash when it cannot be said."""
    if before is None or after is None or not before > 0.0 or not math.isfinite(after):
        return NONE
    return fixed(100.0 * (1.0 - (after / before) ** 2), 1) + " %"


def _minus(text: str) -> str:
    return text.replace("-", "−")
