"""How well a test that was not measured yet would separate two explanations of the tests that were.

Hunter and Reiner's T-optimality in its Bayesian form: the difference of the two predictions, in units of its noise,
that is left when the second explanation has adapted everything it may still adapt: its effects and data sheet within
what the campaign has left open, the new set-up within its priors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mjsim.inference.data_sheet import DATA_SHEET, calibrated, data_sheet, sheet_block
from mjsim.inference.discrepancy import Sizes, left_in
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.inference.least_squares import ridge_solution
from mjsim.inference.linearisation import Linearisation
from mjsim.inference.noise import Noise
from mjsim.inference.nuisance import BAR_LENGTH, NEST, TRIGGER, instrument_blocks, set_up_columns, set_up_sizes
from mjsim.inference.parameters import Block, Parameters
from mjsim.inference.planning.candidates import Reach
from mjsim.inference.posterior import CompetingModel, Posterior
from mjsim.inference.problem import KeptChanges, sheet_grid, sheet_plants
from mjsim.inference.samples import BLOCKS, GRID_STEPS
from mjsim.inference.whitening import Whitening
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.kinematics import BarSensitivity
from mjsim.machine.model import Machine, build
from mjsim.simulation.axes import AxesMotion

_STEP = 0.02
#: Prior width of an effect's parameters where nothing was measured, typical sizes.
_OPEN = 100.0


@dataclass(frozen=True)
class Explanation:
    """A fitted model, and what in it is free with which covariance.

    Attributes:
        name: Id of the effect that it stands for.
        base: The machine without the free effects, data sheet as printed.
        sheet_deviation: Deviations of its data sheet, (sheet,) standard deviations.
        effects: Free effects.
        parameters: Blocks of the instrument, data sheet and effects: what a new set-up does not change.
        covariance: Of these, (p, p), in prior standard deviations and typical sizes.
    """

    name: str
    base: Machine
    sheet_deviation: np.ndarray
    effects: tuple[EffectVector, ...]
    parameters: Parameters
    covariance: np.ndarray

    @classmethod
    def of_fit(cls, name: str, fit: Fit) -> Explanation:
        """From a fit."""
        kept = _lasting(fit.base, fit.effects, [b for b in fit.parameters.blocks if b.name in (BAR_LENGTH, NEST)])
        at = fit.parameters.places(*(b.name for b in kept.blocks))
        return cls(name, fit.base, fit.sheet_deviation, fit.effects, kept, fit.covariance[np.ix_(at, at)])

    @classmethod
    def of_priors(cls, name: str, machine: Machine, effects: list[EffectVector]) -> Explanation:
        """From priors alone, where nothing was measured."""
        kept = _lasting(machine, tuple(effects))
        spread = np.where(kept.informative, 1.0, _OPEN**2)
        return cls(name, machine, np.zeros(len(data_sheet(machine.chain))), tuple(effects), kept, np.diag(spread))

    def with_effect(self, name: str, effect: EffectVector) -> Explanation:
        """The same with one more effect of a given size, that is not free."""
        return replace(self, name=name, effects=(*self.effects, effect))

    @property
    def machine(self) -> Machine:
        """The whole machine at the best estimate."""
        return calibrated(self.base.with_effects(f.effect for f in self.effects), self.sheet_deviation)


@dataclass(frozen=True)
class Separation:
    """What a test would do: ``deviance`` (squared distance in noise units), ``difference`` RMS in m after
    adaptation.
    """

    test: BallBarTest
    deviance: float
    difference: float


@dataclass(frozen=True)
class Unmeasured:
    """A test that was not measured yet: its reading is sampled at every instant of the grid.

    Attributes:
        motions: Its axes' motion, alone in a tuple.
        sensitivity: The reading's derivatives along it, likewise.
        changes: What was computed already.
    """

    motions: tuple[AxesMotion]
    sensitivity: tuple[BarSensitivity]
    changes: KeptChanges = field(default_factory=KeptChanges)

    @property
    def samples(self) -> tuple[Unmeasured]:
        """The reading as it is."""
        return (self,)

    def sample(self, grid: np.ndarray, shift: float) -> np.ndarray:
        """The reading itself."""
        return grid

    def map(self, work: Callable[[int], object]) -> list:
        """The work on the one test."""
        return [work(0)]

    def shift(self, k: int, nuisance: np.ndarray) -> float:
        """No trigger shift."""
        return 0.0


class Separator:
    """Separations of two explanations by tests, under one noise model.

    Args:
        truth: The one that is taken for true.
        other: The one that adapts.
        noise: Of the instrument.
        block: Length of the blocks whose means are compared, s.
        reach: What can be measured.
        left: Sizes of what neither explanation has, and the new test will show as well.
    """

    def __init__(
        self,
        truth: Explanation,
        other: Explanation,
        noise: Noise,
        block: float = BLOCKS[0],
        reach: Reach | None = None,
        left: Sizes | None = None,
    ) -> None:
        self.truth, self.other, self.noise, self.block, self.left = truth, other, noise, block, left
        self.reach = reach or Reach(truth.base.chain)
        self._plants = build(truth.machine), build(other.machine)
        axes = {f.effect.subject for f in (*truth.effects, *other.effects)}
        self._moved = sheet_plants(other.machine, axes)

    def of(self, test: BallBarTest) -> Separation:
        """Deviance and difference of one test."""
        return self._adapted(test, lasting=True)

    def most(self, test: BallBarTest) -> float:
        """Deviance of one test if nothing but its set-up adapted: no less than the true one, and sooner known."""
        return self._adapted(test, lasting=False).deviance

    def _adapted(self, test: BallBarTest, lasting: bool) -> Separation:
        """One test when the second explanation has adapted its set-up, and with ``lasting`` all that it may."""
        motions = self.reach.motions(test)
        parts = [self._seen_by(motion, lasting) for motion in motions]
        for motion in motions:  # hundreds of tests are looked at
            motion.give_back()
        d, J, rows = (np.concatenate(x) for x in zip(*parts, strict=True))
        dw, Jw = rows[:, 0], rows[:, 1:]
        adapted = ridge_solution(Jw.T @ Jw, Jw.T @ dw, 1.0)
        rest = dw - Jw @ adapted
        return Separation(test, float(max(dw @ rest, 0.0)), float(np.sqrt(np.mean((d - J @ adapted) ** 2))))

    def _seen_by(self, motion: AxesMotion, lasting: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of one reading the difference of the explanations, (n,) m; the derivatives of the second one, (n, p) m per
        prior standard deviation; and both whitened by the noise and by what is in no model, (rows, 1 + p).
        """
        first, second = (motion.reading(p, GRID_STEPS) for p in self._plants)
        sens = motion.sensitivity(self._plants[1], GRID_STEPS)
        set_up, (own, _) = set_up_columns(motion.test, sens, np.zeros((len(second), 3))), set_up_sizes(motion.test)
        trigger = -np.gradient(second, motion.time[GRID_STEPS]) * TRIGGER
        d, *columns = (_blocks(motion, c, self.block) for c in (first - second, *set_up[:, :own].T, trigger))
        if lasting:
            every = (*set_up[:, own:].T, *self._lasting(motion, sens, second))
            kept = [_blocks(motion, c, self.block) for c in every]
            # in units of the root the prior is a unit normal
            columns += list((np.column_stack(kept) @ self._prior_root(motion.test)).T)
        J = np.column_stack(columns)
        rows = whitened(self.noise, np.column_stack([d, J]))
        if self.left is not None and (self.left.slow or self.left.fast):
            time = _blocks(motion, motion.time[::GRID_STEPS], self.block)
            beside = whitened(self.noise, left_in(motion.test, time, self.left))
            rows = Whitening(np.ones(1)).beside(beside).of_all(rows)
        return d, J, rows

    def _prior_root(self, test: BallBarTest) -> np.ndarray:
        """Cholesky factor of the covariance of what lasts: instrument, data sheet of the axes concerned, effects."""
        other = self.other
        instrument = NEST if test.component else BAR_LENGTH
        sheet = [other.parameters.place(DATA_SHEET, data_sheet(other.base.chain)[j].label) for j in self._moved]
        effects = [f.block.name for f in other.effects]
        kept = [*other.parameters.places(instrument), *sheet, *other.parameters.places(*effects)]
        return np.linalg.cholesky(other.covariance[np.ix_(kept, kept)] + 1e-12 * np.eye(len(kept)))

    def _lasting(self, motion: AxesMotion, sens: BarSensitivity, base: np.ndarray) -> Iterator[np.ndarray]:
        """Derivatives of the second explanation's reading for data sheet and effects, m per prior unit.

        Args:
            motion: Of the axes.
            sens: Derivatives of the reading along it.
            base: The reading, m on the grid.
        """
        plant, other = self._plants[1], self.other
        yield from sheet_grid(motion, sens, plant, self._moved)[list(self._moved)]
        linear = Linearisation(Unmeasured((motion,), (sens,)), other.machine, np.zeros(0))
        for f in other.effects:
            cheap = linear.columns(f)
            if cheap is not None:
                yield from cheap[0].T
                continue
            for j in range(len(f.vector)):
                effect, change = f.nudged(j, _STEP)
                there = motion.reading(build(other.machine.with_effect(effect)), GRID_STEPS)
                yield (there - base) / change if abs(change) > 1e-9 else np.zeros(len(base))


