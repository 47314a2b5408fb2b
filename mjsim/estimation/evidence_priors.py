"""Effects of a model with the prior widths that the evidence gave them."""

from __future__ import annotations

import numpy as np

from mjsim.estimation.candidate_groups import own_groups
from mjsim.estimation.effect_vector import EffectVector
from mjsim.machine.model import Machine

#: Prior standard deviation of what nothing holds back, typical sizes.
WIDE = 1e3


def kept_waves(f: EffectVector, precision: dict[int | None, float]) -> EffectVector:
    """An effect of the model with the waves (or all entries) that are still needed."""
    if None in precision:
        return f.with_prior(f.off, _widths(f, precision[None]))
    rows = f.effect.values["components"]
    waves = sorted(w for w in precision if w is not None)
    effect = f.effect.replaced(components=[rows[w] for w in waves])
    widths = np.concatenate([np.full(2, precision[w] ** -0.5) for w in waves])
    return EffectVector(effect, f.names).with_prior(np.zeros(len(widths)), widths)


def _widths(f: EffectVector, precision: float) -> np.ndarray:
    """Prior standard deviations: of the linear entries by the evidence, wide for shapes."""
    out = np.full(len(f.vector), WIDE)
    for _, entries in own_groups(f):
        out[entries] = precision**-0.5
    return out


def added(machine: Machine, free: EffectVector, x: np.ndarray, precision: float) -> EffectVector:
    """A candidate at its linear estimate ``x``, with the prior that the evidence gave it."""
    if free.effect.kind == "pitch_error":
        start = EffectVector(free.at(x), free.names)
        return start.with_prior(np.zeros(2), np.full(2, precision**-0.5))
    present = machine.effect(free.effect.key)
    v = free.vector
    if present is not None:
        start = EffectVector(free.at(v + x), free.names)
        return start.with_prior(EffectVector(present, free.names).vector, np.full(len(v), precision**-0.5))
    off = v.copy()
    off[free.linear] = free.neutral
    v[free.linear] = free.neutral + x
    start = EffectVector(free.at(v), free.names)
    return start.with_prior(off, _widths(start, precision))
