"""What a video of one test shows: the axes' motion, the traces about one centre, the error that is magnified, and
by how much.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.ball_bar.compare import overlay
from mjsim.errors import InputError
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.vibration import phased_at
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.model import Machine
from mjsim.plots.polar import centre_of, off_centre
from mjsim.plots.style import step_below
from mjsim.progress import Progress, counted, silent
from mjsim.simulation.drive import STEP
from mjsim.simulation.multibody import Simulation, simulate
from mjsim.threads import one_blas_thread
from mjsim.units import UM

#: Largest magnified error over the bar's length, when the factor is chosen.
FILL = 0.2
#: A value is shown as the present one while a sample lies this near, s.
NEAR = 0.05


@dataclass(frozen=True)
class Signal:
    """Something measured along a test: ``time`` (n,) s on the program's clock, ``phi`` (n,) rad, ``value`` (n,) m;
    NaN where invalid.
    """

    name: str
    time: np.ndarray
    phi: np.ndarray
    value: np.ndarray

    def last(self, time: float) -> int:
        """Index of the last sample taken by ``time``; -1 before the first."""
        return int(np.searchsorted(self.time, time + 1e-9, side="right")) - 1

    def at(self, time: float) -> float:
        """The last valid value taken by ``time``, m; NaN where there was none within the last 50 ms."""
        i = self.last(time)
        while i >= 0 and time - self.time[i] <= NEAR:
            if np.isfinite(self.value[i]):
                return float(self.value[i])
            i -= 1
        return math.nan


@dataclass(frozen=True)
class Story:
    """One test as it is shown.

    Attributes:
        simulation: the axes' motion. traces: measured (where there is one) and simulated, both about the least-squares
            centre of the first of them. error: what is magnified. measured: whether the error is measured less
            simulated.
        magnification: drawn length over real length of the error.
    """

    campaign: str
    machine: Machine
    test: BallBarTest
    simulation: Simulation
    traces: tuple[Signal, ...]
    error: Signal
    measured: bool
    magnification: float
    program: Program = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "program", Program(self.test))

    @property
    def duration(self) -> float:
        """From rest to rest, s."""
        return self.program.duration

    @property
    def magnified(self) -> str:
        """What is magnified and by how much, in words."""
        what = "measured − simulated" if self.measured else "simulated deviation"
        return f"error × {_plain(self.magnification)} ({what})"

    def stretch(self, time: float) -> float:
        """The magnified error at ``time``, m; 0 where there is no reading."""
        value = self.error.at(time)
        return self.magnification * value if math.isfinite(value) else 0.0

    def position(self, time: float) -> np.ndarray:
        """Axis positions (5,) m and rad at ``time``."""
        i = min(round(time / STEP), len(self.simulation.time) - 1)
        return self.simulation.position[i]


def _plain(factor: float) -> str:
    return f"{factor:.0f}" if factor >= 100 else f"{factor:.4g}"


@one_blas_thread
def tell(
    campaign: Campaign,
    machine: Machine,
    test: BallBarTest,
    magnify: float | None = None,
    threads: int = 2,
    progress: Progress = silent,
) -> Story:
    """Simulate a test, and compare it as :func:`mjsim.commands.compare` does where it was measured.

    Args:
        magnify: factor of the error; chosen (1, 2, 5, 10 …) so that the largest error is a fifth of the bar, when
            ``None``.

    Raises:
        InputError: ``magnify`` draws the error longer than the bar.
    """
    measured = test.name in campaign.traces
    if measured:
        simulation, traces, error = _compared(campaign, machine, test, threads, progress)
    else:
        progress("simulating", 0, 1)
        (simulation,) = simulate(machine, [test], threads)
        traces, error = _simulated(simulation)
    largest = float(np.nanmax(np.abs(error.value)))
    if magnify is None:
        magnify = max(1.0, step_below(FILL * test.shown_over / max(largest, 1e-12)))
    elif not (math.isfinite(magnify) and magnify >= 1.0 and magnify * largest <= 0.9 * test.shown_over):
        shown = "the bar" if test.length else "the picture"
        raise InputError(
            f"magnification {magnify:g}: the error is up to {largest / UM:.2f} µm and {shown} "
            f"{test.shown_over * 1e3:g} mm; allowed: 1 to {0.9 * test.shown_over / max(largest, 1e-12):.0f}"
        )
    return Story(campaign.name, machine, test, simulation, traces, error, measured, magnify)


def _compared(campaign: Campaign, machine: Machine, test: BallBarTest, threads: int, progress: Progress):
    """All measured tests count, so that the nuisances, and the residual, are those of ``mjsim compare``."""
    problem = checked_problem(campaign, machine, threads)
    progress("simulating", 0, len(problem.tests))
    whole, begin = phased_at(problem, machine)
    done = counted(progress, "simulating", len(problem.tests))
    simulations = simulate(whole, problem.tests, threads, done)
    k = [t.name for t in problem.tests].index(test.name)
    t = overlay(problem, machine, simulations, begin).tests[k]
    time = problem.samples[k].time - t.trigger
    common = off_centre(centre_of(test, t.phi[t.valid], t.measured[t.valid]), t.phi)
    hidden = np.where(t.valid, 0.0, np.nan)
    traces = tuple(Signal(n, time, t.phi, getattr(t, n) - common + hidden) for n in ("measured", "simulated"))
    return simulations[k], traces, Signal("error", time, t.phi, t.residual + hidden)


def _simulated(s: Simulation):
    begin, end = Program(s.test).measured_span
    keep = np.flatnonzero((s.time >= begin) & (s.time <= end))[::5]
    phi, deviation = s.phi[keep], s.deviation[keep]
    trace = Signal("simulated", s.time[keep], phi, deviation - off_centre(centre_of(s.test, phi, deviation), phi))
    return (trace,), trace
