"""What is missing from a machine's model, from ball-bar tests and axis logs of one campaign.

The ball bar is diagnosed first. What it cannot tell apart is fitted to the logs, each explanation with what the ball
bar knows of the drive as its priors: the sum of both log evidences is that of both instruments, and it decides.
Then the logs are searched for what the ball bar cannot see. Causes that they find enter the machine, and the ball bar
is diagnosed again with them.
"""

from __future__ import annotations

from dataclasses import replace

from mjsim.campaign.model import Campaign
from mjsim.commands.axis_log.compare import checked_logs, compare_logs
from mjsim.commands.axis_log.diagnose import diagnose_logs, exists
from mjsim.commands.axis_log.diagnosis import LogDiagnosis
from mjsim.commands.axis_log.judge import Judge, Judged
from mjsim.commands.axis_log.numbers import parameter_intervals
from mjsim.commands.ball_bar.compare import compare_bars
from mjsim.commands.ball_bar.diagnose import diagnose_bars
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.finding import BOTH, DiagnosedEffect
from mjsim.inference.axis_logs.shared import MOTOR_SIDE
from mjsim.inference.outcome import verdict_of
from mjsim.inference.search import LEAST
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread


@one_blas_thread
def diagnose_jointly(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None = None,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Diagnosis:
    """Find what is missing from the model of a machine, with both instruments.

    Args:
        campaign: With at least one measured ball-bar test and one recorded log.
        machine: As given.
        max_effects: At most so many different effects; without it as many as the data prove.
        threads: Tests that are worked on side by side.
        progress: Called as work gets on.
        settings: What decides.

    Raises:
        InputError: An instrument has no data, or they show a mistake.
    """
    recorded, bars = checked_logs(campaign, machine), campaign.in_motion
    given = diagnose_bars(bars, machine, max_effects, threads, progress, settings)
    judge = Judge(recorded, machine, threads)
    judged = judge.of(given, {})
    logs = diagnose_logs(recorded, judged.machine, max_effects, threads, progress, judged.shared(judge.axes))
    bar = given
    if logs.effects:  # with what the logs have found, the ball bar is looked at again
        known = machine
        for e in logs.effects:
            known = known.with_effect(e.effect)
        bar = diagnose_bars(bars, known, max_effects, threads, progress, settings)
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
    final = logs.machine
    found = [_of_bar(e, judged, logs) for e in bar.effects]
    names = {e.effect.id for e in found}
    found += [replace(e, decided_by=e.found_by) for e in logs.effects if e.effect.id not in names]
    progress("simulating the machine that both instruments support", 0, 1)
    after = compare_bars(campaign, final, threads, progress) if final != bar.machine else bar.after
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
    by = LogTest.instrument if by_log else BallBarTest.instrument
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
    competitors = {} if decision is None else {BallBarTest.instrument: decision.bar, LogTest.instrument: decision.logs}
    whole = None if e.probability is None else e.probability + sum(e.others.values())
    told = e.others if decision is None else {i.split("[")[0]: (whole or 0.0) * p for i, p in decision.told.items()}
    return replace(
        e,
        probability=None if whole is None else whole - sum(told.values()),
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
