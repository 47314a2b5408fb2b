"""Axis logs of other systems into a campaign: which column is which signal of which axis, and in which unit."""

from __future__ import annotations

import gzip
import io
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from mjsim.campaign.files import campaign_from
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.importing.formats import read_any
from mjsim.importing.into_campaign import campaign_file, test_name
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.importing.units import QUANTITIES, TIME, TIME_WORDS, bare, factor, unit_named, unit_of_column
from mjsim.instruments.axis_log.files import FEWEST, GAP, LOG
from mjsim.instruments.axis_log.instrument import LogMistake, log_mistakes
from mjsim.instruments.axis_log.measurement import AxisRecord, LogTest, Recorder, Recording
from mjsim.io.files import check_writable, write_all
from mjsim.io.inputs import shown
from mjsim.io.toml import parse, read_text
from mjsim.machine.chain import Chain
from mjsim.units import AMPERE, DEG, MM

# -- which column of a table is which channel of which axis ------------------------------------------------------------

#: Words of headers, English and German, for each channel; in lower case.
_WORDS = {
    "command": {"command", "commanded", "cmd", "setpoint", "set", "reference", "ref", "nominal", "nom", "noml", "soll",
                "sollwert", "sollposition", "lagesollwert", "demand", "target", "des", "desired"},
    "actual": {"actual", "act", "feedback", "fb", "encoder", "enc", "measured", "ist", "istwert", "istposition",
               "lageistwert", "readback", "rbv"},
    "lag": {"lag", "following", "diff", "dif", "schleppabstand", "schleppfehler"},
    "load": {"load", "second", "scale", "resolver", "direct", "lastseite"},
    "torque": {"torque", "moment", "drehmoment"},
    "force": {"force", "kraft"},
    "current": {"current", "strom", "iq"},
    "control": {"control", "output", "stellgröße", "stellgroesse"},
    "velocity": {"velocity", "speed", "v", "vel", "geschwindigkeit", "drehzahl"},
    "velocity_command": {"vcmd"},
}  # fmt: skip
#: Quantity of each channel, of a linear and of a rotary axis: keys of :data:`mjsim.importing.units.QUANTITIES`.
QUANTITY = {
    **dict.fromkeys(("command", "actual", "load", "lag"), ("deviation", "angle")),
    **dict.fromkeys(("velocity_command", "velocity"), ("velocity", "turning")),
    **{name: (name, name) for name in ("torque", "force", "current", "control")},
}
#: Words of quantities that are no channel. (A following error is ``lag``.)
_OTHER = {
    "acceleration", "beschleunigung", "jerk", "ruck", "error", "deviation", "regeldifferenz", "power", "feedforward",
    "ffw",
}  # fmt: skip
_POSITIONS = ("command", "actual")
_SIGNAL = re.compile(r"([A-Z])_([a-z_]+)=(.+)")


def quantity(signal: str, rotary: bool) -> str:
    """What a channel measures, a key of :data:`mjsim.importing.units.QUANTITIES`."""
    return QUANTITY[signal][rotary]


def allowed_units(signal: str, rotary: bool) -> list[str]:
    """Units in which a channel may be recorded."""
    return [
        u
        for u in QUANTITIES[quantity(signal, rotary)]
        if signal not in ("command", "actual", "load", "lag") or u != "V"
    ]


@dataclass(frozen=True)
class Column:
    """One column of a file.

    Attributes:
        axis: Letter; empty for the time.
        signal: ``time``, or a key of :data:`QUANTITY`; ``lag`` is the command less the actual position.
        place: Of the column, from 0.
        unit: As the file has it; empty where nothing says it.
    """

    axis: str
    signal: str
    place: int
    unit: str


def columns_of(
    table: Table, chain: Chain, signals: tuple[str, ...], options: Options
) -> tuple[tuple[Column, ...], list[str]]:
    """Which column is what: as the user says, otherwise as the format or the words of the header say.

    Returns:
        The columns, and a sentence for each thing that was left out.

    Raises:
        InputError: A signal is no signal, a column is not there, or an axis has no command or no actual position.
    """
    said = [_said(table, chain, s) for s in signals]
    taken = {c.place for c in said}
    out = {(c.axis, c.signal): c for c in said}
    notes: list[str] = []
    if options.rate is None:
        place = table.place(options.time) if options.time else _time_column(table)
        if place is not None:
            unit = options.time_unit or unit_of_column(table.names[place], table.units[place], "time") or ""
            out[("", "time")] = Column("", "time", place, unit)
            taken.add(place)
    letters = _letters(table, chain, options, notes)
    stated, unused = any(a and signal for a, signal in table.channels), []
    for place, name in enumerate(table.names):
        if place in taken:
            continue
        found = _stated(table, place, letters) if stated else _guessed(name, table.units[place], chain)
        if found is None or found in out:
            unused.append(place)
            continue
        axis, signal = found
        unit = _unit(name, table.units[place], signal, chain.is_rotary(axis))
        if not unit and signal in ("torque", "force", "current", "control"):
            notes.append(f'column {place + 1} "{name}" is not taken: {signal} without a unit, --signal {axis}_{signal}='
                         f"{place + 1}:{allowed_units(signal, False)[0]}")  # fmt: skip
            continue
        out[found] = Column(axis, signal, place, unit)
    _check_complete(table, chain, out, options)
    unused = [p for p in unused if not table.channels or not table.channels[p][0] or table.channels[p][0] in letters]
    if unused:
        notes.append(f"not taken, as no channel of an axis: {table.listed(unused)}")
    return tuple(out.values()), notes


