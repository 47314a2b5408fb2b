"""Sphere tests of a campaign: their ``[[test]]`` tables, and the CSV files with one row a point."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from mjsim.errors import InputError
from mjsim.instruments.schema import Clock, Length, Number, Table, printable
from mjsim.instruments.sphere.measurement import POINT_TIME, Points, SphereTest, sides_of
from mjsim.io.inputs import check_columns, csv_table, need_columns
from mjsim.io.times import check_growing
from mjsim.machine.chain import COORDINATES, Chain, chain_of
from mjsim.units import DEG, MM, UM

#: Fewest points of a test.
FEWEST = 3
#: Columns of the measured deviations.
DEVIATIONS = tuple(f"d{c.lower()}_um" for c in COORDINATES)
#: Words of headers of other systems for what was found, before or behind the letter of a coordinate, lower case.
_FOUND = ("measured", "meas", "actual", "act", "ist", "centre", "center", "m")
_OFF = ("d", "delta", "δ", "dev", "deviation", "diff", "error", "err", "abw", "abweichung")
#: The same for what was commanded.
_NOMINAL = ("nominal", "nom", "soll", "command", "cmd")
#: Columns that a file may have besides those of axes, deviations and sides.
MORE = ("time_s", "run", "spindle_deg")

Angle = Annotated[float, Field(ge=-100_000, le=100_000, allow_inf_nan=False)]


class SphereTable(Table):
    """A ``[[test]]`` table of a sphere."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=100)]
    kind: Literal["sphere"]
    sphere_mm: Annotated[list[Length], Field(min_length=3, max_length=3)]
    trace: str | None = None
    setup: Annotated[str, Field(max_length=200), AfterValidator(printable)] | None = None
    tool_length_mm: Annotated[float, Field(gt=0, le=5000)] | None = None
    angles_deg: Annotated[list[list[Angle]], Field(max_length=1000)] = Field(default=[])
    spindle_deg: Annotated[list[Number], Field(max_length=1000)] = Field(default=[])
    approach: Annotated[list[list[Literal[-1, 1]]], Field(max_length=1000)] = Field(default=[])
    started_s: Clock = 0.0


def sphere_test(file: Path, t: SphereTable, chain: Chain) -> SphereTest:
    """The test that a ``[[test]]`` table describes.

    Args:
        file: Where it stands.
        t: The table.
        chain: Axes of the machine.

    Raises:
        InputError: The machine lacks axes, or a list has another length than it needs.
    """
    place = f'{file}: [[test]] "{t.name}"'
    if not chain.spatial or not chain.rotary:
        raise InputError(
            f"{place}: the machine has the axes {', '.join(chain.letters)}; allowed for a sphere: a machine with "
            f"{', '.join(COORDINATES)} and at least one rotary axis"
        )
    for row in t.angles_deg:
        if len(row) != len(chain.rotary):
            raise InputError(
                f"{place}: angles_deg has the row {row}; allowed: {len(chain.rotary)} numbers a row, the angles of "
                f"{', '.join(chain.rotary)}"
            )
    for key, values in (("spindle_deg", t.spindle_deg), ("approach", t.approach)):
        if values and len(values) != len(t.angles_deg):
            raise InputError(
                f"{place}: {key} has {len(values)} entries for {len(t.angles_deg)} rows of angles_deg; allowed: one "
                "for each row, or none"
            )
    for row in t.approach:
        if len(row) != len(chain.rotary):
            raise InputError(
                f"{place}: approach has the row {row}; allowed: {len(chain.rotary)} numbers a row, 1 or -1 for each of "
                f"{', '.join(chain.rotary)}"
            )
    if t.tool_length_mm is not None and chain.swivelling:
        chain = chain_of(chain.configuration, chain.placements, t.tool_length_mm * MM, chain.singular)
    x, y, z = (v * MM for v in t.sphere_mm)
    angles = tuple(tuple(a * DEG for a in row) for row in t.angles_deg)
    spindle = tuple(a * DEG for a in t.spindle_deg)
    approach = tuple(tuple(row) for row in t.approach)
    return SphereTest(t.name, (x, y, z), t.setup or t.name, t.trace, chain, angles, spindle, approach, t.started_s)


