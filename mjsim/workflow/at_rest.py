"""What is missing from a machine's model, from what was measured while it stood still, alone or beside a ball bar.

With a ball bar the fit is joint: the ball-bar tests come in as the normal distribution of the numbers that they
determine, without their priors, at their best fit. So location errors and their like are those of one least-squares fit
to both instruments. Which causes of the ball bar's own there are, and between which of them it cannot decide, is
decided by the ball bar before; the points add causes, and do not take these back.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import chain

import numpy as np
from scipy.linalg import block_diag

from mjsim.campaign.model import Campaign
from mjsim.estimation.at_rest import RestProblem, explain_at_rest
from mjsim.estimation.findings import Explained
from mjsim.estimation.outcome import verdict_of
from mjsim.estimation.posterior import Posterior
from mjsim.estimation.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread
from mjsim.workflow.any_instrument import compare_plainly, refuse_mistakes
from mjsim.workflow.ball_bar.compare import compare_bars
from mjsim.workflow.diagnosis import AtRest, Diagnosis
from mjsim.workflow.finding import DiagnosedEffect, findings_of, ladder_of

#: What a diagnosis with both says of itself.
_JOINT = (
    "Numbers that both instruments see are fitted to both together: the ball-bar tests enter as the normal "
    "distribution of the numbers that they determine. Causes that the ball bar has found are kept."
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
    found, hidden = explain_at_rest(RestProblem.of(points, settings), machine, max_effects, progress, known)
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
    rest = rests[0]
    before, after = rest.before, rest.after
    first, tests = before.campaign, tuple(t.name for t in before.campaign.measured)
    findings = findings_of(found.selection, first.tests[0].instrument, lambda key: tests)
    effects, rungs = ladder_of(
        findings, found.calibration, machine, (before, after), lambda m, _: compare_plainly(first, m)
    )
    if beside is not None:
        chosen = _joined(campaign, beside, found, hidden, effects, tuple(rests), final, threads, progress)
        ours = {b.effect_id for b in found.budget}
        return replace(chosen, budget=(*(b for b in beside.budget if b.effect_id not in ours), *found.budget))
    return Diagnosis(
        campaign,
        found.verdict,
        rest.noise,
        effects,
        None,
        hidden,
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
        discrepancy=rest.left,
        at_rest=tuple(rests),
        budget=found.budget,
    )


def _shared(part: Campaign) -> set[str]:
    """Names of the numbers of an instrument itself."""
    instrument, out = INSTRUMENTS[part.tests[0].instrument], set()
    for t in part.measured:
        recording = part.traces[t.name]
        time = instrument.observe(t, recording).time
        out |= set(instrument.nuisances_of(t, recording, time, part.instrument).shared)
    return out


def _set_up(found: Explained[RestProblem]) -> dict[str, tuple[float, tuple[float, float]]]:
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


def _joined(
    campaign: Campaign,
    bars: Diagnosis,
    found: Explained[RestProblem],
    unseen: tuple[str, ...],
    effects: tuple[DiagnosedEffect, ...],
    rests: tuple[AtRest, ...],
    final: Machine,
    threads: int,
    progress: Progress,
) -> Diagnosis:
    """The diagnosis of another instrument with what the points have changed and added."""
    fit, rest = found.selection.fit, rests[0]
    ours = {f.effect.key for f in fit.effects}
    old = {e.effect.key: e for e in bars.effects}
    named = [e for e in bars.effects if e.effect.key not in ours]
    for e in effects:
        same = old.get(e.effect.key)
        if same is None:
            named.append(e)
            continue
        own = {"effect": e.effect, "free": e.free, "ci95": e.ci95, "tests": (*same.tests, *e.tests)}
        named.append(replace(same, **own, probability=e.probability if not same.alternatives else same.probability))
    keys = {e.effect.key for e in named}
    calibration = [c for c in bars.calibration if c.effect.effect.key not in ours]
    calibration += [c for c in found.calibration if c.effect.effect.key not in keys]
    verdict = verdict_of((e.is_open for e in named), bars.unexplained is not None or bars.verdict == "unknown")
    if found.verdict == "unknown":
        verdict = "unknown"
    after = bars.after
    if bars.has_bars:
        progress("simulating the machine that both instruments support", 0, 1)
        after = compare_bars(campaign.of(BallBarTest.instrument), final, threads, progress)
    hidden = set(bars.not_testable) & set(unseen) if bars.has_bars else set(unseen)
    hidden -= {e.effect.id for e in named}
    chosen = replace(
        bars,
        campaign=campaign,
        verdict=verdict,
        effects=tuple(named),
        not_testable=tuple(sorted(hidden)),
        machine=final,
        next_test=bars.next_test if verdict == "ambiguous" else None,
        calibration=tuple(calibration),
        combinations=found.combinations,
        posterior=_both(bars.posterior, Posterior.of(fit)),
        probabilities={k: round(v * (1.0 - rest.misfit), 4) for k, v in bars.probabilities.items() if k != "unknown"}
        | {"unknown": round(1.0 - (1.0 - rest.misfit) * (1.0 - bars.probabilities.get("unknown", 0.0)), 4)},
        at_rest=rests,
    )
    if bars.has_bars:
        return replace(chosen, after=after, rungs=(*bars.rungs[:-1], after))
    # axis logs: the points have a unit and a comparison of their own, and come first
    assert bars.logs is not None and LogTest.instrument in campaign.measured_parts
    return replace(
        chosen,
        before=rest.before,
        after=rest.after,
        noise=rest.noise,
        probabilities=found.verdicts.to_json(),
        shares=found.shares,
        rungs=(rest.before, rest.after),
        discrepancy=rest.left,
    )


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
