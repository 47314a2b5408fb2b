"""What a fit leaves uncertain: the effects that it fitted and the covariance of their entries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, chain, pairwise

import numpy as np

from mjsim.inference.data_sheet import DATA_SHEET
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.machine.model import Machine


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
