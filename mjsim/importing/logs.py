"""Axis logs of other systems into a campaign: which column is which signal of which axis, and in which unit."""

from __future__ import annotations

import gzip
import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import tomlkit

from mjsim.campaign.files import campaign_from
from mjsim.errors import InputError
from mjsim.importing.formats import read_any
from mjsim.importing.into_campaign import campaign_file, test_name
from mjsim.importing.log_columns import Column, columns_of, quantity
from mjsim.importing.reading import Options
from mjsim.importing.recorder import with_recorder
from mjsim.importing.table import Table
from mjsim.importing.units import QUANTITIES, TIME, factor
from mjsim.instruments.axis_log.files import FEWEST, GAP, LOG
from mjsim.instruments.axis_log.measurement import AxisRecord, LogTest, Recorder, Recording
from mjsim.instruments.axis_log.mistakes import LogMistake, log_mistakes
from mjsim.io.files import check_writable, write_all
from mjsim.io.toml import parse, read_text
from mjsim.machine.chain import Chain
from mjsim.units import AMPERE, DEG, MM

#: A velocity agrees with the commanded motion within this share: overshoot and noise make some per cent (assumed).
VELOCITY_NEAR = 0.1
#: Units of a campaign's CSV.
_OF_QUANTITY = {"deviation": "mm", "angle": "deg", "velocity": "mm_per_s", "turning": "deg_per_s", "torque": "Nm"}
_OF_QUANTITY |= {"force": "N", "current": AMPERE, "control": "V"}
_ENDINGS = (*_OF_QUANTITY.values(), "percent")
#: Digits of a written position, mm or degrees.
_DIGITS = {"time": "%.7g", "position": "%.7f", "other": "%.7g"}


@dataclass(frozen=True)
class ImportedLog:
    """What an import did, or would do.

    Attributes:
        source: The file.
        test: Name of the log; of several, of the first.
        target: Its CSV in the campaign.
        columns: What was taken for what.
        rate: Samples per second.
        samples: Number of them, in all recordings.
        notes: What was detected.
        questions: Mistakes that the recording shows, a sentence each.
        new_test: Whether campaign.toml gets a table.
        tests: Names of all logs: a file with gaps holds several.
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
    tests: tuple[str, ...] = ()

    def to_json(self) -> dict:
        """Plain data."""
        return {
            "source": str(self.source),
            "test": self.test,
            "tests": list(self.tests),
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
    """Bring one file into a campaign. Where samples are missing for long, one recording ends and another begins.

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
    columns, said = columns_of(table, chain, signals, options)
    stated = _stated_rate(file)
    time, values, notes = _converted(source, table, columns, chain, options, stated)
    columns = tuple(c for c in columns if c.signal in ("time", "lag") or any(_is_of(n, c) for n in values))
    axes = tuple(dict.fromkeys(col.axis for col in columns if col.axis))
    name = test or test_name(source)
    parts, gaps = _parts(source, time)
    names = [name] if len(parts) == 1 else [f"{name}-{i}" for i in range(1, len(parts) + 1)]
    rate = 1.0 / float(np.median(np.diff(time)))
    expected = logs.instruments.get(LogTest.instrument, Recorder(rate)).rate if stated else rate
    known = {t.name: t for t in logs.tests}
    contents: dict[Path, bytes] = {}
    text, questions = read_text(file), []
    for own, part in zip(names, parts, strict=True):
        old = known.get(own)
        target = file.parent / (old.trace if old and old.trace else f"traces/{own}.csv.gz")
        if not preview:
            check_writable(target, force)
        at, numbers = time[part] - time[part][0], {k: v[part] for k, v in values.items()}
        data = _csv(at, numbers)
        contents[target] = gzip.compress(data, mtime=0) if target.suffix == ".gz" else data
        trace = target.relative_to(file.parent).as_posix()
        log = replace(old or LogTest(own, axes, controller, name, None, None, chain), trace=trace)
        questions += _questions(log, axes, numbers, at, expected, columns)
        if old is None or old.trace is None:
            text = _with_test(text, log, old is None, rate)
    if not preview:
        campaign_from(file, tomlkit.parse(text).unwrap(), traces=False)  # what would be refused later is not written
        write_all({**contents, file: text.encode()}, force=True)
    notes = (*table.notes, *said, *notes, *gaps)
    samples = sum(len(time[p]) for p in parts)
    first = next(iter(contents))
    new = names[0] not in known
    return ImportedLog(source, names[0], first, columns, rate, samples, notes, tuple(questions), new, tuple(names))


def _stated_rate(file: Path) -> float | None:
    """Samples per second that campaign.toml states for the recorder, Hz."""
    tables = parse(file).get("instrument", {})
    tables = [tables, *(t for t in tables.values() if isinstance(t, dict))]
    return next((t.get("sample_rate_Hz") for t in tables if t.get("kind") == "axis_log"), None)


def _chain(campaign) -> Chain:
    from mjsim.campaign.machine_file import read_machine

    return read_machine(campaign.machine_file).chain


