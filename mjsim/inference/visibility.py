"""What of a reading's parts stands out: beside the set-up's errors, and of the noise."""

from __future__ import annotations

import numpy as np

from mjsim.inference.fit import Fit
from mjsim.inference.least_squares import LeastSquares
from mjsim.inference.problem import Problem
from mjsim.machine.model import build


def clear_tests(problem: Problem, fit: Fit, key: str) -> tuple[str, ...]:
    """Names of the tests in which an effect's part of the reading stands out of the noise.

    A set-up error that takes some of it up in one test moves the others of that set-up as well. These show nothing of
    the effect: its own part has to stand out too. Significance alone would name what nobody needs to know. A set-up
    error takes up no more than is believed of it: three spindle balls that stand off alike by many times their
    uncertainty are a rotary axis that stands off.

    Args:
        problem: The measured tests.
        fit: The model, the effect included.
        key: Of the effect.
    """
    without = fit.machine.without(key)
    stated = fit.base.effect(key)
    if stated is not None:
        without = without.with_effect(stated)
    parts = problem.difference(problem.readings(build(without)), fit.readings, fit.nuisance)
    left = unabsorbed(problem, fit, parts, problem.settings.setup_limit)
    share = problem.settings.visible_share
    good = [s.good for s in problem.samples]
    return tuple(
        t.name
        for k, (t, ok, *both) in enumerate(zip(problem.tests, good, parts, left, strict=True))
        if min(np.std(p[ok]) for p in both) > share * problem.noise_of(k).rms
    )


def unabsorbed(problem: Problem, fit: Fit, parts: list[np.ndarray], limit: float = np.inf) -> list[np.ndarray]:
    """What the nuisances of the set-up cannot take up of a reading's parts (block means per test, m).

    Args:
        problem: The measured tests.
        fit: The fitted model.
        parts: Of the reading, (m,) per test, m.
        limit: Largest value of a nuisance, prior standard deviations.
    """
    n = fit.nuisances
    design = fit.design.of_nuisances
    taken = np.clip(LeastSquares.of_design(n, design).solve(design.T @ problem.whiten(parts)), -limit, limit)
    columns = problem.nuisance_columns(fit.readings, fit.nuisance)
    return [d - c @ taken[n.of_test(t)] for d, c, t in zip(parts, columns, problem.tests, strict=True)]
