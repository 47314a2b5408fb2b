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
from mjsim.errors import InputError
from mjsim.inference.at_rest import RestFitter, RestProblem
from mjsim.inference.calibration import expected_effects
from mjsim.inference.fit import Fit
from mjsim.inference.planning.at_rest import Known, Open, PlannedTest, RestPlanner, planned_problem
from mjsim.inference.planning.next_test import NOTHING, typical
from mjsim.inference.planning.whole_campaign import CampaignPlanner, minutes_of, possible_tests
from mjsim.inference.posterior import CompetingModel, Posterior
from mjsim.inference.settings import PLAN, PlanSettings
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.instruments.positions.instrument import planned_diagonal, planned_test
from mjsim.instruments.positions.measurement import PositionTest
from mjsim.instruments.sphere.measurement import SphereTest
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.units import DEG, MM

# -- at which positions to measure while the machine stands still, and how well its errors are known after it ----------
# Few positions of a sphere: those after which the location errors are known best. Every point is a place of the rotary
# axes, a side from which it is approached and an angle of the spindle. Points are taken one by one; each takes most
# from the uncertainty of the location errors, in units of what a machine of its class may have, with set-up, probe and
# everything else that the class has as unknowns beside them.
#
# Targets of one axis: as ISO 230-2 asks for them.

#: Steps of the places that are looked at: axes that go round, and those that tilt; how far these tilt, rad.
_ROUND, _TILT, _FARTHEST = 30.0 * DEG, 15.0 * DEG, 90.0 * DEG
#: A number is told by targets that take at least this share of its uncertainty.
_TOLD = 0.1


@dataclass(frozen=True)
class PlannedPositions:
    """A test to be measured.

    Attributes:
        test: With its positions, in the order of measuring.
        known: How well numbers of the machine are known by its class alone, and after the test.
        noise: Standard deviation of one reading that was reckoned with, SI.
        there: Whether the campaign has the test already, without positions.
    """

    test: SphereTest | PositionTest
    known: tuple[Known, ...]
    noise: float
    there: bool = False

    def to_json(self) -> dict:
        """Plain data."""
        table = {"test": INSTRUMENTS[self.test.instrument].test_table(self.test)}
        known = [
            {
                "id": k.effect_id,
                "parameter": k.parameter,
                "half_width95": float(f"{k.after:.3g}"),
                "class_half_width95": float(f"{k.before:.3g}"),
            }
            for k in self.known
        ]
        if isinstance(self.test, SphereTest):
            return table | {"points": len(self.test.angles), "location_errors": known}
        return table | {"targets": len(self.test.targets), "known": known}


def plan_points(
    campaign: Campaign,
    machine: Machine,
    count: int,
    sphere: tuple[float, float, float] | None = None,
    farthest: dict[str, tuple[float, float]] | None = None,
) -> PlannedPositions:
    """Positions to measure.

    Args:
        campaign: Whose first sphere test says where the sphere is, if ``sphere`` does not.
        machine: As given.
        count: Points.
        sphere: Nominal centre in the work frame, m.
        farthest: Ends of a rotary axis' travel, rad, by letter; otherwise all round, or 90° to either side.

    Raises:
        InputError: Nobody says where the sphere is, or an axis is none that turns.
    """
    tests = [t for t in campaign.tests if isinstance(t, SphereTest)]
    if sphere is None and not tests:
        raise InputError(
            f"{campaign.folder / 'campaign.toml'}: no test with a sphere; say where it will be: --sphere X Y Z, mm in "
            "the work frame"
        )
    chain = machine.chain
    for axis in farthest or {}:
        if axis not in chain.rotary:
            raise InputError(f"axis {axis!r}; allowed: {', '.join(chain.rotary)}")
    at = sphere or tests[0].sphere
    names = {t.name for t in campaign.tests}
    blank = next((t for t in tests if t.trace is None and not t.angles and t.sphere == at), None)
    free = (n for n in itertools.chain(["sphere"], (f"sphere-{i}" for i in itertools.count(2))) if n not in names)
    name = blank.name if blank else next(free)
    same = tests[0].setup if tests and tests[0].sphere == at else name
    empty = SphereTest(name, at, same, None, tests[0].chain if tests else chain)
    every = _candidates(empty, farthest or {})
    noise, white, precision, located = _linear(campaign, machine, every)
    chosen = _greedy(white, precision, np.array([p for p, _ in located.values()]), count)
    order = sorted(
        chosen, key=lambda i: (every.approach[i][-1], *(every.approach[i][-1] * a for a in every.angles[i][::-1]))
    )
    test = replace(
        every,
        angles=tuple(every.angles[i] for i in order),
        spindle=tuple(every.spindle[i] for i in order),
        approach=tuple(every.approach[i] for i in order),
    )
    rows = white[np.concatenate([3 * i + np.arange(3) for i in chosen])]
    after = np.linalg.inv(np.diag(precision) + rows.T @ rows)
    known = (
        Known(*name, 1.96 * unit / math.sqrt(precision[p]), 1.96 * math.sqrt(after[p, p]) * unit)
        for name, (p, unit) in located.items()
    )
    return PlannedPositions(test, tuple(known), noise, any(t.name == name for t in tests))


