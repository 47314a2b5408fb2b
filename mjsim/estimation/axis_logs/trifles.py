"""Causes that are too small to be one: within the tolerance of a data sheet, or a trifle of the friction."""

from __future__ import annotations

import math

import numpy as np

from mjsim.estimation.axis_logs.candidates import FRICTION, Candidate
from mjsim.estimation.axis_logs.entries import AxisModel
from mjsim.estimation.axis_logs.fit import AxisFit
from mjsim.estimation.axis_logs.start import MOST_SHIFT
from mjsim.machine.model import TOLERANCE

#: Kinds whose ratio is that of a number of the data sheet.
OF_SHEET = {
    "inertia": "inertia",
    "integral_time": "integral_time",
    "servo_gain": "position_gain",
    "velocity_gain": "velocity_gain",
    "viscous_friction": "viscous",
}
#: Standard deviations of the data sheet within which such a number is as stated.
WITHIN = 2.0
#: Share of the Coulomb friction below which a torque that does not turn with the direction is a trifle (assumed: a
#: bearing drags a little more one way).
_DIRECTION = 0.02

#: Least share by which a cause must lower the RMS of a recording to be a cause of its own.
_LEAST_SHARE = 0.01
#: Least RMS of a cause's part of a recording, as a share of the noise of one sample (chosen on
#: ``scripts/benchmark_logs.py``).
_LEAST_NOISE = 0.5


def is_trifle(model: AxisModel, candidate: Candidate) -> bool:
    """Whether what a fitted model has of a cause is too small to be one."""
    effect = model.machine.effect(candidate.effect.id)
    if effect is None:
        return True
    if effect.kind in OF_SHEET:
        return abs(math.log(effect.values["ratio"])) < WITHIN * TOLERANCE[OF_SHEET[effect.kind]]
    if effect.kind == "servo_delay":  # a recorder may be so late
        return abs(effect.values["delay_ms"]) <= MOST_SHIFT * candidate.entries[0].scale
    if effect.kind == "friction_direction":
        return abs(effect.values["share_ratio"]) < _DIRECTION
    friction = model.machine.effect(f"{FRICTION}.{model.axis}")
    if effect.kind == "constant_force" and friction is not None:
        return abs(effect.values["torque_Nm"]) < _DIRECTION * friction.values["coulomb_Nm"]
    return False


def is_visible(less: AxisFit, more: AxisFit) -> bool:
    """Whether what a cause explains in some recording is more than a trifle, of what was left and of the noise."""
    before, after = less.mean_squares, more.mean_squares
    share = np.sqrt(after / np.maximum(before, 1e-30)) < 1.0 - _LEAST_SHARE
    size = np.sqrt(np.maximum(before - after, 0.0)) > _LEAST_NOISE * np.array(more.noise)
    return bool((share & size).any())
