"""Campaign layouts: which tests, where the table ball sits, in which order and when.

A set-up is one mounting of both balls: tests share it while the table ball stays. Handling time between tests is some
20 s, and 3 min where the ball is moved (assumed). Ball height 155 mm over the rotary centre, bar 100 mm unless said.
"""

from __future__ import annotations

import functools

from .programs import Program

BETWEEN, REMOUNT = 24.0, 180.0
_INCLINATION = {15: 10.0, 30: 20.0, 45: 30.0}


def cone(
    theta: int,
    ball: tuple,
    direction: str = "CCW",
    feed: float = 1000.0,
    sensitive: str = "perpendicular",
    revolutions: int = 2,
) -> dict:
    """A cone-frustum test; ``ball`` is (x, y) in mm."""
    return {
        "name": f"cone{theta}-{_place(ball)}-{direction.lower()}" + ("-parallel" if sensitive == "parallel" else ""),
        "kind": "cone_frustum",
        "half_apex_deg": float(theta),
        "inclination_deg": _INCLINATION[theta],
        "table_ball_mm": [float(ball[0]), float(ball[1]), 155.0],
        "direction": direction,
        "sensitive_direction": sensitive,
        "bar_length_mm": 100.0,
        "feed_mm_min": feed,
        "revolutions": revolutions,
    }


def circle(
    plane: str, direction: str = "CCW", feed: float = 1000.0, ball: tuple = (0, 0), length: float = 100.0
) -> dict:
    """A two-axis circle."""
    return {
        "name": f"circle-{plane.lower()}-{_place(ball)}-{direction.lower()}",
        "kind": "circular",
        "plane": plane,
        "table_ball_mm": [float(ball[0]), float(ball[1]), 155.0],
        "direction": direction,
        "bar_length_mm": length,
        "feed_mm_min": feed,
        "revolutions": 2,
    }


def rotary(
    axis: str, begin: float, end: float, ball: tuple = (0, 0), sensitive: str = "tangential", feed: float = 1000.0
) -> dict:
    """One rotary axis turning."""
    return {
        "name": f"rotary-{axis.lower()}-{sensitive}-{_place(ball)}-{'ccw' if end > begin else 'cw'}",
        "kind": "rotary",
        "axis": axis,
        "table_ball_mm": [float(ball[0]), float(ball[1]), 155.0],
        "from_deg": float(begin),
        "to_deg": float(end),
        "sensitive_direction": sensitive,
        "bar_length_mm": 100.0,
        "feed_mm_min": feed,
    }


def _place(ball: tuple) -> str:
    x, y = ball
    return "centre" if x == y == 0 else (f"x{x:g}" if x else "") + (f"y{y:g}" if y else "")


def arrange(tests: list[dict], begin: float = 180.0) -> list[dict]:
    """Names made unique, set-ups, trace paths and start times filled in."""
    out, clock, setup, mounts, seen = [], begin, None, {}, {}
    for t in tests:
        seen[t["name"]] = seen.get(t["name"], 0) + 1
        name = t["name"] + (f"-{seen[t['name']]}" if seen[t["name"]] > 1 else "")
        mounted = (tuple(t["table_ball_mm"]), t["bar_length_mm"])
        if mounted != setup:
            place = _place(mounted[0][:2])
            mounts[place] = mounts.get(place, 0) + 1
            label = place + (f"-{mounts[place]}" if mounts[place] > 1 else "")
            clock, setup = clock + (REMOUNT if setup else 0.0), mounted
        out.append({**t, "name": name, "trace": f"traces/{name}.csv", "setup": label, "started_s": round(clock, 1)})
        clock += Program(t).duration + BETWEEN
    return out


def turned(tests: list[dict]) -> list[dict]:
    """The same tests, every second one of a set-up with the spindle turned by 180°."""
    count: dict[str, int] = {}
    out = []
    for t in tests:
        k = count[t["setup"]] = count.get(t["setup"], 0) + 1
        out.append(t if k % 2 else {**t, "spindle_deg": 180.0})
    return out


def _both(make, *args, **kw) -> list[dict]:
    return [make(*args, direction="CCW", **kw), make(*args, direction="CW", **kw)]


