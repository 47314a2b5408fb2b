"""How probable it is that a cause found in axis logs is this one, and larger than a machine of its class may have.

Three things make it less than sure: that it is not there, that it is small, and that something else looks like it. The
first is a matter of evidence beside the discrepancy, with the prior odds that every cause has. The second is one of its
size and of the data sheet's tolerance. The third is unknown by its nature. Where a model leaves more than a sound
machine does, a cause that is in no catalogue is at work. Of what the causes found explain, a share like that which it
leaves is taken for its own (assumed).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from mjsim.estimation.axis_logs.candidates import Candidate
from mjsim.estimation.axis_logs.data import AxisData
from mjsim.estimation.axis_logs.discrepancy import discrepancy_of
from mjsim.estimation.axis_logs.fit import AxisFit
from mjsim.estimation.axis_logs.together import deviation_along, leading_number
from mjsim.estimation.axis_logs.trifles import OF_SHEET, WITHIN
from mjsim.estimation.hypotheses import CAUSE
from mjsim.machine.model import TOLERANCE


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
    return there * _large(candidate, fit) * (1.0 - share * fit.discrepancy.probability)


def _large(candidate: Candidate, fit: AxisFit) -> float:
    """Probability that a cause that is there is larger than the data sheet's tolerance: nothing else has one."""
    effect = fit.model.machine.effect(candidate.effect.id)
    assert effect is not None
    lead = leading_number(fit.model, effect, candidate.order)
    if lead is None or effect.kind not in OF_SHEET:
        return 1.0
    direction, _, distance = lead
    limit = WITHIN * TOLERANCE[OF_SHEET[effect.kind]]
    spread = max(deviation_along(fit.covariance, direction, []), 1e-12)
    return float(ndtr((distance - limit) / spread) + ndtr((-distance - limit) / spread))
