"""The test that should follow a search: the best for two explanations."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.discrepancy import Sizes
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.noise import Noise
from mjsim.inference.outcome import Selection
from mjsim.inference.planning.candidates import Reach, axis_speeds, first_round, key_of, minutes, neighbours
from mjsim.inference.planning.separation import Explanation, Separation, Separator
from mjsim.inference.problem import Problem
from mjsim.inference.settings import PLAN, PlanSettings
from mjsim.inference.signatures import Projector
from mjsim.inference.testability import not_testable
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import table_of
from mjsim.machine.chain import Chain
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.units import UM

#: Tests that are offered.
LISTED = 5


def worth(s: Separation, settings: PlanSettings = PLAN) -> tuple[float, float]:
    """Sort key: tests that decide by deviance per minute of machine time, before tests that do not by deviance."""
    if s.deviance < settings.decisive:
        return 0.0, s.deviance
    return 1.0, min(s.deviance, settings.certain) / minutes(s.test, settings.handling)


def choose(
    separator: Separator,
    threads: int = 2,
    progress: Progress = silent,
    settings: PlanSettings = PLAN,
) -> tuple[list[Separation], int]:
    """The candidate tests that are worth most, best first, and how many there are within reach.

    A coarse round over everything comes first, then conditions are varied around the best ones. What a test would do is
    worked out only where it could be worth more than the best ones, when its set-up alone adapts.

    Args:
        separator: Of the two explanations, with what can be measured next to a campaign's tests.
        threads: Tests that are looked at side by side.
        progress: Called as work gets on.
        settings: What decides.
    """
    looked_at: set[str] = set()
    found: list[Separation] = []

    def evaluate(candidates: Iterable[BallBarTest], stage: str) -> None:
        fresh = {key_of(t): t for t in candidates if key_of(t) not in looked_at and separator.reach.holds(t)}
        looked_at.update(fresh)
        most = []
        for n, (t, deviance) in enumerate(zip(fresh.values(), pool.map(separator.most, fresh.values()), strict=True)):
            most.append(Separation(t, deviance, 0.0))
            progress(stage, n + 1, len(fresh))
        most.sort(key=value, reverse=True)
        while most and (len(found) < LISTED or value(most[0]) > value(found[LISTED - 1])):
            if found and most[0].deviance < 1.0:
                break  # less than one standard deviation tells nothing
            found.extend(pool.map(separator.of, [s.test for s in most[:threads]]))
            found.sort(key=value, reverse=True)
            del most[:threads]

    def value(s: Separation) -> tuple[float, float]:
        return worth(s, settings)

    with ThreadPoolExecutor(threads) as pool:
        evaluate(first_round(separator.reach.tests), "planning: all kinds of tests")
        for _ in range(settings.rounds):
            evaluate([n for s in found[: settings.refined] for n in neighbours(s.test)], "planning: around the best")
    return found, len(looked_at)


#: How the absence of every further effect is named in ``between``.
NOTHING = "nothing"


@dataclass(frozen=True)
class Plan:
    """The next test.

    Attributes:
        between: ids of the two explanations; the second is ``"nothing"`` where a hidden effect shall be made to show.
        choices: Candidate tests, best first.
        reason: One sentence.
        settings: By which they were chosen.
        explanations: What is to be separated.
    """

    between: tuple[str, str]
    choices: tuple[Separation, ...]
    reason: str
    settings: PlanSettings = PLAN
    explanations: tuple[Explanation, ...] = ()

    @property
    def best(self) -> Separation:
        """The test to run."""
        return self.choices[0]

    @property
    def decides(self) -> bool:
        """Whether the best test is expected to decide."""
        return self.best.deviance >= self.settings.decisive

    def to_json(self, most: int = LISTED) -> dict:
        """As ``next_test`` in the JSON of ``mjsim diagnose``, with the runners-up."""
        return {
            **self._row(self.best),
            "decides": self.decides,
            "reason": self.reason,
            "enough": round(self.settings.decisive**0.5, 1),
            "plenty": round(self.settings.certain**0.5, 1),
            "axis_speeds": axis_speeds(self.best.test),
            "runners_up": [self._row(s) for s in self.choices[1:most]],
        }

    def _row(self, s: Separation) -> dict:
        return {
            "between": list(self.between),
            "test": table_of(s.test),
            "difference_um": round(s.difference / UM, 3),
            "separation": round(s.deviance**0.5, 1),
            "minutes": round(minutes(s.test, self.settings.handling), 1),
        }


def plan_for(
    problem: Problem, selection: Selection, threads: int = 2, progress: Progress = silent, hidden: bool = True
) -> Plan | None:
    """The next test after a search: the first that is expected to decide between a finding and what may stand in its
    place, or else the one that comes nearest.

    Args:
        problem: The measured tests.
        selection: What was found in them.
        threads: Tests that are looked at side by side.
        progress: Called as work gets on.
        hidden: Also where nothing is ambiguous, for what is not testable.
    """
    reach = Reach(problem.chain, problem.campaign.tests)
    block, settings = problem.samples[0].block, problem.settings.plan
    args = (reach, problem.noise, block, threads, progress, settings, selection.left)
    undecided = []
    for f in selection.found:
        for other, fit in f.competing.items():
            mine = f.key.partition("[")[0]
            pair = Explanation.of_fit(mine, selection.fit), Explanation.of_fit(other, fit)
            plan = best_of((mine, other), pair, *args)
            if plan.decides:
                return plan
            undecided.append(plan)
    if undecided:
        return max(undecided, key=lambda plan: plan.best.deviance)
    if not hidden:
        return None
    for effect_id in not_testable(problem, Projector(selection.start), selection.bank):
        if not _seeds(effect_id, problem.chain):
            continue
        here = Explanation.of_fit(NOTHING, selection.fit)
        there = here.with_effect(effect_id, lacking(effect_id, here.machine))
        return best_of((effect_id, NOTHING), (there, here), *args)
    return None


def best_of(
    between: tuple[str, str],
    explanations: tuple[Explanation, Explanation],
    reach: Reach,
    noise: Noise,
    block: float,
    threads: int,
    progress: Progress,
    settings: PlanSettings = PLAN,
    left: Sizes | None = None,
) -> Plan:
    """The plan that separates two explanations best; arguments as of :class:`Separator` and :func:`choose`."""
    separator = Separator(*explanations, noise, block, reach, left)
    choices, reached = choose(separator, threads, progress, settings)
    a, b = between
    what = f"makes {a} show" if b == NOTHING else f"separates {a} from {b}"
    best = choices[0]
    if best.deviance >= settings.decisive:
        reason = f"Of {reached} tests within reach this one {what} best per minute of machine time."
    else:
        reason = f"No test of {reached} within reach {what} clearly; this one comes nearest."
    return Plan(between, tuple(choices), reason, settings, explanations)


def _seeds(effect_id: str, chain: Chain) -> list[dict]:
    """Typical values of an effect; none where its shape is free."""
    cls, subject = registry.effect_class(effect_id, chain)
    return cls.search.seeds_of(cls.parameters_of(subject), subject, chain)


def lacking(effect_id: str, machine: Machine) -> EffectVector:
    """An effect that a machine may have and its model lacks: one typical size of it, beyond what the model has.

    Args:
        effect_id: ``kind.SUBJECT``.
        machine: The model.

    Raises:
        InputError: As of :func:`typical`.
    """
    free, present = typical(effect_id, machine.chain), machine.effect(effect_id)
    if present is None:
        return free
    mine = EffectVector(present, free.names)
    vector = mine.vector.copy()
    vector[mine.linear or slice(None)] += 1.0
    return mine.with_effect(mine.at(vector))


def typical(effect_id: str, chain: Chain) -> EffectVector:
    """An effect at a typical size, whatever the machine has of it.

    Args:
        effect_id: ``kind.SUBJECT``.
        chain: axes of the machine.

    Raises:
        InputError: its shape is free (a pitch error's order), so no size is typical.
    """
    cls, subject = registry.effect_class(effect_id, chain)
    seeds = _seeds(effect_id, chain)
    if not seeds:
        raise InputError(
            f"plan for {effect_id}: its orders are not known beforehand; measure any test in which its axis moves"
            if not cls.follows_sensor(subject)
            else f"plan for {effect_id}: nobody knows the temperatures beforehand; measure the same test cold and warm"
        )
    return EffectVector(cls(subject, **seeds[0]), cls.search.free_of(cls.parameters_of(subject)))
