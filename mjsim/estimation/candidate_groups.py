"""All candidates beside a fitted model as one whitened linear problem: the model's own effects, and the catalogue."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.evidence import Group, LinearProblem
from mjsim.estimation.fit import Fit
from mjsim.estimation.one_direction import one_direction_candidates
from mjsim.estimation.problem import Problem
from mjsim.estimation.settings import DiagnosisSettings
from mjsim.estimation.signatures import Candidate, Projector, SignatureBank, seeds
from mjsim.estimation.spectrum import spectral_candidates

#: Waves per axis that are looked at, and how many orders they are chosen from.
_WAVES, ORDERS = 6, 800


@dataclass(frozen=True)
class Member:
    """What a group stands for.

    Attributes:
        free: The model's own effect, or ``None``.
        wave: Which of its components, for a pitch error.
        entries: Which entries of its vector.
        candidate: An effect that is not in the model, or ``None``.
    """

    free: EffectVector | None = None
    wave: int | None = None
    entries: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    candidate: Candidate | None = None

    @property
    def key(self) -> str:
        """Key of the effect."""
        mine = self.free or self.candidate
        return mine.effect.key if mine else ""


@dataclass(frozen=True)
class CandidateGroups:
    """The linear problem at a fitted model.

    Attributes:
        problem: Information and score of all columns; what is always in the model is marginalised.
        groups: What may be in the model or not.
        members: What each group stands for.
        settings: What decides in a diagnosis.
    """

    problem: LinearProblem
    groups: tuple[Group, ...]
    members: tuple[Member, ...]
    settings: DiagnosisSettings

    @classmethod
    def at(cls, problem: Problem, fit: Fit, bank: SignatureBank) -> CandidateGroups:
        """The groups at a fitted model.

        Args:
            problem: The measured tests.
            fit: The fitted model.
            bank: Signatures at a model near ``fit``; those of effects that are not in the model are used.
        """
        settings = problem.settings
        blocks: list[np.ndarray] = []
        members: list[Member] = []
        odds: list[float] = []
        parameters = fit.parameters
        places = []
        for f in fit.effects:
            at = np.arange(parameters.size)[parameters[f.block.name]]
            for wave, entries in own_groups(f):
                places.append(at[entries])
                members.append(Member(free=f, wave=wave, entries=entries))
                odds.append(settings.log_odds)
        others = _candidates(problem, fit, bank)
        count: dict[str, int] = {}
        for c, _ in others:
            count[c.id] = count.get(c.id, 0) + 1
        for c, columns in others:
            blocks.append(columns)
            members.append(Member(candidate=c))
            tried = ORDERS if c.effect.kind == "pitch_error" else count[c.id]
            odds.append(settings.log_odds - math.log(tried))
        return cls(*_marginalised(fit, places, blocks, odds), tuple(members), settings)


def own_groups(f: EffectVector) -> list[tuple[int | None, np.ndarray]]:
    """Linear entries of an effect of the model, wave by wave: which wave, and the entries of its vector."""
    if f.effect.kind == "pitch_error":
        return [(i, np.array([2 * i, 2 * i + 1])) for i in range(len(f.vector) // 2)]
    return [(None, np.array(f.linear if f.linear else range(len(f.vector))))]


def _marginalised(fit: Fit, places: list[np.ndarray], blocks: list[np.ndarray], odds: list[float]):
    """The linear problem of the model's own groups (``places`` in the vector) and of further ``blocks`` of columns;
    its groups.
    """
    p = fit.parameters
    inside = np.concatenate(places) if places else np.zeros(0, int)
    always = np.setdiff1d(np.arange(p.size), inside)
    vector = fit.vector
    neutral = vector.copy()
    for f in fit.effects:
        at = np.arange(p.size)[p[f.block.name]]
        neutral[at] = f.off
    # the residual with everything at its prior mean: what is always in at the mean, the groups at off
    reference = np.where(np.isin(np.arange(p.size), inside), neutral, np.where(p.informative, p.mean, vector))
    residual = fit.residual + fit.design @ (vector - reference)
    columns = np.hstack([fit.design.columns(inside), *blocks])
    linear = LinearProblem.marginalised(columns, residual, fit.design.without(inside), p.precision(1.0)[always])
    widths = [*(len(x) for x in places), *(b.shape[1] for b in blocks)]
    ends = np.cumsum([0, *widths])
    groups = tuple(
        Group(str(i), np.arange(a, b), log_odds=o)
        for i, (a, b, o) in enumerate(zip(ends[:-1], ends[1:], odds, strict=True))
    )
    return linear, groups


def _candidates(problem: Problem, fit: Fit, bank: SignatureBank) -> list[tuple[Candidate, np.ndarray]]:
    """What is not in the model, with its whitened columns: other effects, further waves of a pitch error, and other
    orders of an error motion whose tolerance is in it.
    """
    have = {f.effect.key: f for f in fit.effects}
    if not bank.candidates:
        bank.compute(seeds(fit.base))
    out = []
    for c, columns in zip(bank.candidates, bank.slices, strict=True):
        mine = have.get(c.effect.key)
        if mine is None:
            out.append((c, bank.matrix[:, columns]))
    out += one_direction_candidates(fit, bank, Projector(fit).screen(bank))
    for axis in fit.base.chain.letters:
        for c, columns in spectral_candidates(problem, fit, bank, axis, _WAVES):
            mine = have.get(c.effect.key)
            if mine is None:
                out.append((c, columns))
            elif c.effect.kind == "pitch_error":
                orders = {round(row[0]) for row in mine.effect.values["components"]}
                if round(c.effect.values["components"][0][0]) not in orders:
                    out.append((c, columns))
    return out
