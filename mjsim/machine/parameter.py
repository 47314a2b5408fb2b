"""One parameter of an effect: its unit, bounds and typical size."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from mjsim.units import unit_of


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, in the units of its name.

    Attributes:
        name: e.g. ``width_deg``; the unit is its ending.
        meaning: one line.
        lower, upper: allowed closed range.
        neutral: the value that switches the effect off (leading parameters only).
        default: value when the file leaves it out; ``None`` makes it required.
        kind: ``number``, ``components`` (a list of [order, amplitude, phase_deg]), ``choice``, or ``sensor`` (name of a
            temperature sensor of the campaign).
        choices: allowed texts of a ``choice``.
        scale: a typical size, in the same unit: the step of numerical derivatives and of searches.
        inverse: fitted as its reciprocal (a stiffness is off at infinity; its compliance is off at zero).
        log: fitted as its logarithm (a time constant is above zero, and known to a factor rather than to seconds).
    """

    name: str
    meaning: str
    lower: float = -1e9
    upper: float = 1e9
    neutral: float | None = None
    default: Any = None
    kind: str = "number"
    choices: tuple[str, ...] = ()
    scale: float = 1.0
    inverse: bool = False
    log: bool = False

    def encode(self, value: float) -> float:
        """A value as fits see it, in typical sizes."""
        if self.log:
            return math.log(value / self.scale)
        return self.scale / value if self.inverse else value / self.scale

    def decode(self, x: float) -> float:
        """The value, inside its bounds, that fits see as ``x``."""
        if self.inverse:
            return max(self.scale / x, self.lower) if x > self.scale / self.upper else self.upper
        value = self.scale * math.exp(min(x, 700.0)) if self.log else x * self.scale
        return min(max(value, self.lower), self.upper)

    @property
    def factor(self) -> float:
        """Factor to SI."""
        return unit_of(self.name)[0]

    @property
    def unit(self) -> str:
        """Symbol of the unit, empty for ratios and orders."""
        return unit_of(self.name)[1]

    @property
    def leading(self) -> bool:
        """Whether this parameter's neutral value switches the whole effect off."""
        return self.neutral is not None or self.kind == "components"
