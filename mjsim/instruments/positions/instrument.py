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
from mjsim.instruments.positions.iso230_2 import REVERSAL, SYSTEMATIC, positioning_figures
from mjsim.instruments.positions.measurement import PositionTest, Reader, Readings, stops_of
from mjsim.instruments.positions.mistakes import position_mistakes, position_remarks
from mjsim.instruments.positions.plan import proposals
from mjsim.instruments.schema import GainUncertainty, OwnLength
from mjsim.machine.chain import COORDINATES, Chain
from mjsim.machine.kinematics import Geometry, bar_vector
from mjsim.units import DEG, MM, UM

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
