"""Testability first: which effects this campaign could show at all."""

from __future__ import annotations

import numpy as np

from mjsim.effects import registry
from mjsim.inference.problem import Problem
from mjsim.inference.signatures import Bank, Projector
from mjsim.machine.chain import Chain

#: Sensitivity below which an axis is not seen: linear, and rotary (m/rad).
_SEEN = (0.02, 1e-3)


def detection_limits(projector: Projector, bank: Bank) -> dict[str, float]:
    """Three standard deviations of every effect's leading size, in typical sizes, with everything else free (best
    seed).
    """
    limits: dict[str, float] = {}
    cross = projector.design.T @ bank.matrix
    reduced = projector.equations.solve(cross)
    for c, s, own in zip(bank.candidates, bank.slices, bank.own, strict=True):
        left = np.diag(own - cross[:, s].T @ reduced[:, s])
        # beyond a ten-millionth of the signature's power nothing but rounding is left
        power = float(np.max(np.where(left > 1e-7 * np.diag(own), left, 0.0))) if len(left) else 0.0
        limit = 3.0 / np.sqrt(power) if power > 0 else np.inf
        limits[c.id] = min(limit, limits.get(c.id, np.inf))
    return limits


def not_testable(problem: Problem, projector: Projector, bank: Bank) -> list[str]:
    """Ids that the set-up, the axes that move, or the other parameters hide in this campaign."""
    limits = detection_limits(projector, bank)
    waves = [i for i in registry.all_ids(problem.chain) if i not in limits and _is_scanned(i, problem.chain)]
    return sorted(
        [i for i, limit in limits.items() if limit > problem.settings.testable_size]
        + [i for i in waves if not _shows(problem, i)]
    )


def _is_scanned(effect_id: str, chain: Chain) -> bool:
    """Whether an effect is read off a spectrum."""
    return registry.effect_class(effect_id, chain)[0].search.scanned


def _shows(problem: Problem, effect_id: str) -> bool:
    """Whether a wave on the effect's axis reaches any reading: the axis is seen, and moves where the wave is one of
    its position.
    """
    cls, subject = registry.effect_class(effect_id, problem.chain)
    i = problem.chain.index(subject)
    return any(
        np.abs(s.axes[:, i]).max() > _SEEN[problem.chain.is_rotary(subject)] and (cls.kind == "vibration" or m.moves[i])
        for s, m in zip(problem.sensitivity, problem.motions, strict=True)
    )
