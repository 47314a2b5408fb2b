"""Causes outside the catalogue that are no curve of one variable of one axis: they remember, or depend on two things.

As in :mod:`.unlisted` each is linear in ``amplitude`` and declares what a right verdict may say. Sizes are assumed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit
from scipy.signal import lfilter

from .kinematics import DEG
from .simulate import State
from .unlisted import Unlisted


def travel_unit(axis: str) -> float:
    """A usual travel: 100 mm, or 45° of a rotary axis."""
    return 45.0 * DEG if axis in "ABC" else 0.1


def _settled(seat: np.ndarray, state: State, time_constant_s: float = 0.02) -> np.ndarray:
    """What follows ``seat`` with a lag, at rest at first."""
    keep = np.exp(-(state.time[1] - state.time[0]) / time_constant_s)
    return lfilter([1.0 - keep], [1.0, -keep], seat, zi=[keep * seat[0]])[0]


@dataclass(frozen=True)
class AlternatingKey(Unlisted):
    """A loose key has two seats: whenever its axis starts back from a lower end it goes to the other one.

    The seat does not follow from where the axis is, only from how often it has turned.
    """

    variable: ClassVar = ("direction", "position", "time_since_reversal")

    def shape(self, state: State, i: int) -> np.ndarray:
        way = state.direction[:, i]
        starts = np.concatenate([[False], (way[1:] > 0.0) & (way[:-1] < 0.0)])
        return _settled(1.0 - 2.0 * (np.cumsum(starts) % 2), state)


@dataclass(frozen=True)
class CrossLoad(Unlisted):
    """A slide sags by where two axes are at once: amplitude where both are one usual travel off their middle."""

    beside: str = "Y"
    variable: ClassVar = ("position",)

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((self.axis, self.beside, self.moves or self.axis)))

    def shape(self, state: State, i: int) -> np.ndarray:
        j = state.axes.index(self.beside)
        first, second = state.position[:, i] / travel_unit(self.axis), state.position[:, j] / travel_unit(self.beside)
        return first * second


@dataclass(frozen=True)
class WarmMotor(Unlisted):
    """What the motor has done warms a bracket: a first-order lag of its squared torque, in units of its mean square."""

    time_constant_s: float = 12.0
    variable: ClassVar = ("torque", "clock_time")

    def shape(self, state: State, i: int) -> np.ndarray:
        square = state.torque[:, i] ** 2
        warmth = _settled(np.concatenate([[0.0], square[1:]]), state, self.time_constant_s)
        return warmth / max(float(square.mean()), 1e-12)


@dataclass(frozen=True)
class OilFilm(Unlisted):
    """A slide that reverses squeezes its oil film and sinks by how long ago that was, whatever the direction."""

    time_constant_s: float = 0.5
    variable: ClassVar = ("time_since_reversal",)

    def shape(self, state: State, i: int) -> np.ndarray:
        return -1.0 / (1.0 + state.since_reversal[:, i] / self.time_constant_s)


@dataclass(frozen=True)
class StickSlip(Unlisted):
    """Bursts after a reversal: the slide sticks and jumps, several times a second, until it is fast enough."""

    period_s: float = 0.2
    time_constant_s: float = 0.8
    variable: ClassVar = ("time_since_reversal", "velocity", "direction")

    def shape(self, state: State, i: int) -> np.ndarray:
        since = state.since_reversal[:, i]
        burst = np.exp(-np.minimum(since / self.time_constant_s, 50.0))
        return state.direction[:, i] * burst * (2.0 * np.mod(since / self.period_s, 1.0) - 1.0)


@njit(cache=True, nogil=True)
def _switched(x, threshold):
    y, state = np.empty_like(x), 0.0
    for i in range(len(x)):
        if x[i] > threshold:
            state = 1.0
        elif x[i] < -threshold:
            state = -1.0
        y[i] = state
    return y


@dataclass(frozen=True)
class LooseBracket(Unlisted):
    """A bracket has two seats and snaps from one to the other at a force: its seat is that of the last snap.

    ``threshold`` is a share of the largest departure of the motor's torque from its mean.
    """

    threshold: float = 0.6
    variable: ClassVar = ("torque", "direction", "acceleration", "position")

    def shape(self, state: State, i: int) -> np.ndarray:
        force = state.torque[:, i] - state.torque[:, i].mean()
        seat = _switched(np.ascontiguousarray(force), self.threshold * max(float(np.abs(force).max()), 1e-12))
        return _settled(seat, state)


@dataclass(frozen=True)
class WhirlingScrew(Unlisted):
    """A screw or worm that whirls: a wave along the axis that grows with the square of the speed (1 at 1 m/min or
    0.2 rad/s).
    """

    waves: float = 4.0
    phase_deg: float = 0.0
    variable: ClassVar = ("position", "velocity")

    def shape(self, state: State, i: int) -> np.ndarray:
        speed = state.velocity[:, i] / (0.2 if self.axis in "ABC" else 1.0 / 60.0)
        turns = self.waves * state.position[:, i] / travel_unit(self.axis)
        return speed**2 * np.sin(2.0 * np.pi * turns + self.phase_deg * DEG)


def draw_makers(axes: str, rng: np.random.Generator) -> list[Callable[[], Unlisted]]:
    """One of each family on axes of a machine, shapes drawn. The amplitude is to be scaled."""
    linear = [a for a in axes if a in "XYZ"]
    tilt = next(a for a in axes if a in "AB")
    first, second = (str(a) for a in rng.choice(["X", "Y"], 2, replace=False))
    other, any_axis = str(rng.choice([a for a in linear if a != first])), str(rng.choice([*linear, tilt, "C"]))
    sign, low = float(rng.choice([-1.0, 1.0])), float(rng.uniform(0.5, 1.5))
    return [
        lambda: AlternatingKey(first, sign),
        lambda: CrossLoad(first, sign, moves="Z", beside=second),
        lambda: CrossLoad(tilt, sign, moves=first, beside="C"),
        lambda: WarmMotor(first, sign, moves=other, time_constant_s=12.0 * low),
        lambda: OilFilm(first, sign, moves=second, time_constant_s=0.5 * low),
        lambda: StickSlip(first, sign, period_s=0.2 * low, time_constant_s=0.8 * low),
        lambda: LooseBracket(first, sign, moves=second, threshold=0.4 + 0.25 * low),
        lambda: WhirlingScrew(any_axis, sign, waves=4.0 * low, phase_deg=360.0 * low),
    ]
