"""What a user gives: files of bounded size, places inside a folder, values cut to what fits in a sentence."""

from __future__ import annotations

import gzip
import os
import stat
import zlib
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import numpy as np

from mjsim.errors import InputError, shortened

_LARGEST = 200_000_000
#: Most samples of one trace: half an hour at 1 kHz. A recorder that makes more tells nothing more about a machine.
MOST = 2_000_000


def file_bytes(path: Path, largest: int, hint: str, what: str = "no such file") -> bytes:
    """Content of a file.

    Args:
        path: the file; links are followed.
        largest: bytes allowed.
        hint: what is allowed, for the sentence on a file that is too large.
        what: the sentence where there is none.

    Raises:
        InputError: it is not there, a folder, not readable, or too large.
    """
    try:
        if os.path.isdir(path):  # reading one is another error on each system
            raise IsADirectoryError
        if (size := os.path.getsize(path)) > largest:
            raise InputError(f"{path}: {_megabytes(size)}; {hint}")
        return path.read_bytes()
    except IsADirectoryError:
        raise InputError(f"{path}: a folder stands there; allowed: a file") from None
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path}: {what}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def is_file(path: Path) -> bool:
    """Whether a file is there; ``os.path.isfile`` denies it as well where nobody may look.

    Raises:
        InputError: nobody may look.
    """
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return False
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def read_bytes(path: Path, missing: str = "no such file") -> bytes:
    """The file's content; ``.gz`` is unpacked.

    Raises:
        InputError: it is missing, too large, or no gzip file.
    """
    data = file_bytes(path, _LARGEST, f"allowed: up to {_LARGEST / 1e6:.0f} MB, thin the trace", missing)
    if path.suffix != ".gz":
        return data
    try:
        return gzip.decompress(data)
    except (OSError, EOFError, zlib.error):
        raise InputError(f"{path}: not a readable gzip file; allowed: a CSV file, plain or as .csv.gz") from None


def csv_text(path: Path, allowed: str = "a CSV file") -> tuple[str, str]:
    """First line of a trace, plain or compressed (``.csv.gz``), and everything below it.

    Args:
        path: the file, as a campaign names it.
        allowed: what it may be, for the sentence on a file that is no text.

    Raises:
        InputError: it is missing, too large, or no text.
    """
    data = read_bytes(path, "the trace is missing (named in campaign.toml)")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not text; allowed: {allowed}") from None
    first, _, body = text.partition("\n")
    return first, body


def csv_table(path: Path, check: Callable[[list[str]], None]) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names of the columns of a trace of numbers, its rows (n, columns), and the lines that they stand on, (n,).

    Args:
        path: The file, plain or compressed (``.csv.gz``).
        check: Refuses names.

    Raises:
        InputError: Names the file, the line or column, what was found and what is allowed.
    """
    first, body = csv_text(path)
    body = body.replace("\r\n", "\n")
    names = [n.strip() for n in first.split(",")]
    check_rows(path, body.count("\n"))
    check(names)
    return names, *csv_rows(path, body, names)


def check_columns(path: Path, names: list[str], allowed: Collection[str], what: str = "") -> None:
    """Refuse columns that are unknown or double.

    Args:
        path: The file.
        names: Of its columns.
        allowed: Names that they may have.
        what: Of what these are allowed, for the sentence.

    Raises:
        InputError: Names the column and what is allowed.
    """
    of = f" for {what}" if what else ""
    for name in names:
        if name not in allowed:
            raise InputError(f"{path}, line 1: column {shown(name)}; allowed{of}: {', '.join(allowed)}")
        if names.count(name) > 1:
            raise InputError(f"{path}, line 1: the column {name} appears {names.count(name)} times; allowed: once")


def need_columns(path: Path, names: list[str], need: Sequence[str]) -> None:
    """Refuse a file that lacks a column.

    Args:
        path: The file.
        names: Of its columns.
        need: Names that they must have.

    Raises:
        InputError: Names the first one that is missing.
    """
    for name in need:
        if name not in names:
            raise InputError(f"{path}, line 1: the column {name} is missing")


def csv_rows(path: Path, body: str, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the rows below the first line, (n, columns), and the lines that they stand on, (n,); empty lines are
    left out.

    Args:
        path: The file, for messages.
        body: Everything below its first line.
        names: Of the columns.

    Raises:
        InputError: Names the line and what was found.
    """
    rows, lines = [], []
    for number, line in enumerate(body.split("\n"), start=2):
        if not line.strip():
            continue
        cells = line.split(",")
        if len(cells) != len(names):
            raise InputError(
                f"{path}, line {number}: {len(cells)} columns in {shown(line, 60)}; allowed: {len(names)}, as in line 1"
            )
        row = []
        for name, cell in zip(names, cells, strict=True):
            try:
                row.append(float(cell))
            except ValueError:
                row.append(np.nan)
            if not np.isfinite(row[-1]):
                raise InputError(
                    f"{path}, line {number}: {name} = {shown(cell.strip(), 40)}; allowed: a number with a decimal point"
                )
        rows.append(row)
        lines.append(number)
    return np.array(rows).reshape(len(rows), len(names)), np.array(lines)


def check_rows(path: Path, rows: int) -> None:
    """Refuse a table with more rows than a recording needs.

    Raises:
        InputError: it has more than :data:`MOST` rows.
    """
    if rows > MOST:
        raise InputError(
            f"{path}: {rows} rows; allowed: up to {MOST}, keep one row in {-(-rows // MOST)}, or the mean of as many"
        )


def named_file(file: Path, name: str, key: str, outside: bool = False) -> Path:
    """The file that a key of a campaign names.

    Args:
        file: The campaign's own file.
        name: As the key has it, relative to that file's folder.
        key: For messages.
        outside: Whether it may lie outside that folder.

    Raises:
        InputError: It is no file name, or leaves the folder.
    """
    if not name.strip() or not name.isprintable():
        raise InputError(f"{file}: {key} = {shown(name)} is no file name; allowed: a path inside the campaign's folder")
    target = file.parent / name
    if Path(name).is_absolute() or (not outside and not inside(file.parent, target)):
        raise InputError(f"{file}: {key} = {shown(name)} leaves the campaign's folder; allowed: a path inside it")
    return target


def inside(folder: Path, path: Path) -> bool:
    """Whether ``path`` lies in ``folder`` after all links have been followed."""
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def shown(value: object, longest: int = 80) -> str:
    """A value as it was found, cut to what fits in a sentence."""
    text = repr(value)
    return shortened(text if len(text) <= longest else f"{text[: longest - 10]} … ({len(text)} characters)")


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.0f} MB" if size >= 1e6 else f"{size} bytes"
