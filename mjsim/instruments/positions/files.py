"""Position tests of a campaign: their ``[[test]]`` tables, and the CSV files with one row a reading."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from mjsim.errors import InputError
from mjsim.instruments.positions.measurement import READING_TIME, PositionTest, Readings, sides_of
from mjsim.instruments.schema import Clock, Length, Table, printable
from mjsim.io.inputs import check_columns, csv_table, need_columns, shown
from mjsim.io.times import check_growing
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM, UM

#: Fewest readings of a test.
FEWEST = 3
#: Columns of the deviation, each with its SI unit.
LENGTHS = {"deviation_um": UM}
ANGLES = {"deviation_urad": 1e-6, "deviation_arcsec": DEG / 3600.0}
#: Most runs that may stand side by side in another system's table.
MOST_RUNS = 10
#: Words of headers of other systems, lower case and without units.
_WORDS = {
    "target": (
        "target",
        "targets",
        "nominal",
        "position",
        "pos",
        "soll",
        "sollposition",
        "command",
        "commanded",
        "set",
    ),
    "deviation": ("deviation", "dev", "error", "err", "abweichung", "abw", "diff", "difference", "delta"),
    "measured": ("measured", "actual", "actual position", "ist", "istposition", "laser", "reading"),
    "direction": ("direction", "dir", "richtung", "side"),
    "run": ("run", "cycle", "lauf", "zyklus"),
    "time": ("time", "t", "zeit"),
    "temperature": ("temperature", "temp", "temperatur", "material temperature", "temperature degc"),
}
_SIDES = {"up": ("up", "+", "↑", "forward", "fwd", "vor"), "down": ("down", "-", "↓", "backward", "bwd", "zurück")}
#: Words that may stand beside side and number of a run.
_BESIDE_RUNS = (
    "run",
    "cycle",
    "lauf",
    "zyklus",
    "deviation",
    "dev",
    "error",
    "um",
    "µm",
    "mm",
    "urad",
    "µrad",
    "arcsec",
)
_SIGN = {"up": 1.0, "down": -1.0}
#: Columns that a file may have besides target and deviation.
MORE = ("run", "direction", "time_s", "temperature_degC")

Angle = Annotated[float, Field(ge=-100_000, le=100_000, allow_inf_nan=False)]


class PositionTable(Table):
    """A ``[[test]]`` table of target positions."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=100)]
    kind: Literal["positions"]
    axis: str
    component: str | None = None
    from_mm: dict[str, Length] = Field(default={})
    to_mm: dict[str, Length] = Field(default={})
    line_mm: Annotated[list[Length], Field(min_length=3, max_length=3)] = Field(default=[0.0, 0.0, 0.0])
    at_mm: dict[str, Length] = Field(default={})
    dead_path_mm: Annotated[float, Field(ge=0, le=100_000)] = 0.0
    setup: Annotated[str, Field(max_length=200), AfterValidator(printable)] | None = None
    trace: str | None = None
    targets_mm: Annotated[list[Length], Field(max_length=1000)] = Field(default=[])
    targets_deg: Annotated[list[Angle], Field(max_length=1000)] = Field(default=[])
    runs: Annotated[int, Field(ge=1, le=100)] = 5
    started_s: Clock = 0.0


def components_of(chain: Chain, axis: str) -> tuple[str, ...]:
    """What can be measured of an axis, positioning first."""
    own = f"E{axis}{axis}"
    if chain.is_rotary(axis) or not chain.spatial:
        return (own,)
    return (own, *(n for n in (*chain.straightness, *chain.angular) if n[2] == axis))


