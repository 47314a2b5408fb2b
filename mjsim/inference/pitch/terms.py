"""What an axis adds to its position, as terms that the reading is linear in: waves, and faults of one place.

Positions are those of the motor side over the gear, rad: what the pitch error is a function of (effect catalogue).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mjsim.units import DEG

#: One unit of a fitted coefficient, rad.
UNIT = 1e-3 * DEG


@dataclass(frozen=True)
class Wave:
    """``c sin(N x) + s cos(N x)``, in units of :data:`UNIT`: amplitude hypot(c, s), phase atan2(s, c).

    Attributes:
        axis: A or C. direction: CW, CCW, or empty for both directions. order: N per turn of the axis.
        free_order: whether the order is fitted as well. test: the only test it acts in (what is below the tooth order);
            None: all.
    """

    axis: str
    direction: str
    order: float
    c: float = 0.0
    s: float = 0.0
    free_order: bool = False
    test: str | None = None

    @property
    def size(self) -> int:
        """Number of fitted numbers."""
        return 3 if self.free_order else 2

    @property
    def amplitude_deg(self) -> float:
        return float(np.hypot(self.c, self.s)) * UNIT / DEG

    @property
    def phase_deg(self) -> float:
        return float(np.degrees(np.arctan2(self.s, self.c)))

    def value(self, x: np.ndarray) -> np.ndarray:
        """What it adds at positions ``x`` (n,) rad, rad."""
        return UNIT * (self.c * np.sin(self.order * x) + self.s * np.cos(self.order * x))

    def columns(self, x: np.ndarray) -> list[np.ndarray]:
        """Derivatives of :meth:`value` with respect to c, s and, where it is free, the order."""
        sin, cos = UNIT * np.sin(self.order * x), UNIT * np.cos(self.order * x)
        return [sin, cos, x * (self.c * cos - self.s * sin)] if self.free_order else [sin, cos]

    def moved(self, step: np.ndarray) -> Wave:
        """The term with its numbers moved by ``step`` (size,)."""
        order = self.order + float(step[2]) if self.free_order else self.order
        return replace(self, c=self.c + float(step[0]), s=self.s + float(step[1]), order=order)


@dataclass(frozen=True)
class Fault:
    """``height exp(-((x - centre)/width)²/2)``, once per turn: a local fault such as a worn stretch of the wheel;
    height in UNIT, rad.
    """

    axis: str
    direction: str
    centre: float
    width: float
    height: float = 0.0
    test: str | None = None

    @property
    def size(self) -> int:
        return 3

    def _away(self, x: np.ndarray) -> np.ndarray:
        return ((x - self.centre + np.pi) % (2 * np.pi) - np.pi) / self.width

    def value(self, x: np.ndarray) -> np.ndarray:
        """What it adds at positions ``x`` (n,) rad, rad."""
        return UNIT * self.height * np.exp(-0.5 * self._away(x) ** 2)

    def columns(self, x: np.ndarray) -> list[np.ndarray]:
        """Derivatives with respect to height, centre and ln width; the latter two per tenth of a width."""
        u = self._away(x)
        bell = UNIT * np.exp(-0.5 * u**2)
        return [bell, 0.1 * self.height * bell * u, 0.1 * self.height * bell * u**2]

    def moved(self, step: np.ndarray) -> Fault:
        """The term with its numbers moved by ``step`` (3,), place and width by less than half a width at once."""
        shift, stretch = np.clip(0.1 * step[1:], -0.5, 0.5)
        return replace(
            self,
            height=self.height + float(step[0]),
            centre=self.centre + float(shift) * self.width,
            width=self.width * float(np.exp(stretch)),
        )


Term = Wave | Fault
