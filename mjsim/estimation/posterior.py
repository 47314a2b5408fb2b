"""What a fit leaves uncertain: the effects that it fitted and the covariance of their entries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.estimation.data_sheet import DATA_SHEET
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fit
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

    def within(self, machine: Machine) -> Posterior:
        """What it says of the effects that a machine has."""
        kept: list[int] = []
        effects: list[EffectVector] = []
        at = 0
        for f in self.effects:
            places = range(at, at + len(f.vector))
            at = places.stop
            if (present := machine.effect(f.effect.key)) is not None:
                kept += places
                effects.append(EffectVector(present, f.names))
        kept += range(at, len(self.covariance))
        return Posterior(tuple(effects), self.covariance[np.ix_(kept, kept)])
