"""The search on ball-bar tests.

A machine for which no tolerance is stated may be as its file says but for a few causes, or have all the small errors of
its class. Both are searched, and the evidence says which it is.

Effects that act in one direction of motion only, such as a worm wheel that is worn on one flank, are no seeds of their
own. Where one direction has a dent, the same dent in both explains about half of it, so that the best seeds of the
whole effect say where to look. Where the effect is in the model already, what it leaves may be the difference of the
two directions, at its own place.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mjsim.inference.bar_gain import gain_of_bar
from mjsim.inference.calibration import Calibrated, calibrated_effects, expected_effects
from mjsim.inference.discrepancy import CommonError, Discrepancy, Sizes
from mjsim.inference.disturbances import readmitted, without_disturbances
from mjsim.inference.drift import drift_of_machine
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit, Fitter, retimed
from mjsim.inference.hypotheses import CAUSE, WIDTHS, Hypotheses
from mjsim.inference.linear_evidence import NEAR, Chosen, margin, without
from mjsim.inference.linear_model import Products
from mjsim.inference.local_noise import LocalNoise
from mjsim.inference.nuisance import TRIGGER, TRIGGERS
from mjsim.inference.problem import Problem
from mjsim.inference.search import (
    FIRST,
    FITTED,
    LEAST,
    ROUNDS,
    SEEN,
    STEPS,
    DataFitter,
    Found,
    Model,
    Search,
    best_singles,
    with_curves,
    with_priors_of_size,
)
from mjsim.inference.signatures import Candidate, Offer, Row, SignatureBank, seeds, seeds_of
from mjsim.inference.slide_angles import turns_of_slides
from mjsim.inference.spectrum import spectral_candidates
from mjsim.inference.unknown_curves import Curve, ModesBeside, best_curves
from mjsim.inference.varying_friction import variation_of_friction
from mjsim.machine.effect import Effect
from mjsim.progress import Progress, silent

#: Seeds of one effect that are tried in each direction, the best first.
_SEEDS = 3
#: Most times that what friction does is derived anew at the drives that are fitted beside it.
_FOLLOWING = 4
#: Waves of each axis that are looked at, the best of all orders; and most that one pitch error is given.
_LOOKED_AT, _WAVES = 6, 12


def in_each_direction(effect: Effect) -> list[Effect]:
    """The same effect acting in one direction of motion only, once per direction; empty where it has one already or
    knows none.
    """
    directions = next((p.choices for p in effect.parameters_of(effect.subject) if p.name == "direction"), ())
    return [] if "direction" in effect.values else [effect.replaced(direction=d) for d in directions]


def one_direction_candidates(fit: Fit, bank: SignatureBank, rows: list[Row]) -> list[Offer]:
    """Candidates in each direction of motion, with their whitened columns: of the fitted effects and the best of
    ``rows`` (best first) of every effect that knows directions. A direction in which the model has the effect is left
    out.
    """
    have = {e.key for e in fit.machine.effects}
    whole = [Candidate(f.effect, f.names) for f in fit.effects if not f.effect.search.scanned]
    tried: dict[str, int] = {}
    for gain, c in rows:
        if gain < -2.0 * CAUSE:  # acting in both directions, it would be there less likely than not
            break
        if in_each_direction(c.effect) and tried.setdefault(c.id, 0) < _SEEDS:
            tried[c.id] += 1
            whole.append(c)
    directed = [
        Candidate(effect, c.names) for c in whole for effect in in_each_direction(c.effect) if effect.key not in have
    ]
    return [(c, bank.problem.whiten(bank.columns(c))) for c in directed]


def further_candidates(
    plain: Problem, fit: Fit, bank: SignatureBank, only: Collection[str] = ()
) -> Callable[[list[Row]], Iterable[Offer]]:
    """What gives the candidates that are not among the seeds: effects in one direction of motion, and waves, whose
    orders are read off a spectrum.

    Args:
        plain: The measured tests, whitened by the campaign's noise alone.
        fit: The model that they are beside.
        bank: Of the seeds.
        only: Ids of the effects that are asked about; without them the whole catalogue.
    """
    axes = {i.rpartition(".")[2] for i in only} or {*fit.base.chain.letters}

    def further(ranked: list[Row]) -> Iterator[Offer]:
        yield from one_direction_candidates(fit, bank, ranked)
        have = {f.effect.key: f.effect for f in fit.effects}
        for axis in fit.base.chain.letters:
            if axis not in axes:
                continue
            for c, columns in spectral_candidates(plain, fit, bank, axis, _LOOKED_AT):
                if only and c.id not in only:
                    continue
                mine = have.get(c.effect.key)
                waves = [] if mine is None else [round(row[0]) for row in mine.values.get("components", [])]
                if mine is None or (waves and round(c.effect.values["components"][0][0]) not in waves):
                    yield c, columns

    return further


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
        ranked.append(order[:FITTED])
    out: dict[str, tuple[Chosen, int, float]] = {}
    for row in itertools.zip_longest(*ranked):
        for g in [g for g in row if g is not None]:
            level = max(range(len(judged)), key=lambda i, g=g: judged[i].evidence + judged[i].odds[g])
            chosen = {**here, g: float(judged[level].width[g])}
            out.setdefault(hypotheses.all[g].name, (chosen, level, float(judged[-1].odds[g])))
    return list(out.values())[:FITTED]


class BarSearch(Search[Problem]):
    """One search on ball-bar tests.

    Args:
        fitter: Of the machine, on tests whitened by the campaign's noise alone.
        progress: Called as work gets on.
        only: Kinds and subjects of the effects that are looked for; without them the whole catalogue.
    """

    def __init__(
        self, fitter: Fitter, progress: Progress = silent, only: Collection[tuple[type[Effect], str]] = ()
    ) -> None:
        self.only = tuple(f"{cls.kind}.{subject}" for cls, subject in only)
        some = (c for cls, subject in only for c in seeds_of(cls, subject, fitter.machine))
        self.seeds = [*some] if only else seeds(fitter.machine)
        # what all tests may show that is in no model: whatever the machine is, and as it is fitted
        self._common: tuple[CommonError, ...] = (
            turns_of_slides(fitter.problem, fitter.machine),
            drift_of_machine(fitter.problem, fitter.machine),
            gain_of_bar(fitter.problem, fitter.machine),
        )
        self._varying: tuple[CommonError, ...] = ()
        self._shifts: Sequence[float] = ()
        self._followed_last: Model[Problem] | None = None
        super().__init__(fitter, progress)

    def _begin(self, fitter: DataFitter[Problem]) -> None:
        self._signatures: tuple[SignatureBank, Products] | None = None
        self._beside_curves: tuple[tuple[Curve, ...], Discrepancy] | None = None
        super()._begin(fitter)

    def run(self, most: int | None = None) -> Found[Problem]:
        """The best model.

        Args:
            most: Most causes of a machine that is otherwise as its file says.
        """
        if self.machine.tolerance:
            return self._found(self._searched(self._begun(calibrated_effects(self.machine))))
        few = self._begun(())
        if most is not None:
            return self._found(self._extended(few, most))
        if few.leaves_nothing:
            return self._found(self._searched(few))
        usual = self._begun(expected_effects(self.machine))
        if usual.leaves_nothing:
            few = self._with_few(usual)
            if few.evidence > usual.evidence:
                return self._found(few)
            usual = self._searched(usual)
        else:  # a fault that is no small error: by itself, or beside them
            begun = self._on_present_samples(few)
            few = self._or_one_curve(self._extended(begun, ROUNDS, usual.evidence), begun)
            if few.leaves_nothing:
                return self._found(self._searched(few))
            usual = self._searched(self._on_present_samples(usual))
            if few.evidence > usual.evidence:
                usual = max(usual, self._searched(few), key=lambda m: m.evidence)
        return self._found(max(usual, self._with_few(usual), key=lambda m: m.evidence))

    def _or_one_curve(self, several: Model[Problem], model: Model[Problem]) -> Model[Problem]:
        """Causes that were found one after the other, or the best curve of an unknown cause in the place of all of
        them, whichever explains the data better: one wave of a table that is not round is two error motions as well.

        Args:
            several: With the causes.
            model: Without any.
        """
        if len(several.fit.effects) < 2:
            return several
        model = self._on_present_samples(model)
        hypotheses = self._hypotheses(model, curves=True)
        here = self._widths(hypotheses)
        rows = best_singles(hypotheses, here, hypotheses.judged(here))
        curves = [row for row in rows if any(hypotheses.all[g].curve is not None for g in row[1])]
        trials = [self._fitted(model, (hypotheses, chosen, level)) for _, chosen, level in curves]
        return max([several, *trials], key=lambda m: m.evidence)

    def _with_few(self, usual: Model[Problem]) -> Model[Problem]:
        """The best model of a machine that is as its file says but for a few causes, found from one with everything
        that is usual: what the data do not need of it goes. The same where that promises nothing, where a fit does not
        keep the promise, or where it has no more already.
        """
        if not usual.expected:
            return usual
        model = replace(usual, expected={})
        hypotheses = self._hypotheses(model, curves=False)
        none, linear, _ = hypotheses.levels[0]
        chosen = linear.best_set(hypotheses.present)
        if none + linear.total(chosen) < usual.evidence - NEAR:
            return usual
        few = self._fitted(model, (hypotheses, chosen, 0))
        return self._searched(few) if few.evidence > usual.evidence - NEAR else usual

    def _found(self, model: Model[Problem]) -> Found[Problem]:
        """The outcome, on tests with the samples that the model follows, and the machine as given beside it. A model
        may show a knock that its waves have hidden; and where nothing repeats, a quick local fault looks like a knock
        until it is known.
        """
        self._take_noise_of(model)
        other = model if model.curves else self._on_samples(model, readmitted)
        if model.leaves_nothing and not model.curves:
            other = self._cleaned(other)
        model = model if other is model else self._renoised(self._settled(other))
        return Found(self.fitter.fit([], exact=False), model, self.signatures_at(model)[0], self.trail)

    def _discrepancy(self) -> Discrepancy:
        return Discrepancy.of_tests(self.plain, (*self._common, *self._varying), self._shifts)

    def _follow(self, fit: Fit) -> None:
        self._shifts = [self.plain.shift(k, fit.nuisance) for k in range(len(self.plain.tests))]
        self._varying = tuple(variation_of_friction(self.plain, fit.simulated_machine))
        self._begin_with(self.plain.local)

    def _followed(self, model: Model[Problem]) -> Model[Problem]:
        """What friction that varies does to the readings depends on the drives, and these are fitted beside it. So both
        are found in turn, where it can be seen and is most of what is left: as long as something larger is in no
        model, the drives are fitted to that.
        """
        for _ in range(_FOLLOWING):
            varies = math.hypot(*(model.sizes.common.get(e.name, 0.0) for e in self._varying))
            most = max(SEEN * self.plain.noise.rms, math.hypot(model.sizes.slow, model.sizes.fast))
            if model is self._followed_last or varies < most:
                break
            self._take_noise_of(model)
            self._follow(model.fit)
            before, model = model.evidence, self._tuned(model)
            if abs(model.evidence - before) < LEAST:  # the shapes are those that the drives were fitted beside
                break
            model = self._fitted_again(model, STEPS)
        self._followed_last = model
        return model

    def _discrepancy_beside(self, curves: Sequence[Curve]) -> Discrepancy:
        curves = [c for c in curves if not c.term.mode]
        if not curves:
            return self.discrepancy
        known = self._beside_curves
        if known is None or [*map(id, known[0])] != [*map(id, curves)]:
            readings, turns = [c.readings for c in curves], [c.term.turns for c in curves]
            found = self.discrepancy.beside_curves(self.plain, readings, turns)
            self._beside_curves = known = tuple(curves), found
        return known[1]

    # -- models --------------------------------------------------------------------------------------------------------

    def _first(self, effects: Sequence[EffectVector]) -> Fit:
        """Effects fitted from the machine as given, with triggers that stand in no false minimum."""
        fit = self.fitter.fit(list(effects), exact=False, iterations=FIRST)
        better = retimed(self.plain, fit)
        return fit if better is None else self.fitter.fit(fit.effects, start=better, exact=False, iterations=FIRST)

    def _cleaned(self, model: Model[Problem]) -> Model[Problem]:
        return self._on_samples(model, without_disturbances)

    def _on_samples(self, model: Model[Problem], chosen_by: Callable[..., Problem]) -> Model[Problem]:
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

    def _on_present_samples(self, model: Model[Problem]) -> Model[Problem]:
        """A model on the samples that count now; itself where it was fitted to these."""
        is_so = model.base.samples is self.plain.samples
        return model if is_so else self._settled(self._refitted(model))

    def _refitted(self, model: Model[Problem]) -> Model[Problem]:
        """A model without curves, fitted to the present samples."""
        fit = self.fitter.fit(list(model.fit.effects), exact=False, iterations=FIRST)
        return replace(model, fit=fit, base=self.plain)

    def _retimed(self, model: Model[Problem]) -> Model[Problem]:
        """The model at better triggers, where it fits better there."""
        better = retimed(model.problem, model.fit)
        if better is not None:
            fitter = self.fitter.with_problem(model.problem)
            fit = fitter.fit(better.effects, start=better, exact=True, iterations=STEPS, fresh=False)
            if fit.objective < model.fit.objective - 1.0:
                self._follow(fit)
                model = self._settled(replace(model, fit=fit), 0)
        return self._followed(model)

    @property
    def _of_noise(self) -> float:
        return sum(n.log_evidence for n in self.plain.local.values())

    def _take_noise_of(self, model: Model[Problem]) -> None:
        if model.base.local is not self.plain.local:
            self._begin_with(model.base.local)

    def _begin_with(self, local: Mapping[int, LocalNoise]) -> None:
        """Go on with another local noise of the tests."""
        known = self._signatures
        self._begin(self.fitter.with_problem(self.plain.with_local_noise(local)))
        self._signatures = known

    def _renoised(self, model: Model[Problem]) -> Model[Problem]:
        """The model on tests that are louder where it leaves more; itself where that gains no evidence."""
        if model.leaves_nothing:
            return model
        self._take_noise_of(model)
        tests = self._discrepancy_beside(model.curves).tests
        found = {k: self.plain.local_noise(k, model.rest[at], basis) for k, (basis, at) in enumerate(tests)}
        local = {k: noise for k, noise in found.items() if noise is not None}
        if not local and not self.plain.local:
            return model
        self._begin_with(local)
        curves = tuple(replace(c, rows=self.plain.whiten_sparse(c.term.columns.together())) for c in model.curves)
        sizes = replace(model.sizes, factor=np.ones(len(self.plain.tests)))
        base = self.base_of(sizes, curves)
        better = self._fitted_again(replace(model, base=base, sizes=sizes, curves=curves), STEPS)
        return better if better.evidence > model.evidence else model

    def _or_beside_local_noise(self, model: Model[Problem], better: Model[Problem] | None) -> Model[Problem] | None:
        """What is sharp passes for local noise as long as it is in no model. So a better model is looked for without
        such noise first, and beside it only where the better one leaves some.
        """
        if better is not None and not better.base.local:
            return better
        other = self._renoised(model)
        if other is model:
            return better
        return max(better or model, self._better(other) or other, key=lambda m: m.evidence)

    # -- hypotheses ----------------------------------------------------------------------------------------------------

    def signatures_at(self, model: Model[Problem]) -> tuple[SignatureBank, Products]:
        """Signatures of the catalogue near a model, with their products: again where a trigger has moved by more than a
        block.
        """
        known, block = self._signatures, self.plain.samples[0].block
        at = model.fit.nuisances[TRIGGERS]
        if known is None or np.abs(known[0].fit.nuisance[at] - model.fit.nuisance[at]).max() * TRIGGER > block:
            self.progress("computing signatures", 0, 1)
            bank = SignatureBank(self.plain, model.fit)
            bank.compute(self.seeds)
            self._signatures = known = bank, Products(self.discrepancy, bank.matrix)
        elif known[0].problem.local is not self.plain.local:
            bank = known[0].on(self.plain)
            self._signatures = known = bank, Products(self.discrepancy, bank.matrix)
        return known[0], known[1].with_discrepancy(self.discrepancy)

    def _beside(self, model: Model[Problem], levels: Sequence[Sizes], curves: bool) -> Hypotheses:
        competing = [*model.curves]
        if curves or model.curves:
            # as long as a curve is in no model, common errors stand for a part of it
            common = any(model.sizes.common.values())
            base = self.base_of(model.sizes.without_common(), model.curves) if common else model.base
            beside = model.fit if model.fit.whitening is base.whitening else self.whitened_by(model, base)
            own = {c.name for c in model.curves}  # they compete with other knots and priors in any case
            modes_beside = [*self._modes_beside(model, base, beside, curves)]
            found = [c for _, c in best_curves(base, beside, self.plain, own, curves, modes_beside)]
            competing += [c for c in found if not any(map(c.is_like, model.curves))]
        bank, products = self.signatures_at(model)
        if model.curves:
            products = products.along_more(self._discrepancy_beside(model.curves))
        further = self._further(model, bank)
        design = self.discrepancy.plain(model.fit)
        return Hypotheses(model.fit, design, bank, products, model.expected, levels, competing, further)

    def _modes_beside(self, model: Model[Problem], base: Problem, fit: Fit, others: bool) -> Iterator[ModesBeside]:
        """Beside what modes of the structure compete: those of the model each beside the rest of them, and ``others``
        beside all of them.
        """
        modes = [c for c in model.curves if c.term.mode]
        for some, mode in [*(([c for c in modes if c is not m], m.term) for m in modes), (modes, None)]:
            if mode is not None or others:
                data = with_curves(base, some)
                yield data, fit if data is base else self.whitened_by(model, data), mode

    def _further(self, model: Model[Problem], bank: SignatureBank) -> Callable[[list[Row]], Iterable[Offer]]:
        """What gives the candidates beside a model that are not among the seeds."""
        return further_candidates(self.plain, model.fit, bank, self.only)

    def whitened_by(self, model: Model[Problem], problem: Problem) -> Fit:
        """The fit of a model with its design and residual whitened by another problem."""
        fitter = self.fitter.with_problem(problem)
        return fitter.fit(model.fit.effects, start=model.fit, exact=True, iterations=0, fresh=False)

    def with_effect(self, fit: Fit) -> Model[Problem] | None:
        """The one effect that is looked for beside a fit, at its best seed, and with all waves that gain evidence where
        it is a pitch error; ``None`` where it changes no reading.

        Args:
            fit: The machine as given, with what it has a tolerance for.
        """
        known = {c.key: c for c in calibrated_effects(self.machine)}
        self._follow(fit)
        model, found = self._followed(self._settled(Model(known, fit, self.plain, self._usual))), None
        given = self.machine.effect(self.only[0])
        if given is not None and given.search.scanned and not given.is_neutral:  # its own waves before any other
            free = EffectVector(given, given.search.free_of(given.parameters_of(given.subject)))
            free = free.with_prior(free.vector, np.full(len(free.vector), WIDTHS[-1]))
            fit = self.fitter.fit([*fit.effects, free], start=fit, exact=False, iterations=FIRST)
            model = found = self._settled(Model(known, fit, self.plain, self._usual))
        for _ in range(_WAVES):
            hypotheses = self._hypotheses(model, curves=False)
            rows = _best_at_levels(hypotheses, self._widths(hypotheses), -np.inf)
            trials = [self._beside_noise(model, hypotheses, chosen) for chosen, _, _ in rows]
            best = max(trials, key=lambda m: m.evidence, default=None)
            if best is None or (found is not None and best.evidence <= found.evidence + LEAST):
                break
            model = found = best
            if not found.fit.effects[-1].effect.search.scanned:
                break
        return None if found is None else replace(found, fit=self.whitened_by(found, found.problem))

    def of_effects(self, effects: Sequence[EffectVector], expected: dict[str, Calibrated]) -> Model[Problem]:
        """The model that has these effects and nothing else, beside what repeats and is in no model.

        Args:
            effects: Near where they are fitted.
            expected: What a machine of the class has, by key.
        """
        fit = self.fitter.fit(list(effects), exact=False, iterations=FIRST)
        self._follow(fit)
        model = self._renoised(self._followed(self._settled(self._model_of(fit, expected))))
        return replace(model, fit=self.whitened_by(model, model.problem))

    def log_odds(self, model: Model[Problem], effect_id: str) -> float:
        """Log posterior odds of an effect beside everything else in a model, at its best seed or wave; minus infinity
        where it changes no reading.
        """
        hypotheses = self._hypotheses(model, curves=False)
        here = self._widths(hypotheses)
        mine = (g for g, h in enumerate(hypotheses.all) if h.id == effect_id)
        return max((float(hypotheses.linear.odds(without(here, g))[0][g]) for g in mine), default=-np.inf)

    def _beside_noise(self, model: Model[Problem], hypotheses: Hypotheses, chosen: Chosen) -> Model[Problem]:
        """The model with a set of hypotheses, fitted beside the noise alone first: a discrepancy would stand for what
        they are asked to explain.
        """
        effects, _ = hypotheses.model_of(chosen, hypotheses.levels[-1][1])
        fit = self.fitter.fit(effects, start=model.fit, exact=False, iterations=FIRST)
        fit = self.fitter.fit(with_priors_of_size(fit.effects, model.expected), start=fit, iterations=FIRST)
        odds = sum(hypotheses.all[g].log_odds for g in chosen)
        return self._settled(Model(model.expected, fit, self.plain, model.sizes.times(0.0), (), odds))

    def _extended(self, model: Model[Problem], rounds: int, least: float = -np.inf) -> Model[Problem]:
        """A model with causes of the catalogue added one after the other, while one of them gains evidence and less is
        left.

        Args:
            model: To begin with.
            rounds: Most causes.
            least: Evidence of another model: once one cause is added, there are more while this one is ahead of it.
        """
        for number in range(rounds):
            self.progress("looking for one cause more", number, rounds)
            model = self._retimed(model)
            hypotheses = self._hypotheses(model, curves=False)
            best = model
            first = None
            for chosen, level, odds in _best_at_levels(hypotheses, self._widths(hypotheses)):
                if best.leaves_nothing and first is not None and odds < first - margin(first):
                    continue
                first = odds if first is None else first
                best = max(best, self._fitted(model, (hypotheses, chosen, level)), key=lambda m: m.evidence)
            if best.evidence <= model.evidence + LEAST or best.left > model.left:
                break
            model = best
            if model.evidence < least:
                break
            other = self._cleaned(model)  # what its waves had hidden
            model = model if other is model else self._settled(other)
        return model
