"""The generic curve that best explains what a calibrated machine leaves, by evidence.

Small errors of a machine bend towards what they cannot explain. Which curve explains most shows only where they are
fitted together with it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection
from dataclasses import replace
from functools import partial

import numpy as np

from mjsim.estimation.calibration import expected_effects
from mjsim.estimation.curve_fit import Together, fit_beside
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
    own = next((i for i, term in enumerate(ranked) if term.axis == term.moves), 0)
    last = [term for i, term in enumerate(ranked) if i < _NEAR or i == own]
    rows = [(beside.together(term, simple=True), term) for term in last]
    explained = least - min((both.objective for both, _ in rows), default=least)
    if explained < 2.0 * math.log(max(len(ranked), 1)) - 2.0 * settings.curve_log_odds:
        return None

    def charged(both: Together, term: CurveTerm) -> float:
        if term.axis == term.moves:
            return both.objective
        # a curve is an approximation: near the noise, a small share of what it explains decides nothing
        share = settings.notable_share if both.misfit < settings.joint_fit else 0.0
        return both.objective + max(beside.weight * settings.cross_axis_penalty, share * explained)

    best = min(rows, key=lambda row: charged(*row))[1]
    best.coefficients = beside.together(best).coefficients
    return (fit, best) if stands_out(problem, fit, best) else None


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

    def __init__(self, problem: Problem, fit: Fit) -> None:
        self.problem, self.fit = problem, fit
        self.weight = max(1.0, fit.sum_squares / problem.count)

    def together(self, term: CurveTerm, simple: bool = False) -> Together:
        """Model and curve, where the curve is free, or has the simplest shape that the data allow."""
        shape = partial(simplest_shape, closed=term.period is not None) if simple else free_shape
        return Together(self.fit, self.problem.whiten(term.columns), self.weight, shape)

    def objective(self, term: CurveTerm, simple: bool = False) -> float:
        """-2 log evidence of model and curve, but for what all have in common."""
        return self.together(term, simple).objective

    def ranked(self) -> list[CurveTerm]:
        """All curves that reach a reading, the best free one first, and those worth a look with more knots as well."""
        terms = CurveTerms(self.problem, self.fit)
        periodic = (term for term in terms.clock(waves=True) if term.period)
        all_terms = [term for term, _ in terms.whitened(itertools.chain(radial_curves(terms), periodic))]
        rows = sorted(((self.objective(t), t) for t in all_terms), key=lambda r: r[0])
        # what a few teeth do to the position of an axis shows with many knots only
        near = [t for i, (_, t) in enumerate(rows) if i < _NEAR or (t.variable == "position" and t.axis == t.moves)]
        finer = [t for term in near for n in _FINER if n * len(term.knots) <= _LONG for t in terms.finer(term, n)]
        return [t for _, t in sorted([*rows, *((self.objective(t), t) for t in finer)], key=lambda r: r[0])]


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
    return 0.0 if term.axis == term.moves else problem.settings.cross_axis_penalty