def position_test(file: Path, t: PositionTable, chain: Chain) -> PositionTest:
    """The test that a ``[[test]]`` table describes.

    Args:
        file: Where it stands.
        t: The table.
        chain: Axes of the machine.

    Raises:
        InputError: The machine has no such axis, or the axis no such component.
    """
    place = f'{file}: [[test]] "{t.name}"'
    ends = _ends(place, t, chain)
    if not ends and t.axis not in chain.letters:
        raise InputError(f"{place}: axis = {shown(t.axis)}; allowed: {', '.join(chain.letters)}")
    along = "D" + "".join(a if last > first else f"{a}-" for a, first, last in ends)
    components = (along,) if ends else components_of(chain, t.axis)
    component = t.component or components[0]
    if component not in components:
        raise InputError(f"{place}: component = {shown(component)}; allowed for {t.axis}: {', '.join(components)}")
    rotary = not ends and chain.is_rotary(t.axis)
    wrong, right = ("targets_mm", "targets_deg") if rotary else ("targets_deg", "targets_mm")
    if getattr(t, wrong):
        raise InputError(f"{place}: {wrong}; allowed for {t.axis}: {right}")
    if rotary and t.dead_path_mm:
        raise InputError(f"{place}: dead_path_mm = {t.dead_path_mm:g}; allowed for {t.axis}: none, as it turns")
    others = [a for a in chain.linear if a not in t.axis]
    for letter in t.at_mm:
        if letter not in others:
            raise InputError(f"{place}: at_mm names {shown(letter)}; allowed: {', '.join(others) or 'none'}")
    unit = DEG if rotary else MM
    x, y, z = (v * MM for v in t.line_mm)
    return PositionTest(
        t.name,
        t.axis,
        component,
        (x, y, z),
        tuple((a, v * MM) for a, v in t.at_mm.items()),
        t.dead_path_mm * MM,
        t.setup or t.name,
        t.trace,
        chain,
        tuple(v * unit for v in getattr(t, right)),
        t.runs,
        t.started_s,
        ends,
    )


def _ends(place: str, t: PositionTable, chain: Chain) -> tuple[tuple[str, float, float], ...]:
    """The axes of a diagonal with both ends, m; none where one axis moves.

    Raises:
        InputError: The ends are not of the axes that move, or an axis does not move.
    """
    if len(t.axis) < 2 and not t.from_mm and not t.to_mm:
        return ()
    letters = tuple(t.axis)
    known = set(letters) <= set(chain.linear) and len(set(letters)) == len(letters)
    if len(letters) < 2 or not known or not chain.spatial:
        allowed = f"two or more of {', '.join(chain.linear)}, each once" if chain.spatial else "one axis"
        raise InputError(f"{place}: axis = {shown(t.axis)} with from_mm and to_mm; allowed: {allowed}")
    for key, given in (("from_mm", t.from_mm), ("to_mm", t.to_mm)):
        if set(given) != set(letters):
            said = ", ".join(given) or "nothing"
            raise InputError(f"{place}: {key} names {said}; allowed of a diagonal: each of {', '.join(letters)}")
    for letter in letters:
        if t.from_mm[letter] == t.to_mm[letter]:
            at = f"{letter} is at {t.from_mm[letter]:g} mm at both ends"
            raise InputError(f"{place}: {at}; allowed: axes that move, others in at_mm")
    return tuple((a, t.from_mm[a] * MM, t.to_mm[a] * MM) for a in letters)


def test_table(test: PositionTest) -> dict:
    """The ``[[test]]`` table of a planned test."""
    out: dict[str, Any] = {"name": test.name, "kind": test.kind, "axis": test.axis}
    if not test.positioning:
        out["component"] = test.component
    if test.ends:
        out["from_mm"] = {a: round(first / MM, 4) for a, first, _ in test.ends}
        out["to_mm"] = {a: round(last / MM, 4) for a, _, last in test.ends}
    if not test.rotary:
        out["line_mm"] = [round(v / MM, 4) for v in test.line]
    if test.at:
        out["at_mm"] = {a: round(v / MM, 4) for a, v in test.at}
    targets = [round(float(v) / test.unit, 6) for v in test.targets]
    return out | {"targets_deg" if test.rotary else "targets_mm": targets, "runs": test.runs}


def target_column(test: PositionTest) -> str:
    """Name of the column of the targets."""
    return "target_deg" if test.rotary else "target_mm"


