"""Which column of a table is which channel of which axis: from options, from its format, from words of its header."""

from __future__ import annotations

import re
from dataclasses import dataclass

from mjsim.errors import InputError
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.importing.units import QUANTITIES, TIME_WORDS, bare, unit_named, unit_of_column
from mjsim.io.inputs import shown
from mjsim.machine.chain import Chain

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
        place = _place(table, options.time) if options.time else _time_column(table)
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
        few = ", ".join(f'{p + 1} "{table.names[p]}"' if table.names[p] else str(p + 1) for p in unused[:8])
        more = f" and {len(unused) - 8} more" if len(unused) > 8 else ""
        notes.append(f"not taken, as no channel of an axis: column{'s' if len(unused) > 1 else ''} {few}{more}")
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


def _place(table: Table, column: str) -> int:
    if column in table.names:
        return table.names.index(column)
    if column.isdigit() and 1 <= int(column) <= table.values.shape[1]:
        return int(column) - 1
    raise InputError(f"{table.path}: no column {shown(column)}; allowed: {table.columns}, by name or number")


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
    place = _place(table, column)
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
