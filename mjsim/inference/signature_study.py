"""One effect at a fitted model: what it changes in the readings, what it explains, and what looks like it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.inference.considered import with_instrument
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.inference.least_squares import LeastSquares, ridge_solution
from mjsim.inference.problem import Problem
from mjsim.inference.shares import unabsorbed
from mjsim.inference.signatures import Candidate, Projector, SignatureBank, seeds
from mjsim.inference.spectrum import sides_of, spectral_candidates
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine, build

#: Power of a signature that set-up and data sheet leave, below which it counts as hidden.
_HIDDEN = 1e-6
#: Standard deviations of its size from which an effect is shown at its fitted size, otherwise at a typical one.
_SEEN = 3.0


@dataclass(frozen=True)
class SignatureStudy:
    """One effect at a fitted model.

    Attributes:
        fit: The model, with or without the effect.
        effect: At the size that is shown: the fitted one, or a typical one where nothing of it is seen.
        fitted: Whether it is the fitted size.
        estimate: The effect at its estimate beside everything else in the model.
        ci95: 95 % intervals of the estimate, in the units of the names.
        gain: How far the objective falls with the effect.
        absorbed: Share of its power that ball offsets, bar length and triggers take up.
        hidden: Whether set-up, data sheet and the rest of the model leave nothing of it.
        parts: What it changes in the block means once the set-up is fitted, (m,) per test, m.
        without: Measured less everything else in the model, block means, (m,) per test, m.
        alike: Cosine of every other effect's signature with this one, once the set-up is fitted, the largest first.
    """

    fit: Fit
    effect: Effect
    fitted: bool
    estimate: Effect
    ci95: dict
    gain: float
    absorbed: float
    hidden: bool
    parts: list[np.ndarray]
    without: list[np.ndarray]
    alike: dict[str, float]


def study_of_member(problem: Problem, fit: Fit, member: EffectVector) -> SignatureStudy:
    """Study an effect that the fitted model has.

    Args:
        problem: The measured tests.
        fit: The fitted model.
        member: One of its effects.
    """
    off = member.at(member.off)
    machine = fit.machine.with_effect(off) if member.effect.kind != "pitch_error" else _without_waves(fit, member)
    parts = problem.difference(problem.readings(build(machine)), fit.readings, fit.nuisance)
    left = unabsorbed(problem, fit, parts)
    covariance = fit.covariance_of(member)
    x = member.vector - member.off
    linear = np.arange(len(x)) if member.effect.kind == "pitch_error" or not member.linear else np.array(member.linear)
    precision = np.linalg.inv(covariance[np.ix_(linear, linear)])
    rest = problem.residual(fit.readings, fit.nuisance)
    bank = SignatureBank(problem, fit)
    bank.compute(seeds(fit.base))
    setup, vector = _Setup(fit), problem.whiten(left)
    return SignatureStudy(
        fit,
        member.effect,
        True,
        member.effect,
        member.interval(member.vector, with_instrument(problem, fit).covariance_of(member)),
        float(x[linear] @ precision @ x[linear]),
        _absorbed(problem.whiten(parts), vector),
        False,
        left,
        [r + p for r, p in zip(rest, left, strict=True)],
        _alike(fit, bank, setup, vector, member.effect.id),
    )


def study_of_candidate(problem: Problem, fit: Fit, effect_id: str) -> SignatureStudy | None:
    """Study an effect that the fitted model lacks, from its best starting point.

    Args:
        problem: The measured tests.
        fit: The fitted model.
        effect_id: ``kind.SUBJECT``.

    Returns:
        The study, or ``None`` where the effect has no signature in these tests.
    """
    bank = SignatureBank(problem, fit)
    bank.compute(seeds(fit.base))
    own = [(c, w) for c, w in _own(problem, fit, bank, effect_id) if w.any()]
    if not own:
        return None
    projector = Projector(fit)
    gain, x, candidate, columns = max(((*projector.gain(w), c, w) for c, w in own), key=lambda row: row[0])
    normal = projector.normal(columns)[0]
    left = np.diag(normal)
    hidden = bool((left <= _HIDDEN * np.square(columns).sum(axis=0)).all())
    covariance = ridge_solution(normal, np.eye(len(x)), 1e-9 * max(float(left.max()), 1e-30))
    seen = gain > _SEEN**2 and not hidden
    shown = x if seen else _typical(candidate, len(x))
    free = EffectVector(candidate.effect, candidate.names)
    here = free.with_effect(_at(fit, free, x))
    parts = unabsorbed(problem, fit, [c @ shown for c in _unwhitened(bank, candidate)])
    setup = _Setup(fit)
    vector = setup.left(columns @ shown)
    return SignatureStudy(
        fit,
        _at(fit, free, shown),
        seen,
        here.effect,
        _free(here.interval(here.vector, _whole(free, covariance))),
        gain,
        _absorbed(columns @ shown, vector),
        hidden,
        parts,
        problem.residual(fit.readings, fit.nuisance),
        _alike(fit, bank, setup, vector, effect_id),
    )


def _absorbed(whole: np.ndarray, left: np.ndarray) -> float:
    """Share of a signature's power that is gone in what is left of it."""
    power = float(whole @ whole)
    return 1.0 - float(left @ left) / power if power else 1.0


