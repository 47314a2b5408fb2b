"""Targets of an axis by ISO 230-2:2014, clause 5.3; and tests that a plan looks at."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mjsim.instruments.positions.files import components_of
from mjsim.instruments.positions.measurement import PositionTest
from mjsim.machine.chain import COORDINATES, Chain, usual_travel
from mjsim.units import DEG, MM

#: Fewest targets of a linear axis, and of one metre of it.
_FEWEST, _PER_METRE = 5, 5
#: Fewest targets of a rotary axis by its range, rad.
_ROTARY = ((90.0 * DEG, 3), (180.0 * DEG, 5), (math.inf, 8))
#: Parts of a period by which one target after the other is moved: the golden ratio meets every phase.
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
#: Distance of a second line from the first, m; digits of a target, of its unit (mm or °).
_BESIDE, _DIGITS = 200.0 * MM, 3


def fewest_targets(rotary: bool, way: float) -> int:
    """How many targets the standard asks for.

    Args:
        rotary: Whether the axis turns.
        way: Range of the test, m or rad.
    """
    if rotary:
        return next(n for end, n in _ROTARY if way <= end + 1e-9)
    return max(_FEWEST, math.ceil(_PER_METRE * way - 1e-9))


def targets_over(low: float, high: float, count: int, period: float) -> np.ndarray:
    """Targets P_i = (i − 1) p + r from one end to the other, none in step with a periodic error.

    Args:
        low: First end, m or rad.
        high: Other end.
        count: How many.
        period: Of a periodic error, such as the lead of a screw, m or rad.

    Returns:
        (count,) m or rad, growing.
    """
    even = np.linspace(low, high, count)
    step = min(period, 0.8 * (even[1] - even[0]))
    phase = np.mod(_GOLDEN * np.arange(count), 1.0) - 0.5
    phase[0], phase[-1] = max(phase[0], 0.0), min(phase[-1], 0.0)
    return np.clip(even + step * phase, low, high)


def planned_test(
    name: str,
    axis: str,
    component: str,
    chain: Chain,
    ends: tuple[float, float],
    period: float,
    count: int | None = None,
    line: tuple[float, ...] = (0.0, 0.0, 0.0),
) -> PositionTest:
    """A test with its targets.

    Args:
        name: Of the test.
        axis: Letter of the axis.
        component: What is measured, by its name in ISO 230-1.
        chain: Axes of the machine.
        ends: Of the range, m or rad.
        period: Of a periodic error of the axis, m or rad.
        count: Of the targets; without it as few as the standard allows.
        line: Where the moving optics is while all axes are at 0, (3,) m.
    """
    test = PositionTest(name, axis, component, (line[0], line[1], line[2]), setup=name, chain=chain)
    count = count or fewest_targets(test.rotary, ends[1] - ends[0])
    targets = np.round(targets_over(*ends, count, period) / test.unit, _DIGITS) * test.unit
    return replace(test, targets=tuple(float(v) for v in targets))


def proposals(chain: Chain, periods: Mapping[str, float]) -> list[PositionTest]:
    """Tests over the usual travel: positioning along three lines, straightness and angles of linear axes; positioning
    of rotary axes.

    Args:
        chain: Axes of the machine.
        periods: Of each axis' periodic error, m or rad.
    """
    out, travel = [], dict(zip(chain.letters, usual_travel(chain), strict=True))
    for a in chain.linear:
        ends = (float(travel[a][0]), float(travel[a][1]))
        first, *others = components_of(chain, a)
        lines = {"": (0.0, 0.0, 0.0)}
        if chain.spatial:
            across = [c for c in COORDINATES if c != a]
            lines |= {f"-{c.lower()}{_BESIDE / MM:.0f}": tuple(_BESIDE * (k == c) for k in COORDINATES) for c in across}
        for suffix, line in lines.items():
            out.append(planned_test(f"laser-{a.lower()}{suffix}", a, first, chain, ends, periods[a], line=line))
        out += [planned_test(c.lower(), a, c, chain, ends, periods[a]) for c in others]
    for a in chain.rotary:
        whole = a in chain.round_axes
        ends = (0.0, 2.0 * math.pi) if whole else (float(travel[a][0]), float(travel[a][1]))
        out.append(planned_test(f"calibrator-{a.lower()}", a, f"E{a}{a}", chain, ends, periods[a]))
    return out
