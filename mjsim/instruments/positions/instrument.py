"""Laser, scale, rotary calibrator and level as an instrument of a campaign."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field

from mjsim.errors import InputError
from mjsim.instruments.base import Channel, Instrument, Mistake, Nuisances, Observation, Over, Stops, register
from mjsim.instruments.positions.measurement import READING_TIME, PositionTest, Reader, Readings, sides_of, stops_of
from mjsim.instruments.schema import Clock, GainUncertainty, Length, OwnLength, Table, printable
from mjsim.io.inputs import check_columns, csv_table, need_columns, shown
from mjsim.io.times import check_growing
from mjsim.machine.chain import COORDINATES, Chain, usual_travel
from mjsim.machine.kinematics import Geometry, bar_vector
from mjsim.units import DEG, MM, UM

# -- position tests of a campaign --------------------------------------------------------------------------------------

#: Fewest readings of a test.
FEWEST = 3
#: Columns of the deviation, each with its SI unit.
LENGTHS = {"deviation_um": UM}
ANGLES = {"deviation_urad": 1e-6, "deviation_arcsec": DEG / 3600.0}
#: Most runs that may stand side by side in another system's table.
MOST_RUNS = 10
#: Words of headers of other systems, lower case and without units.
_WORDS = {
    "target": (
        "target",
        "targets",
        "nominal",
        "position",
        "pos",
        "soll",
        "sollposition",
        "command",
        "commanded",
        "set",
    ),
    "deviation": ("deviation", "dev", "error", "err", "abweichung", "abw", "diff", "difference", "delta"),
    "measured": ("measured", "actual", "actual position", "ist", "istposition", "laser", "reading"),
    "direction": ("direction", "dir", "richtung", "side"),
    "run": ("run", "cycle", "lauf", "zyklus"),
    "time": ("time", "t", "zeit"),
    "temperature": ("temperature", "temp", "temperatur", "material temperature", "temperature degc"),
}
_SIDES = {"up": ("up", "+", "↑", "forward", "fwd", "vor"), "down": ("down", "-", "↓", "backward", "bwd", "zurück")}
#: Words that may stand beside side and number of a run.
_BESIDE_RUNS = (
    "run",
    "cycle",
    "lauf",
    "zyklus",
    "deviation",
    "dev",
    "error",
    "um",
    "µm",
    "mm",
    "urad",
    "µrad",
    "arcsec",
)
_SIGN = {"up": 1.0, "down": -1.0}
#: Columns that a file may have besides target and deviation.
MORE = ("run", "direction", "time_s", "temperature_degC")

Angle = Annotated[float, Field(ge=-100_000, le=100_000, allow_inf_nan=False)]


class PositionTable(Table):
    """A ``[[test]]`` table of target positions."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=100)]
    kind: Literal["positions"]
    axis: str
    component: str | None = None
    from_mm: dict[str, Length] = Field(default={})
    to_mm: dict[str, Length] = Field(default={})
    line_mm: Annotated[list[Length], Field(min_length=3, max_length=3)] = Field(default=[0.0, 0.0, 0.0])
    at_mm: dict[str, Length] = Field(default={})
    dead_path_mm: Annotated[float, Field(ge=0, le=100_000)] = 0.0
    setup: Annotated[str, Field(max_length=200), AfterValidator(printable)] | None = None
    trace: str | None = None
    targets_mm: Annotated[list[Length], Field(max_length=1000)] = Field(default=[])
    targets_deg: Annotated[list[Angle], Field(max_length=1000)] = Field(default=[])
    runs: Annotated[int, Field(ge=1, le=100)] = 5
    started_s: Clock = 0.0


def components_of(chain: Chain, axis: str) -> tuple[str, ...]:
    """What can be measured of an axis, positioning first."""
    own = f"E{axis}{axis}"
    if chain.is_rotary(axis) or not chain.spatial:
        return (own,)
    return (own, *(n for n in (*chain.straightness, *chain.angular) if n[2] == axis))


