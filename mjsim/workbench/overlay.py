"""Simulated readings laid over the measured ones, test by test, with the nuisances fitted."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.nuisance_fit import fit_nuisance
from mjsim.inference.problem import KeptChanges, Problem
from mjsim.inference.samples import GRID, GRID_STEPS
from mjsim.inference.vibration import phased
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import reversals
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.plots.polar import centre_of, off_centre
from mjsim.simulation.axes import AxesMotion, motions_of
from mjsim.simulation.drive import STEP
from mjsim.simulation.multibody import reading_of, simulate_each
from mjsim.simulation.stability import check_stable
from mjsim.threads import Workers, one_blas_thread

# -- A campaign that is open in the workbench --------------------------------------------------------------------------


@dataclass(frozen=True)
class OpenCampaign:
    """A campaign with its machine, ready for changes of the model.

    Attributes:
        campaign: As it was read.
        machine: The model in the machine file.
        problem: The measured tests without outliers; ``None`` where nothing was measured.
        background: The same tests with motions of their own, for work that takes seconds: it never holds up a change.
        motions: The axes' motion in each test, by the test's name.
        threads: Tests that are worked on side by side.
    """

    campaign: Campaign
    machine: Machine
    problem: Problem | None
    background: Problem | None
    motions: dict[str, AxesMotion]
    threads: int

    @classmethod
    @one_blas_thread
    def of(cls, campaign: Campaign, machine: Machine, threads: int = 2) -> OpenCampaign:
        """Prepare a campaign.

        Args:
            campaign: As it was read; it needs no traces.
            machine: The model.
            threads: Tests that are worked on side by side.

        Raises:
            InputError: The traces show a mistake.
        """
        campaign = campaign.in_motion
        problem = checked_problem(campaign, machine, threads) if campaign.measured else None
        motions = {t.name: m for t, m in zip(campaign.tests, motions_of(campaign.tests), strict=True)}
        background = None
        if problem is not None:
            motions |= {t.name: m for t, m in zip(problem.tests, problem.motions, strict=True)}
            own = motions_of(problem.tests, light=True)
            background = replace(problem, motions=own, workers=Workers(1), changes=KeptChanges())
        return cls(campaign, machine, problem, background, motions, threads)

    @property
    def tests(self) -> tuple[BallBarTest, ...]:
        """All tests, measured or not, in the campaign's order."""
        return self.campaign.tests

    @property
    def measured(self) -> dict[str, int]:
        """Place in the problem of every measured test, by name."""
        return {t.name: k for k, t in enumerate(self.problem.tests)} if self.problem else {}

    def test(self, name: str) -> BallBarTest:
        """The test of this name.

        Raises:
            KeyError: there is none.
        """
        return next(t for t in self.tests if t.name == name)


# -- simulated readings of the tests, by the drives alone at once and by the multibody model soon after, and kept ------

#: Names of the two ways to simulate, as the plots print them.
DRIVES, MULTIBODY = "drives alone", "multibody"
#: Multibody readings that are kept: so many models of a campaign of 13 tests, 0.3 MB a test.
_KEPT_MODELS = 12


@dataclass(frozen=True)
class Simulated:
    """A simulated reading.

    Attributes:
        deviation: (n,) m, from the program's start, without nuisances.
        spacing: s between its values.
        engine: What simulated it.
    """

    deviation: np.ndarray
    spacing: float
    engine: str

    @property
    def coarse(self) -> np.ndarray:
        """The reading on the grid of the fits, m."""
        return self.deviation[:: round(GRID / self.spacing)]


def key_of(machine: Machine) -> tuple:
    """What the readings of a machine depend on: its drives and the values of its effects, in their order."""
    effects = tuple((e.key, repr(e.values)) for e in machine.effects)
    return machine.configuration, tuple(map(repr, machine.drives.values())), effects


