"""Fit of one axis to all its recordings: bounded least squares on block means, weighted by what each test leaves.

What a model fails to explain counts as noise: a recording's residuals are divided by their own RMS (never below the
noise), and counted by how many independent ones they are worth, from their correlation. So priors keep their weight
while a model is poor, and intervals are those of correlated residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from mjsim.estimation.axis_logs.data import AxisData
from mjsim.estimation.axis_logs.entries import CONTROLLER, NUISANCES, PHASE, SHIFT, START_TORQUE, ZERO, AxisModel
from mjsim.machine.model import build
from mjsim.simulation.servo import ServoMotion, ServoStart, follow

#: Number of the plant -> kind of the effect that puts a wave there, whose phase is free in every set-up.
WAVES = {"ripple": "torque_ripple", "friction_ripple": "friction_ripple"}
#: Step of numerical derivatives, units of the vector.
_STEP = 1e-3
#: A residual beyond so many metres or radians belongs to a model that has run away.
_LOST = 0.1


@dataclass(frozen=True)
class AxisFit:
    """A fitted model of one axis.

    Attributes:
        model: Its entries have the fitted values.
        residual: Measured less modelled block means per test, (blocks,) axis units.
        design: Derivatives of the modelled block means per test, (blocks, p); empty before they were needed.
        independent: How many independent residuals each test's are worth.
        weight: One over the standard deviation that each test's block means are given, 1/axis units.
    """

    model: AxisModel
    residual: tuple[np.ndarray, ...]
    design: tuple[np.ndarray, ...]
    independent: tuple[float, ...]
    weight: tuple[float, ...]

    @property
    def mean_squares(self) -> np.ndarray:
        """Mean square of the residuals, one per test."""
        return np.array([r @ r / len(r) for r in self.residual])

    @property
    def rms(self) -> float:
        """Of all tests together, axis units."""
        return float(np.sqrt(np.mean(self.mean_squares)))

    @property
    def precision(self) -> np.ndarray:
        """Inverse covariance of the vector, (p, p)."""
        prior = np.array([e.deviation for e in self.model.entries]) ** -2.0
        normal = sum((w * d).T @ (w * d) for w, d in zip(self.weight, self.design, strict=True))
        return np.asarray(normal) + np.diag(prior)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the vector, (p, p)."""
        p = self.precision
        scale = 1.0 / np.sqrt(np.maximum(np.diag(p), 1e-30))
        inverse = np.linalg.pinv(p * np.outer(scale, scale), rcond=1e-13, hermitian=True)
        return inverse * np.outer(scale, scale)


