"""The R-test as an instrument of a campaign."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, create_model

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.files import MotionTable, check_duration, check_span, plain, spans_fit
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.kinds.base import Angle
from mjsim.instruments.ball_bar.program import Program
from mjsim.instruments.ball_bar.span import explain
from mjsim.instruments.base import Instrument, Mistake, Observation, register
from mjsim.instruments.r_test.measurement import Nest, NestTrace, SphereReading
from mjsim.instruments.schema import Length, OwnLength, one_of
from mjsim.instruments.sphere.instrument import DEVIATIONS, OFF
from mjsim.instruments.sphere.measurement import Points, Probe, SphereTest, sides_of
from mjsim.instruments.sphere.mistakes import sphere_mistakes
from mjsim.io.inputs import check_columns, csv_table, need_columns
from mjsim.io.times import check_growing
from mjsim.machine.chain import COORDINATES, Chain
from mjsim.units import DEG, MM, UM

# -- R-tests of a campaign ---------------------------------------------------------------------------------------------

#: Fewest samples of a recording.
_FEWEST = 50
#: Names of what it reads.
_READ = tuple(f"d{c.lower()}" for c in COORDINATES)
#: Words of headers of other systems before or behind the letter of a coordinate, lower case.
_OFF = (*OFF, "sensor", "")


class RTestTable(MotionTable):
    """A ``[[test]]`` table of an R-test."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=90)]
    kind: Literal["r_test"]
    sphere_mm: Annotated[list[Length], Field(min_length=3, max_length=3)]
    from_deg: Angle
    to_deg: Angle
    second_from_deg: Angle | None = None
    second_to_deg: Angle | None = None


_ENDS = (("from", "start"), ("to", "stop"))


def read_nest(path: Path, test: SphereReading, nest: Nest) -> NestTrace:
    """Read the CSV of one R-test, plain or compressed (``.csv.gz``).

    Args:
        path: The file.
        test: One of its readings.
        nest: The instrument.

    Raises:
        InputError: Names the file, the line or column, what was found and what is allowed.
    """
    need = ("time_s", *DEVIATIONS)
    names, table, _ = csv_table(path, lambda names: _check_header(path, names, need))
    column = {n: table[:, i] for i, n in enumerate(names)}
    time = column["time_s"]
    check_growing(path, time, lambda i: i + 2)
    return nest_trace(path, test, time, np.column_stack([column[d] * UM for d in DEVIATIONS]), nest)


def _check_header(path: Path, names: list[str], need: Sequence[str]) -> None:
    check_columns(path, names, need)
    need_columns(path, names, need)


def nest_trace(path: Path, test: SphereReading, time: np.ndarray, vector: np.ndarray, nest: Nest) -> NestTrace:
    """One coordinate of what was recorded.

    Args:
        path: Of the file, for messages.
        test: Whose coordinate it is.
        time: From the start of the program, (n,) s.
        vector: All coordinates, (n, 3) m.
        nest: The instrument.

    Raises:
        InputError: There are too few samples in the sensors' range.
    """
    valid = np.abs(vector).max(axis=1) < nest.range * (1 - 1e-9)
    if valid.sum() < _FEWEST:
        raise InputError(
            f"{path}: {int(valid.sum())} of {len(valid)} samples are inside the sensors' range of ±{nest.range / MM:g} "
            f"mm; allowed: at least {_FEWEST}"
        )
    vector = np.clip(vector, -2 * nest.range, 2 * nest.range)
    own = vector[:, COORDINATES.index(test.component)]
    return NestTrace(time, own, valid, int((~valid).sum()), vector)


#: So many places of a motion are looked at for mistakes.
_LOOKED_AT = 60


