"""Triggers that stand in a false minimum: a fit moves along slopes, and sharp marks such as reversals have none far
from their place.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjsim.estimation.fit import Fit
from mjsim.estimation.nuisance import TRIGGERS
from mjsim.estimation.problem import Problem

#: Triggers that are tried, prior standard deviations: 3 ms apart, within the shift that is believed.
_TRIED = np.linspace(-3.9, 3.9, 53)
#: Share of a test's squared residual that another trigger has to take away (assumed).
_WON = 0.3
#: Tests whose residual is so near to the noise are not looked at (assumed).
_GOOD = 1.2
#: Nearer than this the fit finds the place itself, prior standard deviations.
_NEAR = 0.3


def retimed(problem: Problem, fit: Fit) -> Fit | None:
    """The fit with better triggers, to start from again; ``None`` where each stands in its best place.

    Args:
        problem: The measured tests.
        fit: A fit of them.
    """
    at = problem.nuisances[TRIGGERS]
    rests = problem.residual(list(fit.readings), fit.nuisance)
    size = np.array([np.sqrt(np.mean(r[s.good] ** 2)) for r, s in zip(rests, problem.samples, strict=True)])
    poor = np.flatnonzero(size > _GOOD * problem.noise.block_rms)
    if not len(poor):
        return None
    tried = np.array([_left(problem, fit, np.full(len(problem.tests), trigger), poor) for trigger in _TRIED])
    now, least, best = _left(problem, fit, fit.nuisance[at], poor), tried.min(axis=0), _TRIED[tried.argmin(axis=0)]
    nuisance = fit.nuisance.copy()
    triggers = nuisance[at]
    better = (least < (1.0 - _WON) * now) & (np.abs(best - triggers[poor]) > _NEAR)
    if not better.any():
        return None
    triggers[poor[better]] = best[better]
    nuisance[at] = triggers
    return replace(fit, nuisance=nuisance)


def _left(problem: Problem, fit: Fit, triggers: np.ndarray, tests: np.ndarray) -> np.ndarray:
    """Squared residual of some tests at these triggers of all tests, once the set-up has taken up what it can."""
    nuisance = fit.nuisance.copy()
    nuisance[problem.nuisances[TRIGGERS]] = triggers
    readings = list(fit.readings)
    rests, columns = problem.residual(readings, nuisance), problem.nuisance_columns(readings, nuisance)
    out = []
    for k in tests:
        good = problem.samples[k].good
        r, slow = rests[k][good], np.delete(columns[k], -1, axis=1)[good]  # all but the trigger's own
        out.append(float(np.sum((r - slow @ np.linalg.lstsq(slow, r, rcond=1e-10)[0]) ** 2)))
    return np.array(out)
