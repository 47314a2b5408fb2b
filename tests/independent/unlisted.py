"""Causes that the catalogue does not have, to see whether a diagnosis admits that it does not know.

Each is linear in ``amplitude`` and declares what a right verdict may say: its axes and the variables that it depends
on, out of position, direction, velocity, acceleration, torque, time_since_reversal and clock_time. All sizes are
assumed; SI units inside.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from .kinematics import DEG, MICRO
from .simulate import State
from .transmission import _play

ARCSEC = DEG / 3600.0


def unit(axis: str) -> float:
    """What an amplitude of 1 means on an axis: 1 µm, or 1 arcsec on a rotary axis."""
    return ARCSEC if axis in "ABC" else MICRO


@dataclass(frozen=True)
class Unlisted:
    """A cause outside the catalogue. ``axis`` is where it comes from, ``amplitude`` in µm (arcsec where it acts on a
    rotary axis).
    """

    axis: str
    amplitude: float = 1.0
    variable: ClassVar[tuple[str, ...]] = ()
    #: The axis that it displaces, where that is another one.
    moves: str | None = None

    @property
    def name(self) -> str:
        words = "".join("_" + c.lower() if c.isupper() else c for c in type(self).__name__).lstrip("_")
        return f"{words}.{self.axis}"

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((self.axis, self.moves or self.axis)))

    def scaled(self, factor: float) -> Unlisted:
        return replace(self, amplitude=self.amplitude * factor)

    def shape(self, state: State, i: int) -> np.ndarray:
        """(n,) the displacement for an amplitude of 1; ``i`` is the column of ``axis``."""
        return np.zeros(len(state.time))

    def displacement(self, state: State) -> np.ndarray:
        """(n, 5) what is added to the axis positions, m and rad."""
        out = np.zeros_like(state.position)
        target = self.moves or self.axis
        source = state.axes.index(self.axis)
        out[:, state.axes.index(target)] = self.amplitude * unit(target) * self.shape(state, source)
        return out

    def table(self, state: State, ball: np.ndarray) -> np.ndarray | float:
        """(n, 3) displacement of the table ball in the cradle frame, m."""
        return 0.0


@dataclass(frozen=True)
class EncoderStep(Unlisted):
    """The encoder of a rotary axis reads wrong by a constant between two positions (a damaged stretch of its scale)."""

    from_deg: float = 120.0
    to_deg: float = 200.0
    variable: ClassVar = ("position",)

    def shape(self, state: State, i: int) -> np.ndarray:
        away = (state.position[:, i] / DEG - self.from_deg) % 360.0
        width = (self.to_deg - self.from_deg) % 360.0
        return np.clip(away / 0.2, 0.0, 1.0) - np.clip((away - width) / 0.2, 0.0, 1.0)


@dataclass(frozen=True)
class LooseGib(Unlisted):
    """Play of a slide in one part of its travel only (a gib worn where the machine works most)."""

    from_mm: float = -30.0
    to_mm: float = 40.0
    variable: ClassVar = ("position", "direction")

    def shape(self, state: State, i: int) -> np.ndarray:
        x = state.position[:, i]
        inside = 0.5 * (np.tanh((x * 1e3 - self.from_mm) / 4.0) - np.tanh((x * 1e3 - self.to_mm) / 4.0))
        return (_play(np.ascontiguousarray(x), 4e-6) - x) / 2e-6 * inside


@dataclass(frozen=True)
class EccentricPlay(Unlisted):
    """Play of a rotary axis that varies with its position (worm wheel out of centre)."""

    centre_deg: float = 60.0
    variable: ClassVar = ("position", "direction")

    def shape(self, state: State, i: int) -> np.ndarray:
        x = state.position[:, i]
        narrow = 4.0 * ARCSEC
        return (_play(np.ascontiguousarray(x), narrow) - x) / (narrow / 2.0) * np.cos(x - self.centre_deg * DEG)


@dataclass(frozen=True)
class Crosstalk(Unlisted):
    """A slide is pushed aside by another one's acceleration: amplitude per 10 mm/s²."""

    variable: ClassVar = ("acceleration",)

    def shape(self, state: State, i: int) -> np.ndarray:
        return state.acceleration[:, i] / 0.010


