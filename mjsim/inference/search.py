"""The search for what a machine's model lacks: hypotheses are ranked linearly, the best are fitted exactly, and the log
evidence decides.

Two kinds of proposals are judged in each round: the best set of the linear problem as a whole, and single hypotheses
that promise much of what that set promises. Near the data the linear problem is right. Far from them it is one of
imitation, where many small things stand for one large one; there the exact fits of single hypotheses decide.

What was measured, and how, the search does not ask. It needs data that can be fitted, whitened and linearised. Its loop
(:class:`Ascent`) needs less: proposals, and exact fits with an evidence. The search on axis logs is that loop as well.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from mjsim.inference.calibration import Calibrated
from mjsim.inference.considered import move_to
from mjsim.inference.discrepancy import Discrepancy, Sizes
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.inference.hypotheses import Hypotheses, Judged, log_odds_of, with_prior_of_size
from mjsim.inference.linear_evidence import WORTH, Chosen, without
from mjsim.inference.linear_model import Knots, LinearModel, Products
from mjsim.inference.settings import DiagnosisSettings
from mjsim.inference.signatures import Bank
from mjsim.inference.unknown_curves import Curve
from mjsim.inference.whitening import Whitening
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent

#: Gain in log evidence below which a model is not taken for better, nats: odds of twenty to one (Kass and Raftery,
#: J. Am. Statist. Assoc. 90 (1995) 773-795, call them strong).
LEAST = 3.0
#: Nothing is looked for in a discrepancy that is smaller than such a share of one sample's noise.
SEEN = 0.5
#: Most proposals that are fitted in a round, and single hypotheses among them at each level.
FITTED, _SINGLES = 4, 3
#: Share of the best promise from which the best single cause, or curve, is fitted as well.
_SHARE = 1.0 / 3.0
#: Share of its promise that a proposal must keep for no other to be fitted.
_KEPT = 0.5
#: Shares of the present discrepancy at which hypotheses are judged as well: what explains most leaves much less.
_LEVELS = (0.4, 0.15, 0.0)
#: Most rounds of one search.
ROUNDS = 8
#: Most hypotheses that are fitted in the place of one.
RIVALS = 2
#: Evidence against a cause of a size that makes no sense by itself, nats: odds of one to ten (assumed). With one to
#: twenty such a cause would never be told, however well it explains the data: see TOLD.
_UNLIKELY = 2.3
#: Probability that the causes which are told in the place of one have together: with which ISO 14253-1 takes it for
#: proven that a number is beyond its limit.
TOLD = 0.95
#: Most Gauss-Newton steps of the first fit of everything that a machine may have, and of the others.
FIRST, STEPS, _AGAIN = 16, 5, 3
#: Most times that a model is fitted again at the sizes that it leaves.
_SETTLING = 4


class Noise(Protocol):
    """The noise of the data."""

    @property
    def rms(self) -> float:
        """Of one value, SI."""
        ...


class Data(Protocol):
    """Measured data, whitened by their noise, and by what a model leaves beside it where that is told."""

    @property
    def noise(self) -> Noise: ...
    @property
    def settings(self) -> DiagnosisSettings: ...
    @property
    def whitening(self) -> Whitening | None: ...
    @property
    def local_rms(self) -> float:
        """RMS by which places of the tests are louder than the noise, SI."""
        ...

    def whitened_by(self, whitening: Whitening) -> Any:
        """The same data with another whitening."""
        ...

    def whiten_further(self, rows: np.ndarray) -> np.ndarray:
        """Rows (count,) or (count, k) that the noise alone has whitened, with all of the whitening."""
        ...


D = TypeVar("D", bound=Data)


class DataFitter(Protocol[D]):
    """Fits models of one machine to data. A fit has the whitened design and residual at its end."""

    @property
    def machine(self) -> Machine: ...
    @property
    def problem(self) -> D: ...
    def with_problem(self, problem: D) -> DataFitter[D]:
        """The same with other data, or another whitening."""
        ...

    def fit(
        self,
        effects: Sequence[EffectVector],
        start: Fit | None = None,
        iterations: int = ...,
        exact: bool = ...,
        fresh: bool = ...,
    ) -> Fit:
        """Effects fitted with the set-up; arguments as of :meth:`mjsim.inference.fit.Fitter.fit`."""
        ...


@dataclass(frozen=True)
class Model(Generic[D]):
    """A fitted model of the machine.

    Attributes:
        expected: What a machine of its class has, by key.
        fit: Effects, data sheet and set-up.
        base: The data with the whitening of this model, without what its curves add to that.
        sizes: Of the discrepancy and the noise.
        curves: Of unknown causes.
        log_odds: Prior odds of all its hypotheses, logarithm.
        evidence: Log evidence, prior odds included.
        rest: What it leaves at its best values, discrepancy included, whitened by the noise alone, (count,).
    """

    expected: dict[str, Calibrated]
    fit: Fit
    base: D
    sizes: Sizes
    curves: tuple[Curve, ...] = ()
    log_odds: float = 0.0
    evidence: float = -np.inf
    rest: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def problem(self) -> D:
        """The data with the whitening of this model."""
        return with_curves(self.base, self.curves)

    @property
    def leaves_nothing(self) -> bool:
        """Whether what it leaves cannot be seen beside the noise."""
        return self.left < SEEN * self.base.noise.rms

    @property
    def left(self) -> float:
        """RMS of what it leaves besides the noise, m."""
        return float(np.hypot(self.sizes.left(self.base.noise.rms), self.base.local_rms))


@dataclass(frozen=True)
class Found(Generic[D]):
    """Outcome of a search.

    Attributes:
        start: The machine as given, with set-up and data sheet fitted.
        model: The best model.
        bank: Signatures of the catalogue, whitened by the noise alone.
        trail: What was tried, for those who ask.
    """

    start: Fit
    model: Model[D]
    bank: Bank
    trail: list[dict] = field(default_factory=list)


#: What may be gained by a set of hypotheses, the set, and the level at which it is judged.
Promised = tuple[float, Chosen, int]


def best_singles(hypotheses: Hypotheses, here: Chosen, judged: Sequence[Judged]) -> list[Promised]:
    """The single cause of the catalogue, and the single curve of an unknown cause, that promise most beside what is in
    the model, the better one first; none where they promise nothing.

    Args:
        hypotheses: Beside the model.
        here: What is in it.
        judged: What each level says.
    """
    curves = np.array([h.curve is not None for h in hypotheses.all])
    best: dict[bool, Promised] = {}
    for level, (evidence, odds, width) in enumerate(judged):
        for is_curve in (False, True):
            g = int(np.argmax(np.where(curves == is_curve, odds, -np.inf)))
            promise = evidence - judged[0].evidence + float(odds[g])
            if curves[g] == is_curve and promise > (best[is_curve][0] if is_curve in best else LEAST):
                best[is_curve] = promise, {**here, g: float(width[g])}, level
    return sorted(best.values(), key=lambda row: -row[0])


def with_priors_of_size(effects: Sequence[EffectVector], expected: Collection[str]) -> tuple[EffectVector, ...]:
    """Effects with priors of the widths that their sizes ask for, but for those of which a machine of the class is
    expected to have some, by key.
    """
    return tuple(f if f.effect.key in expected else with_prior_of_size(f) for f in effects)


def with_curves(problem: D, curves: Sequence[Curve]) -> D:
    """Data with the coefficients of curves marginalised.

    Args:
        problem: With the whitening of a discrepancy.
        curves: With the widths of their priors.
    """
    if not curves:
        return problem
    assert problem.whitening is not None
    columns = problem.whiten_further(np.hstack([c.columns for c in curves]))
    return problem.whitened_by(problem.whitening.beside(columns))


def is_near(fit: Fit, other: Fit, key: str) -> bool:
    """Whether two fits of the same data have the same values of an effect, within its uncertainty.

    Args:
        fit: A finished one.
        other: Likewise.
        key: Of the effect.
    """
    f = next(f for f in fit.effects if f.effect.key == key)
    off = move_to(fit, other)[fit.parameters[f.block.name]]
    return float(off @ np.linalg.solve(fit.covariance_of(f), off)) < len(off)


class WithEvidence(Protocol):
    """What the log evidence judges."""

    @property
    def evidence(self) -> float:
        """Log evidence, prior odds included."""
        ...


class Explaining(WithEvidence, Protocol):
    """A fitted model of data."""

    @property
    def leaves_nothing(self) -> bool:
        """Whether what it leaves cannot be seen beside the noise."""
        ...

    @property
    def left(self) -> float:
        """RMS of what it leaves besides the noise, SI."""
        ...


E = TypeVar("E", bound=WithEvidence)
M = TypeVar("M", bound=Explaining)


@dataclass(frozen=True)
class Proposal:
    """A change of a model.

    Attributes:
        names: Of the hypotheses that the changed model has.
        change: What is changed, as the search that proposes it has it.
        promise: Log evidence that it gains in the linear problem; infinite where that is a poor judge, so that it is
            fitted whatever others gain.
        is_enough: Whether no other is fitted where it keeps its promise.
    """

    names: Sequence[str]
    change: Any
    promise: float = np.inf
    is_enough: bool = True


def number_to_tell(shares: np.ndarray) -> int:
    """How many of several answers are told: the fewest that hold the truth with the probability of what is told.

    Args:
        shares: Probabilities, the largest first, (n,).
    """
    return int(np.searchsorted(np.cumsum(shares), TOLD)) + 1


def names_to_tell(
    rivals: Sequence[tuple[str, E]], evidence: float, own: str = ""
) -> tuple[float, dict[str, tuple[float, E]]]:
    """Share of the probability that a cause has beside all its rivals, and what is told of these: share and model, by
    id; the fewest that hold the truth with the probability of what is told.

    Args:
        rivals: Ids, and models with them in the cause's place.
        evidence: Log evidence of the model with the cause.
        own: Id of the cause.
    """
    logs = np.array([0.0, *(m.evidence - evidence for _, m in rivals)])
    others: dict[str, tuple[float, E]] = {}
    for (i, m), share in zip(rivals, np.exp(logs - np.logaddexp.reduce(logs))[1:], strict=True):
        if share > others.get(i, (0.0,))[0] and i != own:
            others[i] = float(share), m
    mine = 1.0 - sum(p for p, _ in others.values())
    told, covered = {}, mine
    for i, (p, m) in sorted(others.items(), key=lambda row: -row[1][0]):
        if covered < TOLD and not i.startswith("curve"):
            told[i] = p, m
        covered += p
    return mine, told


class Ascent(ABC, Generic[M]):
    """The loop of every search: proposals are fitted exactly, and the log evidence decides.

    Args:
        progress: Called as work gets on.
    """

    def __init__(self, progress: Progress = silent) -> None:
        self.progress = progress
        self.trail: list[dict] = []

    @abstractmethod
    def _proposals(self, model: M) -> list[Proposal]:
        """Changes of a model that promise evidence, in the order in which they are fitted."""

    @abstractmethod
    def _fitted(self, model: M, change: Any) -> M:
        """The model with a change, fitted exactly."""

    def _retimed(self, model: M) -> M:
        """The model at better values, where steps from the present ones do not lead to them."""
        return model

    def _renoised(self, model: M) -> M:
        """The model on data that are louder where it leaves more; itself where they are not."""
        return model

    def _or_beside_local_noise(self, model: M, better: M | None) -> M | None:
        """A better model than ``model``, the one that was found or one that is found beside local noise."""
        return better

    def _searched(self, model: M, rounds: int = ROUNDS) -> M:
        """The best model that is found from one."""
        for number in range(rounds):
            self.progress("looking for what explains the rest", number, rounds)
            model = self._retimed(model)
            better = self._better(model)
            if not number:
                better = self._or_beside_local_noise(model, better)
            if better is None:
                break
            model = better
        return model

    def _better(self, model: M) -> M | None:
        """A model of larger evidence; ``None`` where no proposal has one.

        Proposals are fitted until one keeps its promise.
        """
        best: M | None = None
        for p in self._proposals(model):
            if best is not None and p.promise < best.evidence - model.evidence:
                break
            trial = self._renoised(self._fitted(model, p.change))
            gain = trial.evidence - model.evidence
            self.trail.append({"hypotheses": p.names, "promise": p.promise, "gain": gain, "left": trial.left})
            if gain > (LEAST if best is None else best.evidence - model.evidence):
                best = trial
            if trial is best and (trial.leaves_nothing or (gain > _KEPT * p.promise and p.is_enough)):
                break
        return best


class Search(Ascent[Model[D]]):
    """One search on data that can be fitted, whitened and linearised.

    Args:
        fitter: Of the machine, on data whitened by their noise alone.
        progress: Called as work gets on.
    """

    def __init__(self, fitter: DataFitter[D], progress: Progress = silent) -> None:
        super().__init__(progress)
        self.machine = fitter.machine
        self._begin(fitter)

    def _begin(self, fitter: DataFitter[D]) -> None:
        """Begin with data of which other samples are left out."""
        self.fitter, self.plain = fitter, fitter.problem
        self.discrepancy = self._discrepancy()
        self._knots = Knots([], self.discrepancy.rows)
        self._last: tuple[Model[D], bool, Hypotheses] | None = None

    # -- what each instrument says -------------------------------------------------------------------------------------

    @abstractmethod
    def _discrepancy(self) -> Discrepancy:
        """What the data may show that is in no model."""

    def _discrepancy_beside(self, curves: Sequence[Curve]) -> Discrepancy:
        """The same beside curves of unknown causes."""
        assert not curves
        return self.discrepancy

    @abstractmethod
    def _first(self, effects: Sequence[EffectVector]) -> Fit:
        """Effects fitted from the machine as given."""

    def _follow(self, fit: Fit) -> None:
        """What the data may show that is in no model, for a machine and triggers as in a fit."""

    def _followed(self, model: Model[D]) -> Model[D]:
        """A settled model beside what the data may show at its own machine."""
        return model

    @abstractmethod
    def _beside(self, model: Model[D], levels: Sequence[Sizes], curves: bool) -> Hypotheses:
        """Everything beside a model; ``curves`` says whether unknown causes that it does not have compete as well."""

    def _cleaned(self, model: Model[D]) -> Model[D]:
        """The model on data without what then stands out as having happened once."""
        return model

    @property
    def _of_noise(self) -> float:
        """What the noise of the data adds to the log evidence of every model on them."""
        return 0.0

    def _take_noise_of(self, model: Model[D]) -> None:
        """Go on with the noise of the data that a model was fitted to, where there is more than one."""

    @property
    def _usual(self) -> Sizes:
        """Sizes to begin with: what an ordinary machine leaves."""
        return self.discrepancy.usual

    # -- models --------------------------------------------------------------------------------------------------------

    def base_of(self, sizes: Sizes, curves: Sequence[Curve]) -> D:
        """The data with the whitening of a model, without what its curves add to that."""
        return self.plain.whitened_by(self._discrepancy_beside(curves).whitening(sizes))

    def problem_of(self, sizes: Sizes, curves: Sequence[Curve]) -> D:
        """The data with the whitening of a model."""
        return with_curves(self.base_of(sizes, curves), curves)

    def _tuned(self, model: Model[D]) -> Model[D]:
        """A model with the sizes of largest evidence, and that evidence with the prior odds; its fit stays."""
        self._take_noise_of(model)
        parameters, fit = model.fit.parameters, model.fit
        design, residual = self.discrepancy.plain(fit)
        products = Products(self._discrepancy_beside(model.curves), design)
        products = products.with_curves(self._knots_of(model.curves), [c.root * c.width for c in model.curves])
        more = products.width - parameters.size
        precision = np.concatenate([parameters.precision(), np.ones(more)])
        departure = np.concatenate([parameters.departure(fit.vector), np.zeros(more)])
        linear = LinearModel(products, residual, precision, departure)
        sizes, evidence = linear.tuned(model.sizes)
        evidence += self._of_noise + model.log_odds
        base = self.base_of(sizes, model.curves)
        return replace(model, base=base, sizes=sizes, evidence=evidence, rest=linear.rest(sizes))

    def _knots_of(self, curves: Sequence[Curve]) -> Knots:
        """The knots of curves: those of the curves before where they are the same."""
        rows = [c.rows for c in curves]
        if not self._knots.are_of(rows):
            self._knots = Knots(rows, self.discrepancy.rows)
        return self._knots

    def _settled(self, model: Model[D], steps: int = STEPS) -> Model[D]:
        """A model with the sizes of largest evidence, fitted again at them."""
        before, model = model.sizes, self._tuned(model)
        if abs(np.log((before.rms + 1e-8) / (model.sizes.rms + 1e-8))) < 0.2 and not steps:
            return model
        return self._fitted_again(model, max(steps, 1))

    def _fitted_again(self, model: Model[D], steps: int) -> Model[D]:
        """A model fitted at its sizes, with those of largest evidence then."""
        fitter = self.fitter.with_problem(model.problem)
        fit = fitter.fit(model.fit.effects, start=model.fit, exact=True, iterations=steps, fresh=False)
        return self._tuned(replace(model, fit=fit))

    def _begun(self, expected: Sequence[Calibrated]) -> Model[D]:
        """A model with everything that is expected, on data without what then stands out as having happened once.

        Args:
            expected: What a machine of the class has; nothing for one that is as its file says.
        """
        self.progress("fitting the machine as given" if not expected else "fitting what its class has", 0, 1)
        fit = self._first([c.free for c in expected])
        self._follow(fit)
        model = self._settled(self._cleaned(self._model_of(fit, {c.key: c for c in expected})))
        return self._followed(model)

    def _model_of(self, fit: Fit, expected: dict[str, Calibrated]) -> Model[D]:
        """A fit as a model, with priors of its effects' sizes, before it is settled.

        Args:
            fit: Of any effects.
            expected: What a machine of the class has, by key.
        """
        effects = with_priors_of_size(fit.effects, expected)
        odds = sum(log_odds_of(f, self.machine) for f in effects if f.effect.key not in expected)
        return Model(expected, replace(fit, effects=effects), self.plain, self._usual, (), odds)

    # -- hypotheses ----------------------------------------------------------------------------------------------------

    def _hypotheses(self, model: Model[D], curves: bool) -> Hypotheses:
        """Everything beside a model; ``curves`` says whether unknown causes that it does not have compete as well."""
        self._take_noise_of(model)
        if self._last is None or self._last[0] is not model or self._last[1] != curves:
            levels = [model.sizes]
            if not model.leaves_nothing:
                levels += [model.sizes.times(share) for share in _LEVELS]
            self._last = None  # the columns of the one before fill hundreds of MB
            self._last = model, curves, self._beside(model, levels, curves)
        return self._last[2]

    def _widths(self, hypotheses: Hypotheses) -> Chosen:
        """What is in the model, each at the width that explains most beside the others."""
        chosen: Chosen = dict.fromkeys(hypotheses.present, 1.0)
        for _ in range(2):
            for g in list(chosen):
                odds, width = hypotheses.linear.odds(without(chosen, g))
                chosen[g] = float(width[g]) if np.isfinite(odds[g]) else chosen[g]
        return chosen

    # -- the loop ------------------------------------------------------------------------------------------------------

    def _proposals(self, model: Model[D]) -> list[Proposal]:
        """The best sets of the linear problem and the best single hypotheses, the most promising first; before them the
        best single cause and the best single curve: far from the data many small things imitate it. Unknown causes
        compete where something is left, or where something promises evidence at all.
        """
        found = self._ranked(model, curves=not model.leaves_nothing)
        return self._ranked(model, curves=True) if found and model.leaves_nothing else found

    def _ranked(self, model: Model[D], curves: bool) -> list[Proposal]:
        """As :meth:`_proposals`; ``curves`` says whether unknown causes that the model does not have compete."""
        hypotheses = self._hypotheses(model, curves)
        here = self._widths(hypotheses)
        judged = hypotheses.judged(here)
        now = judged[0].evidence
        proposals: dict[frozenset[int], Promised] = {}

        def propose(promise: float, chosen: Chosen, level: int) -> None:
            key = frozenset(chosen)
            if promise > max(LEAST, proposals.get(key, (0.0,))[0]):
                proposals[key] = promise, chosen, level

        for h in here:  # what the others have made needless
            rest = without(here, h)
            propose(hypotheses.levels[0][0] + hypotheses.linear.total(rest) - now, rest, 0)
        for level, (none, linear, _) in enumerate(hypotheses.levels):
            chosen = linear.best_set(hypotheses.present)
            propose(none + linear.total(chosen) - now, chosen, level)
            linear.forget()
            evidence, odds, width = judged[level]
            for g in np.argsort(-odds)[:_SINGLES]:
                if np.isfinite(odds[g]):
                    propose(evidence - now + float(odds[g]), {**here, int(g): float(width[g])}, level)
        ranked = sorted(proposals.values(), key=lambda row: -row[0])[:FITTED]
        if not ranked:
            return []
        rows = [row for row in best_singles(hypotheses, here, judged) if row[0] > _SHARE * ranked[0][0]]
        alone = len(rows)
        rows += [row for row in ranked if row[:2] not in [r[:2] for r in rows]]
        return [
            Proposal([hypotheses.all[g].name for g in chosen], (hypotheses, chosen, level), p, i >= alone)
            for i, (p, chosen, level) in enumerate(rows)
        ]

    def _fitted(self, model: Model[D], change: tuple[Hypotheses, Chosen, int]) -> Model[D]:
        """The model with a set of hypotheses as one level has it, fitted exactly."""
        self._take_noise_of(model)
        hypotheses, chosen, level = change
        _, linear, sizes = hypotheses.levels[level]
        effects, curves = hypotheses.model_of(chosen, linear)
        odds = sum(hypotheses.all[g].log_odds for g in chosen)
        base = self.base_of(sizes, curves)
        fitter = self.fitter.with_problem(with_curves(base, curves))
        fit = fitter.fit(effects, start=model.fit, exact=True, iterations=STEPS, fresh=False)
        sized = with_priors_of_size(fit.effects, model.expected)
        if any((a.block.deviation != b.block.deviation).any() for a, b in zip(fit.effects, sized, strict=True)):
            fit = fitter.fit(sized, start=fit, exact=True, iterations=_AGAIN, fresh=False)
        trial = self._tuned(Model(model.expected, fit, base, sizes, tuple(curves), odds))
        noise, before = self.plain.noise.rms, sizes
        for _ in range(_SETTLING):  # fitted at other sizes than it turned out to leave
            ratio = (trial.sizes.left(noise) + SEEN * noise) / (before.left(noise) + SEEN * noise)
            if 0.7 < ratio < 1.5:
                break
            before, trial = trial.sizes, self._fitted_again(trial, _AGAIN)
        return trial

    def rivals_of(
        self, model: Model[D], keys: Collection[str], until_better: bool = False
    ) -> dict[str, list[tuple[str, Model[D]]]]:
        """Models with something else in the place of single causes, fitted exactly.

        Args:
            model: The best model.
            keys: Of the causes.
            until_better: Ends with the first that explains the data better: that has other rivals.
        """
        last = self._last  # unknown causes may be in it as well, and are passed over
        hypotheses = last[2] if last is not None and last[0] is model else self._hypotheses(model, curves=False)
        chosen = self._widths(hypotheses)
        out: dict[str, list[tuple[str, Model[D]]]] = {}
        for h in chosen:
            mine = hypotheses.all[h]
            if mine.name not in keys or mine.curve is not None:
                continue
            self.progress(f"what could stand in the place of {mine.name}", 0, 1)
            rest = without(chosen, h)
            rows = hypotheses.linear.rivals(chosen, h)
            rivals = {g: w for _, g, w in [row for row in rows if hypotheses.all[row[1]].curve is None][:RIVALS]}
            for g in (*rivals, *(g for g in hypotheses.look_alikes(h) if g not in rivals)):
                trial = self._fitted(model, (hypotheses, {**rest, g: rivals.get(g, 1.0)}, 0))
                if g not in rivals:
                    trial = replace(trial, evidence=trial.evidence - _UNLIKELY)
                if hypotheses.all[g].name == mine.name and is_near(model.fit, trial.fit, mine.name):
                    continue  # another seed has led to the same place
                if g in rivals or (trial.fit.effects[-1].vector > trial.fit.effects[-1].neutral).all():
                    out.setdefault(mine.name, []).append((hypotheses.all[g].id, trial))
                    if until_better and trial.evidence > model.evidence + WORTH:
                        return out
        return out
