"""A ball-bar test, the instrument, and what it recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.machine.chain import FIVE_AXIS, Chain


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
    keys that only one's own kinds have, SI.
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
    """The ball bar: ``resolution`` and ``range`` in m, ``rate`` in Hz."""

    resolution: float = 0.1e-6
    range: float = 1.0e-3
    rate: float = 200.0
