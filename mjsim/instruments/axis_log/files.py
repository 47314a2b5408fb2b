"""Axis logs of a campaign: their ``[[test]]`` tables, and the CSV files with one column for every signal."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from mjsim.errors import InputError
from mjsim.instruments.axis_log.measurement import AxisRecord, Circle, LogTest, Recording
from mjsim.instruments.axis_log.signals import without_holds
from mjsim.instruments.schema import Length, Table, Text, printable
from mjsim.io.inputs import check_rows, csv_rows, csv_text, shown
from mjsim.io.times import check_growing
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM

#: Kind of a test that is an axis log.
LOG = "log"
#: What follows the axis letter in a column's name -> (signal, factor to SI).
SIGNALS = {
    "command_mm": ("command", MM),
    "command_deg": ("command", DEG),
    "actual_mm": ("actual", MM),
    "actual_deg": ("actual", DEG),
    "load_mm": ("load", MM),
    "load_deg": ("load", DEG),
    "torque_Nm": ("torque", 1.0),
    "force_N": ("force", 1.0),
    "current_A": ("current", 1.0),
    "control_V": ("control", 1.0),
    "torque_percent": ("torque_share", 0.01),
    "current_percent": ("current_share", 0.01),
    "control_percent": ("control_share", 0.01),
    "velocity_mm_per_s": ("velocity", MM),
    "velocity_deg_per_s": ("velocity", DEG),
    "velocity_command_mm_per_s": ("velocity_command", MM),
    "velocity_command_deg_per_s": ("velocity_command", DEG),
}
#: A step of so many usual ones is a gap: the command inside it is not known.
GAP = 10.0
#: Fewest samples of a log.
FEWEST = 100


class CircleTable(Table):
    plane: Annotated[str, Field(min_length=2, max_length=2)]
    centre_mm: Annotated[list[Length], Field(min_length=2, max_length=2)]
    radius_mm: Annotated[float, Field(gt=0, le=10_000)]
    direction: Literal["CCW", "CW"] = "CCW"


class LogTable(Table):
    """A ``[[test]]`` table of an axis log."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=100)]
    kind: Literal["log"]
    axes: Annotated[list[str], Field(min_length=1, max_length=9)]
    trace: str | None = None
    controller: Text | None = None
    setup: Annotated[str, Field(max_length=200), AfterValidator(printable)] | None = None
    circle: CircleTable | None = None
    span_s: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None


def log_test(file: Path, t: LogTable, chain: Chain) -> LogTest:
    """The log that a ``[[test]]`` table describes.

    Args:
        file: Where it stands.
        t: The table.
        chain: Axes of the machine.

    Raises:
        InputError: An axis is none of the machine.
    """
    place = f'{file}: [[test]] "{t.name}"'
    for axis in t.axes:
        if axis not in chain.letters or t.axes.count(axis) > 1:
            raise InputError(f"{place}: axes = {t.axes}; allowed: each of {', '.join(chain.letters)} at most once")
    circle = None
    if t.circle is not None:
        first, second = t.circle.plane
        if first == second or not {first, second} <= set(t.axes) & set(chain.linear):
            raise InputError(f'{place}: circle plane = "{t.circle.plane}"; allowed: two linear axes out of axes')
        x, y = (c * MM for c in t.circle.centre_mm)
        circle = Circle((first, second), (x, y), t.circle.radius_mm * MM, t.circle.direction)
    span = None
    if t.span_s is not None:
        first, last = t.span_s
        if not 0.0 <= first < last:
            raise InputError(f"{place}: span_s = {t.span_s}; allowed: [from, to] in seconds, from 0, growing")
        span = (first, last)
    return LogTest(t.name, tuple(t.axes), t.controller, t.setup or t.name, t.trace, circle, chain, span)


