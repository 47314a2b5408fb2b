"""A ball-bar test, the instrument, and what it recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.machine.chain import COORDINATES, FIVE_AXIS, Chain

#: RMS of one sample of an ordinary ball bar, m (assumed).
USUAL_NOISE = 0.12e-6


@dataclass(frozen=True)
class BallBarTest:
    """One ball-bar test. Lengths in m, angles in rad, feed in m/s; names as in ``campaign.toml``.

    ``kind`` is a name of :data:`mjsim.instruments.ball_bar.kinds.KINDS`: cone_frustum, circular, rotary or one of the
    user's own.
    ``sensitive`` is perpendicular or parallel (cone_frustum), tangential, radial or axial (rotary). ``start``/``stop``
    are the ends of a kind that does not go round, ``setup`` names the tests that share both balls' offsets, ``started``
    is the clock time of the NC program's start in s. ``commanded`` is the motion of an NC file where one takes the
    place of the test's own program. ``spindle`` is the angle in rad at which the spindle is held: what the spindle ball
    is off its centreline turns with it. ``chain`` has the axes of the machine that runs the test. ``more`` holds the
    keys that only one's own kinds have, SI. ``component`` is the coordinate (X, Y or Z) along which a sensor reads how
    far the table's ball stands off the spindle's, in the machine frame; empty, it is the distance of the balls that is
    read.
    """

    instrument: ClassVar[str] = "ball_bar"

    name: str
    kind: str
    table_ball: tuple[float, float, float]
    length: float
    feed: float
    half_apex: float = 0.0
    inclination: float = 0.0
    sensitive: str = "perpendicular"
    plane: str = FIVE_AXIS.planes[0]
    axis: str = FIVE_AXIS.round_axes[0]
    start: float = 0.0
    stop: float = 0.0
    direction: str = "CCW"
    revolutions: int = 2
    setup: str = ""
    started: float = 0.0
    spindle: float = 0.0
    trace: str | None = None
    commanded: Commanded | None = None
    chain: Chain = FIVE_AXIS
    more: Mapping[str, float | int | str] = field(default_factory=dict, hash=False)
    component: str = ""

    @property
    def shown_over(self) -> float:
        """Length of what a picture shows, m: the bar, or the surroundings of a sphere (assumed)."""
        return self.length or 0.1

    def pointing(self, table: np.ndarray, spindle: np.ndarray) -> np.ndarray:
        """Direction in which a growing reading is drawn, (3,): along the bar, or along a sensor.

        Args:
            table: Centre of the table's ball, (3,) m.
            spindle: Centre of the spindle's ball, (3,) m.
        """
        if self.component:
            return np.array([float(c == self.component) for c in COORDINATES])
        return (spindle - table) / np.linalg.norm(spindle - table)

    @property
    def recording(self) -> str:
        """Name of the recording that it comes from: readings of one share its clock."""
        return self.name

    @property
    def readings(self) -> list[BallBarTest]:
        """What its recording reads: all coordinates of an R-test, or itself alone."""
        return [replace(self, component=c) for c in COORDINATES] if self.component else [self]


@dataclass(frozen=True)
class Trace:
    """A recorded trace: ``time`` (n,) s from the program's start, ``deviation`` (n,) m, ``valid`` (n,) bool.

    ``saturated`` is the number of samples that are not valid because the sensor stood at its stop, or beyond its range.
    """

    time: np.ndarray
    deviation: np.ndarray
    valid: np.ndarray
    saturated: int = 0


@dataclass(frozen=True)
class BallBarData:
    """The ball bar.

    Without a certificate, its errors are those of a maker's specification: 0.7 µm and 0.3 % of the reading, and the
    resolution as the difference of growing and falling readings (assumed: what makers of such bars state).

    Attributes:
        resolution: Of a reading, m.
        range: Largest reading, m.
        rate: Samples per second, Hz.
        certificate: Which certificate states the numbers below; empty where none does.
        gain: Known relative error of its sensor, which the readings are freed of.
        gain_uncertainty: Expanded uncertainty (k = 2) of that.
        form: Expanded uncertainty (k = 2) of a reading by the form of balls and seats, m.
        hysteresis: Expanded uncertainty (k = 2) of half the difference of growing and falling readings, m.
        temperature: Of the bar while it measures, °C; ``None`` where it is not stated.
        expansion: Of the bar, 1/K.
    """

    resolution: float = 0.1e-6
    range: float = 1.0e-3
    rate: float = 200.0
    certificate: str = ""
    gain: float = 0.0
    gain_uncertainty: float = 3e-3
    form: float = 0.7e-6
    hysteresis: float = 0.1e-6
    temperature: float | None = None
    expansion: float = 0.0
    usual_noise: ClassVar[float] = USUAL_NOISE
    noise_stated: ClassVar[bool] = False

    @property
    def source(self) -> str:
        """From what its errors are known."""
        return self.certificate or "maker's specification (typical, no certificate is stated)"

    def corrected(self, trace: Trace, length: float) -> Trace:
        """A recording freed of what is known of the bar: its gain, and its expansion from 20 °C.

        Args:
            trace: As recorded.
            length: Of the bar at 20 °C, m.
        """
        longer = 0.0 if self.temperature is None else length * self.expansion * (self.temperature - 20.0)
        if self.gain == 0.0 and longer == 0.0:
            return trace
        return replace(trace, deviation=trace.deviation / (1.0 + self.gain) + longer)