def columns_of(chain: Chain) -> dict[str, float]:
    """Columns that every file must have, each with its SI unit."""
    axes = {f"{a}_deg" if chain.is_rotary(a) else f"{a}_mm": DEG if chain.is_rotary(a) else MM for a in chain.letters}
    return axes | dict.fromkeys(DEVIATIONS, UM)


def read_points(path: Path, test: SphereTest) -> Points:
    """Read the CSV of one test, plain or compressed (``.csv.gz``).

    Args:
        path: The file.
        test: What it is to hold.

    Raises:
        InputError: Names the file, the line or column, what was found and what is allowed.
    """
    names, table, _ = csv_table(path, lambda names: _check_header(path, names, test))
    if len(table) < FEWEST:
        raise InputError(f"{path}: {len(table)} points; allowed: at least {FEWEST}")
    return points_of(path, names, table, test)


def points_of(path: Path, names: list[str], table: np.ndarray, test: SphereTest) -> Points:
    """Points from a table of numbers.

    Args:
        path: Of the file, for messages.
        names: Of the columns, as in a trace.
        table: (n, columns) in the units of the names.
        test: What it is of.

    Raises:
        InputError: A clock runs backwards, or a side is neither +1 nor -1.
    """
    chain, column = test.chain, {n: table[:, i] for i, n in enumerate(names)}
    need = columns_of(chain)
    position = np.column_stack([column[n] * need[n] for n in list(need)[: chain.count]])
    deviation = np.column_stack([column[n] * need[n] for n in DEVIATIONS])
    side = sides_of(position[:, chain.rotary_columns])
    for i, a in enumerate(chain.rotary):
        if (name := f"from_{a}") in column:
            side[:, i] = column[name]
            if wrong := np.flatnonzero(~np.isin(side[:, i], (-1.0, 0.0, 1.0))).tolist():
                found = f"{column[name][wrong[0]]:g}"
                raise InputError(
                    f"{path}, line {wrong[0] + 2}: {name} = {found}; allowed: 1 where the last move of {a} was towards "
                    "larger angles, -1 where towards smaller ones, 0 where nobody knows"
                )
    n = len(table)
    timed = "time_s" in column
    time = column["time_s"] if timed else POINT_TIME * np.arange(n)
    if timed:
        check_growing(path, time, lambda i: i + 2)
    spindle = column.get("spindle_deg", np.zeros(n)) * DEG
    return Points(position, deviation, side, spindle, time, timed, column.get("run", np.ones(n)))


def _check_header(path: Path, names: list[str], test: SphereTest) -> None:
    """Refuse columns that are missing, unknown or double."""
    need = list(columns_of(test.chain))
    allowed = [*need, *MORE, *(f"from_{a}" for a in test.chain.rotary)]
    if "time_s" in names and not any(n in names for n in need[: test.chain.count]):
        raise InputError(
            f"{path}, line 1: there are no positions of axes, as in the recording of an R-test along a motion, which "
            f'has kind = "r_test"; allowed: one row a point, with the columns {", ".join(need)}'
        )
    check_columns(path, names, allowed)
    need_columns(path, names, need)


def file_columns(chain: Chain) -> dict[str, tuple[str, str]]:
    """What a column of another system's table may be: its quantity, and the unit where nothing says it."""
    out = {a: ("angle", "deg") if chain.is_rotary(a) else ("deviation", "mm") for a in chain.letters}
    for c in COORDINATES:
        out[f"d{c.lower()}"] = "deviation", "um"
        out[f"{c.lower()}_measured"] = "deviation", "mm"
    return (
        out
        | {f"from_{a}": ("", "") for a in chain.rotary}
        | {"spindle": ("angle", "deg"), "run": ("", ""), "time": ("time", "s")}
    )