@register
class RTest(Instrument[SphereReading, NestTrace]):
    """A nest of three sensors that follows a sphere; each coordinate is a test of its own."""

    name = SphereReading.instrument
    noun = "R-test"
    test_noun = "R-test reading"
    beside = "r_tests"
    order = 0
    in_motion = True
    own_keys = {"repeatability_um": (OwnLength, None)}  # noqa: RUF012

    def kinds(self) -> Sequence[str]:
        return (self.name,)

    def table(self, chain: Chain) -> type[RTestTable]:
        rotary: Any = Annotated[str, AfterValidator(one_of(lambda: chain.rotary))]
        return create_model("RTestTable", __base__=RTestTable, axis=(rotary, ...))

    def test_of(self, file: Path, table: Any, chain: Chain) -> SphereReading:
        return self.tests_of(file, table, chain)[0]

    def tests_of(self, file: Path, table: Any, chain: Chain) -> tuple[SphereReading, ...]:
        """One reading a coordinate."""
        place = f'{file}: [[test]] "{table.name}"'
        more: dict[str, float] = {}
        if (table.second_from_deg is None) != (table.second_to_deg is None):
            raise InputError(f"{place}: one of second_from_deg and second_to_deg is missing; allowed: both, or none")
        if table.second_from_deg is not None:
            more = {"second_start": table.second_from_deg * DEG, "second_stop": table.second_to_deg * DEG}
        x, y, z = (v * MM for v in table.sphere_mm)
        one = SphereReading(
            name=table.name,
            kind="simultaneous" if more else "rotary",
            table_ball=(x, y, z),
            length=0.0,
            feed=table.feed_mm_min * MM / 60.0,
            sensitive=COORDINATES[-1] if more else "radial",  # a bar without length has no direction
            axis=table.axis,
            start=table.from_deg * DEG,
            stop=table.to_deg * DEG,
            setup=table.setup or table.name,
            started=table.started_s,
            spindle=table.spindle_deg * DEG,
            trace=table.trace,
            chain=chain,
            more=more,
        )
        kind = kind_of(one)
        if reason := kind.cannot(chain):
            raise InputError(f"{place}: the machine has the axes {', '.join(chain.letters)}: {reason}")
        whole = kind.completed(one)
        assert isinstance(whole, SphereReading)
        if wrong := kind.wrong(whole):
            raise InputError(f"{place}: {wrong.replace('table_ball_mm', 'sphere_mm')}")
        check_duration(place, whole)
        return tuple(
            replace(whole, name=f"{table.name}.{d}", component=c) for d, c in zip(_READ, COORDINATES, strict=True)
        )

    def data_of(self, table: Any) -> Nest:
        stated = None if table.repeatability_um is None else table.repeatability_um * UM
        return Nest(table.resolution_um * UM, table.range_mm * MM, table.sample_rate_Hz, stated)

    def read(self, path: Path, test: SphereReading, data: Nest) -> NestTrace:
        return read_nest(path, test, data)

    def look_at(self, path: Path, test: SphereReading, recording: NestTrace, tests: Sequence[SphereReading]) -> None:
        check_span(path, test, recording, tuple(tests))

    def file_columns(self, test: SphereReading) -> dict[str, tuple[str, str]]:
        return {"time": ("time", "s"), **dict.fromkeys(_READ, ("deviation", "um"))}

    def column_named(self, test: SphereReading, header: str, word: str) -> str:
        word = word.replace(" ", "_").strip("_")
        if word in ("time", "t", "zeit"):
            return "time"
        for d, c in zip(_READ, COORDINATES, strict=True):
            low = c.lower()
            if word == d or (word.count(low) == 1 and word.replace(low, "_", 1).strip("_") in _OFF):
                return d
        return ""

    def missing_columns(self, test: SphereReading, have: Collection[str]) -> list[str]:
        return [n for n in self.file_columns(test) if n not in have]

    def from_columns(
        self, source: Path, test: SphereReading, columns: dict[str, np.ndarray]
    ) -> tuple[NestTrace, list[str]]:
        time, *vector = (columns[n] for n in self.file_columns(test))
        first, last = Program(test).measured_span
        inside, notes = np.ones(len(time), bool), []
        if time[0] < first and time[-1] > last:  # recorded from the start of the program to its end
            inside = (time >= first) & (time <= last)
            notes.append(f"{int((~inside).sum())} samples are left out: they lie before or after the measured part")
        trace = nest_trace(source, test, time[inside], np.column_stack(vector)[inside], Nest(range=np.inf))
        return trace, notes

    def trace_text(self, test: SphereReading, recording: NestTrace) -> str:
        rows = np.column_stack([recording.time, recording.vector / UM])
        lines = [f"{t:.4f},{x:.4f},{y:.4f},{z:.4f}" for t, x, y, z in rows]
        return "\n".join([",".join(("time_s", *DEVIATIONS)), *lines, ""])

    def test_table(self, test: SphereReading) -> dict[str, Any]:
        second = (
            {f"second_{k}_deg": plain(float(test.more[f"second_{e}"]) / DEG) for k, e in _ENDS} if test.more else {}
        )
        turned = {"spindle_deg": plain(test.spindle / DEG)} if test.spindle else {}
        return {
            "name": test.recording,
            "kind": test.instrument,
            "sphere_mm": [plain(v / MM) for v in test.table_ball],
            "axis": test.axis,
            "from_deg": plain(test.start / DEG),
            "to_deg": plain(test.stop / DEG),
            **second,
            "feed_mm_min": plain(test.feed / MM * 60.0),
            **turned,
            "setup": test.setup,
        }

    def observe(self, test: SphereReading, recording: NestTrace) -> Observation:
        return Observation(recording.time, recording.deviation[:, None], recording.valid[:, None])

    def facts(self, test: SphereReading, recording: NestTrace) -> dict[str, Any]:
        return {f"{test.axis}_deg": [round(test.start / DEG, 3), round(test.stop / DEG, 3)]}

    def figures(self, test: SphereReading, time: np.ndarray, reading: np.ndarray) -> dict[str, float]:
        """Range of the coordinate (ISO 10791-6)."""
        return {"range_um": float(np.ptp(reading)) / UM}

    def mistakes(self, tests: Sequence[SphereReading], recordings: dict[str, NestTrace], data: Nest) -> list[Mistake]:
        """Wrong clocks, and columns with another order, sign or unit: by the geometry of the motion alone."""
        out = []
        for name, mine in _recordings(tests).items():
            names, trace = tuple(t.name for t in mine), recordings[mine[0].name]
            if not spans_fit(mine[0], float(trace.time[0]), float(trace.time[-1])):
                out.append(Mistake("clock", names, f"{name}: {_clock(mine[0], trace)}"))
                continue
            sphere, points = _points_of(mine[0], trace)
            found = sphere_mistakes([sphere], {name: points}, Probe(data.usual_noise))
            out += [replace(m, tests=names) for m in found]
        return out


