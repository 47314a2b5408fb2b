"""Joint fit of nuisances, data sheet and effects: Gauss-Newton on whitened residuals with priors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mjsim.estimation.data_sheet import SHEET, calibrated
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.nuisance import TRIGGER_LIMIT, fit_nuisance
from mjsim.estimation.problem import Problem
from mjsim.machine.effect import Effect
from mjsim.machine.model import FRICTION_PARAMETERS, Machine, build

_STEP = 0.02  # of a parameter's typical size, for numerical derivatives
#: Prior width of effect parameters in typical sizes: wide, it only keeps the equations regular.
_WIDE = 1e3
#: Share of the hoped-for gain that a step must bring for its derivatives to be used again.
_GOOD = 0.7
#: A start that fits about so well (mean square), with its data sheet within so many standard deviations, is a beginning by itself.
_SOUND, _UPRIGHT = 1.5, 3.0


@dataclass
class Fit:
    """A fitted model.

    Attributes:
        base: the user's machine with ``effects`` in it, data sheet as printed.
        effects: the free effects at their fitted values. nuisance: (layout.size,). sheet_deviation: (len(SHEET),) data-sheet moves;
        all three in prior standard deviations (effects: typical sizes).
        objective: squared whitened residuals plus prior penalties. sum_squares: without the penalties.
        readings: simulated readings on the GRID, with the fitted effects and the data sheet moved by ``held`` (the rest of
        ``sheet_deviation`` counts linearly where the fit is not exact).
        residual: (count,) whitened. design: (count, p) whitened columns, order nuisance, sheet, effects.
        covariance: (p, p) of those parameters. step: (p,) Gauss-Newton step from here (near zero after convergence).
    """

    base: Machine
    effects: list[EffectVector]
    nuisance: np.ndarray
    sheet_deviation: np.ndarray
    objective: float = np.inf
    sum_squares: float = np.inf
    held: np.ndarray = field(default_factory=lambda: np.zeros(0))
    readings: list[np.ndarray] = field(default_factory=list)
    residual: np.ndarray = field(default_factory=lambda: np.zeros(0))
    design: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    step: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def machine(self) -> Machine:
        """The machine with the fitted effects and the calibrated data sheet."""
        return calibrated(with_effects(self.base, [f.effect for f in self.effects]), self.sheet_deviation)

    def block(self, index: int) -> slice:
        """Columns of the ``index``-th effect in design and covariance."""
        start = len(self.nuisance) + len(self.sheet_deviation) + sum(len(f.vector) for f in self.effects[:index])
        return slice(start, start + len(self.effects[index].vector))


def with_effects(machine: Machine, effects: list[Effect]) -> Machine:
    """``machine`` with effects appended or replaced."""
    for e in effects:
        machine = machine.with_effect(e)
    return machine


class Fitter:
    """Fits models of one machine to one problem. The data sheet's derivative columns are computed once, at the start."""

    def __init__(self, problem: Problem, machine: Machine, calibrate: bool = True) -> None:
        self.problem, self.machine = problem, machine
        self.calibrate = calibrate
        none = [np.zeros((len(SHEET), len(m.time[::5]))) for m in problem.motions]
        self._grids = problem.sheet_grids(machine) if calibrate else none

    def sheet_at(self, fit: Fit) -> tuple[list[np.ndarray], np.ndarray]:
        """Data-sheet columns per test and whitened, at the fit's triggers; simulated anew for axes whose drives the effects change."""
        grids = self._grids
        axes = {f.effect.subject for f in fit.effects if not f.effect.search.quasi_static}
        if axes and self.calibrate:
            mine = np.array([p.axis in axes for p in SHEET])[:, None]
            fresh = self.problem.sheet_grids(fit.machine, axes)
            grids = [np.where(mine, a, b) for a, b in zip(fresh, grids, strict=True)]
        sheet = self.problem.sample_grids(grids, fit.nuisance)
        return sheet, self.problem.whiten(sheet)

    def frozen_sheet(self, effects: list[EffectVector]) -> np.ndarray:
        """Data-sheet entries that an effect fits freely, so that they leave the calibration, (len(SHEET),) bool."""
        out = np.zeros(len(SHEET), bool)
        if not self.calibrate:
            return ~out
        for f in effects:
            if f.effect.kind == "friction":
                out |= [p.axis == f.effect.subject and FRICTION_PARAMETERS.get(p.name) in f.names for p in SHEET]
        return out

    def fit(
        self, effects: list[EffectVector], start: Fit | None = None, iterations: int = 6, exact: bool = True, fresh: bool = True
    ) -> Fit:
        """Fit the given effects together with nuisances and data sheet.

        Args:
            effects: what is free, at its starting values. start: an earlier fit to start from.
            iterations: Gauss-Newton steps at most. exact: simulate again after every change of the data sheet; otherwise its
            derivative columns stand in for small changes (much faster, for ranking). fresh: begin with fresh nuisances where that is
            nearer than ``start``.
        """
        p = self.problem
        frozen = self.frozen_sheet(effects)
        now, sheet, white, anchor = self._begin(effects, start, frozen, exact, fresh)
        fresh = True
        for iteration in range(iterations):
            # what the model fails to explain counts as noise: nuisances and data sheet stay near their priors until it is good
            weight = max(1.0, now.sum_squares / p.count)
            if fresh and exact and iteration:
                sheet, white = self.sheet_at(now)
            step = self._solve(now, frozen, white, weight) if fresh else self._step(now, weight)
            for scale in (1.0, 0.5, 0.2, 0.05):
                trial = self._moved(now, scale * step)
                self._evaluate(trial, anchor, exact, sheet)
                if trial.objective < now.objective:
                    break
            else:
                if fresh:
                    break
                fresh = True
                continue
            gain, hoped = now.objective - trial.objective, float(step @ np.linalg.solve(now.covariance, step))
            now = trial
            if gain < 0.5:
                break
            fresh = scale < 1.0 or gain < _GOOD * hoped  # derivatives that keep their promise serve once more
        self._solve(now, frozen, white)
        return now

    def _begin(self, effects: list[EffectVector], start: Fit | None, frozen: np.ndarray, exact: bool, fresh: bool):
        """The better of two beginnings: where ``start`` ended, or fresh nuisances and the data sheet as printed.

        A model that lacked an effect has bent nuisances and data sheet; with the effect in it, a fresh beginning is often nearer.
        """
        p = self.problem
        beginnings = []
        if start is not None:
            beginnings.append((start.nuisance.copy(), np.where(frozen, 0.0, start.sheet_deviation)))
        if start is None or (fresh and (start.sum_squares > _SOUND * p.count or np.abs(start.sheet_deviation).max() > _UPRIGHT)):
            beginnings.append((None, np.zeros(len(SHEET))))
        made = []
        for nuisance, sheet_deviation in beginnings:
            fit = Fit(self.machine, list(effects), np.zeros(p.layout.size) if nuisance is None else nuisance, sheet_deviation)
            if nuisance is None:
                fit.nuisance = fit_nuisance(p, p.readings(build(fit.machine)))
            sheet, white = self.sheet_at(fit)
            self._evaluate(fit, fit.sheet_deviation, exact, sheet)
            made.append((fit, sheet, white, fit.sheet_deviation.copy()))
        return min(made, key=lambda m: m[0].objective)

    def _moved(self, fit: Fit, step: np.ndarray) -> Fit:
        n, t = len(fit.nuisance), len(fit.sheet_deviation)
        effects, at = [], n + t
        for f in fit.effects:
            v = f.vector
            effects.append(EffectVector(f.at(v + step[at : at + len(v)]), f.names))
            at += len(v)
        nuisance = fit.nuisance + step[:n]
        first = self.problem.layout.length + 1
        nuisance[first:] = np.clip(nuisance[first:], -TRIGGER_LIMIT, TRIGGER_LIMIT)
        return replace(fit, effects=effects, nuisance=nuisance, sheet_deviation=fit.sheet_deviation + step[n : n + t])

    def _evaluate(self, fit: Fit, anchor: np.ndarray, exact: bool, sheet: list[np.ndarray]) -> None:
        p = self.problem
        machine = with_effects(self.machine, [f.effect for f in fit.effects])
        fit.held = fit.sheet_deviation if exact else anchor
        fit.readings = p.readings(build(calibrated(machine, fit.held)))
        rest = p.residual(fit.readings, fit.nuisance)
        if not exact:
            rest = [r - c @ (fit.sheet_deviation - anchor) for r, c in zip(rest, sheet, strict=True)]
        fit.residual = p.whiten(rest)
        fit.sum_squares = float(fit.residual @ fit.residual)
        fit.objective = fit.sum_squares + float(fit.nuisance @ fit.nuisance + fit.sheet_deviation @ fit.sheet_deviation)

    def effect_columns(self, fit: Fit) -> list[np.ndarray]:
        """Derivative of the block means with respect to the effects' vectors, (m, k) per test, m per typical size."""
        p = self.problem
        columns: list[list[np.ndarray]] = [[] for _ in p.tests]
        for i, f in enumerate(fit.effects):
            for j in range(len(f.vector)):
                effect, change = f.nudged(j, _STEP)
                others = [g.effect if k != i else effect for k, g in enumerate(fit.effects)]
                plant = build(calibrated(with_effects(self.machine, others), fit.held))
                for k, d in enumerate(p.difference(fit.readings, p.readings(plant), fit.nuisance)):
                    columns[k].append(d / change)
        return [np.column_stack(c) if c else np.zeros((len(s.centre), 0)) for c, s in zip(columns, p.samples, strict=True)]

    def _solve(self, fit: Fit, frozen: np.ndarray, sheet_white: np.ndarray, weight: float = 1.0) -> np.ndarray:
        """Gauss-Newton step, priors counted ``weight`` times; leaves design and covariance in ``fit``."""
        p = self.problem
        nuisance = p.whiten_nuisance(p.nuisance_columns(fit.readings, fit.nuisance))
        effects = p.whiten(self.effect_columns(fit)) if fit.effects else np.zeros((len(nuisance), 0))
        fit.design = np.hstack([nuisance, sheet_white, effects])
        if frozen.any():
            fit.design[:, len(fit.nuisance) + np.flatnonzero(frozen)] = 0.0
        fit.covariance = np.linalg.inv(fit.design.T @ fit.design + np.diag(self._prior(fit, weight)))
        return self._step(fit, weight)

    def _prior(self, fit: Fit, weight: float) -> np.ndarray:
        n = len(fit.nuisance) + len(fit.sheet_deviation)
        return np.concatenate([np.full(n, weight), np.full(fit.design.shape[1] - n, _WIDE**-2)])

    def _step(self, fit: Fit, weight: float) -> np.ndarray:
        """Gauss-Newton step with the design that ``fit`` has, be it from an earlier point."""
        now = np.concatenate(
            [fit.nuisance, fit.sheet_deviation, np.zeros(fit.design.shape[1] - len(fit.nuisance) - len(fit.sheet_deviation))]
        )
        fit.step = fit.covariance @ (fit.design.T @ fit.residual - self._prior(fit, weight) * now)
        return fit.step


def unabsorbed(problem: Problem, fit: Fit, parts: list[np.ndarray]) -> list[np.ndarray]:
    """What of a reading's parts (block means per test, m) the nuisances of the set-up cannot take up."""
    n = len(fit.nuisance)
    design = fit.design[:, :n]
    taken = np.linalg.solve(design.T @ design + np.eye(n), design.T @ problem.whiten(parts))
    columns = problem.nuisance_columns(fit.readings, fit.nuisance)
    return [d - c @ taken[problem.layout.of(t)] for d, c, t in zip(parts, columns, problem.tests, strict=True)]
