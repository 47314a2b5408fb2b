"""Text tables of any separator, decimal sign and encoding, as numbers with the lines that they stand on.

Columns may hold dates and times, which become seconds, or words, which are left out.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.units import TIME_WORDS, bare, is_unit
from mjsim.io.inputs import check_rows, read_bytes, shown

#: Separators by the name that the user gives.
SEPARATORS = {"semicolon": ";", "tab": "\t", "comma": ",", "space": None}
_MISSING = {"", "nan", "-", "--", "---", "n/a", "na", "#n/a", "null", "none"}
#: Lines that decide on separator and decimal sign.
_LOOK = 400
#: Rows that have to follow each other for a table of one column to have begun: a header may hold a single number.
_RUN = 5
_POINT = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_COMMA = re.compile(r"[+-]?(?:\d+(?:,\d+)?|,\d+)(?:[eE][+-]?\d+)?", re.ASCII)
#: A date and a time of day, or a time of day to the second or finer.
_STAMP = re.compile(
    r"(?:(\d{4})[-/.](\d\d?)[-/.](\d\d?)[T ]|(\d\d?)([./-])(\d\d?)[./-](\d{4})[ T])?\s*"
    r"(\d\d?):(\d\d)(?::(\d\d(?:[.,]\d+)?))?\s*([AaPp][Mm])?(?:Z|[+-]\d\d:?\d\d)?",
    re.ASCII,
)
#: Day from which seconds are counted: a double keeps 0.1 µs of some decades.
_EPOCH = date(2020, 1, 1).toordinal()
#: A text column is one where at least this share of the first lines has the same layout (assumed).
_SHARE = 0.3
#: Larger numbers (1e20) are none that a recorder writes; a column's name has so many characters.
_HUGE, _NAME = 1e20, 60
_ALLOWED = "allowed: a table as text (.csv, .txt), or a file with the ending of its format"
_COMMENT = re.compile(r"^\s*(?:#|%|//|;)\s*")


@dataclass(frozen=True)
class Table:
    """Numbers of a text file.

    Attributes:
        path: the file. names, units: (k,) of the columns, empty texts where the file has none. values: (n, k), nan
            where a cell is empty.
        lines: (n,) line numbers, from 1. header: lines above the table. notes: what was detected, for the user.
        channels: (k,) axis and signal of each column as its format states them, empty texts where it does not; nothing:
            the names have to tell.
        began: by place of a column that held times of day: the first of them, s from midnight, or with a date s from
            the first day of 2020.
    """

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: np.ndarray
    lines: np.ndarray
    header: tuple[str, ...]
    notes: tuple[str, ...]
    channels: tuple[tuple[str, str], ...] = ()
    began: Mapping[int, float] = field(default_factory=dict)

    @property
    def columns(self) -> str:
        """The columns as messages list them: ``1 "t [s]", 2 "dev [µm]"``."""
        few = [f'{i} "{n}"' if n else str(i) for i, n in enumerate(self.names[:12], start=1)]
        return ", ".join(few) + (f" and {len(self.names) - 12} more" if len(self.names) > 12 else "")

    def place(self, column: str) -> int:
        """Place of a column, from 0, by its name or its number from 1.

        Raises:
            InputError: There is no such column.
        """
        if column in self.names:
            return self.names.index(column)
        if column.isdigit() and 1 <= int(column) <= len(self.names):
            return int(column) - 1
        raise InputError(f"{self.path}: no column {shown(column)}; allowed: {self.columns}, by name or number")

    def listed(self, places: Sequence[int]) -> str:
        """Some columns as notes list them: ``columns 1 "t [s]", 3``."""
        few = ", ".join(f'{p + 1} "{self.names[p]}"' if self.names[p] else str(p + 1) for p in places[:8])
        more = f" and {len(places) - 8} more" if len(places) > 8 else ""
        return f"column{'s' if len(places) > 1 else ''} {few}{more}"


def read_table(
    path: Path, separator: str | None = None, decimal: str | None = None, rows: tuple[int, int] | None = None
) -> Table:
    """Read a table; what is not given is detected.

    Args:
        path: a text file, or one as ``.gz``. separator: a key of :data:`SEPARATORS`. decimal: ``point`` or ``comma``.
        rows: first and last line of the table, from 1; for files with several tables.

    Raises:
        InputError: names the file, the line, what was found and what is allowed.
    """
    text, notes = _text(path)
    check_rows(path, text.count("\n") + text.count("\r"))
    return table_of(path, text.splitlines(), notes, separator, decimal, rows)


def table_of(
    path: Path,
    lines: list[str],
    notes: list[str],
    separator: str | None = None,
    decimal: str | None = None,
    rows: tuple[int, int] | None = None,
) -> Table:
    """The table in some lines of text; arguments and errors as :func:`read_table`.

    Args:
        path: For messages.
        lines: Of the file.
        notes: On how they were read.
        separator: A key of :data:`SEPARATORS`.
        decimal: ``point`` or ``comma``.
        rows: First and last line of the table, from 1.
    """
    notes = list(notes)
    first, last = rows or (1, max(1, len(lines)))
    if not 1 <= first <= last:
        raise InputError(f"{path}: rows {first} to {last}; allowed: a first line from 1 and a last line not before it")
    body = lines[first - 1 : last]
    layout = _layout(path, body, separator, decimal)
    begin = 0 if rows else _begin(body, layout)
    values, numbers = _numbers(path, body, begin, first, layout)
    header = lines[: first - 1 + begin]
    names, units = _names(header, layout.separator, layout.width)
    began = {}
    for i in layout.stamps:
        began[i] = float(next(iter(values[np.isfinite(values[:, i]), i]), np.nan))
        values[:, i] = _from_midnight_on(values[:, i])
        units[i] = "s"
        notes.append(f"column {i + 1} holds times of day: seconds since the first")
        if bare(names[i]) not in TIME_WORDS and not any(bare(n) in TIME_WORDS for n in names):
            names[i] = "time"
    words = [f'{i + 1} "{names[i]}"' if names[i] else str(i + 1) for i in sorted(layout.words)]
    notes += [f"left out, as text: column{'s' if len(words) > 1 else ''} {', '.join(words)}"] if words else []
    keep = np.asarray(np.isfinite(values).any(axis=0), bool) | (
        len(values) == 0
    )  # a separator at the ends of the lines
    names, units = (tuple(n for n, k in zip(x, keep, strict=True) if k) for x in (names, units))
    wide, comma = layout.width > 1, layout.comma
    shown = next(k for k, v in SEPARATORS.items() if v == layout.separator)
    notes += [f"separator {shown}, decimal {'comma' if comma else 'point'}"] if wide or comma else []
    notes += [f"{len(header)} header line{'s' if len(header) > 1 else ''}"] if header else []
    began = {int(keep[:i].sum()): first for i, first in began.items()}
    return Table(path, names, units, values[:, keep], numbers, tuple(header), tuple(notes), (), began)


@dataclass
class _Layout:
    """How the lines of a table are written.

    Attributes:
        separator: Between cells; None: blanks.
        comma: Whether the decimal sign is a comma.
        width: Number of columns.
        words: Columns that hold text.
        stamps: Columns that hold times of day, with or without a date.
    """

    separator: str | None
    comma: bool
    width: int
    words: set[int] = field(default_factory=set)
    stamps: tuple[int, ...] = ()

    def row(self, line: str) -> list[float] | None:
        """The line's numbers, nan for text; nothing where it is no row of the table."""
        cells = _split(line, self.separator)
        if len(cells) != self.width:
            return None
        row = [
            np.nan if i in self.words else seconds_of(c) if i in self.stamps else _number(c, self.comma)
            for i, c in enumerate(cells)
        ]
        if None in row or not np.isfinite(row).any():  # type: ignore[arg-type]
            return None
        return row  # type: ignore[return-value]


