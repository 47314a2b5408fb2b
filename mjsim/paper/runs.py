"""The simulated traces that the figures show, each run once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mjsim.instruments.ball_bar.iso230 import least_squares_circle
from mjsim.instruments.ball_bar.kinds.cone_frustum import ConeFrustum
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import FIVE_AXIS
from mjsim.paper.machine import PaperMachine
from mjsim.progress import Progress, silent
from mjsim.simulation.multibody import Simulation, simulate
from mjsim.units import DEG, MM, UM

#: Plot angles of every trace, ° (the paper's plots call 180° what its appendix calls φ = 0).
ANGLE = np.arange(0.0, 360.0, 0.1)
#: Inclination of the cone for each half apex angle, °.
INCLINATION = {15: 10, 45: 30}
#: The paper's bar, ball height and feed.
LENGTH, HEIGHT, FEED = 100.0 * MM, 155.0 * MM, 1000.0 * MM / 60.0


@dataclass(frozen=True, order=True)
class Run:
    """One cone-frustum test of the paper with one cause.

    Attributes:
        cause: of :data:`mjsim.paper.machine.CAUSES`. theta: half apex angle, °. x, y: X_T and Y_T, mm.
        method: "perpendicular" or "parallel".
    """

    cause: str
    theta: int
    x: float = 0.0
    y: float = 0.0
    method: str = "perpendicular"

    @classmethod
    def beside(cls, cause: str, theta: int, along: str, offset: float) -> Run:
        """The run with the cone's centre ``offset`` mm along X or Y."""
        return cls(cause, theta, x=offset) if along == "X" else cls(cause, theta, y=offset)

    def test(self) -> BallBarTest:
        """The test, one revolution CCW."""
        return BallBarTest(
            name=f"{self.cause} {self.theta}° ({self.x:g}, {self.y:g}) {self.method}",
            kind=ConeFrustum.name,
            table_ball=(self.x * MM, self.y * MM, HEIGHT),
            length=LENGTH,
            feed=FEED,
            half_apex=self.theta * DEG,
            inclination=INCLINATION[self.theta] * DEG,
            sensitive=self.method,
            revolutions=1,
        )

    @property
    def reference(self) -> Run | None:
        """The run without the cause, where a figure shows it "without tracking delay and friction": what is drawn
        is the difference.
        """
        return (
            None if self.cause in ("all", "friction", "none") else Run("none", self.theta, self.x, self.y, self.method)
        )


class Traces:
    """Simulations of all runs asked for.

    Args:
        machine: the paper's machine. runs: what will be asked for. threads: tests side by side. progress: stage, done,
            total.
    """

    def __init__(
        self, machine: PaperMachine, runs: Iterable[Run], threads: int = 2, progress: Progress = silent
    ) -> None:
        wanted = set(runs)
        wanted |= {r.reference for r in wanted if r.reference}
        self._done: dict[Run, Simulation] = {}
        by_cause: dict[str, list[Run]] = {}
        for run in sorted(wanted):
            by_cause.setdefault(run.cause, []).append(run)

        def one(_: BallBarTest) -> None:
            count[0] += 1
            progress("simulating the paper's tests", count[0], len(wanted))

        count = [0]
        for cause, some in by_cause.items():
            results = simulate(machine.machine(cause), [r.test() for r in some], threads, one)
            self._done |= dict(zip(some, results, strict=True))

    def simulation(self, run: Run) -> Simulation:
        """The simulation as it is."""
        return self._done[run]

    def raw(self, run: Run) -> np.ndarray:
        """What the cause makes of the reading at :data:`ANGLE`, µm."""
        reading = self._reading(run)
        return reading - self._reading(run.reference) if run.reference else reading

    def centred(self, run: Run) -> np.ndarray:
        """As :meth:`raw`, about the least-squares centre, as the paper draws its traces (section 3.1)."""
        phi, raw = np.radians(ANGLE - 180.0), self.raw(run)
        return raw - least_squares_circle(phi, raw * UM).eccentricity_m(phi) / UM

    def velocity(self, run: Run, axis: str) -> tuple[np.ndarray, np.ndarray]:
        """Simulated velocity of one axis over the plot angle 0° to 360°: mm/min, for rotary axes °/min."""
        s = self._done[run]
        position = s.position[:, FIVE_AXIS.index(axis)] / (DEG if FIVE_AXIS.is_rotary(axis) else MM)
        # what changes within 40 ms: the shape of a glitch is no matter of velocities
        speed = np.convolve(np.gradient(position, s.time), np.full(40, 1 / 40), "same") * 60.0
        keep = (s.phi >= 0) & (s.phi <= 2 * np.pi)
        angle = (np.degrees(s.phi[keep]) + 180.0) % 360.0
        order = np.argsort(angle)
        return angle[order], speed[keep][order]

    def _reading(self, run: Run) -> np.ndarray:
        s = self._done[run]
        return np.interp(np.radians(ANGLE - 180.0) % (2 * np.pi), s.phi, s.deviation / UM)
