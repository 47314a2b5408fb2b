"""What a candidate must satisfy: bounds, sizes that make sense, a penalty per parameter."""

from __future__ import annotations

import numpy as np

from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fit
from mjsim.estimation.signatures import Candidate
from mjsim.machine.effect import Effect, Parameter
from mjsim.machine.model import Machine

#: Fall of the objective below which nothing is called an effect. Some 4,000 cells with two entries each are tried:
#: chance passes it once in a thousand campaigns; ``scripts/null_bank.py`` measures it on simulated nulls.
THRESHOLD = 30.0
#: Least size of an effect: its part of the reading in its clearest test, as a share of one sample's noise.
VISIBLE = 0.25
#: Standard deviations of the data sheet beyond which one of its numbers is wrong. It has 35 numbers: the largest of a healthy machine is
#: beyond 3 in one campaign of eleven, beyond 4 in one of 450.
BEYOND_SHEET = 4.0
#: Price of one more free parameter when models are compared.
PRICE = 8.0
#: What an effect that acts in one direction of motion only pays more than one that acts in both.
ONE_WAY = 4.0
#: How far beyond its bounds, in typical sizes, a linear estimate may lie.
_SLACK = 0.02


def parameter_count(fit: Fit) -> int:
    """Number of free parameters of a model's effects."""
    return sum(len(f.vector) for f in fit.effects)


def penalised_objective(fit: Fit) -> float:
    """Objective of a model with its free parameters, and the directions that its effects pick, paid for: the lower the better."""
    return fit.objective + PRICE * parameter_count(fit) + ONE_WAY * sum(f.effect.direction_sign != 0.0 for f in fit.effects)


def is_feasible(machine: Machine, x: np.ndarray, c: Candidate) -> bool:
    """Whether the linear estimate lies within the parameter's bounds and above its least sensible size."""
    if c.effect.search.scanned:
        return True
    free = EffectVector(c.effect, c.names)
    if free.polar and free.amplitude is not None:
        p = free.specs[free.amplitude]
        return bool(np.hypot(x[0], x[1]) * p.scale <= p.upper)
    present = any(e.key == c.effect.key for e in machine.effects)
    for value, name in zip(x, (n for n in free.names if present or free.specs[n].neutral is not None), strict=False):
        p = free.specs[name]
        size = value + p.encode(c.effect.values[name] if present else p.neutral or 0.0)
        low, high = sorted((p.encode(p.lower), p.encode(p.upper)))
        if not low - _SLACK <= size <= high + _SLACK:
            return False
        if c.effect.search.least and abs(p.decode(size) - (p.neutral or 0.0)) < c.effect.search.least:
            return False
    return True


def is_large_enough(machine: Machine, free: EffectVector) -> bool:
    """Whether a fitted effect is large enough to be a cause of its own, and outside what the data sheet allows anyway."""
    effect: Effect = free.effect
    present = machine.effect(effect.key)
    counted = [n for n in free.names if n in effect.search.tolerances or free.specs[n].neutral is not None]
    return not counted or any(_departs(effect, free.specs[n], effect.values[n], present.values[n] if present else None) for n in counted)


def _departs(effect: Effect, p: Parameter, value: float, present: float | None) -> bool:
    origin = present if present is not None else p.neutral if p.neutral is not None else p.default
    if p.inverse:
        return value != origin
    departure, hints = abs(value - origin), effect.search
    return departure > 0.0 and departure >= hints.least and departure >= BEYOND_SHEET * hints.tolerances.get(p.name, 0.0) * abs(origin)


def wald_statistic(machine: Machine, fit: Fit, index: int) -> float:
    """Squared distance of an effect's linear entries from off, in standard deviations: a lower bound of what dropping it costs."""
    f = fit.effects[index]
    block = fit.block(index)
    v = f.vector
    present = machine.effect(f.effect.key)
    if present is not None:
        d = v - EffectVector(present, f.names).vector if len(EffectVector(present, f.names).vector) == len(v) else v
        keep = list(range(len(v)))
    elif f.polar or f.effect.search.scanned:
        d, keep = v, list(range(len(v) if f.effect.search.scanned else 2))
    else:
        keep = f.linear
        d = v.copy()
        d[keep] -= f.neutral
    c = fit.covariance[block, block][np.ix_(keep, keep)]
    return float(d[keep] @ np.linalg.solve(c, d[keep]))
