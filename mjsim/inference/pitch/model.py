"""The campaign's readings as a machine, its set-up and terms of the rotary axes; Gauss-Newton over all of them.

Nuisances (ball offsets, length, triggers) and the data sheet have their priors, as in :mod:`mjsim.inference`; terms
are free.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit

from mjsim.inference.data_sheet import DATA_SHEET, calibrated, data_sheet, sheet_block
from mjsim.inference.least_squares import LeastSquares
from mjsim.inference.nuisance import TRIGGER, Nuisances
from mjsim.inference.parameters import Block, Parameters
from mjsim.inference.pitch.settings import PITCH, PitchSettings
from mjsim.inference.pitch.terms import Term
from mjsim.inference.problem import Problem
from mjsim.inference.samples import GRID, GRID_STEPS
from mjsim.machine.model import Machine, build
from mjsim.simulation.transmission import BLEND

#: Prior width of a term's numbers, in their units: wide, it only keeps the equations regular.
_WIDE = 1e4


@njit(cache=True, nogil=True)
def _shares(x: np.ndarray, blend: float, direction: float) -> np.ndarray:
    """How much of a term acts that belongs to one direction of motion, (n,) 0 to 1: it comes in over ``blend`` of
    travel.
    """
    out = np.zeros(len(x))
    last = 0.0
    for i in range(1, len(x)):
        step = (x[i] - x[i - 1]) * direction
        last = min(1.0, max(0.0, last + (abs(step) if step > 0.0 else -abs(step)) / blend)) if step != 0.0 else last
        out[i] = last
    return out


@dataclass(frozen=True)
class State:
    """Where a fit stands.

    Attributes:
        nuisances: Blocks of set-up and instrument.
        nuisance: Their values, (nuisances.size,) in prior standard deviations.
        sheet_deviation: Deviations of the data sheet, (sheet,) standard deviations.
        sheet: Their block.
        terms: Waves and faults.
        objective: Squared whitened residuals and prior penalties.
        equations: Normal equations of the last step, for :attr:`parameters` as they were then.
    """

    nuisances: Nuisances
    nuisance: np.ndarray
    sheet_deviation: np.ndarray
    sheet: Block
    terms: tuple[Term, ...] = ()
    objective: float = np.inf
    equations: LeastSquares | None = None

    @cached_property
    def parameters(self) -> Parameters:
        """Everything that is fitted: nuisances, data sheet, and a block per term, whose values are moves from its
        present ones.
        """
        terms = [
            Block.normal(_term_block(i), [str(j) for j in range(t.size)], deviation=_WIDE, informative=False)
            for i, t in enumerate(self.terms)
        ]
        return self.nuisances.with_blocks(self.sheet, *terms)

    @cached_property
    def vector(self) -> np.ndarray:
        """Present values of :attr:`parameters`, (p,)."""
        return self.parameters.join(self.nuisances.split(self.nuisance) | {DATA_SHEET: self.sheet_deviation})

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of :attr:`parameters`, (p, p)."""
        assert self.equations is not None
        return self.equations.covariance

    @property
    def blocks(self) -> list[slice]:
        """Place of every term's numbers in the parameter vector."""
        return [self.parameters[_term_block(i)] for i in range(len(self.terms))]

    def moved(self, step: np.ndarray) -> State:
        """The state with its vector moved by ``step`` (p,), not evaluated yet."""
        p, values = self.parameters, self.parameters.split(self.vector + step)
        terms = tuple(t.moved(values[_term_block(i)]) for i, t in enumerate(self.terms))
        nuisance = p.part(self.vector + step, self.nuisances)
        return replace(self, nuisance=nuisance, sheet_deviation=values[DATA_SHEET], terms=terms)


def _term_block(i: int) -> str:
    return f"term {i}"