class Readings:
    """Readings of one open campaign, shared by all pages.

    Args:
        opened: The campaign.
    """

    def __init__(self, opened: OpenCampaign) -> None:
        self.opened = opened
        self._motions, self._bodies = threading.Lock(), threading.Lock()
        self._kept: OrderedDict[tuple, Simulated] = OrderedDict()
        self._change = threading.Lock()
        self._most = max(1, len(opened.tests)) * _KEPT_MODELS

    def plant(self, machine: Machine) -> Plant:
        """The plant of a machine, its vibrations with the phases that they have in the measured tests.

        Raises:
            InputError: An effect acts on what the machine does not have.
            SimulationError: A drive is unstable.
        """
        problem = self.opened.problem
        with self._motions:
            plant = build(phased(problem, machine) if problem is not None else machine)
        check_stable(plant)
        return plant

    def drives_alone(self, machine: Machine, names: Iterable[str] | None = None) -> dict[str, Simulated]:
        """Readings of some tests (all) by the drives alone, by the test's name.

        Raises:
            InputError: An effect acts on what the machine does not have.
            SimulationError: A drive is unstable.
        """
        plant = self.plant(machine)
        # a vibration does not survive the coarse grid
        every = 1 if any(e.kind == "vibration" and not e.is_neutral for e in machine.effects) else GRID_STEPS
        with self._motions:
            return {
                name: Simulated(self.opened.motions[name].reading(plant, every), STEP * every, DRIVES)
                for name in (names if names is not None else [t.name for t in self.opened.tests])
            }

    def multibody(self, machine: Machine, names: Sequence[str]) -> dict[str, Simulated]:
        """Readings of some tests in the multibody model, by the test's name; kept ones are not simulated again.

        Raises:
            InputError: There is no multibody model of such a machine.
            SimulationError: The simulation cannot be trusted.
        """
        out = self.kept(machine, names)
        missing = [self.opened.test(n) for n in names if n not in out]
        if missing:
            plant, key = self.plant(machine), key_of(machine)
            with self._bodies:
                done = simulate_each(plant, missing, reading_of, self.opened.threads)
            for s in done:
                out[s.test.name] = Simulated(s.deviation, STEP, MULTIBODY)
                self._keep((key, s.test.name), out[s.test.name])
        return out

    def kept(self, machine: Machine, names: Iterable[str] | None = None) -> dict[str, Simulated]:
        """Multibody readings that are there already, by the test's name."""
        key, out = key_of(machine), {}
        with self._change:
            for name in names if names is not None else [t.name for t in self.opened.tests]:
                if (key, name) in self._kept:
                    self._kept.move_to_end((key, name))
                    out[name] = self._kept[key, name]
        return out

    def _keep(self, key: tuple, reading: Simulated) -> None:
        with self._change:
            self._kept[key] = reading
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)


@dataclass(frozen=True)
class Trace:
    """One test: measured and simulated.

    Attributes:
        test: The test.
        engine: What simulated it.
        time: (n,) s on the program's clock.
        phi: (n,) rad, signed.
        simulated: (n,) m, with the nuisances applied.
        measured: (n,) m; ``None`` where the test was not measured.
        valid: (n,) bool, samples that count.
        rms: Of the residual, m; 0 without a measurement.
        share: Of this test in the squared residuals of all tests.
    """

    test: BallBarTest
    engine: str
    time: np.ndarray
    phi: np.ndarray
    simulated: np.ndarray
    measured: np.ndarray | None
    valid: np.ndarray
    rms: float = 0.0
    share: float = 0.0

    @property
    def residual(self) -> np.ndarray | None:
        """Measured less simulated, (n,) m; NaN where a sample does not count."""
        if self.measured is None:
            return None
        return np.where(self.valid, self.measured - self.simulated, np.nan)

    @cached_property
    def centred(self) -> tuple[np.ndarray | None, np.ndarray]:
        """Measured and simulated, (n,) m, without what a ball off its place adds: about the least-squares centre of
        the first that there is, as in the plots of ``mjsim compare``.
        """
        base = self.simulated if self.measured is None else self.measured
        eccentric = off_centre(centre_of(self.test, self.phi[self.valid], base[self.valid]), self.phi)
        measured = None if self.measured is None else np.where(self.valid, self.measured - eccentric, np.nan)
        return measured, self.simulated - eccentric