_TESTS = {
    # an ordinary check: what a workshop measures in an hour
    "standard": [
        *_both(cone, 15, (0, 0)),
        cone(45, (0, 0)),
        circle("XY"),
        cone(15, (50, 0)),
        cone(45, (50, 0)),
        cone(15, (0, 50)),
        cone(15, (30, 30), sensitive="parallel"),
    ],
    "rotaries": [
        rotary("A", 0, 90),
        rotary("A", 90, 0),
        circle("XY", "CCW", 2000.0),
        circle("XY", "CW", 2000.0),
        rotary("C", 0, 360, (150, 0), feed=2000.0),
        rotary("C", 360, 0, (150, 0), feed=2000.0),
        rotary("C", 0, 360, (150, 0), "radial", 2000.0),
        cone(15, (50, 0), feed=1500.0),
    ],
    "circles": [
        *_both(circle, "XY", feed=1500.0),
        *_both(circle, "YZ", feed=1500.0),
        *_both(circle, "ZX", feed=1500.0),
        cone(15, (0, 0), feed=2000.0),
        rotary("C", 0, 360, (100, 0), feed=2000.0),
    ],
    "cones-far": [
        *_both(cone, 15, (0, 0), feed=1500.0),
        cone(15, (200, 0), feed=1500.0),
        cone(15, (-200, 0), feed=1500.0),
        cone(15, (0, 200), feed=1500.0),
        cone(45, (0, -200), feed=1500.0),
    ],
    "feeds": [
        cone(15, (50, 0), feed=800.0),
        cone(15, (50, 0), feed=3000.0),
        cone(45, (50, 0), "CW", feed=2000.0),
        circle("XY", "CCW", 3000.0, (50, 0)),
        circle("XY", "CW", 1000.0, (50, 0)),
        rotary("C", 0, 360, (120, 0), feed=3000.0),
        rotary("C", 360, 0, (120, 0), feed=1500.0),
        rotary("A", -20, 90, (0, 60), feed=1500.0),
    ],
    "table": [
        rotary("C", 0, 360, (150, 0), "tangential", 2000.0),
        rotary("C", 360, 0, (150, 0), "radial", 2000.0),
        rotary("C", 0, 360, (150, 0), "axial", 2000.0),
        rotary("C", 360, 0, (0, 80), "axial", 1500.0),
        cone(15, (0, 80), feed=1500.0),
        cone(45, (0, 80), "CW", feed=1500.0, sensitive="parallel"),
    ],
    "cradle": [
        rotary("A", 0, 90, (0, 0), "tangential", 1500.0),
        rotary("A", 90, 0, (0, 0), "radial", 1500.0),
        rotary("A", -30, 90, (40, 0), "axial", 1500.0),
        rotary("A", 90, -30, (40, 0), "tangential", 1500.0),
        cone(45, (40, 0), feed=1500.0),
        circle("YZ", "CCW", 2000.0, (40, 0)),
    ],
    # a full check of all axes, with set-ups shared between the tests
    "full": [
        *_both(cone, 15, (0, 0), feed=1500.0),
        cone(45, (0, 0), feed=1500.0),
        *_both(circle, "XY", feed=1500.0),
        rotary("A", 0, 90, feed=1500.0),
        rotary("A", 90, 0, feed=1500.0),
        cone(15, (50, 0), feed=1500.0),
        cone(45, (50, 0), feed=1500.0),
        cone(15, (0, 50), feed=1500.0),
        cone(15, (0, 50), feed=1500.0, sensitive="parallel"),
        rotary("C", 0, 360, (150, 0), feed=2000.0),
        rotary("C", 360, 0, (150, 0), feed=2000.0),
    ],
    "short": [
        *_both(cone, 15, (0, 0), feed=2400.0),
        cone(45, (50, 0), feed=2400.0),
        circle("XY", "CW", 2400.0, (50, 0)),
        cone(15, (0, 50), feed=3000.0, sensitive="parallel"),
    ],
    "quick": [
        cone(15, (40, 0), feed=3000.0),
        cone(45, (40, 0), "CW", feed=3000.0),
        circle("ZX", "CCW", 3000.0, (40, 0)),
        rotary("C", 0, 360, (110, 0), feed=3000.0),
    ],
    "sparse-cones": [cone(15, (0, 0), feed=1500.0), cone(45, (50, 0), "CW", feed=1500.0)],
    "sparse-mixed": [
        cone(15, (50, 0), feed=1800.0),
        circle("XY", "CW", 2400.0, (50, 0)),
        rotary("C", 0, 360, (150, 0), feed=2400.0),
    ],
    "sparse-circles": [*_both(circle, "XY", feed=2000.0), circle("YZ", "CCW", 2000.0)],
    "mirror": [
        cone(15, (100, 0), feed=2000.0),
        cone(15, (-100, 0), "CW", feed=2000.0),
        cone(15, (0, 100), feed=2000.0),
        cone(15, (0, -100), "CW", feed=2000.0),
        cone(30, (60, -60), feed=2000.0),
        circle("ZX", "CW", 1500.0),
        rotary("A", 0, 90, (0, 0), feed=2000.0),
    ],
}
LAYOUTS = tuple(n for n in _TESTS if n != "full")


@functools.cache
def _arranged(name: str) -> tuple[dict, ...]:
    return tuple(arrange(_TESTS[name]))


def layout(name: str) -> list[dict]:
    """The tests of a layout, as in campaign.toml."""
    return [dict(t) for t in _arranged(name)]
