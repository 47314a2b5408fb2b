"""The ball bar as an instrument of a campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field

from mjsim.instruments.ball_bar.files import BallBarTable, ball_bar_table, check_span, read_trace, test_of, test_table
from mjsim.instruments.ball_bar.kinds import KINDS
from mjsim.instruments.ball_bar.measurement import BallBarData, BallBarTest, Trace
from mjsim.instruments.base import Instrument, Observation, register
from mjsim.instruments.schema import GainUncertainty, Text
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
    in_motion = True
    own_keys: ClassVar[Mapping[str, tuple[Any, Any]]] = {
        "certificate": (Text, ""),
        "gain_ppm": (Annotated[float | None, Field(ge=-1e5, le=1e5)], None),
        "gain_uncertainty_ppm": (GainUncertainty, None),
        "form_um": (Annotated[float | None, Field(ge=0, le=1000)], None),
        "hysteresis_um": (Annotated[float | None, Field(ge=0, le=1000)], None),
        "temperature_degC": (Annotated[float | None, Field(ge=-20, le=60)], None),
        "expansion_ppm_per_K": (Annotated[float | None, Field(ge=-100, le=100)], None),
    }

    def kinds(self) -> Sequence[str]:
        return tuple(KINDS)

    def table(self, chain: Chain) -> type[BallBarTable]:
        return ball_bar_table(chain)

    def test_of(self, file: Path, table: BallBarTable, chain: Chain) -> BallBarTest:
        return test_of(file, table, chain)

    def data_of(self, table: Any) -> BallBarData:
        resolution, usual = table.resolution_um * UM, BallBarData()
        stated = {
            "certificate": table.certificate,
            "gain": _times(table.gain_ppm, 1e-6),
            "gain_uncertainty": _times(table.gain_uncertainty_ppm, 1e-6),
            "form": _times(table.form_um, UM),
            "temperature": table.temperature_degC,
            "expansion": _times(table.expansion_ppm_per_K, 1e-6),
            "hysteresis": resolution if table.hysteresis_um is None else table.hysteresis_um * UM,
        }
        known = {key: value for key, value in stated.items() if value is not None}
        return replace(usual, resolution=resolution, range=table.range_mm * MM, rate=table.sample_rate_Hz, **known)

    def test_table(self, test: BallBarTest) -> dict[str, Any]:
        return test_table(test)

    def read(self, path: Path, test: BallBarTest, data: BallBarData) -> Trace:
        return data.corrected(read_trace(path, data), test.length)

    def observe(self, test: BallBarTest, recording: Trace) -> Observation:
        return Observation(recording.time, recording.deviation[:, None], recording.valid[:, None])

    def look_at(self, path: Path, test: BallBarTest, recording: Trace, tests: Sequence[BallBarTest]) -> None:
        check_span(path, test, recording, tuple(tests))


def _times(value: float | None, unit: float) -> float | None:
    """A number of a table in SI."""
    return None if value is None else value * unit