def position_test(file: Path, t: PositionTable, chain: Chain) -> PositionTest:
    """The test that a ``[[test]]`` table describes.

    Args:
        file: Where it stands.
        t: The table.
        chain: Axes of the machine.

    Raises:
        InputError: The machine has no such axis, or the axis no such component.
    """
    place = f'{file}: [[test]] "{t.name}"'
    ends = _ends(place, t, chain)
    if not ends and t.axis not in chain.letters:
        raise InputError(f"{place}: axis = {shown(t.axis)}; allowed: {', '.join(chain.letters)}")
    components = (along(ends),) if ends else components_of(chain, t.axis)
    component = t.component or components[0]
    if component not in components:
        raise InputError(f"{place}: component = {shown(component)}; allowed for {t.axis}: {', '.join(components)}")
    rotary = not ends and chain.is_rotary(t.axis)
    wrong, right = ("targets_mm", "targets_deg") if rotary else ("targets_deg", "targets_mm")
    if getattr(t, wrong):
        raise InputError(f"{place}: {wrong}; allowed for {t.axis}: {right}")
    if rotary and t.dead_path_mm:
        raise InputError(f"{place}: dead_path_mm = {t.dead_path_mm:g}; allowed for {t.axis}: none, as it turns")
    others = [a for a in chain.linear if a not in t.axis]
    for letter in t.at_mm:
        if letter not in others:
            raise InputError(f"{place}: at_mm names {shown(letter)}; allowed: {', '.join(others) or 'none'}")
    unit = DEG if rotary else MM
    x, y, z = (v * MM for v in t.line_mm)
    return PositionTest(
        t.name,
        t.axis,
        component,
        (x, y, z),
        tuple((a, v * MM) for a, v in t.at_mm.items()),
        t.dead_path_mm * MM,
        t.setup or t.name,
        t.trace,
        chain,
        tuple(v * unit for v in getattr(t, right)),
        t.runs,
        t.started_s,
        ends,
    )


def along(ends: tuple[tuple[str, float, float], ...]) -> str:
    """What is measured of a diagonal: ``D`` and its axes, with a minus behind those that go down."""
    return "D" + "".join(a if last > first else f"{a}-" for a, first, last in ends)


def _ends(place: str, t: PositionTable, chain: Chain) -> tuple[tuple[str, float, float], ...]:
    """The axes of a diagonal with both ends, m; none where one axis moves.

    Raises:
        InputError: The ends are not of the axes that move, or an axis does not move.
    """
    if len(t.axis) < 2 and not t.from_mm and not t.to_mm:
        return ()
    letters = tuple(t.axis)
    known = set(letters) <= set(chain.linear) and len(set(letters)) == len(letters)
    if len(letters) < 2 or not known or not chain.spatial:
        allowed = f"two or more of {', '.join(chain.linear)}, each once" if chain.spatial else "one axis"
        raise InputError(f"{place}: axis = {shown(t.axis)} with from_mm and to_mm; allowed: {allowed}")
    for key, given in (("from_mm", t.from_mm), ("to_mm", t.to_mm)):
        if set(given) != set(letters):
            said = ", ".join(given) or "nothing"
            raise InputError(f"{place}: {key} names {said}; allowed of a diagonal: each of {', '.join(letters)}")
    for letter in letters:
        if t.from_mm[letter] == t.to_mm[letter]:
            at = f"{letter} is at {t.from_mm[letter]:g} mm at both ends"
            raise InputError(f"{place}: {at}; allowed: axes that move, others in at_mm")
    return tuple((a, t.from_mm[a] * MM, t.to_mm[a] * MM) for a in letters)


def target_column(test: PositionTest) -> str:
    """Name of the column of the targets."""
    return "target_deg" if test.rotary else "target_mm"


def deviation_columns(test: PositionTest) -> dict[str, float]:
    """Names that the column of the deviations may have, each with its SI unit; the first is ours."""
    return ANGLES if test.angular else LENGTHS


def read_readings(path: Path, test: PositionTest) -> Readings:
    """Read the CSV of one test, plain or compressed (``.csv.gz``).

    Args:
        path: The file.
        test: What it is to hold.

    Raises:
        InputError: Names the file, the line or column, what was found and what is allowed.
    """
    names, table, lines = csv_table(path, lambda names: _check_header(path, names, test))
    if len(table) < FEWEST:
        raise InputError(f"{path}: {len(table)} readings; allowed: at least {FEWEST}")
    return readings_of(path, dict(zip(names, table.T, strict=True)), lines, test)