def _blocks(motion: AxesMotion, grid: np.ndarray, length: float) -> np.ndarray:
    """Block means of what was computed on the grid, over the measured part of a test.

    Args:
        motion: Of the test.
        grid: Values, (n,).
        length: Of a block, s.
    """
    lo, hi = motion.program.measured_span
    time = motion.time[::GRID_STEPS]
    inside = np.flatnonzero((time >= lo) & (time <= hi))
    per_block = max(1, round(length / (time[1] - time[0])))
    return grid[inside[: len(inside) // per_block * per_block]].reshape(-1, per_block).mean(axis=1)


def whitened(noise: Noise, columns: np.ndarray) -> np.ndarray:
    """Block means (m, k) of one test without a gap in units of the noise, (m - order, k)."""
    taps = noise.taps
    p = len(taps) - 1
    out = np.zeros_like(columns[p:])
    for k, t in enumerate(taps):
        out += t * columns[p - k : len(columns) - k]
    return out


def competing_of(explanation: Explanation) -> CompetingModel:
    """An explanation as other instruments take it: its machine, and what is uncertain about effects and data sheet."""
    e = explanation
    places = e.parameters.places(*(f.block.name for f in e.effects), DATA_SHEET)
    return CompetingModel(e.name, e.machine, Posterior(e.effects, e.covariance[np.ix_(places, places)]), 0.0)


def _lasting(
    machine: Machine, effects: tuple[EffectVector, ...], instruments: Sequence[Block] | None = None
) -> Parameters:
    """Blocks of what a new set-up does not change; without ``instruments`` those of any."""
    own = instrument_blocks() if instruments is None else instruments
    sheet = sheet_block(machine, np.zeros(len(data_sheet(machine.chain)), bool))
    return Parameters((*own, sheet, *(f.block for f in effects)))
