"""Tests that could be measured next: what this machine can reach, in the kinds, feeds, offsets and directions of a
ball-bar campaign.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from itertools import product

import numpy as np

from mjsim.inference.settings import PLAN
from mjsim.instruments.ball_bar.kinds import KINDS, kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program, commanded_speed
from mjsim.instruments.base import table_of
from mjsim.instruments.r_test.measurement import SphereReading
from mjsim.machine.chain import COORDINATES, Chain, usual_speed, usual_travel
from mjsim.simulation.axes import AxesMotion, motions_of
from mjsim.units import DEG, MM

#: Feeds that are looked at, m/s: all of them around the best tests, and two in the first round.
FEEDS = tuple(f * MM / 60.0 for f in (500, 1000, 2000, 4000, 6000))
FIRST_FEEDS = (FEEDS[1], FEEDS[3])
#: Motions that are kept of each axis of a test: two explanations differ in few drives.
_KEPT = 4


class Reach:
    """What a machine can measure next to the tests of a campaign: what the travel and speed of its axes allow, and what
    these tests reach. The motions of a test are the same whatever it is asked to tell apart, and are kept.

    Args:
        chain: Axes of the machine.
        tests: Of the campaign.
    """

    def __init__(self, chain: Chain, tests: Sequence[BallBarTest] = ()) -> None:
        self.tests = tuple(tests)
        low, high = usual_travel(chain).T
        for other in tests:
            q = _commands(other)
            low, high = np.minimum(low, q.min(axis=0)), np.maximum(high, q.max(axis=0))
        self._low, self._high, self._speed = low - 1e-9, high + 1e-9, usual_speed(chain)
        self._holds: dict[str, bool] = {}
        self._motions: dict[str, tuple[AxesMotion, ...]] = {}

    def holds(self, test: BallBarTest) -> bool:
        """Whether a test is within reach."""
        key = key_of(test)
        if key not in self._holds:
            q, speed = commanded_speed(test)
            is_near = bool((q >= self._low).all() and (q <= self._high).all())
            self._holds[key] = is_near and bool((speed <= self._speed).all())
        return self._holds[key]

    def motions(self, test: BallBarTest) -> tuple[AxesMotion, ...]:
        """Motions of the axes in the readings of a test. They are compared with each other: what a single sub-step of
        the drives misses is the same in all.
        """
        key = key_of(test)
        if key not in self._motions:
            self._motions[key] = motions_of(test.readings, _KEPT, substeps=1)
        return self._motions[key]


def key_of(test: BallBarTest) -> str:
    """What two tests have in common that are measured alike."""
    return str({k: v for k, v in table_of(test).items() if k not in ("name", "setup")})


def reachable(test: BallBarTest) -> bool:
    """Whether the axes' travel and speed allow a test."""
    return Reach(test.chain).holds(test)


def _commands(test: BallBarTest) -> np.ndarray:
    program = Program(test)
    return program.commands(np.linspace(0.0, program.duration, 361))


def axis_speeds(test: BallBarTest) -> dict[str, tuple[float, str]]:
    """Highest speed of every axis that moves, and its unit (mm/min or °/s)."""
    _, speed = commanded_speed(test)
    rows = {
        a.letter: (v / DEG, "°/s") if a.rotary else (v / MM * 60.0, "mm/min")
        for a, v in zip(test.chain.axes, speed, strict=True)
    }
    return {letter: (round(float(v), 1), unit) for letter, (v, unit) in rows.items() if v > 1e-3}


def minutes(test: BallBarTest, handling: float = PLAN.handling) -> float:
    """Machine time of a test with its handling, min.

    Args:
        test: The test.
        handling: Time for mounting the balls and starting, s.
    """
    return (Program(test).duration + handling) / 60.0


def first_round(tests: tuple[BallBarTest, ...]) -> Iterator[BallBarTest]:
    """A coarse choice over all kinds, with the bar and the height of the table ball of ``tests``."""
    if tests[0].component:  # the sphere stays where it is
        for test, feed in product(motions_at(tests[0].chain, tests[0].table_ball), FIRST_FEEDS):
            yield _named(replace(test, feed=feed))
        return
    for kind in KINDS.values():
        for test, feed in product(kind.proposals(tests[0].chain, tests[0].length, tests[0].table_ball[2]), FIRST_FEEDS):
            yield _named(replace(test, feed=feed))


def motions_at(chain: Chain, sphere: tuple[float, float, float]) -> Iterator[SphereReading]:
    """R-tests with a sphere at a place, one reading of each: every rotary axis alone, and two together.

    Args:
        chain: The machine's axes.
        sphere: Its centre in the work frame, m.
    """
    for kind in (k for k in KINDS.values() if not k.moves_on_table and not k.cannot(chain)):
        seen = set()
        for test in kind.proposals(chain, 0.0, sphere[2]):
            given = {f.name: getattr(test, f.name) for f in fields(BallBarTest)}
            one = SphereReading(**given | {"component": COORDINATES[0], "table_ball": sphere})
            path = one.axis, one.start, one.stop
            if path not in seen and not kind.wrong(one):
                seen.add(path)
                yield one


def renamed(test: BallBarTest, name: str, setup: str) -> BallBarTest:
    """A test with another name and set-up; of one reading, ``name`` is that of its recording."""
    return replace(test, name=f"{name}.d{test.component.lower()}" if test.component else name, setup=setup)


def neighbours(test: BallBarTest) -> Iterator[BallBarTest]:
    """Tests that differ from ``test`` in one condition."""
    kind = kind_of(test)
    yield _named(kind.turned(test))
    for feed in FEEDS:
        if feed != test.feed:
            yield _named(replace(test, feed=feed))
    yield from map(_named, kind.variations(test))


def _named(test: BallBarTest) -> BallBarTest:
    name = f"{kind_of(test).short_name(test)}-f{round(test.feed / MM * 60)}"
    return replace(
        renamed(test, name, name), commanded=None
    )  # another test than the one that an NC file was written for
