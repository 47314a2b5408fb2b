"""The ball bar as an instrument of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mjsim.instruments.ball_bar.files import check_span, test_of, test_table
from mjsim.instruments.ball_bar.kinds import KINDS
from mjsim.instruments.ball_bar.measurement import BallBarData, BallBarTest, Trace
from mjsim.instruments.ball_bar.tables import BallBarTable, ball_bar_table
from mjsim.instruments.ball_bar.traces import read_trace
from mjsim.instruments.base import Instrument, Observation, register
from mjsim.machine.chain import Chain
from mjsim.units import MM, UM


@register
class BallBar(Instrument[BallBarTest, Trace]):
    """Two balls and a sensor of their distance."""

    name = BallBarTest.instrument
    noun = "ball bar"
    test_noun = "ball-bar test"
    beside = "ball_bar_tests"
    order = 0

    def kinds(self) -> Sequence[str]:
        return tuple(KINDS)

    def table(self, chain: Chain) -> type[BallBarTable]:
        return ball_bar_table(chain)

    def test_of(self, file: Path, table: BallBarTable, chain: Chain) -> BallBarTest:
        return test_of(file, table, chain)

    def data_of(self, table: Any) -> BallBarData:
        return BallBarData(table.resolution_um * UM, table.range_mm * MM, table.sample_rate_Hz)

    def test_table(self, test: BallBarTest) -> dict[str, Any]:
        return test_table(test)

    def read(self, path: Path, test: BallBarTest, data: BallBarData) -> Trace:
        return read_trace(path, data)

    def observe(self, test: BallBarTest, recording: Trace) -> Observation:
        return Observation(recording.time, recording.deviation[:, None], recording.valid[:, None])

    def look_at(self, path: Path, test: BallBarTest, recording: Trace, tests: Sequence[BallBarTest]) -> None:
        check_span(path, test, recording, tuple(tests))
