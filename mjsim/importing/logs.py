"""Axis logs of other systems into a campaign: which column is which signal of which axis, and in which unit."""

from __future__ import annotations

import gzip
import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tomlkit

from mjsim.campaign.files import campaign_from
from mjsim.errors import InputError
from mjsim.importing.formats import read_any
from mjsim.importing.into_campaign import campaign_file, test_name
from mjsim.importing.log_columns import Column, columns_of
from mjsim.importing.reading import Options
from mjsim.importing.recorder import with_recorder
from mjsim.importing.table import Table
from mjsim.importing.units import factor
from mjsim.instruments.axis_log.files import LOG
from mjsim.instruments.axis_log.measurement import AxisRecord, LogTest, Recorder, Recording
from mjsim.instruments.axis_log.mistakes import LogMistake, log_mistakes
from mjsim.io.files import check_writable, write_all
from mjsim.io.toml import parse, read_text
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM

#: Digits of a written position, mm or degrees.
_DIGITS = {"time": "%.7g", "position": "%.7f", "other": "%.7g"}


@dataclass(frozen=True)
class ImportedLog:
    """What an import did, or would do.

    Attributes:
        source: The file.
        test: Name of the log.
        target: The CSV in the campaign.
        columns: What was taken for what.
        rate: Samples per second.
        samples: Number of them.
        notes: What was detected.
        questions: Mistakes that the recording shows, a sentence each.
        new_test: Whether campaign.toml gets a table.
    """

    source: Path
    test: str
    target: Path
    columns: tuple[Column, ...]
    rate: float
    samples: int
    notes: tuple[str, ...]
    questions: tuple[str, ...]
    new_test: bool

    def to_json(self) -> dict:
        """Plain data."""
        return {
            "source": str(self.source),
            "test": self.test,
            "file": str(self.target),
            "columns": [
                {"column": c.place + 1, "axis": c.axis, "signal": c.signal, "unit": c.unit} for c in self.columns
            ],
            "rate_Hz": round(self.rate, 4),
            "samples": self.samples,
            "notes": list(self.notes),
            "questions": list(self.questions),
            "new_test": self.new_test,
        }


def import_log(
    campaign: Path,
    source: Path,
    test: str | None = None,
    signals: tuple[str, ...] = (),
    controller: str | None = None,
    options: Options | None = None,
    force: bool = False,
    preview: bool = False,
) -> ImportedLog:
    """Bring one recording into a campaign.

    Args:
        campaign: Its folder.
        source: A table as text, or a file of a known format.
        test: Name of the log; by default that of the file.
        signals: Columns that the header does not name well: ``X_command=2:mm``, column by name or number from 1.
        controller: Name of the controller that ran.
        options: How the file is to be read.
        force: Replace a recording that is there.
        preview: Write nothing.

    Raises:
        InputError: The file cannot be read, or a column or its unit is not known.
    """
    options = options or Options()
    file = campaign_file(campaign)
    c = campaign_from(file, parse(file), traces=False, empty=True)
    logs = c.of(LogTest.instrument)
    chain = logs.tests[0].chain if logs.tests else _chain(c)
    table = read_any(source, options)
    columns = columns_of(table, chain, signals, options)
    time, values, notes = _converted(source, table, columns, options)
    axes = tuple(dict.fromkeys(col.axis for col in columns if col.axis))
    name = test or test_name(source)
    known = next((t for t in logs.tests if t.name == name), None)
    target = file.parent / (known.trace if known and known.trace else f"traces/{name}.csv.gz")
    if not preview:
        check_writable(target, force)
    data = _csv(time, values)
    log = known or LogTest(name, axes, controller, name, target.relative_to(file.parent).as_posix(), None, chain)
    rate = 1.0 / float(np.median(np.diff(time)))
    stated = logs.instruments.get(LogTest.instrument, Recorder(rate)).rate
    questions = _questions(log, axes, values, time, stated, columns)
    if not preview:
        text = read_text(file)
        if known is None or known.trace is None:
            text = _with_test(text, replace(log, trace=target.relative_to(file.parent).as_posix()), known is None, rate)
        campaign_from(file, tomlkit.parse(text).unwrap(), traces=False)  # what would be refused later is not written
        packed = gzip.compress(data, mtime=0) if target.suffix == ".gz" else data
        write_all({target: packed, file: text.encode()}, force=True)
    return ImportedLog(source, name, target, columns, rate, len(time), notes, questions, known is None)


def _chain(campaign) -> Chain:
    from mjsim.campaign.machine_file import read_machine

    return read_machine(campaign.machine_file).chain


