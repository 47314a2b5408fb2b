"""What a candidate must satisfy: bounds, sizes that make sense, a penalty per parameter."""

from __future__ import annotations

import numpy as np

from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fit
from mjsim.estimation.settings import DiagnosisSettings
from mjsim.estimation.signatures import Candidate
from mjsim.machine.effect import Effect, Parameter
from mjsim.machine.model import Machine

#: How far beyond its bounds, in typical sizes, a linear estimate may lie.
_SLACK = 0.02


def parameter_count(fit: Fit) -> int:
    """Number of free parameters of a model's effects."""
    return sum(len(f.vector) for f in fit.effects)


def penalised_objective(fit: Fit, settings: DiagnosisSettings) -> float:
    """Objective of a model plus the penalties of its effects' free parameters and chosen directions: the lower the
    better.
    """
    directed = sum(bool(f.effect.values.get("direction")) for f in fit.effects)
    return fit.objective + settings.parameter_penalty * parameter_count(fit) + settings.direction_penalty * directed


def is_feasible(machine: Machine, x: np.ndarray, c: Candidate) -> bool:
    """Whether the linear estimate lies within the parameter's bounds and above its least sensible size."""
    return feasible_share(machine, x, c) >= 1.0


def start_share(machine: Machine, x: np.ndarray, c: Candidate) -> float:
    """Share of a linear estimate that a fit starts from, 0 to 1: all of it within the bounds, beyond them half of the
    way to them, nothing where it is below its least sensible size.

    An effect that works as the inverse of its parameter, as a velocity gain does, is overestimated where it is large.
    """
    share = feasible_share(machine, x, c)
    return 1.0 if share >= 1.0 else 0.5 * share


def feasible_share(machine: Machine, x: np.ndarray, c: Candidate) -> float:
    """Up to which share of itself, 0 to 1, the linear estimate lies within the parameters' bounds; 0 where it is below
    its least sensible size.
    """
    if c.effect.search.scanned:
        return 1.0
    free = EffectVector(c.effect, c.names)
    if free.polar and free.amplitude is not None:
        p = free.specs[free.amplitude]
        return min(1.0, p.upper / max(float(np.hypot(x[0], x[1])) * p.scale, 1e-30))
    present, share = any(e.key == c.effect.key for e in machine.effects), 1.0
    for value, name in zip(x, (n for n in free.names if present or free.specs[n].neutral is not None), strict=False):
        p = free.specs[name]
        start = p.encode(c.effect.values[name] if present else p.neutral or 0.0)
        low, high = sorted((p.encode(p.lower), p.encode(p.upper)))
        if not low - _SLACK <= start + value <= high + _SLACK:
            share = min(share, ((high if value > 0.0 else low) - start) / value)
        elif c.effect.search.least and abs(p.decode(start + value) - (p.neutral or 0.0)) < c.effect.search.least:
            return 0.0
    return max(0.0, share)


def is_large_enough(machine: Machine, free: EffectVector, settings: DiagnosisSettings) -> bool:
    """Whether a fitted effect is large enough to be a cause of its own, and outside what the data sheet allows
    anyway.
    """
    effect: Effect = free.effect
    present = machine.effect(effect.key)
    counted = [n for n in free.names if n in effect.search.tolerances or free.specs[n].neutral is not None]
    return not counted or any(
        _departs(effect, free.specs[n], effect.values[n], present.values[n] if present else None, settings.sheet_limit)
        for n in counted
    )


def looks_like(effect: Effect, other: Effect) -> bool:
    """Whether an effect makes sense in the place of another one however small it is."""
    return effect.subject == other.subject and other.kind in effect.search.looks_like


def stands_for(f: EffectVector, other: Effect) -> bool:
    """Whether a fitted effect makes sense in the place of another one: it may be small, but not below neutral."""
    return looks_like(f.effect, other) and all(f.effect.values[n] > (f.specs[n].neutral or 0.0) for n in f.names)


def _departs(effect: Effect, p: Parameter, value: float, present: float | None, sheet_limit: float) -> bool:
    origin = present if present is not None else p.neutral if p.neutral is not None else p.default
    if p.inverse:
        return value != origin
    departure, hints = abs(value - origin), effect.search
    tolerance = sheet_limit * hints.tolerances.get(p.name, 0.0) * abs(origin)
    return departure > 0.0 and departure >= hints.least and departure >= tolerance


def wald_statistic(machine: Machine, fit: Fit, index: int) -> float:
    """Squared distance of an effect's linear entries from off, in standard deviations: a lower bound of what
    dropping it costs.
    """
    f = fit.effects[index]
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
    c = fit.covariance_of(f)[np.ix_(keep, keep)]
    return float(d[keep] @ np.linalg.solve(c, d[keep]))
