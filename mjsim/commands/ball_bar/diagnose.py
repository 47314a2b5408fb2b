"""Which physical effects are missing from a machine's model, from ball-bar tests."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.ball_bar.compare import BarComparison, overlay
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.finding import DiagnosedEffect, findings_of, ladder_of
from mjsim.inference.findings import explain
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.outcome import Selection
from mjsim.inference.planning.next_test import plan_for
from mjsim.inference.posterior import CompetingModel, Posterior
from mjsim.inference.problem import Problem
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.inference.shares import clear_tests
from mjsim.inference.signatures import Projector
from mjsim.inference.testability import not_testable
from mjsim.inference.vibration import Line, is_news, phased_at, separate
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.io.cache import remembered
from mjsim.machine.model import Machine, build
from mjsim.progress import Progress, counted, silent
from mjsim.simulation.multibody import Reading
from mjsim.simulation.readings import readings_of
from mjsim.threads import one_blas_thread


@one_blas_thread
def diagnose_bars(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None = None,
    threads: int = 2,
    progress: Progress = silent,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Diagnosis:
    """Find what is missing.

    The search runs on the drives' motions, and so do the models between the machine as given and the fitted one. The
    errors of these two come from the full multibody simulation.

    Args:
        campaign: With at least one measured test.
        machine: As given.
        max_effects: At most so many different effects; without it as many as the data prove.
        threads: Tests that are worked on side by side.
        progress: Called as work gets on.
        settings: What decides.

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
    separated = separate(
        checked_problem(campaign, build(machine), threads, settings=settings, machine=machine), machine
    )
    # much of the search keeps one core busy: another simulates meanwhile
    readings_as_given = separated.problem.workers.start(lambda: readings_of(machine, separated.problem.tests, 1))
    explained = explain(separated, progress, max_effects)
    data, selection, unexplained = explained.data, explained.selection, explained.unexplained
    hidden = not_testable(data, Projector(selection.start), selection.bank)
    selection.bank.forget()  # the simulations need the room
    vibrations = [_vibration(data, line) for line in separated.lines if is_news(line, machine)]
    found = [*_found(data, selection), *sorted(vibrations, key=lambda e: -e.gain)]
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
        plant = build(phased)
        moved = problem.map(lambda k: Reading(problem.tests[k], problem.motions[k].reading(plant)))
        return overlay(problem, phased, moved, begin)

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
        posterior=Posterior.of(selection.fit),
        settings=settings,
        probabilities=explained.verdicts.to_json(),
        discrepancy=explained.discrepancy,
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
