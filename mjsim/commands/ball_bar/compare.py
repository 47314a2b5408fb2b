"""Ball-bar tests against a machine, after the nuisances of set-up and instrument have been fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.comparison import ComparedChannel, ComparedPart, ComparedTest
from mjsim.errors import InputError
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.nuisance_fit import fit_nuisance_retimed
from mjsim.inference.problem import Problem
from mjsim.inference.samples import GRID_STEPS
from mjsim.inference.vibration import at_own_noise, phased_at
from mjsim.instruments.ball_bar.acceptance import Measured, judge
from mjsim.instruments.ball_bar.iso230 import (
    BidirectionalFigures,
    CircularFigures,
    bidirectional_figures,
    circular_figures,
)
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program, event_at, range_warning, reversals, speed_warnings
from mjsim.instruments.base import Channel
from mjsim.machine.model import Machine, build
from mjsim.progress import Progress, counted, silent
from mjsim.simulation.drive import STEP
from mjsim.simulation.multibody import Reading, Simulation
from mjsim.simulation.readings import readings_of
from mjsim.threads import one_blas_thread
from mjsim.units import DEG, UM


@dataclass(frozen=True)
class ComparedBarTest(ComparedTest):
    """One test. Arrays over its samples: ``phi`` rad (signed), ``measured``, ``simulated``, ``residual`` in m,
    ``valid`` bool, ``time`` s as recorded.

    ``simulated`` has the nuisances applied. ``rms``, ``maximum`` (m) are of the residual; ``worst_phi`` (rad) is where
    the model fails most and ``worst_event`` the axis event there. ``iso`` holds ISO 230-4 figures (µm) of measured and
    simulated, ``ranges`` those of a coordinate of an R-test about the sphere's place (ISO 10791-6).
    """

    test: BallBarTest
    phi: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray
    residual: np.ndarray
    valid: np.ndarray
    rms: float
    maximum: float
    worst_phi: float
    worst_event: str
    reversals: dict[str, np.ndarray]
    trigger: float
    iso: dict
    outliers: int = 0
    time: np.ndarray = field(default_factory=lambda: np.empty(0))
    saturated: int = 0
    noise: float = 0.0
    ranges: dict = field(default_factory=dict)

    @property
    def channels(self) -> tuple[ComparedChannel, ...]:
        """The one deviation."""
        return (ComparedChannel(Channel(), self.time, self.measured, self.simulated, self.valid, self.noise),)

    def to_json(self) -> dict:
        """Plain numbers, µm, degrees and ms."""
        return {
            "name": self.test.name,
            "setup": self.test.setup,
            "kind": self.test.kind,
            "rms_um": _r(self.rms / UM),
            "max_um": _r(self.maximum / UM),
            "samples": len(self.valid),
            "samples_left_out": int((~self.valid).sum()),
            "samples_saturated": self.saturated,
            "outliers": self.outliers,
            "worst_phi_deg": _r(self.worst_phi / DEG, 1),
            "worst_plot_angle_deg": _r(self.worst_phi / DEG % 360, 1),
            "worst_event": self.worst_event,
            "trigger_ms": _r(self.trigger * 1e3, 2),
            "iso230_4": self.iso,
        } | ({"iso10791_6": self.ranges} if self.ranges else {})


@dataclass(frozen=True)
class BarComparison(ComparedPart):
    """The ball-bar tests of a campaign against a machine.

    Attributes:
        noise: RMS of one sample's noise, m, and ``noise_source``, where it comes from. rms, maximum: of all residuals,
            m.
        setups: table-ball and spindle-ball offsets per set-up (6,) m; of an R-test the sphere's and the nest's.
        length: bar-length offset, m.
        nest: what else was fitted of the nest of an R-test, by name with the unit.
        bidirectional: ISO 230-4 figures of pairs of tests in both directions, µm.
        readings: simulated reading of each test on the engine's time grid, (n,) m, without nuisances.
    """

    campaign: Campaign
    machine: Machine
    tests: tuple[ComparedBarTest, ...]
    noise: float
    noise_source: str
    rms: float
    maximum: float
    setups: dict[str, np.ndarray]
    length: float
    bidirectional: list[dict] = field(default_factory=list)
    readings: tuple[np.ndarray, ...] = ()
    nest: dict[str, float] = field(default_factory=dict)

    def to_json(self) -> dict:
        """Plain numbers in µm, degrees and ms, as ``mjsim compare --json`` prints them."""
        return {
            "campaign": self.campaign.name,
            "machine": self.machine.name,
            "effects": [e.id for e in self.machine.effects],
            "noise_um": _r(self.noise / UM),
            "noise_source": self.noise_source,
            "rms_um": _r(self.rms / UM),
            "max_um": _r(self.maximum / UM),
            "warnings": self.warnings,
            "not_measured": [t.name for t in self.campaign.planned],
            "tests": [t.to_json() for t in self.tests],
            "setups": {
                k: {"table_ball_um": [_r(x / UM, 2) for x in v[:3]], "spindle_ball_um": [_r(x / UM, 2) for x in v[3:]]}
                for k, v in self.setups.items()
            },
            **({"nest": {k: _r(v) for k, v in self.nest.items()}} if self.nest else {}),
            "length_um": _r(self.length / UM, 2),
            "iso230_4_bidirectional": self.bidirectional,
            "acceptance": self.acceptance,
        }

    @property
    def acceptance(self) -> list[dict]:
        """One row for each limit of the campaign and what it was held against, µm; empty where it states none."""
        if self.campaign.acceptance is None:
            return []
        traces = [Measured(t.test.name, t.phi[t.valid], t.measured[t.valid]) for t in self.tests]
        return [row.to_json() for row in judge(self.campaign.acceptance, traces, self.noise)]

    @property
    def warnings(self) -> list[str]:
        """Tests that ask more of the axes than an ordinary machine can, and simulated readings beyond the sensor's
        range.
        """
        data, found = self.campaign.instruments, []
        for t in self.tests:
            found += [*speed_warnings(t.test), range_warning(t.test, t.simulated, data[t.test.instrument].range)]
        return [w for w in dict.fromkeys(found) if w]


def _r(x: float, digits: int = 4) -> float:
    return round(float(x), digits)


@one_blas_thread
def compare_bars(
    campaign: Campaign, machine: Machine, threads: int = 2, progress: Progress = silent, problem: Problem | None = None
) -> BarComparison:
    """Simulate every measured test in the multibody model and lay it over the measurement.

    The nuisances (ball offsets per set-up, bar length, trigger per test) are fitted by least squares with their priors;
    the machine is taken as it is.

    Raises:
        InputError: no test of the campaign has a trace, or the traces show a mistake
            (:mod:`mjsim.inference.mistakes`).
    """
    campaign = campaign.in_motion
    campaign.need_traces("comparing needs at least one measured test")
    plant = build(machine)
    problem = problem or checked_problem(campaign, machine, threads, keep_motions=False)
    with_phases, begin = phased_at(problem, machine)
    if begin is not None:
        plant, problem = build(with_phases), at_own_noise(problem, with_phases, begin)
    done = counted(progress, "simulating", len(problem.tests))
    return overlay(problem, with_phases, readings_of(plant, problem.tests, threads, done), begin)


def overlay(
    problem: Problem,
    machine: Machine,
    simulations: Sequence[Simulation | Reading],
    begin: np.ndarray | None = None,
) -> BarComparison:
    """Comparison of given simulations (one per measured test, in order), with the nuisances fitted from ``begin`` on
    (:func:`~mjsim.inference.vibration.phased_at`).
    """
    readings = [s.deviation[::GRID_STEPS] for s in simulations]
    nuisance = fit_nuisance_retimed(problem, readings, begin)
    tests, squares, count = [], 0.0, 0
    for k, s in enumerate(problem.samples):
        shift = problem.shift(k, nuisance)
        # the reading on its own fine grid: a vibration does not survive the coarse one
        set_up = s.sample_all(problem.offsets(k, nuisance), shift)
        modelled = s.sample_all(simulations[k].deviation, shift, STEP) + set_up
        residual = s.value - modelled
        good = s.valid
        phi = Program(s.test).phi(s.time - problem.shift(k, nuisance))
        worst = int(np.argmax(np.where(good, np.abs(_smooth(residual)), -1.0)))
        events = reversals(Program(s.test))
        tests.append(
            ComparedBarTest(
                s.test,
                phi,
                s.value,
                modelled,
                residual,
                good,
                float(np.sqrt(np.mean(residual[good] ** 2))),
                float(np.abs(residual[good]).max()),
                float(phi[worst]),
                event_at(float(phi[worst]), events),
                events,
                problem.shift(k, nuisance),
                _iso(s.test, phi[good], s.value[good], modelled[good]),
                problem.outliers[s.test.name],
                s.time,
                problem.campaign.traces[s.test.name].saturated,
                problem.noise_of(k).rms,
                _ranges(s.value - set_up, modelled - set_up, good) if s.test.component else {},
            )
        )
        squares += float(residual[good] @ residual[good])
        count += int(good.sum())
    setups = {
        name: np.concatenate(
            [problem.nuisances.table_ball(nuisance, name), problem.nuisances.spindle_ball(nuisance, name)]
        )
        for name in dict.fromkeys(t.setup for t in problem.tests)
    }
    return BarComparison(
        problem.campaign,
        machine,
        tuple(tests),
        problem.noise.rms,
        problem.noise.source,
        float(np.sqrt(squares / count)),
        max(t.maximum for t in tests),
        setups,
        problem.nuisances.length(nuisance),
        _pairs(tests),
        tuple(s.deviation for s in simulations),
        problem.nuisances.nest(nuisance),
    )


def _smooth(x: np.ndarray, n: int = 9) -> np.ndarray:
    return np.convolve(x, np.ones(n) / n, mode="same")


def _iso(test: BallBarTest, phi: np.ndarray, measured: np.ndarray, simulated: np.ndarray) -> dict:
    if not kind_of(test).goes_round:
        return {}
    try:
        return {
            name: _rounded(circular_figures(phi, d)) for name, d in (("measured", measured), ("simulated", simulated))
        }
    except InputError:  # a gap of the trace leaves part of the circle open: the figures are not defined
        return {}


def _ranges(measured: np.ndarray, simulated: np.ndarray, good: np.ndarray) -> dict:
    """Range of a coordinate of an R-test without what the set-up makes of it, of measured and of simulated."""
    both = {"measured": measured, "simulated": simulated}
    return {who: {"range_um": _r(float(np.ptp(x[good])) / UM)} for who, x in both.items()}


def _rounded(figures: CircularFigures | BidirectionalFigures) -> dict:
    return {k: [_r(x) for x in v] if isinstance(v, tuple) else _r(v) for k, v in asdict(figures).items()}


def _pairs(tests: list[ComparedBarTest]) -> list[dict]:
    """ISO 230-4 bidirectional figures where one path was measured in both directions."""
    out = []
    for a in tests:
        for b in tests:
            if _both_ways(a.test, b.test):
                row: dict = {"ccw": a.test.name, "cw": b.test.name}
                try:
                    for name in ("measured", "simulated"):
                        row[name] = _rounded(
                            bidirectional_figures(
                                a.phi[a.valid], getattr(a, name)[a.valid], b.phi[b.valid], getattr(b, name)[b.valid]
                            )
                        )
                except InputError:
                    continue
                out.append(row)
    return out


def _both_ways(a: BallBarTest, b: BallBarTest) -> bool:
    """Whether two tests run one closed path, the first counter-clockwise and the second clockwise."""
    if not kind_of(a).goes_round or (a.direction, b.direction) != ("CCW", "CW"):
        return False

    def path(test: BallBarTest) -> BallBarTest:
        return replace(test, name="", direction="", trace=None, started=0.0, revolutions=1, commanded=None)

    return path(a) == path(b) and (a.commanded is None) == (b.commanded is None)
