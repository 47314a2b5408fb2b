"""The recorder of a control as an instrument of a campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

from mjsim.instruments.axis_log.files import LOG, LogTable, log_test, read_recording
from mjsim.instruments.axis_log.measurement import LogTest, Recorder, Recording
from mjsim.instruments.axis_log.signals import Finding, LogMistake, copies, encoder_step, findings, impossible
from mjsim.instruments.base import Channel, Instrument, Observation, register
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM, UM


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


# -- what people get wrong in axis logs --------------------------------------------------------------------------------
# Nothing here knows the machine. A command is smooth and stands exactly still at a stop; an encoder has steps and
# noise, and follows.

#: Correlation of a command with the position of another axis that must beat its own by so much (assumed).
_SWAPPED = 0.05
#: Factors between command and actual position that are a wrong unit, and what they say.
_FACTORS = {1e3: "µm against mm, or mm against m", 1e-3: "mm against µm, or m against mm", 25.4: "mm against inch"}
_FACTORS |= {1.0 / 25.4: "inch against mm", -1.0: "another sign", 180.0 / np.pi: "° against rad"}
_FACTORS |= {np.pi / 180.0: "rad against °"}
#: A factor is recognised within this share.
_NEAR = 0.03
#: Speeds, m/s and rad/s, that no machine tool reaches (assumed), by whether the axis is rotary.
_FASTEST = {False: 20.0, True: 1000.0}
#: Samples of a second: a stated rate may differ from the recorded one by this factor.
_RATE = 1.5


def log_mistakes(tests: Sequence[LogTest], recordings: Mapping[str, Recording], rate: float) -> list[LogMistake]:
    """All mistakes that the recordings of some tests show; ``rate`` is the stated one, Hz."""
    out = []
    for test in tests:
        recording = recordings[test.name]
        swapped = _swapped(test, recording)
        out += swapped
        taken = {a for m in swapped for a in m.axes}
        for axis in test.axes:
            if axis not in taken:
                out += _of_axis(test, recording, axis)
        out += _time(test, recording, rate)
        for f in (*copies(test, recording), *impossible(test, recording)):
            if f.refused and not taken & set(f.axes):
                out.append(LogMistake(f.kind, f.test, f.axes, f.sentence))
    return out


def _of_axis(test: LogTest, recording: Recording, axis: str) -> list[LogMistake]:
    record = recording.axes[axis]
    c, a = record.command - record.command.mean(), record.actual - record.actual.mean()
    if not np.any(c) and not np.any(a):
        return []
    slope = float(c @ a / max(c @ c, 1e-30))
    for factor, what in _FACTORS.items():
        if abs(slope / factor - 1.0) < _NEAR:
            said = f"{test.name}: the actual position of {axis} is {slope:.4g} times its command: {what}"
            return [LogMistake("unit", test.name, (axis,), f"{said}; correct the column's unit")]
    lag = follows_by(record.command, record.actual)
    rough_command, rough_actual = roughness(record.command), roughness(record.actual)
    noisy = rough_command > 2.0 * rough_actual
    if (lag < 0.0 and noisy) or (lag < -2.0 and rough_command >= rough_actual):
        return [
            LogMistake(
                "exchanged",
                test.name,
                (axis,),
                f"{test.name}: command and actual position of {axis} are exchanged: the column of the command has the "
                f"encoder's steps and follows the other by {-1e3 * lag * recording.step:.3g} ms; exchange the two "
                f"columns",
            )
        ]
    return []


def follows_by(command: np.ndarray, actual: np.ndarray) -> float:
    """Samples by which the actual position follows the command; negative where it leads.

    From the first-order part: actual ≈ command − lag · d(command).
    """
    rate = np.gradient(0.5 * (command + actual))
    power = float(rate @ rate)
    return float((command - actual) @ rate / power) if power > 0.0 else 0.0


def roughness(position: np.ndarray) -> float:
    """Median size of the third difference: small for what a control has computed."""
    third = np.abs(np.diff(position, 3))
    return float(np.quantile(third, 0.7))


def _swapped(test: LogTest, recording: Recording) -> list[LogMistake]:
    """Axes whose commands fit each other's positions better than their own."""
    axes = [a for a in test.axes if np.ptp(recording.axes[a].command) > 0.0]
    if len(axes) < 2:
        return []
    fit = np.array([[_correlation(recording.axes[a].command, recording.axes[b].actual) for b in axes] for a in axes])
    own = float(np.trace(fit))
    best = max(permutations(range(len(axes))), key=lambda p: sum(fit[i, j] for i, j in enumerate(p)))
    if sum(fit[i, j] for i, j in enumerate(best)) < own + _SWAPPED:
        return []
    wrong = tuple(axes[i] for i, j in enumerate(best) if i != j)
    pairs = ", ".join(f"{axes[i]} fits {axes[j]}" for i, j in enumerate(best) if i != j)
    sentence = f"{test.name}: axes are swapped: the command of {pairs}; exchange the columns"
    return [LogMistake("swapped_axes", test.name, wrong, sentence)]


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    u, v = np.diff(a), np.diff(b)
    size = float(np.sqrt((u @ u) * (v @ v)))
    return float(u @ v) / size if size > 0.0 else 0.0


def _time(test: LogTest, recording: Recording, rate: float) -> list[LogMistake]:
    found = 1.0 / recording.step
    if 1.0 / _RATE < found / rate < _RATE:
        return []
    ratio = rate / found
    guess = "time_s is in ms" if abs(ratio / 1e3 - 1.0) < 0.2 else "time_s may be a count of samples"
    if abs(ratio * 1e3 - 1.0) < 0.2:
        guess = "sample_rate_Hz may be in kHz"
    for axis in test.axes:
        rotary = test.chain.is_rotary(axis)
        n = max(1, len(recording.time) // 500)
        speed = np.abs(np.diff(recording.axes[axis].actual[::n])).max() / (n * recording.step)
        if speed > _FASTEST[rotary]:
            unit = f"{speed / (DEG if rotary else MM):.3g} {'°' if rotary else 'mm'}/s"
            guess = f"{axis} would move at {unit}: the unit of time or position is wrong"
    said = f"{test.name}: {found:.4g} samples per second in the file, sample_rate_Hz = {rate:g} in campaign.toml"
    return [LogMistake("time", test.name, test.axes, f"{said}; {guess}")]
