"""Which physical effects are missing from a machine's model, whatever instruments have measured it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.campaign.temperature import in_campaign
from mjsim.commands.at_rest import diagnose_at_rest
from mjsim.commands.axis_log.compare import checked_logs, compare_logs
from mjsim.commands.axis_log.diagnose import diagnose_logs, exists
from mjsim.commands.axis_log.diagnosis import LogDiagnosis
from mjsim.commands.axis_log.judge import Judge, Judged
from mjsim.commands.axis_log.numbers import parameter_intervals
from mjsim.commands.ball_bar.compare import BarComparison, compare_bars, overlay
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.finding import BOTH, DiagnosedEffect, findings_of, ladder_of
from mjsim.errors import InputError
from mjsim.inference.axis_logs.shared import MOTOR_SIDE
from mjsim.inference.findings import explain
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.outcome import Selection, verdict_of
from mjsim.inference.planning.next_test import plan_for
from mjsim.inference.posterior import CompetingModel, Posterior
from mjsim.inference.problem import Problem
from mjsim.inference.search import LEAST
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.inference.shares import clear_tests
from mjsim.inference.signatures import Projector
from mjsim.inference.testability import not_testable
from mjsim.inference.vibration import Line, is_news, phased_at, separate
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io.cache import remembered
from mjsim.machine.model import Machine, build
from mjsim.progress import Progress, counted, silent
from mjsim.simulation.multibody import Reading
from mjsim.simulation.readings import readings_of
from mjsim.simulation.stability import only_in_logs
from mjsim.threads import one_blas_thread

# -- which physical effects are missing from a machine's model, from ball-bar tests ------------------------------------


@one_blas_thread
def diagnose_bars(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None = None,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Diagnosis:
    """What is missing, by ball-bar tests; arguments as of :func:`diagnose`.

    The search runs on the drives' motions, and so do the models between the machine as given and the fitted one. The
    errors of these two come from the full multibody simulation.

    Raises:
        InputError: no measured test, or the traces show a mistake (:mod:`mjsim.inference.mistakes`).
    """
    campaign = campaign.in_motion
    campaign.need_traces("a diagnosis needs measured tests")
    return remembered(
        "diagnoses",
        lambda: (campaign, machine, max_effects, settings),
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
    separated = separate(checked_problem(campaign, machine, threads, settings=settings), machine)
    # much of the search keeps one core busy: another simulates meanwhile
    readings_as_given = separated.problem.workers.start(lambda: readings_of(machine, separated.problem.tests, 1))
    explained = explain(separated, progress, max_effects)
    data, selection, unexplained = explained.data, explained.selection, explained.unexplained
    hidden = not_testable(data, Projector(selection.start), selection.bank)
    selection.bank.forget()  # the simulations need the room
    vibrations = [_vibration(data, line) for line in separated.lines if is_news(line, machine)]
    instrument_of = {t.name: t.instrument for t in campaign.measured}
    found = [*_found(data, selection), *sorted(vibrations, key=lambda e: -e.gain)]
    found = [replace(e, found_by=instrument_of[e.tests[0]]) if e.tests else e for e in found]
    problem = data.restored()

    def simulated(m: Machine, described: str, begin: np.ndarray | None = None) -> BarComparison:
        done = counted(progress, f"simulating {described}", len(problem.tests))
        return overlay(problem, m, readings_of(m, problem.tests, threads, done), begin)

    given, begin = phased_at(problem, machine)
    stage = "the machine as given"
    progress(f"simulating {stage}", 0, 1)
    before = overlay(problem, given, readings_as_given()) if given is machine else simulated(given, stage, begin)
    # the triggers have moved since the vibrations were found, and their phases with them
    final = selection.fit.machine.with_effects(line.effect for line in separated.lines)
    final, begin = phased_at(problem, final, list(selection.fit.readings), selection.fit.nuisance)
    after = simulated(final, "the fitted machine", begin)

    def compared(m: Machine, described: str) -> BarComparison:
        progress(f"simulating {described}", 0, 1)
        phased, begin = phased_at(problem, m)
        readings = map(Reading, problem.tests, problem.readings(build(phased), every=1))
        return overlay(problem, phased, list(readings), begin)

    effects, rungs = ladder_of(found, explained.calibration, machine, (before, after), compared)
    following = plan_for(problem, selection, threads, progress, hidden=False)
    named = {e.effect.id for e in effects} | {a for e in effects for a in e.alternatives}
    return Diagnosis(
        campaign,
        explained.verdict,
        problem.noise.rms,
        effects,
        unexplained,
        tuple(h for h in hidden if h not in named),
        final,
        before,
        after,
        rungs,
        next_test=following.to_json() if following else None,
        trail=selection.trail,
        calibration=explained.calibration,
        shares=explained.shares,
        combinations=explained.combinations,
        further=explained.further,
        posterior=Posterior.of(selection.fit),
        settings=settings,
        probabilities=explained.verdicts.to_json(),
        discrepancy=explained.discrepancy,
        common=explained.common,
        louder=data.louder_places(),
        hums=separated.hums,
        budget=explained.budget,
    )


def _found(problem: Problem, selection: Selection) -> list[DiagnosedEffect]:
    """Every effect of the search, with the models that compete for it."""
    fit = selection.fit
    found = findings_of(selection, BallBarTest.instrument, lambda key: clear_tests(problem, fit, key))
    # between models of the same tests, log probabilities differ as log evidences do
    rows = (
        [(f.key, fit, f.probability), *((i, m, f.others[i]) for i, m in f.competing.items())] for f in selection.found
    )
    models = (tuple(CompetingModel.of(i, m, math.log(max(p, 1e-300))) for i, m, p in row) for row in rows)
    return [replace(e, models=m) for e, m in zip(found, models, strict=True)]


def _vibration(problem: Problem, line: Line) -> DiagnosedEffect:
    i, size = problem.chain.index(line.effect.subject), line.effect.si("amplitude_um")
    spread = [size * np.sqrt(np.mean(s.axes[:, i] ** 2) / 2) for s in problem.sensitivity]
    tests = tuple(
        t.name
        for t, x in zip(problem.tests, spread, strict=True)
        if x > problem.settings.visible_share * problem.noise.rms
    )
    return DiagnosedEffect(
        line.effect, line.effect.search.free, line.ci95, 0.0, 0.0, line.alternatives, tests, line.gain
    )


# -- what is missing from a machine's model, from ball-bar tests and axis logs of one campaign -------------------------
# The ball bar is diagnosed first. What it cannot tell apart is fitted to the logs, each explanation with what the ball
# bar knows of the drive as its priors: the sum of both log evidences is that of both instruments, and it decides.
# Then the logs are searched for what the ball bar cannot see. Causes that they find enter the machine, and the ball bar
# is diagnosed again with them.


@one_blas_thread
def diagnose_jointly(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None = None,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Diagnosis:
    """What is missing, by ball-bar tests and axis logs; arguments as of :func:`diagnose`.

    Raises:
        InputError: An instrument has no data, or they show a mistake.
    """
    recorded, bars = checked_logs(campaign, machine), campaign.in_motion
    given = diagnose_bars(bars, machine, max_effects, threads, progress, settings)
    judge = Judge(recorded, machine, threads)
    judged = judge.of(given, {})
    logs = diagnose_logs(recorded, judged.machine, max_effects, threads, progress, judged.known(judge.axes))
    bar = given
    if logs.effects:  # with what the logs have found, the ball bar is looked at again
        known = machine
        for e in logs.effects:
            known = known.with_effect(e.effect)
        bar = diagnose_bars(bars, simulated_in_motion(known), max_effects, threads, progress, settings)
        judged = judge.of(bar, {a: s.fit for a, s in logs.selections.items()})
        logs = judge.again(logs, judged)
    return _result(campaign, given, bar, judged, logs, threads, progress)


def _result(
    campaign: Campaign,
    given: Diagnosis,
    bar: Diagnosis,
    judged: Judged,
    logs: LogDiagnosis,
    threads: int,
    progress: Progress,
) -> Diagnosis:
    final, moving = logs.machine, simulated_in_motion(logs.machine)
    found = [_of_bar(e, judged, logs) for e in bar.effects]
    names = {e.effect.id for e in found}
    found += [replace(e, decided_by=e.found_by) for e in logs.effects if e.effect.id not in names]
    progress("simulating the machine that both instruments support", 0, 1)
    after = compare_bars(campaign, moving, threads, progress) if moving != bar.machine else bar.after
    before = compare_logs(campaign, given.before.machine, threads, progress)
    verdict = verdict_of((bool(e.alternatives) or e.contradicted for e in found), bool(bar.unexplained))
    verdict = "unknown" if logs.rest else verdict
    seen = {f"{kind}.{a}" for a in judged.axes for kind in MOTOR_SIDE if exists(f"{kind}.{a}", final)}
    named = {e.effect.id for e in found} | {a for e in found for a in e.alternatives}
    ours = {b.effect_id for b in logs.budget}
    posterior = judged.model.posterior if judged.model is not None else bar.posterior
    return replace(
        bar,
        campaign=campaign,
        verdict=verdict,
        effects=tuple(found),
        not_testable=tuple(h for h in bar.not_testable if h not in seen | named),
        machine=final,
        before=given.before,
        after=after,
        rungs=(*bar.rungs[:-1], after),
        next_test=bar.next_test if verdict == "ambiguous" else None,
        posterior=posterior.within(final) if posterior is not None else None,
        logs=replace(logs, before=before),
        budget=(*(b for b in bar.budget if b.effect_id not in ours), *logs.budget),
    )


def simulated_in_motion(machine: Machine) -> Machine:
    """A machine without the effects that only the simulation of axis logs has, such as cogging or a torque limit: tests
    in motion are simulated without them.
    """
    kept = replace(machine, effects=())
    if any(map(only_in_logs, build(kept).axes.values())):  # its file says so: that is refused elsewhere
        return machine
    for e in machine.effects:
        more = kept.with_effect(e)
        if not any(map(only_in_logs, build(more).axes.values())):
            kept = more
    return kept


def _of_bar(e: DiagnosedEffect, judged: Judged, logs: LogDiagnosis) -> DiagnosedEffect:
    """A finding of the ball bar with what the logs say of it."""
    decision = judged.decisions.get(e.effect.id)
    effect, ci, alternatives, tests = e.effect, e.ci95, e.alternatives, list(e.tests)
    excluded: tuple[str, ...] = ()
    if decision is not None:
        excluded = decision.excluded
        alternatives = tuple(m.effect_id for m in e.models if m.effect_id != decision.effect_id)
        alternatives = tuple(a.split("[")[0] for a in alternatives if a not in excluded)
        if decision.effect_id not in (effect.id, effect.key):
            model = next(m for m in e.models if m.effect_id == decision.effect_id)
            effect = model.machine.effect(decision.effect_id) or effect
            ci = model.posterior.interval_of(effect.key)
    by_log = bool(excluded)
    support = judged.support.get(effect.id)
    by = LogTest.instrument if by_log else e.found_by
    if not by_log and support is not None and support > LEAST:
        by = BOTH
    axis = logs.selections.get(effect.subject)
    if axis is not None:
        mine = parameter_intervals(axis.fit).get(effect.id)
        now = axis.fit.model.machine.effect(effect.id)
        if mine and now is not None:
            effect, ci = now, {**ci, **mine}
            if support is not None and support > LEAST:
                tests += [d.test.name for d in logs.after.tests if effect.subject in d.axes]
    competitors = {} if decision is None else {e.found_by: decision.bar, LogTest.instrument: decision.logs}
    whole = e.whole or 0.0
    told = e.others if decision is None else {i.split("[")[0]: whole * p for i, p in decision.told.items()}
    return replace(
        e,
        probability=e.probability if decision is None else whole * decision.share,
        others=told,
        effect=effect,
        free=e.free if effect.id == e.effect.id else tuple(ci),
        ci95=ci,
        alternatives=alternatives,
        tests=tuple(tests),
        decided_by=by,
        worse={who: dict(rows) for who, rows in competitors.items()},
        contradicted=support is not None and support < -LEAST,
    )


def diagnosable() -> tuple[str, ...]:
    """Instruments whose recordings a diagnosis explains: along a motion, axis logs, and all that measure at rest."""
    at_rest = (name for name, i in INSTRUMENTS.items() if i.at_rest)
    in_motion = (name for name, i in INSTRUMENTS.items() if i.in_motion)
    return (*in_motion, LogTest.instrument, *at_rest)


def diagnose(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None = None,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Diagnosis:
    """Find what is missing from the model of a machine, with all instruments that have measured it.

    Args:
        campaign: With at least one measured test.
        machine: As given.
        max_effects: At most so many different effects; without it as many as the data prove.
        threads: Simulations side by side.
        progress: Called as work gets on.
        settings: What decides.

    Raises:
        InputError: Nothing was measured, the recordings show a mistake, or there is no diagnosis for an instrument.
    """
    campaign.need_traces("a diagnosis needs measured tests")
    machine, have = in_campaign(machine, campaign), set(campaign.measured_parts)
    if unable := sorted(have - set(diagnosable())):
        raise InputError(
            f"{campaign.folder / 'campaign.toml'}: no diagnosis works with tests of the instrument {unable[0]!r}; "
            f"allowed: {', '.join(diagnosable())}"
        )
    if any(INSTRUMENTS[name].at_rest for name in have):
        others = [name for name in campaign.measured_parts if not INSTRUMENTS[name].at_rest]
        beside = None
        if others:
            beside = diagnose(campaign.of(*others), machine, max_effects, threads, progress, settings)
        return diagnose_at_rest(campaign, machine, max_effects, threads, progress, settings, beside)
    if LogTest.instrument in have and campaign.in_motion.measured:
        return diagnose_jointly(campaign, machine, max_effects, threads, progress, settings)
    if LogTest.instrument in have:
        logs = diagnose_logs(campaign, machine, max_effects, threads, progress)
        return Diagnosis(
            campaign,
            logs.verdict,
            logs.before.noise,
            logs.effects,
            None,
            logs.not_testable,
            logs.machine,
            logs.before,
            logs.after,
            logs=logs,
            settings=settings,
            budget=logs.budget,
        )
    return diagnose_bars(campaign, machine, max_effects, threads, progress, settings)
