"""Tests of one axis, or of a diagonal, at target positions; what was measured in one, and where the machine stands in
each reading.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from mjsim.instruments.base import ASSUMED_AS, FEWEST_REPEATS, LEAD_LINEAR, LEAD_ROTARY, STATED, Channel, Stops
from mjsim.machine.chain import COORDINATES, FIVE_AXIS, Chain
from mjsim.units import DEG, MM, UM

#: Clock of a reading where none was recorded: a reading takes so long, s (assumed; only plots show it).
READING_TIME = 10.0
#: Reading where nobody states how well it repeats, m and rad: an axis under a laser or a level (assumed).
ASSUMED_LENGTH, ASSUMED_ANGLE = 0.5 * UM, 2e-6
LENGTH = Channel()
ANGLE = Channel(unit="µrad", size=1e-6, suffix="urad")


@dataclass(frozen=True)
class PositionTest:
    """One axis goes to target positions, or several linear axes along a line, and an instrument reads what it is off
    there.

    Attributes:
        name: Unique in the campaign.
        axis: Letter of the axis that moves; of a diagonal the letters of all that move together.
        component: What is measured, by its name in ISO 230-1: positioning (``E``, coordinate, the axis again),
            straightness (another coordinate) or an angle of the slide (A, B or C). Of a diagonal ``D`` and its axes,
            with a minus behind those that go down.
        line: Where the moving optics is while all axes are at 0, machine frame, (3,) m. Of a straight beam along the
            axis, the coordinates across it.
        at: Where the other axes stand, by letter, m and rad; those that are left out stand at 0.
        dead_path: Of a laser: distance between both optics where they are nearest, m; counts without compensation.
        setup: Tests with the instrument left where it is.
        trace: File of the readings, relative to the campaign; ``None`` where they are not measured yet.
        chain: Axes of the machine.
        targets: Targets that are planned, m or rad; may be empty.
        runs: How often each planned target is measured from each side.
        started: Campaign clock at its first reading's time 0, s.
        ends: Of a diagonal (ISO 230-6): letter of every axis that moves, where it is at target 0, and where at the
            end, m. Targets count along the line.
    """

    __test__ = False
    instrument: ClassVar[str] = "positions"

    name: str
    axis: str
    component: str
    line: tuple[float, float, float] = (0.0, 0.0, 0.0)
    at: tuple[tuple[str, float], ...] = ()
    dead_path: float = 0.0
    setup: str = ""
    trace: str | None = None
    chain: Chain = FIVE_AXIS
    targets: tuple[float, ...] = ()
    runs: int = 5
    started: float = 0.0
    ends: tuple[tuple[str, float, float], ...] = ()

    @property
    def kind(self) -> str:
        """As in campaign.toml."""
        return self.instrument

    @property
    def rotary(self) -> bool:
        """Whether the axis turns."""
        return not self.ends and self.chain.is_rotary(self.axis)

    @property
    def moving(self) -> tuple[str, ...]:
        """Letters of the axes that move."""
        return tuple(letter for letter, _, _ in self.ends) or (self.axis,)

    @property
    def way(self) -> np.ndarray:
        """How far every axis moves per metre or radian of the target, (axes,)."""
        out = np.zeros(self.chain.count)
        for letter, first, last in self.ends or ((self.axis, 0.0, 1.0),):
            out[self.chain.index(letter)] = last - first
        return out / np.linalg.norm(out)

    @property
    def length(self) -> float:
        """Of a diagonal, m."""
        return float(np.linalg.norm([last - first for _, first, last in self.ends]))

    @property
    def unit(self) -> float:
        """SI per mm or degree of its targets."""
        return DEG if self.rotary else MM

    @property
    def positioning(self) -> bool:
        """Whether the component is along the axis or the diagonal itself."""
        return bool(self.ends) or self.component[1] == self.axis

    @property
    def angular(self) -> bool:
        """Whether the readings are angles."""
        return not self.ends and self.component[1] not in COORDINATES

    @property
    def channel(self) -> Channel:
        """Name and unit of the readings."""
        kind = ANGLE if self.angular else LENGTH
        return Channel(self.component, kind.unit, kind.size, kind.suffix)

    @property
    def planned(self) -> Readings:
        """The planned readings in the standard's order, with no deviation: all targets upwards, then downwards, as
        often as there are runs.
        """
        up = np.sort(np.array(self.targets))
        target = np.tile(np.concatenate([up, up[::-1]]), self.runs)
        side = np.tile(np.repeat([1.0, -1.0], len(up)), self.runs)
        run = np.repeat(np.arange(1.0, self.runs + 1.0), 2 * len(up))
        time = READING_TIME * np.arange(len(target))
        return Readings(target, np.zeros(len(target)), side, run, time, False, None)

    @property
    def place(self) -> np.ndarray:
        """Positions of all axes at target 0, (axes,) m and rad."""
        q = np.zeros(self.chain.count)
        for letter, position in (*self.at, *((a, first) for a, first, _ in self.ends)):
            q[self.chain.index(letter)] = position
        return q


@dataclass(frozen=True)
class Readings:
    """What was measured in one test.

    Attributes:
        target: Commanded position of the axis, (n,) m or rad.
        deviation: Actual less commanded, (n,) m or rad.
        side: Direction of the last move, +1 or -1, (n,).
        run: Number of the repetition, (n,).
        time: From the start of the test, (n,) s.
        timed: Whether the times were recorded.
        temperature: Of the axis, (n,) °C; ``None`` where it was not recorded.
    """

    target: np.ndarray
    deviation: np.ndarray
    side: np.ndarray
    run: np.ndarray
    time: np.ndarray
    timed: bool
    temperature: np.ndarray | None

    @cached_property
    def place(self) -> np.ndarray:
        """Number of the target and side that each reading repeats, (n,)."""
        rounded = np.column_stack([np.round(self.target / 1e-7), self.side])
        return np.unique(rounded, axis=0, return_inverse=True)[1].ravel()

    @property
    def scatter(self) -> tuple[float, int]:
        """Sum of the squared departures of repeated readings from their means, m² or rad², and their degrees of
        freedom.
        """
        count = np.bincount(self.place)
        mean = np.bincount(self.place, self.deviation) / count
        return float(((self.deviation - mean[self.place]) ** 2).sum()), len(self.place) - len(count)


@dataclass(frozen=True)
class Reader:
    """Numbers of the instrument.

    Attributes:
        repeatability: Standard deviation of one reading of a length, m; ``None`` where nobody states it.
        angle_repeatability: The same of an angle, rad.
        gain: Standard uncertainty of its unit of length, of the temperature of the axis and of their compensation,
            relative.
        compensated: Whether its readings are corrected for the temperatures of air and axis.
        repeats: Degrees of freedom of repeated readings.
    """

    repeatability: float | None = None
    angle_repeatability: float | None = None
    gain: float = 1e-6
    compensated: bool = False
    repeats: int = 0

    @property
    def source(self) -> str:
        """Where the noise comes from: ``repeated points``, ``stated`` or ``assumed``."""
        if self.repeats >= FEWEST_REPEATS:
            return "repeated points"
        return "assumed" if self.repeatability is None and self.angle_repeatability is None else "stated"

    def stated_noise(self, test: PositionTest) -> tuple[float, int]:
        """Standard deviation of one reading of a test, m or rad, before anything was read: as stated or assumed; and as
        how many repeated readings that counts.
        """
        stated = self.angle_repeatability if test.angular else self.repeatability
        if stated is not None:
            return stated, STATED
        return (ASSUMED_ANGLE if test.angular else ASSUMED_LENGTH), ASSUMED_AS

    def noise(self, test: PositionTest, readings: Readings) -> float:
        """Standard deviation of one reading of a test, m or rad: of repeated readings, pooled with what is stated."""
        known, weight = self.stated_noise(test)
        squares, freedom = readings.scatter
        return float(np.sqrt((squares + weight * known**2) / (freedom + weight)))


def stops_of(test: PositionTest, readings: Readings) -> Stops:
    """Where the machine comes from and stands in every reading; the positions of one axis are counted from the target,
    those of a diagonal are as they are.
    """
    n, way = len(readings.target), test.way
    stand = test.place + readings.target[:, None] * way
    before = stand - readings.side[:, None] * (LEAD_ROTARY if test.rotary else LEAD_LINEAR) * np.sign(way)
    route = np.stack([before, stand], axis=1).reshape(2 * n, -1)
    clock = np.repeat(readings.time if readings.timed else np.zeros(n), 2)
    away = np.zeros(stand.shape) if test.ends else readings.target[:, None] * way
    return Stops(route, test.started + clock, (1 + 2 * np.arange(n))[:, None], away)


def sides_of(target: np.ndarray) -> np.ndarray:
    """Direction of the last move by the order of the targets, (n,). Where a target follows itself, the axis has turned
    about beyond it; the first reading is approached as the second one.
    """
    step = np.sign(np.where(np.abs(np.diff(target)) < 1e-9, 0.0, np.diff(target)))
    out = np.ones(len(target))
    moved = np.flatnonzero(step)
    out[0] = step[moved[0]] if len(moved) else 1.0
    for i, s in enumerate(step, start=1):
        out[i] = s or -out[i - 1]
    return out
