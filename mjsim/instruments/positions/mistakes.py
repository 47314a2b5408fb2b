"""What is wrong with a file of readings: unit, direction, single readings, positions in the place of deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mjsim.instruments.base import Mistake
from mjsim.instruments.positions.measurement import PositionTest, Reader, Readings
from mjsim.units import DEG, MM

#: Deviations that no unit but a wrong one makes, m and rad: beyond any machine.
_HUGE_LENGTH, _HUGE_ANGLE = 5.0 * MM, 1.0 * DEG
#: Deviations that repeat better than this, or all lie within ten times of it, are those of no machine, m and rad: air
#: alone does more to a laser.
_SMALL_LENGTH, _SMALL_ANGLE = 2e-9, 2e-9
#: Targets of a linear axis that lie within this are in another unit, m: less than a turn of any screw.
_NARROW = 1.0 * MM
#: How far beyond the ends of a diagonal a target may be, m: ends are rounded.
_BEYOND = 1.0 * MM
#: A reading that is off the others of its target and side by so many times their scatter was not one of them: normal
#: readings do it once in 10⁹ (the scatter is that of the median, so it holds with an outlier too).
_FAR = 6.0
#: Scatter below which readings only repeat the resolution, m and rad.
_FINEST = 0.05e-6


def position_mistakes(tests: Sequence[PositionTest], recordings: Mapping[str, Readings]) -> list[Mistake]:
    """Mistakes of all tests, in the order in which they are put right."""
    out = []
    for t in tests:
        r = recordings[t.name]
        out += _target_mistakes(t, r) or _size_mistakes(t, r) or _direction_mistakes(t, r) or _outliers(t, r)
    return out


def position_remarks(tests: Sequence[PositionTest], recordings: Mapping[str, Readings], data: Reader) -> list[Mistake]:
    """Play that is negative: a control's compensation that is too large, or a sign."""
    out = []
    for t in tests:
        r = recordings[t.name]
        if not t.positioning or len(np.unique(r.side)) < 2:
            continue
        up, down = r.deviation[r.side > 0], r.deviation[r.side < 0]
        gap = float(up.mean() - down.mean())
        same = np.intersect1d(np.round(r.target[r.side > 0], 7), np.round(r.target[r.side < 0], 7))
        sure = 3.0 * data.noise(t, r) * np.sqrt(1.0 / len(up) + 1.0 / len(down))
        if len(same) and gap > sure:
            size, unit = gap / t.channel.size, t.channel.unit
            out.append(
                Mistake(
                    "reversal",
                    (t.name,),
                    f"{t.name}: readings from below are {size:.3g} {unit} larger than those from above; play makes "
                    "them smaller. The control's backlash compensation is too large, or deviation or direction has "
                    "the opposite sign",
                )
            )
    return out


def _target_mistakes(t: PositionTest, r: Readings) -> list[Mistake]:
    spread = float(np.ptp(r.target))
    if t.ends and (r.target.min() < -_BEYOND or r.target.max() > t.length + _BEYOND):
        found = f"{t.name}: targets of {r.target.min() / MM:g} to {r.target.max() / MM:g} mm on a diagonal of "
        found += f"{t.length / MM:.4g} mm; target_mm counts along the line, from where from_mm says"
        return [Mistake("target", (t.name,), found)]
    if not t.rotary and spread < _NARROW:
        found = f"{t.name}: all targets lie within {spread / MM:.3g} mm"
        return [Mistake("target_unit", (t.name,), f"{found}; write them in mm, not in m")]
    if t.rotary and spread > 0.0:
        # round numbers of degrees that were written in radians: every target is a multiple of 0.5° if it is one
        as_degrees = r.target / DEG / DEG  # the numbers of the file, taken for radians, in degrees
        fit = np.abs(2.0 * as_degrees - np.round(2.0 * as_degrees))
        plain = r.target / DEG
        if fit.max() < 0.01 and np.abs(2.0 * plain - np.round(2.0 * plain)).max() > 0.05:
            found = f"{t.name}: the targets are multiples of half a degree if they are in rad"
            return [Mistake("target_unit", (t.name,), f"{found}; write them in degrees")]
    return []


