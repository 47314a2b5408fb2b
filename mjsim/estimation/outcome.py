"""What a model selection returns: the model, its findings, and what else was tried."""

from __future__ import annotations

from dataclasses import dataclass, field

from mjsim.estimation.curve_terms import CurveTerm
from mjsim.estimation.fit import Fit
from mjsim.estimation.signatures import SignatureBank


@dataclass(frozen=True)
class Found:
    """One missing effect of the final model.

    Attributes:
        key: Of the effect.
        gain: How far the objective falls with it.
        competing: Models with another effect in its place that the data cannot tell from it, by that effect's id.
        rejected: How much worse the others do that were fitted in its place, by id. Where none came near enough to be
            fitted, the best of them by its linear gain.
        probability: That it is this cause, and larger than a machine of its class may have.
        others: The same of what could stand in its place, by id.
        whole: That it is one of them.
    """

    key: str
    gain: float
    competing: dict[str, Fit] = field(default_factory=dict)
    rejected: dict[str, float] = field(default_factory=dict)
    probability: float = 1.0
    others: dict[str, float] = field(default_factory=dict)
    whole: float = 1.0

    @property
    def alternatives(self) -> tuple[str, ...]:
        """Ids of the effects that do as well."""
        return tuple(self.competing)


@dataclass(frozen=True)
class Selection:
    """Outcome of a model selection.

    Attributes:
        start: The model without missing effects.
        fit: The final model.
        found: Its effects in the order of their contribution.
        bank: Signatures of all candidates.
        trail: The models that were tried.
        first_gain: What the first effect alone explained.
        best_curve: The generic curve that explains most at ``start``, where it was looked for.
        complete: Whether the search ended by itself, and not because few effects do not explain the data.
    """

    start: Fit
    fit: Fit
    found: list[Found]
    bank: SignatureBank
    trail: list[dict] = field(default_factory=list)
    first_gain: float = 0.0
    best_curve: CurveTerm | None = None
    complete: bool = True
