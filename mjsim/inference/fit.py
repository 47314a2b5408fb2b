"""Joint fit of nuisances, data sheet and effects: Gauss-Newton on whitened residuals with priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mjsim.inference.data_sheet import DATA_SHEET, calibrated, data_sheet, is_another_drive, sheet_block
from mjsim.inference.design import Design
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.least_squares import LeastSquares
from mjsim.inference.linearisation import Linearisation
from mjsim.inference.nuisance import Nuisances
from mjsim.inference.nuisance_fit import better_triggers, fit_nuisance
from mjsim.inference.parameters import Parameters
from mjsim.inference.problem import Problem
from mjsim.inference.whitening import Whitening
from mjsim.machine.model import FRICTION_PARAMETERS, Machine, build

_STEP = 0.02  # of a parameter's typical size, for numerical derivatives
#: Shares of a Gauss-Newton step that are tried until the objective falls.
_SCALES = (1.0, 0.5, 0.2, 0.05)
#: Share of the promised gain that a step must bring for its derivatives to be used again.
_KEPT_PROMISE = 0.7
#: Fall of the objective below which a fit has converged; share of what it leaves beyond the noise below which it ends.
CONVERGED, _SLOW = 0.1, 1e-3
#: A start that fits about so well (mean square), with its data sheet within so many standard deviations, needs no other
#: beside it.
_GOOD_START, _GOOD_SHEET = 1.5, 3.0
_FAR_SHEET = 10.0  # beyond so many standard deviations, the printed data sheet is tried as well


@dataclass(frozen=True)
class Fit:
    """A fitted model.

    Attributes:
        base: The user's machine without the fitted effects, data sheet as printed.
        effects: The free effects at their fitted values.
        nuisances: Blocks of set-up and instrument.
        nuisance: Their values, (nuisances.size,) in prior standard deviations.
        sheet_deviation: Deviations of the data sheet, (sheet,) in standard deviations of its tolerances.
        frozen_sheet: Numbers of the data sheet that stay as printed, (sheet,) bool.
        objective: Squared whitened residuals plus prior penalties.
        sum_squares: Without the penalties.
        simulated_deviation: The data-sheet deviations of the simulated readings, (sheet,).
        readings: Simulated readings on the GRID, one per test, m, with the fitted effects. The rest of
            ``sheet_deviation`` counts linearly where the fit is not exact.
        residual: Whitened, (count,).
        design: Whitened derivatives with respect to :attr:`vector`.
        whitening: What both are whitened by, beside the campaign's noise.
        equations: Normal equations of the design, once it is made.
        step: Gauss-Newton step from here, (p,); near zero after convergence.
        considered: What else its covariance has: columns (p, k), the sum of whose squares is that, by what it is from
            (:mod:`mjsim.inference.considered`).
    """

    base: Machine
    effects: tuple[EffectVector, ...]
    nuisances: Nuisances
    nuisance: np.ndarray
    sheet_deviation: np.ndarray
    frozen_sheet: np.ndarray
    objective: float = np.inf
    sum_squares: float = np.inf
    simulated_deviation: np.ndarray = field(default_factory=lambda: np.zeros(0))
    readings: tuple[np.ndarray, ...] = ()
    residual: np.ndarray = field(default_factory=lambda: np.zeros(0))
    design: Design = field(default_factory=lambda: Design([], 0))
    whitening: Whitening | None = None
    equations: LeastSquares | None = None
    step: np.ndarray = field(default_factory=lambda: np.zeros(0))
    considered: Mapping[str, np.ndarray] = field(default_factory=dict)

    @cached_property
    def machine(self) -> Machine:
        """The machine with the fitted effects and the calibrated data sheet."""
        return calibrated(self.base.with_effects(f.effect for f in self.effects), self.sheet_deviation)

    @cached_property
    def simulated_machine(self) -> Machine:
        """The machine that :attr:`readings` were simulated with."""
        return calibrated(self.base.with_effects(f.effect for f in self.effects), self.simulated_deviation)

    @cached_property
    def parameters(self) -> Parameters:
        """Nuisances, data sheet, a block per effect. What a poor model lacks drives effects to bounds: it has none."""
        sheet = sheet_block(self.base, self.frozen_sheet)
        near = self.sum_squares < _GOOD_START * len(self.residual)
        return self.nuisances.with_blocks(sheet, *(f.block if near else f.block.unbounded for f in self.effects))

    @cached_property
    def vector(self) -> np.ndarray:
        """Present values of :attr:`parameters`, (p,)."""
        values = self.nuisances.split(self.nuisance) | {DATA_SHEET: self.sheet_deviation}
        return self.parameters.join(values | {f.block.name: f.vector for f in self.effects})

    @property
    def linear(self) -> LeastSquares:
        """The normal equations of a finished fit."""
        assert self.equations is not None
        return self.equations

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of :attr:`vector`, (p, p)."""
        return self.linear.covariance + sum((c @ c.T for c in self.considered.values()), 0.0)

    def covariance_of(self, effect: EffectVector) -> np.ndarray:
        """Covariance of one effect's entries, (k, k)."""
        at = self.parameters[effect.block.name]
        return self.covariance[at, at]

    def moved(self, step: np.ndarray) -> Fit:
        """The model with its vector moved by ``step`` (p,), not evaluated yet."""
        p = self.parameters
        vector = self.vector + step
        values = p.split(vector)
        effects = tuple(f.with_effect(f.at(values[f.block.name])) for f in self.effects)
        return replace(
            self, effects=effects, nuisance=p.part(vector, self.nuisances), sheet_deviation=values[DATA_SHEET]
        )


