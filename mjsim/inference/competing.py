"""Models that the ball-bar tests cannot tell from each other, as another instrument needs them to decide."""

from __future__ import annotations

from dataclasses import dataclass

from mjsim.inference.fit import Fit
from mjsim.inference.posterior import Posterior
from mjsim.machine.model import Machine


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
