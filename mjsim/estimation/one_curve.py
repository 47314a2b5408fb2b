"""One cause that is in no catalogue, against several named effects that imitate it.

A few tests leave the catalogue much room. An axis whose play changes with its position looks like a pitch error in one
direction, and what that does not fit goes into locations and straightness. One generic curve of that axis explains the
same with a single cause.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from mjsim.estimation.calibration import Calibrated
from mjsim.estimation.candidate_groups import ORDERS, own_groups
from mjsim.estimation.curve_fit import Together, fit_beside
from mjsim.estimation.curve_search import stands_out
from mjsim.estimation.curve_terms import CurveTerm, CurveTerms
from mjsim.estimation.curve_waves import free_curve, waves
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fit, Fitter
from mjsim.estimation.signatures import seeds

#: Fewest effects that a free curve may stand for.
FEWEST = 2
#: Curves that are fitted, and Gauss-Newton steps with each: the model without the effects may be far off.
_TRIED, _STEPS = 2, 4
#: Share of what a curve must explain that the linear problem has to promise for it to be fitted (assumed): the model
#: without the effects may be far from the data.
_PROMISED = 0.95
#: Share of what an effect of both directions explains that one curve must explain to take its place (assumed).
_AS_MUCH = 0.98


def one_curve(fitter: Fitter, calibrated: Fit, named: Fit, findings: Collection[str]) -> tuple[Fit, CurveTerm] | None:
    """The model with one curve in place of all findings, where the evidence is for it; otherwise ``None``.

    Args:
        fitter: Of the machine.
        calibrated: The model without findings.
        named: The model with them.
        findings: Their keys.
    """
    problem, terms = fitter.problem, CurveTerms(fitter.problem, named)
    # where what a machine may have explains everything, no curve is needed either
    named_objective = objective_with_findings(named, calibrated, findings, problem.settings.log_odds)
    ranked: list[tuple[float, CurveTerm]] = []
    tried = 0
    # one effect is not doubted for a free curve, which can bend as it likes
    for term, columns in terms.whitened(waves(terms), free=len(findings) >= FEWEST):
        tried += 1
        ranked.append((Together(calibrated, columns).objective, term))
        ranked = sorted(ranked, key=lambda r: r[0])[:_TRIED]  # a curve's columns fill several MB
    charge = 2.0 * math.log(max(tried, 1)) - 2.0 * problem.settings.curve_log_odds
    least = min(calibrated.objective, named_objective) - charge
    promised = calibrated.objective - _PROMISED * (calibrated.objective - least)
    fitted = [fit_beside(fitter, calibrated, term, _STEPS) for objective, term in ranked if objective < promised]

    def is_better(fit: Fit, curve: CurveTerm, together: Together) -> bool:
        if together.objective >= least or not stands_out(problem, fit, curve):
            return False
        # a curve that does as much beside the findings stands for something else than they do
        beside = Together(named, problem.whiten(curve.columns)).objective - named.objective
        return together.objective < named_objective + beside

    better = [row for row in fitted if is_better(*row)]
    if not better:
        return None
    fit, curve, _ = min(better, key=lambda row: row[2].objective)
    fit = fitter.fit(fit.effects, start=fit, iterations=0, fresh=False)
    if curve.order:  # the wave has decided: all that such a cause does shows in the free curve
        fit, curve, _ = fit_beside(fitter, fit, free_curve(CurveTerms(problem, fit), curve))
        fit = fitter.fit(fit.effects, start=fit, iterations=0, fresh=False)
    return fit, curve


def objective_with_findings(named: Fit, calibrated: Fit, findings: Collection[str], log_odds: float) -> float:
    """-2 log evidence of a model with its findings, but for what it shares with the model without them."""
    out = named.objective
    held = {f.effect.key: f for f in calibrated.effects}
    seeded = Counter(c.id for c in seeds(named.base))
    for f in named.effects:
        if f.effect.key not in findings:
            continue
        variance, other = np.diag(named.covariance_of(f)), held.get(f.effect.key)
        for wave, entries in own_groups(f):
            out -= 2.0 * (log_odds - math.log(_forms(f, wave, other, seeded)))
            # a prior as wide as the size that was found costs this much
            out += float(np.log1p((f.vector - f.off)[entries] ** 2 / variance[entries]).sum())
        if other is not None and other.prior is not None and len(other.vector) == len(f.vector):
            # the other model has the effect as well, and pays for it by its tolerance
            out -= float(np.log1p(other.prior[1] ** 2 / variance).sum())
    return out


def _forms(f: EffectVector, wave: int | None, other: EffectVector | None, seeded: Mapping[str, int]) -> int:
    """Of how many forms of an effect, or of a pitch error's ``wave``, the selection has chosen this one: the form that
    it has as ``other`` in the model without findings was not chosen, and the places of a curve are charged alike.
    """
    if wave is not None:
        expected = [round(row[0]) for row in other.effect.values["components"]] if other else []
        return 1 if round(f.effect.values["components"][wave][0]) in expected else ORDERS
    if other is not None and other.effect.values.get("order") == f.effect.values.get("order"):
        return 1
    return max(seeded[f.effect.id], 1)


def in_place_of_both_directions(
    fitter: Fitter, fit: Fit, findings: Collection[str], usual: Collection[Calibrated] = ()
) -> tuple[Fit, CurveTerm, set[str]] | None:
    """The model with one curve in place of an effect that it has once per direction of motion, or once for both and
    once for one of them; otherwise ``None``.

    Two flanks that differ leave a part that both directions share. Where there is next to none, what they do is equal
    and opposite: an axis whose play changes with its position, which is one cause and in no catalogue.

    Args:
        fitter: Of the machine.
        fit: The model with its effects.
        findings: Keys of the findings. The second effect may be within its tolerance.
        usual: Effects that a machine of its class has: they go back to the waves that are usual.

    Returns:
        The model without the two effects, the curve fitted beside it, and the keys of the two.
    """
    problem = fitter.problem
    for a, b in combinations([f.effect for f in fit.effects], 2):
        pair = {a.key, b.key}
        if a.id != b.id or not (a.direction_sign or b.direction_sign) or pair.isdisjoint(findings):
            continue
        others = [f for f in fit.effects if f.effect.key not in pair]
        without = fitter.fit([*others, *(c.free for c in usual if c.key in pair)], start=fit)
        explained = without.sum_squares - fit.sum_squares
        for term in CurveTerms(problem, without).own():
            if term.axes != (a.subject,) or term.variable != "direction":
                continue
            beside, curve, together = fit_beside(fitter, without, term, _STEPS)
            gain = without.sum_squares - together.misfit * problem.count
            if gain > _AS_MUCH * explained and stands_out(problem, beside, curve):
                beside = fitter.fit(beside.effects, start=beside, iterations=0, fresh=False)
                return beside, replace(curve, gain=gain), pair
    return None
