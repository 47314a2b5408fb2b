"""Damped Gauss-Newton descent for residuals of recordings whose noise is unknown.

The objective is the sum over the recordings of n log(mean square), n the number of independent residuals, and of the
squared departures from the priors. Its Gauss-Newton steps are those of least squares with the weights of the present
residuals; they are damped as by Levenberg and Marquardt, and derivatives that predicted a step well are carried on by
Broyden's rule. (``scipy.optimize.least_squares`` has fixed weights, and takes new derivatives at every step.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

#: A descent ends where the objective falls by less, or at this damping.
FALL, _STUCK = 0.05, 1e5
#: Share of a change of the residuals by which the derivatives may miss it and be kept, and how often in a row.
_PREDICTED, _KEPT = 0.2, 4

Residuals = Sequence[np.ndarray]


@dataclass(frozen=True)
class Priors:
    """Priors and bounds of a vector, (p,) each.

    Attributes:
        mean: Prior means.
        deviation: Prior standard deviations; infinite: none.
        low: Least values.
        high: Largest values.
        largest: Longest steps.
        centre: Means of what is known of several entries together.
        coupling: What that adds to the precision of the deviations, (p, p).
    """

    mean: np.ndarray
    deviation: np.ndarray
    low: np.ndarray
    high: np.ndarray
    largest: np.ndarray
    centre: np.ndarray
    coupling: np.ndarray

    @property
    def precision(self) -> np.ndarray:
        """Inverse covariance, (p, p)."""
        return np.diag(self.deviation**-2.0) + self.coupling

    def squares(self, vector: np.ndarray) -> float:
        """Sum of the squared departures of a vector, in standard deviations."""
        departure, off = (vector - self.mean) / self.deviation, vector - self.centre
        return float(departure @ departure + off @ self.coupling @ off)

    def pull(self, vector: np.ndarray) -> np.ndarray:
        """Half the fall of :meth:`squares` per unit, (p,)."""
        return (self.mean - vector) / self.deviation**2 + self.coupling @ (self.centre - vector)

    def inside(self, vector: np.ndarray) -> np.ndarray:
        """A vector within its bounds."""
        return np.clip(vector, self.low + 1e-9, self.high - 1e-9)

    def room(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest steps from a vector."""
        low, high = np.minimum(self.low + 1e-9 - vector, 0.0), np.maximum(self.high - 1e-9 - vector, 0.0)
        return np.maximum(low, -self.largest), np.minimum(high, self.largest)


@dataclass(frozen=True)
class Descended:
    """Where a descent ended.

    Attributes:
        vector: (p,)
        residual: There, (n,) per recording.
        design: Derivatives of the modelled values at one of the last points, (n, p) per recording.
    """

    vector: np.ndarray
    residual: Residuals
    design: tuple[np.ndarray, ...]


def mean_logs(residual: Residuals, noise: Sequence[float]) -> np.ndarray:
    """Logarithm of the mean square of every recording's residual, never below that of its noise."""
    return np.log(np.array([max(float(r @ r) / len(r), rms**2) for r, rms in zip(residual, noise, strict=True)]))


def descend(
    begin: Descended,
    priors: Priors,
    count: Sequence[float],
    noise: Sequence[float],
    residual_of: Callable[[np.ndarray], Residuals],
    columns_of: Callable[[np.ndarray, Residuals], tuple[np.ndarray, ...]],
    steps: int,
    least: float = FALL,
    renew: bool = True,
) -> Descended:
    """Lower the objective from a point on.

    Args:
        begin: Where to start. Its derivatives serve for the first steps where it has any.
        priors: Of the vector.
        count: Number of independent residuals per recording.
        noise: RMS of each recording's noise.
        residual_of: Measured less modelled values at a vector.
        columns_of: Derivatives of the modelled values at a vector, whose residuals are given as well.
        steps: At most so many steps.
        least: It ends where the objective falls by less in one.
        renew: Take new derivatives where those that were carried on fail. Without, a step is only made shorter.
    """
    n = np.array(count)

    def objective(x: np.ndarray, rest: Residuals) -> float:
        return float(n @ mean_logs(rest, noise)) + priors.squares(x)

    vector, residual, design = begin.vector, begin.residual, begin.design
    now, damping, well = objective(vector, residual), 1e-3, True
    kept = 1 if design and all(d.shape[1] == len(vector) for d in design) else _KEPT
    for _ in range(steps):
        if kept >= _KEPT and renew:
            design, kept = columns_of(vector, residual), 0
        weight = np.sqrt(n / np.exp(mean_logs(residual, noise)) / [len(r) for r in residual])
        normal, gradient = priors.precision, priors.pull(vector)
        for w, d, r in zip(weight, design, residual, strict=True):
            normal = normal + (w * d).T @ (w * d)
            gradient = gradient + w * w * (d.T @ r)
        fall, step = 0.0, np.zeros(len(vector))
        while damping < _STUCK and not fall:
            step = bounded_step(normal, gradient, damping, *priors.room(vector))
            rest = residual_of(vector + step)
            value = objective(vector + step, rest)
            if value < now:
                fall, now = now - value, value
                design, well = _broyden(design, step, residual, rest, weight)
                kept = kept + 1 if well else _KEPT
                vector, residual, damping = vector + step, rest, max(0.1 * damping, 1e-9)
            elif kept and renew:
                break
            else:
                damping *= 10.0
        if fall < least:
            if not kept or (fall and well) or not renew:
                break
            kept = _KEPT  # the derivatives were carried on: try new ones before giving up
    return Descended(vector, residual, design)


def _broyden(
    design: tuple[np.ndarray, ...], step: np.ndarray, before: Residuals, after: Residuals, weight: np.ndarray
) -> tuple[tuple[np.ndarray, ...], bool]:
    """Derivatives that give the change that a step made, and whether the former ones gave nearly that."""
    out, missed, moved = [], 0.0, 0.0
    for d, a, b, w in zip(design, before, after, weight, strict=True):
        miss = (a - b) - d @ step
        missed, moved = missed + w * w * (miss @ miss), moved + w * w * ((a - b) @ (a - b))
        out.append(d + np.outer(miss, step / max(step @ step, 1e-30)))
    return tuple(out), missed < _PREDICTED**2 * moved


def bounded_step(
    normal: np.ndarray, gradient: np.ndarray, damping: float, least: np.ndarray, most: np.ndarray
) -> np.ndarray:
    """A damped Gauss-Newton step (p,); entries that would leave their bounds stop there, the others go on.

    Args:
        normal: Normal matrix with the priors, (p, p).
        gradient: Half the fall of the objective per unit, (p,).
        damping: Of Levenberg and Marquardt.
        least: Smallest steps allowed, (p,).
        most: Largest.
    """
    step, free = np.zeros(len(gradient)), np.ones(len(gradient), bool)
    while free.any():
        right = gradient - normal @ np.where(free, 0.0, step)
        inner = normal[np.ix_(free, free)]
        size = 1.0 / np.sqrt(np.maximum(np.diag(inner), 1e-30))
        scaled = inner * np.outer(size, size) + damping * np.eye(int(free.sum()))
        step[free] = size * np.linalg.lstsq(scaled, right[free] * size, rcond=1e-14)[0]
        beyond = free & ((step < least) | (step > most))
        if not beyond.any():
            break
        step = np.clip(step, least, most)
        free = free & ~beyond
    return step
