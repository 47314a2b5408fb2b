"""Model selection for machines on which much is a little wrong: all candidates together in one linear problem, by
evidence.

First everything that a machine of its class may have is fitted at once, with its tolerance as prior. Where no tolerance
is stated, typical sizes stand in, and what the data prove is a finding whatever its size. At that model all other
candidates, and what each expected effect may have beyond its tolerance, stand together in one whitened linear problem.
Sparse Bayesian selection says which of them the data need (:mod:`mjsim.estimation.evidence`). The model is fitted again
with these, until nothing changes. Where something is left that no named effect explains, generic curves of one axis'
motion compete with them: where a curve is the better explanation, the cause is in no catalogue.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mjsim.estimation.calibration import Calibrated, expected_effects
from mjsim.estimation.candidate_groups import CandidateGroups
from mjsim.estimation.criteria import causes, is_feasible
from mjsim.estimation.curve_terms import CurveTerm
from mjsim.estimation.disturbances import without_disturbances
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.equivalents import Equivalents
from mjsim.estimation.evidence import SparseModel, log_evidence, select
from mjsim.estimation.evidence_priors import added, kept_waves
from mjsim.estimation.fit import Fit, Fitter
from mjsim.estimation.one_curve import one_curve
from mjsim.estimation.outcome import Found, JointSelection, Selection
from mjsim.estimation.retiming import retimed
from mjsim.estimation.servo_fault import with_servo_fault
from mjsim.estimation.signatures import SignatureBank
from mjsim.estimation.verdicts import beyond, is_beyond, proven
from mjsim.estimation.visibility import clear_tests
from mjsim.progress import Progress, silent

#: Most rounds of selection and refit; most Gauss-Newton steps of the first fit and of the others. Waves of a pitch
#: error and trigger shifts need many: an unfinished fit asks for causes that are not there.
_ROUNDS, _FIRST, _STEPS = 6, 16, 8
#: The same with another effect in the place of a finding: one that fits as well is soon there.
_TRIAL_STEPS = 6
#: A model that leaves so much more than the one before it is not taken.
_WORSE = 1.1
#: Signatures are computed again where the misfit has fallen to this share.
_NEARER = 0.5


@dataclass
class _Model:
    """The model in the making.

    Attributes:
        fit: Its fit.
        kept: What stays in it whatever the data say.
        expected: All effects that a machine of its class may have, by key.
        bank: Signatures of the candidates.
        bank_misfit: Mean square of the whitened residuals at which they were computed.
        curve: A curve beside the effects.
    """

    fit: Fit
    kept: dict[str, Calibrated]
    expected: dict[str, Calibrated]
    bank: SignatureBank
    bank_misfit: float = np.inf
    curve: CurveTerm | None = None


class JointSelector:
    """Runs one joint selection."""

    def __init__(self, fitter: Fitter, progress: Progress = silent) -> None:
        self.fitter, self.problem, self.progress = fitter, fitter.problem, progress
        self.settings = fitter.problem.settings

    def run(self) -> JointSelection:
        """Fit what the machine may have, select what else the data need, and release what lies beyond its tolerance."""
        machine = self.fitter.machine
        expected = {c.key: c for c in expected_effects(machine)}
        self.progress("fitting everything that a machine may have", 0, 1)
        first = self._first_fit([c.free for c in expected.values()])
        start = self.fitter.fit([], exact=False)
        model = _Model(first, dict(expected), expected, SignatureBank(self.problem, first))
        for number in range(_ROUNDS):
            self.progress("selecting causes by evidence", number, _ROUNDS)
            if not self._select(model) and not self._release(model) and not self._retime(model):
                break
        model.fit = self._exact_refit(model.fit.effects, model.fit)
        self._without_invisible(model)
        self._return(model)
        instead = self._one_curve(model, first)
        if instead is not None:
            fit, curve = instead
            selection = Selection(start, fit, [], model.bank)
            return JointSelection(self.problem, selection, tuple(expected.values()), curve, alone=True)
        if not machine.tolerance and model.curve is None:  # beside something unknown nothing small is proven
            for key in proven(model.fit, model.kept, self.settings.log_odds):
                del model.kept[key]
        refit = partial(self.fitter.fit, start=model.fit, exact=True, iterations=_TRIAL_STEPS, fresh=False)
        others = Equivalents(self.problem, model.fit, model.bank, model.expected, refit)
        found = []
        for key, gain in causes(model.fit, self.fitter.machine, self.settings, set(model.kept)).items():
            self.progress(f"what could stand in place of {key}", 0, 1)
            found.append(Found(key, gain, others.of(key)))
        return JointSelection(
            self.problem, Selection(start, model.fit, found, model.bank), tuple(model.kept.values()), model.curve
        )

    def _first_fit(self, effects: list[EffectVector]) -> Fit:
        """Everything that a machine may have, fitted to data without what then stands out as having happened once."""
        fit = with_servo_fault(self._fresh_fit, self._fresh_fit(effects), self.settings.indistinguishable)
        data = without_disturbances(self.problem, fit.readings, fit.nuisance)
        if data is self.problem:
            return fit
        self.problem, self.fitter = data, self.fitter.with_problem(data)
        return self._refit(list(fit.effects), None, _FIRST)

    def _fresh_fit(self, effects: list[EffectVector]) -> Fit:
        """Effects fitted from the machine as given."""
        fit = self._refit(effects, None, _FIRST)
        better = retimed(self.problem, fit)
        return fit if better is None else self._refit(list(fit.effects), better, _FIRST)

    def _select(self, model: _Model) -> bool:
        """Replace the free effects of the model by those that the data need; whether that changed it."""
        misfit = model.fit.sum_squares / self.problem.count
        if misfit < _NEARER * model.bank_misfit:
            model.bank, model.bank_misfit = SignatureBank(self.problem, model.fit), misfit
        # a curve has nothing to explain where the effects explain everything
        curves = misfit > self.settings.complete_fit
        groups = CandidateGroups.at(self.problem, model.fit, model.bank, set(model.kept), curves)
        weight = max(1.0, misfit)
        chosen = self._chosen(groups, weight)
        model.curve = next((groups.members[g].curve for g in chosen.precision if groups.members[g].curve), None)
        kept = self._kept(model, groups, chosen)
        effects = self._effects(model, groups, chosen, kept)
        before = [(f.effect.key, len(f.vector)) for f in model.fit.effects]
        after = [(f.effect.key, len(f.vector)) for f in effects]
        if sorted(before) == sorted(after) and set(kept) == set(model.kept):
            return False
        fit = self._refit(effects, model.fit, _STEPS)
        if fit.objective > model.fit.objective:  # worse with what the data need: the fit has lost its way
            fit = min(fit, self._exact_refit(effects, model.fit), key=lambda f: f.objective)
        if model.curve is None and fit.sum_squares > _WORSE * model.fit.sum_squares:
            return False  # what the linear problem promised is not there
        model.fit, model.kept = fit, kept
        return True

    @staticmethod
    def _kept(model: _Model, groups: CandidateGroups, chosen: SparseModel) -> dict[str, Calibrated]:
        """The expected effects that the evidence does not put beyond their tolerance."""
        needed = {groups.members[g].key for g in chosen.precision}
        return {key: c for key, c in model.expected.items() if key not in needed}

    def _chosen(self, groups: CandidateGroups, weight: float) -> SparseModel:
        """The groups of largest evidence: with named effects and curves together, or one curve instead of them
        where that is better.
        """
        linear, machine = groups.problem.scaled(weight), self.fitter.machine
        curves = {g for g, m in enumerate(groups.members) if m.curve is not None}
        excluded: set[int] = set()
        while True:
            chosen = select(linear, groups.groups, tuple(excluded))
            impossible = {
                g
                for g in chosen.precision
                if (c := groups.members[g].candidate) is not None
                and not is_feasible(machine, chosen.value(groups.groups[g]), c)
            }
            if not impossible:
                break
            excluded |= impossible
        if not curves & set(chosen.precision):
            return chosen
        # a curve is needed beside the named effects: without it they would have to do, and without them the curve would
        named = select(linear, groups.groups, tuple(excluded | curves))
        own = {g for g, m in enumerate(groups.members) if m.free is not None}
        alone = select(linear, groups.groups, tuple(set(range(len(groups.groups))) - own - curves))
        return max(named, alone, key=lambda s: log_evidence(linear, groups.groups, s))

    def _effects(
        self, model: _Model, groups: CandidateGroups, chosen: SparseModel, kept: dict[str, Calibrated]
    ) -> list[EffectVector]:
        """Effects of the next model: what is kept, with its tolerance as prior, and what was chosen, with the width
        that the evidence gave it.
        """
        best_first = sorted(chosen.precision, key=lambda g: -chosen.log_odds[g])
        new = [(g, c) for g in best_first if (c := groups.members[g].candidate) is not None]
        out = []
        for f in model.fit.effects:
            key = f.effect.key
            mine = {m.wave: g for g, m in enumerate(groups.members) if m.free is f and g in chosen.precision}
            if key in kept:
                out.append(f if key in model.kept else kept[key].at(f))
            elif key in model.kept:
                if not any(c.effect.key == key and c.at_another_order(f.effect) for _, c in new):
                    out.append(EffectVector(f.effect, f.names))
            elif mine:
                out.append(kept_waves(f, {wave: chosen.precision[g] for wave, g in mine.items()}))
        for g, c in new:
            x = chosen.value(groups.groups[g])
            same = next((i for i, f in enumerate(out) if f.effect.key == c.effect.key), None)
            if same is not None and c.effect.kind != "pitch_error":
                continue  # another place of the same cause: the refit finds the best one
            new_effect = added(self.fitter.machine, EffectVector(c.effect, c.names), x, chosen.precision[g])
            if same is None:
                out.append(new_effect)
            else:
                out[same] = out[same].with_waves(new_effect)
        return out

    def _release(self, model: _Model) -> bool:
        """Fit the effect freely that lies farthest beyond its tolerance with its whole interval, if there is one: this
        is a finding. One at a time: what one cause does, several others share as long as it is held back.
        """
        misfit = model.fit.sum_squares / self.problem.count
        far = {
            f.effect.key: beyond(model.fit, f, model.kept[f.effect.key], misfit)
            for f in model.fit.effects
            if f.effect.key in model.kept
        }
        key = max(far, key=lambda k: far[k], default=None)
        if key is None or far[key] <= 1.0:
            return False
        del model.kept[key]
        effects = [EffectVector(f.effect, f.names) if f.effect.key == key else f for f in model.fit.effects]
        model.fit = self._refit(effects, model.fit, _STEPS)
        return True

    def _retime(self, model: _Model) -> bool:
        """Fit again with triggers that had followed what the model lacked; whether there were such."""
        if (better := retimed(self.problem, model.fit)) is not None:
            model.fit = self._refit(list(model.fit.effects), better, _STEPS)
        return better is not None

    def _return(self, model: _Model) -> None:
        """Put what came to lie within its tolerance again among what is calibrated."""
        free = [f for f in model.fit.effects if f.effect.key in model.expected and f.effect.key not in model.kept]
        if not (inside := {f.effect.key for f in free if not is_beyond(model.fit, f, model.expected[f.effect.key])}):
            return
        model.kept |= {key: model.expected[key] for key in inside}
        effects = [model.expected[f.effect.key].at(f) if f.effect.key in inside else f for f in model.fit.effects]
        model.fit = self._exact_refit(effects, model.fit)

    def _one_curve(self, model: _Model, first: Fit) -> tuple[Fit, CurveTerm] | None:
        """One generic curve in place of all findings, where the evidence is for it."""
        named = [f.effect.key for f in model.fit.effects if f.effect.key not in model.kept]
        if model.curve is not None or not named:
            return None
        self.progress("one cause outside the catalogue against all that was named", 0, 1)
        if len(first.effects) > len(model.expected):  # it has a servo fault
            first = self._fresh_fit([c.free for c in model.expected.values()])
        return one_curve(self.fitter, first, model.fit, named)

    def _without_invisible(self, model: _Model) -> None:
        """Drop what was selected, but stands out of no test."""
        new = [f.effect.key for f in model.fit.effects if f.effect.key not in model.expected]
        if hidden := {key for key in new if not clear_tests(self.problem, model.fit, key)}:
            seen = [f for f in model.fit.effects if f.effect.key not in hidden]
            model.fit = self._exact_refit(seen, model.fit)

    def _refit(self, effects: list[EffectVector], start: Fit | None, iterations: int) -> Fit:
        """Joint fit; exact where the model comes near the data: a linearised data sheet is driven far off there."""
        fit = self.fitter.fit(effects, start=start, exact=False, iterations=iterations)
        if fit.sum_squares > self.settings.close_fit * self.problem.count:
            return fit
        limit = self.settings.close_sheet
        near = replace(fit, sheet_deviation=np.clip(fit.sheet_deviation, -limit, limit))
        return self.fitter.fit(fit.effects, start=near, exact=True, iterations=2, fresh=False)

    def _exact_refit(self, effects: list[EffectVector] | tuple[EffectVector, ...], start: Fit) -> Fit:
        """Joint fit from where ``start`` ended, exact at once: from there a linearised data sheet is driven far off."""
        return self.fitter.fit(effects, start=start, exact=True, iterations=_STEPS, fresh=False)
