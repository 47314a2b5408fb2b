"""A test that is driven by an NC program of its own, or by what a control made of one: the angle of a commanded
motion, and whether it follows the test.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import SENSES
from mjsim.machine.kinematics import reading
from mjsim.units import DEG, MM, UM

# -- feed profile along a circular path --------------------------------------------------------------------------------

#: Peripheral acceleration at both ends of a test, m/s² (assumed; the paper does not print one).
ACCELERATION = 0.5


def trapezoid(length: float, feed: float, acceleration: float = ACCELERATION):
    """Travel along a path of ``length`` (m) from rest to rest.

    Returns:
        ``(duration, travel)``: the duration in s and a function of time (n,) s that gives the distance travelled (n,)
        m; it holds its ends. A path too short for the feed gets a triangular profile.

    >>> duration, travel = trapezoid(length=0.1, feed=0.01)
    >>> round(duration, 3), round(float(travel(duration / 2)), 3)
    (10.02, 0.05)
    """
    feed = min(feed, float(np.sqrt(acceleration * length)))
    ramp = feed / acceleration
    duration = length / feed + ramp

    def travel(t: np.ndarray) -> np.ndarray:
        t = np.clip(np.asarray(t, float), 0.0, duration)
        rest = duration - t
        up, down = 0.5 * acceleration * t**2, length - 0.5 * acceleration * rest**2
        return np.where(t < ramp, up, np.where(rest < ramp, down, feed * (t - 0.5 * ramp)))

    return duration, travel


#: How far the balls' distance may leave the bar's length, m: the sensor's range of an ordinary ball bar.
RANGE = 1.0 * MM
#: How far the program's mean feed may lie from the test's, as a ratio; more is another feed and has to be named.
FEED_TOLERANCE = 0.02
#: As much for what a control really told its axes: it may be slowed down by its accelerations.
RECORD_TOLERANCE = 0.5

#: How far a program may begin behind the measured part, or end before it, rad: printed digits of one without run-in.
TOUCH = 0.01 * DEG


def angle(test: BallBarTest, q: np.ndarray) -> np.ndarray:
    """The test's angle φ (n,) rad, within a turn, at axis positions ``q`` (n, axes): the place of the spindle ball on
    its circle.

    For a kind that does not go round it is the command that turns.
    """
    return kind_of(test).angle(test, q)


def unwrapped(test: BallBarTest, q: np.ndarray) -> np.ndarray:
    """:func:`angle` along a motion ``q`` (n, axes) without jumps; circles begin within half a turn of φ = 0."""
    return np.unwrap(angle(test, q)) if kind_of(test).goes_round else angle(test, q)


@dataclass(frozen=True, eq=False)
class Followed:
    """The commanded motion of a test on its own clock: block times, with the peripheral acceleration at both ends.

    Attributes:
        test: the test; its ``commanded`` is the motion. acceleration: peripheral, m/s².
    """

    test: BallBarTest
    acceleration: float = ACCELERATION

    @cached_property
    def _profile(self):
        if self._motion.clocked:
            duration = self._motion.duration
            return duration, lambda time: np.clip(time, 0.0, duration)
        # the control overrides all block times alike while it accelerates: the same trapezoid, in block time instead of
        # path
        return trapezoid(self._motion.duration, 1.0, self.acceleration / self.test.feed)

    @property
    def _motion(self) -> Commanded:
        assert self.test.commanded is not None
        return self.test.commanded

    @property
    def duration(self) -> float:
        """Time from rest to rest, s."""
        return self._profile[0]

    def commands(self, time: np.ndarray) -> np.ndarray:
        """Axis commands (n, axes) m and rad at ``time`` (n,) s, held at both ends."""
        return self._motion.at(self._profile[1](time))

    @cached_property
    def knots(self) -> np.ndarray:
        """φ at the points of the blocks, (n + 1,) rad."""
        return unwrapped(self.test, self._motion.axes)

    def phi(self, time: np.ndarray) -> np.ndarray:
        """φ (n,) rad at ``time`` (n,) s."""
        inside = self._profile[1](time)
        phi = angle(self.test, self._motion.at(inside))
        if not kind_of(self.test).goes_round:
            return phi
        turn = 2 * np.pi
        return phi + turn * np.round((np.interp(inside, self._motion.knots, self.knots) - phi) / turn)

    def time_of(self, phi: float) -> float:
        """Program time (s) at which φ (rad) is reached; its start or end where φ lies beyond."""
        from scipy.optimize import root_scalar  # takes longer to load than all else here

        first, last = self.knots[[0, -1]]
        if (phi - first) * (last - first) <= 0.0:
            return 0.0
        if (phi - last) * (last - first) >= 0.0:
            return self.duration
        return float(
            root_scalar(lambda t: self.phi(np.array([t]))[0] - phi, bracket=(0.0, self.duration), xtol=1e-9).root
        )


def own_path(test: BallBarTest, motion: Commanded, name: str) -> Commanded:
    """The cutting path of a program on which the balls keep their distance; the longest of several.

    Args:
        test: As the campaign defines it. motion: An NC program. name: Of the program's file, for messages.

    Raises:
        InputError: the axes stop within the path.
    """
    if motion.cutting is None and motion.stops is None:
        return motion
    parts = [motion.part(first, last) for first, last in motion.paths]
    if not parts:
        raise InputError(f"{name}: has no feed block; allowed: a program with the path of the test")
    ball = np.asarray(test.table_ball)
    near = [p for p in parts if np.abs(reading(test.chain, p.axes, ball, test.length)).max() <= RANGE]
    own = max(near or parts, key=lambda p: p.duration)
    if own.stops is not None and own.stops[:-1].any():
        raise InputError(
            f"{name}: the axes stop within the path (exact stop, as G61), at point {int(np.argmax(own.stops)) + 2}; "
            "allowed for a test: path mode, as G64"
        )
    return replace(own, cutting=None, stops=None)


def counted_otherwise(test: BallBarTest, axes: np.ndarray) -> str:
    """Rotary axes with whose positions counted the other way the balls keep their distance along most of a motion, for
    a message; empty where there are none.

    Args:
        test: The test.
        axes: (n, axes) positions, m and rad.
    """
    for count in range(1, len(test.chain.rotary) + 1):
        for letters in combinations(test.chain.rotary, count):
            turned = axes.copy()
            turned[:, [test.chain.index(a) for a in letters]] *= -1.0
            off = reading(test.chain, turned, np.asarray(test.table_ball), test.length)
            if np.median(np.abs(off)) <= RANGE:
                senses = " and ".join(
                    f'sense = "{SENSES[test.chain.sense(a) == SENSES[0]]}" of [axis.{a}]' for a in letters
                )
                return (
                    f"{' and '.join(letters)} counted the other way, the balls keep their distance: {senses} in the "
                    "machine file if the control counts so, program_reversed if this program alone does"
                )
    return ""


def check_path(test: BallBarTest, motion: Commanded, span: tuple[float, float], name: str) -> np.ndarray:
    """Refuse a program that is none of this test; φ (n + 1,) rad at its points.

    Args:
        test: as the campaign defines it. motion: an NC program.
        span: φ (rad) at which the measured part begins and ends. name: of the program's file, for messages.

    Raises:
        InputError: the balls leave the bar's range, φ turns back, or the measured part is not covered.
    """
    axes = motion.axes
    off = reading(test.chain, axes, np.asarray(test.table_ball), test.length)
    worst = int(np.argmax(np.abs(off)))
    if abs(off[worst]) > RANGE:
        otherwise = counted_otherwise(test, axes)
        signs = f"check the test, its table ball, the zero point, and the signs of {' and '.join(test.chain.rotary)}"
        raise InputError(
            f'{name}: is no program of test "{test.name}": at point {worst + 1} of {len(axes)} the balls are '
            f"{(test.length + off[worst]) / MM:.3f} mm apart; allowed: the bar's {test.length / MM:g} ± "
            f"{RANGE / MM:g} mm "
            f"({f'with {otherwise}' if otherwise else signs})"
        )
    phi, (first, last) = unwrapped(test, axes), span
    sign = np.sign(last - first)
    back = np.flatnonzero(sign * np.diff(phi) < -1e-3 * DEG)
    if len(back):
        i = int(back[0])
        raise InputError(
            f"{name}: φ goes from {phi[i] / DEG:.3f}° to {phi[i + 1] / DEG:.3f}° at point {i + 2} of {len(axes)}; "
            f'allowed for test "{test.name}": φ that only {"grows" if sign > 0 else "falls"}'
        )
    if sign * (phi[0] - first) > TOUCH or sign * (phi[-1] - last) < -TOUCH:
        raise InputError(
            f"{name}: runs from φ = {phi[0] / DEG:.3f}° to {phi[-1] / DEG:.3f}°; "
            f'test "{test.name}" is measured from {first / DEG:.3f}° to {last / DEG:.3f}°'
        )
    return phi


def follow(test: BallBarTest, motion: Commanded, span: tuple[float, float], name: str) -> BallBarTest:
    """``test`` driven by ``motion`` from now on; its feed is the mean one that the block times really give.

    Args:
        as :func:`check_path`.

    Raises:
        InputError: as :func:`check_path`, or the feed is another one than the test's.
    """
    phi, sign = check_path(test, motion, span, name), np.sign(span[1] - span[0])
    begin, end = np.interp(sign * np.array(span), sign * phi, motion.knots)
    feed = abs(span[1] - span[0]) * kind_of(test).radius(test) / float(end - begin)
    # a record says what feed a control really gave, and only a program of another test is far from it
    tolerance = RECORD_TOLERANCE if motion.clocked else FEED_TOLERANCE
    if abs(feed / test.feed - 1.0) > tolerance:
        raise InputError(
            f"{name}: its mean feed is {feed / MM * 60:.6g} mm/min on the circle; "
            f'allowed for test "{test.name}": feed_mm_min = {test.feed / MM * 60:g} within {tolerance:.0%}'
        )
    return replace(test, commanded=motion, feed=feed)


def deviation(driven: BallBarTest, nominal, times: int = 20001) -> dict:
    """How far a driven test's program is from the test's own one, at the same φ over the measured part.

    Args:
        driven: from :func:`follow`. nominal: the ``Program`` of the same test without a commanded motion. times:
            instants looked at.

    Returns:
        ``position_um`` per linear axis, ``angle_urad`` per rotary axis, ``time_ms``, each the largest absolute
        deviation, and ``reading_um``: ``[lowest, highest]`` reading of an ideal machine; ``feed_mm_min``: the mean
        feed.
    """
    motion = Followed(driven)
    lo, hi = nominal.measured_span
    time = np.linspace(lo, hi, times)
    phi = nominal.phi(time)
    own = np.linspace(motion.time_of(phi[0]), motion.time_of(phi[-1]), times)
    phi = motion.phi(own)
    q = motion.commands(own)
    off = q - nominal.path(phi)
    for table in map(driven.chain.index, driven.chain.round_axes):
        off[:, table] = (off[:, table] + np.pi) % (2 * np.pi) - np.pi  # whole turns do not matter
    off = np.abs(off).max(axis=0)
    sign = np.sign(phi[-1] - phi[0])
    late = own - own[0] - (np.interp(sign * phi, sign * nominal.phi(time), time) - lo)
    bar = reading(driven.chain, q, np.asarray(driven.table_ball), driven.length)
    return {
        "position_um": {a: float(off[driven.chain.index(a)] / UM) for a in driven.chain.linear},
        "angle_urad": {a: float(off[driven.chain.index(a)] / 1e-6) for a in driven.chain.rotary},
        "time_ms": float(np.abs(late).max() * 1e3),
        "reading_um": [float(bar.min() / UM), float(bar.max() / UM)],
        "feed_mm_min": driven.feed / MM * 60,
    }
