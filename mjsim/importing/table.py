"""Text tables of any separator, decimal sign and encoding, as numbers with the lines that they stand on."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.units import is_unit
from mjsim.io.inputs import check_rows, read_bytes

#: Separators by the name that the user gives.
SEPARATORS = {"semicolon": ";", "tab": "\t", "comma": ",", "space": None}
_MISSING = {"", "nan", "-", "--", "---", "n/a", "na"}
#: Lines that decide on separator and decimal sign.
_LOOK = 400
#: Rows that have to follow each other for a table of one column to have begun: a header may hold a single number.
_RUN = 5
_POINT = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_COMMA = re.compile(r"[+-]?(?:\d+(?:,\d+)?|,\d+)(?:[eE][+-]?\d+)?", re.ASCII)
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
    """

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: np.ndarray
    lines: np.ndarray
    header: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def columns(self) -> str:
        """The columns as messages list them: ``1 "t [s]", 2 "dev [µm]"``."""
        few = [f'{i} "{n}"' if n else str(i) for i, n in enumerate(self.names[:12], start=1)]
        return ", ".join(few) + (f" and {len(self.names) - 12} more" if len(self.names) > 12 else "")


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
    lines = text.splitlines()
    first, last = rows or (1, max(1, len(lines)))
    if not 1 <= first <= last:
        raise InputError(f"{path}: rows {first} to {last}; allowed: a first line from 1 and a last line not before it")
    body = lines[first - 1 : last]
    sep, comma, width = _layout(path, body, separator, decimal)
    begin = 0 if rows else _begin(body, sep, comma, width)
    values, numbers = _numbers(path, body, begin, first, sep, comma, width)
    header = lines[: first - 1 + begin]
    names, units = _names(header, sep, width)
    keep = np.asarray(np.isfinite(values).any(axis=0), bool) | (
        len(values) == 0
    )  # a separator at the ends of the lines
    names, units = (
        tuple(n for n, k in zip(names, keep, strict=True) if k),
        tuple(u for u, k in zip(units, keep, strict=True) if k),
    )
    shown = next(k for k, v in SEPARATORS.items() if v == sep)
    notes += [f"separator {shown}, decimal {'comma' if comma else 'point'}"] if width > 1 or comma else []
    notes += [f"{len(header)} header line{'s' if len(header) > 1 else ''}"] if header else []
    return Table(path, names, units, values[:, keep], numbers, tuple(header), tuple(notes))


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
    return [c.strip().strip('"') for c in (line.split(sep) if sep else line.split())]


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


def _layout(path: Path, body: list[str], separator: str | None, decimal: str | None) -> tuple[str | None, bool, int]:
    """Separator, whether the decimal sign is a comma, and the number of columns."""
    look = [line for line in body[:_LOOK] if line.strip()]
    found = []
    for name, sep in SEPARATORS.items():
        for comma in (False, True):
            if (
                (separator not in (None, name))
                or (decimal not in (None, "comma" if comma else "point"))
                or (comma and sep == ",")
            ):
                continue
            widths = Counter(len(r) for line in look if (r := _row(line, sep, comma)))
            if widths:
                width, count = widths.most_common(1)[0]
                found.append((count, width, sep, comma))
    best = max((f[0] for f in found), default=0)
    if best < min(3, len(look)) or not best:
        near = look[0].strip()[:60] if look else ""
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
    return sep, comma, width


def _begin(body: list[str], sep: str | None, comma: bool, width: int) -> int:
    """Index of the first line of the table."""
    full = [i for i, line in enumerate(body) if line.strip()]
    good = [(row := _row(body[i], sep, comma)) is not None and len(row) == width for i in full]
    need = 1 if width > 1 else min(_RUN, sum(good))
    return next((full[n] for n in range(len(full)) if good[n] and all(good[n : n + need])), full[0])


def _numbers(path: Path, body: list[str], begin: int, first: int, sep: str | None, comma: bool, width: int):
    values, numbers = [], []
    for i, line in enumerate(body[begin:], start=first + begin):
        if not line.strip():
            continue
        row = _row(line, sep, comma)
        if row is None or len(row) != width:
            raise InputError(
                f"{path}, line {i}: {line.strip()[:60]!r}; allowed: {width} number{'s' if width > 1 else ''} as in "
                f"the lines above "
                "(--rows FIRST LAST takes a part of the file)"
            )
        values.append(row)
        numbers.append(i)
    return np.array(values, float).reshape(-1, width), np.array(numbers, int)


def _names(header: list[str], sep: str | None, width: int) -> tuple[list[str], list[str]]:
    """Names and units of the columns from the lines above the table; units may have a line of their own."""
    rows = [[c[:_NAME] for c in _split(_COMMENT.sub("", line), sep)] for line in header if line.strip()]
    rows = [r[:-1] if len(r) == width + 1 and not r[-1] else r for r in rows]
    units = [""] * width
    if rows and len(rows[-1]) == width and all(not c or is_unit(c) for c in rows[-1]) and any(rows[-1]):
        if len(rows) > 1 and len(rows[-2]) == width:
            units = rows.pop()
    names = rows[-1] if rows and len(rows[-1]) == width else [""] * width
    return names, units