def _text(path: Path) -> tuple[str, list[str]]:
    data = read_bytes(path)
    for mark, encoding, name in (
        (b"\xef\xbb\xbf", "utf-8-sig", "UTF-8"),
        (b"\xff\xfe", "utf-16", "UTF-16"),
        (b"\xfe\xff", "utf-16", "UTF-16"),
    ):
        if data.startswith(mark):
            try:
                return data.decode(encoding), [f"{name} with byte order mark"]
            except UnicodeDecodeError as error:
                raise InputError(
                    f"{path}: byte {error.start} is no {name} text, though the file begins with its mark"
                ) from None
    if b"\0" in data:
        raise InputError(f"{path}: byte {data.index(0)} is not text; {_ALLOWED}")
    try:
        return data.decode(), []
    except UnicodeDecodeError:
        try:
            return data.decode("cp1252"), ["not UTF-8, read as Windows-1252"]
        except UnicodeDecodeError as error:
            raise InputError(f"{path}: byte {error.start} is not text; {_ALLOWED}") from None


def _split(line: str, sep: str | None) -> list[str]:
    if sep and '"' in line:
        return [c.strip() for c in next(csv.reader([line], delimiter=sep, skipinitialspace=True))]
    return [c.strip().strip('"') for c in (line.split(sep) if sep else line.split())]