class PitchModel:
    """Readings of a problem's tests for a machine without pitch errors, plus terms.

    Attributes:
        problem: the campaign. machine: its machine. use: the tests (indices) that count. weight: (tests,) of each
            test's
        residuals, 1 or, where it cannot be explained, 0. kept: dictionaries' columns. frozen: test
        -> trigger (s) at which the machine's own part of the reading is held, where that part is no witness of the
        trigger.
    """

    def __init__(self, problem: Problem, machine: Machine, settings: PitchSettings = PITCH) -> None:
        self.problem, self.machine, self.settings = problem, machine, settings
        self.use = list(range(len(problem.tests)))
        self.weight = np.ones(len(problem.tests))
        self.simulated_deviation = np.zeros(len(data_sheet(machine.chain)))
        self.kept: dict = {}
        self.frozen: dict[int, float] = {}
        self._sheet = problem.sheet_grids(machine)
        self._linearise()

    def _linearise(self) -> None:
        plant = build(calibrated(self.machine, self.simulated_deviation))
        p = self.problem
        self.readings = p.readings(plant)
        self.position = [
            {a: np.ascontiguousarray(m.motor(a, plant.axes[a], GRID_STEPS)) for a in p.chain.rotary} for m in p.motions
        ]
        self.share = [
            {
                (a, w): _shares(x, BLEND, sign * p.chain.axis(a).ccw)
                for a, x in q.items()
                for w, sign in (("CCW", 1.0), ("CW", -1.0))
            }
            for q in self.position
        ]

    def recentred(self, state: State) -> None:
        """Simulate the drives at the fitted data sheet, which counted linearly until now."""
        self.simulated_deviation = state.sheet_deviation.copy()
        self._linearise()

    def start(self, nuisance: np.ndarray) -> State:
        """A state without terms."""
        sheet = sheet_block(self.machine, np.zeros(len(data_sheet(self.machine.chain)), bool))
        nuisances = Nuisances.of_tests(self.problem.tests, self.settings.trigger_limit)
        return State(nuisances, nuisance.copy(), sheet.mean, sheet)

    def _acts(self, k: int, t: Term) -> bool:
        return (t.test is None or t.test == self.problem.tests[k].name) and (
            not t.direction or bool(self.share[k][t.axis, t.direction].any())
        )

    def _turns(self, k: int, t: Term) -> bool:
        return not t.direction or bool(self.share[k][t.axis, t.direction].any())

    def factor(self, k: int, t: Term) -> np.ndarray:
        """Reading per rad of the term's axis while it turns in the term's direction, (n,) m on the GRID."""
        sens = self.problem.sensitivity[k].axes[:, self.problem.chain.index(t.axis)]
        return sens * self.share[k][t.axis, t.direction] if t.direction else sens

    def terms_total(self, k: int, state: State) -> np.ndarray:
        """What the terms add to the reading of one test, on the GRID, m."""
        out = np.zeros(len(self.readings[k]))
        for t in state.terms:
            if self._acts(k, t):
                out += self.factor(k, t) * t.value(self.position[k][t.axis])
        return out

    def total(self, k: int, state: State) -> np.ndarray:
        """Modelled reading of one test on the GRID, m, without what the data sheet has moved since it was last
        simulated.
        """
        return self.readings[k] + self.problem.offsets(k, state.nuisance) + self.terms_total(k, state)

    def residual(self, k: int, state: State) -> np.ndarray:
        """Measured less modelled block means of one test, m."""
        s, shift = self.problem.samples[k], self.problem.shift(k, state.nuisance)
        own = self.readings[k] + self.problem.offsets(k, state.nuisance)
        moved = state.sheet_deviation - self.simulated_deviation
        if moved.any():
            own = own + moved @ self._sheet[k]
        terms = self.terms_total(k, state)
        if k in self.frozen:
            return s.mean - s.sample(own, self.frozen[k]) - s.sample(terms, shift)
        return s.mean - s.sample(own + terms, shift)

    def columns(self, k: int, state: State) -> np.ndarray:
        """Derivatives of the modelled block means of one test, (m, parameters), m per unit."""
        p = self.problem
        s, shift = p.samples[k], p.shift(k, state.nuisance)
        parts = [self._nuisance_columns(k, state)]
        parts += [np.column_stack([s.sample(g, shift) if g.any() else np.zeros(len(s.centre)) for g in self._sheet[k]])]
        for t in state.terms:
            if self._acts(k, t):
                f = self.factor(k, t)
                parts.append(np.column_stack([s.sample(f * c, shift) for c in t.columns(self.position[k][t.axis])]))
            else:
                parts.append(np.zeros((len(s.centre), t.size)))
        return np.hstack(parts)

    def _nuisance_columns(self, k: int, state: State) -> np.ndarray:
        p = self.problem
        s, shift = p.samples[k], p.shift(k, state.nuisance)
        moving = self.terms_total(k, state)
        if k not in self.frozen:
            moving = moving + self.readings[k] + p.offsets(k, state.nuisance)
        own = [*p.set_up_means(k, shift), -s.sample(np.gradient(moving, GRID), shift) * TRIGGER]
        out = np.zeros((len(s.centre), state.nuisances.size))
        out[:, state.nuisances.of_test(p.tests[k])] = np.column_stack(own)
        return out

    def whitened(self, k: int, columns: np.ndarray) -> np.ndarray:
        """Block columns of one test in standard deviations of the noise, weighted."""
        out = self.problem.whiten_test(k, columns)
        return out if self.weight[k] == 1.0 else np.sqrt(self.weight[k]) * out

    def cost(self, state: State) -> float:
        """Squared whitened residuals and prior penalties."""
        rest = self.problem.map(lambda k: self.whitened(k, self.residual(k, state)) if k in self.use else np.zeros(0))
        return float(sum(r @ r for r in rest) + state.parameters.penalty(state.vector))

    def normal(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and gradient of the data alone."""

        def one(k: int):
            if k not in self.use:
                return None
            both = self.whitened(k, np.column_stack([self.columns(k, state), self.residual(k, state)]))
            return both.T @ both

        total = np.sum([m for m in self.problem.map(one) if m is not None], axis=0)
        return total[:-1, :-1], total[:-1, -1]

    def fit(self, state: State, iterations: int = 5) -> State:
        """Least squares of everything from ``state`` on."""
        state = replace(state, objective=self.cost(state))
        for _ in range(iterations):
            matrix, gradient = self.normal(state)
            equations = LeastSquares(state.parameters, matrix)
            step = equations.step(gradient, state.vector)
            state = replace(state, equations=equations)
            trial = state
            for scale in (1.0, 0.4, 0.1):
                trial = state.moved(scale * step)
                trial = replace(trial, objective=self.cost(trial))
                if trial.objective < state.objective:
                    break
            else:
                break
            gain = state.objective - trial.objective
            state = trial
            if gain < 0.05:
                break
        return state

    def misfit(self, state: State) -> np.ndarray:
        """Mean square of each test's whitened residuals, unweighted, (tests,): 1 where only noise is left."""
        rests = [self.problem.whiten_test(k, self.residual(k, state)) for k in range(len(self.problem.samples))]
        return np.array([float(np.mean(rest**2)) for rest in rests])
