"""Tests that could be measured next: what this machine can reach, in the kinds, feeds, offsets and directions of a ball-bar campaign."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from mjsim.ballbar.measurement import BallBarTest
from mjsim.ballbar.program import Program
from mjsim.units import DEG, MM

#: Travel of X, Y, Z (m), A, C (rad) and speed (m/s, rad/s) of an ordinary machine of this size (assumed: a machine file has none);
#: whatever the campaign's own tests reach is allowed as well.
TRAVEL = np.array([[-0.3, 0.3], [-0.3, 0.3], [-0.1, 0.5], [-30 * DEG, 110 * DEG], [-50.0, 50.0]])
SPEED = np.array([0.33, 0.33, 0.33, 1.0, 2.0])
#: Half apex and inclination of the cones, rad: the paper's two, one that passes close to the table's axis (C turns fast there), and one
#: on which C swings to and fro.
CONES = tuple((a * DEG, b * DEG) for a, b in ((15, 10), (45, 30), (20, 17), (10, 25)))
FEEDS = tuple(f * MM / 60.0 for f in (500, 1000, 2000, 4000, 6000))
OFFSETS = tuple(o * MM for o in (-200, -100, -50, 50, 100, 200))
#: Time for mounting the balls and starting, s (assumed).
HANDLING = 240.0


def reachable(test: BallBarTest, tests: Iterable[BallBarTest] = ()) -> bool:
    """Whether the axes' travel and speed allow a test."""
    low, high = TRAVEL.T.copy()
    for other in tests:
        q = _commands(other)
        low, high = np.minimum(low, q.min(axis=0)), np.maximum(high, q.max(axis=0))
    program = Program(test)
    time = np.linspace(0.0, program.duration, 721)
    q = program.commands(time)
    speed = np.abs(np.gradient(q, time, axis=0)).max(axis=0)
    return bool((q >= low - 1e-9).all() and (q <= high + 1e-9).all() and (speed <= SPEED).all())


def _commands(test: BallBarTest) -> np.ndarray:
    program = Program(test)
    return program.commands(np.linspace(0.0, program.duration, 361))


def minutes(test: BallBarTest) -> float:
    """Machine time of a test with its handling, min."""
    return (Program(test).duration + HANDLING) / 60.0


def first_round(tests: tuple[BallBarTest, ...]) -> Iterator[BallBarTest]:
    """A coarse choice over all kinds, with the bar and the height of the table ball of ``tests``."""
    length, z = tests[0].length, tests[0].table_ball[2]
    places = [(0.0, 0.0), (0.1, 0.0), (0.0, 0.1), (-0.1, 0.0), (0.0, -0.1)]
    feeds = (FEEDS[1], FEEDS[3])
    for (half, tilt), sensitive, (x, y), feed in product(CONES, ("perpendicular", "parallel"), places, feeds):
        yield _named(BallBarTest("", "cone_frustum", (x, y, z), length, feed, half_apex=half, inclination=tilt, sensitive=sensitive))
    for plane, feed in product(("XY", "YZ", "ZX"), feeds):
        yield _named(BallBarTest("", "circular", (0.0, 0.0, z), length, feed, plane=plane))
    for sensitive, feed in product(("tangential", "radial", "axial"), feeds):
        yield _named(BallBarTest("", "rotary", (0.1, 0.0, z), length, feed, sensitive=sensitive, axis="C", stop=2 * np.pi))
        yield _named(BallBarTest("", "rotary", (0.0, 0.0, z), length, feed, sensitive=sensitive, axis="A", start=-20 * DEG, stop=90 * DEG))


def neighbours(test: BallBarTest) -> Iterator[BallBarTest]:
    """Tests that differ from ``test`` in one condition."""
    x, y, z = test.table_ball
    if test.kind == "rotary":
        yield _named(replace(test, start=test.stop, stop=test.start))
    else:
        yield _named(replace(test, direction="CW" if test.direction == "CCW" else "CCW"))
    for feed in FEEDS:
        if feed != test.feed:
            yield _named(replace(test, feed=feed))
    if test.kind == "cone_frustum":
        for half, tilt in CONES:
            if (half, tilt) != (test.half_apex, test.inclination):
                yield _named(replace(test, half_apex=half, inclination=tilt))
        yield _named(replace(test, sensitive="parallel" if test.sensitive == "perpendicular" else "perpendicular"))
        for o in OFFSETS:
            yield _named(replace(test, table_ball=(o, y, z)))
            yield _named(replace(test, table_ball=(x, o, z)))


def _named(test: BallBarTest) -> BallBarTest:
    x, y, _ = (round(v / MM) for v in test.table_ball)
    place = "-".join(p for p in (f"x{x}" if x else "", f"y{y}" if y else "") if p) or "centre"
    feed = f"f{round(test.feed / MM * 60)}"
    if test.kind == "cone_frustum":
        cone = f"cone{round(test.half_apex / DEG)}-{round(test.inclination / DEG)}"
        name = f"{cone}-{place}-{test.sensitive}-{test.direction.lower()}-{feed}"
    elif test.kind == "circular":
        name = f"circle-{test.plane.lower()}-{test.direction.lower()}-{feed}"
    elif test.kind != "rotary":
        name = f"{test.kind}-{place}-{test.direction.lower()}-{feed}"
    else:
        name = f"rotary-{test.axis.lower()}-{test.sensitive}-{'cw' if test.stop < test.start else 'ccw'}-{place}-{feed}"
    return replace(test, name=name, setup=name, commanded=None)  # another test than the one that an NC file was written for
