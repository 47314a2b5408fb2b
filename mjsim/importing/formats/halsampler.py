"""LinuxCNC's ``halsampler -t``: the number of the sample, then the pins, separated by blanks, without a header.

Without ``-t`` it is a table of numbers like any other. ``overrun`` stands where the recorder lost samples.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.formats.base import Format, register
from mjsim.importing.reading import Options
from mjsim.importing.table import Table, read_table
from mjsim.io.inputs import read_bytes

_LOST = "overrun"
#: Lines that have to count on for the first column to be the number of the sample.
_LOOK = 20


@register
class HalSampler(Format):
    """Columns ``sample``, ``pin 0``, ``pin 1`` and so on."""

    heeds = ("rows",)

    def recognises(self, head: str) -> bool:
        lines = [line.split() for line in head.splitlines()[: _LOOK + 1] if line.strip()][:-1]
        rows = [r for r in lines if r != [_LOST]]
        tags = [r[0] for r in rows]
        if len(rows) < 3 or any(len(r) != len(rows[0]) or len(r) < 2 for r in rows):
            return False
        if not all(t.isdigit() for t in tags):
            return False
        counted = all(int(b) - int(a) == 1 for a, b in pairwise(tags))
        return counted and all("." in r[1] for r in rows)

    def read(self, path: Path, options: Options) -> Table:
        lines = read_bytes(path).decode(errors="replace").splitlines()
        first, last = options.rows or (1, len(lines))
        lost = [n for n, line in enumerate(lines, start=1) if line.strip() == _LOST and first <= n <= last]
        if lost:
            raise InputError(
                f"{path}, line {lost[0]}: the recorder lost samples ({len(lost)} times); allowed: a part without, "
                f"--rows FIRST LAST, or a recording with a larger depth of the sampler"
            )
        table = read_table(path, "space", "point", options.rows)
        names = ("sample", *(f"pin {i}" for i in range(table.values.shape[1] - 1)))
        if (np.diff(table.values[:, 0]) != 1.0).any():
            line = int(table.lines[int(np.argmax(np.diff(table.values[:, 0]) != 1.0)) + 1])
            raise InputError(f"{path}, line {line}: the number of the sample does not count on; allowed: no gap")
        notes = (f"halsampler with sample numbers, {len(names) - 1} pins", "its rate is not in the file: --rate HZ")
        return Table(path, names, ("",) * len(names), table.values, table.lines, (), notes)
