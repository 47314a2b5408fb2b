"""What a search on axis logs found on one axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from mjsim.inference.axis_logs.candidates import Candidate
from mjsim.inference.axis_logs.fit import AxisFit
from mjsim.inference.axis_logs.gains import GainsRead
from mjsim.inference.search import SEEN


@dataclass(frozen=True, eq=False)
class LogModel:
    """A fitted model of one axis with the causes that the machine file does not have.

    Attributes:
        fit: The fit.
        causes: In the order in which they were found.
    """

    fit: AxisFit
    causes: tuple[Candidate, ...] = ()

    @property
    def evidence(self) -> float:
        """Log evidence, the prior odds of the causes included."""
        return self.fit.evidence + sum(c.log_odds for c in self.causes)

    @property
    def left(self) -> float:
        """RMS of the discrepancy in the recording that shows most of it, axis units."""
        return max(self.fit.discrepancy.left[: self.fit.positions])

    @property
    def leaves_nothing(self) -> bool:
        """Whether what it leaves cannot be seen beside the noise."""
        return all(x < SEEN * noise for x, noise in zip(self.fit.discrepancy.left, self.fit.noise, strict=True))

    @property
    def keys(self) -> tuple[str, ...]:
        """Of the causes."""
        return tuple(c.key for c in self.causes)


@dataclass(frozen=True)
class FoundCause:
    """One cause of the final model.

    Attributes:
        key: Of the candidate.
        effect_id: Of the effect.
        gain: Log evidence that it gains, prior odds included.
        whole: Probability that it, or what could stand in its place, is there and larger than a machine of its class
            may have.
        known: Probability that what it explains is not that of a cause which is in no catalogue.
        probability: That it is this cause.
        others: Probabilities of effects that the recordings cannot tell from it, by id.
        rejected: How much less log evidence others have in its place, by id.
        tests: Where it shows.
        competing: Fits with an alternative in its place, by id.
    """

    key: str
    effect_id: str
    gain: float
    whole: float
    known: float
    probability: float
    others: dict[str, float] = field(default_factory=dict)
    rejected: dict[str, float] = field(default_factory=dict)
    tests: tuple[str, ...] = ()
    competing: dict[str, AxisFit] = field(default_factory=dict)


@dataclass(frozen=True)
class AxisSelection:
    """Outcome of the search on one axis.

    Attributes:
        axis: Letter.
        given: The machine as it is, nuisances fitted.
        sheet: With the data sheet fitted within its priors.
        fit: The final model.
        found: Its causes, the largest gain first.
        gains: Read back from recorded outputs.
        ladder: The models on the way from the data sheet.
    """

    axis: str
    given: AxisFit
    sheet: AxisFit
    fit: AxisFit
    found: tuple[FoundCause, ...] = ()
    gains: tuple[GainsRead, ...] = ()
    ladder: Sequence[LogModel] = ()

    @property
    def rungs(self) -> list[tuple[str, AxisFit]]:
        """What every model of the ladder has that the one before has not, or the other way round, and its fit."""
        out = []
        for before, after in pairwise(self.ladder):
            said = [f"+ {key}" for key in after.keys if key not in before.keys]
            said += [f"− {key}" for key in before.keys if key not in after.keys]
            out.append((", ".join(said) or "the same, fitted anew", after.fit))
        return out

    def step_of(self, key: str) -> tuple[float, float]:
        """RMS before and after a cause came into the model, axis units."""
        for before, after in reversed(list(pairwise(self.ladder))):
            if key in after.keys and key not in before.keys:
                return before.fit.rms, after.fit.rms
        return self.sheet.rms, self.fit.rms
