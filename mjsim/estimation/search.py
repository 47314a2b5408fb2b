"""The search for what a machine's model lacks: hypotheses are ranked linearly, the best are fitted exactly, and the log
evidence decides.

Two kinds of proposals are judged in each round: the best set of the linear problem as a whole, and single hypotheses
that promise much of what that set promises. Near the data the linear problem is right. Far from them it is one of
imitation, where many small things stand for one large one; there the exact fits of single hypotheses decide. A machine
for which no tolerance is stated may be as its file says but for a few causes, or have all the small errors of its
class. Both are searched, and the evidence says which it is.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mjsim.estimation.calibration import Calibrated, calibrated_effects, expected_effects
from mjsim.estimation.discrepancy import USUAL, Discrepancy, LinearModel, Products, Sizes
from mjsim.estimation.disturbances import readmitted, without_disturbances
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fit, Fitter
from mjsim.estimation.hypotheses import WIDTHS, Hypotheses, Judged, Signatures, log_odds_of, with_prior_of_size
from mjsim.estimation.linear_evidence import Chosen, without
from mjsim.estimation.nuisance import TRIGGER, TRIGGERS
from mjsim.estimation.problem import Problem
from mjsim.estimation.retiming import better_triggers, retimed
from mjsim.estimation.servo_fault import with_servo_fault
from mjsim.estimation.signatures import SignatureBank, seeds, seeds_of
from mjsim.estimation.unknown_curves import Curve, best_curves
from mjsim.machine.effect import Effect
from mjsim.progress import Progress, silent

#: Gain in log evidence below which a model is not taken for better, nats: odds of twenty to one (Kass and Raftery,
#: J. Am. Statist. Assoc. 90 (1995) 773-795, call them strong).
_LEAST = 3.0
#: Nothing is looked for in a discrepancy that is smaller than such a share of one sample's noise.
_SEEN = 0.5
#: Most proposals that are fitted in a round, and single hypotheses among them at each level.
_FITTED, _SINGLES = 4, 3
#: Share of the best promise from which the best single cause of the catalogue is fitted as well.
_SHARE = 1.0 / 3.0
#: Share of its promise that a proposal must keep for no other to be fitted.
_KEPT = 0.5
#: Shares of the present discrepancy at which hypotheses are judged as well: what explains most leaves much less.
_LEVELS = (0.4, 0.15, 0.0)
#: Most rounds of one search, and most causes that are added one after the other to the machine as given.
_ROUNDS, _FEW = 8, 4
#: Difference in log evidence within which another hypothesis may stand in the place of one, nats: odds of 160,000 to
#: one; the share of its log odds that the linear problem may be wrong by (assumed); and most that are fitted there.
_NEAR, _ROUGH, _RIVALS = 12.0, 0.1, 2
#: Evidence against a cause of a size that makes no sense by itself, nats: odds of one to twenty (assumed).
_UNLIKELY = 3.0
#: Most Gauss-Newton steps of the first fit of everything that a machine may have, and of the others.
_FIRST, _STEPS, _AGAIN = 16, 5, 3
#: Most waves that one pitch error is given.
_WAVES = 12
#: Most times that a model is fitted again at the sizes that it leaves.
_SETTLING = 4


@dataclass(frozen=True)
class Model:
    """A fitted model of the machine.

    Attributes:
        expected: What a machine of its class has, by key.
        fit: Effects, data sheet and set-up, whitened by ``problem``.
        problem: The measured tests with the whitening of this model.
        sizes: Of the discrepancy and the noise.
        curves: Of unknown causes.
        log_odds: Prior odds of all its hypotheses, logarithm.
        evidence: Log evidence, prior odds included.
    """

    expected: dict[str, Calibrated]
    fit: Fit
    problem: Problem
    sizes: Sizes
    curves: tuple[Curve, ...] = ()
    log_odds: float = 0.0
    evidence: float = -np.inf

    @property
    def base(self) -> Problem:
        """The tests with the same whitening, without what the curves add to it."""
        whitening = self.problem.whitening
        return self.problem if whitening is None else replace(self.problem, whitening=whitening.without_shared())

    @property
    def leaves_nothing(self) -> bool:
        """Whether what it leaves cannot be seen beside the noise."""
        return self.left < _SEEN * self.problem.noise.rms

    @property
    def left(self) -> float:
        """RMS of what it leaves besides the noise, m."""
        return self.sizes.left(self.problem.noise.rms)


@dataclass(frozen=True)
class Found:
    """Outcome of a search.

    Attributes:
        start: The machine as given, with set-up and data sheet fitted.
        model: The best model.
        bank: Signatures of the catalogue, whitened by the noise alone.
        trail: What was tried, for those who ask.
    """

    start: Fit
    model: Model
    bank: SignatureBank
    trail: list[dict] = field(default_factory=list)


#: What may be gained by a set of hypotheses, the set, and the level at which it is judged.
Proposal = tuple[float, Chosen, int]


def _best_single(hypotheses: Hypotheses, here: Chosen, judged: Sequence[Judged]) -> Proposal | None:
    """The single cause of the catalogue that promises most beside what is in the model; ``None`` where none does.

    Args:
        hypotheses: Beside the model.
        here: What is in it.
        judged: What each level says.
    """
    best: Proposal | None = None
    for level, (evidence, odds, width) in enumerate(judged):
        for g in [g for g in np.argsort(-odds) if hypotheses.all[g].curve is None][:_SINGLES]:
            promise = evidence - judged[0].evidence + float(odds[g])
            if np.isfinite(promise) and promise > (_LEAST if best is None else best[0]):
                best = promise, {**here, int(g): float(width[g])}, level
    return best


def _best_at_levels(hypotheses: Hypotheses, here: Chosen, least: float = 0.0) -> list[tuple[Chosen, int, float]]:
    """The single causes of the catalogue that do best beside what is in the model, in turn at each level, that of the
    noise alone first: a cause that explains nearly all of the data is seen best where nothing else may.

    Args:
        hypotheses: Beside the model.
        here: What is in it.
        least: Log odds below which none is worth a fit.

    Returns:
        The set with each of them, the level at which it promises most, and its log odds beside the noise alone.
    """
    judged = hypotheses.judged(here)
    ranked = []
    for _, odds, _ in reversed(judged):
        order = [int(g) for g in np.argsort(-odds) if odds[g] >= least and hypotheses.is_new_and_seen(int(g))]
        ranked.append(order[:_FITTED])
    out: dict[str, tuple[Chosen, int, float]] = {}
    for row in itertools.zip_longest(*ranked):
        for g in [g for g in row if g is not None]:
            level = max(range(len(judged)), key=lambda i, g=g: judged[i].evidence + judged[i].odds[g])
            chosen = {**here, g: float(judged[level].width[g])}
            out.setdefault(hypotheses.all[g].name, (chosen, level, float(judged[-1].odds[g])))
    return list(out.values())[:_FITTED]


def _sized(effects: Sequence[EffectVector], expected: Collection[str]) -> tuple[EffectVector, ...]:
    """Effects with priors of the widths that their sizes ask for, but for those of which a machine of the class is
    expected to have some, by key.
    """
    return tuple(f if f.effect.key in expected else with_prior_of_size(f) for f in effects)


def with_curves(problem: Problem, curves: Sequence[Curve]) -> Problem:
    """A problem with the coefficients of curves marginalised.

    Args:
        problem: With the whitening of a discrepancy.
        curves: With the widths of their priors.
    """
    if not curves:
        return problem
    assert problem.whitening is not None
    columns = problem.whiten_further(np.hstack([c.columns * c.width for c in curves]))
    return replace(problem, whitening=problem.whitening.beside(columns))


class Search:
    """One search.

    Args:
        fitter: Of the machine, on tests whitened by the campaign's noise alone.
        progress: Called as work gets on.
        only: Kind and subject of the one effect that is looked for; without it the whole catalogue.
    """

    def __init__(
        self, fitter: Fitter, progress: Progress = silent, only: tuple[type[Effect], str] | None = None
    ) -> None:
        self.progress, self.machine = progress, fitter.machine
        self.only = f"{only[0].kind}.{only[1]}" if only else ""
        self.seeds = seeds_of(*only, self.machine) if only else seeds(self.machine)
        self.trail: list[dict] = []
        self._begin(fitter)

    def _begin(self, fitter: Fitter) -> None:
        """Begin with tests that have other samples left out."""
        self.fitter, self.plain = fitter, fitter.problem
        self.discrepancy = Discrepancy.of_tests(self.plain)
        self._signatures: Signatures | None = None
        self._last: tuple[Model, bool, Hypotheses] | None = None

    def run(self, most: int | None = None) -> Found:
        """The best model.

        Args:
            most: Most causes of a machine that is otherwise as its file says.
        """
        if self.machine.tolerance:
            return self._found(self._searched(self._begun(calibrated_effects(self.machine))))
        few = self._extended(self._begun(()), most)
        if most is not None:
            return self._found(few)
        if few.leaves_nothing:
            return self._found(self._searched(few))
        data = self.plain
        usual = self._searched(self._begun(expected_effects(self.machine)))
        few = few if self.plain is data else self._settled(self._refitted(few))
        if usual.curves or not usual.leaves_nothing or usual.evidence < few.evidence:
            usual = max(usual, self._searched(few), key=lambda m: m.evidence)
        return self._found(usual)

    def _found(self, model: Model) -> Found:
        """The outcome, on tests with all samples that the model follows, and the machine as given beside it: where
        nothing repeats, a quick local fault looks like a knock until it is known.
        """
        other = model if model.curves else self._on_samples(model, readmitted)
        model = model if other is model else self._settled(other)
        return Found(self.fitter.fit([], exact=False), model, self.signatures_at(model).bank, self.trail)

    @property
    def _usual(self) -> Sizes:
        """Sizes to begin with: what an ordinary machine leaves."""
        return Sizes(USUAL, USUAL, np.ones(len(self.plain.tests)))

    # -- models --------------------------------------------------------------------------------------------------------

    def _problem(self, sizes: Sizes, curves: Sequence[Curve]) -> Problem:
        """The tests with the whitening of a model."""
        return with_curves(replace(self.plain, whitening=self.discrepancy.whitening(sizes)), curves)

    def _tuned(self, model: Model) -> Model:
        """A model with the sizes of largest evidence, and that evidence with the prior odds; its fit stays."""
        parameters, fit = model.fit.parameters, model.fit
        design, residual = self.discrepancy.plain(fit, model.problem.whitening)
        columns = np.hstack([design, *(c.columns * c.width for c in model.curves)])
        more = columns.shape[1] - parameters.size
        precision = np.concatenate([parameters.precision(), np.ones(more)])
        departure = np.concatenate([parameters.departure(fit.vector), np.zeros(more)])
        linear = LinearModel(Products(self.discrepancy, columns), residual, precision, departure)
        sizes, evidence = linear.tuned(model.sizes)
        problem = self._problem(sizes, model.curves)
        return replace(model, problem=problem, sizes=sizes, evidence=evidence + model.log_odds)

    def _settled(self, model: Model, steps: int = _STEPS) -> Model:
        """A model with the sizes of largest evidence, fitted again at them."""
        before, model = model.sizes, self._tuned(model)
        if abs(np.log((before.rms + 1e-8) / (model.sizes.rms + 1e-8))) < 0.2 and not steps:
            return model
        fit = self.fitter.with_problem(model.problem).fit(
            model.fit.effects, start=model.fit, exact=True, iterations=max(steps, 1), fresh=False
        )
        return self._tuned(replace(model, fit=fit))

    def _anew(self, effects: Sequence[EffectVector]) -> Fit:
        """Effects fitted from the machine as given, with triggers that stand in no false minimum."""
        fit = self.fitter.fit(list(effects), exact=False, iterations=_FIRST)
        better = retimed(self.plain, fit)
        return fit if better is None else self.fitter.fit(fit.effects, start=better, exact=False, iterations=_FIRST)

    def _begun(self, expected: Sequence[Calibrated]) -> Model:
        """A model with everything that is expected, and with an axis that lags far behind where it must, on tests
        without what then stands out as having happened once.

        Args:
            expected: What a machine of the class has; nothing for one that is as its file says.
        """
        self.progress("fitting the machine as given" if not expected else "fitting what its class has", 0, 1)
        fit = with_servo_fault(self._anew, self._anew([c.free for c in expected]), _NEAR)
        known = {c.key: c for c in expected}
        effects = _sized(fit.effects, known)
        odds = sum(log_odds_of(f, self.machine) for f in effects if f.effect.key not in known)
        model = Model(known, replace(fit, effects=effects), self.plain, self._usual, (), odds)
        return self._settled(self._on_samples(model, without_disturbances))

    def _on_samples(self, model: Model, chosen_by: Callable[..., Problem]) -> Model:
        """The model fitted to those samples that a choice made at its fit leaves; itself where they are the same.

        Args:
            model: The model.
            chosen_by: Gives the tests with the samples that count.
        """
        data = chosen_by(self.plain, model.fit.readings, model.fit.nuisance)
        if data is self.plain:
            return model
        self._begin(self.fitter.with_problem(data))
        return self._refitted(model)

    def _refitted(self, model: Model) -> Model:
        """A model without curves, fitted to the present samples."""
        fit = self.fitter.fit(list(model.fit.effects), exact=False, iterations=_FIRST)
        return replace(model, fit=fit, problem=self.plain)

    def _retimed(self, model: Model) -> Model:
        """The model at better triggers, where it fits better there."""
        nuisance = better_triggers(model.problem, model.fit.readings, model.fit.nuisance)
        if nuisance is None:
            return model
        fitter = self.fitter.with_problem(model.problem)
        fit = fitter.fit(
            model.fit.effects, start=replace(model.fit, nuisance=nuisance), exact=True, iterations=_STEPS, fresh=False
        )
        return self._settled(replace(model, fit=fit), 0) if fit.objective < model.fit.objective - 1.0 else model

    # -- hypotheses ----------------------------------------------------------------------------------------------------

    def signatures_at(self, model: Model) -> Signatures:
        """Signatures of the catalogue near a model: again where a trigger has moved by more than a block."""
        known, block = self._signatures, self.plain.samples[0].block
        at = model.fit.nuisances[TRIGGERS]
        if known is None or np.abs(known.bank.fit.nuisance[at] - model.fit.nuisance[at]).max() * TRIGGER > block:
            self.progress("computing signatures", 0, 1)
            bank = SignatureBank(self.plain, model.fit)
            bank.compute(self.seeds)
            self._signatures = known = Signatures.of(self.discrepancy, bank)
        return known

    def _hypotheses(self, model: Model, curves: bool) -> Hypotheses:
        """Everything beside a model; ``curves`` says whether unknown causes that it does not have compete as well."""
        if self._last is None or self._last[0] is not model or self._last[1] != curves:
            self._last = model, curves, self._made(model, curves)
        return self._last[2]

    def _made(self, model: Model, curves: bool) -> Hypotheses:
        design = self.discrepancy.plain(model.fit, model.problem.whitening)
        competing = [*model.curves]
        if curves:
            beside = model.fit if not model.curves else self._whitened_by(model, model.base)
            competing += best_curves(model.base, beside, self.plain, {c.name for c in model.curves})
        levels = [model.sizes]
        if not model.leaves_nothing:
            levels += [model.sizes.times(share) for share in _LEVELS]
        bank = self.signatures_at(model)
        return Hypotheses(self.plain, model.fit, design, bank, model.expected, competing, levels, self.only)

    def _whitened_by(self, model: Model, problem: Problem) -> Fit:
        """The fit of a model with its design and residual whitened by another problem."""
        fitter = self.fitter.with_problem(problem)
        return fitter.fit(model.fit.effects, start=model.fit, exact=True, iterations=0, fresh=False)

    def _widths(self, hypotheses: Hypotheses) -> Chosen:
        """What is in the model, each at the width that explains most beside the others."""
        chosen: Chosen = dict.fromkeys(hypotheses.present, 1.0)
        for _ in range(2):
            for g in list(chosen):
                odds, width = hypotheses.linear.odds(without(chosen, g))
                chosen[g] = float(width[g]) if np.isfinite(odds[g]) else chosen[g]
        return chosen

    # -- the loop ------------------------------------------------------------------------------------------------------

    def _searched(self, model: Model) -> Model:
        """The best model that is found from one."""
        for number in range(_ROUNDS):
            self.progress("looking for what explains the rest", number, _ROUNDS)
            model = self._retimed(model)
            better = self._better(model)
            if better is None:
                break
            model = better
        return model

    def with_effect(self, fit: Fit) -> Model | None:
        """The one effect that is looked for beside a fit, at its best seed, and with all waves that gain evidence where
        it is a pitch error; ``None`` where it changes no reading.

        Args:
            fit: The machine as given, with what it has a tolerance for.
        """
        known = {c.key: c for c in calibrated_effects(self.machine)}
        model, found = self._settled(Model(known, fit, self.plain, self._usual)), None
        given = self.machine.effect(self.only)
        if given is not None and given.search.scanned and not given.is_neutral:  # its own waves before any other
            free = EffectVector(given, given.search.free_of(given.parameters_of(given.subject)))
            free = free.with_prior(free.vector, np.full(len(free.vector), WIDTHS[-1]))
            fit = self.fitter.fit([*fit.effects, free], start=fit, exact=False, iterations=_FIRST)
            model = found = self._settled(Model(known, fit, self.plain, self._usual))
        for _ in range(_WAVES):
            hypotheses = self._hypotheses(model, curves=False)
            rows = _best_at_levels(hypotheses, self._widths(hypotheses), -np.inf)
            trials = [self._beside_noise(model, hypotheses, chosen) for chosen, _, _ in rows]
            best = max(trials, key=lambda m: m.evidence, default=None)
            if best is None or (found is not None and best.evidence <= found.evidence + _LEAST):
                break
            model = found = best
            if not found.fit.effects[-1].effect.search.scanned:
                break
        return found

    def _beside_noise(self, model: Model, hypotheses: Hypotheses, chosen: Chosen) -> Model:
        """The model with a set of hypotheses, fitted beside the noise alone first: a discrepancy would stand for what
        they are asked to explain.
        """
        effects, _ = hypotheses.model_of(chosen, hypotheses.levels[-1][1])
        fit = self.fitter.fit(effects, start=model.fit, exact=False, iterations=_FIRST)
        fit = self.fitter.fit(_sized(fit.effects, model.expected), start=fit, iterations=_FIRST)
        odds = sum(hypotheses.all[g].log_odds for g in chosen)
        return self._settled(Model(model.expected, fit, self.plain, model.sizes.times(0.0), (), odds))

    def _extended(self, model: Model, most: int | None) -> Model:
        """A model with causes of the catalogue added one after the other, while one of them gains evidence and less is
        left.
        """
        rounds = _FEW if most is None else most
        for number in range(rounds):
            self.progress("looking for one cause more", number, rounds)
            model = self._retimed(model)
            hypotheses = self._hypotheses(model, curves=False)
            best = model
            first = None
            for chosen, level, odds in _best_at_levels(hypotheses, self._widths(hypotheses)):
                if best.leaves_nothing and first is not None and odds < first - max(_NEAR, _ROUGH * first):
                    continue
                first = odds if first is None else first
                best = max(best, self._fitted(model, hypotheses, chosen, level), key=lambda m: m.evidence)
            if best.evidence <= model.evidence + _LEAST or best.left > model.left:
                break
            model = best
            other = self._on_samples(model, without_disturbances)  # what its waves had hidden
            model = model if other is model else self._settled(other)
        return model

    def _better(self, model: Model) -> Model | None:
        """A model of larger evidence; ``None`` where no proposal has one.

        Proposals are fitted exactly, the most promising first, until one keeps its promise. The best single cause of
        the catalogue comes before them: far from the data many small things imitate it.
        """
        hypotheses = self._hypotheses(model, curves=not model.leaves_nothing)
        here = self._widths(hypotheses)
        judged = hypotheses.judged(here)
        now = judged[0].evidence
        proposals: dict[frozenset[int], Proposal] = {}

        def propose(promise: float, chosen: Chosen, level: int) -> None:
            key = frozenset(chosen)
            if promise > max(_LEAST, proposals.get(key, (0.0,))[0]):
                proposals[key] = promise, chosen, level

        for level, (none, linear, _) in enumerate(hypotheses.levels):
            chosen = linear.best_set(hypotheses.present)
            propose(none + linear.total(chosen) - now, chosen, level)
            evidence, odds, width = judged[level]
            for g in np.argsort(-odds)[:_SINGLES]:
                if np.isfinite(odds[g]):
                    propose(evidence - now + float(odds[g]), {**here, int(g): float(width[g])}, level)
        ranked = sorted(proposals.values(), key=lambda row: -row[0])[:_FITTED]
        single = _best_single(hypotheses, here, judged)
        first = [single] if single is not None and single[0] > _SHARE * ranked[0][0] else []
        best: Model | None = None
        for promise, chosen, level in [*first, *(row for row in ranked if row[:2] not in [f[:2] for f in first])]:
            if best is not None and promise < best.evidence - model.evidence:
                break
            trial = self._fitted(model, hypotheses, chosen, level)
            gain = trial.evidence - model.evidence
            names = [hypotheses.all[g].name for g in chosen]
            self.trail.append({"hypotheses": names, "promise": promise, "gain": gain, "sizes": trial.sizes})
            if gain > (_LEAST if best is None else best.evidence - model.evidence):
                best = trial
            is_alone = any(chosen is f[1] for f in first)
            if trial is best and (trial.leaves_nothing or (gain > _KEPT * promise and not is_alone)):
                break
        return best

    def _fitted(self, model: Model, hypotheses: Hypotheses, chosen: Chosen, level: int = 0) -> Model:
        """The model with a set of hypotheses, fitted exactly."""
        _, linear, sizes = hypotheses.levels[level]
        effects, curves = hypotheses.model_of(chosen, linear)
        odds = sum(hypotheses.all[g].log_odds for g in chosen)
        problem = self._problem(sizes, curves)
        fitter = self.fitter.with_problem(problem)
        fit = fitter.fit(effects, start=model.fit, exact=True, iterations=_STEPS, fresh=False)
        sized = _sized(fit.effects, model.expected)
        if any((a.block.deviation != b.block.deviation).any() for a, b in zip(fit.effects, sized, strict=True)):
            fit = fitter.fit(sized, start=fit, exact=True, iterations=_AGAIN, fresh=False)
        trial = self._tuned(Model(model.expected, fit, problem, sizes, tuple(curves), odds))
        noise, before = self.plain.noise.rms, sizes
        for _ in range(_SETTLING):  # fitted at other sizes than it turned out to leave
            change = (trial.left + _SEEN * noise) / (before.left(noise) + _SEEN * noise)
            if 0.7 < change < 1.5:
                break
            before, trial = trial.sizes, self._settled(trial, _AGAIN)
        return trial

    def rivals_of(self, model: Model, keys: Collection[str]) -> dict[str, list[tuple[str, Model]]]:
        """Models with something else in the place of single causes, fitted exactly.

        Args:
            model: The best model.
            keys: Of the causes.
        """
        hypotheses = self._hypotheses(model, curves=False)
        chosen = self._widths(hypotheses)
        out: dict[str, list[tuple[str, Model]]] = {}
        for h in chosen:
            mine = hypotheses.all[h]
            if mine.name not in keys or mine.curve is not None:
                continue
            self.progress(f"what could stand in the place of {mine.name}", 0, 1)
            rest = without(chosen, h)
            rivals = {g: w for _, g, w in hypotheses.linear.rivals(chosen, h, _NEAR, _ROUGH)[:_RIVALS]}
            for g in (*rivals, *(g for g in hypotheses.look_alikes(h) if g not in rivals)):
                trial = self._fitted(model, hypotheses, {**rest, g: rivals.get(g, 1.0)})
                if g not in rivals:
                    trial = replace(trial, evidence=trial.evidence - _UNLIKELY)
                if g in rivals or (trial.fit.effects[-1].vector > trial.fit.effects[-1].neutral).all():
                    out.setdefault(mine.name, []).append((hypotheses.all[g].id, trial))
        return out
