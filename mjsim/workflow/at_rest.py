"""What is missing from a machine's model, from points that were measured while it stood still, alone or beside a ball
bar.

With a ball bar the fit is joint: the ball-bar tests come in as the normal distribution of the numbers that they
determine, without their priors, at their best fit. So location errors and their like are those of one least-squares fit
to both instruments. Which causes of the ball bar's own there are, and between which of them it cannot decide, is
decided by the ball bar before; the points add causes, and do not take these back.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.linalg import solve_triangular

from mjsim.campaign.model import Campaign
from mjsim.estimation.at_rest import RestExplained, RestProblem, explain_at_rest
from mjsim.estimation.budget import Budget, Split, budgets
from mjsim.estimation.calibration import calibrated_effects
from mjsim.estimation.outcome import Found, verdict_of
from mjsim.estimation.posterior import Posterior
from mjsim.estimation.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.instruments.sphere.classical import location_errors
from mjsim.instruments.sphere.measurement import SphereTest
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread
from mjsim.units import UM
from mjsim.workflow.any_instrument import PlainComparison, compare_plainly, refuse_mistakes
from mjsim.workflow.ball_bar.compare import compare_bars
from mjsim.workflow.diagnosis import AtRest, Diagnosis
from mjsim.workflow.finding import DiagnosedEffect

#: What a diagnosis with both says of itself.
_JOINT = (
    "Numbers that both instruments see are fitted to both together: the ball-bar tests enter as the normal "
    "distribution of the numbers that they determine. Causes that the ball bar has found are kept."
)
#: Most findings that get a comparison of their own; smaller ones share the last.
_RUNGS = 3


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
        campaign: With measured tests of a probed sphere, and of other instruments where ``beside`` has their diagnosis.
        machine: As given.
        max_effects: At most so many different effects; without it as many as the data prove.
        threads: Simulations side by side.
        progress: Called as work gets on.
        settings: What counts as testable and as open.
        beside: What the other instruments say.

    Raises:
        InputError: The points show a mistake.
    """
    points = campaign.of(SphereTest.instrument)
    refuse_mistakes(points)
    known = beside.posterior if beside is not None and beside.has_bars else None
    problem = RestProblem.of(points, known)
    found = explain_at_rest(problem, machine, max_effects, progress, settings)
    fit = found.model.fit
    final = (beside.machine if beside is not None else machine).with_effects(
        f.effect for f in fit.effects if not f.effect.is_neutral
    )
    progress("comparing", 0, 1)
    before, after = compare_plainly(points, machine), compare_plainly(points, final)
    effects, rungs = _findings(points, machine, found, before, after)
    rest = AtRest(
        before,
        after,
        points.instrument.noise,
        points.instrument.source,
        float(np.hypot(*found.model.sizes)),
        found.misfit,
        _set_up(problem, found),
        _classical(points),
        _JOINT if known is not None else "",
    )
    if beside is not None:
        chosen = _joined(campaign, beside, found, effects, rest, final, threads, progress)
        own = _budget(machine, problem, found)
        ours = {b.effect_id for b in own}
        return replace(chosen, budget=(*(b for b in beside.budget if b.effect_id not in ours), *own))
    return Diagnosis(
        campaign,
        found.verdict,
        points.instrument.noise,
        effects,
        None,
        found.not_testable,
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
        at_rest=rest,
        budget=_budget(machine, problem, found),
    )


def _findings(
    campaign: Campaign, machine: Machine, found: RestExplained, before: PlainComparison, after: PlainComparison
) -> tuple[tuple[DiagnosedEffect, ...], tuple[PlainComparison, ...]]:
    """Findings with the errors before and after each, and the comparisons between."""
    fit = found.model.fit
    of_key = {f.effect.key: f for f in fit.effects}
    expected = machine.with_effects(c.effect.effect for c in found.calibration)
    rungs = [before]
    if found.calibration and found.found:
        rungs = [compare_plainly(campaign, expected)]
    for i in range(1, min(len(found.found), _RUNGS)):
        part = expected.with_effects(of_key[f.key].effect for f in found.found[:i])
        rungs.append(compare_plainly(campaign, part))
    last = len(rungs) - 1
    rungs += [after] * max(1, len(found.found) - last)
    effects = []
    for i, f in enumerate(found.found):
        rms = rungs[min(i, last)].rms, rungs[i + 1].rms
        effects.append(_finding(f, found, rms, tuple(t.name for t in campaign.measured)))
    return tuple(effects), tuple(rungs)


