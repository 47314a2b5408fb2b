"""The commanded motion of a test on a time grid, and its feed words (paper, eq. A.10 and A.11)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.feed import ACCELERATION, trapezoid
from mjsim.instruments.ball_bar.follow import Followed, follow, own_path
from mjsim.instruments.ball_bar.kinds import Kind, kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.units import DEG


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
