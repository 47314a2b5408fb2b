"""Which column is what, and in which unit: from options, from headers, and from the test where only one answer fits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.table import Table
from mjsim.importing.units import QUANTITIES, TIME_WORDS, bare, factor, unit_of_column
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.units import DEG, MM, UM

#: What headers call a column, without its unit, lower case.
_WORDS = {
    "time": TIME_WORDS,
    "angle": {"angle", "phi", "φ", "theta", "winkel", "position angle", "a", "deg", "degrees"},
    "deviation": {
        "deviation", "dev", "radial deviation", "radius deviation", "radial error", "abweichung", "reading", "measured",
        "ball bar", "ballbar", "bar", "length", "radius", "r", "dr", "d", "error",
    },
}  # fmt: skip
#: How far a mean length may lie from the bar's for a column to be taken for absolute lengths, m.
_NEAR = 5.0 * MM


@dataclass(frozen=True)
class Options:
    """How a file is to be read. What is ``None`` comes from the file, or from the test where only one answer fits.

    Attributes:
        separator, decimal, rows: as :func:`mjsim.importing.table.read_table`.
        time, angle, deviation: columns, by name or number from 1. rate: samples per second where there is neither time
            nor angle.
        time_unit, angle_unit, deviation_unit: keys of :mod:`mjsim.importing.units`. um_per_volt: the sensor's scale.
        inward: the file counts a shorter bar as positive. absolute: the column holds the bar's length, not its change.
        clock: ``program`` (times count from the start of the NC program) or ``trace`` (the first sample is where the
            trace begins).
        angle_zero: the file's angle (rad) at φ = 0. angle_sense: ``ccw`` or ``cw``, which way the file's angle counts.
        axes: axes of the file and the letters that the machine has for them, for axis logs.
        start_angle: φ (rad) of the first sample, where a test begins elsewhere than at φ = 0.
    """

    separator: str | None = None
    decimal: str | None = None
    rows: tuple[int, int] | None = None
    time: str | None = None
    angle: str | None = None
    deviation: str | None = None
    rate: float | None = None
    time_unit: str | None = None
    angle_unit: str | None = None
    deviation_unit: str | None = None
    um_per_volt: float | None = None
    inward: bool = False
    absolute: bool | None = None
    clock: str | None = None
    angle_zero: float = 0.0
    angle_sense: str | None = None
    start_angle: float | None = None
    axes: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        for name in ("rate", "um_per_volt", "angle_zero", "start_angle"):
            value = getattr(self, name)
            if value is not None and not abs(value) < 1e9:
                raise InputError(f"{name} = {value:g}; allowed: a finite number of ordinary size")
        if self.rate is not None and self.rate < 1e-3:
            raise InputError(f"--rate {self.rate:g}; allowed: samples per second, above 0.001")


@dataclass(frozen=True)
class Recording:
    """A file's columns in SI.

    Attributes:
        deviation: (n,) m, outward positive, nan where missing. time: (n,) s, or ``None``. angle: (n,) rad, or ``None``.
            lines: (n,).
        unit: of the deviation in the file. notes: what was found and what was concluded.
    """

    deviation: np.ndarray
    time: np.ndarray | None
    angle: np.ndarray | None
    lines: np.ndarray
    unit: str
    notes: tuple[str, ...]


def read_columns(table: Table, test: BallBarTest, o: Options) -> Recording:
    """Time or angle, and deviation, of a table.

    Raises:
        InputError: a column or unit is missing, or cannot be concluded; the message names the option that gives it.
    """
    notes: list[str] = []
    at = {q: _column(table, q, getattr(o, q)) for q in _WORDS}
    if o.rate is not None:
        at["time"] = at["angle"] = None
    elif at["time"] is not None and at["angle"] is not None and o.time is None:
        if o.angle is None:
            notes.append("both time and angle are there: the time is used (--angle COLUMN uses the angle)")
        at["time" if o.angle else "angle"] = None
    elif o.time is not None:
        at["angle"] = None
    _the_rest(table, at, o)
    time = angle = None
    if at["time"] is not None:
        time = _finite(table, at["time"], "time") * _time_factor(table, at["time"], test, o, notes)
    elif at["angle"] is not None:
        angle = _finite(table, at["angle"], "angle") * _angle_factor(table, at["angle"], test, o, notes)
    elif o.rate:
        time = np.arange(len(table.lines)) / o.rate
    deviation, unit = _deviation(table, at["deviation"], test, o, notes)
    return Recording(deviation, time, angle, table.lines, unit, tuple(notes))


def _column(table: Table, quantity: str, given: str | None) -> int | None:
    """Index of a column that the user names, or that its header names."""
    if given is None:
        hits = [i for i, n in enumerate(table.names) if n and bare(n) in _WORDS[quantity]]
        return hits[0] if len(hits) == 1 else None
    if given.isdigit() and given.isascii():
        if 1 <= int(given[:9]) <= len(table.names):
            return int(given) - 1
    else:
        hits = [i for i, n in enumerate(table.names) if n.lower() == given.lower()]
        hits = hits or [i for i, n in enumerate(table.names) if n and bare(n) == given.lower()]
        if len(hits) == 1:
            return hits[0]
    raise InputError(f"{table.path}: no column {given!r} for --{quantity}; the file has {table.columns}")


def _the_rest(table: Table, at: dict[str, int | None], o: Options) -> None:
    """Find the deviation by exclusion, and say what is missing."""
    if at["time"] is None and at["angle"] is None and not o.rate:
        raise InputError(
            f"{table.path}: which column is the time or the angle? say --time COLUMN or --angle COLUMN, or --rate "
            f"HZ where there is none; "
            f"the file has {table.columns}"
        )
    if at["deviation"] is None:
        left = [i for i in range(len(table.names)) if i not in (at["time"], at["angle"])]
        if len(left) != 1:
            raise InputError(
                f"{table.path}: which column is the deviation? say --deviation COLUMN; the file has {table.columns}"
            )
        at["deviation"] = left[0]
    used = [i for i in at.values() if i is not None]
    if len(set(used)) < len(used):
        raise InputError(f"{table.path}: one column is given for two things; the file has {table.columns}")


def _finite(table: Table, i: int, quantity: str) -> np.ndarray:
    x = table.values[:, i]
    if not np.isfinite(x).all():
        line = int(table.lines[np.flatnonzero(~np.isfinite(x))[0]])
        raise InputError(f"{table.path}, line {line}: the {quantity} is missing; allowed: a finite number in every row")
    return x


def _time_factor(table: Table, i: int, test: BallBarTest, o: Options, notes: list[str]) -> float:
    unit = o.time_unit or unit_of_column(table.names[i], table.units[i], "time")
    if unit is None:
        lasts, have = Program(test).duration, float(np.ptp(table.values[:, i]))
        fits = [u for u in QUANTITIES["time"] if 0.5 < have * factor(u, "time") / lasts < 2.0]
        if len(fits) != 1:
            raise InputError(
                f'{table.path}: the time goes over {have:g} of an unknown unit, the program of test "{test.name}" '
                f"lasts {lasts:.1f} s; "
                "say --time-unit s or ms"
            )
        unit = fits[0]
        notes.append(f"time taken for {unit}: only that fits the program of {lasts:.1f} s (--time-unit)")
    return factor(unit, "time")


def _angle_factor(table: Table, i: int, test: BallBarTest, o: Options, notes: list[str]) -> float:
    unit = o.angle_unit or unit_of_column(table.names[i], table.units[i], "angle")
    if unit is None:
        whole, have = (
            abs(np.subtract(*Program(test).measured_ends)),
            float(np.ptp(np.unwrap(table.values[:, i], period=360.0))),
        )
        have_rad = float(np.ptp(np.unwrap(table.values[:, i])))
        fits = [u for u, x in (("deg", have * DEG), ("rad", have_rad)) if 0.7 < x / whole < 1.5]
        if float(np.ptp(table.values[:, i])) > 8.0 * np.pi * max(1, test.revolutions):
            fits = [u for u in fits if u == "deg"]
        if len(fits) != 1:
            raise InputError(f"{table.path}: the angle's unit is not known; say --angle-unit deg or rad")
        unit = fits[0]
        notes.append(f"angle taken for {unit}: only that fits the test's {whole / DEG:.0f}° (--angle-unit)")
    return factor(unit, "angle")


def _deviation(table: Table, i: int | None, test: BallBarTest, o: Options, notes: list[str]) -> tuple[np.ndarray, str]:
    assert i is not None
    raw = table.values[:, i]
    if not np.isfinite(raw).any():
        raise InputError(f"{table.path}: column {i + 1} has no number; the file has {table.columns}")
    middle = float(np.nanmedian(raw))
    unit = o.deviation_unit or unit_of_column(table.names[i], table.units[i], "deviation")
    if unit is None:
        units = [
            u
            for u in QUANTITIES["deviation"]
            if u != "V" and abs(middle * factor(u, "deviation") - test.length) < _NEAR
        ]
        if len(units) != 1 or o.absolute is False:
            raise InputError(
                f"{table.path}: the deviation's unit is not known ({np.nanmin(raw):g} to {np.nanmax(raw):g}); say "
                f"--deviation-unit "
                "um, mm, inch, mil, uin or V"
            )
        unit = units[0]
        notes.append(
            f"deviation taken for {unit}: only so it is the bar's length of {test.length / MM:g} mm (--deviation-unit)"
        )
    if (unit == "V") != (o.um_per_volt is not None):
        raise InputError(
            f"{table.path}: the deviation is in {unit}; "
            + ("say --scale UM_PER_VOLT" if unit == "V" else "--scale is for volts only")
        )
    metres = raw * (o.um_per_volt * UM if o.um_per_volt is not None else factor(unit, "deviation"))
    absolute = o.absolute
    if absolute is None and unit != "V" and abs(middle * factor(unit, "deviation") - test.length) < _NEAR:
        absolute = True
        notes.append(
            f"lengths, not deviations: the bar's {test.length / MM:g} mm are subtracted (--relative keeps them)"
        )
    if absolute and o.inward:
        raise InputError(
            f"{table.path}: the column holds lengths of the bar, which grow outward; allowed: --sign outward"
        )
    if absolute:
        metres = metres - test.length
    return (-metres if o.inward else metres), unit
