"""Which kind of model explains the data: a few causes, many small errors together, or one that is in no catalogue."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

from mjsim.estimation.calibration import Calibrated, expected_effects
from mjsim.estimation.combinations import Combination, combinations
from mjsim.estimation.curve_choice import best_curve_again, best_curve_beside, curve_instead
from mjsim.estimation.curve_fit import fit_beside, fit_beside_simple
from mjsim.estimation.curve_search import best_curve_term
from mjsim.estimation.curve_terms import CurveTerm
from mjsim.estimation.disturbances import readmitted
from mjsim.estimation.fit import Fitter
from mjsim.estimation.joint_selection import JointSelector
from mjsim.estimation.local_waves import in_place_of_many_waves
from mjsim.estimation.one_curve import in_place_of_both_directions, one_curve
from mjsim.estimation.outcome import Selection
from mjsim.estimation.problem import Problem
from mjsim.estimation.selection import ModelSelection
from mjsim.estimation.shares import Calibration, calibrations
from mjsim.estimation.unexplained import Unexplained, describe, find_unexplained
from mjsim.estimation.verdicts import stands
from mjsim.estimation.vibration import Separated
from mjsim.progress import Progress, silent

#: One curve that leaves so many times what explains everything is not fitted: its machine has many causes (assumed).
_HOPELESS = 20.0


@dataclass(frozen=True)
class Explained:
    """Outcome of the model selection: the data that it ends on, the model, what is left, and what was calibrated."""

    data: Problem
    selection: Selection
    unexplained: Unexplained | None
    calibration: tuple[Calibration, ...] = ()
    shares: dict[str, float] = field(default_factory=dict)
    combinations: tuple[Combination, ...] = ()


def select_model(separated: Separated, max_effects: int | None = None, progress: Progress = silent) -> Explained:
    """The model selection on data without vibrations.

    Where the machine file states a tolerance, all effects are judged together. Where it states none, a few effects are
    tried first: what they explain down to the noise needs no others.
    """
    fitter = Fitter(separated.problem, separated.machine)
    if separated.machine.tolerance:
        return _explain_jointly(fitter, progress)
    fitter, selection = ModelSelection(fitter, progress).run(max_effects)
    problem = fitter.problem
    if selection.complete:
        return explain_with_few(fitter, selection, progress)
    alone = _explain_by_curve(fitter, selection, progress)
    if alone is not None and _left(alone) ** 2 < problem.settings.joint_fit:
        return alone
    joint = _explain_jointly(fitter, progress)
    if _left(joint) ** 2 < problem.settings.joint_fit:
        return by_few_alone(fitter, joint, progress) or joint
    # neither a few causes nor a machine that is a little wrong everywhere: most likely the cause is in no catalogue
    named = explain_with_few(*ModelSelection(fitter, progress).run(problem.settings.most_effects), progress)
    return joint if _left(joint) < problem.settings.clearly_less * _left(named) else named


def by_few_alone(fitter: Fitter, joint: Explained, progress: Progress = silent) -> Explained | None:
    """The few effects that explain all the data on a machine that is otherwise as given, where many small errors name
    no more than a few.
    """
    few = fitter.problem.settings.few_effects
    if joint.unexplained is not None or len(joint.selection.found) > few:
        return None
    named = explain_with_few(*ModelSelection(fitter, progress).run(few), progress)
    complete = _left(named) ** 2 < fitter.problem.settings.complete_fit
    return named if complete and named.unexplained is None else None


def _left(explained: Explained) -> float:
    """RMS that an explanation leaves, with the curve beside it where there is one, in units of the noise."""
    if explained.unexplained is not None:
        return explained.unexplained.left / explained.data.noise.rms
    return float(np.sqrt(explained.selection.fit.sum_squares / explained.data.count))


def _explain_by_curve(fitter: Fitter, selection: Selection, progress: Progress) -> Explained | None:
    """The machine as given with one generic curve, where there is one: a single cause that is in no catalogue."""
    progress("looking for one cause outside the catalogue", 0, 1)
    start, problem = selection.start, fitter.problem
    curve = best_curve_term(problem, start)
    if curve is None or start.sum_squares - curve.gain > _HOPELESS * problem.settings.joint_fit * problem.count:
        return None
    selection, curve = _beside_best_curve(fitter, replace(selection, fit=start, found=[]), curve)
    return Explained(problem, selection, describe(problem, selection.fit, curve))


def explain_with_few(fitter: Fitter, selection: Selection, progress: Progress) -> Explained:
    """What a few effects explain, and what is left beside them."""
    problem = fitter.problem
    keys = [f.key for f in selection.found]
    unknown = in_place_of_both_directions(fitter, selection.fit, keys)
    if unknown is None and keys:
        progress("one cause outside the catalogue against all that was named", 0, 1)
        if (instead := one_curve(fitter, selection.start, selection.fit, keys)) is not None:
            unknown = *instead, set(keys)
    if unknown is not None:
        fit, curve, replaced = unknown
        selection = replace(selection, fit=fit, found=[f for f in selection.found if f.key not in replaced])
        selection, curve = _beside_unknown(fitter, selection, curve)
    else:
        curve, selection = find_unexplained(problem, selection, progress)
        if curve is not None:
            selection, curve = _beside_best_curve(fitter, selection, curve)
    if curve is not None:
        return Explained(problem, selection, describe(problem, selection.fit, curve))
    if selection.found:
        data = readmitted(problem, selection.fit.readings, selection.fit.nuisance)
        if data is not problem:
            refitted = fitter.with_problem(data).fit(selection.fit.effects, start=selection.fit)
            return Explained(data, replace(selection, fit=refitted), None)
    return Explained(problem, selection, None)


def _explain_jointly(fitter: Fitter, progress: Progress) -> Explained:
    """The same with everything that a machine may have calibrated at once: findings lie beyond its tolerance, or are
    proven where none is stated.
    """
    joint = JointSelector(fitter, progress).run()
    problem, fit = joint.problem, joint.selection.fit
    fitter = fitter.with_problem(problem)
    rest = joint.curve if joint.alone else None
    usual = expected_effects(fitter.machine)
    varying = in_place_of_both_directions(fitter, fit, [f.key for f in joint.selection.found], usual)
    if varying is not None:
        fit, rest, replaced = varying
        joint = joint.without(replaced, fit, usual)
    local = in_place_of_many_waves(fitter, joint) if rest is None else None
    if local is not None:
        joint, rest = local
        problem, fit = joint.problem, joint.selection.fit
        fitter = fitter.with_problem(problem)
    if rest is None and (joint.curve is not None or fit.sum_squares > problem.settings.joint_fit * problem.count):
        beside = best_curve_beside(fitter, fit)
        if beside is not None:
            fit, rest = beside
            joint = replace(joint, selection=replace(joint.selection, fit=fit))
    if rest is not None:
        progress("fitting beside what is not in the catalogue", 0, 1)
        selection, rest = _beside_unknown(fitter, joint.selection, rest, usual, sure=local is not None)
        if len(selection.found) < len(joint.selection.found):
            keys = {f.key for f in selection.found}
            joint = replace(joint, calibrated=tuple(c for c in usual if c.key not in keys))
        joint, fit = replace(joint, selection=selection), selection.fit
    progress("shares of the error", 0, 1)
    entries, shares = calibrations(problem, fit, joint.calibrated)
    explained = joint.selection.start.sum_squares - fit.sum_squares
    found = [replace(f, gain=shares.get(f.key, 0.0) * explained) for f in joint.selection.found]
    selection = replace(joint.selection, found=sorted(found, key=lambda f: -f.gain))
    unexplained = describe(problem, fit, rest) if rest else None
    return Explained(problem, selection, unexplained, entries, shares, combinations(fit, problem.settings))


def _beside_best_curve(fitter: Fitter, selection: Selection, curve: CurveTerm) -> tuple[Selection, CurveTerm]:
    """The outcome beside the curve of largest evidence, where ``curve`` has shown that there is one."""
    fit, curve = best_curve_beside(fitter, selection.fit) or (selection.fit, curve)
    return _beside_unknown(fitter, replace(selection, fit=fit), curve)


def _beside_unknown(
    fitter: Fitter, selection: Selection, rest: CurveTerm, usual: Collection[Calibrated] = (), sure: bool = False
) -> tuple[Selection, CurveTerm]:
    """The outcome fitted together with a curve, and without the findings that do not stand beside it.

    Args:
        fitter: Of the machine.
        selection: Its model was fitted without the curve.
        rest: The curve.
        usual: Effects that a machine of its class has.
        sure: Whether it is known what the curve depends on. Otherwise another one may explain more without the findings
            that go.
    """
    problem, start = fitter.problem, selection.fit
    found = selection.found
    if found:
        fit, curve, _ = fit_beside(fitter, start, rest)
        expected = {c.key: c for c in usual}
        misfit = (describe(problem, fit, curve).left / problem.noise.rms) ** 2
        found = [f for f in found if stands(fit, f.key, expected, misfit, problem.settings.joint_fit)]
        if len(found) < len(selection.found):
            keys = {f.key for f in found}
            effects = [f for f in fit.effects if f.effect.key in keys]
            calibrated = [c.free for c in usual if c.key not in keys]
            start = fitter.fit([*effects, *calibrated], start=start, fresh=False)
            start, rest = (None if sure else best_curve_beside(fitter, start)) or (start, rest)
    alone = curve_instead(fitter, start, rest, [f.key for f in found], usual) if found else None
    if alone is not None:
        start, rest = alone
        found = []
    # findings are judged beside a curve that may do anything; what all are worth, beside one with what is needed
    best = fit_beside_simple(fitter, start, rest)
    again = None if sure else best_curve_again(fitter, start, best[0])
    if again is not None:
        best = min(best, fit_beside_simple(fitter, *again), key=lambda row: row[2].left)
    fit, curve, _ = best
    return replace(selection, fit=fit, found=found), curve
