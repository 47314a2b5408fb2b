"""What happened once in a measurement is left out: spikes, and what a knock has moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjsim.estimation.jumps import largest_jump, leave_out_shorter_side
from mjsim.estimation.nuisance import AFTER_KNOCK
from mjsim.estimation.nuisance_fit import fit_nuisance
from mjsim.estimation.outliers import mark_outliers, readmit_outliers
from mjsim.estimation.problem import Problem


def without_disturbances(
    problem: Problem, readings: Sequence[np.ndarray], nuisance: np.ndarray | None = None
) -> Problem:
    """The problem without what happened once; the same one where there is nothing of that kind.

    The waves of a worm gear hide a knock. So it is worth to look again once a model follows them: what was found before
    stays left out.

    Args:
        problem: The measured tests.
        readings: Simulated readings on the GRID, one per test, m: of the machine as given, or of a fitted model.
        nuisance: Of the fitted model; fitted to the readings where it is missing.
    """
    rest = problem.sample_residuals(readings, fit_nuisance(problem, readings) if nuisance is None else nuisance)
    samples = [s.copy() for s in problem.samples]
    tests, events = list(problem.tests), {t.name: 0 for t in problem.tests}
    noise, settings = [problem.noise_of(k).rms for k in range(len(samples))], problem.settings.outliers
    for s, r, n in zip(samples, rest, noise, strict=True):
        events[s.test.name] = mark_outliers(s, r, n, settings)
    for _ in range(settings.most_events):
        found = {k: largest_jump(s, rest[k], noise[k], settings) for k, s in enumerate(samples)}
        jumps = {k: at for k, at in found.items() if at is not None}
        accidents = [k for k in jumps if not _jumps_elsewhere(problem, jumps, k)]
        for k in accidents:
            if leave_out_shorter_side(samples[k], jumps[k], rest[k], settings):  # the ball sits anew in what is kept
                tests[k] = replace(tests[k], setup=f"{tests[k].name} {AFTER_KNOCK}")
            events[tests[k].name] += 1
        if not accidents:
            break
    if not any(events.values()):
        return problem
    events = {name: count + problem.outliers.get(name, 0) for name, count in events.items()}
    return problem.with_samples(samples, tuple(tests), events).with_noise_of_samples()


def readmitted(problem: Problem, readings: Sequence[np.ndarray], nuisance: np.ndarray) -> Problem:
    """The problem with those disturbances counted again that a fitted model follows; the same one where there are none.

    Fits made before have other rows then.

    Args:
        problem: The measured tests without disturbances.
        readings: Simulated readings of the fitted model on the GRID, one per test, m.
        nuisance: Its nuisances.
    """
    samples, events = [s.copy() for s in problem.samples], dict(problem.outliers)
    found = 0
    rest = problem.sample_residuals(readings, nuisance)
    for k, (s, r) in enumerate(zip(samples, rest, strict=True)):
        back = readmit_outliers(s, s.given, r, problem.noise_of(k).rms, problem.settings.outliers)
        events[s.test.name] = max(0, events[s.test.name] - back)
        found += back
    return problem.with_samples(samples, problem.tests, events) if found else problem


def _jumps_elsewhere(problem: Problem, jumps: dict[int, int], k: int) -> bool:
    """Whether another test jumps at the same position of a rotary axis that moves there: then it is no accident."""
    motion = problem.motions[k]
    columns = motion.test.chain.rotary_columns

    def place(j: int) -> np.ndarray:
        return problem.motions[j].program.commands(problem.samples[j].time[[jumps[j]]])[0, columns]

    moving, near = motion.moves[columns], problem.settings.outliers.same_place
    return any(j != k and (moving & (np.abs(place(j) - place(k)) < near)).any() for j in jumps)