def _finding(f: Found, found: RestExplained, rms: tuple[float, float], tests: tuple[str, ...]) -> DiagnosedEffect:
    fit = found.model.fit
    free = next(x for x in fit.effects if x.effect.key == f.key)
    ci = free.interval(free.vector, fit.covariance_of(free))
    made = DiagnosedEffect(free.effect, free.names, ci, *rms, f.alternatives, tests, f.gain)
    return replace(made, probability=f.probability, others=f.others, found_by=SphereTest.instrument)


def _budget(machine: Machine, problem: RestProblem, found: RestExplained) -> tuple[Budget, ...]:
    split, stated = split_of_points(problem, found.model.sizes), {c.key: c for c in calibrated_effects(machine)}
    return budgets(found.model.fit, split, stated, INSTRUMENTS[SphereTest.instrument].noun)


def _set_up(problem: RestProblem, found: RestExplained) -> dict[str, tuple[float, tuple[float, float]]]:
    """Fitted numbers of set-ups and probe with their 95 % intervals, by set-up and name."""
    fit, out = found.model.fit, {}
    spread = np.sqrt(np.diag(fit.covariance)[: problem.nuisances.size]) * problem.units
    value = fit.nuisance * problem.units
    for block in problem.nuisances.blocks:
        for label in block.labels:
            at = problem.nuisances.place(block.name, label)
            name = label if not block.name.startswith("set-up ") else f"{block.name.removeprefix('set-up ')}: {label}"
            half = 1.96 * float(spread[at])
            out[name] = float(value[at]), (float(value[at]) - half, float(value[at]) + half)
    return out


def split_of_points(problem: RestProblem, sizes: tuple[float, float]) -> Split:
    """How the variance of the values splits into noise and discrepancy, and that of another instrument's rows.

    Args:
        problem: The measured tests.
        sizes: Of the discrepancy, smooth and rough, SI.
    """
    factor = problem.factor(sizes)

    def split(weights: np.ndarray) -> dict[str, float]:
        own, other = weights[: problem.count], weights[problem.count :]
        noise = float(np.sum((problem.noise * solve_triangular(factor.T, own)) ** 2))
        rows = {"noise": noise, "not_understood": float(own @ own) - noise}
        return rows | {"other_instrument": float(other @ other)} if len(other) else rows

    return split


def _classical(points: Campaign) -> dict[str, float]:
    """Location errors as circles alone give them, in the units of the effects' numbers."""
    found = location_errors(points.measured, points.traces)
    return {f"axis_location.{name}": value / UM for name, value in found.items()}  # µm and µrad alike


def _joined(
    campaign: Campaign,
    bars: Diagnosis,
    found: RestExplained,
    effects: tuple[DiagnosedEffect, ...],
    rest: AtRest,
    final: Machine,
    threads: int,
    progress: Progress,
) -> Diagnosis:
    """The diagnosis of another instrument with what the points have changed and added."""
    fit = found.model.fit
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
    hidden = set(bars.not_testable) & set(found.not_testable) if bars.has_bars else set(found.not_testable)
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
        probabilities={k: round(v * (1.0 - found.misfit), 4) for k, v in bars.probabilities.items() if k != "unknown"}
        | {"unknown": round(1.0 - (1.0 - found.misfit) * (1.0 - bars.probabilities.get("unknown", 0.0)), 4)},
        at_rest=rest,
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
    places: list[int] = []
    effects = []
    ends = np.cumsum([0, *(len(f.vector) for f in first.effects)])
    for f, (a, b) in zip(first.effects, pairwise(ends.tolist()), strict=True):
        if f.effect.key not in ours:
            effects.append(f)
            places += range(a, b)
    places += range(int(ends[-1]), len(first.covariance))  # the data sheet: points say nothing about it
    own = first.covariance[np.ix_(places, places)]
    n, k = sum(len(f.vector) for f in second.effects), len(own)
    covariance = np.zeros((n + k, n + k))
    covariance[:n, :n], covariance[n:, n:] = second.covariance[:n, :n], own
    return Posterior((*second.effects, *effects), covariance)
