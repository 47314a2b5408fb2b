"""Laser, scale, rotary calibrator and level as an instrument of a campaign."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mjsim.instruments.base import Channel, Instrument, Mistake, Nuisances, Observation, Over, Stops, register
from mjsim.instruments.positions import files
from mjsim.instruments.positions.files import PositionTable, position_test
from mjsim.instruments.positions.measurement import PositionTest, Reader, Readings, stops_of
from mjsim.instruments.positions.plan import proposals
from mjsim.instruments.schema import GainUncertainty, OwnLength
from mjsim.machine.chain import COORDINATES, Chain
from mjsim.machine.kinematics import Geometry, bar_vector
from mjsim.units import DEG, MM, UM

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
        return files.read_readings(path, test)

    def file_columns(self, test: PositionTest) -> dict[str, tuple[str, str]]:
        return files.file_columns(test)

    def column_named(self, test: PositionTest, header: str, word: str) -> str:
        return files.column_named(header, word)

    def missing_columns(self, test: PositionTest, have: Collection[str]) -> list[str]:
        return files.missing_columns(have)

    def from_columns(
        self, source: Path, test: PositionTest, columns: dict[str, np.ndarray]
    ) -> tuple[Readings, list[str]]:
        return files.from_columns(source, test, columns)

    def trace_text(self, test: PositionTest, recording: Readings) -> str:
        return files.trace_text(test, recording)

    def found_columns(self, test: PositionTest) -> Sequence[str]:
        return tuple(files.deviation_columns(test))[:1]

    def planned_text(self, test: PositionTest) -> str:
        return files.targets_text(test)

    def proposals(self, chain: Chain, periods: Mapping[str, float]) -> list[PositionTest]:
        """Of each linear axis its position along three lines, its straightness and its angles; of each rotary axis its
        position.
        """
        return proposals(chain, periods)

    def planned_noise(self, test: PositionTest, data: Reader) -> np.ndarray:
        return np.array([data.stated_noise(test)[0]])

    def test_table(self, test: PositionTest) -> dict[str, Any]:
        return files.test_table(test)

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
