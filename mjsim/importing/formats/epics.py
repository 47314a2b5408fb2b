"""EPICS: process variables as ``camonitor``, ``arget`` or the channel archiver print them.

``camonitor`` prints a line for each new value: name, date, time, value, alarms
(https://docs.epics-controls.org, channel access tools). ``arget`` prints date, time, name and value. The variables come
at times of their own: the times of the one with most values are taken, and the others have the last value before them.
``ArchiveExport`` writes a table with a time and a column for each variable, which is read as a table of text.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.formats.base import Format, register
from mjsim.importing.reading import Options
from mjsim.importing.table import Table, seconds_of
from mjsim.io.inputs import check_rows, read_bytes

_TIME = r"(?P<time>(?:\d{4}-)?\d\d-\d\d[ T]\d\d:\d\d:\d\d(?:\.\d+)?)"
_VALUE = r"(?P<value>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?:\s.*)?"
_NAME = r"(?P<name>[A-Za-z][^\s,;]*)"
_LINES = tuple(re.compile(rf"\s*{p}\s*") for p in (rf"{_NAME}\s+{_TIME}\s+{_VALUE}", rf"{_TIME}\s+{_NAME}\s+{_VALUE}"))
#: Lines at the beginning of a file of which most have to be of one of the two kinds.
_LOOK = 40


def _match(line: str) -> re.Match[str] | None:
    return next((m for p in _LINES if (m := p.fullmatch(line))), None)


@register
class EPICS(Format):
    """Lines of ``camonitor`` (name, date, time, value) or of ``arget`` (date, time, name, value)."""

    def recognises(self, head: str) -> bool:
        lines = [x for x in head.splitlines()[:_LOOK] if x.strip()][:-1]
        return len(lines) > 2 and sum(_match(x) is not None for x in lines) > 0.5 * len(lines)

    def read(self, path: Path, options: Options) -> Table:
        text = read_bytes(path).decode("utf-8", errors="replace")
        check_rows(path, text.count("\n"))
        found: dict[str, tuple[list[float], list[float]]] = {}
        left = 0
        for line in text.splitlines():
            m = _match(line)
            if m is None:
                left += bool(line.strip())
                continue
            stamp = m["time"] if m["time"][4:5] == "-" else f"1972-{m['time']}"  # a leap year, for 29 February
            seconds = seconds_of(stamp)
            if seconds is not None:
                times, values = found.setdefault(m["name"], ([], []))
                times.append(seconds)
                values.append(float(m["value"]))
        if not found:
            raise InputError(f"{path}: no line with a variable, a time and a number; allowed: {self.__doc__}")
        lead = max(found, key=lambda name: len(found[name][0]))
        order = np.argsort(found[lead][0], kind="stable")
        time = np.array(found[lead][0])[order]
        columns = []
        for times, values in found.values():
            own = np.argsort(times, kind="stable")
            at = np.searchsorted(np.array(times)[own], time, side="right") - 1
            columns.append(np.where(at >= 0, np.array(values)[own][np.maximum(at, 0)], np.nan))
        notes = [f"EPICS, {len(found)} process variables; the times are those of {lead}"]
        notes += [f"{left} lines left out: no number"] if left else []
        table = np.column_stack([np.round(time - time[0], 7), *columns])
        lines = np.arange(1, len(time) + 1)
        return Table(path, ("time", *found), ("s", *[""] * len(found)), table, lines, (), tuple(notes))
