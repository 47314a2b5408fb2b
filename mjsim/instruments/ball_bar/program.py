"""The commanded motion of a test on a time grid, and its feed words (paper, eq. A.10 and A.11)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.follow import ACCELERATION, Followed, follow, own_path, trapezoid
from mjsim.instruments.ball_bar.kinds import Kind, kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import usual_speed
from mjsim.units import DEG, MM

#: Fourth difference of commands above which they are no cubic, m or rad; every such instant of a path is computed, so
#: that its turns are counted without a gap.
_BEND, _COUNTED = 4e-10, 100


@dataclass(frozen=True)
class Program:
    """Commanded motion of one test: its own, or the one of the NC file that drives it.

    Attributes:
        test: the test.
        duration: s, rest to rest.
    """

    test: BallBarTest
    acceleration: float = ACCELERATION

    @property
    def kind(self) -> Kind:
        """The test's kind."""
        return kind_of(self.test)

    @cached_property
    def _followed(self) -> Followed | None:
        return None if self.test.commanded is None else Followed(self.test, self.acceleration)

    @cached_property
    def ends(self) -> tuple[float, float]:
        """φ (rad) at which the test's own program begins and ends, at rest."""
        return self.kind.ends(self.test)

    @cached_property
    def _profile(self):
        first, last = self.ends
        radius = self.kind.radius(self.test)
        duration, travel = trapezoid(abs(last - first) * radius, self.test.feed, self.acceleration)
        sign = np.sign(last - first)
        return duration, lambda time: first + sign * travel(time) / radius

    @property
    def duration(self) -> float:
        """Time from rest to rest, s."""
        if self._followed:
            return self._followed.duration
        return self._profile[0]

    def phi(self, time: np.ndarray) -> np.ndarray:
        """Signed angle φ (rad) at ``time`` (n,) s; the command that turns, for a kind that does not go round."""
        if self._followed:
            return self._followed.phi(time)
        return self._profile[1](time)

    def commands(self, time: np.ndarray) -> np.ndarray:
        """Axis commands (n, axes) m and rad at ``time`` (n,) s, held at both ends."""
        if self._followed:
            return self._followed.commands(time)
        return self.path(self.phi(time))

    def late(self, axis: int, commands: np.ndarray, step: float, delay: float) -> np.ndarray:
        """Commands of one axis (n,) that come ``delay`` s late. A path takes long to compute. Where it is smooth, a
        cubic through four neighbours gives the same.

        Args:
            axis: Its place.
            commands: Of all axes without delay, (n, axes) m and rad, from the program's start.
            step: Between two of them, s.
            delay: s; negative if they come early.
        """
        at, known = np.arange(len(commands)), np.ascontiguousarray(commands[:, axis])
        before = int(np.floor(-delay / step))
        u = -delay / step - before
        # what a cubic misses between its points is at most 3/128 of the fourth difference
        bent = np.pad(np.abs(np.diff(known, 4)) > _BEND, 2, constant_values=True)
        exact = (np.convolve(bent, np.ones(7), "same") > 0.0).take(at + before, mode="clip")
        exact[::_COUNTED] = True
        weights = (
            -u * (u - 1.0) * (u - 2.0) / 6.0,
            (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
            -u * (u + 1.0) * (u - 2.0) / 2.0,
            u * (u + 1.0) * (u - 1.0) / 6.0,
        )
        near = (known.take(at + (before + j), mode="clip") for j in (-1, 0, 1, 2))
        out = np.sum([w * q for w, q in zip(weights, near, strict=True)], axis=0)
        out[exact] = self.commands(step * at[exact] - delay)[:, axis]
        return out

    def path(self, phi: np.ndarray) -> np.ndarray:
        """Axis positions (n, axes), m and rad, of the test's own path at φ (n,) rad."""
        return self.kind.path(self.test, np.asarray(phi, float))

    @property
    def measured_ends(self) -> tuple[float, float]:
        """φ (rad) between which the trace is recorded."""
        first, last = self.ends
        margin = np.sign(last - first) * self.kind.margin
        return first + margin, last - margin

    @cached_property
    def measured_span(self) -> tuple[float, float]:
        """Program times (s) between which the trace is recorded: all but the kind's margin at both ends."""
        if self._followed:
            begin, end = map(self._followed.time_of, self.measured_ends)
            return begin, end
        first, last = self.ends
        margin = self.kind.margin * self.kind.radius(self.test)
        length = abs(last - first) * self.kind.radius(self.test)
        feed = min(self.test.feed, float(np.sqrt(self.acceleration * length)))
        ramp = feed / self.acceleration
        lead = (
            margin / feed + 0.5 * ramp if margin > 0.5 * feed * ramp else float(np.sqrt(2 * margin / self.acceleration))
        )
        return lead, self.duration - lead

    def feed_words(self, phi: np.ndarray) -> np.ndarray:
        """F of eq. A.11 for the blocks between successive φ (n,) rad: mm/min with angles in degrees, (n - 1,)."""
        q = self.path(phi)
        d = np.diff(q * np.array([1 / DEG if a.rotary else 1e3 for a in self.test.chain.axes]), axis=0)
        length = abs(np.diff(phi)) * self.kind.radius(self.test)
        return np.linalg.norm(d, axis=1) / (length / self.test.feed / 60.0)

    def axis_velocity(self, phi: np.ndarray) -> np.ndarray:
        """Axis velocities (n, axes), m/s and rad/s, at φ (n,) rad at the constant feed."""
        h = 1e-5
        path, t = self.kind.path, self.test
        lo, hi = path(t, np.asarray(phi) - h), path(t, np.asarray(phi) + h)
        step = hi - lo
        for table in map(t.chain.index, t.chain.round_axes):
            step[:, table] = (step[:, table] + np.pi) % (2 * np.pi) - np.pi
        sign = np.sign(self.ends[1] - self.ends[0])
        return sign * step / (2 * h) * t.feed / self.kind.radius(t)


def driven_by(test: BallBarTest, motion: Commanded, name: str = "NC program") -> BallBarTest:
    """``test`` with the motion of an NC program in place of its own; every simulation of it uses that.

    Args:
        motion: as :func:`mjsim.nc.read.read_nc` gives it (its ``motion``); of several cutting paths the test's.
        name: of the program, for messages.

    Raises:
        InputError: the program is none of this test, or has another feed.
    """
    motion = own_path(test, motion, name)
    return follow(test, motion, Program(replace(test, commanded=None)).measured_ends, name)


# -- axis events along a test ------------------------------------------------------------------------------------------

#: Extent within which a point counts as being at a reversal, rad of the test's angle.
NEAR = np.radians(6.0)

#: Reversals so close to an end of the measured part still show in it, s.
_EDGE = 0.2


def reversals(program: Program) -> dict[str, np.ndarray]:
    """Signed test angles φ (rad) at which each axis reverses in the measured part, its ends included; other axes
    are left out.
    """
    lo, hi = program.measured_span
    time = np.linspace(max(0.0, lo - _EDGE), min(program.duration, hi + _EDGE), 20001)
    q, phi = program.commands(time), program.phi(time)
    out = {}
    for i, axis in enumerate(program.test.chain.letters):
        step = np.diff(q[:, i])
        step[np.abs(step) < 1e-12] = 0.0
        moving = np.flatnonzero(step)
        if len(moving) < 2:
            continue
        turn = moving[np.flatnonzero(np.diff(np.sign(step[moving])))]
        if len(turn):
            out[axis] = phi[turn + 1]
    return out


def event_at(phi: float, events: dict[str, np.ndarray]) -> str:
    """The axis event nearest to an angle: ``"reversal of Y"``, or ``"between reversals"``."""
    near = [(float(np.min(np.abs(a - phi))), axis) for axis, a in events.items()]
    distance, axis = min(near, default=(np.inf, ""))
    return f"reversal of {axis}" if distance <= NEAR else "between reversals"


# -- what a test asks of the axes, and what looks impossible about it --------------------------------------------------

#: Instants that are looked at.
_INSTANTS = 721


def commanded_speed(test: BallBarTest) -> tuple[np.ndarray, np.ndarray]:
    """Axis commands (n, axes) m and rad along a test, and the highest speed of each axis (axes,) m/s and rad/s."""
    program = Program(test)
    time = np.linspace(0.0, program.duration, _INSTANTS)
    q = program.commands(time)
    return q, np.abs(np.gradient(q, time, axis=0)).max(axis=0)


def speed_warnings(test: BallBarTest) -> list[str]:
    """One sentence per axis that the test moves faster than an ordinary machine can; empty where there is none."""
    _, speed = commanded_speed(test)
    out = []
    for axis, v, most in zip(test.chain.axes, speed, usual_speed(test.chain), strict=True):
        scale, unit = (DEG, "°/s") if axis.rotary else (MM / 60.0, "mm/min")
        if v > most:
            out.append(
                f"{test.name}: {axis.letter} has to move at {v / scale:.0f} {unit}; an ordinary machine reaches "
                f"{most / scale:.0f} {unit}. "
                "A lower feed or another path needs less."
            )
    return out


def range_warning(test: BallBarTest, deviation: np.ndarray, sensor_range: float) -> str:
    """A sentence where a reading (n,) m leaves the sensor's range (m); empty where it does not."""
    largest = float(np.abs(deviation).max())
    if largest <= sensor_range:
        return ""
    return (
        f"{test.name}: the reading reaches {largest / MM:.3g} mm, beyond the sensor's range of "
        f"±{sensor_range / MM:g} mm."
    )
