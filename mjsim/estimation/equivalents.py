"""What could stand in the place of a finding of the joint selection: another effect of the catalogue, or what a machine
of its class has anyway, beyond its tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mjsim.estimation.calibration import Calibrated
from mjsim.estimation.candidate_groups import CandidateGroups, Member
from mjsim.estimation.criteria import is_feasible, is_large_enough, looks_like, stands_for
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.evidence import best_precision, log_bayes_factor
from mjsim.estimation.evidence_priors import WIDE, added
from mjsim.estimation.fit import Fit
from mjsim.estimation.problem import Problem
from mjsim.estimation.signatures import SignatureBank
from mjsim.estimation.verdicts import is_beyond
from mjsim.machine.effect import Effect

#: Fits a model with the given effects.
Refit = Callable[[list[EffectVector]], Fit]


@dataclass(frozen=True)
class Equivalents:
    """Looks for what could stand in the place of the findings of one model.

    Attributes:
        problem: The measured tests.
        fit: The final model.
        bank: Signatures of what is not in it.
        expected: All effects that a machine of its class may have, by key; those of the model with a prior were held to
            their tolerance.
        refit: Fits a model with the given effects, starting from the final one.
    """

    problem: Problem
    fit: Fit
    bank: SignatureBank
    expected: Mapping[str, Calibrated]
    refit: Refit

    @cached_property
    def _held(self) -> set[str]:
        """Keys of the effects that the model holds to their tolerance."""
        return {f.effect.key for f in self.fit.effects if f.effect.key in self.expected and f.prior is not None}

    @cached_property
    def _groups(self) -> CandidateGroups:
        """The linear problem of the findings and of all that could stand in their place."""
        released = [f if f.effect.key in self._held else self._from_mean(f) for f in self.fit.effects]
        start = replace(self.fit, effects=tuple(released))
        return CandidateGroups.at(self.problem, start, self.bank, self._held, curves=False)

    def _from_mean(self, f: EffectVector) -> EffectVector:
        """A finding that counts from where its tolerance is centred, as friction from the data sheet's."""
        mine = self.expected.get(f.effect.key)
        if mine is None or len(mine.mean) != len(f.vector):  # a pitch error may have further waves
            return f
        return f.with_prior(mine.mean, np.full(len(mine.mean), WIDE))

    def of(self, key: str) -> dict[str, Fit]:
        """Models with another effect in the place of one finding that explain the data as well, by that effect's id.

        A finding that a machine of its class may have goes back to its tolerance, another one leaves the model. Within
        its tolerance nothing stands in its place: the others would have to be there besides. A cause of an unlikely
        size is named only beside a likely one that it looks like, where no likely one explains more.
        """
        finding, mine = next(f for f in self.fit.effects if f.effect.key == key), self.expected.get(key)
        if key in self._held or (mine is not None and not is_beyond(self.fit, finding, mine)):
            return {}
        rest = [f for f in self.fit.effects if f is not finding]
        if mine is not None:
            rest.append(mine.free)
        settings = self.problem.settings
        likely: dict[str, Fit] = {}
        unlikely: list[tuple[EffectVector, Fit]] = []
        effects = [finding.effect]
        for member, x, precision in self._near(finding.effect):
            trial = self.refit(self._with(rest, member, x, precision))
            other = next(f for f in trial.effects if f.effect.key == member.key)
            if member.key in self._held:
                is_likely = is_beyond(trial, other, self.expected[member.key])
            else:
                is_likely = is_large_enough(self.fit.base, other, settings)
            if trial.objective < self.fit.objective + settings.indistinguishable:
                if is_likely:
                    likely[other.effect.id] = trial
                    effects.append(other.effect)
                else:
                    unlikely.append((other, trial))
        limit = min(fit.objective for fit in (self.fit, *likely.values())) + settings.better
        close = [(other, trial) for other, trial in unlikely if trial.objective < limit]
        return likely | {f.effect.id: trial for f, trial in close if any(stands_for(f, e) for e in effects)}

    def _with(self, rest: list[EffectVector], member: Member, x: np.ndarray, precision: float) -> list[EffectVector]:
        """The effects of the model with one more, or with one of them released from its tolerance."""
        if member.excess:
            return [EffectVector(f.effect, f.names) if f.effect.key == member.key else f for f in rest]
        c = member.candidate
        assert c is not None
        new = added(self.fit.base, EffectVector(c.effect, c.names), x, precision)
        # a pitch error with further waves, or an error motion that takes the place of one of another order
        same = next((f for f in rest if f.effect.key == c.effect.key), None)
        waves = same is not None and c.effect.kind == "pitch_error"
        return [*(f for f in rest if f is not same), same.with_waves(new) if same and waves else new]

    def _near(self, finding: Effect) -> list[tuple[Member, np.ndarray, float]]:
        """What reaches nearly the finding's evidence in its place, the best group of each effect, with the linear
        estimate and the prior precision.
        """
        groups, members, key = self._groups, self._groups.members, finding.key
        mine = [g for g, m in enumerate(members) if m.key == key and m.free is not None]
        own = [g for g, m in enumerate(members) if m.free is not None and not m.excess and m.key != key]
        columns = np.concatenate([groups.groups[g].columns for g in own]) if own else np.zeros(0, int)
        precisions = np.concatenate([np.zeros(0), *(_precisions(members[g]) for g in own)])
        beside = groups.problem.beside(columns, precisions)
        at = np.concatenate([groups.groups[g].columns for g in mine])
        information, score = beside.gram[np.ix_(at, at)], beside.score[at]
        here = log_bayes_factor(information, score, best_precision(information, score)[0])
        rows = []
        for g, member in enumerate(members):
            if member.key == key or not (member.excess or member.candidate):
                continue
            information, score = beside.of(groups.groups[g])
            precision, gain = best_precision(information, score)
            if not np.isfinite(precision):
                continue
            gain += groups.groups[g].log_odds - groups.settings.log_odds  # one of many waves: by chance more likely
            if gain < self._share(member, finding.subject) * here:
                continue
            x = np.linalg.solve(information + precision * np.eye(len(score)), score)
            c = member.candidate
            if c is None or is_feasible(self.fit.base, x, c) or looks_like(c.effect, finding):
                rows.append((gain, member, x, precision))
        best: dict[str, tuple[Member, np.ndarray, float]] = {}
        for _, member, x, precision in sorted(rows, key=lambda r: -r[0]):
            best.setdefault(member.key, (member, x, precision))
        return list(best.values())[: groups.settings.most_equivalents]

    def _share(self, member: Member, subject: str) -> float:
        """Share of the finding's evidence that this must reach in its place by the linear estimate."""
        mine = member.free or member.candidate
        assert mine is not None
        settings, effect = self.problem.settings, mine.effect
        of_drive = effect.subject == subject and not effect.search.quasi_static
        return settings.equivalent_share_drive if of_drive else settings.equivalent_share


def _precisions(member: Member) -> np.ndarray:
    """Prior precisions of the entries of one of the model's own groups."""
    assert member.free is not None
    prior = member.free.prior
    return np.full(len(member.entries), 1e-6) if prior is None else prior[1][member.entries] ** -2.0
