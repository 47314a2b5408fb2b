"""NC programs of the kinds of ball-bar test, as exact functions of time.

Nothing is interpolated between NC points: the path is evaluated in closed form, which is what points 0.1° apart
approximate. Definitions: the paper's equations A.5 to A.9 and the feed profile (rest 10° before φ = 0, 0.5 m/s² at both
ends).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .kinematics import DEG, axis_command, turn_x, turn_y, turn_z

#: Peripheral acceleration at both ends of a program, m/s².
ACCELERATION = 0.5
#: Run-in and run-out of the closed paths, rad.
OVERRUN = 10.0 * DEG
#: What a rotary trace leaves out at both ends, rad.
ROTARY_MARGIN = 2.0 * DEG
PLANES = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0)}


@dataclass
class Program:
    """One test's program.

    Args:
        test: a ``[[test]]`` table of campaign.toml.

    Attributes:
        duration: s. window: instants between which the trace is recorded, s. ball: (3,) m. length: m.
    """

    test: dict
    duration: float = field(init=False)
    window: tuple[float, float] = field(init=False)

    def __post_init__(self) -> None:
        t = self.test
        self.ball = np.array(t["table_ball_mm"], float) * 1e-3
        self.length = t["bar_length_mm"] * 1e-3
        self.feed = t["feed_mm_min"] / 60e3
        if t["kind"] in ("rotary", "simultaneous"):
            first, last = t["from_deg"] * DEG, t["to_deg"] * DEG
            self.radius, margin = self.turning_radius(), ROTARY_MARGIN
            self.start, self.sign, turned = first, np.sign(last - first), abs(last - first)
        else:
            shrunk = t["kind"] == "cone_frustum" and t["sensitive_direction"] == "perpendicular"
            self.radius, margin = self.length * (np.cos(t["half_apex_deg"] * DEG) if shrunk else 1.0), OVERRUN
            self.sign = 1.0 if t["direction"] == "CCW" else -1.0
            self.start, turned = -self.sign * OVERRUN, 2.0 * np.pi * t["revolutions"] + 2.0 * OVERRUN
        self.path = self.radius * turned
        self.ramp = min(self.feed / ACCELERATION, np.sqrt(self.path / ACCELERATION))
        self.speed = ACCELERATION * self.ramp
        self.duration = self.path / self.speed + self.ramp
        self.window = (self._instant(self.radius * margin), self._instant(self.path - self.radius * margin))
        if t["kind"] == "cone_frustum":
            self.prepare_cone()

    def turning_radius(self) -> float:
        """Of the circle on which a rotary axis carries the table ball; the linear axes' largest path per rad where both
        turn, m.
        """
        if self.test["kind"] == "rotary":
            return self._circle()
        phi, h = np.linspace(self.test["from_deg"] * DEG, self.test["to_deg"] * DEG, 361), 1e-5
        slope = (self._both(phi + h) - self._both(phi - h))[:, :3] / (2 * h)
        return float(np.linalg.norm(slope, axis=1).max())

    def _circle(self) -> float:
        return float(np.hypot(*self.ball[[1, 2] if self.test["axis"] == "A" else [0, 1]]))

    def _second(self, phi: np.ndarray) -> np.ndarray:
        """Where the other rotary axis is, in proportion, rad."""
        first, last, other, end = (
            self.test[k] * DEG for k in ("from_deg", "to_deg", "second_from_deg", "second_to_deg")
        )
        return other + (end - other) * (phi - first) / (last - first)

    def _resting(self) -> np.ndarray:
        """Spindle ball at rest in the frame of the workpiece, (3,) m."""
        return self.ball + self.length * np.eye(3)["XYZ".index(self.test["sensitive_direction"])]

    def _both(self, phi: np.ndarray) -> np.ndarray:
        """Both rotary axes, the spindle ball at rest in the frame of the workpiece, (n, axes)."""
        a, c = (phi, self._second(phi)) if self.test["axis"] == "A" else (self._second(phi), phi)
        return axis_command(a, c, np.tile(self._resting(), (len(phi), 1)))

    def prepare_cone(self) -> None:
        """Table of C along a cone, without jumps."""
        self._table_phi = np.arange(min(self.start, self.last), max(self.start, self.last) + 2e-3, 1e-3)
        raw = self._table_phi if self.sign > 0 else self._table_phi[::-1]
        self._table_c = np.unwrap(self._principal_c(raw))[:: int(self.sign)]

    @property
    def last(self) -> float:
        """φ at the end, rad."""
        return self.start + self.sign * self.path / self.radius

    def _instant(self, distance: float) -> float:
        """When the ball has gone ``distance`` (outside the ramps), s."""
        return float(distance / self.speed + self.ramp / 2.0)

    def phi(self, time: np.ndarray) -> np.ndarray:
        """Central angle (rotary: axis command) at the given instants, rad."""
        t = np.clip(time, 0.0, self.duration)
        left = self.duration - t
        gone = np.where(t < self.ramp, ACCELERATION / 2.0 * t**2, self.speed * (t - self.ramp / 2.0))
        gone = np.where(left < self.ramp, self.path - ACCELERATION / 2.0 * left**2, gone)
        return self.start + self.sign * gone / self.radius

    def _cone(self, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Spindle ball in the work frame and unit tool direction, both (n, 3)."""
        theta, beta = self.test["half_apex_deg"] * DEG, self.test["inclination_deg"] * DEG
        if self.test["sensitive_direction"] == "perpendicular":
            radius, height, apex = self.length * np.cos(theta), self.length * np.sin(theta), self.length / np.sin(theta)
        else:
            radius, height, apex = self.length, 0.0, self.length / np.tan(theta)
        p = np.column_stack([radius * np.cos(phi), radius * np.sin(phi), np.full_like(phi, height)])
        tool = np.array([0.0, 0.0, apex]) - p
        tool /= np.linalg.norm(tool, axis=1)[:, None]
        return turn_y(beta, p) + self.ball, turn_y(beta, tool)

    def _principal_c(self, phi: np.ndarray) -> np.ndarray:
        tool = self._cone(phi)[1]
        return np.arctan2(tool[:, 0], tool[:, 1])

    def commands(self, time: np.ndarray) -> np.ndarray:
        """Axis commands (n, 5) in m and rad; before and after the program the axes rest on its ends."""
        t, phi = self.test, self.phi(np.asarray(time, float))
        if t["kind"] == "cone_frustum":
            point, tool = self._cone(phi)
            c = np.arctan2(tool[:, 0], tool[:, 1])
            c += 2.0 * np.pi * np.round((np.interp(phi, self._table_phi, self._table_c) - c) / (2.0 * np.pi))
            return axis_command(np.arccos(np.clip(tool[:, 2], -1.0, 1.0)), c, point)
        if t["kind"] == "circular":
            out = np.zeros((len(phi), 5))
            out[:, :3] = self.ball
            first, second = PLANES[t["plane"]]
            out[:, first] += self.length * np.cos(phi)
            out[:, second] += self.length * np.sin(phi)
            return out
        if t["kind"] == "simultaneous":
            return self._both(phi)
        axis = np.array([1.0, 0.0, 0.0] if t["axis"] == "A" else [0.0, 0.0, 1.0])
        radial = self.ball - axis * (self.ball @ axis)
        radial = radial / np.linalg.norm(radial)
        way = {"radial": radial, "axial": axis, "tangential": np.cross(axis, radial)}[t["sensitive_direction"]]
        held = np.broadcast_to(self.ball + self.length * way, (len(phi), 3))
        still = np.zeros_like(phi)
        if t["axis"] == "A":
            return np.column_stack([turn_x(phi, held), phi, still])
        return np.column_stack([turn_z(phi, held), still, phi])
