"""A servo fault that is large, found before anything else.

An axis that lags far more than its data sheet says moves every mark in the readings. Triggers then follow it into false
minima, and so does what a machine may have: no linear problem at such a fit shows the cause. The data sheet tells where
it is, since the position gain of the axis is driven off its tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from mjsim.effects import registry
from mjsim.inference.data_sheet import data_sheet
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.machine.model import Machine

#: What a lag may come from, the likeliest first. Where they are small, they cannot be told apart.
_KINDS = ("servo_gain", "servo_delay", "velocity_feedforward")
#: Mean square of the whitened residuals above which a model is far from the data (assumed).
_FAR = 2.0
#: A position gain is suspected whose penalty in the objective is that of so many standard deviations (assumed).
_SUSPECTED = 4.0
#: Share of the sum of squares that a servo fault must take away (assumed).
_WON = 0.5


def with_servo_fault(refit: Callable[[list[EffectVector]], Fit], fit: Fit, clearly: float) -> Fit:
    """``fit`` with a free gain, delay or feedforward of one axis or more beside its effects, where these explain most
    of what is left; otherwise as it is. What they are called in the end is for the evidence to say.

    Args:
        refit: Fits a model anew, from the machine as given.
        fit: Of everything that a machine may have.
        clearly: A later kind must leave a sum of squares that is less by so much.
    """
    while _misfit(fit) > _FAR and (axis := _suspected(fit)) is not None:
        best = fit
        for kind in _KINDS:
            trial = refit([*fit.effects, _free(kind, axis, fit.base)])
            if best is fit and trial.sum_squares > (1.0 - _WON) * fit.sum_squares:
                return fit
            if best is fit or trial.sum_squares < best.sum_squares - clearly:
                best = trial
        fit = best
    return fit


def _free(kind: str, axis: str, machine: Machine) -> EffectVector:
    """A free effect that starts as ``machine`` has it, or without influence."""
    effect_class = registry.kinds()[kind]
    neutral = {p.name: p.neutral for p in effect_class.parameters if p.neutral is not None}
    effect = machine.effect(f"{kind}.{axis}") or effect_class(axis, **neutral)
    return EffectVector(effect, tuple(neutral))


def _misfit(fit: Fit) -> float:
    return fit.sum_squares / len(fit.residual)


def _suspected(fit: Fit) -> str | None:
    """The axis without a fitted servo fault whose position gain is farthest off its data sheet; ``None`` where none is
    suspected. While a model is far from the data, priors weigh as much more as it leaves.
    """
    known = {f.effect.subject for f in fit.effects if f.effect.kind in _KINDS}
    off = {
        p.axis: abs(deviation) * math.sqrt(_misfit(fit))
        for p, deviation in zip(data_sheet(fit.base.chain), fit.sheet_deviation, strict=True)
        if p.name == "position_gain" and p.axis not in known
    }
    axis = max(off, key=lambda a: off[a], default=None)
    return axis if axis is not None and off[axis] > _SUSPECTED else None
