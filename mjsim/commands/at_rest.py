"""What is missing from a machine's model, from what was measured while it stood still, alone or beside a ball bar.

With a ball bar the fit is joint: the ball-bar tests come in as the normal distribution of the numbers that they
determine, without their priors, at their best fit. So location errors and their like are those of one least-squares fit
to both instruments. Which causes of the ball bar's own there are, and between which of them it cannot decide, is
decided by the ball bar before. The values at rest add causes, and take back only what they show to be within its
class.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import chain

import numpy as np
from scipy.linalg import block_diag

from mjsim.campaign.model import Campaign
from mjsim.commands.any_instrument import compare_plainly, refuse_mistakes, together
from mjsim.commands.axis_log.diagnose import seen_by_logs
from mjsim.commands.axis_log.diagnosis import LogDiagnosis
from mjsim.commands.ball_bar.compare import compare_bars
from mjsim.commands.diagnosis import AtRest, Diagnosis
from mjsim.commands.finding import findings_of, ladder_of
from mjsim.inference.at_rest import ExplainedAtRest, RestProblem, explain_at_rest
from mjsim.inference.findings import Verdicts
from mjsim.inference.outcome import verdict_of
from mjsim.inference.posterior import CompetingModel, Posterior
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread

#: What a diagnosis with both says of itself.
_JOINT = (
    "Numbers that both instruments see are fitted to both together: the ball-bar tests enter as the normal "
    "distribution of the numbers that they determine. Causes that the ball bar has found are kept where the values at "
    "rest do not show them."
)


@one_blas_thread
def diagnose_at_rest(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None = None,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
    beside: Diagnosis | None = None,
) -> Diagnosis:
    """Find what is missing.

    Args:
        campaign: With measured tests of instruments that measure at rest, and of others where ``beside`` has their
            diagnosis.
        machine: As given.
        max_effects: At most so many different effects; without it as many as the data prove.
        threads: Simulations side by side.
        progress: Called as work gets on.
        settings: What counts as testable and as open.
        beside: What the other instruments say.

    Raises:
        InputError: The points show a mistake.
    """
    parts = {name: part for name, part in campaign.measured_parts.items() if INSTRUMENTS[name].at_rest}
    for part in parts.values():
        refuse_mistakes(part)
    points = campaign.of(*parts)
    known = beside.posterior if beside is not None and beside.has_bars else None
    found = explain_at_rest(RestProblem.of(points, settings), machine, max_effects, progress, known)
    fit, misfit = found.selection.fit, found.verdicts.unknown
    final = (beside.machine if beside is not None else machine).with_effects(
        f.effect for f in fit.effects if not f.effect.is_neutral
    )
    progress("comparing", 0, 1)
    set_up = _set_up(found)
    rests = []
    for name, part in parts.items():
        before, after = compare_plainly(part, machine), compare_plainly(part, final)
        setups = {f"{t.setup}: " for t in part.measured}
        mine = {k: v for k, v in set_up.items() if any(k.startswith(s) for s in setups) or k in _shared(part)}
        rests.append(
            AtRest(
                before,
                after,
                before.noise,
                part.instrument.source,
                found.discrepancy,
                misfit,
                mine,
                INSTRUMENTS[name].by_itself(part.measured, part.traces),
                _JOINT if known is not None else "",
            )
        )
    before = together(points, machine, [r.before for r in rests])
    after = together(points, final, [r.after for r in rests])
    of_test = {t.name: t.instrument for t in points.measured}
    rows = findings_of(found.selection, points.measured[0].instrument, lambda key: found.tests[key])
    findings = []
    for e, f in zip(rows, found.selection.found, strict=True):
        models = tuple(CompetingModel.of(i, m) for i, m in ((f.key, fit), *f.competing.items()))
        findings.append(replace(e, found_by=of_test[e.tests[0]], models=models))
    effects, rungs = ladder_of(
        findings,
        found.calibration,
        machine,
        (before, after),
        lambda m, _: together(points, m, [compare_plainly(part, m) for part in parts.values()]),
    )
    alone = Diagnosis(
        campaign,
        found.verdict,
        before.noise,
        effects,
        None,
        found.hidden,
        final,
        before,
        after,
        rungs,
        calibration=found.calibration,
        shares=found.shares,
        combinations=found.combinations,
        posterior=Posterior.of(fit),
        settings=settings,
        probabilities=found.verdicts.to_json(),
        discrepancy=found.discrepancy,
        at_rest=tuple(rests),
        budget=found.budget,
    )
    if beside is None:
        return alone
    ours = {b.effect_id for b in found.budget}
    budget = (*(b for b in beside.budget if b.effect_id not in ours), *found.budget)
    return replace(_joined(alone, beside, found, threads, progress), budget=budget)


def _shared(part: Campaign) -> set[str]:
    """Names of the numbers of an instrument itself."""
    instrument, out = INSTRUMENTS[part.tests[0].instrument], set()
    for t in part.measured:
        recording = part.traces[t.name]
        time = instrument.observe(t, recording).time
        out |= set(instrument.nuisances_of(t, recording, time, part.instrument).shared)
    return out


def _set_up(found: ExplainedAtRest) -> dict[str, tuple[float, tuple[float, float]]]:
    """Fitted numbers of set-ups and probe with their 95 % intervals, by set-up and name."""
    fit, problem, out = found.selection.fit, found.data, {}
    spread = np.sqrt(np.diag(fit.covariance)[: problem.nuisances.size]) * problem.units
    value = fit.nuisance * problem.units
    for block in problem.nuisances.blocks:
        for label in block.labels:
            at = problem.nuisances.place(block.name, label)
            name = label if not block.name.startswith("set-up ") else f"{block.name.removeprefix('set-up ')}: {label}"
            half = 1.96 * float(spread[at])
            out[name] = float(value[at]), (float(value[at]) - half, float(value[at]) + half)
    return out


def _joined(alone: Diagnosis, beside: Diagnosis, found: ExplainedAtRest, threads: int, progress: Progress) -> Diagnosis:
    """The diagnosis of other instruments with what the values at rest have changed and added.

    Args:
        alone: Of the values at rest.
        beside: Of the other instruments.
        found: In the values at rest.
        threads: Simulations side by side.
        progress: Called as work gets on.
    """
    fit, misfit, campaign = found.selection.fit, found.verdicts.unknown, alone.campaign
    of_key = {f.effect.key: f for f in fit.effects}
    ours = set(of_key) - found.unresolved  # of which the values at rest may say that they are within their class
    old = {e.effect.key: e for e in beside.effects}
    named = []
    for e in (e for e in beside.effects if e.effect.key not in ours):
        f = of_key.get(e.effect.key)
        both = {} if f is None else {"effect": f.effect, "ci95": f.interval(f.vector, fit.covariance_of(f))}
        named.append(replace(e, **both))
    for e in alone.effects:
        same = old.get(e.effect.key)
        if same is None:
            named.append(e)
            continue
        own = {"effect": e.effect, "free": e.free, "ci95": e.ci95, "tests": (*same.tests, *e.tests)}
        named.append(replace(same, **own, probability=e.probability if not same.alternatives else same.probability))
    keys = {e.effect.key for e in named}
    calibration = [c for c in beside.calibration if c.effect.effect.key not in of_key]
    calibration += [c for c in found.calibration if c.effect.effect.key not in keys]
    probable = [e for e in named if e.probability is None or e.probability >= 0.5]
    verdict = verdict_of((e.is_open for e in probable), beside.unexplained is not None or beside.verdict == "unknown")
    if found.verdict == "unknown":
        verdict = "unknown"
    chosen = replace(
        alone,
        verdict=verdict,
        effects=tuple(named),
        calibration=tuple(calibration),
        posterior=_both(beside.posterior, Posterior.of(fit)),
        logs=beside.logs,
    )
    names = {e.effect.id for e in named}
    if not beside.has_bars:
        # axis logs: the points have a unit and a comparison of their own, and come first
        assert beside.logs is not None and LogTest.instrument in campaign.measured_parts
        hidden = set(found.hidden) - seen_by_logs(beside.logs.campaign, chosen.machine) - names
        return replace(
            chosen, not_testable=tuple(sorted(hidden)), probabilities=_with_logs(found.verdicts, beside.logs)
        )
    progress("simulating the machine that both instruments support", 0, 1)
    after = compare_bars(campaign.in_motion, alone.machine, threads, progress)
    told = beside.probabilities
    return replace(
        beside,
        **{k: getattr(chosen, k) for k in _OF_ALL},
        after=after,
        rungs=(*beside.rungs[:-1], after),
        not_testable=tuple(sorted(set(beside.not_testable) & set(found.hidden) - names)),
        next_test=beside.next_test if verdict == "ambiguous" else None,
        probabilities={k: round(v * (1.0 - misfit), 4) for k, v in told.items() if k != "unknown"}
        | {"unknown": round(1.0 - (1.0 - misfit) * (1.0 - told.get("unknown", 0.0)), 4)},
    )


#: What a diagnosis beside ball-bar tests has of all instruments; the rest is the ball bar's.
_OF_ALL = ("campaign", "verdict", "effects", "machine", "calibration", "combinations", "posterior", "at_rest")


def _with_logs(verdicts: Verdicts, logs: LogDiagnosis) -> dict[str, float]:
    """Probabilities of the verdicts on values at rest and axis logs, which are independent; none where something is
    left in the logs that no cause explains, because nobody says how probable that is.
    """
    if logs.verdict == "unknown":
        return {}
    out = verdicts.to_json()
    sound = float(np.prod([1.0 - (e.whole or 0.0) for e in logs.effects]))
    moved = out["nothing_found"] * (1.0 - sound)
    named = "ambiguous" if logs.verdict == "ambiguous" else "identified"
    return out | {"nothing_found": round(out["nothing_found"] - moved, 4), named: round(out[named] + moved, 4)}


def _both(first: Posterior | None, second: Posterior) -> Posterior:
    """The points' posterior, and what the other one says of effects that points do not show, as if independent."""
    if first is None:
        return second
    ours = {f.effect.key for f in second.effects}
    others = [(f, at) for f, at in first.blocks if f.effect.key not in ours]
    # points say nothing about the data sheet
    own, mine = first.part([*chain.from_iterable(at for _, at in others), *first.sheet]), second.sheet.start
    covariance = np.array(block_diag(second.covariance[:mine, :mine], own))
    return Posterior((*second.effects, *(f for f, _ in others)), covariance)
