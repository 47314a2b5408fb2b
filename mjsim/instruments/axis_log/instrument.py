"""The recorder of a control as an instrument of a campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mjsim.instruments.axis_log.files import LOG, LogTable, log_test, read_recording
from mjsim.instruments.axis_log.measurement import LogTest, Recorder, Recording
from mjsim.instruments.axis_log.mistakes import LogMistake, log_mistakes
from mjsim.instruments.axis_log.signals import Finding, encoder_step, findings
from mjsim.instruments.base import Channel, Instrument, Observation, register
from mjsim.machine.chain import Chain
from mjsim.units import DEG, UM


@register
class AxisLog(Instrument[LogTest, Recording]):
    """What a control records of its axes: commands, encoders, torques."""

    name = LogTest.instrument
    noun = "axis log"
    test_noun = "axis log"
    beside = "axis_logs"
    order = 1

    def kinds(self) -> Sequence[str]:
        return (LOG,)

    def table(self, chain: Chain) -> type[LogTable]:
        return LogTable

    def test_of(self, file: Path, table: LogTable, chain: Chain) -> LogTest:
        return log_test(file, table, chain)

    def data_of(self, table: Any) -> Recorder:
        return Recorder(table.sample_rate_Hz, table.resolution_um * UM, table.resolution_deg * DEG)

    def known_from(self, data: Recorder, recordings: Mapping[str, Recording]) -> Recorder:
        found: dict[str, float] = {}
        for recording in recordings.values():
            for axis in recording.axes:
                found[axis] = max(found.get(axis, 0.0), encoder_step(recording, axis))
        return replace(data, found=found)

    def read(self, path: Path, test: LogTest, data: Recorder) -> Recording:
        return read_recording(path, test)

    def facts(self, test: LogTest, recording: Recording) -> dict[str, Any]:
        return {"axes": list(test.axes), "rate_Hz": round(1.0 / recording.step, 3)}

    def channels(self, test: LogTest) -> tuple[Channel, ...]:
        rotary = {a: test.chain.is_rotary(a) for a in test.axes}
        return tuple(Channel(a, "°", DEG, "deg") if turns else Channel(a) for a, turns in rotary.items())

    def observe(self, test: LogTest, recording: Recording) -> Observation:
        value = np.column_stack([recording.axes[a].actual for a in test.axes])
        return Observation(recording.time, value, np.ones(value.shape, bool))

    def remarks(self, tests: Sequence[LogTest], recordings: dict[str, Recording], data: Recorder) -> list[Finding]:
        return [f for f in findings(tests, recordings, data) if not f.refused]

    def mistakes(self, tests: Sequence[LogTest], recordings: dict[str, Recording], data: Recorder) -> list[LogMistake]:
        return log_mistakes(tests, recordings, data.rate)
