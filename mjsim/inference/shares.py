"""What each effect of a fitted model does to the readings beside the set-up's errors: its RMS, its share of the
explained squared error, and the tests in which it stands out of the noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjsim.inference.calibration import Calibrated
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.inference.least_squares import LeastSquares
from mjsim.inference.linearisation import Linearisation
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


@dataclass(frozen=True)
class Calibration:
    """One calibrated effect.

    Attributes:
        effect: With its fitted values, and which of them were fitted.
        ci95: 95 % intervals, in the units of the names.
        limit: Limit of its size, in the unit of its leading parameter.
        observable: Whether the tests say more about it than the tolerance does.
        rms: RMS over all tests of what it changes in the readings once the set-up is fitted, m.
    """

    effect: EffectVector
    ci95: dict
    limit: float
    observable: bool
    rms: float


def parts_of(problem: Problem, fit: Fit) -> dict[str, np.ndarray]:
    """What each effect adds to the block means of all tests that the set-up cannot take up, by key, (m,) each, m."""
    linearisation = Linearisation(problem, fit.machine, fit.nuisance)
    out = {}
    for f in fit.effects:
        columns = linearisation.columns(f)
        if columns is not None:
            parts = [c @ (f.vector - f.off) for c in columns]
        else:
            without = fit.machine.with_effect(f.at(f.off))
            parts = problem.difference(problem.readings(build(without)), fit.readings, fit.nuisance)
        left = unabsorbed(problem, fit, parts)
        out[f.effect.key] = np.concatenate([p[s.good] for p, s in zip(left, problem.samples, strict=True)])
    return out


def calibrations(
    parts: Mapping[str, np.ndarray], fit: Fit, calibrated: Sequence[Calibrated], observable: float
) -> tuple[tuple[Calibration, ...], dict[str, float]]:
    """The calibration table of a fitted model, and every effect's share of the explained squared error.

    Args:
        parts: What each effect adds to the readings that the set-up cannot take up, by key, (m,) m.
        fit: The final model.
        calibrated: Its effects that stay inside their tolerance.
        observable: Share of the prior's standard deviation below which a number is known from the tests.

    Returns:
        One entry per calibrated effect, and shares that sum to 1: of each finding by its key, and of the calibrated
        effects together by ``kind.*``.
    """
    expected = {c.key: c for c in calibrated}
    entries = []
    shares: dict[str, float] = {}
    total = sum(parts.values())
    for f in fit.effects:
        key = f.effect.key
        name = f"{f.effect.kind}.*" if key in expected else key
        shares[name] = shares.get(name, 0.0) + max(0.0, float(parts[key] @ total))
        if key not in expected:
            continue
        covariance = fit.covariance_of(f)
        _, allowed = f.prior or (None, expected[key].deviation)
        ratio = np.sqrt(np.diag(covariance)) / allowed
        entries.append(
            Calibration(
                f,
                f.interval(f.vector, covariance),
                next(iter(expected[key].limits.values())),
                bool(ratio.min() < observable),
                float(np.sqrt(np.mean(parts[key] ** 2))),
            )
        )
    whole = sum(shares.values()) or 1.0
    ranked = sorted(shares.items(), key=lambda item: -item[1])
    return tuple(entries), {name: value / whole for name, value in ranked}
