"""What a model selection returns: the model, its findings, and what else was tried."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from mjsim.inference.discrepancy import Sizes
from mjsim.inference.fit import Fit
from mjsim.inference.signatures import Bank


@dataclass(frozen=True)
class FoundEffect:
    """One missing effect of the final model.

    Attributes:
        key: Of the effect.
        gain: How far the objective falls with it.
        competing: Models with another effect in its place that the data cannot tell from it, by that effect's id.
        probability: That it is this cause, and larger than a machine of its class may have.
        others: The same of what could stand in its place, by id.
        whole: That it is one of them.
    """

    key: str
    gain: float
    competing: dict[str, Fit] = field(default_factory=dict)
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
        left: Sizes of what is in no model.
        trail: The models that were tried.
    """

    start: Fit
    fit: Fit
    found: list[FoundEffect]
    bank: Bank
    left: Sizes
    trail: list[dict] = field(default_factory=list)


def verdict_of(is_open: Iterable[bool], has_rest: bool) -> str:
    """``identified``, ``ambiguous``, ``unknown`` or ``nothing_found``.

    Args:
        is_open: Of every finding, whether something else may stand in its place.
        has_rest: Whether something is left that no cause of the catalogue explains.
    """
    findings = list(is_open)
    if findings:
        return "ambiguous" if any(findings) else "identified"
    return "unknown" if has_rest else "nothing_found"
