"""Nuisances by plain least squares, for a model as it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mjsim.estimation.problem import Problem

#: Successive blocks that make one independent value of the noise, and independent values of a model's failure in one test.
_CORRELATED, _MISFIT_POINTS = 5.0, 50.0
#: Triggers are not believed further from their prior than this, standard deviations: a model that fails badly would drive them out of
#: the range in which they act linearly.
TRIGGER_LIMIT = 4.0


def fit_nuisance(problem: Problem, readings: list[np.ndarray], iterations: int = 12) -> np.ndarray:
    """Least-squares nuisances (layout.size,) in prior standard deviations, for fixed simulated readings on the GRID.

    Plain block means, not whitened ones: what is fitted here is what the eye would take out of the plots. Noise counts with its
    correlation; what the model fails to explain counts as a few independent points per test only, so that a wrong model does not
    drive the nuisances away from their priors. That failure is taken over all tests together (each test's own would let one test
    win and leave its twin to pay), and a constant rest of a test says nothing about its trigger.
    """
    x = np.zeros(problem.layout.size)
    first = problem.layout.length + 1
    for _ in range(iterations):
        columns, rest = problem.nuisance_columns(readings, x), problem.residual(readings, x)
        spread = [float(np.median(np.abs(r[s.good] - np.median(r[s.good])))) / 0.6745 for r, s in zip(rest, problem.samples, strict=True)]
        misfit = max(0.0, float(np.sqrt(np.mean(np.square(spread)))) - problem.noise.block_rms)
        A, b = np.zeros((len(x), len(x))), np.zeros(len(x))
        for c, r, s, t in zip(columns, rest, problem.samples, problem.tests, strict=True):
            c, r, at = c[s.good], r[s.good], problem.layout.of(t)
            c[:, 7] -= c[:, 7].mean()  # its trigger's
            weight = 1.0 / (_CORRELATED * problem.noise.block_rms**2 + max(1.0, len(r) / _MISFIT_POINTS) * misfit**2)
            A[np.ix_(at, at)] += weight * c.T @ c
            b[at] += weight * c.T @ r
        step = _bounded(A + np.eye(len(x)), b - x, x, first)
        x = x + step
        if np.abs(step).max() < 1e-3:
            break
    return x


def _bounded(A: np.ndarray, b: np.ndarray, x: np.ndarray, first: int) -> np.ndarray:
    """The step that solves ``A step = b`` with the triggers, which are ``x[first:]``, kept within their limit."""
    step = np.zeros(len(x))
    free = np.ones(len(x), bool)
    for _ in range(len(x)):
        rest = b[free] - A[np.ix_(free, ~free)] @ step[~free]
        step[free] = np.linalg.solve(A[np.ix_(free, free)], rest)
        over = free & (np.arange(len(x)) >= first) & (np.abs(x + step) > TRIGGER_LIMIT)
        if not over.any():
            break
        step[over] = np.clip((x + step)[over], -TRIGGER_LIMIT, TRIGGER_LIMIT) - x[over]
        free &= ~over
    return step
