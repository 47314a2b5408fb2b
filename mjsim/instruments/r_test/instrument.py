"""The R-test as an instrument of a campaign."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mjsim.instruments.ball_bar.files import check_span, spans_fit
from mjsim.instruments.ball_bar.program import Program
from mjsim.instruments.ball_bar.span import explain
from mjsim.instruments.base import Instrument, Mistake, Observation, register
from mjsim.instruments.r_test import files
from mjsim.instruments.r_test.files import RTestTable, r_test_table, readings_of_table
from mjsim.instruments.r_test.measurement import Nest, NestTrace, SphereReading
from mjsim.instruments.schema import OwnLength
from mjsim.instruments.sphere.measurement import Points, Probe, SphereTest, sides_of
from mjsim.instruments.sphere.mistakes import sphere_mistakes
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM, UM

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
        return r_test_table(chain)

    def test_of(self, file: Path, table: Any, chain: Chain) -> SphereReading:
        return self.tests_of(file, table, chain)[0]

    def tests_of(self, file: Path, table: Any, chain: Chain) -> tuple[SphereReading, ...]:
        return readings_of_table(file, table, chain)

    def data_of(self, table: Any) -> Nest:
        stated = None if table.repeatability_um is None else table.repeatability_um * UM
        return Nest(table.resolution_um * UM, table.range_mm * MM, table.sample_rate_Hz, stated)

    def read(self, path: Path, test: SphereReading, data: Nest) -> NestTrace:
        return files.read_nest(path, test, data)

    def look_at(self, path: Path, test: SphereReading, recording: NestTrace, tests: Sequence[SphereReading]) -> None:
        check_span(path, test, recording, tuple(tests))

    def file_columns(self, test: SphereReading) -> dict[str, tuple[str, str]]:
        return files.file_columns()

    def column_named(self, test: SphereReading, header: str, word: str) -> str:
        return files.column_named(word)

    def missing_columns(self, test: SphereReading, have: Collection[str]) -> list[str]:
        return files.missing_columns(have)

    def from_columns(
        self, source: Path, test: SphereReading, columns: dict[str, np.ndarray]
    ) -> tuple[NestTrace, list[str]]:
        time, *vector = (columns[n] for n in files.file_columns())
        return files.nest_trace(source, test, time, np.column_stack(vector), Nest(range=np.inf)), []

    def trace_text(self, test: SphereReading, recording: NestTrace) -> str:
        return files.trace_text(recording)

    def test_table(self, test: SphereReading) -> dict[str, Any]:
        return files.test_table(test)

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