def _check_header(path: Path, names: list[str], test: PositionTest) -> None:
    """Refuse columns that are missing, unknown or double."""
    units = deviation_columns(test)
    check_columns(path, names, [target_column(test), *units, *MORE], test.component)
    need_columns(path, names, [target_column(test)])
    if len([n for n in names if n in units]) != 1:
        raise InputError(f"{path}, line 1: allowed: one column of {' or '.join(units)}")


def readings_of(path: Path, column: dict[str, np.ndarray], lines: np.ndarray, test: PositionTest) -> Readings:
    """Readings from columns of numbers.

    Args:
        path: Of the file, for messages.
        column: By name, as in a trace, (n,) each.
        lines: Of the rows in the file, (n,).
        test: What it is of.

    Raises:
        InputError: A clock runs backwards, a side is neither +1 nor -1, or a temperature is none of a shop.
    """
    target = column[target_column(test)] * test.unit
    name = next(n for n in deviation_columns(test) if n in column)
    side = column.get("direction")
    if side is None:
        side = sides_of(target)
    elif wrong := np.flatnonzero(~np.isin(side, (-1.0, 1.0))).tolist():
        raise InputError(
            f"{path}, line {lines[wrong[0]]}: direction = {side[wrong[0]]:g}; allowed: 1 where the last move was "
            "towards larger positions, -1 where towards smaller ones"
        )
    run = column.get("run")
    if run is None:
        run = _runs(target, side)
    n = len(target)
    timed = "time_s" in column
    time = column["time_s"] if timed else READING_TIME * np.arange(n)
    if timed:
        check_growing(path, time, lambda i: int(lines[i]))
    temperature = column.get("temperature_degC")
    if temperature is not None and (wrong := np.flatnonzero(np.abs(temperature - 25.0) > 75.0).tolist()):
        raise InputError(
            f"{path}, line {lines[wrong[0]]}: temperature_degC = {temperature[wrong[0]]:g}; allowed: -50 to 100"
        )
    deviation = column[name] * deviation_columns(test)[name]
    return Readings(target, deviation, side, run, time, timed, temperature)