def _check_complete(table: Table, chain: Chain, out: dict[tuple[str, str], Column], options: Options) -> None:
    """Refuse columns that lack the time, a position or a unit; take the following error out where it is not needed."""
    if ("", "time") not in out and options.rate is None:
        raise InputError(f"{table.path}: no column of the time in {table.columns}; say --time COLUMN or --rate HZ")
    axes = {a for a, signal in out if signal in (*_POSITIONS, "lag")}
    for key in [k for k in out if k[0] and k[0] not in axes]:
        del out[key]  # of an axis without a position
    if not axes:
        raise InputError(
            f"{table.path}: no column names an axis and a signal: {table.columns}; say --signal "
            f"{chain.letters[0]}_command=COLUMN:UNIT and --signal {chain.letters[0]}_actual=COLUMN:UNIT"
        )
    for axis in sorted(axes):
        missing = [s for s in _POSITIONS if (axis, s) not in out]
        if not missing or len(missing) == 2:
            out.pop((axis, "lag"), None)
        for signal in missing:
            if (axis, "lag") not in out:
                raise InputError(
                    f"{table.path}: no {signal} position of {axis} in {table.columns}; say --signal "
                    f"{axis}_{signal}=COLUMN:UNIT"
                )
    for c in out.values():
        if not c.unit and c.signal in (*_POSITIONS, "lag", "load"):
            what = "following error" if c.signal == "lag" else f"{c.signal} position"
            allowed = ", ".join(allowed_units(c.signal, chain.is_rotary(c.axis))[1:])
            raise InputError(
                f"{table.path}: column {c.place + 1} ({what} of {c.axis}) has no unit; say --signal "
                f"{c.axis}_{c.signal}={c.place + 1}:{'deg' if chain.is_rotary(c.axis) else 'mm'} (or {allowed})"
            )


def _letters(table: Table, chain: Chain, options: Options, notes: list[str]) -> dict[str, str]:
    """Letter of the machine for each axis that the format names.

    The user's word comes first, then the same letter, then the letter in front of a digit (``X1``). The only axis of a
    file is the only axis of a machine.
    """
    there = list(dict.fromkeys(a for a, signal in table.channels if a and signal))
    said = dict(options.axes)
    for name, letter in said.items():
        if name not in there or letter not in chain.letters:
            named = ", ".join(there) or "it names none"
            raise InputError(
                f"--file-axis {shown(name)}={shown(letter)}; allowed: an axis of the file ({named}) and one of the "
                f"machine ({', '.join(chain.letters)})"
            )
    out = dict(said)
    for name in there:
        letter = name.rstrip("0123456789")
        if name not in out and letter in chain.letters and letter not in out.values():
            out[name] = letter
    if not out and len(there) == 1 and chain.count == 1:
        out[there[0]] = chain.letters[0]
        notes.append(f"axis {there[0]} of the file is taken for {chain.letters[0]}, the machine's only one")
    left = [a for a in there if a not in out]
    if left:
        notes.append(
            f"axes of the file that the machine does not have: {', '.join(left)} (--file-axis {left[0]}=LETTER)"
        )
    return out


def _stated(table: Table, place: int, letters: dict[str, str]) -> tuple[str, str] | None:
    """Axis and channel that a file's format states."""
    axis, signal = table.channels[place]
    return (letters[axis], signal) if axis in letters and signal in QUANTITY else None


def _said(table: Table, chain: Chain, text: str) -> Column:
    match = _SIGNAL.fullmatch(text)
    if not match or match[2] not in QUANTITY or match[1] not in chain.letters:
        example = f"{chain.letters[0]}_command=2:mm"
        raise InputError(
            f"--signal {shown(text)}; allowed: AXIS_SIGNAL=COLUMN:UNIT such as {example}, with an axis of "
            f"{', '.join(chain.letters)} and a signal of {', '.join(QUANTITY)}"
        )
    axis, signal, rest = match.groups()
    rotary = chain.is_rotary(axis)
    column, unit = rest, ""
    if rest not in table.names and ":" in rest:  # the name of a column may hold a colon itself
        column, _, unit = rest.rpartition(":")
    place = table.place(column)
    if not unit:
        return Column(axis, signal, place, _unit(table.names[place], table.units[place], signal, rotary))
    known = unit_named(unit, quantity(signal, rotary))
    if known not in allowed_units(signal, rotary):
        allowed = ", ".join(allowed_units(signal, rotary))
        raise InputError(f"--signal {shown(text)}; allowed units for {signal} of {axis}: {allowed}")
    return Column(axis, signal, place, known or "")


def _time_column(table: Table) -> int | None:
    return next((i for i, n in enumerate(table.names) if bare(n) in TIME_WORDS or n.lower() in TIME_WORDS), None)


