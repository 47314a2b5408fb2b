"""Tests with a sphere, what was measured in one, and where the machine stands in each of its points."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.base import ASSUMED_AS, FEWEST_REPEATS, LEAD_LINEAR, LEAD_ROTARY, STATED, Stops
from mjsim.machine.chain import COORDINATES, FIVE_AXIS, Chain
from mjsim.machine.kinematics import bar_vector, turn_about
from mjsim.units import UM

#: Clock of a point where none was recorded: a point takes so long, s (assumed; only plots show it).
POINT_TIME = 30.0


@dataclass(frozen=True)
class SphereTest:
    """A sphere on the table, probed at several positions of the rotary axes.

    Attributes:
        name: Unique in the campaign.
        sphere: Nominal centre in the work frame, all rotary axes at zero, (3,) m.
        setup: Tests with the sphere left where it is.
        trace: File of the points, relative to the campaign; ``None`` where they are not measured yet.
        chain: Axes of the machine, with the tool length of the probe where a head turns.
        angles: Positions of the rotary axes that are planned, one row a point, rad; may be empty.
        spindle: Angle of the spindle in each planned point, rad; empty: 0 in all.
        approach: Direction of the last move of every rotary axis in each planned point, +1 or -1; empty: by their
            order.
        started: Campaign clock at its first point's time 0, s.
    """

    __test__ = False
    instrument: ClassVar[str] = "sphere"

    name: str
    sphere: tuple[float, float, float]
    setup: str = ""
    trace: str | None = None
    chain: Chain = FIVE_AXIS
    angles: tuple[tuple[float, ...], ...] = ()
    spindle: tuple[float, ...] = ()
    approach: tuple[tuple[int, ...], ...] = ()
    started: float = 0.0

    @property
    def kind(self) -> str:
        """As in campaign.toml."""
        return self.instrument

    @property
    def planned(self) -> Points:
        """The planned points, with no deviation."""
        n = len(self.angles)
        angles = np.array(self.angles, float).reshape(n, len(self.chain.rotary))
        side = np.array(self.approach, float) if self.approach else sides_of(angles)
        spindle = np.array(self.spindle) if self.spindle else np.zeros(n)
        time = POINT_TIME * np.arange(n)
        return Points(self.centred(angles), np.zeros((n, 3)), side, spindle, time, False, np.ones(n))

    def centred(self, angles: np.ndarray) -> np.ndarray:
        """Axis positions (n, axes), m and rad, at which an ideal machine's tool centre point is in the sphere's centre.

        Args:
            angles: Of the rotary axes, (n, rotary) rad.
        """
        q = np.zeros((len(angles), self.chain.count))
        q[:, self.chain.rotary_columns] = angles
        at, unit = self.chain.linear_columns, np.eye(self.chain.count)[self.chain.linear_columns]
        away = bar_vector(self.chain, q, np.array(self.sphere))
        # the vector is linear in the linear axes, also where they stand on rotary ones
        moves = np.stack([bar_vector(self.chain, q + u, np.array(self.sphere)) - away for u in unit], axis=2)
        q[:, at] -= np.linalg.solve(moves, away[:, :, None])[:, :, 0]
        return q


@dataclass(frozen=True)
class Points:
    """What was measured in one test.

    Attributes:
        position: Commanded axis positions, (n, axes) m and rad.
        deviation: Measured centre less the commanded place, machine frame, (n, 3) m.
        side: Direction of the last move of every rotary axis, +1, -1, or 0 where nobody knows, (n, rotary).
        spindle: Angle of the spindle, (n,) rad.
        time: From the start of the test, (n,) s.
        timed: Whether the times were recorded.
        run: Number of the repetition, (n,).
    """

    position: np.ndarray
    deviation: np.ndarray
    side: np.ndarray
    spindle: np.ndarray
    time: np.ndarray
    timed: bool
    run: np.ndarray

    @cached_property
    def place(self) -> np.ndarray:
        """Number of the place that each point repeats: same position, same sides, (n,)."""
        rounded = np.column_stack([np.round(self.position / 1e-5), self.side, np.round(self.spindle / 1e-4)])
        return np.unique(rounded, axis=0, return_inverse=True)[1].ravel()

    @property
    def scatter(self) -> tuple[float, int]:
        """Sum of the squared departures of repeated points from their means, m², and their degrees of freedom."""
        mean = np.array([self.deviation[self.place == p].mean(axis=0) for p in range(self.place.max() + 1)])
        return float(((self.deviation - mean[self.place]) ** 2).sum()), 3 * (len(self.place) - len(mean))


@dataclass(frozen=True)
class Probe:
    """Numbers of the instrument.

    Attributes:
        repeatability: Standard deviation of one measured centre, each coordinate, m; ``None`` where nobody states it.
        offset: Prior standard deviation of the probe's tip from the spindle's axis and of its length, m.
    """

    repeatability: float | None = None
    offset: float = 20.0 * UM
    found: tuple[float, int] = field(default=(0.0, 0))

    def with_scatter(self, scatter: float, freedom: int) -> Probe:
        """The same with what repeated points show."""
        return replace(self, found=(scatter, freedom))

    @property
    def source(self) -> str:
        """Where the noise comes from: ``repeated points``, ``stated`` or ``assumed``."""
        if self.found[1] >= FEWEST_REPEATS:
            return "repeated points"
        return "assumed" if self.repeatability is None else "stated"

    @property
    def noise(self) -> float:
        """Standard deviation of one measured centre, each coordinate, m: of repeated points, else as stated.

        Few repeats are pooled with the statement, which counts as much as 10 of them.
        """
        known = ASSUMED if self.repeatability is None else self.repeatability
        weight = ASSUMED_AS if self.repeatability is None else STATED
        squares, freedom = self.found
        return float(np.sqrt((squares + weight * known**2) / (freedom + weight)))


#: Repeatability where nobody states one, m: a strain-gauge or kinematic touch probe and the axes under it (assumed).
ASSUMED = 1.0 * UM


def stops_of(test: SphereTest, points: Points) -> Stops:
    """Where the machine comes from and stands in every point.

    A sphere is touched from opposite sides, so that play of a linear axis cancels in its centre: every point is
    approached by all linear axes from below and from above, and the mean counts. So it is for a rotary axis whose last
    move nobody knows.
    """
    chain, n = test.chain, len(points.position)
    # the linear axes stand where the centre was found, which may be a millimetre from where it was looked for
    away = np.zeros((n, chain.count))
    if not chain.carried:
        away[:, chain.linear_columns] = points.deviation
    stand = points.position + away
    route, clock, at = [], [], []
    for sign in (1.0, -1.0):
        lead = np.zeros((n, chain.count))
        lead[:, chain.linear_columns] = sign * LEAD_LINEAR
        lead[:, chain.rotary_columns] = np.where(points.side == 0, sign, points.side) * LEAD_ROTARY
        both = np.stack([stand - lead, stand], axis=1).reshape(2 * n, -1)
        at.append(len(route) * 2 * n + 1 + 2 * np.arange(n))
        route.append(both)
        clock.append(np.repeat(points.time if points.timed else np.zeros(n), 2))
    return Stops(np.vstack(route), test.started + np.concatenate(clock), np.stack(at, axis=1), away)


def sphere_columns(test: SphereTest, position: np.ndarray) -> np.ndarray:
    """Derivatives of the deviations by the place of the sphere in the work frame, (n, 3, 3)."""
    ball, h = np.array(test.sphere), 1e-3
    at = bar_vector(test.chain, position, ball)
    return np.stack([(at - bar_vector(test.chain, position, ball + h * e)) / h for e in np.eye(3)], axis=2)


def probe_columns(test: SphereTest, points: Points) -> np.ndarray:
    """Derivatives of the deviations by the place of the probe's tip in the spindle and by a three-lobed pre-travel,
    (n, 3, 5).

    A tip that is displaced by a vector finds the centre displaced by minus that. Pre-travel with three lobes displaces
    the centre from four touches along the machine's axes by (cos, sin) of (phase − 3 spindle angle).
    """
    chain, n = test.chain, len(points.position)
    c, s = np.cos(points.spindle), np.sin(points.spindle)
    zero, one = np.zeros(n), np.ones(n)
    vectors = [[c, s, zero], [-s, c, zero], [zero, zero, one]]
    c, s = np.cos(3.0 * points.spindle), np.sin(3.0 * points.spindle)
    vectors += [[-c, s, zero], [-s, -c, zero]]
    out = []
    for vector in vectors:
        for axis in chain.swivelling:
            vector = turn_about(axis, vector, points.position[:, chain.index(axis.letter)])
        out.append(-np.column_stack(vector))
    return np.stack(out, axis=2)


def sides_of(angles: np.ndarray) -> np.ndarray:
    """Direction of the last move of every rotary axis by the order of the points, (n, rotary): 0 before the first
    move.
    """
    out = np.zeros(angles.shape)
    for i in range(1, len(angles)):
        step = angles[i] - angles[i - 1]
        out[i] = np.where(np.abs(step) > 1e-6, np.sign(step), out[i - 1])
    return out


# -- touches of a probe on a sphere ------------------------------------------------------------------------------------
# A tip of radius r touches a sphere of radius R where their centres are R + r apart. The four coordinates of the centre
# and of that distance follow from four touches or more (least squares; the pre-travel of the probe is in the distance).

#: Sides from which a sphere is touched, machine frame: from above first.
_SIDES = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], float)
#: Cosine of the angle between a side and the stem of the sphere within which nobody touches: 60°.
_STEM = 0.5
#: Fewest touches from which a centre follows.
FEWEST_TOUCHES = 4
#: Numbers in a line of a file that LinuxCNC writes of its probings: its nine axes.
LOGGED = 9


def sides_of_points(test: SphereTest) -> list[np.ndarray]:
    """From which sides each planned point is touched, (k, 3) machine frame: where the stem is in the way, from none.

    Args:
        test: With its positions; the stem stands on the table, away from the spindle at zero.

    Raises:
        InputError: A head turns the probe, or the stem of a point is above the sphere.
    """
    chain = test.chain
    if chain.swivelling:
        raise InputError(
            f'test "{test.name}": the head turns with {chain.swivelling[0].letter}; allowed: a probing program for '
            "machines whose table turns"
        )
    position, ball = test.planned.position, np.array(test.sphere)
    below = ball - np.array([0.0, 0.0, 1.0])
    stem = bar_vector(chain, position, ball) - bar_vector(chain, position, below)  # from the sphere to its foot
    out = []
    for i, way in enumerate(stem):
        kept = _SIDES[_SIDES @ way <= _STEM]
        if len(kept) < FEWEST_TOUCHES or not kept[0][2]:
            raise InputError(
                f'test "{test.name}", point {i + 1}: the stem of the sphere is in the way; allowed: positions at which '
                "the table does not hang over"
            )
        out.append(kept)
    return out


def centre_of(contacts: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (3,) and distance of the tip from it that fit some contacts (k, 3) best, m.

    Differences of |p − c|² = d² are linear in the centre; the sum of squares of p is exact for a sphere.
    """
    mean = contacts.mean(axis=0)
    p = contacts - mean
    columns = np.column_stack([2.0 * p, np.ones(len(p))])
    x = np.linalg.lstsq(columns, (p**2).sum(axis=1), rcond=None)[0]
    return mean + x[:3], float(np.sqrt(x[3] + x[:3] @ x[:3]))


def centres_of_log(test: SphereTest, values: np.ndarray) -> np.ndarray:
    """Centres (n, 3) m of the planned points.

    Args:
        test: With its positions.
        values: Where the probe has switched, in the order of the program, (touches, n) m, the linear axes first.

    Raises:
        InputError: There are more or fewer touches than the program makes.
    """
    sides = sides_of_points(test)
    ends = np.cumsum([0, *map(len, sides)])
    # LinuxCNC 2.9 writes a line for every way down beside the sphere too, where the probe did not switch
    down = np.array([not side[2] for point in sides for side in point])
    touches = np.arange(len(down)) + np.cumsum(down)
    if len(values) == len(down) + down.sum():
        values = values[touches]
    if len(values) != len(down):
        raise InputError(
            f'test "{test.name}": {len(values)} touches; allowed: the {len(down)} of its program, in their order, or '
            f"{len(down) + down.sum()} with the ways down beside the sphere"
        )
    return np.array([centre_of(values[a:b, : len(COORDINATES)])[0] for a, b in pairwise(ends)])