def seconds_of(cell: str) -> float | None:
    """Seconds of a date and time, or of a time of day; nothing where the cell is none."""
    if cell.lower() in _MISSING:
        return np.nan
    match = _STAMP.fullmatch(cell)
    if match is None:
        return None
    year, month, day, first, sign, second, late, hour, minute, sec, half = match.groups()
    if sec is None and year is None and first is None:  # 12:30 alone may be anything
        return None
    if year is None and first is not None:  # 31.12.2024, but 12/31/2024
        year, month, day = (late, first, second) if sign == "/" and int(first) <= 12 else (late, second, first)
    try:
        days = date(int(year), int(month), int(day)).toordinal() - _EPOCH if year else 0
    except ValueError:
        return None
    hours = int(hour) % 12 + 12 * (half.lower() == "pm") if half else int(hour)
    return 86400.0 * days + 3600.0 * hours + 60.0 * int(minute) + float((sec or "0").replace(",", "."))


def _from_midnight_on(seconds: np.ndarray) -> np.ndarray:
    """Seconds since the first; times of day without a date go on after midnight."""
    known = np.flatnonzero(np.isfinite(seconds))
    steps = np.diff(seconds[known])
    nights = np.concatenate([[0.0], np.cumsum(86400.0 * (steps < -43200.0))])
    out = seconds.copy()
    out[known] = seconds[known] + nights - seconds[known[0]]
    return np.round(out, 7)


def _number(cell: str, comma: bool) -> float | None:
    """The cell's number, nan for an empty one, ``None`` for anything else."""
    if cell.lower() in _MISSING:
        return np.nan
    if not (_COMMA if comma else _POINT).fullmatch(cell):
        return None
    value = float(cell.replace(",", "."))
    return value if abs(value) < _HUGE else None


def _row(line: str, sep: str | None, comma: bool) -> list[float] | None:
    """The line's numbers, ``None`` where it has anything else or none at all."""
    row = [_number(c, comma) for c in _split(line, sep)]
    if not row or None in row or not np.isfinite(row).any():  # type: ignore[arg-type]
        return None
    return row  # type: ignore[return-value]


def _kinds(line: str, sep: str | None, comma: bool) -> str:
    """One letter for each cell of a line: ``n`` a number or nothing, ``d`` a time of day, ``t`` any other text."""
    numbers = ((_number(c, comma), c) for c in _split(line, sep))
    return "".join("n" if x is not None else "d" if seconds_of(c) is not None else "t" for x, c in numbers)


def _writings(separator: str | None, decimal: str | None) -> Iterable[tuple[str | None, bool]]:
    """Separators and decimal signs (comma or not) that the user's options leave."""
    for name, sep in SEPARATORS.items():
        for comma in (False, True):
            if separator in (None, name) and decimal in (None, "comma" if comma else "point"):
                if not (comma and sep == ","):
                    yield sep, comma


def _with_text(look: list[str], separator: str | None, decimal: str | None) -> _Layout | None:
    """The layout of a table that has text or times of day beside its numbers."""
    best, out = (0, 0), None
    for sep, comma in _writings(separator, decimal):
        seen = Counter(k for line in look if "n" in (k := _kinds(line, sep, comma)) and len(k) > 1)
        for kinds, count in seen.most_common(1):
            score = (count, sum(k != "t" for k in kinds))
            if score > best and set(kinds) != {"n"}:
                words = {i for i, k in enumerate(kinds) if k == "t"}
                stamps = tuple(i for i, k in enumerate(kinds) if k == "d")
                best, out = score, _Layout(sep, comma, len(kinds), words, stamps)
    return out if best[0] >= max(min(3, len(look)), _SHARE * len(look)) else None


