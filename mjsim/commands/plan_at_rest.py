"""The next test of an instrument that measures while the machine stands still."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.plan_positions import plan_points
from mjsim.errors import InputError
from mjsim.inference.at_rest import RestFitter, RestProblem
from mjsim.inference.calibration import expected_effects
from mjsim.inference.fit import Fit
from mjsim.inference.planning.at_rest import Open, PlannedTest, RestPlanner
from mjsim.inference.planning.next_test import NOTHING, typical
from mjsim.inference.planning.whole_campaign import CampaignPlanner, minutes_of, possible_tests
from mjsim.inference.posterior import CompetingModel, Posterior
from mjsim.inference.settings import PLAN, PlanSettings
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.instruments.sphere.measurement import SphereTest
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.units import MM

#: Deviance that says something: below, both explanations foretell the same within one standard deviation.
_LEAST = 1.0
#: Points of a proposed sphere, and where it is where no campaign has one, m in the work frame.
_POINTS, _SPHERE = 30, (100 * MM, 0.0, 155 * MM)


@dataclass(frozen=True)
class MostTelling:
    """What to measure next where no finding is open: what tells most of what the campaign has not shown.

    Attributes:
        choices: Tests, by what they tell per minute, the best first.
    """

    choices: tuple[PlannedTest, ...]

    def to_json(self, most: int = 5) -> dict:
        """As ``mjsim plan --json`` prints it: the best test; and of every instrument the best ones, each of which makes
        other numbers known.
        """
        rows: dict[tuple, PlannedTest] = {}
        for p in self.choices:
            rows.setdefault((p.test.instrument, *((k.effect_id, k.parameter) for k in p.known)), p)
        count = Counter[str]()
        kept = []
        for p in rows.values():
            count[p.test.instrument] += 1
            if count[p.test.instrument] <= most:
                kept.append(telling_row(p))
        reason = (
            f"Nothing that was found is open. Of {len(self.choices)} tests this one tells most per minute of what the "
            "campaign does not show."
        )
        return kept[0] | {"reason": reason, "runners_up": kept[1:]}


def telling_row(p: PlannedTest) -> dict:
    """A test that tells of the machine's errors, as plain data."""
    known = [
        {
            "id": k.effect_id,
            "parameter": k.parameter,
            "half_width95_now": float(f"{k.before:.3g}"),
            "half_width95": float(f"{k.after:.3g}"),
        }
        for k in p.known
    ]
    return _row(p) | {"bits": round(p.bits, 2), "known": known}


def separating_row(p: PlannedTest, between: Sequence[str]) -> dict:
    """A test that separates two explanations, as plain data."""
    channel = INSTRUMENTS[p.test.instrument].channels(p.test)[0]
    return _row(p) | {
        "between": list(between),
        f"difference_{channel.suffix}": float(f"{p.difference / channel.size:.4g}"),
        "separation": round(p.deviance**0.5, 1),
        "decides": p.decides,
    }


def _row(p: PlannedTest) -> dict:
    instrument = INSTRUMENTS[p.test.instrument]
    return {"instrument": instrument.name, "test": instrument.test_table(p.test), "minutes": round(p.minutes, 1)}


def tests_at_rest(campaign: Campaign, machine: Machine) -> list[Any]:
    """Tests that are looked at, each with a name that the campaign does not have."""
    taken, out = {t.name for t in campaign.tests}, list[Any]()
    periods = {a: 2.0 * math.pi / machine.drives[a].gear for a in machine.chain.letters}
    for instrument in INSTRUMENTS.values():
        for test in instrument.proposals(machine.chain, periods):
            names = itertools.chain([test.name], (f"{test.name}-{i}" for i in itertools.count(2)))
            name = next(n for n in names if n not in taken)
            out.append(replace(test, name=name, setup=name))
    if machine.chain.spatial and machine.chain.rotary:
        spheres = [t.sphere for t in campaign.tests if isinstance(t, SphereTest)]
        try:
            out.append(plan_points(campaign, machine, _POINTS, spheres[0] if spheres else _SPHERE).test)
        except InputError:  # its class has no location errors
            pass
    return out


