"""The commanded motion of a test on a time grid, and its feed words (paper, eq. A.10 and A.11)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mjsim.campaign.model import Test
from mjsim.nc.feed import ACCELERATION, trapezoid
from mjsim.nc.paths import PATHS, peripheral_radius
from mjsim.units import DEG

#: Run-in and run-out of cone_frustum and circular tests, rad.
OVERLAP = 10.0 * DEG
#: Both ends that a rotary trace leaves out, rad.
ROTARY_MARGIN = 2.0 * DEG


@dataclass(frozen=True)
class Program:
    """Commanded motion of one test.

    Attributes:
        test: the test.
        duration: s, rest to rest.
    """

    test: Test
    acceleration: float = ACCELERATION

    @cached_property
    def _ends(self) -> tuple[float, float]:
        t = self.test
        if t.kind == "rotary":
            return t.start, t.stop
        sign = 1.0 if t.direction == "CCW" else -1.0
        return -sign * OVERLAP, sign * (2 * np.pi * t.revolutions + OVERLAP)

    @cached_property
    def _profile(self):
        first, last = self._ends
        radius = peripheral_radius(self.test)
        duration, travel = trapezoid(abs(last - first) * radius, self.test.feed, self.acceleration)
        sign = np.sign(last - first)
        return duration, lambda time: first + sign * travel(time) / radius

    @property
    def duration(self) -> float:
        """Time from rest to rest, s."""
        return self._profile[0]

    def phi(self, time: np.ndarray) -> np.ndarray:
        """Signed angle φ (rad) at ``time`` (n,) s; for rotary tests the rotary axis' command."""
        return self._profile[1](time)

    def commands(self, time: np.ndarray) -> np.ndarray:
        """Axis commands (n, 5): X, Y, Z (m), A, C (rad) at ``time`` (n,) s, held at both ends."""
        return PATHS[self.test.kind](self.test, self.phi(time))

    @cached_property
    def measured_span(self) -> tuple[float, float]:
        """Program times (s) between which the trace is recorded: whole revolutions, or all but 2° at both ends."""
        first, last = self._ends
        margin = (ROTARY_MARGIN if self.test.kind == "rotary" else OVERLAP) * peripheral_radius(self.test)
        length = abs(last - first) * peripheral_radius(self.test)
        feed = min(self.test.feed, float(np.sqrt(self.acceleration * length)))
        ramp = feed / self.acceleration
        lead = margin / feed + 0.5 * ramp if margin > 0.5 * feed * ramp else float(np.sqrt(2 * margin / self.acceleration))
        return lead, self.duration - lead

    def feed_words(self, phi: np.ndarray) -> np.ndarray:
        """F of eq. A.11 for the blocks between successive φ (n,) rad: mm/min with dA, dC in degrees, (n - 1,)."""
        q = PATHS[self.test.kind](self.test, np.asarray(phi, float))
        d = np.diff(q * np.array([1e3, 1e3, 1e3, 1 / DEG, 1 / DEG]), axis=0)
        length = abs(np.diff(phi)) * peripheral_radius(self.test)
        return np.linalg.norm(d, axis=1) / (length / self.test.feed / 60.0)

    def axis_velocity(self, phi: np.ndarray) -> np.ndarray:
        """Axis velocities (n, 5), m/s and rad/s, at φ (n,) rad at the constant feed."""
        h = 1e-5
        path, t = PATHS[self.test.kind], self.test
        lo, hi = path(t, np.asarray(phi) - h), path(t, np.asarray(phi) + h)
        step = hi - lo
        step[:, 4] = (step[:, 4] + np.pi) % (2 * np.pi) - np.pi
        sign = np.sign(self._ends[1] - self._ends[0])
        return sign * step / (2 * h) * t.feed / peripheral_radius(t)
