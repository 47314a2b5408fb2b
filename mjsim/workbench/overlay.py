"""Simulated readings laid over the measured ones, test by test, with the nuisances fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mjsim.inference.nuisance_fit import fit_nuisance
from mjsim.inference.samples import GRID
from mjsim.instruments.ball_bar.events import reversals
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.model import Machine
from mjsim.plots.polar import centre_of, off_centre
from mjsim.workbench.opened import OpenCampaign
from mjsim.workbench.readings import DRIVES, MULTIBODY, Simulated


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
