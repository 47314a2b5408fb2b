"""Triggers that stand in a false minimum: a fit moves along slopes, and sharp marks such as reversals have none far
from their place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjsim.inference.fit import Fit
from mjsim.inference.nuisance import TRIGGERS
from mjsim.inference.nuisance_fit import fit_nuisance
from mjsim.inference.problem import Problem

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


def retimed(problem: Problem, fit: Fit) -> Fit | None:
    """The fit with better triggers, to start from again; ``None`` where each stands in its best place.

    Args:
        problem: The measured tests.
        fit: A fit of them.
    """
    nuisance = better_triggers(problem, fit.readings, fit.nuisance)
    return None if nuisance is None else replace(fit, nuisance=nuisance)


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
