"""Reading recorded traces: ``time_s,deviation_um``, as CSV, plain or compressed (``.csv.gz``)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.measurement import BallBarData, Trace
from mjsim.io.inputs import check_rows, csv_text, shown
from mjsim.io.times import check_growing
from mjsim.units import UM

_HEADER = ["time_s", "deviation_um"]
#: A reading that stands still for so many samples at its extreme, and leaves it by so many of its smallest steps, was
#: cut off.
_FLAT, _CUT = 10, 20.0
#: A trace may have so many times fewer samples than its usual step would give; fewer is no even recording.
_UNEVEN = 20
_NUMBER = re.compile(r"\s*[+-]?(?:(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?|nan|inf|infinity)\s*", re.ASCII | re.IGNORECASE)


def read_trace(path: Path, instrument: BallBarData) -> Trace:
    """Read one trace; samples at or beyond the sensor's range, and those of a sensor that stands at its stop, are
    marked invalid.

    Raises:
        InputError: names the file, the line, what was found and what is allowed.
    """
    first, body = csv_text(path, f"a CSV file with the header {','.join(_HEADER)}")
    header = [h.strip() for h in first.split(",")]
    if header != _HEADER:
        raise InputError(f"{path}, line 1: header {shown(first.strip())}; allowed: {','.join(_HEADER)}")
    if not body.strip():
        raise InputError(f"{path}: 0 samples; allowed: at least 50")
    check_rows(path, body.count("\n"))
    time, deviation = _columns(path, body.replace("\r\n", "\n").split("\n"))
    held = saturated(deviation)
    inside = np.isfinite(deviation) & (np.abs(np.nan_to_num(deviation)) < instrument.range * (1 - 1e-9))
    valid = inside & ~held
    if valid.sum() < 50:
        at = f", and {int((inside & held).sum())} more stand at one extreme value" if (inside & held).any() else ""
        raise InputError(
            f"{path}: only {int(inside.sum())} of {len(valid)} samples are inside the sensor's range of "
            f"±{instrument.range * 1e3:g} mm{at}"
        )
    reading = np.clip(np.nan_to_num(deviation), -2 * instrument.range, 2 * instrument.range)
    return Trace(time, reading, valid, int((np.isfinite(deviation) & ~valid).sum()))


def _columns(path: Path, lines: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) s and deviations (n,) m of the lines below the header."""
    try:
        data = np.loadtxt(lines, delimiter=",", ndmin=2, comments=None)
        if data.shape[1] != 2:
            raise ValueError
    except ValueError:
        raise InputError(f"{path}{_first_bad_line(lines)}") from None
    if len(data) < 50:
        raise InputError(f"{path}: {len(data)} samples; allowed: at least 50")
    time, deviation = data[:, 0], data[:, 1] * UM

    def line(i: int) -> int:
        return [number for number, row in enumerate(lines, start=2) if row.strip()][i]

    if not np.isfinite(time).all():
        raise InputError(
            f"{path}, line {line(int(np.flatnonzero(~np.isfinite(time))[0]))}: time_s is not a finite number"
        )
    if np.abs(time).max() > 1e12:
        raise InputError(
            f"{path}, line {line(int(np.argmax(np.abs(time))))}: time_s = {np.abs(time).max():g}; allowed: seconds"
        )
    check_growing(path, time, line)
    usual = float(np.median(np.diff(time)))
    if time[-1] - time[0] > _UNEVEN * usual * len(time):
        raise InputError(
            f"{path}: {len(time)} samples in {time[-1] - time[0]:.4g} s, though every other one follows within "
            f"{usual:.3g} s; "
            "allowed: samples at an even rate"
        )
    return time, deviation


def saturated(deviation: np.ndarray) -> np.ndarray:
    """Which samples (n,) of a reading (n,) m are those of a sensor at its stop: flat tops at its highest or lowest
    value.

    A stop cuts a curve off: the reading stays at one value for :data:`_FLAT` samples or more, and as far before and
    after as it stays there it is away from it by :data:`_CUT` of its smallest steps or more. A peak that is flat
    because its digits are few is left by a few such steps only.
    """
    out = np.zeros(len(deviation), bool)
    known = deviation[np.isfinite(deviation)]
    values = np.unique(known)
    if len(values) < 3:
        return out
    step = max(float(np.diff(values).min()), 1e-9 * float(np.abs(values).max()))
    for stop in (values[0], values[-1]):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], deviation == stop, [0]])))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            length = end - begin
            if length < _FLAT:
                continue
            half = max(1, length // 2)
            sides = [deviation[max(0, begin - half)], deviation[min(len(deviation), end + half) - 1]]
            away = [abs(x - stop) for x in sides if np.isfinite(x)]
            if away and max(away) > _CUT * step:
                out[begin:end] = True
    return out


def _first_bad_line(lines: list[str]) -> str:
    for number, line in enumerate(lines, start=2):
        if not line.strip():
            continue
        row = line.split(",")
        if len(row) != 2:
            columns = f"{len(row)} column{'s' if len(row) > 1 else ''}"
            return (
                f", line {number}: {columns} in {shown(line, 60)}; allowed: two numbers, time_s and deviation_um "
                f"(decimal point)"
            )
        for name, value in zip(_HEADER, row, strict=True):
            if not _NUMBER.fullmatch(value):
                return (
                    f", line {number}: {name} = {shown(value.strip(), 40)} is not a number; allowed: a number with "
                    f"a decimal point"
                )
    return ": the table cannot be read; allowed: two columns of numbers"