def _recordings(tests: Sequence[SphereReading]) -> dict[str, list[SphereReading]]:
    """The readings of each recording, by its name."""
    out: dict[str, list[SphereReading]] = {}
    for t in tests:
        out.setdefault(t.recording, []).append(t)
    return out


def _clock(test: SphereReading, trace: NestTrace) -> str:
    """What is wrong with the times of a recording."""
    begin, end = float(trace.time[0]), float(trace.time[-1])
    mistake, (first, last) = explain(test, begin, end), Program(test).measured_span
    if mistake is not None:
        return mistake.sentence
    return (
        f"it runs from {begin:.2f} to {end:.2f} s, the program from {first:.2f} to {last:.2f} s; check feed_mm_min and "
        "that the trace belongs to this test"
    )


def _points_of(test: SphereReading, trace: NestTrace) -> tuple[SphereTest, Points]:
    """A motion as points: the geometry does not ask how fast it was gone through."""
    kept = np.flatnonzero(trace.valid)
    kept = kept[np.linspace(0, len(kept) - 1, _LOOKED_AT).astype(int)]
    time, chain = trace.time[kept], test.chain
    position = Program(test).commands(time)
    side, spindle = sides_of(position[:, chain.rotary_columns]), np.full(len(kept), test.spindle)
    points = Points(position, trace.vector[kept], side, spindle, time, True, np.ones(len(kept)))
    return SphereTest(test.recording, test.table_ball, test.setup, chain=chain), points