def separating(
    campaign: Campaign,
    machine: Machine,
    models: Sequence[CompetingModel],
    progress: Progress = silent,
    settings: PlanSettings = PLAN,
) -> list[PlannedTest]:
    """Tests at rest that tell two explanations apart, those that decide first, the best first; of parallel lines the
    best one.

    Args:
        campaign: Whose instruments they are measured with.
        machine: As given.
        models: Both explanations; the first is taken for true.
        progress: Called as work gets on.
        settings: What decides.
    """
    planner, tests, out = RestPlanner(campaign, machine, settings), tests_at_rest(campaign, machine), []
    for i, test in enumerate(tests):
        progress("planning: tests at rest", i, len(tests))
        out.append(planner.apart(test, models[0], models[1]))
    best: dict[tuple, PlannedTest] = {}
    for p in sorted((p for p in out if p.deviance > _LEAST), key=lambda p: p.worth, reverse=True):
        best.setdefault((p.test.instrument, *(getattr(p.test, k, "") for k in ("axis", "component"))), p)
    return list(best.values())


def models_between(campaign: Campaign, machine: Machine, between: tuple[str, str]) -> tuple[CompetingModel, ...]:
    """Two explanations of what was measured at rest, fitted; the first is taken for true.

    Args:
        campaign: With measured tests at rest.
        machine: As given.
        between: Two ids of effects, or one and :data:`NOTHING`: then the effect has its typical size.

    Raises:
        InputError: An effect is none of the machine.
    """
    problem = RestProblem.of(campaign.of(*(n for n in campaign.measured_parts if INSTRUMENTS[n].at_rest)))
    fitter = RestFitter(problem, machine)
    free = {i: typical(i, machine.chain) for i in between if i != NOTHING}
    shown = [c.free for c in expected_effects(machine) if problem.shows(machine, c.free)]

    def fitted(name: str) -> Fit:
        without = set(free) if name == NOTHING else {name}
        own = [] if name == NOTHING else [free[name]]
        return fitter.fit([*(f for f in shown if f.effect.id not in without), *own])

    if NOTHING in between:
        ((name, effect),) = free.items()
        here = CompetingModel.of(NOTHING, fitted(NOTHING))
        there = CompetingModel(name, here.machine.with_effect(effect.effect), Posterior((), np.zeros((0, 0))), 0.0)
        return there, here
    first, second = (CompetingModel.of(name, fitted(name)) for name in between)
    return first, second


def most_telling(
    campaign: Campaign,
    machine: Machine,
    found: Diagnosis,
    threads: int = 2,
    progress: Progress = silent,
    settings: PlanSettings = PLAN,
) -> MostTelling:
    """What tells most of the errors that a machine of its class may have, at rest or with a ball bar.

    Args:
        campaign: Whose instruments it is measured with.
        machine: As given.
        found: What was found so far.
        threads: Simulations side by side.
        progress: Called as work gets on.
        settings: By which tests are judged.
    """
    planner, tests, out = RestPlanner(campaign, machine, settings), tests_at_rest(campaign, machine), []
    shown = {c.effect.effect.id for c in found.calibration if c.observable} | {e.effect.id for e in found.effects}
    left = Open(found.machine, found.posterior, planner.expected, shown)
    for i, test in enumerate(tests):
        progress("planning: tests at rest", i, len(tests))
        out.append(planner.told(test, left))
    bars = _bar_tests(machine)
    if bars:
        judge = CampaignPlanner(found.machine, threads, progress, left.effects, bars)
        out += [left.after(t, minutes_of([t]), judge.told_by(t)) for t in bars]
    return MostTelling(tuple(sorted(out, key=lambda p: p.bits / p.minutes, reverse=True)))


def _bar_tests(machine: Machine) -> list[BallBarTest]:
    """A ball-bar test of every shape that the machine can run: where the table ball is, the next plan varies."""
    every: dict[str, BallBarTest] = {}
    for test in possible_tests(machine):
        every.setdefault(kind_of(test).short_name(replace(test, table_ball=(0.0, 0.0, test.table_ball[2]))), test)
    return list(every.values())
