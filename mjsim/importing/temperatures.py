"""Records of temperature loggers into a campaign: ``mjsim import --temperatures``.

A logger writes the time of day, and a column for each sensor. A campaign counts seconds from an instant of its own, the
same as ``started_s`` of its tests.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjsim.campaign.temperature import FILE, temperatures_of
from mjsim.errors import InputError
from mjsim.importing.formats import read_any
from mjsim.importing.into_campaign import campaign_file
from mjsim.importing.reading import Options
from mjsim.importing.table import Table, seconds_of
from mjsim.importing.units import TIME, TIME_WORDS, bare, unit_of_column
from mjsim.io.files import check_writable, write_all
from mjsim.io.inputs import shown
from mjsim.machine.temperatures import Temperatures

#: Factor and zero that make °C of a unit, by what headers call it, lower case.
_UNITS = {"°c": (1.0, 0.0), "degc": (1.0, 0.0), "c": (1.0, 0.0), "k": (1.0, -273.15)}
_UNITS |= dict.fromkeys(("°f", "degf", "f"), (1.0 / 1.8, -32.0 / 1.8))
_UNIT = re.compile(r"(?:[\[(]\s*([^\])]+?)\s*[\])]|[_ /](°?[CFK]|deg[CF]))\s*$", re.IGNORECASE)
#: Words of headers of columns that are no sensors.
_NUMBERS = {"no", "no.", "nr", "nr.", "index", "id", "#", "sample", "humidity", "feuchte", "rh"}


@dataclass(frozen=True)
class ImportedTemperatures:
    """A record as it was brought in, or as it would be.

    Attributes:
        source: File of the logger.
        target: ``temperature.csv`` of the campaign.
        temperatures: What is in it.
        notes: What was found and concluded.
    """

    source: Path
    target: Path
    temperatures: Temperatures
    notes: tuple[str, ...]

    def to_json(self) -> dict:
        """Plain data."""
        t = self.temperatures
        sensors = {
            n: [round(float(v.min()), 3), round(float(v.max()), 3)] for n, v in zip(t.names, t.value.T, strict=True)
        }
        return {
            "source": str(self.source),
            "file": str(self.target),
            "samples": len(t.time),
            "from_s": round(float(t.time[0]), 3),
            "to_s": round(float(t.time[-1]), 3),
            "sensors_degC": sensors,
            "notes": list(self.notes),
        }


def import_temperatures(
    campaign: Path,
    source: Path,
    start: str | None = None,
    options: Options | None = None,
    force: bool = False,
    preview: bool = False,
) -> ImportedTemperatures:
    """Bring the record of a temperature logger into a campaign.

    Args:
        campaign: Its folder.
        source: A table: dates and times, times of day, or seconds; and a column of °C, °F or K for each sensor.
        start: Date and time from which the campaign counts, written as in the file; without it the first sample.
        options: How the file is to be read.
        force: Replace a record that is there.
        preview: Write nothing.

    Raises:
        InputError: The file cannot be read, has no times or no sensors, or ``start`` is not on its clock.
    """
    options = options or Options()
    target = campaign_file(campaign).parent / FILE
    table = read_any(source, options)
    place = _time_column(table, options)
    time, notes = _clock(table, place, start)
    sensors = [i for i, n in enumerate(table.names) if i != place and bare(n) not in _NUMBERS]
    if not sensors:
        raise InputError(f"{source}: no column of a sensor; the file has {table.columns}")
    names = [_sensor(table.names[i]) or f"sensor-{i + 1}" for i in sensors]
    values = np.column_stack([_celsius(table, i) for i in sensors])
    whole = np.isfinite(values).all(axis=1) & np.isfinite(time)
    if not whole.all():
        notes.append(f"{int((~whole).sum())} rows are left out: they have empty cells")
    time, values, lines = time[whole], values[whole], table.lines[whole]
    # a logger that rounds its clock writes several samples at one time: their mean counts
    first = np.flatnonzero(np.diff(time, prepend=-np.inf))
    if len(first) < len(time):
        notes.append(f"{len(time)} samples at {len(first)} times: those of one time are averaged")
        values = np.add.reduceat(values, first) / np.diff(np.append(first, len(time)))[:, None]
    dropped = [i for i in range(len(table.names)) if i != place and i not in sensors]
    notes += [f"not taken: {table.listed(dropped)}"] if dropped else []
    rows = np.column_stack([time[first], values])
    found = temperatures_of(source, ["time_s", *names], rows, lines[first])
    if not preview:
        check_writable(target, force)
        write_all({target: _text(found)}, force=True)
    return ImportedTemperatures(source, target, found, (*table.notes, *notes))


def _time_column(table: Table, options: Options) -> int:
    """The column of the times."""
    if options.time is not None:
        return table.place(options.time)
    named = [i for i, n in enumerate(table.names) if bare(n) in TIME_WORDS or n.lower() in TIME_WORDS]
    if not named:
        raise InputError(f"{table.path}: no column of times; the file has {table.columns}; say which it is with --time")
    return named[0]


def _clock(table: Table, place: int, start: str | None) -> tuple[np.ndarray, list[str]]:
    """Times on the clock of the campaign, (n,) s, and what was concluded."""
    own = table.began.get(place)
    if own is None:
        if start is not None:
            raise InputError(f"{table.path}: its times are no times of day, so --start has no meaning")
        unit = unit_of_column(table.names[place], table.units[place], "time") or "s"
        return table.values[:, place] * TIME[unit][0], [f"times in {unit}, on the clock of the campaign"]
    if start is None:
        return table.values[:, place], ["0 s of the campaign is the first sample; --start DATE-AND-TIME says otherwise"]
    begin = seconds_of(start.strip())
    if begin is None or not np.isfinite(begin):
        raise InputError(f"--start {shown(start)}; allowed: a date and time to the second, such as 2026-03-02 08:00:00")
    if (begin < 86400.0) != (own < 86400.0):
        raise InputError(
            f"--start {shown(start)}; allowed: {'a time of day, as' if own < 86400.0 else 'a date and time, as those'} "
            f"of {table.path}"
        )
    return table.values[:, place] + own - begin, []


def _celsius(table: Table, place: int) -> np.ndarray:
    """Temperatures of a column, (n,) °C."""
    found = _UNIT.search(table.names[place])
    unit = (table.units[place] or (found and (found[1] or found[2])) or "°C").lower()
    if unit not in _UNITS:
        raise InputError(f"{table.path}: column {shown(table.names[place])} in {unit}; allowed: °C, °F or K")
    factor, zero = _UNITS[unit]
    return table.values[:, place] * factor + zero


def _sensor(header: str) -> str:
    """What a sensor is called, from the header of its column."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", _UNIT.sub("", header)).strip("-._")
    return name[:40]


def _text(t: Temperatures) -> str:
    rows = [",".join([f"{s:.3f}", *(f"{v:.4f}" for v in row)]) for s, row in zip(t.time, t.value, strict=True)]
    return "\n".join([",".join(["time_s", *t.names]), *rows, ""])
