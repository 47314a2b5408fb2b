"""What a search has found, in sentences that an engineer acts on: probabilities that something is larger than a machine
of its class may have.

Evidence says whether something is there. On a real machine a dozen small things are there, and nobody cares for them.
So each effect has a class size: the limit of its tolerance; for a kind without one, one typical size; nothing on a
machine that is otherwise as its file says. An effect is a finding where its size is beyond that for sure, by the rule
of ISO 14253-1: with a probability of 95 %.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.special import erfc

from mjsim.estimation.budget import Budget, budgets, of_bars
from mjsim.estimation.calibration import LIMIT_DEVIATIONS, Calibrated
from mjsim.estimation.combinations import Combination, combinations
from mjsim.estimation.conformity import beyond
from mjsim.estimation.considered import Alternative, with_choice, with_instrument
from mjsim.estimation.curve_fit import Together, fit_beside_simple
from mjsim.estimation.curve_shape import simplest_shape
from mjsim.estimation.curve_terms import CurveTerm, CurveTerms
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fit, Fitter
from mjsim.estimation.hypotheses import entries_of, log_odds_of
from mjsim.estimation.outcome import Found as FoundEffect
from mjsim.estimation.outcome import Selection, verdict_of
from mjsim.estimation.problem import Problem
from mjsim.estimation.search import Found, Model, Search, with_curves
from mjsim.estimation.shares import Calibration, calibrations
from mjsim.estimation.unexplained import Unexplained, describe
from mjsim.estimation.unknown_curves import FINER, LONGEST, Curve
from mjsim.estimation.vibration import Separated
from mjsim.machine.chain import is_rotary
from mjsim.progress import Progress, silent
from mjsim.units import DEG, UM

#: Probability from which something is a finding: with which ISO 14253-1 takes it for proven that a number is beyond its
#: limit. The set of names that is told for a finding has the same.
FINDING = TOLD = 0.95
#: How often something else may take a finding's place.
_SWAPS = 3


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
class Explained:
    """What the data say.

    Attributes:
        data: The tests that the search ended on.
        selection: The model, and its findings in the order of their contribution.
        unexplained: A cause that is in no catalogue.
        calibration: Effects of a machine of its class that are no findings.
        shares: Share of each cause in the explained squared error.
        combinations: Sums of numbers that the tests determine.
        verdict: ``identified``, ``ambiguous``, ``unknown`` or ``nothing_found``, by what is a finding.
        verdicts: Probabilities of all.
        discrepancy: RMS in a test of what repeats and is in no model, m.
        budget: Where the uncertainty of every number comes from.
    """

    data: Problem
    selection: Selection
    unexplained: Unexplained | None
    calibration: tuple[Calibration, ...]
    shares: dict[str, float]
    combinations: tuple[Combination, ...]
    verdict: str
    verdicts: Verdicts
    discrepancy: float
    budget: tuple[Budget, ...]


def explain(separated: Separated, progress: Progress = silent, most: int | None = None) -> Explained:
    """What is missing from the model of a machine.

    Args:
        separated: The measured tests without vibrations.
        progress: Called as work gets on.
        most: Most findings that are named; without it all.
    """
    search = Search(Fitter(separated.problem, separated.machine), progress)
    return _Reader(search, search.run(most), progress).read(most)


class ClassSizes:
    """Sizes of fitted effects against what a machine of its class may have.

    Args:
        expected: What a machine of the class has, by key.
    """

    def __init__(self, expected: Mapping[str, Calibrated]) -> None:
        self.expected = expected

    def sizes(self, fit: Fit) -> dict[str, float]:
        """Probability of every effect of the model, by key, that it is there and larger than its class allows."""
        out = {f.effect.key: self._beyond(fit, f) for f in fit.effects}
        for f in fit.effects:
            if f.effect.key not in self.expected:
                out[f.effect.key] *= self._there(fit, f)
        return out

    def findings(
        self, fit: Fit, rivals_of: Mapping[str, Sequence[tuple[str, Alternative]]], evidence: float
    ) -> list[FoundEffect]:
        """Every effect of a model with the probability that it is larger than its class allows.

        Args:
            fit: The model.
            rivals_of: Models with something else in the place of a cause, and its id, by the cause's key.
            evidence: Log evidence of the model.
        """
        size = self.sizes(fit)
        out = []
        for f in fit.effects:
            key, large = f.effect.key, size[f.effect.key]
            rivals = rivals_of.get(key, [])
            logs = np.array([0.0, *(m.evidence - evidence for _, m in rivals)])
            shares = np.exp(logs - np.logaddexp.reduce(logs))
            others: dict[str, tuple[float, Alternative]] = {}
            for (effect_id, m), share in zip(rivals, shares[1:], strict=True):
                if share > others.get(effect_id, (0.0,))[0] and effect_id != f.effect.id:
                    others[effect_id] = float(share), m
            told, covered = {}, 1.0 - sum(p for p, _ in others.values())
            for i, (p, m) in sorted(others.items(), key=lambda row: -row[1][0]):
                if covered < TOLD and not i.startswith("curve"):
                    told[i] = p, m
                covered += p
            columns = fit.design.columns(fit.parameters[f.block.name]) @ (f.vector - f.off)
            mine = 1.0 - sum(p for p, _ in told.values())
            entry = FoundEffect(key, float(columns @ columns), {i: m.fit for i, (_, m) in told.items()})
            others_p = {i: p * large for i, (p, _) in told.items()}
            out.append(replace(entry, probability=mine * large, others=others_p, whole=large))
        return out

    def _there(self, fit: Fit, f: EffectVector) -> float:
        """Probability that an effect is there at all: of its surest wave (Savage-Dickey density ratio)."""
        assert f.prior is not None
        mean, deviation = f.prior
        covariance = fit.covariance_of(f)
        groups = entries_of(f)
        best = -np.inf
        for _, at in groups:
            off, c = (f.vector - mean)[at], covariance[np.ix_(at, at)]
            shrunk = np.linalg.slogdet(c)[1] - 2.0 * np.log(deviation[at]).sum()
            odds = 0.5 * float(off @ np.linalg.solve(c, off) + shrunk)
            best = max(best, odds + log_odds_of(f, fit.base) / len(groups))
        return 1.0 / (1.0 + math.exp(-min(best, 700.0)))

    def _class_of(self, f: EffectVector) -> tuple[np.ndarray, np.ndarray]:
        """What a machine of the class has of an effect, and how far it may be from that, (n,) typical sizes each."""
        expected = self.expected.get(f.effect.key)
        if expected is None:
            return f.off, np.ones(len(f.vector)) if self.expected else np.zeros(len(f.vector))
        mean, deviation, own = expected.prior_of(f)
        return mean, np.where(own, LIMIT_DEVIATIONS * deviation, 1.0)

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
        """Size of an effect over that of its class; zero where its class has none at all."""
        if not self.expected:
            return 0.0
        mean, limit = self._class_of(f)
        return float(np.max([np.linalg.norm(((f.vector - mean) / limit)[at]) for _, at in entries_of(f)]))

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


class _Reader:
    """Reads findings out of a search."""

    def __init__(self, search: Search, found: Found, progress: Progress) -> None:
        self.search, self.found, self.progress = search, found, progress

    @property
    def model(self) -> Model:
        """The best model so far."""
        return self.found.model

    @property
    def problem(self) -> Problem:
        """The tests with its whitening."""
        return self.model.problem

    @property
    def expected(self) -> dict[str, Calibrated]:
        """What a machine of its class has, by key."""
        return self.model.expected

    @property
    def stated(self) -> dict[str, Calibrated]:
        """What the machine file states a tolerance for, by key."""
        return self.expected if self.model.fit.base.tolerance else {}

    @property
    def of_class(self) -> ClassSizes:
        """Sizes against what a machine of its class has."""
        return ClassSizes(self.expected)

    def read(self, most: int | None) -> Explained:
        fit, rivals = self.model.fit, {}
        for _ in range(_SWAPS):
            fitter = Fitter(self.problem, self.model.fit.base)
            fit = fitter.fit(self.model.fit.effects, start=self.model.fit, exact=True, iterations=3, fresh=False)
            rivals = self._rivals(fit)
            best = max((m for row in rivals.values() for _, m in row), key=lambda m: m.evidence, default=self.model)
            if best.evidence <= self.model.evidence:
                break
            # something else in its place is the better explanation
            self.found = replace(self.found, model=best)
        unexplained, unknown, fit, problem = self._unknown(fit)
        fit = with_choice(with_instrument(problem, fit), rivals, self.model.evidence)
        rows = self.of_class.findings(fit, rivals, self.model.evidence)
        self.progress("shares of the error", 0, 1)
        named = [r for r in rows if r.whole >= FINDING]
        named = sorted(named, key=lambda r: -r.gain)[:most]
        excess = {f.effect.key: self.of_class.excess(f) for f in fit.effects}
        keys = {r.key for r in named}
        inside = [self.of_class.in_class(f) for f in fit.effects if f.effect.key not in keys]
        entries, shares = calibrations(self.problem, fit, inside)
        explained = self.found.start.sum_squares - fit.sum_squares
        named = [replace(r, gain=max(shares.get(r.key, 0.0) * explained, 0.0)) for r in named]
        named.sort(key=lambda r: (-excess[r.key], -r.gain))
        selection = Selection(self.found.start, fit, named, self.found.bank, self.found.trail)
        verdicts = self.of_class.verdicts(named, rows, unknown)
        verdict = verdict_of((bool(r.others) for r in named), unexplained is not None)
        sums, left = combinations(fit, self.problem.settings), self.model.sizes.rms
        budget = budgets(fit, of_bars(problem), self.stated)
        return Explained(self.problem, selection, unexplained, entries, shares, sums, verdict, verdicts, left, budget)

    # -- sizes ---------------------------------------------------------------------------------------------------------

    def _rivals(self, fit: Fit) -> dict[str, list[tuple[str, Model]]]:
        """What could stand in the place of each finding."""
        large = {key for key, p in self.of_class.sizes(fit).items() if p >= FINDING}
        return self.search.rivals_of(self.model, large)

    # -- unknown causes ------------------------------------------------------------------------------------------------

    def _unknown(self, fit: Fit) -> tuple[Unexplained | None, float, Fit, Problem]:
        """The unknown cause that is farthest beyond its class, where it is a finding; the probability that it is larger
        than its class allows; the model fitted beside it, and the problem that it is fitted to.
        """
        curves = self.model.curves
        if not curves:
            return None, 0.0, fit, self.problem
        (large, _), i = max((self._curve_beyond(c.term, *row), i) for i, (c, row) in enumerate(self._values(fit)))
        curve = curves[i]
        if large < FINDING:
            return None, large, fit, self.problem
        self.progress("describing what is in no catalogue", 0, 1)
        problem = with_curves(self.model.base, [c for c in curves if c is not curve])
        fitter = Fitter(problem, fit.base)
        alone = fitter.fit(fit.effects, start=fit, exact=True, iterations=0, fresh=False)
        moved, term, _ = fit_beside_simple(fitter, alone, _with_enough_knots(problem, alone, curve.term))
        return describe(problem, moved, term), large, moved, problem

    def _values(self, fit: Fit) -> Iterator[tuple[Curve, tuple[np.ndarray, np.ndarray]]]:
        """Every curve of the model with its values at the knots and their standard deviations, all fitted together."""
        model, base = self.model, self.model.base
        alone = Fitter(base, fit.base).fit(fit.effects, start=fit, exact=True, iterations=0, fresh=False)
        columns = base.whiten_further(np.hstack([c.columns * c.width for c in model.curves]))
        cross = alone.design.T @ columns
        information = alone.linear.left_over(columns.T @ columns, cross)
        covariance = np.linalg.inv(information + np.eye(columns.shape[1]))
        sizes = covariance @ (columns.T @ alone.residual - cross.T @ alone.step)
        first = 0
        for c in model.curves:
            at = slice(first, first + c.columns.shape[1])
            root = c.root * c.width
            yield c, (root @ sizes[at], np.sqrt(np.einsum("ij,jk,ik->i", root, covariance[at, at], root)))
            first = at.stop

    def _curve_beyond(self, term: CurveTerm, values: np.ndarray, spread: np.ndarray) -> tuple[float, float]:
        """Probability that a curve is larger, at some place, than a machine of the class may have: than its pitch
        error, or than its play where it has a sign by the direction of motion. How far it is beyond, over its spread.
        """
        size, spread = np.abs(values - values.mean()) * term.unit, np.maximum(spread, 1e-9) * term.unit
        limit = 0.0
        if self.expected:
            chain, kind = self.model.fit.base.chain, "backlash" if term.signed else "pitch_error"
            moves = term.moves if term.moves in chain.letters else chain.linear[0]
            expected = self.expected.get(f"{kind}.{moves}")
            if expected is not None:
                limit = next(iter(expected.limits.values())) * (DEG if is_rotary(moves) else UM)
        beyond = float(np.max((size - limit) / spread))
        return (1.0 if limit == 0.0 else 0.5 * float(erfc(-beyond / math.sqrt(2.0)))), beyond


def _with_enough_knots(problem: Problem, fit: Fit, term: CurveTerm) -> CurveTerm:
    """A curve with the number of knots of largest evidence in the simplest shape: a step lies between two of them."""
    terms = CurveTerms(problem, fit)
    shape = partial(simplest_shape, closed=term.period is not None)
    finer = [t for n in FINER for t in terms.finer(term, n) if len(t.knots) <= LONGEST]
    return min((term, *finer), key=lambda t: Together(fit, problem.whiten(t.columns), 1.0, shape).objective)