def _without_waves(fit: Fit, member: EffectVector) -> Machine:
    """The model with a pitch error as its prior expects it."""
    expected = member.off
    return fit.machine.with_effect(member.at(expected)) if expected.any() else fit.machine.without(member.effect.key)


class _Setup:
    """What ball offsets, bar length and triggers leave of whitened columns."""

    def __init__(self, fit: Fit) -> None:
        self.design = fit.design.of_nuisances
        self.equations = LeastSquares.of_design(fit.nuisances, self.design)

    def left(self, columns: np.ndarray) -> np.ndarray:
        """Columns (count,) or (count, k) without what the set-up can take up."""
        return columns - self.design @ self.equations.solve(self.design.T @ columns)


def _unwhitened(bank: SignatureBank, c: Candidate) -> list[np.ndarray]:
    """Block-mean signatures of a candidate, (m, k) per test in m per typical size; waves as sine and cosine."""
    if c.effect.kind != "pitch_error":
        return bank.columns(c)
    waves = [sides_of(bank, c.effect, order) for order, _, _ in c.effect.values["components"]]
    return bank.problem.map(lambda k: np.hstack([wave(k) for wave in waves]))


def _own(problem: Problem, rest: Fit, bank: SignatureBank, effect_id: str) -> list[tuple[Candidate, np.ndarray]]:
    """Starting points of one effect, with their whitened columns."""
    own = [(c, bank.matrix[:, s]) for c, s in zip(bank.candidates, bank.slices, strict=True) if c.id == effect_id]
    subject = effect_id.partition(".")[2]
    if not own and subject in problem.chain.letters:
        own = [
            (c, w)
            for c, w in spectral_candidates(problem, rest, bank, subject)
            if c.id == effect_id and "direction" not in c.effect.values
        ]
    return own


def _typical(candidate: Candidate, count: int) -> np.ndarray:
    """One typical size of the first entry, (count,)."""
    free = EffectVector(candidate.effect, candidate.names)
    seed = (free.vector - free.off)[free.linear] if candidate.effect.kind != "pitch_error" else free.vector
    out = np.zeros(count)
    out[: min(count, len(seed))] = seed[:count]
    return out if out.any() else np.eye(count)[0]


def _at(rest: Fit, free: EffectVector, x: np.ndarray) -> Effect:
    """The effect with its linear entries ``x`` away from what the model has."""
    v = free.vector
    if any(e.key == free.effect.key for e in rest.machine.effects):
        return free.at(v + x)
    if free.effect.kind == "pitch_error":
        return free.at(x)
    v[free.linear] = free.neutral + x
    return free.at(v)


def _free(intervals: dict) -> dict:
    """Intervals of what was free; a shape that is held has none."""
    return {name: ends for name, ends in intervals.items() if ends[0] != ends[1]}


def _whole(free: EffectVector, covariance: np.ndarray) -> np.ndarray:
    """Covariance of all entries; shapes that are held count as known."""
    n = len(free.vector)
    if len(covariance) == n:
        return covariance
    out = np.zeros((n, n))
    out[np.ix_(free.linear, free.linear)] = covariance
    return out


def _alike(rest: Fit, bank: SignatureBank, setup: _Setup, vector: np.ndarray, effect_id: str) -> dict[str, float]:
    """Largest cosine of each other effect's signature with ``vector``, both without what the set-up takes up."""
    out: dict[str, float] = {}
    rows = [(c.id, bank.matrix[:, s]) for c, s in zip(bank.candidates, bank.slices, strict=True)]
    rows += [(f.effect.id, rest.design.columns(rest.parameters[f.block.name])) for f in rest.effects]
    size = float(vector @ vector)
    for name, columns in rows:
        power = np.square(columns).sum(axis=0)
        left = setup.left(columns[:, power > 0.0])
        left = left[:, np.square(left).sum(axis=0) > _HIDDEN * power[power > 0.0]]
        if name == effect_id or not left.shape[1] or not size:
            continue
        score = left.T @ vector
        normal = left.T @ left
        explained = float(score @ ridge_solution(normal, score, 1e-9 * float(np.diag(normal).max())))
        out[name] = max(out.get(name, 0.0), float(np.sqrt(min(max(explained / size, 0.0), 1.0))))
    return dict(sorted(out.items(), key=lambda item: -item[1]))
