"""Sums of numbers that the tests determine although they do not determine the numbers themselves.

Two location errors that every test sees as their sum have wide intervals each, and a narrow one together. All numbers
are compared in standard deviations of their priors.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings


@dataclass(frozen=True)
class Term:
    """One number of a sum.

    Attributes:
        effect_id: Of the effect that it belongs to.
        name: Of the parameter, with its unit.
        factor: How often it counts, in the unit of the first number over its own.
    """

    effect_id: str
    name: str
    factor: float


@dataclass(frozen=True)
class Combination:
    """A sum of numbers, in the unit of its first one, whose factor is 1.

    Attributes:
        terms: The numbers.
        value: The sum.
        ci95: Its 95 % interval.
    """

    terms: tuple[Term, ...]
    value: float
    ci95: tuple[float, float]


def combinations(
    fit: Fit, settings: DiagnosisSettings = DIAGNOSIS, wanted: Mapping[str, float] | None = None
) -> tuple[Combination, ...]:
    """Sums of the single numbers with a prior that a fit determines, the best determined first.

    Effects with several numbers, as straightness errors, take part where angular errors are fitted: at one place of the
    ball these are the same.

    Args:
        fit: A finished fit.
        settings: What counts as open and as determined.
        wanted: Standard deviation to compare with in place of the prior's, by key of the effect, in typical sizes.
            Effects that it does not name are left out.
    """
    from scipy.sparse.csgraph import connected_components  # slow to load

    several = any(f.effect.search.within_tolerance for f in fit.effects)
    index = np.arange(fit.parameters.size)
    free: list[tuple[EffectVector, str]] = []
    place: list[int] = []
    deviation: list[float] = []
    for f in fit.effects:
        if f.prior is None or (wanted is not None and f.effect.key not in wanted):
            continue
        if f.polar or f.names == ("components",) or (len(f.names) > 1 and not several):
            continue
        for name, at, own in zip(f.names, index[fit.parameters[f.block.name]], f.prior[1], strict=True):
            if not f.specs[name].inverse:
                free.append((f, name))
                place.append(int(at))
                deviation.append(float(own) if wanted is None else wanted[f.effect.key])
    if len(free) < 2:
        return ()
    at, prior = np.array(place), np.array(deviation)
    covariance = fit.covariance[np.ix_(at, at)] / np.outer(prior, prior)
    width = np.sqrt(np.diag(covariance))
    tied = np.abs(covariance / np.outer(width, width)) > settings.tied_numbers
    is_open = width > settings.open_number
    _, label = connected_components(tied & is_open[:, None] & is_open, directed=False)
    found = []
    for group in (np.flatnonzero((label == n) & is_open) for n in np.unique(label)):
        if len(group) > 1:
            found += list(
                _determined([free[i] for i in group], covariance[np.ix_(group, group)], prior[group], settings)
            )
    return tuple(c for _, c in sorted(found, key=lambda row: row[0]))


def _determined(
    free: list[tuple[EffectVector, str]], covariance: np.ndarray, prior: np.ndarray, settings: DiagnosisSettings
) -> Iterator[tuple[float, Combination]]:
    """The sums of one group that are determined, each with its width in prior standard deviations."""
    for direction in np.linalg.eigh(covariance)[1].T:
        factor = np.where(np.abs(direction) < settings.least_factor * np.abs(direction).max(), 0.0, direction)
        factor /= np.linalg.norm(factor)
        width, used = float(np.sqrt(factor @ covariance @ factor)), np.flatnonzero(factor)
        alone = np.sqrt(np.diag(covariance)[used]).min()
        if len(used) > 1 and width < min(settings.determined_sum, settings.narrower_sum * alone):
            yield width, _in_units([free[i] for i in used], factor[used] / prior[used], width)


def _in_units(free: list[tuple[EffectVector, str]], factor: np.ndarray, width: float) -> Combination:
    """A sum of numbers of effects, (n,) ``factor`` each, in the units of their parameters."""
    scale = np.array([f.specs[name].scale for f, name in free])
    of_number = factor / scale
    first = int(np.argmax(np.abs(factor)))
    of_number, unit = of_number / of_number[first], 1.0 / of_number[first]
    order = sorted(range(len(free)), key=lambda i: i != first)
    terms = tuple(Term(free[i][0].effect.id, free[i][1], float(of_number[i])) for i in order)
    value = float(sum(t.factor * free[i][0].effect.values[t.name] for t, i in zip(terms, order, strict=True)))
    half = 1.96 * width * abs(unit)
    return Combination(terms, value, (value - half, value + half))