def _parts(source: Path, time: np.ndarray) -> tuple[list[slice], list[str]]:
    """The recordings of a file, and a sentence for each gap between them and for what is too short."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    ends = np.flatnonzero(steps > GAP * usual)
    edges = [0, *(ends + 1), len(time)]
    notes = [
        f"{steps[i]:.4g} s without a sample after {time[i] - time[0]:.4g} s: another recording begins there"
        for i in ends[:5]
    ]
    notes += [f"and {len(ends) - 5} more such gaps"] if len(ends) > 5 else []
    all_parts = [slice(a, b) for a, b in pairwise(edges)]
    parts = [p for p in all_parts if p.stop - p.start >= FEWEST]
    if not parts:
        longest = max(p.stop - p.start for p in all_parts)
        raise InputError(f"{source}: {longest} samples without a gap; allowed: at least {FEWEST}")
    if len(parts) < len(all_parts):
        notes.append(f"{len(all_parts) - len(parts)} recordings of less than {FEWEST} samples are left out")
    return parts, notes


def _converted(
    source: Path,
    table: Table,
    columns: tuple[Column, ...],
    chain: Chain,
    options: Options,
    expected: float | None,
):
    """Times (n,) s, values by column name of a campaign's CSV, and notes; ``expected`` is the stated rate, Hz."""
    notes, values = [], table.values
    whole = np.isfinite(values[:, [c.place for c in columns]]).all(axis=1)
    if not whole.all():
        notes.append(f"{int((~whole).sum())} rows are left out: they have empty cells")
    values = values[whole]
    if len(values) < FEWEST:
        raise InputError(f"{source}: {len(values)} whole rows; allowed: at least {FEWEST}")
    clock = next((c for c in columns if c.signal == "time"), None)
    if clock is None:
        time = np.arange(len(values)) / (options.rate or 1.0)
    else:
        time, unit = values[:, clock.place], clock.unit
        if not unit:
            unit = _time_unit(float(np.median(np.diff(time))), expected, notes)
        time = time * factor(unit, "time")
        keep = np.concatenate([[True], time[1:] > np.maximum.accumulate(time)[:-1]])
        if not keep.all():
            notes.append(f"{int((~keep).sum())} rows are left out: their time was there before")
            time, values = time[keep], values[keep]
    time = time - time[0]
    out: dict[str, np.ndarray] = {}
    for c in columns:
        if c.axis and c.signal not in ("velocity", "velocity_command"):
            name, size = _of_campaign(c, chain.is_rotary(c.axis))
            out[name] = values[:, c.place] * size
    notes += _without_lag(out)
    for c in columns:
        if c.signal in ("velocity", "velocity_command"):
            unit, note = _velocity_unit(c, chain.is_rotary(c.axis), values[:, c.place], time, out)
            notes += [note] if note else []
            if unit:
                name, size = _of_campaign(replace(c, unit=unit), chain.is_rotary(c.axis))
                out[name] = values[:, c.place] * size
    return time, out, notes


def _time_unit(step: float, expected: float | None, notes: list[str]) -> str:
    """The unit of a time that states none: the one that fits the stated rate, else ms where the steps are large."""
    fits = [u for u, (size, _) in TIME.items() if expected and 1 / 1.5 < step * size * expected < 1.5]
    unit = fits[0] if fits else "ms" if step >= 0.05 else "s"
    if unit != "s":
        notes.append(f"time has no unit; {step:g} from sample to sample, so it is taken for {unit}")
    return unit


def _of_campaign(column: Column, rotary: bool) -> tuple[str, float]:
    """Name of a column in the CSV of a campaign, and the factor that brings the file's numbers into its unit."""
    kind = quantity(column.signal, rotary)
    if column.unit == "%":
        return f"{column.axis}_{column.signal}_percent", 1.0
    into = DEG if kind in ("angle", "turning") else MM if kind in ("deviation", "velocity") else 1.0
    return f"{column.axis}_{column.signal}_{_OF_QUANTITY[kind]}", factor(column.unit, kind) / into


def _is_of(name: str, column: Column) -> bool:
    """Whether a column of the campaign's CSV is that of a column of the file."""
    return any(name == f"{column.axis}_{column.signal}_{end}" for end in _ENDINGS)


def _velocity_unit(
    column: Column, rotary: bool, values: np.ndarray, time: np.ndarray, positions: dict[str, np.ndarray]
) -> tuple[str, str]:
    """The unit of a velocity, held against the way that its axis went, and what has to be said about it.

    The way is the one commanded. Units of a velocity differ by factors of six and more, so that what the ratio says is
    sure; a ratio that is no unit's leaves the column out.
    """
    kind = quantity(column.signal, rotary)
    way = np.gradient(positions[f"{column.axis}_command_{'deg' if rotary else 'mm'}"], time)
    what = f"{column.signal.replace('_', ' ')} of {column.axis} (column {column.place + 1})"
    gone, said = (float(np.abs(x[np.abs(x) > 0.05 * np.abs(x).max()]).sum()) for x in (way, values))
    if gone == 0.0 or said == 0.0:
        return column.unit, "" if column.unit else f"{what} is not taken: no unit, and the axis does not move"
    into = DEG if rotary else MM
    ratios = {u: said * size / into / gone for u, (size, _) in QUANTITIES[kind].items()}
    if column.unit and abs(ratios[column.unit] - 1.0) < VELOCITY_NEAR:
        return column.unit, ""
    fits = [u for u, ratio in ratios.items() if abs(ratio - 1.0) < VELOCITY_NEAR and u != "inch/min"]
    if len(fits) == 1:
        return fits[0], f"{what} is in {fits[0]}: so it agrees with the commanded motion"
    return "", (
        f"{what} is not taken: it is {said / gone:.4g} times the velocity of the command in "
        f"{'°' if rotary else 'mm'}/s, which is no unit"
    )


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
    if test.setup != test.name:
        table["setup"] = test.setup
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
