"""Nuisances fitted by plain least squares, for a model as it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjsim.inference.least_squares import LeastSquares
from mjsim.inference.problem import Problem

#: Successive blocks that make one independent value of the noise, and independent values of a model's failure in one
#: test.
_CORRELATED, _MISFIT_POINTS = 5.0, 50.0


def fit_nuisance(
    problem: Problem, readings: Sequence[np.ndarray], iterations: int = 12, begin: np.ndarray | None = None
) -> np.ndarray:
    """Least-squares nuisances for fixed simulated readings.

    Plain block means are fitted, not whitened ones: what is fitted here is what the eye would take out of the plots.
    Noise counts with its correlation. What the model fails to explain counts as a few independent points per test only,
    so that a wrong model does not drive the nuisances away from their priors. That failure is taken over all tests
    together (each test's own would let one test win and leave its twin to pay). A constant rest of a test says nothing
    about its trigger.

    Args:
        problem: The measured tests.
        readings: Simulated readings on the GRID, one per test, m.
        iterations: Gauss-Newton steps at most.
        begin: Nuisances to start from; all zero by default.

    Returns:
        The nuisances, (problem.nuisances.size,), in prior standard deviations.
    """
    p = problem.nuisances
    x = np.zeros(p.size) if begin is None else begin
    for _ in range(iterations):
        columns, rest = problem.nuisance_columns(readings, x), problem.residual(readings, x)
        noises = [problem.noise_of(k).block_rms for k in range(len(rest))]
        misfit = max(0.0, _spread(problem, rest) - float(np.sqrt(np.mean(np.square(noises)))))
        normal, gradient = np.zeros((p.size, p.size)), np.zeros(p.size)
        for c, r, s, t, noise in zip(columns, rest, problem.samples, problem.tests, noises, strict=True):
            c, r, at = c[s.good], r[s.good], p.of_test(t)
            c[:, -1] -= c[:, -1].mean()  # its trigger's
            weight = 1.0 / (_CORRELATED * noise**2 + max(1.0, len(r) / _MISFIT_POINTS) * misfit**2)
            normal[np.ix_(at, at)] += weight * c.T @ c
            gradient[at] += weight * c.T @ r
        step = LeastSquares(p, normal).step(gradient, x)
        x = x + step
        if np.abs(step).max() < 1e-3:
            break
    return x


def _spread(problem: Problem, rest: list[np.ndarray]) -> float:
    """Robust standard deviation of the residuals (m,) per test, over all tests, m."""
    good = [r[s.good] for r, s in zip(rest, problem.samples, strict=True)]
    spread = [float(np.median(np.abs(r - np.median(r)))) / 0.6745 for r in good]
    return float(np.sqrt(np.mean(np.square(spread))))
