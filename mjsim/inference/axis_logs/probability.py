"""How probable it is that a cause of axis logs is larger than a machine of its class may have, and that it is this one.

Three things make a cause less than sure: that it is not there, that it is small, and that something else looks like it.
The first is a matter of evidence (:mod:`mjsim.inference.axis_logs.search`). The second is one of its size and of its
tolerance. A cause without one is small where it changes a recording by no more than a sound machine may leave there.
The third is unknown by its nature. Where a model leaves more than a sound machine does, a cause that is in no catalogue
is at work. Of what the causes found explain, a share like that which is left is then taken for its own (assumed). This
is enough for what every axis has some of. A fault is a second one beside the unlisted one, and as improbable as before
anything was recorded: its prior odds count as well.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from mjsim.campaign.tolerance import TYPICAL_TOLERANCE, unit_of_size
from mjsim.inference.axis_logs.candidates import FRICTION, Candidate
from mjsim.inference.axis_logs.entries import Entry
from mjsim.inference.axis_logs.fit import AxisFit
from mjsim.inference.axis_logs.start import MOST_SHIFT
from mjsim.inference.axis_logs.together import deviation_along, leading_number
from mjsim.inference.calibration import LIMIT_DEVIATIONS
from mjsim.inference.data_sheet import OF_SHEET
from mjsim.machine.effect import Effect
from mjsim.machine.model import TOLERANCE, Machine

#: Share of the Coulomb friction that a torque may have which does not turn with the direction (assumed: a bearing drags
#: a little more one way).
_DIRECTION = 0.02


def probability_of_size(candidate: Candidate, fit: AxisFit, without: AxisFit) -> float:
    """Probability that a cause that is there is larger than a machine of its class may have.

    Args:
        candidate: The cause.
        fit: The final model.
        without: The model without the cause.
    """
    large = beyond_class(candidate, fit)
    if large is not None:
        return large
    changed = np.maximum(without.mean_squares - fit.mean_squares, 1e-30)
    # a mean square is known as well as the number of independent residuals tells
    spread = changed * np.sqrt(2.0 / np.array(fit.independent))
    return float(ndtr((changed - np.square(fit.allowed)) / spread).max())


def probability_known(candidate: Candidate, fit: AxisFit, without: AxisFit) -> float:
    """Probability that what a cause explains is not that of a cause which is in no catalogue; arguments as there."""
    share = min(fit.rms / max(without.rms, 1e-30), 1.0)
    # no motor is without slots, no screw even, no drive rigid, and no friction follows a law: that is no second fault
    is_fault = candidate.effect.search.stated or candidate.sheet
    odds = math.exp(candidate.log_odds) if is_fault else 1.0
    return 1.0 - fit.discrepancy.probability * share / (share + odds * (1.0 - share))


def beyond_class(candidate: Candidate, fit: AxisFit) -> float | None:
    """Probability that a cause that is there is larger than the tolerance of the data sheet, or that of the machine.
    Nothing where neither has one.
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
        return LIMIT_DEVIATIONS * TOLERANCE[OF_SHEET[effect.kind]]
    if effect.kind == "servo_delay":  # a recorder may be so late
        return MOST_SHIFT
    if effect.kind == "friction_direction":
        return _DIRECTION / entry.scale
    friction = machine.effect(f"{FRICTION}.{effect.subject}")
    if effect.kind == "constant_force" and friction is not None:
        return _DIRECTION * friction.values["coulomb_Nm"] / entry.scale
    limits = (machine.tolerance or TYPICAL_TOLERANCE).get(effect.kind, {})
    unit = unit_of_size(effect.parameters_of(effect.subject)[0], effect.subject)
    return limits.get(unit, 0.0) / entry.scale if not entry.log else 0.0