def deviation_columns(test: PositionTest) -> dict[str, float]:
    """Names that the column of the deviations may have, each with its SI unit; the first is ours."""
    return ANGLES if test.angular else LENGTHS


def read_readings(path: Path, test: PositionTest) -> Readings:
    """Read the CSV of one test, plain or compressed (``.csv.gz``).

    Args:
        path: The file.
        test: What it is to hold.

    Raises:
        InputError: Names the file, the line or column, what was found and what is allowed.
    """
    names, table, lines = csv_table(path, lambda names: _check_header(path, names, test))
    if len(table) < FEWEST:
        raise InputError(f"{path}: {len(table)} readings; allowed: at least {FEWEST}")
    return readings_of(path, dict(zip(names, table.T, strict=True)), lines, test)


def _check_header(path: Path, names: list[str], test: PositionTest) -> None:
    """Refuse columns that are missing, unknown or double."""
    units = deviation_columns(test)
    check_columns(path, names, [target_column(test), *units, *MORE], test.component)
    need_columns(path, names, [target_column(test)])
    if len([n for n in names if n in units]) != 1:
        raise InputError(f"{path}, line 1: allowed: one column of {' or '.join(units)}")


def readings_of(path: Path, column: dict[str, np.ndarray], lines: np.ndarray, test: PositionTest) -> Readings:
    """Readings from columns of numbers.

    Args:
        path: Of the file, for messages.
        column: By name, as in a trace, (n,) each.
        lines: Of the rows in the file, (n,).
        test: What it is of.

    Raises:
        InputError: A clock runs backwards, a side is neither +1 nor -1, or a temperature is none of a shop.
    """
    target = column[target_column(test)] * test.unit
    name = next(n for n in deviation_columns(test) if n in column)
    side = column.get("direction")
    if side is None:
        side = sides_of(target)
    elif wrong := np.flatnonzero(~np.isin(side, (-1.0, 1.0))).tolist():
        raise InputError(
            f"{path}, line {lines[wrong[0]]}: direction = {side[wrong[0]]:g}; allowed: 1 where the last move was "
            "towards larger positions, -1 where towards smaller ones"
        )
    run = column.get("run")
    if run is None:
        run = _runs(target, side)
    n = len(target)
    timed = "time_s" in column
    time = column["time_s"] if timed else READING_TIME * np.arange(n)
    if timed:
        check_growing(path, time, lambda i: int(lines[i]))
    temperature = column.get("temperature_degC")
    if temperature is not None and (wrong := np.flatnonzero(np.abs(temperature - 25.0) > 75.0).tolist()):
        raise InputError(
            f"{path}, line {lines[wrong[0]]}: temperature_degC = {temperature[wrong[0]]:g}; allowed: -50 to 100"
        )
    deviation = column[name] * deviation_columns(test)[name]
    return Readings(target, deviation, side, run, time, timed, temperature)


