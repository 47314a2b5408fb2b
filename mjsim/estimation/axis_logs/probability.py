"""How probable it is that a cause found in axis logs is this one, and larger than a machine of its class may have.

Three things make it less than sure: that it is not there, that it is small, and that something else looks like it. The
first is a matter of evidence beside the discrepancy, with the prior odds that every cause has. The second is one of its
size and of its tolerance. A cause without one is small where it changes a recording by no more than a sound machine may
leave there. The third is unknown by its nature. Where a model leaves more than a sound machine does, a cause that is in
no catalogue is at work. Of what the causes found explain, a share like that which it leaves is taken for its own
(assumed).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from mjsim.campaign.tolerance import TYPICAL_TOLERANCE, unit_of_size
from mjsim.estimation.axis_logs.candidates import Candidate
from mjsim.estimation.axis_logs.data import AxisData
from mjsim.estimation.axis_logs.discrepancy import discrepancy_of
from mjsim.estimation.axis_logs.entries import Entry
from mjsim.estimation.axis_logs.fit import AxisFit
from mjsim.estimation.axis_logs.together import deviation_along, leading_number
from mjsim.estimation.axis_logs.trifles import OF_SHEET, WITHIN
from mjsim.estimation.hypotheses import CAUSE
from mjsim.machine.effect import Effect
from mjsim.machine.model import TOLERANCE, Machine


def probability_of(candidate: Candidate, fit: AxisFit, without: AxisFit, data: Sequence[AxisData]) -> float:
    """Probability of one cause of the final model.

    Args:
        candidate: The cause.
        fit: The final model, with its discrepancy.
        without: The model without the cause.
        data: The recordings.
    """
    assert fit.discrepancy is not None
    less = discrepancy_of(without.model, without.residual, without.design, data, fit.discrepancy.allowed)
    odds = fit.discrepancy.evidence - less.evidence + CAUSE
    there = 1.0 / (1.0 + math.exp(-np.clip(odds, -700.0, 700.0)))
    share = min(fit.rms / max(without.rms, 1e-30), 1.0)
    large = beyond_class(candidate, fit)
    if large is None:
        large = _beyond_allowed(fit, without)
    return there * large * (1.0 - share * fit.discrepancy.probability)


def _beyond_allowed(fit: AxisFit, without: AxisFit) -> float:
    """Probability that what a cause changes in some recording is more than a sound machine may leave there."""
    assert fit.discrepancy is not None
    changed = np.maximum(without.mean_squares - fit.mean_squares, 1e-30)
    # a mean square is known as well as the number of independent residuals tells
    spread = changed * np.sqrt(2.0 / np.array(fit.independent))
    return float(ndtr((changed - np.square(fit.discrepancy.allowed)) / spread).max())


def beyond_class(candidate: Candidate, fit: AxisFit) -> float | None:
    """Probability that a cause that is there is larger than a machine of its class may have: than the tolerance of the
    data sheet, or that of the machine. Nothing where neither has one.
    """
    effect = fit.model.machine.effect(candidate.effect.id)
    assert effect is not None
    lead = leading_number(fit.model, effect, candidate.order)
    limit = 0.0 if lead is None else _limit_of(fit.model.machine, effect, fit.model.entries[int(np.argmax(lead[0]))])
    if lead is None or limit == 0.0:
        return None
    direction, _, distance = lead
    spread = max(deviation_along(fit.covariance, direction, []), 1e-12)
    # both ends of what a sound machine may have
    return float(ndtr((distance - limit) / spread) + ndtr((-distance - limit) / spread))


def _limit_of(machine: Machine, effect: Effect, entry: Entry) -> float:
    """What a machine of its class may have of an effect, in units of the vector; zero where nothing says so."""
    if effect.kind in OF_SHEET:
        return WITHIN * TOLERANCE[OF_SHEET[effect.kind]]
    limits = (machine.tolerance or TYPICAL_TOLERANCE).get(effect.kind, {})
    unit = unit_of_size(effect.parameters_of(effect.subject)[0], effect.subject)
    return limits.get(unit, 0.0) / entry.scale if not entry.log else 0.0