@dataclass(frozen=True)
class Overlay:
    """A model laid over all tests.

    Attributes:
        machine: The model.
        traces: By the test's name, in the campaign's order.
        rms: Of all residuals, m; ``None`` where nothing was measured.
        worst: Largest residual, m; ``None`` likewise.
        engine: What simulated it; the drives alone where some tests have nothing else yet.
        nuisance: Fitted nuisances, in prior standard deviations.
    """

    machine: Machine
    traces: Mapping[str, Trace]
    rms: float | None
    worst: float | None
    engine: str
    nuisance: np.ndarray | None = None


def overlay(opened: OpenCampaign, machine: Machine, readings: Mapping[str, Simulated]) -> Overlay:
    """Lay readings over the traces; the nuisances are fitted as in ``mjsim compare``.

    Args:
        opened: The campaign.
        machine: The model that was simulated.
        readings: Of every test, by its name.
    """
    engine = MULTIBODY if all(r.engine == MULTIBODY for r in readings.values()) else DRIVES
    problem, traces = opened.problem, {}
    if problem is None:
        traces = {t.name: _simulated(opened, t, readings[t.name]) for t in opened.tests}
        return Overlay(machine, traces, None, None, engine)
    nuisance = fit_nuisance(problem, [readings[t.name].coarse for t in problem.tests])

    def one(k: int) -> tuple[Trace, float, int, float]:
        return _measured(opened, k, readings[problem.tests[k].name], nuisance)

    rows = problem.map(one)
    squares, count = sum(r[1] for r in rows), sum(r[2] for r in rows)
    found = {r[0].test.name: replace(r[0], share=r[1] / squares if squares else 0.0) for r in rows}
    for t in opened.tests:
        traces[t.name] = found[t.name] if t.name in found else _simulated(opened, t, readings[t.name])
    rms = float(np.sqrt(squares / count)) if count else None
    return Overlay(machine, traces, rms, max(r[3] for r in rows), engine, nuisance)


def with_one(opened: OpenCampaign, machine: Machine, name: str, reading: Simulated, now: Overlay) -> Overlay:
    """One test of a model beside the other tests of an earlier overlay, with the nuisances that were fitted there.

    Args:
        opened: The campaign.
        machine: The model that was simulated.
        name: Of the test.
        reading: Of the test.
        now: The earlier overlay; its errors stand until all tests are there.
    """
    if now.nuisance is None or name not in opened.measured:
        trace = _simulated(opened, opened.test(name), reading)
    else:
        trace = replace(
            _measured(opened, opened.measured[name], reading, now.nuisance)[0], share=now.traces[name].share
        )
    return replace(now, machine=machine, traces={**now.traces, name: trace}, engine=DRIVES)


def _measured(opened: OpenCampaign, k: int, reading: Simulated, nuisance: np.ndarray):
    """Trace, sum of squares, number of samples and largest residual of one measured test."""
    problem = opened.problem
    assert problem is not None
    s, shift = problem.samples[k], problem.shift(k, nuisance)
    modelled = s.sample_all(reading.deviation, shift, reading.spacing)
    modelled += s.sample_all(problem.offsets(k, nuisance), shift, GRID)
    rest = (s.value - modelled)[s.valid]
    squares, time = float(rest @ rest), s.time - shift
    rms, worst = float(np.sqrt(squares / max(1, len(rest)))), float(np.abs(rest).max(initial=0.0))
    phi = opened.motions[s.test.name].program.phi(time)
    return Trace(s.test, reading.engine, time, phi, modelled, s.value, s.valid, rms), squares, len(rest), worst


def _simulated(opened: OpenCampaign, test: BallBarTest, reading: Simulated) -> Trace:
    """Trace of a test without a measurement, in the part that would be measured."""
    program = opened.motions[test.name].program
    deviation = reading.coarse
    time = np.arange(len(deviation)) * GRID
    begin, end = program.measured_span
    keep = (time >= begin) & (time <= end)
    time, deviation = time[keep], deviation[keep]
    valid = np.ones(len(time), bool)
    return Trace(test, reading.engine, time, program.phi(time), deviation, None, valid)


def reversals_of(opened: OpenCampaign, name: str) -> dict[str, np.ndarray]:
    """φ (rad) at which each axis reverses in a test, by the axis' letter."""
    return reversals(opened.motions[name].program)
