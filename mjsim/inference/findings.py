"""What a search has found, in sentences that an engineer acts on: probabilities that something is larger than a machine
of its class may have.

Evidence says whether something is there. On a real machine a dozen small things are there, and nobody cares for them.
So each effect has a class size: the limit of its tolerance; for a kind without one, one typical size; nothing on a
machine that is otherwise as its file says. An effect is a finding where its size is beyond that for sure, by the rule
of ISO 14253-1: with a probability of 95 %.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic

import numpy as np
from scipy.special import erfc, expit

from mjsim.inference.bar_search import BarSearch
from mjsim.inference.budget import Budget, budgets, split_of_bars
from mjsim.inference.calibration import LIMIT_DEVIATIONS, Calibrated, expected_effects, sheet_deviations, sheet_range
from mjsim.inference.combinations import Combination, combinations
from mjsim.inference.considered import with_choice, with_instrument
from mjsim.inference.curve_fit import Together, fit_beside_simple, simplest_shape
from mjsim.inference.curve_terms import CurveTerm, CurveTerms
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit, Fitter
from mjsim.inference.hypotheses import CAUSE, entries_of, log_odds_of, name_of
from mjsim.inference.linear_evidence import WORTH
from mjsim.inference.outcome import FoundEffect, Selection, verdict_of
from mjsim.inference.posterior import beyond
from mjsim.inference.problem import Problem
from mjsim.inference.search import SEEN, STEPS, TOLD, D, DataFitter, Found, Model, Search, names_to_tell, number_to_tell
from mjsim.inference.shares import Calibration, calibrations, parts_of, unabsorbed
from mjsim.inference.unexplained import FurtherCurve, Unexplained, describe
from mjsim.inference.unknown_curves import Curve, best_curves
from mjsim.inference.vibration import Separated
from mjsim.machine.chain import is_rotary
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.units import DEG, UM

#: Probability from which something is a finding: the same as that of the names that are told for it.
FINDING = TOLD
#: Most knots of a curve that is told: they say where its steps are.
_SHARPEST = 600
#: Curves that are fitted in the place of the one of an unknown cause, those of largest evidence.
_OTHERS = 3
#: How often something else may take a finding's place.
_SWAPS = 2


@dataclass(frozen=True)
class Verdicts:
    """Probabilities of what a diagnosis can say; they sum to 1.

    Attributes:
        nothing_found: No effect and no unknown cause is larger than a machine of its class may have.
        identified: Some effect is, and it is known which.
        ambiguous: Some effect is, and more than one name for it is left.
        unknown: The cause is in no catalogue.
    """

    nothing_found: float
    identified: float
    ambiguous: float
    unknown: float

    def to_json(self) -> dict[str, float]:
        """As in the JSON of ``mjsim diagnose``."""
        return {name: round(float(p), 4) for name, p in vars(self).items()}


@dataclass(frozen=True)
class Explained(Generic[D]):
    """What the data say.

    Attributes:
        data: What the search ended on.
        selection: The model, and its findings in the order of their contribution.
        unexplained: A cause that is in no catalogue.
        further: Other curves of such causes, most of them no larger than a machine of the class may have.
        calibration: Effects of a machine of its class that are no findings.
        shares: Share of each cause in the explained squared error.
        combinations: Sums of numbers that the tests determine.
        verdict: ``identified``, ``ambiguous``, ``unknown`` or ``nothing_found``, by what is a finding.
        verdicts: Probabilities of all.
        discrepancy: RMS of what is in no model, m.
        common: Sizes of what every machine has a little of and no model has, by name, in their own units: the RMS turn
            of the slides over 200 mm of travel, rad; the RMS share of the friction by which it varies. Only of those
            that the data show.
        budget: Where the uncertainty of every number comes from.
    """

    data: D
    selection: Selection
    unexplained: Unexplained | None
    further: tuple[FurtherCurve, ...]
    calibration: tuple[Calibration, ...]
    shares: dict[str, float]
    combinations: tuple[Combination, ...]
    verdict: str
    verdicts: Verdicts
    discrepancy: float
    common: dict[str, float]
    budget: tuple[Budget, ...]


def explain(separated: Separated, progress: Progress = silent, most: int | None = None) -> Explained[Problem]:
    """What is missing from the model of a machine.

    Args:
        separated: The measured tests without vibrations.
        progress: Called as work gets on.
        most: Most findings that are named; without it all.
    """
    search = BarSearch(Fitter(separated.problem, separated.machine), progress)
    return _BarReader(search, search.run(most), progress).read(most)


@dataclass(frozen=True)
class UnknownCauses:
    """What a model has of causes that are in no catalogue.

    Attributes:
        fit: The model, fitted beside the one that is told.
        probability: That one of them is larger than its class allows.
        told: The one that is farthest beyond its class, where it is a finding.
        further: All others.
    """

    fit: Fit
    probability: float = 0.0
    told: Unexplained | None = None
    further: tuple[FurtherCurve, ...] = ()


class ClassSizes:
    """Sizes of fitted effects against what a machine of its class may have.

    Args:
        expected: What a machine of the class has, by key.
        machine: As its file says.
    """

    def __init__(self, expected: Mapping[str, Calibrated], machine: Machine) -> None:
        self.expected, self.machine = expected, machine

    def sizes(self, fit: Fit, without: Callable[[EffectVector], Fit] | None = None) -> dict[str, float]:
        """Probability of every effect of the model, by key, that it is there and larger than its class allows.

        In a linear problem, others may take an effect's place that cannot: the motion does not tell all torques of a
        drive from all times one factor, but no factor makes a ripple of nothing. So what is large and seems to be
        there perhaps is fitted without.

        Args:
            fit: The model.
            without: Fits the model without one of its effects; else the linear problem is believed.
        """
        out = {f.effect.key: self._beyond(fit, f) for f in fit.effects}
        for f in fit.effects:
            key = f.effect.key
            if key in self.expected:
                continue
            there = self._there(fit, f)
            if without is not None and there < FINDING <= out[key]:
                there = max(there, self._missed(fit, f, without(f)))
            out[key] *= there
        return out

    def findings(
        self, fit: Fit, size: Mapping[str, float], rivals_of: Mapping[str, Sequence[tuple[str, Model]]], evidence: float
    ) -> list[FoundEffect]:
        """Every effect of a model with the probability that it is larger than its class allows.

        Args:
            fit: The model.
            size: Probability of every effect, by key, that it is there and larger than its class allows.
            rivals_of: Models with something else in the place of a cause, and its id, by the cause's key.
            evidence: Log evidence of the model.
        """
        out = []
        for f in fit.effects:
            key, large = f.effect.key, size[f.effect.key]
            mine, told = names_to_tell(rivals_of.get(key, []), evidence, name_of(f.effect))
            columns = fit.design.columns(fit.parameters[f.block.name]) @ (f.vector - f.off)
            entry = FoundEffect(key, float(columns @ columns), {i: m.fit for i, (_, m) in told.items()})
            others_p = {i: p * large for i, (p, _) in told.items()}
            out.append(replace(entry, probability=mine * large, others=others_p, whole=large))
        return out

    def _there(self, fit: Fit, f: EffectVector) -> float:
        """Probability that an effect is there at all: of its surest wave (Savage-Dickey density ratio). A number of the
        data sheet is there where it is none that the sheet allows.
        """
        assert f.prior is not None
        mean, deviation = f.prior
        covariance, sheet = fit.covariance_of(f), sheet_deviations(fit.base, f)
        groups = entries_of(f)
        best = -np.inf
        for _, at in groups:
            off, c = (f.vector - mean)[at], covariance[np.ix_(at, at)]
            odds = _density_ratio(off, c, deviation[at])
            if sheet[at].all():
                information = np.linalg.inv(c) - np.diag(deviation[at] ** -2.0)
                c_sheet = np.linalg.inv(information + np.diag(sheet[at] ** -2.0))
                odds -= _density_ratio(c_sheet @ np.linalg.solve(c, off), c_sheet, sheet[at])
            best = max(best, odds + log_odds_of(f, fit.base) / len(groups))
        return float(expit(best))

    @staticmethod
    def _missed(fit: Fit, f: EffectVector, without: Fit) -> float:
        """Probability that an effect is there, by what the model lacks without it."""
        assert f.prior is not None
        shrunk = np.linalg.slogdet(fit.covariance_of(f))[1] - 2.0 * np.log(f.prior[1]).sum()
        return float(expit(0.5 * (without.objective - fit.objective + shrunk) + log_odds_of(f, fit.base)))

    def _class_of(self, f: EffectVector) -> tuple[np.ndarray, np.ndarray]:
        """Middle of what a machine of the class has of an effect, and how far it may be from that, (n,) typical sizes
        each. A size that is a number of the data sheet may be whatever that is believed to be.
        """
        expected = self.expected.get(f.effect.key)
        if expected is None:
            mean, limit = f.off, np.ones(len(f.vector)) if self.expected else np.zeros(len(f.vector))
        else:
            mean, deviation, own = expected.prior_of(f)
            limit = np.where(own, LIMIT_DEVIATIONS * deviation, 1.0)
        low, high = mean - limit, mean + limit
        for name, ends in sheet_range(self.machine, f.effect).items():
            if name in f.names:
                i, ends = f.names.index(name), [f.specs[name].encode(x) for x in ends]
                low[i], high[i] = min(low[i], *ends), max(high[i], *ends)
        return 0.5 * (low + high), 0.5 * (high - low)

    def _beyond(self, fit: Fit, f: EffectVector) -> float:
        """Probability that an effect is larger than its class allows: of the number that lies farthest."""
        covariance = fit.covariance_of(f)
        mean, limit = self._class_of(f)
        best = 0.0
        for _, entries in entries_of(f):
            off, c = (f.vector - mean)[entries], covariance[np.ix_(entries, entries)]
            if len(entries) == 2 and (f.polar or f.names == ("components",)):
                best = max(best, beyond(off, c, float(limit[entries].max())))
            else:
                for x, variance, most in zip(off, np.diag(c), limit[entries], strict=True):
                    best = max(best, beyond(np.array([x]), np.array([[variance]]), float(most)))
        return best

    def excess(self, f: EffectVector) -> float:
        """Share of an effect that is beyond the limit of its class; all of it where its class has none at all."""
        if not self.expected:
            return 1.0
        mean, limit = self._class_of(f)
        size = np.max([np.linalg.norm(((f.vector - mean) / limit)[at]) for _, at in entries_of(f)])
        return 1.0 - 1.0 / max(float(size), 1.0)

    def in_class(self, f: EffectVector) -> Calibrated:
        """What a machine of the class may have of an effect, also where no tolerance says so."""
        expected = self.expected.get(f.effect.key)
        if expected is not None:
            return expected
        sizes = {n: f.specs[n].scale for n in f.names if f.specs[n].neutral is not None or n == "components"}
        return Calibrated(f, f.off, np.ones(len(f.vector)), sizes or {f.names[0]: 1.0})

    @staticmethod
    def verdicts(named: list[FoundEffect], rows: list[FoundEffect], unknown: float) -> Verdicts:
        """Probabilities of the four verdicts; findings are taken for independent of each other.

        Args:
            named: Findings.
            rows: All effects of the model.
            unknown: Probability of a cause that is in no catalogue.
        """
        keys = {r.key for r in named}
        sure = float(np.prod([1.0 - r.whole for r in named]))  # that none of the findings is one
        small = float(np.prod([1.0 - r.whole for r in rows if r.key not in keys]))
        clear = float(np.prod([r.probability / r.whole for r in named]))
        rest = sure * (1.0 - unknown)
        identified = (1.0 - sure) * clear + rest * (1.0 - small)
        return Verdicts(rest * small, identified, (1.0 - sure) * (1.0 - clear), sure * unknown)


def _density_ratio(off: np.ndarray, covariance: np.ndarray, deviation: np.ndarray) -> float:
    """Logarithm of the prior density where an effect is neutral over the posterior density there.

    Args:
        off: Estimate, from there, (n,).
        covariance: Of the estimate, (n, n).
        deviation: Of the prior around there, (n,).
    """
    shrunk = np.linalg.slogdet(covariance)[1] - 2.0 * np.log(deviation).sum()
    return 0.5 * float(off @ np.linalg.solve(covariance, off) + shrunk)


def _without(fitter: DataFitter[D], fit: Fit, f: EffectVector, instead: Sequence[EffectVector] = ()) -> Fit:
    """A model fitted without one of its effects, or with something else in its place."""
    effects = [*(g for g in fit.effects if g is not f), *instead]
    return fitter.fit(effects, start=fit, exact=True, iterations=STEPS, fresh=False)


class Reader(ABC, Generic[D]):
    """Reads findings out of a search.

    Args:
        search: That has ended.
        found: Its outcome.
        progress: Called as work gets on.
    """

    def __init__(self, search: Search[D], found: Found[D], progress: Progress) -> None:
        self.search, self.found, self.progress = search, found, progress

    @property
    def model(self) -> Model[D]:
        """The best model so far."""
        return self.found.model

    @property
    def stated(self) -> dict[str, Calibrated]:
        """What the machine file states a tolerance for, by key."""
        return self.model.expected if self.model.fit.base.tolerance else {}

    @property
    def of_class(self) -> ClassSizes:
        """Sizes against what a machine of its class has. One with an unknown cause is not as its file says: what else
        it has is judged as on any machine.
        """
        expected = self.model.expected
        if self.model.curves and not expected:
            expected = {c.key: c for c in expected_effects(self.model.fit.base)}
        return ClassSizes(expected, self.model.fit.base)

    @abstractmethod
    def _parts(self, fit: Fit) -> dict[str, np.ndarray]:
        """What each effect adds to the readings that the set-up cannot take up, by key, (m,) SI."""

    @abstractmethod
    def _unknown(self, fit: Fit) -> UnknownCauses:
        """What a model has of causes that are in no catalogue."""

    @abstractmethod
    def _budget(self, fit: Fit) -> tuple[Budget, ...]:
        """Where the uncertainty of every number of a model comes from."""

    def _with_instrument(self, problem: D, fit: Fit) -> Fit:
        """A model with the errors of the instrument that are no unknowns of it; the fit is whitened by ``problem``."""
        return fit

    def resolves(self, f: EffectVector) -> bool:
        """Whether the data tell an effect from others of its kind."""
        return True

    def _verdict(
        self, named: list[FoundEffect], rows: list[FoundEffect], shown: Collection[str], unknown: UnknownCauses
    ) -> tuple[str, Verdicts]:
        """The verdict, and the probabilities of all.

        Args:
            named: Findings.
            rows: All effects of the model.
            shown: Keys of those of which the data say more than the tolerance.
            unknown: Causes that are in no catalogue.
        """
        verdict = verdict_of((bool(r.others) for r in named), unknown.told is not None)
        # a number that the data do not show is no more beyond its limit than on any machine of the class
        return verdict, self.of_class.verdicts(named, [r for r in rows if r.key in shown], unknown.probability)

    def _as_of_class(self, f: EffectVector) -> EffectVector:
        """An effect of the model with the prior that its class gives it, where it does."""
        expected = self.model.expected.get(f.effect.key)
        return f if expected is None else f.with_prior(*expected.prior_of(f)[:2])

    def _is_cause(self, f: EffectVector) -> bool:
        """Whether an effect of the model, or a wave of it, is none that a machine of the class has."""
        expected = self.model.expected.get(f.effect.key)
        return expected is None or not expected.prior_of(f)[2].all()

    def _sizes(self, fit: Fit) -> dict[str, float]:
        """Probability of every effect of a model, by key, that it is there and larger than its class allows. Beside an
        unknown cause an effect is only named for what no curve can say that is as large at any place as at its largest:
        an error that a machine of the class has for what is beyond that by the prior of the class, any other cause for
        what the model without it leaves.

        Args:
            fit: The model, with what the instrument may be off.
        """
        fitter, curves = self.search.fitter.with_problem(self.model.problem), self.model.curves
        sizes = self.of_class.sizes(fit, lambda f: _without(fitter, fit, f))
        if not curves:
            return sizes
        wide = [replace(c, width=max(c.width, c.largest)) for c in curves]
        problem = self.search.problem_of(self.model.sizes, wide)
        wide_fitter = self.search.fitter.with_problem(problem)
        usual = [self._as_of_class(f) for f in fit.effects]
        free = wide_fitter.fit(usual, start=fit, exact=True, iterations=STEPS, fresh=False)
        free = self._with_instrument(problem, free)
        sizes = {key: min(p, sizes[key]) for key, p in self.of_class.sizes(free).items()}
        for f in free.effects:
            if sizes[f.effect.key] < FINDING or not self._is_cause(f):
                continue
            mine = [self.model.expected[f.effect.key].free] if f.effect.key in self.model.expected else []
            odds = 0.5 * (_without(wide_fitter, free, f, mine).objective - free.objective) + CAUSE
            sizes[f.effect.key] = min(sizes[f.effect.key], float(expit(odds)))
        return sizes

    def _fitted(self, start: Fit, iterations: int) -> Fit:
        """The model fitted from ``start``, with what the instrument may be off."""
        fitter = self.search.fitter.with_problem(self.model.problem)
        fit = fitter.fit(start.effects, start=start, exact=True, iterations=iterations, fresh=False)
        return self._with_instrument(self.model.problem, fit)

    def read(self, most: int | None) -> Explained[D]:
        """What the data say.

        Args:
            most: Most findings that are named; without it all.
        """
        fit, rivals, sizes = self.model.fit, {}, {}
        for swaps in range(_SWAPS + 1):
            fit = self._fitted(self.model.fit, 3)
            sizes = self._sizes(fit)
            keys = {key for key, p in sizes.items() if p >= FINDING}
            rivals = self.search.rivals_of(self.model, keys, until_better=swaps < _SWAPS)
            best = max((m for row in rivals.values() for _, m in row), key=lambda m: m.evidence, default=self.model)
            if best.evidence <= self.model.evidence + WORTH or swaps == _SWAPS:
                break
            # something else in its place is the better explanation
            self.found = replace(self.found, model=best)
        unknown = self._unknown(fit)
        if unknown.told is not None:  # the same model where that cause is part of what the data are whitened by
            fit = self._fitted(unknown.fit, 0)
            sizes = self._sizes(fit)
        whitened = fit
        fit = replace(unknown.fit, considered=whitened.considered)
        # a probability has the rivals' already: their spread goes into the intervals only
        rows = self.of_class.findings(fit, sizes, rivals, self.model.evidence)
        fit = with_choice(fit, rivals, self.model.evidence)
        budget = self._budget(replace(whitened, considered=fit.considered))
        self.progress("shares of the error", 0, 1)
        coarse = {f.effect.key for f in fit.effects if not self.resolves(f)}
        named = [r for r in rows if r.whole >= FINDING and r.key not in coarse]
        named = sorted(named, key=lambda r: -r.gain)[:most]
        excess = {f.effect.key: self.of_class.excess(f) for f in fit.effects}
        keys = {r.key for r in named}
        inside = [self.of_class.in_class(f) for f in fit.effects if f.effect.key not in keys]
        settings = self.model.problem.settings
        entries, shares = calibrations(self._parts(fit), fit, inside, settings.observable)
        entries = tuple(replace(c, observable=c.observable and c.effect.effect.key not in coarse) for c in entries)
        explained = self.found.start.sum_squares - fit.sum_squares
        named = [replace(r, gain=max(shares.get(r.key, 0.0) * explained, 0.0)) for r in named]
        # first what takes most of the error away when it is brought back to its limit
        named.sort(key=lambda r: (-r.gain * excess[r.key] ** 2, -r.gain))
        selection = Selection(self.found.start, fit, named, self.found.bank, self.model.sizes, self.found.trail)
        shown = keys | {c.effect.effect.key for c in entries if c.observable}
        verdict, verdicts = self._verdict(named, rows, shown, unknown)
        sums, sizes, ended = combinations(fit, settings), self.model.sizes, self.model.problem
        told, further = unknown.told, unknown.further
        common = self.search.discrepancy.told(sizes, SEEN * ended.noise.rms)
        return Explained(
            ended, selection, told, further, entries, shares, sums, verdict, verdicts, sizes.rms, common, budget
        )


class _BarReader(Reader[Problem]):
    """Reads findings out of a search on ball-bar tests."""

    def _parts(self, fit: Fit) -> dict[str, np.ndarray]:
        return parts_of(self.model.problem, fit)

    def _with_instrument(self, problem: Problem, fit: Fit) -> Fit:
        return with_instrument(problem, fit)

    def _budget(self, fit: Fit) -> tuple[Budget, ...]:
        return budgets(fit, split_of_bars(self.model.problem), self.stated)

    def _unknown(self, fit: Fit) -> UnknownCauses:
        curves = self.model.curves
        if not curves:
            return UnknownCauses(fit)
        sizes = [(c, values, self._curve_beyond(c.term, values, spread)) for c, (values, spread) in self._values(fit)]
        causes = [row for row in sizes if not row[0].term.mode]
        if not causes:
            return UnknownCauses(fit, 0.0, None, tuple(self._further(fit, c, v, p) for c, v, (p, _) in sizes))
        curve, _, (large, _) = max(causes, key=lambda row: row[2])
        is_finding = large >= FINDING
        rest = [row for row in sizes if row[0] is not curve or not is_finding]
        further = tuple(self._further(fit, c, values, beyond) for c, values, (beyond, _) in rest)
        if not is_finding:
            return UnknownCauses(fit, large, None, further)
        self.progress("describing what is in no catalogue", 0, 1)
        # where it jumps is what is asked now: the readings there have no error of their own
        problem = self.search.problem_of(self.model.sizes, [c for c in curves if c is not curve])
        fitter = self.search.fitter.with_problem(problem)
        alone = fitter.fit(fit.effects, start=fit, exact=True, iterations=0, fresh=False)
        (best, probability), *others = self._terms(problem, alone, curve)
        moved, term, _ = fit_beside_simple(fitter, alone, best)
        others = [(t, large * p) for t, p in others]
        told = describe(problem, moved, term, large * probability, others)
        return UnknownCauses(moved, large, told, further)

    def _terms(self, problem: Problem, beside: Fit, curve: Curve) -> list[tuple[CurveTerm, float]]:
        """What an unknown cause may act on and depend on, with probabilities, the likeliest first: the fewest that hold
        the truth with the probability of what is told. Each in the simplest shape, with the knots that it needs.

        Args:
            problem: The tests with the whitening of the model without the curve.
            beside: The model without the curve, whitened by ``problem``.
            curve: Of the model.
        """
        others = (c for _, c in best_curves(problem, beside, self.search.plain) if c.name != curve.name)
        rows: dict[tuple, tuple[float, CurveTerm]] = {}
        terms = CurveTerms(problem, beside)
        for c in (curve, *itertools.islice(others, _OTHERS)):
            objective, term = _with_enough_knots(terms, terms.by_values(c.term))
            key, evidence = (term.axis, term.moves, term.variable), c.log_odds - 0.5 * objective
            if key not in rows or evidence > rows[key][0]:  # one variable with another period is the same answer
                rows[key] = evidence, term
        ranked = sorted(rows.values(), key=lambda row: -row[0])
        shares = np.exp([e - ranked[0][0] for e, _ in ranked])
        shares /= shares.sum()
        told = number_to_tell(shares)
        return [(term, float(p)) for (_, term), p in zip(ranked[:told], shares[:told], strict=True)]

    def _values(self, fit: Fit) -> Iterator[tuple[Curve, tuple[np.ndarray, np.ndarray]]]:
        """Every curve of the model with how far it displaces at its knots, and the standard deviations of that, all
        fitted together.
        """
        model, base = self.model, self.model.base
        fitter = self.search.fitter.with_problem(base)
        alone = fitter.fit(fit.effects, start=fit, exact=True, iterations=0, fresh=False)
        columns = base.whiten_further(np.hstack([c.columns for c in model.curves]))
        cross = alone.design.T @ columns
        information = alone.linear.left_over(columns.T @ columns, cross)
        covariance = np.linalg.inv(information + np.eye(columns.shape[1]))
        sizes = covariance @ (columns.T @ alone.residual - cross.T @ alone.step)
        first = 0
        for c in model.curves:
            at = slice(first, first + c.root.shape[1])
            root = c.displacing(sizes[at]) * c.width
            yield c, (root @ sizes[at], np.sqrt(np.einsum("ij,jk,ik->i", root, covariance[at, at], root)))
            first = at.stop

    def _curve_beyond(self, term: CurveTerm, values: np.ndarray, spread: np.ndarray) -> tuple[float, float]:
        """Probability that a curve is larger, at some place, than a machine of the class may have: than its pitch
        error, or than its play where it has a sign by the direction of motion. How far it is beyond, over its spread.
        """
        size, spread = np.abs(values) * term.unit, np.maximum(spread, 1e-9) * term.unit
        limit = self._limit_of(term)
        beyond = float(np.max((size - limit) / spread))
        return (1.0 if limit == 0.0 else 0.5 * float(erfc(-beyond / math.sqrt(2.0)))), beyond

    def _limit_of(self, term: CurveTerm) -> float:
        """How far a curve may displace on a machine of the class, m or rad; 0 where nothing of the kind is expected."""
        if term.mode or not self.model.expected:
            return 0.0
        chain, kind = self.model.fit.base.chain, "backlash" if term.signed else "pitch_error"
        moves = term.moves if term.moves in chain.letters else chain.linear[0]
        expected = self.model.expected.get(f"{kind}.{moves}")
        return next(iter(expected.limits.values())) * (DEG if is_rotary(moves) else UM) if expected else 0.0

    def _further(self, fit: Fit, curve: Curve, values: np.ndarray, beyond: float) -> FurtherCurve:
        """A curve of the model in short.

        Args:
            fit: The model.
            curve: Of it.
            values: How far it displaces at its knots, (knots,).
            beyond: Probability that this is more than the class allows.
        """
        term = curve.term
        rms = float(np.sqrt(np.mean(np.concatenate(unabsorbed(self.model.problem, fit, list(curve.readings))) ** 2)))
        # the accelerations of axes that follow each other are told apart badly: together they say how far it swings
        swings = max(float(np.abs(r).max()) for r in curve.readings)
        largest = swings if term.mode else float(np.abs(values).max()) * term.unit
        return FurtherCurve(term.axis, term.moves, term.variable, largest, self._limit_of(term), rms, beyond, term.mode)


def _with_enough_knots(terms: CurveTerms, term: CurveTerm) -> tuple[float, CurveTerm]:
    """A curve with the number of knots of largest evidence in the simplest shape, and its -2 log evidence: a step lies
    between two of them.
    """
    shape = partial(simplest_shape, closed=term.period is not None)
    whiten, all_terms = terms.problem.whiten, (term, *terms.finer(term, _SHARPEST))
    rows = [(Together(terms.fit, whiten(t.columns), 1.0, shape).objective, t) for t in all_terms]
    return min(rows, key=lambda row: row[0])
