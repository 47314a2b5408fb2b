"""What a search on axis logs found on one axis."""

from __future__ import annotations

from dataclasses import dataclass, field

from mjsim.estimation.axis_logs.fit import AxisFit
from mjsim.estimation.axis_logs.gains import GainsRead


@dataclass(frozen=True)
class FoundCause:
    """One cause of the final model.

    Attributes:
        key: Of the candidate.
        effect_id: Of the effect.
        gain: Twice the logarithm of the likelihood ratio against the model without it.
        alternatives: Ids of effects that the recordings cannot tell from it.
        rejected: How much worse others do in its place, by id.
        tests: Where it shows.
        competing: Fits with an alternative in its place, by id.
        probability: That it is this cause, and larger than a machine of its class may have.
    """

    key: str
    effect_id: str
    gain: float
    alternatives: tuple[str, ...] = ()
    rejected: dict[str, float] = field(default_factory=dict)
    tests: tuple[str, ...] = ()
    competing: dict[str, AxisFit] = field(default_factory=dict)
    probability: float = 1.0


@dataclass(frozen=True)
class AxisSelection:
    """Outcome of the search on one axis.

    Attributes:
        axis: Letter.
        given: The machine as it is, nuisances fitted.
        sheet: With the data sheet fitted within its priors.
        ladder: The models on the way, one cause more each; the last is the final one before competing models.
        fit: The final model.
        found: Its causes, the largest gain first.
        gains: Read back from recorded outputs.
        order: Keys of the causes in the order of the ladder.
    """

    axis: str
    given: AxisFit
    sheet: AxisFit
    ladder: tuple[AxisFit, ...]
    fit: AxisFit
    found: tuple[FoundCause, ...]
    gains: tuple[GainsRead, ...] = ()
    order: tuple[str, ...] = ()
