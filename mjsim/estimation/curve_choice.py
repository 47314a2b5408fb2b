"""The generic curve that best explains what a calibrated machine leaves, by evidence.

Small errors of a machine bend towards what they cannot explain. Which curve explains most shows only where they are
fitted together with it.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from mjsim.estimation.calibration import expected_effects
from mjsim.estimation.curve_fit import Together, fit_beside
from mjsim.estimation.curve_search import stands_out
from mjsim.estimation.curve_terms import CurveTerm, CurveTerms
from mjsim.estimation.curve_waves import radial_curves
from mjsim.estimation.fit import Fit, Fitter
from mjsim.estimation.one_curve import objective_with_findings
from mjsim.estimation.problem import Problem

#: Best curves that are tried with more knots, the factors, and most knots (assumed).
_NEAR, _FINER, _LONG = 6, (2, 4), 320


def best_curve_beside(fitter: Fitter, fit: Fit) -> CurveTerm | None:
    """The curve of largest evidence beside a model, where it is worth its number of knots and stands out of a test.

    Args:
        fitter: Of the machine.
        fit: The model without a curve.
    """
    problem = fitter.problem
    terms, weight = CurveTerms(problem, fit), max(1.0, fit.sum_squares / problem.count)

    def objective(term: CurveTerm, columns: np.ndarray) -> float:
        return Together(fit, columns, weight).objective + weight * _across(term, problem)

    rough = [(objective(term, columns), term) for term, columns in terms.whitened(radial_curves(terms))]
    rough.sort(key=lambda r: r[0])
    # what a few teeth do to the position of an axis shows with many knots only
    near = [t for i, (_, t) in enumerate(rough) if i < _NEAR or (t.variable == "position" and t.axis == t.moves)]
    finer = [t for term in near for n in _FINER if n * len(term.knots) <= _LONG for t in terms.finer(term, n)]
    rows = [*rough, *((objective(t, problem.whiten(t.columns)), t) for t in finer)]
    least, best = min(rows, key=lambda r: r[0], default=(math.inf, None))
    charge = 2.0 * math.log(max(len(rows), 1)) - 2.0 * problem.settings.curve_log_odds
    if best is None or least > fit.objective - charge:
        return None
    best.coefficients = Together(fit, problem.whiten(best.columns), weight).coefficients
    return best if stands_out(problem, fit, best) else None


def curve_instead(
    fitter: Fitter, named: Fit, beside: CurveTerm, findings: Collection[str]
) -> tuple[Fit, CurveTerm] | None:
    """The machine without findings and one curve, where the evidence is for it against findings beside a curve.

    Findings beside something unknown may be parts of it.

    Args:
        fitter: Of the machine.
        named: The model with the findings.
        beside: The curve beside it.
        findings: Their keys.
    """
    problem = fitter.problem
    calibrated = fitter.fit([c.free for c in expected_effects(fitter.machine)], start=named, fresh=False)
    curve = best_curve_beside(fitter, calibrated)
    if curve is None:
        return None
    with_findings, _, both = fit_beside(fitter, named, beside)
    _, _, single = fit_beside(fitter, calibrated, curve)
    cost = objective_with_findings(with_findings, calibrated, findings, problem.settings.log_odds)
    cost -= with_findings.objective
    # what neither explains counts as noise
    loss = (single.objective - both.objective) / max(1.0, min(single.misfit, both.misfit))
    loss += _across(curve, problem) - _across(beside, problem)
    # one cause stands where several do not do clearly better
    return (calibrated, curve) if loss < cost + problem.settings.likelihood_ratio else None


def _across(term: CurveTerm, problem: Problem) -> float:
    """What -2 log evidence is charged for a curve that does not move the axis on which it depends."""
    return 0.0 if term.axis == term.moves else problem.settings.cross_axis_penalty