def column_named(chain: Chain, header: str, word: str) -> str:
    """What a header means; empty where it means nothing. ``word`` is the header without its unit, lower case."""
    for a in chain.rotary:  # the letter would be taken for a unit
        if header.strip().lower() == f"from_{a.lower()}":
            return f"from_{a}"
    word = word.replace(" ", "_").strip("_")
    if word in ("spindle", "run", "time"):
        return word
    if word.upper() in chain.letters:
        return word.upper()
    for c in (c.lower() for c in COORDINATES):
        parts = word.replace(c, "_", 1).strip("_") if word.count(c) == 1 else ""
        if c in word and parts in _OFF:
            return f"d{c}"
        if c in word and parts in _FOUND:
            return f"{c}_measured"
    parts = word.split("_")
    if len(parts) == 2 and parts[0].upper() in chain.letters and parts[1] in _NOMINAL:
        return parts[0].upper()
    return ""


def missing_columns(chain: Chain, have: Collection[str]) -> list[str]:
    """Columns that a table lacks."""
    missing = [a for a in chain.rotary if a not in have]
    for c in (c.lower() for c in COORDINATES):
        if f"d{c}" not in have and f"{c}_measured" not in have:
            missing.append(f"d{c} or {c}_measured")
    return missing


def from_columns(source: Path, test: SphereTest, si: dict[str, np.ndarray]) -> tuple[Points, list[str]]:
    """Points from columns of another system's table, SI; linear positions that it lacks are those of an ideal
    machine.
    """
    chain, notes, si = test.chain, [], dict(si)
    centred = test.centred(np.column_stack([si[a] for a in chain.rotary]))
    if lacking := [a for a in chain.linear if a not in si]:
        notes.append(f"no column for {', '.join(lacking)}: where the tool of an ideal machine is in the sphere")
    for i, a in enumerate(chain.linear):
        si.setdefault(a, centred[:, i])
    for i, c in enumerate(COORDINATES):
        low = c.lower()
        if f"d{low}" not in si:
            si[f"d{low}"] = si[f"{low}_measured"] - si[chain.linear[i]]
    order = [*chain.letters, *(f"d{c.lower()}" for c in COORDINATES)]
    out = {name: si[own] / size for own, (name, size) in zip(order, columns_of(chain).items(), strict=True)}
    out |= {n: si[n] for n in si if n.startswith("from_")}
    if "spindle" in si:
        out["spindle_deg"] = si["spindle"] / DEG
    for own, name in (("run", "run"), ("time", "time_s")):
        if own in si:
            out[name] = si[own]
    return points_of(source, list(out), np.column_stack(list(out.values())), test), notes


def trace_text(test: SphereTest, points: Points) -> str:
    """A trace as :func:`read_points` reads it."""
    need = columns_of(test.chain)
    names = [*need, *(f"from_{a}" for a in test.chain.rotary)]
    values = np.column_stack([points.position, points.deviation]) / np.array(list(need.values()))
    columns = [*values.T, *points.side.T]
    forms = ["%.6f"] * test.chain.count + ["%.4f"] * 3 + ["%.0f"] * len(test.chain.rotary)
    more = (
        ("spindle_deg", points.spindle / DEG, "%.4f", points.spindle.any()),
        ("time_s", points.time, "%.3f", points.timed),
    )
    for name, column, form, present in (*more, ("run", points.run, "%.0f", points.run.max() > 1)):
        if present:
            names.append(name)
            columns.append(column)
            forms.append(form)
    rows = [",".join(f % v for f, v in zip(forms, row, strict=True)) for row in np.column_stack(columns)]
    return "\n".join([",".join(names), *rows, ""])


def positions_text(test: SphereTest) -> str:
    """The planned positions as a table: a trace without what is to be found; empty where none are planned."""
    if not test.angles:
        return ""
    head, *rows = trace_text(test, test.planned).splitlines()
    names = head.split(",")
    kept = [i for i, n in enumerate(names) if n not in DEVIATIONS]
    lines = [",".join(row.split(",")[i] for i in kept) for row in (head, *rows)]
    return "\n".join([*lines, ""])


def test_table(test: SphereTest) -> dict:
    """The ``[[test]]`` table of a planned test."""
    return {
        "name": test.name,
        "kind": test.kind,
        "sphere_mm": [round(v / MM, 4) for v in test.sphere],
        "setup": test.setup,
        "angles_deg": [[round(a / DEG, 4) for a in row] for row in test.angles],
        "spindle_deg": [round(a / DEG, 4) for a in test.spindle],
        "approach": [list(row) for row in test.approach],
    }