def _runs(target: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Number of the repetition of each reading: how often its target was there before from that side."""
    seen: dict[tuple[float, float], int] = {}
    out = []
    for key in zip(np.round(target, 9).tolist(), side.tolist(), strict=True):
        seen[key] = seen.get(key, 0) + 1
        out.append(float(seen[key]))
    return np.array(out)


def trace_text(test: PositionTest, readings: Readings) -> str:
    """A trace as :func:`read_readings` reads it."""
    name, size = next(iter(deviation_columns(test).items()))
    columns = [
        (target_column(test), readings.target / test.unit, "%.6f"),
        ("run", readings.run, "%.0f"),
        ("direction", readings.side, "%.0f"),
        (name, readings.deviation / size, "%.4f"),
    ]
    if readings.timed:
        columns.append(("time_s", readings.time, "%.3f"))
    if readings.temperature is not None:
        columns.append(("temperature_degC", readings.temperature, "%.3f"))
    rows = zip(*([form % v for v in values] for _, values, form in columns), strict=True)
    return "\n".join([",".join(n for n, _, _ in columns), *(",".join(r) for r in rows), ""])


# -- targets of an axis by ISO 230-2:2014, clause 5.3; and tests that a plan looks at ----------------------------------

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
    return _with_targets(test, ends, count, period)


def planned_diagonal(
    name: str,
    ends: tuple[tuple[str, float, float], ...],
    chain: Chain,
    periods: Mapping[str, float],
    count: int | None = None,
) -> PositionTest:
    """A test along a diagonal with its targets, as many as of an axis of its length.

    Args:
        name: Of the test.
        ends: Letter of every axis that moves, where it is at the beginning, and where at the end, m.
        chain: Axes of the machine.
        periods: Of each axis' periodic error, m or rad.
        count: Of the targets; without it as few as the standard allows.
    """
    letters = "".join(a for a, _, _ in ends)
    test = PositionTest(name, letters, along(ends), setup=name, chain=chain, ends=ends)
    longest = max(periods[a] / abs(float(test.way[chain.index(a)])) for a in letters)  # along the line
    return _with_targets(test, (0.0, test.length), count, longest)


def _with_targets(test: PositionTest, ends: tuple[float, float], count: int | None, period: float) -> PositionTest:
    count = count or fewest_targets(test.rotary, ends[1] - ends[0])
    targets = np.round(targets_over(*ends, count, period) / test.unit, _DIGITS) * test.unit
    return replace(test, targets=tuple(float(v) for v in targets))


def proposals(chain: Chain, periods: Mapping[str, float]) -> list[PositionTest]:
    """Tests over the usual travel: positioning along three lines, straightness and angles of linear axes; face and body
    diagonals; positioning of rotary axes.

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
    for count in range(2, len(chain.linear) + 1) if chain.spatial else ():
        for letters in itertools.combinations(chain.linear, count):
            for down in itertools.product((False, True), repeat=count - 1):  # the first axis goes up
                turned = tuple(
                    (a, float(travel[a][int(d)]), float(travel[a][1 - d]))
                    for a, d in zip(letters, (False, *down), strict=True)
                )
                name = "diagonal-" + along(turned)[1:].lower().replace("-", "m")
                out.append(planned_diagonal(name, turned, chain, periods))
    for a in chain.rotary:
        whole = a in chain.round_axes
        ends = (0.0, 2.0 * math.pi) if whole else (float(travel[a][0]), float(travel[a][1]))
        out.append(planned_test(f"calibrator-{a.lower()}", a, f"E{a}{a}", chain, ends, periods[a]))
    return out


# -- accuracy and repeatability of positioning by ISO 230-2:2014, clause 3 ---------------------------------------------
# At target i, x̄_i↑ and x̄_i↓ are the mean deviations from either side, s_i↑ and s_i↓ the standard uncertainties
# (estimators of the standard deviation, n − 1). B_i = x̄_i↑ − x̄_i↓, x̄_i is the mean of both. Then
#
#     R_i↑ = 4 s_i↑                   R_i = max(2 s_i↑ + 2 s_i↓ + |B_i|, R_i↑, R_i↓)      R = max R_i
#     E↑ = max x̄_i↑ − min x̄_i↑        E = max(x̄_i↑, x̄_i↓) − min(x̄_i↑, x̄_i↓)             M = max x̄_i − min x̄_i
#     A↑ = max(x̄_i↑ + 2 s_i↑) − min(x̄_i↑ − 2 s_i↑)      A the same over both sides            B = max |B_i|

#: Names of the figures: accuracy, repeatability, systematic error, mean systematic error, reversal error.
ACCURACY, REPEATABILITY, SYSTEMATIC, MEAN, REVERSAL = "AREMB"
#: Words for the sides in names of figures.
SIDES = {1.0: "forward", -1.0: "backward"}


def positioning_figures(target: np.ndarray, side: np.ndarray, deviation: np.ndarray) -> dict[str, float]:
    """Figures of one test, in the unit of the deviations; those that its readings do not give are left out.

    Args:
        target: Commanded positions, (n,).
        side: Side of approach, +1 or -1, (n,).
        deviation: Actual less commanded, (n,).

    Returns:
        ``A``, ``R``, ``E``, ``M``, ``B``, ``B_mean`` (the mean of B_i, with its sign), and ``A``, ``R`` and ``E`` of
        one side with its word. ``R`` and ``A`` need every target twice from each side.
    """
    places, index = np.unique(np.round(target, 9), return_inverse=True)
    mean: dict[float, np.ndarray] = {}
    spread: dict[float, np.ndarray] = {}
    for s in SIDES:
        rows = [deviation[(index == i) & (side == s)] for i in range(len(places))]
        if all(len(r) for r in rows):
            mean[s] = np.array([r.mean() for r in rows])
            if all(len(r) > 1 for r in rows):
                spread[s] = np.array([r.std(ddof=1) for r in rows])
    out: dict[str, float] = {}
    for s, word in SIDES.items():
        if s in mean:
            out[f"{SYSTEMATIC}_{word}"] = float(np.ptp(mean[s]))
        if s in spread:
            out[f"{REPEATABILITY}_{word}"] = float(4.0 * spread[s].max())
            out[f"{ACCURACY}_{word}"] = float((mean[s] + 2.0 * spread[s]).max() - (mean[s] - 2.0 * spread[s]).min())
    if len(mean) == 2:
        up, down = mean.values()
        out[SYSTEMATIC] = float(max(up.max(), down.max()) - min(up.min(), down.min()))
        out[MEAN] = float(np.ptp(0.5 * (up + down)))
        out[REVERSAL] = float(np.abs(up - down).max())
        out[f"{REVERSAL}_mean"] = float((up - down).mean())
    if len(spread) == 2:
        (up, down), (s_up, s_down) = mean.values(), spread.values()
        both = 2.0 * s_up + 2.0 * s_down + np.abs(up - down)
        out[REPEATABILITY] = float(np.max([both, 4.0 * s_up, 4.0 * s_down]))
        high, low = np.append(up + 2.0 * s_up, down + 2.0 * s_down), np.append(up - 2.0 * s_up, down - 2.0 * s_down)
        out[ACCURACY] = float(high.max() - low.min())
    order = [
        n + w for n in (ACCURACY, REPEATABILITY, SYSTEMATIC) for w in ("", *(f"_{word}" for word in SIDES.values()))
    ]
    return {n: out[n] for n in (*order, MEAN, REVERSAL, f"{REVERSAL}_mean") if n in out}


# -- what is wrong with a file of readings -----------------------------------------------------------------------------

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


#: Prior standard deviation of a zero, m and rad: it is arbitrary.
ZERO = 1.0 * MM
#: Prior standard deviation of the inclination of a straightedge or beam to the axis, rad.
SLOPE = 1e-3
#: Prior standard deviation of the expansion of an axis and of the air, relative, where nothing is compensated and no
#: temperature is recorded: a steel axis in a shop within ± 3 K of 20 °C (assumed).
EXPANSION = 20e-6
#: The same where the temperature is recorded, 1/K: steel less air is 11e-6, aluminium 22e-6, a glass scale 7e-6.
EXPANSION_PER_K = 12e-6
#: Distance to the point about which an axis grows, m (assumed).
FIXED_POINT = 1.0
#: Air: change of the wavelength with the temperature, 1/K (Edlén's equation), and how much that changes, K/h (assumed).
AIR_PER_K, AIR_RATE = 0.93e-6, 1.0
#: Reference temperature of lengths, °C (ISO 1).
REFERENCE = 20.0


@register
class Positions(Instrument[PositionTest, Readings]):
    """What one axis is off its targets, read while the machine stands still."""

    name = PositionTest.instrument
    noun = "laser or level"
    test_noun = "position test"
    beside = "position_tests"
    order = 3
    at_rest = True
    plan_option = "--targets AXIS"
    usual = Reader(compensated=True)
    handling = 1200.0  # a laser is to be aligned (assumed)
    by_itself_noun = "from the means"
    by_itself_note = (
        "From the means: scale error as the slope of all deviations, backlash as the mean reversal error of ISO 230-2, "
        "with every other error and the instrument taken for perfect."
    )
    own_keys: ClassVar[Mapping[str, tuple[Any, Any]]] = {
        "repeatability_um": (OwnLength, None),
        "repeatability_urad": (OwnLength, None),
        "gain_uncertainty_ppm": (GainUncertainty, None),
        "compensated": (bool, False),
    }

    def kinds(self) -> Sequence[str]:
        return (self.name,)

    def table(self, chain: Chain) -> type[PositionTable]:
        return PositionTable

    def test_of(self, file: Path, table: PositionTable, chain: Chain) -> PositionTest:
        return position_test(file, table, chain)

    def data_of(self, table: Any) -> Reader:
        length, angle, gain = table.repeatability_um, table.repeatability_urad, table.gain_uncertainty_ppm
        return Reader(
            None if length is None else length * UM,
            None if angle is None else angle * 1e-6,
            1e-6 if gain is None else 0.5 * gain * 1e-6,
            table.compensated,
        )

    def known_from(self, data: Reader, recordings: Mapping[str, Readings]) -> Reader:
        return replace(data, repeats=sum(r.scatter[1] for r in recordings.values()))

    def read(self, path: Path, test: PositionTest, data: Reader) -> Readings:
        return read_readings(path, test)

    def file_columns(self, test: PositionTest) -> dict[str, tuple[str, str]]:
        """``up_1``, ``down_1`` and so on are deviations of one run from one side, where each row is a target."""
        place = ("angle", "deg") if test.rotary else ("deviation", "mm")
        off = ("angle", "urad") if test.angular else ("deviation", "um")
        runs = {f"{side}_{k}": off for k in range(1, MOST_RUNS + 1) for side in _SIDES}
        more = {"direction": ("", ""), "run": ("", ""), "time": ("time", "s"), "temperature": ("", "")}
        return {"target": place, "deviation": off, **({"measured": place} if test.positioning else {}), **more, **runs}

    def column_named(self, test: PositionTest, header: str, word: str) -> str:
        parts = re.findall(r"\d+|[^\W\d_]+|[-+↑↓]", re.sub(r"[\[(<].*?[\])>]", "", header).lower())
        parts = [p for p in parts if p not in _BESIDE_RUNS]
        numbers = [int(p) for p in parts if p.isdigit()]
        sides = [side for side, words in _SIDES.items() for p in parts if p in words]
        if len(parts) == 2 and len(numbers) == len(sides) == 1:
            return f"{sides[0]}_{numbers[0]}"
        word = word.replace("_", " ").strip()
        return next((name for name, words in _WORDS.items() if word in words), "")

    def missing_columns(self, test: PositionTest, have: Collection[str]) -> list[str]:
        lacking = [] if "target" in have else ["target"]
        found = {"deviation", "measured"} & set(have) or [n for n in have if n.partition("_")[0] in _SIDES]
        return lacking + ([] if found else ["deviation or measured"])

    def from_columns(
        self, source: Path, test: PositionTest, columns: dict[str, np.ndarray]
    ) -> tuple[Readings, list[str]]:
        """Runs that stand side by side are put one after another."""
        wide = [n for n in columns if n.partition("_")[0] in _SIDES]
        notes, lines = [], np.arange(1, len(columns["target"]) + 1)
        own, size = next(iter(deviation_columns(test).items()))
        if wide:
            # the order of the standard's cycle: run by run, upwards and then downwards
            ordered = sorted(wide, key=lambda n: (int(n.partition("_")[2]), n.startswith("down")))
            up = np.argsort(columns["target"], kind="stable")
            blocks = [(n, up if n.startswith("up") else up[::-1]) for n in ordered]
            column = {
                target_column(test): np.concatenate([columns["target"][rows] for _, rows in blocks]) / test.unit,
                own: np.concatenate([columns[n][rows] for n, rows in blocks]) / size,
                "direction": np.concatenate([np.full(len(rows), _SIGN[n.partition("_")[0]]) for n, rows in blocks]),
                "run": np.concatenate([np.full(len(rows), float(n.partition("_")[2])) for n, rows in blocks]),
            }
            notes.append(f"one row a target, {len(wide)} columns of deviations")
            lines = np.concatenate([lines[rows] for _, rows in blocks])
            return readings_of(source, column, lines, test), notes
        column = {target_column(test): columns["target"] / test.unit}
        if "deviation" in columns:
            column[own] = columns["deviation"] / size
        else:
            column[own] = (columns["measured"] - columns["target"]) / size
            notes.append("deviation: measured less target")
        for name, ours in (("run", "run"), ("direction", "direction"), ("time", "time_s")):
            if name in columns:
                column[ours] = columns[name]
        if "temperature" in columns:
            column["temperature_degC"] = columns["temperature"]
        if "direction" not in column:
            notes.append("no column for direction: by the order of the targets")
        return readings_of(source, column, lines, test), notes

    def trace_text(self, test: PositionTest, recording: Readings) -> str:
        return trace_text(test, recording)

    def found_columns(self, test: PositionTest) -> Sequence[str]:
        return tuple(deviation_columns(test))[:1]

    def planned_text(self, test: PositionTest) -> str:
        """A trace without what is to be found; along a diagonal with the positions of the axes."""
        if not test.targets:
            return ""
        head, *rows = [line.split(",")[:3] for line in trace_text(test, test.planned).splitlines()]
        for letter, first, _ in test.ends:
            way = test.way[test.chain.index(letter)]
            head.append(f"{letter}_mm")
            for row, target in zip(rows, test.planned.target, strict=True):
                row.append(f"{(first + way * target) / MM:.4f}")
        return "\n".join([*(",".join(r) for r in (head, *rows)), ""])

    def proposals(self, chain: Chain, periods: Mapping[str, float]) -> list[PositionTest]:
        """Of each linear axis its position along three lines, its straightness and its angles; diagonals; of each
        rotary axis its position.
        """
        return proposals(chain, periods)

    def planned_noise(self, test: PositionTest, data: Reader) -> np.ndarray:
        return np.array([data.stated_noise(test)[0]])

    def test_table(self, test: PositionTest) -> dict[str, Any]:
        out: dict[str, Any] = {"name": test.name, "kind": test.kind, "axis": test.axis}
        if not test.positioning:
            out["component"] = test.component
        if test.ends:
            out["from_mm"] = {a: round(first / MM, 4) for a, first, _ in test.ends}
            out["to_mm"] = {a: round(last / MM, 4) for a, _, last in test.ends}
        if not test.rotary:
            out["line_mm"] = [round(v / MM, 4) for v in test.line]
        if test.at:
            out["at_mm"] = {a: round(v / MM, 4) for a, v in test.at}
        targets = [round(float(v) / test.unit, 6) for v in test.targets]
        return out | {"targets_deg" if test.rotary else "targets_mm": targets, "runs": test.runs}

    def facts(self, test: PositionTest, recording: Readings) -> dict[str, Any]:
        ends = float(recording.target.min()) / test.unit, float(recording.target.max()) / test.unit
        return {
            "component": test.component,
            f"{test.axis}_{'deg' if test.rotary else 'mm'}": [round(v, 4) for v in ends],
            "targets": len(np.unique(np.round(recording.target, 9))),
            "runs": len(np.unique(recording.run)),
            "both_sides": len(np.unique(recording.side)) == 2,
        }

    def channels(self, test: PositionTest) -> tuple[Channel, ...]:
        return (test.channel,)

    def observe(self, test: PositionTest, recording: Readings) -> Observation:
        value = recording.deviation[:, None]
        return Observation(recording.time - recording.time[0], value, np.ones(value.shape, bool))

    def stops(self, test: PositionTest, recording: Readings) -> Stops:
        return stops_of(test, recording)

    def reading_at(self, test: PositionTest, position: np.ndarray, geometry: Geometry, stops: Stops) -> np.ndarray:
        """As :meth:`reading`; along a diagonal, how far the optics are apart less how far they should be."""
        if not test.ends:
            return self.reading(test, position, geometry)
        chain, start = test.chain, test.place
        moved = position.copy()
        for column, motion in enumerate(chain.motions[: position.shape[1] - chain.count], start=chain.count):
            moved[:, column] *= motion.axis in test.moving
        told = stops.route[stops.at[:, 0]]
        tool, table = _optics(test, start)
        seen, should = bar_vector(chain, moved, table, geometry, tool), bar_vector(chain, told, table, Geometry(), tool)
        along = bar_vector(chain, (start + test.way)[None], table, Geometry(), tool)[0]
        return ((seen - should) @ (along / np.linalg.norm(along)))[:, None]

    def reading(self, test: PositionTest, position: np.ndarray, geometry: Geometry) -> np.ndarray:
        """What the moving optics is off, or by what the slide has turned; positions are counted from the target."""
        chain, what = test.chain, test.component
        if test.rotary or not chain.spatial:
            return position[:, [chain.index(test.axis)]]
        if test.angular:
            column = chain.columns.index(what)
            return position[:, [column]] if column < position.shape[1] else np.zeros((len(position), 1))
        ideal = test.place
        tip, table = _optics(test, ideal)
        # what other axes add does not change while they stand: it is part of the zero
        moved = position.copy()
        for column, motion in enumerate(chain.motions[: position.shape[1] - chain.count], start=chain.count):
            moved[:, column] *= motion.axis == test.axis
        seen, before = (bar_vector(chain, q, table, geometry, tip) for q in (moved, ideal[None]))
        return (seen - before)[:, [COORDINATES.index(what[1])]]

    def over(self, test: PositionTest, recording: Readings) -> Over:
        sides = tuple("from below" if s > 0 else "from above" for s in recording.side)
        return Over(
            f"{'way along' if test.ends else 'target of'} {test.axis}",
            "°" if test.rotary else "mm",
            recording.target / test.unit,
            sides,
        )

    def nuisances_of(self, test: PositionTest, recording: Readings, time: np.ndarray, data: Reader) -> Nuisances:
        size, suffix = test.channel.size, test.channel.suffix
        way = recording.target - (0.0 if test.rotary else recording.target.mean())
        rows: list[tuple[str, np.ndarray, float]] = [
            (f"{test.component}_zero_{suffix}", np.full(len(way), size), ZERO / size)
        ]
        shared: tuple[str, ...] = ()
        if not test.rotary and not test.angular and not test.positioning:
            rows.append((f"{test.component}_slope_urad", 1e-6 * way, SLOPE / 1e-6))
        if not test.rotary and test.positioning:
            shared = ("gain_ppm",)
            # counted as the axis counts: so it is a scale error, and leaves the zero alone
            rows.append(("gain_ppm", 1e-6 * recording.target, data.gain / 1e-6))
            if not data.compensated:
                rows += _temperature(test, recording, way)
        columns = np.stack([c for _, c, _ in rows], axis=1)[:, None, :]
        return Nuisances(tuple(n for n, _, _ in rows), columns, np.array([s for _, _, s in rows]), shared)

    def noise(self, test: PositionTest, recording: Readings, data: Reader) -> np.ndarray:
        return np.array([data.noise(test, recording)])

    def figures_of(
        self, test: PositionTest, recording: Readings, time: np.ndarray, reading: np.ndarray
    ) -> dict[str, float]:
        """A, R, E, M and B of ISO 230-2; of a diagonal E and B, as ISO 230-6 has them."""
        found = positioning_figures(recording.target, recording.side, reading[:, 0])
        # readings of a model repeat to rounding errors only
        kept = found if not test.ends else {k: v for k, v in found.items() if k[0] in SYSTEMATIC + REVERSAL}
        return {f"{k}_{test.channel.suffix}": round(v / test.channel.size, 6) for k, v in kept.items()}

    def by_itself(self, tests: Sequence[PositionTest], recordings: Mapping[str, Readings]) -> dict[str, float]:
        """Scale error from the line through the mean deviations, and play as the mean reversal error."""
        out: dict[str, float] = {}
        for t in tests:
            r = recordings[t.name]
            if not t.positioning or t.ends:
                continue
            found = positioning_figures(r.target, r.side, r.deviation)
            if f"{REVERSAL}_mean" in found:
                out[f"backlash.{t.axis}"] = -found[f"{REVERSAL}_mean"] / (DEG if t.rotary else UM)
            if not t.rotary and np.ptp(r.target) > 0.0:
                columns = np.column_stack([r.target, np.ones(len(r.target)), r.side])
                out[f"scale_error.{t.axis}"] = float(np.linalg.lstsq(columns, r.deviation, rcond=None)[0][0]) / 1e-6
        return out

    def mistakes(
        self, tests: Sequence[PositionTest], recordings: dict[str, Readings], data: Reader
    ) -> Sequence[Mistake]:
        return position_mistakes(tests, recordings)

    def remarks(
        self, tests: Sequence[PositionTest], recordings: dict[str, Readings], data: Reader
    ) -> Sequence[Mistake]:
        return position_remarks(tests, recordings, data)


def _optics(test: PositionTest, place: np.ndarray) -> tuple[tuple[float, float, float], np.ndarray]:
    """Where the optics are fixed in the spindle's and in the table's frame, (3,) m each, so that both are at the line
    while the axes stand at ``place``.
    """
    tool, table = np.array(test.line), np.array(test.line)
    for letter in test.chain.linear:
        axis, at = test.chain.axis(letter), place[test.chain.index(letter)]
        if letter in [a.letter for a in test.chain.tool]:
            tool = tool - at * np.array(axis.unit)
        else:
            table = table + at * np.array(axis.unit)
    return (float(tool[0]), float(tool[1]), float(tool[2])), table


def _temperature(test: PositionTest, recording: Readings, way: np.ndarray) -> list[tuple[str, np.ndarray, float]]:
    """Nuisances of readings that are not compensated: names, columns in m per unit, prior standard deviations."""
    air = test.dead_path * AIR_PER_K
    if recording.temperature is not None:
        warm = recording.temperature - REFERENCE
        # it grows about a point that nobody knows, so its zero drifts as well, with that of the dead path
        drift = float(np.hypot(EXPANSION_PER_K * FIXED_POINT, air))
        return [
            (f"{test.component}_expansion_ppm_per_K", 1e-6 * way * warm, EXPANSION_PER_K / 1e-6),
            (f"{test.component}_drift_um_per_K", UM * (warm - warm[0]), drift / UM),
        ]
    out = [(f"{test.component}_expansion_ppm", 1e-6 * way, EXPANSION / 1e-6)]
    if air and recording.timed:
        hours = (recording.time - recording.time[0]) / 3600.0
        out.append((f"{test.component}_dead_path_um_per_h", UM * hours, air * AIR_RATE / UM))
    return out