def _guessed(name: str, unit: str, chain: Chain) -> tuple[str, str] | None:
    """Axis and channel that a column's name tells; nothing where it tells none, or two.

    On a machine of one axis, the name need not say which.
    """
    inside = re.compile(r"\[([^\]]*)\]|\(([^)]*)\)")
    units = {u for q in ("torque", "force", "current", "control") for u in QUANTITIES[q]}
    plain = inside.sub(lambda m: f" {m[2]} " if m[2] and len(m[2]) == 1 and m[2] not in units else " ", name)
    words = [w for w in re.split(r"[^A-Za-zÄÖÜäöü]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", plain)) if w]
    axes = {w.upper() for w in words if len(w) == 1 and w.upper() in chain.letters}
    axes = axes or (set(chain.letters) if chain.count == 1 else set())
    small = {w.lower() for w in words}
    if len(axes) != 1 or (small & _OTHER and not small & _WORDS["lag"]):
        return None
    axis = axes.pop()
    signal = _signal({s for s, known in _WORDS.items() if small & known})
    if signal == "load" and not _unit(name, unit, "load", chain.is_rotary(axis)) and "%" in name + unit:
        return None  # how much of its torque a drive gives
    return (axis, signal) if signal else None


def _signal(found: set[str]) -> str:
    """The channel that some words mean together; empty where they mean none, or two."""
    what = found - {"command", "actual"}
    if what == {"velocity"}:
        return "velocity_command" if found >= {"command"} and "actual" not in found else "velocity"
    if what and what <= {"torque", "force", "current", "control"} and "command" in found:
        return ""  # what the loop asks for is not what the motor gives
    if what == {"load"} or (len(what) == 1 and "lag" not in what):
        return what.pop() if "command" not in found else ""
    return found.pop() if len(found) == 1 else ""


def _unit(name: str, own: str, signal: str, rotary: bool) -> str:
    """The unit that a header states; of ``mm|deg`` the one that the axis has."""
    own = own.split("|")[rotary] if "|" in own else own
    return unit_of_column(name, own, quantity(signal, rotary)) or ""


# -- the table of the recorder in a campaign that had ball-bar tests only ----------------------------------------------

#: What the two instruments are called.
BAR, CONTROL = "bar", "control"


def with_recorder(document: Any, rate: float) -> None:
    """Give a parsed campaign.toml the rate of its recorder, and a table for it beside a ball bar's.

    Args:
        document: With all its tables.
        rate: Samples per second of the recording, Hz.
    """
    tables = document.get("test", [])
    bars = [t for t in tables if t.get("kind") != LOG]
    present = document.get("instrument", {})
    named = bool(present) and all(isinstance(v, dict) for v in present.values())
    kinds = [v.get("kind", "ball_bar") for v in present.values()] if named else []
    for recorder in [present, *present.values()] if named else [present]:
        if recorder.get("kind") == "axis_log" and "sample_rate_Hz" not in recorder:
            recorder["sample_rate_Hz"] = float(f"{rate:.6g}")
    if not bars or "axis_log" in kinds:
        return
    instruments = tomlkit.table(is_super_table=True)
    if named:
        for name, table in present.items():
            instruments[name] = table
    else:
        instruments[BAR] = {"kind": "ball_bar"} | {k: v for k, v in present.items()}
    recorder = tomlkit.table()
    recorder["kind"], recorder["sample_rate_Hz"] = "axis_log", float(f"{rate:.6g}")
    instruments[CONTROL] = recorder
    document["instrument"] = instruments


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
        InputError: The file cannot be read, a column or its unit is not known, or the machine has no such controller.
    """
    options = options or Options()
    file = campaign_file(campaign)
    c = campaign_from(file, parse(file), traces=False, empty=True)
    logs = c.of(LogTest.instrument)
    chain = logs.tests[0].chain if logs.tests else read_machine(c.machine_file).chain
    table = read_any(source, options)
    columns, said = columns_of(table, chain, signals, options)
    stated = _stated_rate(file)
    time, values, notes = _converted(source, table, columns, chain, options, stated)
    columns = tuple(c for c in columns if c.signal in ("time", "lag") or any(_is_of(n, c) for n in values))
    axes = tuple(dict.fromkeys(col.axis for col in columns if col.axis))
    _check_controller(c, controller, axes)
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


def _check_controller(campaign: Campaign, controller: str | None, axes: tuple[str, ...]) -> None:
    """Refuse a controller that the machine file does not state for all axes of a log."""
    if controller is None:
        return
    known = read_machine(campaign.machine_file).controllers
    able = [name for name, tables in known.items() if tables.keys() >= set(axes)]
    if controller not in able:
        allowed = ", ".join(able) or "none, write [controller.NAME.AXIS] there"
        raise InputError(
            f"{campaign.machine_file}: no controller {shown(controller)} of {' and '.join(axes)}; allowed: {allowed}"
        )


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
        positions = {s: values.get(f"{axis}_{s}_{unit}") for s in ("command", "actual", "load")}
        records[axis] = AxisRecord(**{s: x * size for s, x in positions.items() if x is not None})
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