class LogFitter:
    """Fits models of one axis to its recordings.

    Args:
        data: All recordings of the axis.
        threads: Simulations side by side.
    """

    def __init__(self, data: Sequence[AxisData], threads: int = 2) -> None:
        self.data = tuple(data)
        self._measured = [d.means(d.record.actual) for d in self.data]
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None
        setups = dict.fromkeys(d.test.setup for d in self.data)
        self.first_setup = next(iter(setups))

    # -- simulation ----------------------------------------------------------------------------------------------------

    def motion(self, model: AxisModel, vector: np.ndarray, k: int) -> ServoMotion:
        """The simulated motion of recording ``k``."""
        d = self.data[k]
        plant = build(model.at(vector).under(d.test.controller)).axes[d.axis]
        for attribute, kind in WAVES.items():
            phase = model.nuisance(vector, PHASE, d.test.setup, kind)
            if phase:
                amplitude, order, angle = getattr(plant, attribute)
                setattr(plant, attribute, (amplitude, order, angle + phase))
        start = ServoStart(*d.start, model.nuisance(vector, START_TORQUE, d.name))
        return follow(plant, d.time, d.record.command, start)

    def positions(self, model: AxisModel, vector: np.ndarray, k: int) -> np.ndarray:
        """Modelled samples of recording ``k``, (n,) axis units: the simulated motion with the nuisances."""
        d = self.data[k]
        motion = self.motion(model, vector, k)
        shift, zero = (model.nuisance(vector, n, d.name) for n in (SHIFT, ZERO))
        if not shift and len(motion.time) == len(d.time) and abs(motion.time[-1] - d.time[-1]) < 1e-3 * d.step:
            return motion.position + zero
        return motion.at(d.time - shift) + zero

    def _means(self, model: AxisModel, vector: np.ndarray, k: int) -> np.ndarray:
        return self.data[k].means(self.positions(model, vector, k))

    def map(self, jobs: Sequence) -> list:
        """Results of ``f(*arguments)`` for every job ``(f, *arguments)``, in order."""
        if self._pool is None:
            return [job[0](*job[1:]) for job in jobs]
        return list(self._pool.map(lambda job: job[0](*job[1:]), jobs))

    def residual(self, model: AxisModel, vector: np.ndarray) -> tuple[np.ndarray, ...]:
        """Measured less modelled block means of every recording."""
        modelled = self.map([(self._means, model, vector, k) for k in range(len(self.data))])
        return tuple(
            np.nan_to_num(np.clip(m - x, -_LOST, _LOST), nan=_LOST)
            for m, x in zip(self._measured, modelled, strict=True)
        )

    def touches(self, model: AxisModel, j: int, k: int) -> bool:
        """Whether an entry of the vector changes recording ``k``."""
        e, d = model.entries[j], self.data[k]
        if e.owner == CONTROLLER:
            return e.where == (d.test.controller or next(iter(model.machine.controllers)))
        if e.owner == PHASE:
            return e.where == d.test.setup
        return e.owner not in NUISANCES or e.where == d.name

    def columns(
        self, model: AxisModel, vector: np.ndarray, residual, entries=None, central: bool = False
    ) -> tuple[np.ndarray, ...]:
        """Derivatives of the modelled block means, (blocks, len(entries)) per recording.

        Args:
            model: What is free.
            vector: Where.
            residual: There.
            entries: Places in the vector; all by default.
            central: By differences to both sides: what the recordings cannot separate looks separable otherwise.
        """
        which = range(len(vector)) if entries is None else entries
        jobs = [(j, k) for j in which for k in range(len(self.data)) if self.touches(model, j, k)]

        def one(j: int, k: int) -> np.ndarray:
            moved = vector.copy()
            low, high = model.entries[j].bounds
            step = _STEP if vector[j] + _STEP <= high else -_STEP
            moved[j] = max(moved[j] + step, low)
            if central and low + _STEP < vector[j] < high - _STEP:
                other = vector.copy()
                other[j] -= step
                return (self._means(model, moved, k) - self._means(model, other, k)) / (2.0 * step)
            change = moved[j] - vector[j]
            return (self._means(model, moved, k) - (self._measured[k] - residual[k])) / change

        out = tuple(np.zeros((len(r), len(which))) for r in residual)
        at = {j: i for i, j in enumerate(which)}
        for (j, k), column in zip(jobs, self.map([(one, j, k) for j, k in jobs]), strict=True):
            out[k][:, at[j]] = np.nan_to_num(column)
        return out

    # -- fit -----------------------------------------------------------------------------------------------------------

    def independent(self, residual: Sequence[np.ndarray]) -> tuple[float, ...]:
        """Number of independent residuals per test."""
        pairs = zip(self.data, residual, strict=True)
        return tuple(independent_count(r, d.memory / (d.step * d.block)) for d, r in pairs)

    def weights(self, residual: Sequence[np.ndarray]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Number of independent residuals per test, and the weight of one block mean."""
        independent, weight = self.independent(residual), []
        for d, r, n in zip(self.data, residual, independent, strict=True):
            rms = max(float(np.sqrt(r @ r / len(r))), d.noise.rms)
            weight.append(float(np.sqrt(n / len(r)) / rms))
        return independent, tuple(weight)

    def evaluated(self, model: AxisModel) -> AxisFit:
        """A model as it stands, with the derivatives there."""
        residual = self.residual(model, model.vector)
        return AxisFit(model, residual, self.columns(model, model.vector, residual), *self.weights(residual))

    def polished(self, fit: AxisFit, steps: int = 2) -> AxisFit:
        """A fit after some Gauss-Newton steps with central derivatives, which it keeps.

        Along combinations that only the priors fix, one-sided derivatives lead astray.
        """
        for step in range(steps + 1):
            model, vector = fit.model, fit.model.vector
            design = self.columns(model, vector, fit.residual, central=True)
            fit = replace(fit, design=design)
            if step == steps:
                break
            deviation = np.array([e.deviation for e in model.entries])
            mean = np.array([e.mean for e in model.entries])
            low, high = np.array([e.bounds for e in model.entries]).T
            gradient = (mean - vector) / deviation**2
            for d, w, r in zip(design, fit.weight, fit.residual, strict=True):
                gradient = gradient + w * w * (d.T @ r)
            size = 1.0 / np.sqrt(np.maximum(np.diag(fit.precision), 1e-30))
            moved = size * np.linalg.lstsq(fit.precision * np.outer(size, size), gradient * size, rcond=1e-15)[0]
            trial = np.clip(vector + moved, low + 1e-9, high - 1e-9)
            residual = self.residual(model, trial)
            if self.cost(fit, residual, (trial - mean) / deviation) > self.cost(
                fit, fit.residual, (vector - mean) / deviation
            ):
                continue
            fit = replace(fit, model=model.with_values(trial), residual=residual)
        return fit

    @staticmethod
    def cost(fit: AxisFit, residual: Sequence[np.ndarray], departure: np.ndarray) -> float:
        """Squared weighted residuals and departures from the priors."""
        return float(sum(w * w * (r @ r) for w, r in zip(fit.weight, residual, strict=True)) + departure @ departure)

    def fit(self, model: AxisModel, rounds: int = 3, steps: int = 8) -> AxisFit:
        """Fit all entries of a model.

        Args:
            model: At its starting values.
            rounds: How often the weights are taken from the residuals.
            steps: Evaluations at most between.
        """
        from scipy.optimize import least_squares  # slow to load

        if not model.entries:
            residual = self.residual(model, model.vector)
            return AxisFit(model, residual, tuple(np.zeros((len(r), 0)) for r in residual), *self.weights(residual))
        deviation = np.array([e.deviation for e in model.entries])
        mean = np.array([e.mean for e in model.entries])
        low, high = np.array([e.bounds for e in model.entries]).T
        vector, last = np.clip(model.vector, low + 1e-9, high - 1e-9), np.inf
        residual = self.residual(model, vector)
        for _ in range(rounds):
            _, weight = self.weights(residual)
            size = np.concatenate([np.full(len(r), w) for w, r in zip(weight, residual, strict=True)])

            def whole(x: np.ndarray, size: np.ndarray = size) -> np.ndarray:
                return np.concatenate([np.concatenate(self.residual(model, x)) * size, (x - mean) / deviation])

            def slopes(x: np.ndarray, size: np.ndarray = size) -> np.ndarray:
                stacked = np.vstack(self.columns(model, x, self.residual(model, x)))
                return np.vstack([-stacked * size[:, None], np.diag(1.0 / deviation)])

            found = least_squares(
                whole,
                vector,
                slopes,  # pyright: ignore[reportArgumentType]
                (low, high),
                "trf",
                x_scale=1.0,
                max_nfev=steps,
                ftol=1e-4,
                xtol=1e-5,
            )
            vector = found.x
            residual = self.residual(model, vector)
            squares = float(sum(np.log(max(r @ r / len(r), 1e-30)) for r in residual))
            if abs(last - squares) < 0.01:
                break
            last = squares
        fitted = model.with_values(vector)
        return replace(self.evaluated(fitted))


def independent_count(residual: np.ndarray, memory: float) -> float:
    """Number of independent residuals that a correlated series (n,) is worth: n over its integrated correlation.

    Args:
        residual: (n,)
        memory: Number of samples beyond which a correlation belongs to what the model lacks, not to noise.
    """
    n = len(residual)
    r = residual - residual.mean()
    power = np.abs(np.fft.rfft(r, 2 * n)) ** 2
    correlation = np.fft.irfft(power)[:n]
    if correlation[0] <= 0.0:
        return float(n)
    correlation = correlation / correlation[0]
    below = np.flatnonzero(correlation < 0.05)
    end = int(below[0]) if len(below) else n
    return float(n / min(1.0 + 2.0 * correlation[1:end].sum(), max(memory, 1.0)))


def gain(less: AxisFit, more: AxisFit) -> float:
    """Twice the logarithm of the likelihood ratio of two fits, the noise of every test unknown."""
    ratios = np.log(np.maximum(less.mean_squares, 1e-30) / np.maximum(more.mean_squares, 1e-30))
    return float(np.array(more.independent) @ ratios)
