"""Effects of the catalogue that could stand in place of a finding of the joint selection."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mjsim.estimation.candidate_groups import CandidateGroups
from mjsim.estimation.criteria import is_feasible, is_large_enough
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.evidence import best_precision, log_bayes_factor
from mjsim.estimation.fit import Fit
from mjsim.estimation.signatures import Candidate
from mjsim.machine.model import Machine

#: A candidate, its linear estimate and the precision of its prior as an effect of a model.
AddedEffect = Callable[[Machine, EffectVector, np.ndarray, float], EffectVector]


def equivalents(
    fit: Fit, groups: CandidateGroups, key: str, refit: Callable[[list[EffectVector]], Fit], added: AddedEffect
) -> dict[str, Fit]:
    """Models with another effect in the place of one finding that explain the data as well, by that effect's id.

    Args:
        fit: The final model.
        groups: All candidates beside it.
        key: Of the finding.
        refit: Fits a model with the given effects.
        added: Makes an effect of a model of a candidate.
    """
    settings = groups.settings
    rest = [f for f in fit.effects if f.effect.key != key]
    out: dict[str, Fit] = {}
    for c, x, precision in _near(fit, groups, key):
        new = added(fit.base, EffectVector(c.effect, c.names), x, precision)
        same = next((f for f in rest if f.effect.key == c.effect.key), None)  # a pitch error with other waves
        trial = refit([*(f for f in rest if f is not same), same.with_waves(new) if same else new])
        mine = next(f for f in trial.effects if f.effect.key == c.effect.key)
        if not is_large_enough(fit.base, mine, settings):
            continue
        if trial.sum_squares < fit.sum_squares + settings.indistinguishable:
            out[c.id] = trial
    return out


def _near(fit: Fit, groups: CandidateGroups, key: str) -> list[tuple[Candidate, np.ndarray, float]]:
    """Candidates that reach nearly the finding's evidence in its place, the best of each effect, with their linear
    estimates and prior precisions.
    """
    own = [g for g, m in enumerate(groups.members) if m.free is not None and not m.excess]
    mine = [g for g in own if groups.members[g].key == key]
    others = [g for g in own if g not in mine]
    columns = np.concatenate([groups.groups[g].columns for g in others]) if others else np.zeros(0, int)
    beside = groups.problem.beside(columns, np.concatenate([_precisions(groups, g) for g in others] or [np.zeros(0)]))
    at = np.concatenate([groups.groups[g].columns for g in mine])
    information, score = beside.gram[np.ix_(at, at)], beside.score[at]
    here = log_bayes_factor(information, score, best_precision(information, score)[0])
    rows = []
    for g, member in enumerate(groups.members):
        c = member.candidate
        if c is None or c.effect.key == key:
            continue
        information, score = beside.of(groups.groups[g])
        precision, gain = best_precision(information, score)
        if not np.isfinite(precision) or gain < groups.settings.equivalent_share * here:
            continue
        x = np.linalg.solve(information + precision * np.eye(len(score)), score)
        if is_feasible(fit.base, x, c):
            rows.append((gain, c, x, precision))
    best: dict[str, tuple] = {}
    for row in sorted(rows, key=lambda r: -r[0]):
        best.setdefault(row[1].effect.key, row[1:])
    return list(best.values())[: groups.settings.most_equivalents]


def _precisions(groups: CandidateGroups, g: int) -> np.ndarray:
    """Prior precisions of the entries of one of the model's own groups."""
    member = groups.members[g]
    assert member.free is not None
    entries = member.entries
    prior = member.free.prior
    return np.full(len(entries), 1e-6) if prior is None else prior[1][entries] ** -2.0
