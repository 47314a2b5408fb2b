"""The generic term that explains a residual best."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np

from mjsim.inference.criteria import THRESHOLD, VISIBLE
from mjsim.inference.fit import Fit
from mjsim.inference.generic import Generic, Term
from mjsim.inference.problem import Problem
from mjsim.inference.signatures import Projector

#: Mean squared whitened residual above which something is left for sure, so that unusual terms are tried as well.
_EXCESS = 1.08
#: By how much a term that moves another axis must be better than one of the axis itself.
_ACROSS = 20.0
#: Finer knots that are tried for the best term.
_FINER = (2, 4)


def best_term(problem: Problem, fit: Fit) -> Term | None:
    """The generic term that explains most of a fit's residual, net of its coefficients' price; ``None`` where none is worth it."""
    projector, generic = Projector(fit), Generic(problem, fit)
    excess = fit.sum_squares > _EXCESS * problem.count
    best = _best(problem, projector, itertools.chain(generic.own(), generic.clock(excess)))
    net = best.gain - best.price if best else 0.0
    if net > 0.0 or excess:
        other = _best(problem, projector, generic.across())
        if other is not None and other.gain - other.price > net + (_ACROSS if net > THRESHOLD else 0.0):
            best = other
    if best is None or best.gain - best.price < THRESHOLD:
        return None
    best = _best(problem, projector, [best, *(t for n in _FINER for t in generic.finer(best, n))])
    return best if any(np.std(p) > VISIBLE * problem.noise.rms for p in visible(problem, fit, best)) else None


def _best(problem: Problem, projector: Projector, terms: Iterable[Term]) -> Term | None:
    best: Term | None = None
    for term in terms:
        matrix, score = projector.normal(problem.whiten(term.columns))
        matrix = matrix + np.eye(len(matrix)) * (1e-6 * np.trace(matrix) / len(matrix) + 1e-9)
        inverse = np.linalg.inv(matrix)
        term.coefficients = inverse @ score
        term.gain = float(score @ term.coefficients)
        term.covariance = inverse
        if best is None or term.gain - term.price > best.gain - best.price:
            best = term
    return best


def visible(problem: Problem, fit: Fit, term: Term) -> list[np.ndarray]:
    """What of a term's readings the nuisances cannot take up: block means per test, m."""
    parts = [c @ term.coefficients for c in term.columns]
    n = len(fit.nuisance)
    taken = (fit.covariance @ (fit.design.T @ problem.whiten(parts)))[:n]
    return [d - c @ taken for d, c in zip(parts, problem.nuisance_columns(fit.readings, fit.nuisance), strict=True)]
