"""Which physical effects are missing from a machine's model, with honest confidence."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mjsim.axislog.measurement import Logs
from mjsim.ballbar.measurement import BallBarTest
from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.estimation.calibration import expected_effects
from mjsim.estimation.combinations import Combination, combinations
from mjsim.estimation.competing import CompetingModel
from mjsim.estimation.curve_fit import fit_beside
from mjsim.estimation.curve_search import best_curve_term
from mjsim.estimation.curve_terms import CurveTerm
from mjsim.estimation.disturbances import readmitted
from mjsim.estimation.fit import Fitter, with_effects
from mjsim.estimation.joint_selection import JointSelection, JointSelector
from mjsim.estimation.lines import Line
from mjsim.estimation.mistakes.checked_problem import checked_problem
from mjsim.estimation.one_curve import in_place_of_both_directions
from mjsim.estimation.planning.next_test import plan_for
from mjsim.estimation.posterior import Posterior
from mjsim.estimation.problem import Problem
from mjsim.estimation.selection import ModelSelection, Selection
from mjsim.estimation.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.estimation.shares import Calibration, calibrations
from mjsim.estimation.signatures import Projector
from mjsim.estimation.testability import not_testable
from mjsim.estimation.unexplained import Unexplained, describe, find_unexplained
from mjsim.estimation.verdicts import stands
from mjsim.estimation.vibration import Separated, is_news, phased_at, separate
from mjsim.estimation.visibility import clear_tests
from mjsim.io.cache import remembered
from mjsim.machine.model import Machine, build
from mjsim.progress import Progress, silent
from mjsim.simulation.readings import readings_of
from mjsim.threads import one_blas_thread
from mjsim.workflow.compare import Comparison, overlay
from mjsim.workflow.diagnosis import DiagnosedEffect, Diagnosis

#: Most findings that get a rung of the ladder of their own; smaller ones share the last.
_RUNGS = 3


@one_blas_thread
def diagnose(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None = None,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Diagnosis:
    """Find what is missing.

    The search runs on the drives' motions; every error that is reported comes from the full multibody simulation.

    Args:
        campaign: With at least one measured test.
        machine: As given.
        max_effects: At most so many different effects; without it as many as the data prove.
        threads: Tests that are worked on side by side.
        progress: Called as work gets on.
        settings: What decides.

    Raises:
        InputError: no measured test, or the traces show a mistake (:mod:`mjsim.estimation.mistakes`).
    """
    if not campaign.measured:
        raise InputError(f"{campaign.folder / 'campaign.toml'}: no test has a trace; a diagnosis needs measured tests")
    return remembered(
        "diagnoses",
        lambda: (replace(campaign, logs=Logs()), machine, max_effects, settings),
        lambda: _diagnose(campaign, machine, max_effects, threads, progress, settings),
    )


def _diagnose(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None,
    threads: int,
    progress: Progress,
    settings: DiagnosisSettings,
) -> Diagnosis:
    """The diagnosis itself, whatever the cache has."""
    progress("preparing", 0, 1)
    separated = separate(checked_problem(campaign, build(machine), threads, settings=settings), machine)
    explained = select_model(separated, max_effects, progress)
    data, selection, unexplained = explained.data, explained.selection, explained.unexplained
    hidden = not_testable(data, Projector(selection.start), selection.bank)
    selection.bank.forget()  # the simulations need the room
    found = sorted(
        [*_found(data, selection), *(_vibration(data, line) for line in separated.lines if is_news(line, machine))],
        key=lambda f: -f[0],
    )
    problem = data.restored()

    def simulated(m: Machine, stage: str, begin: np.ndarray | None = None) -> Comparison:
        count = [0]

        def done(_: BallBarTest) -> None:
            count[0] += 1
            progress(stage, count[0], len(problem.tests))

        return overlay(problem, m, readings_of(m, problem.tests, threads, done), begin)

    given, begin = phased_at(problem, machine)
    before = simulated(given, "simulating the machine as given", begin)
    expected = with_effects(machine, [c.effect.effect for c in explained.calibration])
    ladder = [before]
    if explained.calibration and found:
        calibrated, begin = phased_at(problem, expected)
        ladder = [simulated(calibrated, "simulating the calibrated machine", begin)]
    for i in range(1, min(len(found), _RUNGS)):
        part, begin = phased_at(problem, with_effects(expected, [e.effect for _, e in found[:i]]))
        ladder.append(simulated(part, f"simulating with {i} effect{'s' if i > 1 else ''}", begin))
    # the triggers have moved since the vibrations were found, and their phases with them
    final = with_effects(selection.fit.machine, [line.effect for line in separated.lines])
    final, begin = phased_at(problem, final, list(selection.fit.readings), selection.fit.nuisance)
    after = simulated(final, "simulating the fitted machine", begin)
    last = len(ladder) - 1
    ladder += [after] * max(1, len(found) - last)
    effects = tuple(
        replace(e, rms_before=ladder[min(i, last)].rms, rms_after=ladder[i + 1].rms) for i, (_, e) in enumerate(found)
    )
    if effects:
        verdict = "ambiguous" if any(e.alternatives for e in effects) else "identified"
    else:
        verdict = "unknown" if unexplained else "nothing_found"
    following = plan_for(problem, selection, threads, progress, hidden=False)
    named = {e.effect.id for e in effects} | {a for e in effects for a in e.alternatives}
    return Diagnosis(
        campaign,
        verdict,
        problem.noise.rms,
        effects,
        unexplained,
        tuple(h for h in hidden if h not in named),
        final,
        before,
        after,
        tuple(ladder),
        next_test=following.to_json() if following else None,
        trail=selection.trail,
        calibration=explained.calibration,
        shares=explained.shares,
        combinations=explained.combinations,
        posterior=Posterior.of(selection.fit),
    )


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
    problem = separated.problem
    fitter = Fitter(problem, separated.machine)
    if separated.machine.tolerance:
        return _explain_jointly(problem, fitter, progress)
    selection = ModelSelection(fitter, progress).run(max_effects)
    if selection.complete:
        return _explain_with_few(problem, fitter, selection, progress)
    alone = _explain_by_curve(problem, selection, progress)
    if alone is not None and _left(alone) ** 2 < problem.settings.joint_fit:
        return alone
    joint = _explain_jointly(problem, fitter, progress)
    if _left(joint) ** 2 < problem.settings.joint_fit:
        return joint
    # neither a few causes nor a machine that is a little wrong everywhere: most likely the cause is in no catalogue
    selection = ModelSelection(fitter, progress).run(problem.settings.most_effects)
    few = _explain_with_few(problem, fitter, selection, progress)
    return joint if _left(joint) < problem.settings.clearly_less * _left(few) else few


def _left(explained: Explained) -> float:
    """RMS that an explanation leaves, with the curve beside it where there is one, in units of the noise."""
    if explained.unexplained is not None:
        return explained.unexplained.left / explained.data.noise.rms
    return float(np.sqrt(explained.selection.fit.sum_squares / explained.data.count))


def _explain_by_curve(problem: Problem, selection: Selection, progress: Progress) -> Explained | None:
    """The machine as given with one generic curve, where there is one: a single cause that is in no catalogue."""
    progress("looking for one cause outside the catalogue", 0, 1)
    curve = best_curve_term(problem, selection.start)
    if curve is None:
        return None
    selection = replace(selection, fit=selection.start, found=[])
    return Explained(problem, selection, describe(problem, selection.start, curve))


def _explain_with_few(problem: Problem, fitter: Fitter, selection: Selection, progress: Progress) -> Explained:
    """What a few effects explain, and what is left beside them."""
    varying = in_place_of_both_directions(fitter, selection.fit, [f.key for f in selection.found])
    if varying is None:
        unexplained, selection = find_unexplained(problem, selection, progress)
    else:
        fit, curve, replaced = varying
        selection = replace(selection, fit=fit, found=[f for f in selection.found if f.key not in replaced])
        unexplained = describe(problem, fit, curve, together=True)
    if selection.found:
        data = readmitted(problem, selection.fit.readings, selection.fit.nuisance)
        if data is not problem:
            refitted = fitter.with_problem(data).fit(selection.fit.effects, start=selection.fit)
            return Explained(data, replace(selection, fit=refitted), unexplained)
    return Explained(problem, selection, unexplained)


def _explain_jointly(problem: Problem, fitter: Fitter, progress: Progress) -> Explained:
    """The same with everything that a machine may have calibrated at once: findings lie beyond its tolerance, or are
    proven where none is stated.
    """
    joint = JointSelector(fitter, progress).run()
    problem, fit = joint.problem, joint.selection.fit
    fitter = fitter.with_problem(problem)
    rest = joint.curve if joint.alone else None
    varying = in_place_of_both_directions(fitter, fit, [f.key for f in joint.selection.found])
    if varying is not None:
        beside, rest, replaced = varying
        fit = fitter.fit(beside.effects, start=beside, iterations=0, fresh=False)
        found = [f for f in joint.selection.found if f.key not in replaced]
        joint = replace(joint, selection=replace(joint.selection, fit=fit, found=found))
    if rest is None and (joint.curve is not None or fit.sum_squares > problem.settings.joint_fit * problem.count):
        rest = best_curve_term(problem, fit)
    if rest is not None:
        progress("fitting beside what is not in the catalogue", 0, 1)
        joint, rest = _beside_unknown(problem, fitter, joint, rest)
        fit = joint.selection.fit
    progress("shares of the error", 0, 1)
    entries, shares = calibrations(problem, fit, joint.calibrated)
    explained = joint.selection.start.sum_squares - fit.sum_squares
    found = [replace(f, gain=shares.get(f.key, 0.0) * explained) for f in joint.selection.found]
    selection = replace(joint.selection, found=sorted(found, key=lambda f: -f.gain))
    unexplained = describe(problem, fit, rest, together=True) if rest else None
    return Explained(problem, selection, unexplained, entries, shares, combinations(fit, problem.settings))


def _beside_unknown(
    problem: Problem, fitter: Fitter, joint: JointSelection, rest: CurveTerm
) -> tuple[JointSelection, CurveTerm]:
    """The outcome fitted together with a curve, and without the findings that do not stand beside it."""
    fit, curve, _ = fit_beside(fitter, joint.selection.fit, rest)
    expected = {c.key: c for c in expected_effects(fitter.machine)}
    misfit = (describe(problem, fit, curve, together=True).left / problem.noise.rms) ** 2
    found = [f for f in joint.selection.found if stands(fit, f.key, expected, misfit, problem.settings.joint_fit)]
    if len(found) < len(joint.selection.found):
        keys = {f.key for f in found}
        calibrated = tuple(c for key, c in expected.items() if key not in keys)
        effects = [f for f in fit.effects if f.effect.key in keys]
        start = fitter.fit([*effects, *(c.free for c in calibrated)], start=joint.selection.fit, fresh=False)
        fit, curve, _ = fit_beside(fitter, start, best_curve_term(problem, start) or rest)
        joint = replace(joint, calibrated=calibrated)
    return replace(joint, selection=replace(joint.selection, fit=fit, found=found)), curve


def _found(problem: Problem, selection: Selection) -> list[tuple[float, DiagnosedEffect]]:
    """Gain and entry of every effect of the search; errors are filled in by the full simulation."""
    out = []
    for f in selection.found:
        at = next(j for j, g in enumerate(selection.fit.effects) if g.effect.key == f.key)
        free = selection.fit.effects[at]
        ci = free.interval(free.vector, selection.fit.covariance_of(free))
        where = clear_tests(problem, selection.fit, f.key)
        found = DiagnosedEffect(free.effect, free.names, ci, 0.0, 0.0, f.alternatives, where, f.gain, f.rejected)
        models = [CompetingModel.of(i, fit) for i, fit in ((f.key, selection.fit), *f.competing.items())]
        out.append((f.gain, replace(found, models=tuple(models))))
    return out


def _vibration(problem: Problem, line: Line) -> tuple[float, DiagnosedEffect]:
    i, size = problem.chain.index(line.effect.subject), line.effect.si("amplitude_um")
    spread = [size * np.sqrt(np.mean(s.axes[:, i] ** 2) / 2) for s in problem.sensitivity]
    tests = tuple(
        t.name
        for t, x in zip(problem.tests, spread, strict=True)
        if x > problem.settings.visible_share * problem.noise.rms
    )
    return line.gain, DiagnosedEffect(
        line.effect, line.effect.search.free, line.ci95, 0.0, 0.0, line.alternatives, tests, line.gain
    )
