"""The generic term that explains a residual best."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np

from mjsim.estimation.criteria import THRESHOLD, VISIBLE, parameter_count, penalised_objective
from mjsim.estimation.curve_terms import CurveTerm, CurveTerms
from mjsim.estimation.fit import Fit, unabsorbed
from mjsim.estimation.problem import Problem
from mjsim.estimation.signatures import Projector

#: Mean squared whitened residual above which something is left for sure, so that unusual terms are tried as well.
_EXCESS = 1.08
#: By how much a term that moves another axis must be better than one of the axis itself.
_ACROSS = 20.0
#: Finer knots that are tried for the best term.
_FINER = (2, 4)
_LONG = 300
#: So many parameters of named effects are suspected to overfit; mean square at which a model explains everything.
MANY, DONE = 10, 1.1
#: Share of what a pile of effects explains, and multiple of what the first of them explained, at which one generic term is the better
#: explanation although it leaves more.
_MOST_OF_IT, _BEYOND_FIRST = 0.7, 1.15


def best_curve_term(problem: Problem, fit: Fit, teeth: Iterable[str] = ()) -> CurveTerm | None:
    """The generic term that explains most of a fit's residual, net of its coefficients' penalty; ``None`` where none is worth it.

    ``teeth`` names rotary axes whose position is also looked at tooth by tooth.
    """
    projector, generic = Projector(fit), CurveTerms(problem, fit)
    excess = fit.sum_squares > _EXCESS * problem.count
    best = _best(problem, projector, itertools.chain(generic.own(), generic.clock(excess)))
    net = best.gain - best.chance_gain if best else 0.0
    if net > 0.0 or excess:
        other = _best(problem, projector, generic.across())
        if other is not None and other.gain - other.chance_gain > net + (_ACROSS if net > THRESHOLD else 0.0):
            best = other
    for axis in teeth:
        best = max((t for t in (best, _best(problem, projector, generic.fine(axis))) if t), key=lambda t: t.gain - t.chance_gain)
    if best is None or best.gain - best.chance_gain < THRESHOLD:
        return None
    if len(best.knots) <= _LONG:
        best = _best(problem, projector, [best, *(t for n in _FINER for t in generic.finer(best, n))]) or best
    return best if any(np.std(p) > VISIBLE * problem.noise.rms for p in visible(problem, fit, best)) else None


def _best(problem: Problem, projector: Projector, terms: Iterable[CurveTerm]) -> CurveTerm | None:
    best: CurveTerm | None = None
    for term in terms:
        matrix, score = projector.normal(problem.whiten(term.columns))
        matrix = matrix + np.eye(len(matrix)) * (1e-6 * np.trace(matrix) / len(matrix) + 1e-9)
        inverse = np.linalg.inv(matrix)
        term.coefficients = inverse @ score
        term.gain = float(score @ term.coefficients)
        term.covariance = inverse
        if best is None or term.gain - term.chance_gain > best.gain - best.chance_gain:
            best = term
    return best


def visible(problem: Problem, fit: Fit, term: CurveTerm) -> list[np.ndarray]:
    """What of a term's readings the nuisances cannot take up: block means per test, m."""
    return unabsorbed(problem, fit, [c @ term.coefficients for c in term.columns])


def is_overfit(problem: Problem, start: Fit, fit: Fit, best_curve: CurveTerm | None, first: float) -> bool:
    """Whether the named effects of ``fit`` only imitate one cause that is not in the catalogue.

    Either one generic term explains more than all of them, or they are many, leave something, and the term explains most of it and
    clearly more than the first of them did (an effect that is real explains as much as the generic term that it looks like).
    """
    if best_curve is None:
        return False
    named, net = penalised_objective(start) - penalised_objective(fit), best_curve.gain - best_curve.chance_gain
    if net > named + THRESHOLD:
        return True
    left = fit.sum_squares > DONE * problem.count
    return left and parameter_count(fit) >= MANY and net > _MOST_OF_IT * named and net > _BEYOND_FIRST * first