def retimed(problem: Problem, fit: Fit) -> Fit | None:
    """A fit with better triggers, to start from again; ``None`` where each stands in its best place."""
    nuisance = better_triggers(problem, fit.readings, fit.nuisance)
    return None if nuisance is None else replace(fit, nuisance=nuisance)


class SheetGrids:
    """Derivatives of the readings with respect to the data sheet, near the machine that was asked for last: those of an
    axis are simulated anew where its drive has become another one, if that one is stable.

    Args:
        problem: The measured tests.
        machine: To begin with.
    """

    def __init__(self, problem: Problem, machine: Machine) -> None:
        self.problem, self.letters = problem, machine.chain.letters
        self._grids, self._at = problem.sheet_grids(machine), dict.fromkeys(self.letters, machine)
        self._axis_of = np.array([n.axis for n in data_sheet(machine.chain)])

    def near(self, machine: Machine) -> list[np.ndarray]:
        """Derivatives near a machine, (sheet, n) per test on the GRID, m per standard deviation."""
        moved = [a for a in self.letters if is_another_drive(machine, self._at[a], a)]
        fresh = self.problem.sheet_grids(machine, moved) if moved else []
        for axis in moved:
            at = self._axis_of == axis
            if all(np.isfinite(now[at]).all() for now in fresh):
                for grid, now in zip(self._grids, fresh, strict=True):
                    grid[at] = now[at]
                self._at[axis] = machine
        return self._grids


