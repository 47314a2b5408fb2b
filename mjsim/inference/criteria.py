"""What a candidate must satisfy: bounds, sizes that make sense, a price per parameter."""

from __future__ import annotations

import numpy as np

from mjsim.effects.base import Effect
from mjsim.inference.fit import Fit
from mjsim.inference.free import FreeEffect
from mjsim.inference.signatures import Candidate
from mjsim.machine.model import Machine

#: Price of one more free parameter when models are compared.
PRICE = 8.0


def price(fit: Fit) -> float:
    """Objective of a model with its free parameters paid for: the lower the better."""
    return fit.objective + PRICE * sum(len(f.vector) for f in fit.effects)


def possible(machine: Machine, x: np.ndarray, c: Candidate) -> bool:
    """Whether the linear estimate lies within the parameter's bounds and above its least sensible size."""
    if c.effect.scanned:
        return True
    free = FreeEffect(c.effect, c.names)
    if free.polar:
        p = free.specs[free.amplitude]
        return bool(np.hypot(x[0], x[1]) * p.scale <= p.upper)
    present = any(e.key == c.effect.key for e in machine.effects)
    for value, name in zip(x, (n for n in free.names if present or free.specs[n].neutral is not None), strict=False):
        p = free.specs[name]
        size = value * p.scale + (c.effect.values[name] if present else p.neutral)
        slack = 0.02 * p.scale
        if not p.lower - slack <= size <= p.upper + slack:
            return False
        if c.effect.least and abs(size - (p.neutral or 0.0)) < c.effect.least:
            return False
    return True


def sensible(machine: Machine, free: FreeEffect) -> bool:
    """Whether a fitted effect is large enough to be a cause of its own, and outside what the data sheet allows anyway."""
    effect: Effect = free.effect
    p = next((p for p in effect.parameters_of(effect.subject) if p.neutral is not None), None)
    if p is None:
        return True
    present = machine.effect(effect.key)
    origin = present.values[p.name] if present else p.neutral
    departure = abs(effect.values[p.name] - origin)
    return departure >= effect.least and departure >= 3.0 * effect.tolerance * abs(origin)


def wald(machine: Machine, fit: Fit, index: int) -> float:
    """Squared distance of an effect's linear entries from off, in standard deviations: a lower bound of what dropping it costs."""
    f = fit.effects[index]
    block = fit.block(index)
    v = f.vector
    present = machine.effect(f.effect.key)
    if present is not None:
        d = v - FreeEffect(present, f.names).vector if len(FreeEffect(present, f.names).vector) == len(v) else v
        keep = list(range(len(v)))
    elif f.polar or f.effect.scanned:
        d, keep = v, list(range(len(v) if f.effect.scanned else 2))
    else:
        keep = [i for i, n in enumerate(f.names) if f.specs[n].neutral is not None]
        d = v - np.array([(f.specs[n].neutral or 0.0) / f.specs[n].scale for n in f.names])
    c = fit.covariance[block, block][np.ix_(keep, keep)]
    return float(d[keep] @ np.linalg.solve(c, d[keep]))
