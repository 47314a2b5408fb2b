"""The generic term that explains a residual best."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np

from mjsim.estimation.criteria import parameter_count, penalised_objective
from mjsim.estimation.curve_terms import CurveTerm, CurveTerms
from mjsim.estimation.fit import Fit
from mjsim.estimation.least_squares import ridge_solution
from mjsim.estimation.problem import Problem
from mjsim.estimation.signatures import Projector
from mjsim.estimation.visibility import unabsorbed

#: Factors by which the best term's knots are made finer, up to this number of knots.
_FINER, _LONG = (2, 4), 300


def best_curve_term(problem: Problem, fit: Fit) -> CurveTerm | None:
    """The generic term that explains most of a fit's residual, net of its coefficients' penalty; ``None`` where none is
    worth it.
    """
    projector, generic = Projector(fit), CurveTerms(problem, fit)
    settings = problem.settings
    excess = fit.sum_squares > settings.excess * problem.count
    best = _best(problem, projector, itertools.chain(generic.own(), generic.clock(excess)))
    net = best.gain - best.chance_gain if best else 0.0
    if net > 0.0 or excess:
        other = _best(problem, projector, generic.across())
        penalty = settings.cross_axis_penalty if net > settings.likelihood_ratio else 0.0
        if other is not None and other.gain - other.chance_gain > net + penalty:
            best = other
    if best is None or best.gain - best.chance_gain < settings.likelihood_ratio:
        return None
    if len(best.knots) <= _LONG:
        best = _best(problem, projector, [best, *(t for n in _FINER for t in generic.finer(best, n))]) or best
    return best if stands_out(problem, fit, best) else None


def _best(problem: Problem, projector: Projector, terms: Iterable[CurveTerm]) -> CurveTerm | None:
    best: CurveTerm | None = None
    for term in terms:
        matrix, score = projector.normal(problem.whiten_curve(term.columns))
        term.precision = matrix + np.eye(len(matrix)) * (1e-6 * np.trace(matrix) / len(matrix) + 1e-9)
        term.coefficients = ridge_solution(term.precision, score, 0.0)
        term.gain = float(score @ term.coefficients)
        if best is None or term.gain - term.chance_gain > best.gain - best.chance_gain:
            best = term
    return best


def visible(problem: Problem, fit: Fit, term: CurveTerm) -> list[np.ndarray]:
    """What of a term's readings the nuisances cannot take up: block means per test, m."""
    return unabsorbed(problem, fit, [c @ term.coefficients for c in term.columns])


def stands_out(problem: Problem, fit: Fit, term: CurveTerm) -> bool:
    """Whether what a term explains is seen in a test."""
    return any(np.std(p) > problem.settings.visible_share * problem.noise.rms for p in visible(problem, fit, term))


def is_overfit(problem: Problem, start: Fit, fit: Fit, curve: CurveTerm | None, first_gain: float) -> bool:
    """Whether the named effects of ``fit`` only imitate one cause that is not in the catalogue.

    Either one generic curve explains more than all of them, or they are many, leave something, and the curve explains
    most of it and clearly more than the first of them did (an effect that is real explains as much as the generic curve
    that it looks like).

    Args:
        problem: The measured tests.
        start: The model without the effects.
        fit: The model with them.
        curve: The generic curve that explains most of what ``start`` leaves.
        first_gain: What the first of the effects explained.
    """
    if curve is None:
        return False
    settings = problem.settings
    named = penalised_objective(start, settings) - penalised_objective(fit, settings)
    net = curve.gain - curve.chance_gain
    if net > named + settings.likelihood_ratio:
        return True
    left = fit.sum_squares > settings.complete_fit * problem.count
    many = parameter_count(fit) >= settings.overfit_many
    return left and many and net > settings.overfit_share * named and net > settings.overfit_gain * first_gain
