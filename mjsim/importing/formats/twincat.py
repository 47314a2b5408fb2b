"""TwinCAT 3 Scope View, exported as CSV with its header.

The header has one row for each property: its first cell and the first cell of each further block say the property's
name, the other cells its value for one channel. In the table below, the cells under those names are times: one for each
block of channels with the same sample time. Times are in ms from the first sample, or in ticks of 100 ns. Separator and
decimal sign are the user's choice. (The export's description and files that a public reader is tested with.)
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.formats.base import Format, register
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.io.inputs import check_rows, read_bytes

_STAMP = "Starttime of export"
#: Numbers above this are ticks of 100 ns since 1601, not ms.
_TICKS = 1e15


@register
class TwinCAT(Format):
    """The channels with the sample time that most have, with their time."""

    def recognises(self, head: str) -> bool:
        lines = head.splitlines()
        return len(lines) > 2 and lines[0].lstrip('\ufeff"').startswith("Name") and any(_STAMP in s for s in lines[:5])

    def read(self, path: Path, options: Options) -> Table:
        text = read_bytes(path).decode("utf-8-sig", errors="replace")
        check_rows(path, text.count("\n"))
        lines = text.splitlines()
        separator = lines[0].replace('"', "").removeprefix("Name")[:1]
        if separator in ("", " "):
            raise InputError(f"{path}: separated by blanks, which names have as well; allowed: tab or semicolon")
        rows = [[c.strip().strip('"') for c in line.split(separator)] for line in lines]
        first = next((i for i, r in enumerate(rows[1:], start=1) if r[0] == "Name"), None)
        if first is None:
            raise InputError(f"{path}: no row Name of the channels; allowed: an export with its header")
        width = len(rows[first])
        end = next((i for i in range(first, len(rows)) if not any(rows[i])), len(rows))
        header = {r[0]: [*r, *[""] * (width - len(r))] for r in rows[first:end]}
        times = [i for i, c in enumerate(rows[first]) if c == "Name"]
        numbers = _numbers(path, rows, end, width, separator)
        blocks = [range(t + 1, min([u for u in times if u > t], default=width)) for t in times]
        steps = [_step(numbers[:, t]) for t in times]
        kinds = {s: sum(len(b) for b, u in zip(blocks, steps, strict=True) if u == s) for s in steps}
        usual = max(kinds, key=lambda s: (kinds[s], -s))  # the sample time that most channels have
        lead = times[steps.index(usual)]
        time = numbers[:, lead] - numbers[0, lead]
        columns = []
        for t, block, step in zip(times, blocks, steps, strict=True):
            if step == usual and np.array_equal(numbers[:, t], numbers[:, lead], equal_nan=True):
                columns += list(block)
        left = sum(map(len, blocks)) - len(columns)
        time, usual = (1e-4 * time, 1e-4 * usual) if numbers[0, lead] > _TICKS else (time, usual)
        notes = [f"TwinCAT Scope export, {len(columns)} channels with {usual:g} ms"]
        notes += [f"{left} channels with other times left out"] if left else []
        units = [
            header.get("Unit", [""] * width)[i].partition(" (")[0].strip("()").replace("None", "") for i in columns
        ]
        names = [rows[first][i] for i in columns]
        values = np.column_stack([time, numbers[:, columns]])
        keep = np.isfinite(values[:, 0])
        lines_of = np.arange(end + 2, end + 2 + len(values))
        return Table(path, ("time", *names), ("ms", *units), values[keep], lines_of[keep], (), tuple(notes))


def _step(time: np.ndarray) -> float:
    """Usual time between two samples, in the unit of the column, to nine digits."""
    steps = np.diff(time[np.isfinite(time)])
    return float(f"{np.median(steps):.9g}") if len(steps) else np.inf


def _numbers(path: Path, rows: list[list[str]], end: int, width: int, separator: str) -> np.ndarray:
    """The table below the header, (n, width), nan for empty cells."""
    out = []
    for line, row in enumerate(rows[end:], start=end + 1):
        if not any(row):
            continue
        if row[0] == "EOF":
            break
        try:
            values = [_of(c) for c in row[:width]]
        except ValueError:
            raise InputError(f"{path}, line {line}: {separator.join(row)[:60]!r}; allowed: numbers") from None
        out.append([*values, *[np.nan] * (width - len(values))])
    if not out:
        raise InputError(f"{path}: no row of numbers below the header")
    return np.array(out)


def _of(cell: str) -> float:
    return float(cell.replace(",", ".")) if cell else np.nan
