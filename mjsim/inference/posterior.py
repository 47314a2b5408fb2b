"""What a fit leaves uncertain: the effects that it fitted and the covariance of their entries, the probability that a
number lies beyond its limit (JCGM 106), and models that the data cannot tell from each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, chain, pairwise

import numpy as np
from scipy.special import erfc

from mjsim.inference.data_sheet import DATA_SHEET
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.machine.model import Machine

#: Points of the normal distribution by which sizes of waves are judged.
_DRAWS = 2000


def beyond(off: np.ndarray, covariance: np.ndarray, limit: float) -> float:
    """Probability that a number, or the size of a wave, is farther than a limit from what is expected.

    Args:
        off: Departure from what is expected, (1,), or of a wave its cosine and sine, (2,).
        covariance: Of that, (n, n).
        limit: Largest departure allowed.
    """
    if len(off) == 2:
        return _radius_beyond(off, covariance, limit)
    x, sd = float(off[0]), math.sqrt(max(float(covariance[0, 0]), 1e-30))
    return min(
        0.5 * float(erfc((limit - x) / sd / math.sqrt(2)) + erfc((limit + x) / sd / math.sqrt(2))),
        1.0,
    )


def _radius_beyond(centre: np.ndarray, covariance: np.ndarray, limit: float) -> float:
    """Probability that a point of the plane with this normal distribution is farther than ``limit`` from the origin."""
    share = (np.arange(_DRAWS) + 0.5) / _DRAWS
    radius, angle = np.sqrt(-2.0 * np.log(share)), 2.0 * np.pi * np.arange(_DRAWS) * 0.6180339887498949
    values, vectors = np.linalg.eigh(covariance)
    points = vectors * np.sqrt(np.maximum(values, 0.0)) @ np.vstack([radius * np.cos(angle), radius * np.sin(angle)])
    return float(np.mean(np.hypot(*(centre[:, None] + points)) > limit))


@dataclass(frozen=True)
class Posterior:
    """Joint normal distribution of everything that was fitted about the machine.

    Attributes:
        effects: Fitted effects at their estimates.
        covariance: Of their entries one after the other, then of the data sheet in standard deviations of its
            tolerances, (k + sheet, k + sheet).
    """

    effects: tuple[EffectVector, ...]
    covariance: np.ndarray

    @classmethod
    def of(cls, fit: Fit) -> Posterior:
        """The posterior of a finished fit; set-up and instrument are marginalised."""
        places = fit.parameters.places(*(f.block.name for f in fit.effects), DATA_SHEET)
        return cls(tuple(fit.effects), fit.covariance[np.ix_(places, places)])

    @property
    def blocks(self) -> list[tuple[EffectVector, range]]:
        """Every effect, with the places of its entries."""
        ends = accumulate((len(f.vector) for f in self.effects), initial=0)
        return [(f, range(a, b)) for f, (a, b) in zip(self.effects, pairwise(ends), strict=True)]

    @property
    def sheet(self) -> range:
        """Places of the data sheet."""
        return range(sum(len(f.vector) for f in self.effects), len(self.covariance))

    def part(self, places: Sequence[int]) -> np.ndarray:
        """Covariance of some entries, (n, n)."""
        return self.covariance[np.ix_(places, places)]

    def interval_of(self, key: str) -> dict:
        """95 % intervals of one effect, by parameter; empty where it was not fitted."""
        return next((f.interval(f.vector, self.part(at)) for f, at in self.blocks if f.effect.key == key), {})

    def within(self, machine: Machine) -> Posterior:
        """What it says of the effects that a machine has."""
        kept = [(f, at) for f, at in self.blocks if machine.effect(f.effect.key) is not None]
        effects = (f.with_effect(machine.effect(f.effect.key) or f.effect) for f, _ in kept)
        return Posterior(tuple(effects), self.part([*chain.from_iterable(at for _, at in kept), *self.sheet]))


@dataclass(frozen=True)
class CompetingModel:
    """One explanation of the ball-bar tests.

    Attributes:
        effect_id: Id of the effect that it has in the place of another one.
        machine: With the fitted effects and the calibrated data sheet.
        posterior: What the tests leave uncertain about it.
        evidence: Log evidence of the tests with it, prior odds included, but for what all have in common.
    """

    effect_id: str
    machine: Machine
    posterior: Posterior
    evidence: float

    @classmethod
    def of(cls, effect_id: str, fit: Fit, evidence: float = 0.0) -> CompetingModel:
        """From a finished fit."""
        return cls(effect_id, fit.machine, Posterior.of(fit), evidence)
