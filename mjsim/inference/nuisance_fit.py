"""Nuisances fitted by plain least squares, for a model as it is.

A trigger may stand in a false minimum: a fit moves along slopes, and sharp marks such as reversals have none far from
their place. Others are tried there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjsim.inference.least_squares import LeastSquares
from mjsim.inference.nuisance import TRIGGERS
from mjsim.inference.problem import Problem

#: Successive blocks that make one independent value of the noise, and independent values of a model's failure in one
#: test.
_CORRELATED, _MISFIT_POINTS = 5.0, 50.0
#: Triggers that are tried, prior standard deviations: 3 ms apart, within the shift that is believed.
_TRIED = np.linspace(-3.9, 3.9, 53)
#: Share of a test's squared residual that another trigger has to take away (assumed).
_WON = 0.3
#: Tests whose residual is so near to the noise are not looked at (assumed).
_GOOD = 1.2
#: Nearer than this the fit finds the place itself, prior standard deviations.
_NEAR = 0.3
#: Share of the tests up to which a wrong trigger, not a wrong model, may be why they are not met (assumed).
_FEW = 1.0 / 3.0


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


def fit_nuisance_retimed(
    problem: Problem, readings: Sequence[np.ndarray], begin: np.ndarray | None = None
) -> np.ndarray:
    """Least-squares nuisances as of :func:`fit_nuisance`, with other triggers where a few tests alone are not met."""
    nuisance = fit_nuisance(problem, readings, begin=begin)
    better = better_triggers(problem, readings, nuisance, _FEW)
    return nuisance if better is None else fit_nuisance(problem, readings, begin=better)


def better_triggers(
    problem: Problem, readings: Sequence[np.ndarray], nuisance: np.ndarray, largest_share: float = 1.0
) -> np.ndarray | None:
    """Nuisances with better triggers, to start from again; ``None`` where each stands in its best place.

    Args:
        problem: The measured tests.
        readings: Simulated readings on the GRID, one per test, m.
        nuisance: (problem.nuisances.size,) in prior standard deviations.
        largest_share: Nothing is looked for where a larger share of the tests is not met: their model is wrong.
    """
    rests = problem.residual(list(readings), nuisance)
    size = np.array([np.sqrt(np.mean(r[s.good] ** 2)) for r, s in zip(rests, problem.samples, strict=True)])
    noise = np.array([problem.noise_of(k).block_rms for k in range(len(size))])
    poor = np.flatnonzero(size > _GOOD * noise).tolist()
    if not len(poor) or len(poor) > largest_share * len(size):
        return None
    at = [problem.nuisances.place(TRIGGERS, problem.tests[k].recording) for k in poor]
    better = [_better_trigger(problem, k, readings[k], nuisance) for k in poor]
    if all(trigger is None for trigger in better):
        return None
    out = nuisance.copy()
    out[at] = [nuisance[i] if trigger is None else trigger for i, trigger in zip(at, better, strict=True)]
    return out


def _better_trigger(problem: Problem, k: int, reading: np.ndarray, nuisance: np.ndarray) -> float | None:
    """A trigger of test ``k`` that leaves clearly less than the present one; ``None`` where none does."""
    now = problem.nuisances.of_test(problem.tests[k])[-1]
    left = np.array([_left(problem, k, reading, nuisance, t) for t in (float(nuisance[now]), *_TRIED.tolist())])
    best = _TRIED[left[1:].argmin()]
    won = left.min() < (1.0 - _WON) * left[0] and abs(best - nuisance[now]) > _NEAR
    return float(best) if won else None


def _left(problem: Problem, k: int, reading: np.ndarray, nuisance: np.ndarray, trigger: float) -> float:
    """Squared residual of test ``k`` at a trigger, once the set-up has taken up what it can."""
    moved, s = nuisance.copy(), problem.samples[k]
    moved[problem.nuisances.place(TRIGGERS, problem.tests[k].recording)] = trigger
    rest = (s.mean - problem.modelled_test(k, reading, moved))[s.good]
    columns = problem.nuisance_columns_of_test(k, reading, moved)[s.good]
    slow = np.delete(columns, -1, axis=1)  # all but the trigger's own
    return float(np.sum((rest - slow @ np.linalg.lstsq(slow, rest, rcond=1e-10)[0]) ** 2))
