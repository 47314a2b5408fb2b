"""Reading recorded traces: ``time_s,deviation_um``, as CSV, plain or compressed (``.csv.gz``)."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path

import numpy as np

from mjsim.campaign.model import Instrument, Trace
from mjsim.errors import InputError
from mjsim.units import UM

_HEADER = ["time_s", "deviation_um"]
_LARGEST = 200_000_000


def read_trace(path: Path, instrument: Instrument) -> Trace:
    """Read one trace; samples at or beyond the sensor's range are marked invalid.

    Raises:
        InputError: names the file, the line, what was found and what is allowed.
    """
    if not path.is_file():
        raise InputError(f"{path}: the trace is missing (named in campaign.toml)")
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not text; allowed: a CSV file with the header {','.join(_HEADER)}") from None
    first, _, body = text.partition("\n")
    header = [h.strip() for h in first.split(",")]
    if header != _HEADER:
        raise InputError(f"{path}, line 1: header {first.strip()[:80]!r}; allowed: {','.join(_HEADER)}")
    if not body.strip():
        raise InputError(f"{path}: 0 samples; allowed: at least 50")
    try:
        data = np.loadtxt(body.splitlines(), delimiter=",", ndmin=2, comments=None)
        if data.shape[1] != 2:
            raise ValueError
    except ValueError:
        raise InputError(f"{path}, {_first_bad_line(body)}") from None
    if len(data) < 50:
        raise InputError(f"{path}: {len(data)} samples; allowed: at least 50")
    time, deviation = data[:, 0], data[:, 1] * UM
    if not np.isfinite(time).all():
        raise InputError(f"{path}, line {int(np.flatnonzero(~np.isfinite(time))[0]) + 2}: time_s is not a finite number")
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        i = int(back[0])
        raise InputError(f"{path}, line {i + 3}: time_s = {time[i + 1]:g} after {time[i]:g}; allowed: times that grow from line to line")
    valid = np.isfinite(deviation) & (np.abs(np.nan_to_num(deviation)) < instrument.range * (1 - 1e-9))
    if valid.sum() < 50:
        raise InputError(
            f"{path}: only {int(valid.sum())} of {len(valid)} samples are inside the sensor's range of ±{instrument.range * 1e3:g} mm"
        )
    return Trace(time, np.nan_to_num(deviation), valid)


def read_bytes(path: Path) -> bytes:
    """The file's content; ``.gz`` is unpacked, up to the same size limit.

    Raises:
        InputError: it is too large, or no gzip file.
    """
    if path.stat().st_size > _LARGEST:
        raise InputError(f"{path}: {path.stat().st_size / 1e6:.0f} MB; allowed: up to {_LARGEST / 1e6:.0f} MB, thin the trace")
    if path.suffix != ".gz":
        return path.read_bytes()
    try:
        with gzip.open(path) as file:
            data = file.read(_LARGEST + 1)
    except (OSError, EOFError, zlib.error):
        raise InputError(f"{path}: not a readable gzip file; allowed: a CSV file, plain or as .csv.gz") from None
    if len(data) > _LARGEST:
        raise InputError(f"{path}: unpacks to more than {_LARGEST / 1e6:.0f} MB; thin the trace")
    return data


def _first_bad_line(body: str) -> str:
    for number, line in enumerate(body.splitlines(), start=2):
        if not line.strip():
            continue
        row = line.split(",")
        if len(row) != 2:
            columns = f"{len(row)} column{'s' if len(row) > 1 else ''}"
            return f"line {number}: {columns} in {line[:60]!r}; allowed: two numbers, time_s and deviation_um (decimal point)"
        for name, value in zip(_HEADER, row, strict=True):
            try:
                float(value)
            except ValueError:
                return f"line {number}: {name} = {value.strip()[:40]!r} is not a number; allowed: a number with a decimal point"
    return "the table cannot be read; allowed: two columns of numbers"