def _converted(source: Path, table: Table, columns: tuple[Column, ...], options: Options):
    """Times (n,) s, values by column name of a campaign's CSV, and notes."""
    notes, values = list(table.notes), table.values
    whole = np.isfinite(values[:, [c.place for c in columns]]).all(axis=1)
    if not whole.all():
        notes.append(f"{int((~whole).sum())} rows are left out: they have empty cells")
    values = values[whole]
    if len(values) < 100:
        raise InputError(f"{source}: {len(values)} whole rows; allowed: at least 100")
    clock = next((c for c in columns if c.signal == "time"), None)
    if clock is None:
        time = np.arange(len(values)) / (options.rate or 1.0)
    else:
        unit = clock.unit or "s"
        time = values[:, clock.place] * factor(unit, "time")
        step = float(np.median(np.diff(time)))
        if not clock.unit and step >= 0.05:
            time, unit = time * 1e-3, "ms"
            notes.append(f"time has no unit; {step:g} from sample to sample, so it is taken for ms")
        keep = np.concatenate([[True], np.diff(time) > 0.0])
        if not keep.all():
            notes.append(f"{int((~keep).sum())} rows are left out: their time was there before")
            time, values = time[keep], values[keep]
    out: dict[str, np.ndarray] = {}
    for c in columns:
        column = values[:, c.place]
        if c.signal in ("command", "actual", "lag"):
            angle = c.unit in ("deg", "rad")
            size = factor(c.unit, "angle" if angle else "deviation") / (DEG if angle else MM)
            out[f"{c.axis}_{c.signal}_{'deg' if angle else 'mm'}"] = column * size
        elif c.axis:
            out[f"{c.axis}_{c.signal}_{c.unit}"] = column
    notes += _without_lag(out)
    return time - time[0], out, tuple(notes)


def _without_lag(values: dict[str, np.ndarray]) -> list[str]:
    """Put the position that a following error stands for in its place; what was done, a sentence each."""
    notes = []
    for name in [n for n in values if "_lag_" in n]:
        axis, _, unit = name.split("_")
        lag, command, actual = values.pop(name), f"{axis}_command_{unit}", f"{axis}_actual_{unit}"
        if command in values:
            values[actual] = values[command] - lag
            notes.append(f"actual position of {axis}: command less following error")
        else:
            values[command] = values[actual] + lag
            notes.append(f"command of {axis}: actual position and following error")
    return notes


def _csv(time: np.ndarray, values: Mapping[str, np.ndarray]) -> bytes:
    text = io.StringIO()
    kinds = ["position" if name.endswith(("_mm", "_deg")) else "other" for name in values]
    np.savetxt(
        text,
        np.column_stack([time, *values.values()]),
        delimiter=",",
        header=",".join(["time_s", *values]),
        comments="",
        fmt=["%.7f", *[_DIGITS[k] for k in kinds]],
    )
    return text.getvalue().encode()


def _with_test(text: str, test: LogTest, new: bool, rate: float) -> str:
    """campaign.toml with a table for a new log, or with the trace of one that had none."""
    document = tomlkit.parse(text)
    if not new:
        next(t for t in document["test"] if t.get("name") == test.name)["trace"] = test.trace  # pyright: ignore
        return tomlkit.dumps(document)
    table = tomlkit.table()
    table["name"], table["kind"], table["trace"] = test.name, LOG, test.trace
    table["axes"] = list(test.axes)
    if test.controller is not None:
        table["controller"] = test.controller
    if "test" not in document:
        document.add(tomlkit.nl())
        document.append("test", tomlkit.aot())
    with_recorder(document, rate)
    if len(document["test"]):  # pyright: ignore[reportArgumentType]
        document["test"][-1].add(tomlkit.nl())  # pyright: ignore[reportAttributeAccessIssue, reportIndexIssue]
    document["test"].append(table)  # pyright: ignore[reportAttributeAccessIssue, reportArgumentType]
    return tomlkit.dumps(document)


def _questions(
    test: LogTest,
    axes: tuple[str, ...],
    values: Mapping[str, np.ndarray],
    time: np.ndarray,
    rate: float,
    columns: tuple[Column, ...],
) -> tuple[str, ...]:
    """What the recording shows to be wrong, and the options that put exchanged columns right."""
    records = {}
    for axis in axes:
        unit = "deg" if test.chain.is_rotary(axis) else "mm"
        size = DEG if unit == "deg" else MM
        command, actual = (values[f"{axis}_{s}_{unit}"] * size for s in ("command", "actual"))
        records[axis] = AxisRecord(command, actual)
    recording = Recording(time, records)
    found = log_mistakes((replace(test, axes=axes),), {test.name: recording}, rate)
    return tuple(m.sentence + _remedy(m, columns) for m in found)


def _remedy(mistake: LogMistake, columns: tuple[Column, ...]) -> str:
    """The options that exchange command and actual position; empty for other mistakes."""
    if mistake.kind != "exchanged":
        return ""
    at = {(c.axis, c.signal): c for c in columns}
    pairs = [(a, s, at[a, o]) for a in mistake.axes for s, o in (("command", "actual"), ("actual", "command"))]
    return ": say " + " ".join(f"--signal {a}_{s}={c.place + 1}:{c.unit}" for a, s, c in pairs)
