"""A ball-bar test, the instrument, and what it recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.ballbar.commanded import Commanded
from mjsim.machine.chain import FIVE_AXIS, Chain


@dataclass(frozen=True)
class BallBarTest:
    """One ball-bar test. Lengths in m, angles in rad, feed in m/s; names as in ``campaign.toml``.

    ``kind`` is cone_frustum, circular or rotary. ``sensitive`` is perpendicular or parallel (cone_frustum), tangential,
    radial or axial (rotary). ``start``/``stop`` are the rotary axis' ends, ``setup`` names the tests that share both balls'
    offsets, ``started`` is the clock time of the NC program's start in s. ``commanded`` is the motion of an NC file where one takes
    the place of the test's own program. ``chain`` has the axes of the machine that runs the test.
    """

    name: str
    kind: str
    table_ball: tuple[float, float, float]
    length: float
    feed: float
    half_apex: float = 0.0
    inclination: float = 0.0
    sensitive: str = "perpendicular"
    plane: str = FIVE_AXIS.planes[0]
    axis: str = FIVE_AXIS.table_axis
    start: float = 0.0
    stop: float = 0.0
    direction: str = "CCW"
    revolutions: int = 2
    setup: str = ""
    started: float = 0.0
    trace: str | None = None
    commanded: Commanded | None = None
    chain: Chain = FIVE_AXIS

    @property
    def repeats(self) -> bool:
        """Whether the trace goes over the same path at least twice, so that its noise can be told from the machine."""
        return self.kind != "rotary" and self.revolutions >= 2


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
class Instrument:
    """The ball bar: ``resolution`` and ``range`` in m, ``rate`` in Hz."""

    resolution: float = 0.1e-6
    range: float = 1.0e-3
    rate: float = 200.0