def _size_mistakes(t: PositionTest, r: Readings) -> list[Mistake]:
    size, unit = t.channel.size, t.channel.unit
    huge, small = (_HUGE_ANGLE, _SMALL_ANGLE) if t.angular else (_HUGE_LENGTH, _SMALL_LENGTH)
    largest, spread = float(np.abs(r.deviation).max()), float(np.ptp(r.deviation))
    said = f"{t.name}: the deviations are up to {largest / size:.4g} {unit}"
    if t.positioning and spread > 0.0:
        # measured positions: the deviations follow the targets one to one, with any unit of theirs
        slope, _ = np.polyfit(r.target, r.deviation, 1) if np.ptp(r.target) > 0.0 else (0.0, 0.0)
        rest = r.deviation - r.deviation.mean() - slope * (r.target - r.target.mean())
        if abs(slope) > 0.01 and np.std(rest) < 0.1 * np.std(r.deviation):
            return [
                Mistake(
                    "positions",
                    (t.name,),
                    f"{said} and grow with the target, by {slope:.4g} of it; write measured less target, not the "
                    "measured position, and check both units",
                )
            ]
    if largest > huge:
        return [Mistake("unit", (t.name,), f"{said}, more than any machine has; check the unit of the column")]
    squares, freedom = r.scatter
    repeats = float(np.sqrt(squares / freedom)) if freedom else 0.0
    if spread < 10.0 * small or 0.0 < repeats < small:
        named = f"repeat within {repeats / size:.2g} {unit}" if repeats else f"lie within {spread / size:.2g} {unit}"
        found = f"{t.name}: the deviations {named}, which no machine does"
        return [Mistake("unit", (t.name,), f"{found}; write them in {unit}, not in a larger unit")]
    return []


def _direction_mistakes(t: PositionTest, r: Readings) -> list[Mistake]:
    """Directions that are not those of the order of the targets, where that is the order of measuring.

    A table may be sorted by target: then readings from either side stand in the same order, which says nothing.
    """
    ways = []  # of each run and side: which way its targets follow one another
    for run in np.unique(r.run):
        for side in (1.0, -1.0):
            step = np.diff(r.target[(r.run == run) & (r.side == side)])
            step = step[np.abs(step) > 1e-9]
            if len(step) > 1:
                ways.append((side, bool((step > 0).all()), bool((step < 0).all()), run))
    said = "correct the column direction: 1 where the last move was towards larger positions"
    for side, up, down, run in ways:
        if not up and not down and len(np.unique(r.side[r.run == run])) == 1:
            step = np.diff(r.target[(r.run == run) & (r.side == side)])
            turns = int((np.diff(np.sign(step[step != 0.0])) != 0).sum())
            if turns == 1:
                found = f"{t.name}: in run {run:g} the targets go up and down, but direction is {side:g} throughout"
                return [Mistake("direction", (t.name,), f"{found}; {said}")]
    forward = [(u, d) for s, u, d, _ in ways if s > 0]
    backward = [(u, d) for s, u, d, _ in ways if s < 0]
    if forward and all(d for _, d in forward) and all(u for u, _ in backward):
        found = f"{t.name}: the targets fall where direction is 1"
        found += " and grow where it is -1" if backward else ""
        return [Mistake("direction", (t.name,), f"{found}; {said}")]
    return []


def _outliers(t: PositionTest, r: Readings) -> list[Mistake]:
    """Readings far off the others of their target and side."""
    count = np.bincount(r.place)
    median = np.array([np.median(r.deviation[r.place == p]) for p in range(len(count))])
    off = r.deviation - median[r.place]
    repeated = count[r.place] > 2
    if repeated.sum() < 10:
        return []
    # of n repeats about their own median the middle one is 0: the others alone say how they scatter
    others = np.abs(off[repeated])
    scatter = max(1.4826 * float(np.median(others[others > 0.0])) if (others > 0.0).any() else 0.0, _FINEST)
    far = np.flatnonzero(repeated & (np.abs(off) > _FAR * scatter))
    if not len(far):
        return []
    i = int(far[np.argmax(np.abs(off[far]))])
    unit, place = ("°", DEG) if t.rotary else ("mm", MM)
    more = f" (and {len(far) - 1} more like it)" if len(far) > 1 else ""
    return [
        Mistake(
            "outlier",
            (t.name,),
            f"{t.name}: the reading at {r.target[i] / place:g} {unit} in run {r.run[i]:g}, direction {r.side[i]:g}, is "
            f"{off[i] / t.channel.size:.3g} {t.channel.unit} off the others there, which scatter by "
            f"{scatter / t.channel.size:.2g}{more}; measure again, or take the row out",
        )
    ]