@dataclass(frozen=True)
class ReversalCreep(Unlisted):
    """After each reversal an axis settles exponentially into its place (viscous lubricant, a relaxing wiper)."""

    time_constant_s: float = 1.0
    variable: ClassVar = ("time_since_reversal",)

    def shape(self, state: State, i: int) -> np.ndarray:
        return state.direction[:, i] * np.exp(-state.since_reversal[:, i] / self.time_constant_s)


@dataclass(frozen=True)
class CoolerCycle(Unlisted):
    """Growth of a slide that swings with the cooler's switching."""

    period_s: float = 95.0
    phase_deg: float = 40.0
    variable: ClassVar = ("clock_time",)

    def shape(self, state: State, i: int) -> np.ndarray:
        return np.sin(2.0 * np.pi * state.clock / self.period_s + self.phase_deg * DEG)


@dataclass(frozen=True)
class SuddenShift(Unlisted):
    """A fixture slips at one instant of the campaign and stays."""

    at_s: float = 300.0
    variable: ClassVar = ("clock_time",)

    def shape(self, state: State, i: int) -> np.ndarray:
        return np.where(state.clock > self.at_s, 1.0, 0.0)


@dataclass(frozen=True)
class SlideFloat(Unlisted):
    """A slide floats up on its oil film with speed and moves another axis: amplitude at 1 m/min, with the square
    root of the speed.
    """

    variable: ClassVar = ("velocity",)

    def shape(self, state: State, i: int) -> np.ndarray:
        return np.sqrt(np.abs(state.velocity[:, i]) * 60.0)


@dataclass(frozen=True)
class TableLift(Unlisted):
    """The table floats up with its turning speed: amplitude at 1 rad/s times its square root."""

    variable: ClassVar = ("velocity",)

    def shape(self, state: State, i: int) -> np.ndarray:
        return np.sqrt(np.abs(state.velocity[:, i]))


@dataclass(frozen=True)
class TorqueDeflection(Unlisted):
    """The motor's torque bends a bracket and displaces another axis: amplitude per N m."""

    variable: ClassVar = ("torque", "direction")

    def shape(self, state: State, i: int) -> np.ndarray:
        return state.torque[:, i] - state.torque[0, i]


@dataclass(frozen=True)
class ScrewWobble(Unlisted):
    """A bent ball screw pushes its slide aside once per turn."""

    lead_mm: float = 10.0
    phase_deg: float = 30.0
    variable: ClassVar = ("position",)

    def shape(self, state: State, i: int) -> np.ndarray:
        return np.sin(2.0 * np.pi * state.position[:, i] / (self.lead_mm * 1e-3) + self.phase_deg * DEG)


@dataclass(frozen=True)
class ToothPatch(Unlisted):
    """Tooth-mesh waves on a part of the worm wheel only (a patch damaged by a shock)."""

    order: float = 72.0
    centre_deg: float = 150.0
    width_deg: float = 25.0
    variable: ClassVar = ("position",)

    def shape(self, state: State, i: int) -> np.ndarray:
        x = state.position[:, i]
        away = (x / DEG - self.centre_deg + 180.0) % 360.0 - 180.0
        return np.sin(self.order * x) * np.exp(-0.5 * (away / self.width_deg) ** 2)


@dataclass(frozen=True)
class SideThrow(Unlisted):
    """A slide yaws over when it reverses and throws another axis aside: lost motion across the axis."""

    variable: ClassVar = ("direction",)

    def shape(self, state: State, i: int) -> np.ndarray:
        x = state.position[:, i]
        return (_play(np.ascontiguousarray(x), 3e-6) - x) / 1.5e-6


@dataclass(frozen=True)
class TableEgg(Unlisted):
    """The table bulges twice per turn in its own radial direction."""

    phase_deg: float = 20.0
    variable: ClassVar = ("position",)

    def table(self, state: State, ball: np.ndarray) -> np.ndarray:
        turned = state.position[:, state.axes.index("C")] + np.arctan2(ball[1], ball[0])
        radial = np.column_stack([np.cos(turned), np.sin(turned), np.zeros_like(turned)])
        return self.amplitude * MICRO * (np.cos(2.0 * turned + self.phase_deg * DEG)[:, None] * radial)
