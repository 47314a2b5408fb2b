"""How well a test that was not measured yet would separate two explanations of the tests that were.

Hunter and Reiner's T-optimality in its Bayesian form: the difference of the two predictions, in units of its noise, that is left when
the second explanation has adapted everything it may still adapt: its effects and data sheet within what the campaign has left open,
the new set-up within its priors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.ballbar.measurement import BallBarTest
from mjsim.estimation.data_sheet import SHEET, calibrated
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fit, with_effects
from mjsim.estimation.problem import LENGTH, SPINDLE_BALL, TABLE_BALL, TRIGGER, sheet_grid, sheet_plants
from mjsim.estimation.samples import BLOCKS, GRID_STEPS, Noise
from mjsim.machine.model import Machine, build
from mjsim.simulation.axes import AxesMotion

_STEP = 0.02
#: Prior width of an effect's parameters where nothing was measured, typical sizes.
_OPEN = 100.0


@dataclass(frozen=True)
class Explanation:
    """A fitted model: ``fit``'s machine, and what in it is free with which covariance.

    Attributes:
        name: id of the effect that it stands for. machine: with calibrated data sheet, less the free effects' freedom.
        effects: free effects. covariance: of (bar length, data sheet, effects' vectors), prior standard deviations and typical sizes.
    """

    name: str
    base: Machine
    sheet_deviation: np.ndarray
    effects: tuple[EffectVector, ...]
    covariance: np.ndarray

    @classmethod
    def of_fit(cls, name: str, fit: Fit, length: int) -> Explanation:
        """From a fit; ``length`` is the bar length's place among the nuisances."""
        n = len(fit.nuisance)
        keep = [length, *range(n, fit.covariance.shape[0])]
        return cls(name, fit.base, fit.sheet_deviation, tuple(fit.effects), fit.covariance[np.ix_(keep, keep)])

    @classmethod
    def of_priors(cls, name: str, machine: Machine, effects: list[EffectVector]) -> Explanation:
        """From priors alone, where nothing was measured."""
        free = sum(len(f.vector) for f in effects)
        spread = np.concatenate([np.ones(1 + len(SHEET)), np.full(free, _OPEN**2)])
        return cls(name, machine, np.zeros(len(SHEET)), tuple(effects), np.diag(spread))

    @property
    def machine(self) -> Machine:
        """The whole machine at the best estimate."""
        return calibrated(with_effects(self.base, [f.effect for f in self.effects]), self.sheet_deviation)


@dataclass(frozen=True)
class Separation:
    """What a test would do: ``deviance`` (squared distance in noise units), ``difference`` RMS in m after adaptation."""

    test: BallBarTest
    deviance: float
    difference: float


class Separator:
    """Separations of two explanations by tests, under one noise model."""

    def __init__(self, truth: Explanation, other: Explanation, noise: Noise, block: float = BLOCKS[0]) -> None:
        self.truth, self.other, self.noise, self.block = truth, other, noise, block
        self._plants = build(truth.machine), build(other.machine)
        axes = {f.effect.subject for f in (*truth.effects, *other.effects)}
        self._moved = sheet_plants(other.machine, axes)

    def of(self, test: BallBarTest) -> Separation:
        """Deviance and difference of one test."""
        motion = AxesMotion(test, keep=12)
        lo, hi = motion.program.measured_span
        time = motion.time[::GRID_STEPS]
        inside = np.flatnonzero((time >= lo) & (time <= hi))
        per_block = max(1, round(self.block / (time[1] - time[0])))
        inside = inside[: len(inside) // per_block * per_block]

        def blocks(grid: np.ndarray) -> np.ndarray:
            return grid[inside].reshape(-1, per_block).mean(axis=1)

        a, b = (motion.reading(p, GRID_STEPS) for p in self._plants)
        d = blocks(a - b)
        if np.std(d) < 0.02 * self.noise.rms:
            return Separation(test, 0.0, 0.0)
        columns = [blocks(c) for c in self._columns(motion, b)]
        J = np.column_stack(columns)
        W = self._whitened(np.column_stack([d, J]))
        dw, Jw = W[:, 0], W[:, 1:]
        P = self._prior(len(columns))
        back = np.linalg.solve(np.linalg.inv(P) + Jw.T @ Jw, Jw.T @ dw)
        rest = dw - Jw @ back
        return Separation(test, float(max(dw @ rest, 0.0)), float(np.sqrt(np.mean((d - J @ back) ** 2))))

    def _prior(self, size: int) -> np.ndarray:
        """Covariance of (7 nuisances of the new set-up, length, data sheet of the axes concerned, effects)."""
        c = self.other.covariance
        kept = [0, *(1 + j for j in self._moved), *range(1 + len(SHEET), len(c))]
        P = np.eye(size)
        P[7:, 7:] = c[np.ix_(kept, kept)] + 1e-12 * np.eye(size - 7)
        return P

    def _columns(self, motion: AxesMotion, base: np.ndarray):
        """Derivatives of the other explanation's reading: set-up, trigger, length, data sheet, effects; m per prior unit."""
        plant, other = self._plants[1], self.other
        sens = motion.sensitivity(plant, GRID_STEPS)
        yield from (sens.table * TABLE_BALL).T
        yield from (sens.spindle * SPINDLE_BALL).T
        yield -np.gradient(base, motion.time[GRID_STEPS]) * TRIGGER
        yield np.full(len(base), LENGTH)
        yield from sheet_grid(motion, sens, plant, self._moved)[list(self._moved)]
        for k, f in enumerate(other.effects):
            for j in range(len(f.vector)):
                effect, change = f.nudged(j, _STEP)
                effects = [g.effect if m != k else effect for m, g in enumerate(other.effects)]
                there = motion.reading(build(calibrated(with_effects(other.base, effects), other.sheet_deviation)), GRID_STEPS)
                yield (there - base) / change if abs(change) > 1e-9 else np.zeros(len(base))

    def _whitened(self, columns: np.ndarray) -> np.ndarray:
        taps = self.noise.taps
        p = len(taps) - 1
        out = np.zeros_like(columns[p:])
        for k, t in enumerate(taps):
            out += t * columns[p - k : len(columns) - k]
        return out
