"""Which column of a table is which signal of which axis: from options, and from the words of its header."""

from __future__ import annotations

import re
from dataclasses import dataclass

from mjsim.errors import InputError
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.importing.units import QUANTITIES, bare, unit_named, unit_of_column
from mjsim.io.inputs import shown
from mjsim.machine.chain import Chain

#: Words of headers, English and German, for each signal; in lower case. Longer words are looked for first.
_WORDS = {
    "command": ("command", "commanded", "cmd", "setpoint", "set", "reference", "ref", "nominal", "nom", "noml", "soll",
                "sollwert", "sollposition", "lagesollwert"),
    "actual": ("actual", "act", "feedback", "fb", "encoder", "measured", "ist", "istwert", "istposition",
               "lageistwert"),
    "lag": ("lag", "following", "diff", "dif", "schleppabstand", "schleppfehler"),
    "torque": ("torque", "moment", "drehmoment"),
    "current": ("current", "strom"),
    "control": ("control", "output", "stellgröße", "stellgroesse"),
}  # fmt: skip
#: Words of quantities that are no position, so that their setpoint is not the command and their actual value is not
#: the actual position. (A following error is ``lag``.)
_OTHER = {
    "velocity", "speed", "v", "geschwindigkeit", "drehzahl", "acceleration", "beschleunigung", "jerk", "ruck", "error",
    "deviation", "regeldifferenz", "load", "power", "vcmd",
}  # fmt: skip
_TIME = {"time", "t", "zeit", "timestamp", "sec", "seconds", "time_s"}
_ENDINGS = {"torque": "torque_Nm", "current": "current_A", "control": "control_V"}
_UNITS = {signal: ending.rpartition("_")[2] for signal, ending in _ENDINGS.items()}
_POSITIONS = ("command", "actual")
_SIGNAL = re.compile(r"([A-Z])_([a-z]+)=([^:]+)(?::(.+))?")


@dataclass(frozen=True)
class Column:
    """One column of a file.

    Attributes:
        axis: Letter; empty for the time.
        signal: ``time``, ``command``, ``actual``, ``lag`` (command less actual position), ``torque``, ``current`` or
            ``control``.
        place: Of the column, from 0.
        unit: As the file has it; empty where nothing says it.
    """

    axis: str
    signal: str
    place: int
    unit: str


def columns_of(table: Table, chain: Chain, signals: tuple[str, ...], options: Options) -> tuple[Column, ...]:
    """Which column is what: as the user says, otherwise by the words of the header.

    Raises:
        InputError: A signal is no signal, a column is not there, or an axis has no command or no actual position.
    """
    said = [_said(table, chain, s) for s in signals]
    taken = {c.place for c in said}
    out = {(c.axis, c.signal): c for c in said}
    if options.rate is None:
        place = _place(table, options.time) if options.time else _time_column(table)
        if place is not None:
            unit = options.time_unit or unit_of_column(table.names[place], table.units[place], "time") or ""
            out[("", "time")] = Column("", "time", place, unit)
            taken.add(place)
    for place, name in enumerate(table.names):
        found = None if place in taken else _guessed(name, table.units[place], chain)
        if found is not None and found not in out:
            axis, signal = found
            if signal in _UNITS and not _says(name, table.units[place], _UNITS[signal]):
                continue  # a torque in % or without a unit is none in N m
            out[found] = Column(axis, signal, place, _unit(name, table.units[place], signal, chain.is_rotary(axis)))
    if ("", "time") not in out and options.rate is None:
        raise InputError(f"{table.path}: no column of the time in {table.columns}; say --time COLUMN or --rate HZ")
    axes = {a for a, _ in out if a}
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
        if not c.unit and c.signal in (*_POSITIONS, "lag"):
            what = "following error" if c.signal == "lag" else f"{c.signal} position"
            raise InputError(
                f"{table.path}: column {c.place + 1} ({what} of {c.axis}) has no unit; say --signal "
                f"{c.axis}_{c.signal}={c.place + 1}:mm (or um, inch, deg, rad)"
            )
    return tuple(out.values())


def _place(table: Table, column: str) -> int:
    if column in table.names:
        return table.names.index(column)
    if column.isdigit() and 1 <= int(column) <= table.values.shape[1]:
        return int(column) - 1
    raise InputError(f"{table.path}: no column {shown(column)}; allowed: {table.columns}, by name or number")


def _said(table: Table, chain: Chain, text: str) -> Column:
    match = _SIGNAL.fullmatch(text)
    if not match or match[2] not in _WORDS or match[1] not in chain.letters:
        example = f"{chain.letters[0]}_command=2:mm"
        raise InputError(
            f"--signal {shown(text)}; allowed: AXIS_SIGNAL=COLUMN:UNIT such as {example}, with an axis of "
            f"{', '.join(chain.letters)} and a signal of {', '.join(_WORDS)}"
        )
    axis, signal, column, unit = match.groups()
    place = _place(table, column)
    if unit:
        quantity = "angle" if chain.is_rotary(axis) else "deviation"
        allowed = [_UNITS[signal]] if signal in _UNITS else [u for u in QUANTITIES[quantity] if u != "V"]
        known = unit if signal in _UNITS else unit_named(unit, quantity)
        if known not in allowed:
            raise InputError(f"--signal {shown(text)}; allowed units for {signal} of {axis}: {', '.join(allowed)}")
        unit = known
    fallback = _unit(table.names[place] if table.names else "", "", signal, chain.is_rotary(axis))
    return Column(axis, signal, place, unit or fallback)


def _time_column(table: Table) -> int | None:
    return next((i for i, n in enumerate(table.names) if bare(n) in _TIME or n.lower() in _TIME), None)


def _guessed(name: str, unit: str, chain: Chain) -> tuple[str, str] | None:
    """Axis and signal that a column's name tells; nothing where it tells none, or two.

    On a machine of one axis, the name need not say which.
    """
    inside = re.compile(r"\[([^\]]*)\]|\(([^)]*)\)")
    name = inside.sub(lambda m: f" {m[2]} " if m[2] and len(m[2]) == 1 and m[2] not in _UNITS.values() else " ", name)
    words = [w for w in re.split(r"[^A-Za-zÄÖÜäöü]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)) if w]
    axes = {w.upper() for w in words if len(w) == 1 and w.upper() in chain.letters}
    axes = axes or (set(chain.letters) if chain.count == 1 else set())
    small = {w.lower() for w in words}
    signals = {s for s, known in _WORDS.items() if small & set(known)}
    if small & _OTHER and signals <= {"command", "actual"}:
        return None
    return (axes.pop(), signals.pop()) if len(axes) == 1 and len(signals) == 1 else None


def _says(name: str, own: str, unit: str) -> bool:
    """Whether a column's header names a unit."""
    texts = [own, *re.findall(r"[\[(<]([^\])>]*)[\])>]", name), name.rpartition("_")[2]]
    return any(re.sub(r"[\s·.*]", "", t) == unit for t in texts)


def _unit(name: str, own: str, signal: str, rotary: bool) -> str:
    if signal in _UNITS:
        return _UNITS[signal]
    return unit_of_column(name, own, "angle" if rotary else "deviation") or ""