def read_recording(path: Path, test: LogTest) -> Recording:
    """Read the CSV of one log, plain or compressed (``.csv.gz``).

    Args:
        path: The file.
        test: What it is to hold.

    Raises:
        InputError: names the file, the line or column, what was found and what is allowed.
    """
    first, body = csv_text(path)
    names = [n.strip() for n in first.split(",")]
    columns = _header(path, names, test)
    check_rows(path, body.count("\n"))
    table = _numbers(path, body, names)
    if test.span is not None:
        table = _within(path, table, test)
    check_clock(path, table[:, 0])
    time = table[:, 0]
    axes = {a: _record(table, columns[a]) for a in test.axes}
    return without_holds(Recording(time - time[0], axes))


def _within(path: Path, table: np.ndarray, test: LogTest) -> np.ndarray:
    """The rows inside a log's span."""
    assert test.span is not None
    time = table[:, 0] - table[0, 0]
    part = table[(time >= test.span[0]) & (time <= test.span[1])]
    if len(part) < FEWEST:
        first, last = test.span
        raise InputError(
            f'{path}: span_s of test "{test.name}" leaves {len(part)} samples between {first:g} and {last:g} s of '
            f"{time[-1]:.4g} s; allowed: at least {FEWEST}"
        )
    return part


def _header(path: Path, names: list[str], test: LogTest) -> dict[str, dict[str, tuple[int, float]]]:
    """Column and factor to SI of every signal, by axis and signal."""
    if not names or names[0] != "time_s":
        said = f"line 1: the first column is {shown(names[0] if names else '')}"
        raise InputError(f"{path}, {said}; allowed: time_s, then columns such as {test.axes[0]}_command_mm")
    out: dict[str, dict[str, tuple[int, float]]] = {a: {} for a in test.axes}
    for i, name in enumerate(names[1:], start=1):
        axis, _, ending = name.partition("_")
        if ending not in SIGNALS or len(axis) != 1:
            allowed = ", ".join(f"{test.axes[0]}_{ending}" for ending in SIGNALS)
            raise InputError(f"{path}, line 1: column {shown(name)}; allowed: time_s, {allowed}")
        signal, factor = SIGNALS[ending]
        rotary = test.chain.is_rotary(axis)
        if axis in test.axes and (("_mm" in f"_{ending}" and rotary) or ("_deg" in f"_{ending}" and not rotary)):
            kind = "rotary axis is in deg" if rotary else "linear axis is in mm"
            raise InputError(f"{path}, line 1: column {name}; a {kind}")
        if axis in out:
            if signal in out[axis]:
                raise InputError(f"{path}, line 1: {signal} of {axis} appears twice; allowed: once")
            out[axis][signal] = (i, factor)
    for axis, found in out.items():
        for signal in ("command", "actual"):
            if signal not in found:
                unit = "deg" if test.chain.is_rotary(axis) else "mm"
                raise InputError(f"{path}, line 1: the column {axis}_{signal}_{unit} is missing")
    return out


def _numbers(path: Path, body: str, names: list[str]) -> np.ndarray:
    """Numbers of all samples, (n, columns): a recording is long, and is read line by line only where one is wrong."""
    try:
        table = np.loadtxt(body.splitlines(), delimiter=",", ndmin=2, comments=None)
    except ValueError:
        table = np.zeros((0, 0))
    if table.shape[1] != len(names) or not np.isfinite(table).all():
        table, _ = csv_rows(path, body, names)
    if len(table) < FEWEST:
        raise InputError(f"{path}: {len(table)} samples; allowed: at least {FEWEST}")
    return table


def check_clock(path: Path, time: np.ndarray) -> None:
    """Refuse times that stand still or run backwards, and recordings with gaps.

    Raises:
        InputError: names the line.
    """
    check_growing(path, time, lambda i: i + 2)
    steps = np.diff(time)
    usual = float(np.median(steps))
    if steps.max() > GAP * usual:
        i = int(np.argmax(steps))
        raise InputError(
            f"{path}, line {i + 3}: {steps[i]:.3g} s without a sample, where every other one follows within "
            f"{usual:.3g} s; allowed: a recording without gaps, "
            f"span_s takes a part, and mjsim import --log makes several of one"
        )


def _record(table: np.ndarray, columns: dict[str, tuple[int, float]]) -> AxisRecord:
    found = {signal: np.ascontiguousarray(table[:, i] * factor) for signal, (i, factor) in columns.items()}
    return AxisRecord(**found)
