"""The generic curve that best explains what a calibrated machine leaves, by evidence.

Small errors of a machine bend towards what they cannot explain. Which curve explains most shows only where they are
fitted together with it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mjsim.estimation.calibration import Calibrated
from mjsim.estimation.curve_fit import Together, fit_beside, fit_beside_simple
from mjsim.estimation.curve_search import stands_out
from mjsim.estimation.curve_shape import free_shape, simplest_shape
from mjsim.estimation.curve_terms import CurveTerm, CurveTerms
from mjsim.estimation.curve_waves import radial_curves
from mjsim.estimation.fit import Fit, Fitter
from mjsim.estimation.nuisance import TRIGGERS
from mjsim.estimation.one_curve import objective_with_findings
from mjsim.estimation.problem import Problem

#: Best curves that are looked at again, factors of their number of knots, and most knots (assumed).
_NEAR, _FINER, _LONG = 6, (2, 4), 320
#: Best axes whose position, or the clock, is looked at with the most knots, and factor of their number (assumed).
_JUMPS, _FINEST = 2, (8,)
#: Curves whose whitened columns are held at once: each fills tens of MB.
_AT_ONCE = 4
#: Most curves that are fitted where the linear problem leaves in doubt which one is best (assumed).
_RIVALS = 3
#: A trigger that stands further off follows what the model lacks, and one that a curve moves further reads another
#: part of the motion; prior standard deviations (assumed).
_BELIEVED, _MOVED = 3.0, 0.25


def best_curve_beside(fitter: Fitter, fit: Fit) -> tuple[Fit, CurveTerm] | None:
    """The curve of largest evidence beside a model, where it is worth its number of knots and stands out of a test.

    Args:
        fitter: Of the machine.
        fit: The model without a curve.

    Returns:
        The model that the curve stands beside, at believable triggers, and the curve.
    """
    problem, settings = fitter.problem, fitter.problem.settings
    least = fit.objective
    fit = _with_believed_triggers(fitter, fit)
    beside = _Beside(problem, fit)
    ranked = beside.ranked()
    own = [term for term in ranked if not _moves_another(term)]
    last = list({id(term): term for term in [*ranked[:_NEAR], *own[:1], *_jumps(ranked)]}.values())
    rows = [(both, fit, term) for both, term in zip(beside.in_simplest_shape(last), last, strict=True)]
    explained = least - min((both.objective for both, _, _ in rows), default=least)
    if explained < 2.0 * math.log(max(len(ranked), 1)) - 2.0 * settings.curve_log_odds:
        return None

    def charged(row: tuple[Together, Fit, CurveTerm]) -> float:
        both, _, term = row
        return both.objective + beside.weight * _across(term, problem)

    rivals = _one_of_each(sorted(rows, key=charged))[:_RIVALS]
    if rivals[0][0].misfit < settings.joint_fit:  # otherwise the linear problem is far from what it promises
        doubt = charged(rivals[0]) + settings.notable_share * explained
        rivals = [row for row in rivals if charged(row) < doubt]
    if len(rivals) > 1:
        rivals = [_arrived(fitter, fit, term, beside.weight) for _, _, term in rivals]
    both, fit, best = min(rivals, key=charged)
    best.coefficients = both.coefficients
    return (fit, best) if stands_out(problem, fit, best) else None


def _one_of_each(rows: list[tuple[Together, Fit, CurveTerm]]) -> list[tuple[Together, Fit, CurveTerm]]:
    """The first curve of each variable of an axis that moves the same."""
    first: dict[tuple[str, str, str], tuple[Together, Fit, CurveTerm]] = {}
    for row in rows:
        term = row[2]
        first.setdefault((term.axis, term.moves, term.variable), row)
    return list(first.values())


def _arrived(fitter: Fitter, fit: Fit, term: CurveTerm, weight: float) -> tuple[Together, Fit, CurveTerm]:
    """A model fitted together with a curve, and the curve at the triggers that the model has then."""
    fit, _, _ = fit_beside_simple(fitter, fit, term)
    fit = fitter.fit(fit.effects, start=fit, iterations=0, fresh=False)
    term = next(CurveTerms(fitter.problem, fit).finer(term, 1), term)
    return _Beside(fitter.problem, fit, weight).in_simplest_shape([term])[0], fit, term


def _with_believed_triggers(fitter: Fitter, fit: Fit) -> Fit:
    """The model with those triggers at zero that stand too far off."""
    triggers = fit.nuisance[fitter.problem.nuisances[TRIGGERS]]
    believed = np.abs(triggers) < _BELIEVED
    return fit if believed.all() else _with_triggers(fitter, fit, np.where(believed, triggers, 0.0))


def _with_triggers(fitter: Fitter, fit: Fit, triggers: np.ndarray) -> Fit:
    """The model at other ``triggers`` (tests,), in prior standard deviations."""
    nuisance = fit.nuisance.copy()
    nuisance[fitter.problem.nuisances[TRIGGERS]] = triggers
    return fitter.fit(fit.effects, start=replace(fit, nuisance=nuisance), iterations=0, fresh=False)


def best_curve_again(fitter: Fitter, fit: Fit, beside: Fit) -> tuple[Fit, CurveTerm] | None:
    """:func:`best_curve_beside` at the triggers of a model that was fitted beside a curve, where they have moved so far
    that this curve read other parts of the motion; otherwise ``None``.

    Args:
        fitter: Of the machine.
        fit: The model without a curve.
        beside: The same, fitted beside one.
    """
    at = fitter.problem.nuisances[TRIGGERS]
    if np.abs(beside.nuisance[at] - fit.nuisance[at]).max() < _MOVED:
        return None
    return best_curve_beside(fitter, _with_triggers(fitter, fit, beside.nuisance[at]))


class _Beside:
    """Curves beside one model.

    Attributes:
        weight: How often priors count: what the model does not explain counts as noise.
    """

    def __init__(self, problem: Problem, fit: Fit, weight: float | None = None) -> None:
        self.problem, self.fit = problem, fit
        self.weight = weight or max(1.0, fit.sum_squares / problem.count)

    def in_simplest_shape(self, terms: Sequence[CurveTerm]) -> list[Together]:
        """Model and curve, for each curve in the simplest shape that the data allow."""
        whitened = ((term, self.problem.whiten(term.columns)) for term in terms)
        return [both for both, _ in self._linear(whitened, simple=True)]

    def _linear(
        self, whitened: Iterable[tuple[CurveTerm, np.ndarray]], simple: bool = False
    ) -> Iterator[tuple[Together, CurveTerm]]:
        """The linear problem of each curve, from its whitened columns."""

        def one(row: tuple[CurveTerm, np.ndarray]) -> Together:
            term, columns = row
            shape = partial(simplest_shape, closed=term.period is not None) if simple else free_shape
            return Together(self.fit, columns, self.weight, shape)

        whitened = iter(whitened)
        while some := list(itertools.islice(whitened, _AT_ONCE)):
            yield from zip(self.problem.workers.map(one, some), [term for term, _ in some], strict=True)

    def ranked(self) -> list[CurveTerm]:
        """All curves that reach a reading, the best free one first, and those worth a look with more knots as well."""
        terms = CurveTerms(self.problem, self.fit)
        periodic = (term for term in terms.clock(waves=True) if term.period)
        rows = self._sorted([], terms.whitened(itertools.chain(radial_curves(terms), periodic)))
        near = [t for i, (_, t) in enumerate(rows) if i < _NEAR or _may_jump(t)]
        rows = self._sorted(rows, terms.whitened(_finer(terms, near, _FINER), free=False))
        jumps = _jumps([t for _, t in rows])
        return [t for _, t in self._sorted(rows, terms.whitened(_finer(terms, jumps, _FINEST), free=False))]

    def _sorted(
        self, rows: list[tuple[float, CurveTerm]], more: Iterable[tuple[CurveTerm, np.ndarray]]
    ) -> list[tuple[float, CurveTerm]]:
        """Curves with -2 log evidence of model and curve, but for what all have in common."""
        return sorted([*rows, *((both.objective, t) for both, t in self._linear(more))], key=lambda r: r[0])


def _finer(terms: CurveTerms, near: Iterable[CurveTerm], factors: Iterable[int]) -> Iterator[CurveTerm]:
    """The curves with more knots, as far as these are not too many."""
    for term, n in itertools.product(near, factors):
        if n * len(term.knots) <= _LONG:
            yield from terms.finer(term, n)


def _may_jump(term: CurveTerm) -> bool:
    """Whether a curve may have a step at one place or time, which shows with many knots only: what a few teeth do to
    the position of an axis, or a fixture that slips.
    """
    return (term.variable == "position" and term.axis == term.moves) or (not term.axis and term.period is None)


def _jumps(ranked: Iterable[CurveTerm]) -> list[CurveTerm]:
    """Those curves that may jump, of the best that depend on a position or on time."""
    found = [term for term in ranked if _may_jump(term)]
    best = list(dict.fromkeys((term.axis, term.moves) for term in found))[:_JUMPS]
    return [term for term in found if (term.axis, term.moves) in best]


def curve_instead(
    fitter: Fitter, named: Fit, beside: CurveTerm, findings: Collection[str], usual: Collection[Calibrated]
) -> tuple[Fit, CurveTerm] | None:
    """The machine without findings and one curve, where the evidence is for it against findings beside a curve.

    Findings beside something unknown may be parts of it.

    Args:
        fitter: Of the machine.
        named: The model with the findings.
        beside: The curve beside it.
        findings: Their keys.
        usual: Effects that a machine of its class has.
    """
    problem = fitter.problem
    calibrated = fitter.fit([c.free for c in usual], start=named, fresh=False)
    better = best_curve_beside(fitter, calibrated)
    if better is None:
        return None
    calibrated, curve = better
    with_findings, _, both = fit_beside(fitter, named, beside)
    _, _, single = fit_beside(fitter, calibrated, curve)
    cost = objective_with_findings(with_findings, calibrated, findings, problem.settings.log_odds)
    cost -= with_findings.objective
    # what neither explains counts as noise
    noise = max(1.0, min(single.misfit, both.misfit))
    loss = (single.objective - both.objective) / noise + _across(curve, problem) - _across(beside, problem)
    # one cause stands where several do not do clearly better
    clear = problem.settings.likelihood_ratio
    if noise > problem.settings.joint_fit:  # neither is right: a small share of what they explain decides nothing
        explained = (calibrated.objective - single.objective) / noise
        clear = max(clear, problem.settings.notable_share * explained)
    return (calibrated, curve) if loss < cost + clear else None


def _across(term: CurveTerm, problem: Problem) -> float:
    """What -2 log evidence is charged for a curve that does not move the axis on which it depends."""
    return problem.settings.cross_axis_penalty if _moves_another(term) else 0.0


def _moves_another(term: CurveTerm) -> bool:
    """Whether what a curve moves is another axis than that on which it depends, or the table. The clock is no axis."""
    return term.axis not in ("", term.moves)