def _runs(target: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Number of the repetition of each reading: how often its target was there before from that side."""
    seen: dict[tuple[float, float], int] = {}
    out = []
    for key in zip(np.round(target, 9).tolist(), side.tolist(), strict=True):
        seen[key] = seen.get(key, 0) + 1
        out.append(float(seen[key]))
    return np.array(out)


def file_columns(test: PositionTest) -> dict[str, tuple[str, str]]:
    """What a column of another system's table may be: its quantity, and the unit where nothing says it.

    ``up_1``, ``down_1`` and so on are deviations of one run from one side, where each row is a target.
    """
    place = ("angle", "deg") if test.rotary else ("deviation", "mm")
    off = ("angle", "urad") if test.angular else ("deviation", "um")
    runs = {f"{side}_{k}": off for k in range(1, MOST_RUNS + 1) for side in _SIDES}
    more = {"direction": ("", ""), "run": ("", ""), "time": ("time", "s"), "temperature": ("", "")}
    return {"target": place, "deviation": off, **({"measured": place} if test.positioning else {}), **more, **runs}


def column_named(header: str, word: str) -> str:
    """What a header means; empty where it means nothing. ``word`` is the header without its unit, lower case."""
    parts = re.findall(r"\d+|[^\W\d_]+|[-+↑↓]", re.sub(r"[\[(<].*?[\])>]", "", header).lower())
    parts = [p for p in parts if p not in _BESIDE_RUNS]
    numbers = [int(p) for p in parts if p.isdigit()]
    sides = [side for side, words in _SIDES.items() for p in parts if p in words]
    if len(parts) == 2 and len(numbers) == len(sides) == 1:
        return f"{sides[0]}_{numbers[0]}"
    word = word.replace("_", " ").strip()
    return next((name for name, words in _WORDS.items() if word in words), "")


def missing_columns(have: Collection[str]) -> list[str]:
    """Columns that a table lacks."""
    lacking = [] if "target" in have else ["target"]
    found = {"deviation", "measured"} & set(have) or [n for n in have if n.partition("_")[0] in _SIDES]
    return lacking + ([] if found else ["deviation or measured"])


def from_columns(source: Path, test: PositionTest, si: dict[str, np.ndarray]) -> tuple[Readings, list[str]]:
    """Readings from columns of another system's table, SI; runs that stand side by side are put one after another."""
    wide = [n for n in si if n.partition("_")[0] in _SIDES]
    notes, lines = [], np.arange(1, len(si["target"]) + 1)
    own, size = next(iter(deviation_columns(test).items()))
    if wide:
        # the order of the standard's cycle: run by run, upwards and then downwards
        ordered = sorted(wide, key=lambda n: (int(n.partition("_")[2]), n.startswith("down")))
        up = np.argsort(si["target"], kind="stable")
        blocks = [(n, up if n.startswith("up") else up[::-1]) for n in ordered]
        column = {
            target_column(test): np.concatenate([si["target"][rows] for _, rows in blocks]) / test.unit,
            own: np.concatenate([si[n][rows] for n, rows in blocks]) / size,
            "direction": np.concatenate([np.full(len(rows), _SIGN[n.partition("_")[0]]) for n, rows in blocks]),
            "run": np.concatenate([np.full(len(rows), float(n.partition("_")[2])) for n, rows in blocks]),
        }
        notes.append(f"one row a target, {len(wide)} columns of deviations")
        lines = np.concatenate([lines[rows] for _, rows in blocks])
        return readings_of(source, column, lines, test), notes
    column = {target_column(test): si["target"] / test.unit}
    if "deviation" in si:
        column[own] = si["deviation"] / size
    else:
        column[own] = (si["measured"] - si["target"]) / size
        notes.append("deviation: measured less target")
    for name, ours in (("run", "run"), ("direction", "direction"), ("time", "time_s")):
        if name in si:
            column[ours] = si[name]
    if "temperature" in si:
        column["temperature_degC"] = si["temperature"]
    if "direction" not in column:
        notes.append("no column for direction: by the order of the targets")
    return readings_of(source, column, lines, test), notes


def trace_text(test: PositionTest, readings: Readings) -> str:
    """A trace as :func:`read_readings` reads it."""
    name, size = next(iter(deviation_columns(test).items()))
    columns = [
        (target_column(test), readings.target / test.unit, "%.6f"),
        ("run", readings.run, "%.0f"),
        ("direction", readings.side, "%.0f"),
        (name, readings.deviation / size, "%.4f"),
    ]
    if readings.timed:
        columns.append(("time_s", readings.time, "%.3f"))
    if readings.temperature is not None:
        columns.append(("temperature_degC", readings.temperature, "%.3f"))
    rows = zip(*([form % v for v in values] for _, values, form in columns), strict=True)
    return "\n".join([",".join(n for n, _, _ in columns), *(",".join(r) for r in rows), ""])


def targets_text(test: PositionTest) -> str:
    """The planned readings as a table: a trace without what is to be found; empty where none are planned."""
    if not test.targets:
        return ""
    rows = [line.split(",") for line in trace_text(test, test.planned).splitlines()]
    return "\n".join([*(",".join(r[:3]) for r in rows), ""])