def _candidates(test: SphereTest, farthest: dict[str, tuple[float, float]]) -> SphereTest:
    """The test with every place, side and angle of the spindle that is looked at."""
    chain, places = test.chain, []
    for axis in chain.rotary:
        goes_round = axis in chain.round_axes and axis not in farthest
        low, high = farthest.get(axis, (0.0, 2.0 * math.pi) if goes_round else (-_FARTHEST, _FARTHEST))
        step = _ROUND if goes_round else _TILT
        n = max(2, round((high - low) / step) + 1)
        places.append(np.linspace(low, high, n)[: n - 1 if goes_round else n])
    sides = (1, -1)
    rows = [(p, s, a) for p in itertools.product(*places) for s in sides for a in (0.0, math.pi)]
    rotary = len(chain.rotary)
    return replace(
        test,
        angles=tuple(tuple(float(v) for v in p) for p, _, _ in rows),
        approach=tuple((s,) * rotary for _, s, _ in rows),
        spindle=tuple(a for _, _, a in rows),
    )


def _linear(campaign: Campaign, machine: Machine, every: SphereTest):
    """The linear problem of all candidates: noise of a centre, m; whitened columns (3n, p); prior precisions (p,);
    places and units of the location errors, by id and name of the number.
    """
    problem, fit = _fit_of_class(campaign, machine, every)
    located = {
        (f.effect.id, next(iter(f.specs))): (fit.parameters[f.block.name].start, next(iter(f.specs.values())).scale)
        for f in fit.effects
        if f.effect.kind == "axis_location"
    }
    if not located:
        raise InputError(f"{machine.name}: its [tolerance] has no axis_location, so there is nothing to plan for")
    white = fit.design @ np.eye(fit.parameters.size)
    return problem.noise.rms, white, fit.parameters.precision(), located


def _fit_of_class(campaign: Campaign, machine: Machine, test: SphereTest | PositionTest) -> tuple[RestProblem, Fit]:
    """What a test will fit, and how: whatever a machine of its class may have and the test shows."""
    problem = planned_problem(campaign, test)
    shown = [c.free for c in expected_effects(machine) if problem.shows(machine, c.free)]
    return problem, RestFitter(problem, machine).fit(shown, iterations=0)


def _greedy(white: np.ndarray, precision: np.ndarray, places: np.ndarray, count: int) -> list[int]:
    """The points that are taken, one after the other, (count,): each place, side and spindle at most once."""
    white = white.reshape(len(white) // 3, 3, -1)
    n = len(white)
    covariance = np.diag(1.0 / precision)
    weight = precision[places]  # uncertainty in units of the class
    chosen: list[int] = []
    for _ in range(min(count, n)):
        reach = white @ covariance  # (n, 3, p)
        inner = np.eye(3) + np.einsum("nip,njp->nij", reach, white)
        part = reach[:, :, places]
        gain = np.einsum("p,nip,nij,njp->n", weight, part, np.linalg.inv(inner), part)
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        covariance = covariance - reach[best].T @ np.linalg.solve(inner[best], reach[best])
    return chosen


def plan_targets(
    campaign: Campaign,
    machine: Machine,
    axis: str,
    ends: dict[str, tuple[float, float]],
    count: int | None = None,
) -> PlannedPositions:
    """Targets of one axis, or of a diagonal.

    Args:
        campaign: For which they are.
        machine: As given.
        axis: Letter of the axis; of a diagonal the letters of all that move.
        ends: Range of the test by letter of the axis, mm or degrees; of a diagonal its beginning and its end.
        count: How many; without it as few as the standard allows.

    Raises:
        InputError: The machine has no such axis, or nobody says its range.
    """
    chain, names = machine.chain, {t.name for t in campaign.tests}
    diagonal = len(axis) > 1 and chain.spatial and set(axis) <= set(chain.linear) and len(set(axis)) == len(axis)
    for letter in (*(axis if diagonal else [axis]), *ends):
        if letter not in chain.letters:
            more = f", or several of {', '.join(chain.linear)} for a diagonal" if chain.spatial else ""
            raise InputError(f"axis {letter!r}; allowed: {', '.join(chain.letters)}{more}")
        if letter in axis and letter not in ends:
            if not chain.is_rotary(letter):
                raise InputError(f"no range of {letter}; allowed: --range {letter} LOW HIGH, mm")
            ends = {letter: (0.0, 360.0)}
    first = f"{'diagonal' if diagonal else 'targets'}-{axis.lower()}"
    name = next(n for n in itertools.chain([first], (f"{first}-{i}" for i in itertools.count(2))) if n not in names)
    periods = {a: 2.0 * math.pi / machine.drives[a].gear for a in axis}
    for letter in axis:
        low, high = ends[letter]
        if low == high or (low > high and not diagonal):
            allowed = "two ends that differ" if diagonal else "the lower end first"
            raise InputError(f"range of {letter}: {low:g} to {high:g}; allowed: {allowed}")
    if diagonal:
        both = tuple((a, ends[a][0] * MM, ends[a][1] * MM) for a in axis)
        test = planned_diagonal(name, both, chain, periods, count)
    else:
        low, high = (v * (DEG if chain.is_rotary(axis) else MM) for v in ends[axis])
        test = planned_test(name, axis, f"E{axis}{axis}", chain, (low, high), periods[axis], count)
    problem, fit = _fit_of_class(campaign, machine, test)
    prior, after = fit.parameters.precision(), np.sqrt(np.diag(fit.covariance))
    known = []
    for f in (f for f in fit.effects if f.names != ("components",)):
        at = fit.parameters[f.block.name]
        for number, before, then in zip(f.names, prior[at] ** -0.5, after[at], strict=True):
            if then <= (1.0 - _TOLD) * before:
                half = 1.96 * f.specs[number].scale
                known.append(Known(f.effect.id, number, half * before, half * then))
    return PlannedPositions(test, tuple(known), problem.noise.rms)


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