class Fitter:
    """Fits models of one machine to one problem.

    Args:
        problem: The measured tests.
        machine: The machine.
        near: A fitter of a similar machine to the same tests, whose derivatives are taken over where they hold.
    """

    def __init__(self, problem: Problem, machine: Machine, near: Fitter | None = None) -> None:
        self.problem, self.machine = problem, machine
        self._sheet = SheetGrids(problem, machine) if near is None else near._sheet

    def with_problem(self, problem: Problem) -> Fitter:
        """The same for a problem with other samples of the same tests."""
        out = copy(self)
        out.problem = problem
        return out

    def fit(
        self,
        effects: Sequence[EffectVector],
        start: Fit | None = None,
        iterations: int = 6,
        exact: bool = True,
        fresh: bool = True,
    ) -> Fit:
        """Fit the given effects together with nuisances and data sheet.

        Args:
            effects: What is free, at its starting values.
            start: An earlier fit to start from.
            iterations: Gauss-Newton steps at most.
            exact: Simulate again after every change of the data sheet. Otherwise its derivative columns stand in for
                small changes (much faster, for ranking).
            fresh: Begin with fresh nuisances where that is nearer than ``start``.
        """
        now, sheet, white = self._start(tuple(effects), start, exact, fresh)
        anchor = now.sheet_deviation
        fresh = True
        for iteration in range(iterations):
            # what the model fails to explain counts as noise: until it is good, the rest stays near its priors
            weight = max(1.0, now.sum_squares / self.problem.count)
            if fresh and exact and iteration:
                sheet, white = self._sheet_columns(now)
            if fresh:
                now = self._linearised(now, white, weight)
            else:
                now = self._with_step(now, replace(now.linear, weight=weight))
            white = now.design.rest[:, : white.shape[1]]  # one copy of these large columns is enough
            promised = now.linear.gain(now.step)
            if promised < CONVERGED:
                if fresh:
                    return self._with_equations(now, now.design)
                break
            trial, scale = now, 0.0
            for scale in _SCALES if fresh else _SCALES[:1]:
                trial = self._evaluated(now.moved(scale * now.step), anchor, exact, sheet)
                if trial.objective < now.objective:
                    break
            else:
                if fresh:
                    break
                fresh = True
                continue
            gain, now = now.objective - trial.objective, trial
            slow = gain < max(CONVERGED, _SLOW * (now.sum_squares - self.problem.count))
            if slow and fresh:
                break
            # derivatives that keep their promise serve once more
            fresh = slow or scale < 1.0 or gain < _KEPT_PROMISE * promised
        return self._linearised(now, white)

    def _start(self, effects: tuple[EffectVector, ...], start: Fit | None, exact: bool, fresh: bool):
        """The best start, with its data-sheet columns: where ``start`` ended, or fresh nuisances and the sheet as
        printed. A model that lacked an effect has distorted both; with the effect in it, a fresh start is often nearer.
        """
        p, frozen = self.problem, self._frozen_sheet(effects)
        printed = np.zeros(len(frozen))
        made: list[Fit] = []
        if start is not None:
            deviation = np.where(frozen, 0.0, start.sheet_deviation)
            made.append(Fit(self.machine, effects, p.nuisances, start.nuisance, deviation, frozen))
            if np.abs(deviation).max() > _FAR_SHEET:  # may be unstable
                made.append(replace(made[0], sheet_deviation=printed))
        poor = (
            start is None
            or start.sum_squares > _GOOD_START * p.count
            or np.abs(start.sheet_deviation).max() > _GOOD_SHEET
        )
        if start is None or (fresh and poor):
            model = Fit(self.machine, effects, p.nuisances, p.nuisances.mean, printed, frozen)
            nuisance = fit_nuisance(p, p.readings(build(model.machine)))
            made.append(replace(model, nuisance=nuisance))
        return min((self._evaluated_with_sheet(model, exact) for model in made), key=lambda start: start[0].objective)

    def _evaluated_with_sheet(self, fit: Fit, exact: bool) -> tuple[Fit, list[np.ndarray], np.ndarray]:
        """The model evaluated, with its data-sheet columns per test and whitened."""
        sheet, white = self._sheet_columns(fit)
        return self._evaluated(fit, fit.sheet_deviation, exact, sheet), sheet, white

    def _frozen_sheet(self, effects: tuple[EffectVector, ...]) -> np.ndarray:
        """Data-sheet entries that an effect fits freely, so that they leave the calibration, (sheet,) bool."""
        sheet = data_sheet(self.machine.chain)
        out = np.zeros(len(sheet), bool)
        for f in effects:
            if f.effect.kind == "friction":
                out |= [p.axis == f.effect.subject and FRICTION_PARAMETERS.get(p.name) in f.names for p in sheet]
        return out

    def _sheet_columns(self, fit: Fit) -> tuple[list[np.ndarray], np.ndarray]:
        """Data-sheet columns per test, and whitened but for what tests share, at the fit's triggers."""
        sheet = self.problem.sample_grids(self._sheet.near(fit.machine), fit.nuisance)
        return sheet, self.problem.whiten_tests(sheet)

    @np.errstate(over="ignore", invalid="ignore")
    def _evaluated(self, fit: Fit, anchor: np.ndarray, exact: bool, sheet: list[np.ndarray]) -> Fit:
        """The model with its readings, residuals and objective."""
        p = self.problem
        fit = replace(fit, simulated_deviation=fit.sheet_deviation if exact else anchor)
        readings = p.readings(build(fit.simulated_machine))
        rest = p.residual(readings, fit.nuisance)
        if not exact:
            rest = [r - c @ (fit.sheet_deviation - anchor) for r, c in zip(rest, sheet, strict=True)]
        residual = p.whiten(rest)
        squares = float(residual @ residual)
        squares = squares if np.isfinite(squares) else np.inf  # drives that such a data sheet makes unstable
        return replace(
            fit,
            readings=tuple(readings),
            residual=residual,
            whitening=p.whitening,
            sum_squares=squares,
            objective=squares + fit.parameters.penalty(fit.vector),
        )

    def _effect_columns(self, fit: Fit) -> list[np.ndarray]:
        """Derivative of the block means with respect to the effects' vectors, (m, k) per test, m per typical size."""
        p = self.problem
        columns: list[list[np.ndarray]] = [[] for _ in p.tests]
        linearisation = Linearisation(p, fit.simulated_machine, fit.nuisance)
        for f in fit.effects:
            cheap = linearisation.columns(f)
            if cheap is not None:
                for own, part in zip(columns, cheap, strict=True):
                    own.append(part)
                continue
            for j in range(len(f.vector)):
                effect, change = f.nudged(j, _STEP)
                plant = build(fit.simulated_machine.with_effect(effect))
                for k, d in enumerate(p.difference(fit.readings, p.readings(plant), fit.nuisance)):
                    columns[k].append(d / change)
        return [
            np.column_stack(c) if c else np.zeros((len(s.centre), 0)) for c, s in zip(columns, p.samples, strict=True)
        ]

    def _linearised(self, fit: Fit, sheet_white: np.ndarray, weight: float = 1.0) -> Fit:
        """The model with its design and Gauss-Newton step; priors count ``weight`` times."""
        p = self.problem
        nuisance = p.whiten_nuisance(p.nuisance_columns(fit.readings, fit.nuisance))
        effects = p.whiten_tests(self._effect_columns(fit)) if fit.effects else np.zeros((len(sheet_white), 0))
        rest = np.hstack([sheet_white, effects])
        rest[:, fit.parameters.frozen[p.nuisances.size :]] = 0.0
        return self._with_equations(fit, Design(nuisance, p.nuisances.size, rest, p.shared), weight)

    def _with_equations(self, fit: Fit, design: Design, weight: float = 1.0) -> Fit:
        """The model with a design and its Gauss-Newton step."""
        return self._with_step(replace(fit, design=design), LeastSquares.of_design(fit.parameters, design, weight))

    @staticmethod
    def _with_step(fit: Fit, equations: LeastSquares) -> Fit:
        """The model with the Gauss-Newton step of the design that it has, be it from an earlier point."""
        return replace(fit, equations=equations, step=equations.step(fit.design.T @ fit.residual, fit.vector))
