"""Trials of candidates in one step of a search on axis logs, and which of them is taken."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mjsim.estimation.axis_logs.candidates import SIMPLER, Candidate
from mjsim.estimation.axis_logs.fit import AxisFit
from mjsim.estimation.axis_logs.likelihood import Gain
from mjsim.estimation.axis_logs.trifles import is_trifle, is_visible
from mjsim.estimation.settings import DiagnosisSettings


@dataclass(frozen=True, eq=False)
class Trial:
    """A model with one cause more.

    Attributes:
        candidate: The cause.
        fit: With it.
        gain: Over the model without it, less the penalty of its entries.
    """

    candidate: Candidate
    fit: AxisFit
    gain: Gain

    @classmethod
    def of(cls, before: AxisFit, candidate: Candidate, fit: AxisFit, penalty: float) -> Trial:
        """Of a fit with a candidate over the one ``before``, with the ``penalty`` of one entry."""
        more = len(fit.model.entries) - len(before.model.entries) - 1
        won = Gain.of(before.residual, fit.residual, fit.independent, fit.noise)
        return cls(candidate, fit, won.less(penalty * more))


#: What is looked at in turn: what makes the misfit smaller, then what its spectrum shows.
_ORDERS: tuple[Callable[[Trial], float], ...] = (lambda t: t.gain.slow, lambda t: t.gain.fine)


def ahead(trials: Sequence[Trial]) -> list[Trial]:
    """The trials that are ahead of the others: in size, and in the spectrum where that is another one."""
    best = [max(trials, key=of) for of in _ORDERS] if trials else []
    return best[:1] if len(best) > 1 and best[0] is best[1] else best


def taken(
    before: AxisFit, trials: Sequence[Trial], settings: DiagnosisSettings, only_size: bool = False
) -> Trial | None:
    """The trial that a search takes; nothing where none pays.

    Args:
        before: The model that they extend.
        trials: What was tried.
        settings: What decides.
        only_size: Look at the size of the misfit alone, which comes first.
    """
    for of in _ORDERS[: 1 if only_size else None]:
        best = max((t for t in trials if not is_trifle(t.fit.model, t.candidate)), key=of, default=None)
        if best is None or of(best) < settings.likelihood_ratio:
            continue
        close = of(best) - settings.indistinguishable
        best = next((t for t in trials if t.candidate.effect.kind in SIMPLER and of(t) > close), best)
        if is_visible(before, best.fit):
            return best
    return None