def _layout(path: Path, body: list[str], separator: str | None, decimal: str | None) -> _Layout:
    """Separator, decimal sign, number of columns, and the columns that hold no numbers."""
    look = [line for line in body[:_LOOK] if line.strip()]
    found = []
    for sep, comma in _writings(separator, decimal):
        widths = Counter(len(r) for line in look if (r := _row(line, sep, comma)))
        if widths:
            width, count = widths.most_common(1)[0]
            found.append((count, width, sep, comma))
    best = max((f[0] for f in found), default=0)
    if best < min(3, len(look)) or not best:
        if (mixed := _with_text(look, separator, decimal)) is not None:
            return mixed
        near = look[0].strip()[:60] if look else ""
        if best:
            raise InputError(f"{path}: {best} row{'s' * (best > 1)} of numbers; allowed: at least 3, below any header")
        raise InputError(
            f"{path}: no table of numbers found ({len(look)} lines, first {near!r}); allowed: rows of numbers "
            f"below any header"
        )
    likely = [f for f in found if f[0] == best]
    if {(f[2], f[3]) for f in likely} >= {(",", False), (None, True)}:
        raise InputError(
            f"{path}: {look[-1].strip()[:40]!r} is one number with a decimal comma or {len(look[-1].split(','))} "
            f"columns; say "
            "--decimal comma or --separator comma"
        )
    _, width, sep, comma = max(likely, key=lambda f: f[1])
    return _Layout(sep, comma, width)


def _begin(body: list[str], layout: _Layout) -> int:
    """Index of the first line of the table."""
    full = [i for i, line in enumerate(body) if line.strip()]
    good = [layout.row(body[i]) is not None for i in full]
    need = 1 if layout.width > 1 else min(_RUN, sum(good))
    return next((full[n] for n in range(len(full)) if good[n] and all(good[n : n + need])), full[0])


def _numbers(path: Path, body: list[str], begin: int, first: int, layout: _Layout) -> tuple[np.ndarray, np.ndarray]:
    """Values (n, width), nan where a cell is empty or text, and their line numbers (n,)."""
    values, numbers, width = [], [], layout.width
    empty = set(range(width)) - set(layout.stamps)  # columns without a number so far
    for i, line in enumerate(body[begin:], start=first + begin):
        if not line.strip():
            continue
        row = layout.row(line)
        if row is None and empty:  # a column of words that begins late
            cells = _split(line, layout.separator)
            late = {i for i in empty if i < len(cells) and _number(cells[i], layout.comma) is None}
            row = _Layout(layout.separator, layout.comma, width, layout.words | late, layout.stamps).row(line)
            layout.words |= late if row is not None else set()
        if row is None:
            raise InputError(
                f"{path}, line {i}: {line.strip()[:60]!r}; allowed: {width} number{'s' if width > 1 else ''} as in "
                f"the lines above "
                "(--rows FIRST LAST takes a part of the file)"
            )
        if empty:
            empty -= {k for k in empty if row[k] == row[k]}
        values.append(row)
        numbers.append(i)
    return np.array(values, float).reshape(-1, width), np.array(numbers, int)


def _names(header: list[str], sep: str | None, width: int) -> tuple[list[str], list[str]]:
    """Names and units of the columns from the lines above the table.

    Units may have a line of their own. Names may stand in several lines, as an axis above its signals.
    """
    plain = [line if sep == ";" and line.lstrip().startswith(";") else _COMMENT.sub("", line) for line in header]
    rows = [[c[:_NAME] for c in _split(line, sep)] for line in plain if line.strip()]
    rows = [r[:-1] if len(r) == width + 1 and not r[-1] else r for r in rows]
    units = [""] * width
    if len(rows) > 1 and len(rows[-1]) == len(rows[-2]) == width and _of_units(rows[-1]):
        units = [c.strip("[]()<> ") for c in rows.pop()]
    names = rows.pop() if rows and len(rows[-1]) == width else [""] * width
    while width > 2 and rows and len(rows[-1]) == width and not any(_POINT.fullmatch(c) for c in rows[-1]):
        above = rows.pop()
        if not any(above[1:]):
            break  # a title
        for i in range(1, width):
            above[i] = above[i] or above[i - 1]  # the cell of an axis goes over all its signals
        names = [f"{a} {n}".strip()[:_NAME] if a != n else n for a, n in zip(above, names, strict=True)]
    return names, units


def _of_units(row: list[str]) -> bool:
    """Whether a header line holds units: all of its cells, or most where the others are in brackets."""
    cells = [c for c in row if c]
    known = sum(map(is_unit, cells))
    return bool(cells) and (known == len(cells) or (known > 1 and all(is_unit(c) or c[0] in "[(<" for c in cells)))
