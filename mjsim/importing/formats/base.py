"""What a file format is, and which one reads a file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar, TypeVar

from mjsim.errors import InputError
from mjsim.importing.reading import Options
from mjsim.importing.table import Table, read_table
from mjsim.io.inputs import check_rows, read_bytes


class Format(ABC):
    """A file format of recorded traces.

    Class attributes:
        suffixes: endings of its files, in small letters, as ``(".mpr",)``. A ``.gz`` behind them is ignored. Empty for
            a format whose files end as others do: it tells them by their beginning.
        heeds: those of ``separator``, ``decimal`` and ``rows`` that it asks the options for; the others are refused.
    """

    suffixes: ClassVar[tuple[str, ...]] = ()
    heeds: ClassVar[tuple[str, ...]] = ()

    def recognises(self, head: str) -> bool:
        """Whether a file of any other suffix is one of this format, by its beginning.

        Args:
            head: the first characters of the file; bytes that are no UTF-8 are replaced.
        """
        return False

    @abstractmethod
    def read(self, path: Path, options: Options) -> Table:
        """The numbers of a file.

        Columns with the names ``time``, ``angle``, ``deviation`` and with units (``s``, ``deg``, ``um``) need no
        option; the user is asked for a unit that is "". An exception that is no InputError is reported as a file that
        is not one of this format.

        Args:
            path: the file; :func:`mjsim.io.inputs.read_bytes` reads it, up to a size limit.
            options: what the user said about the file.

        Raises:
            InputError: names the file, the place, what was found and what is allowed.
        """


_FORMATS: dict[str, Format] = {}
#: Bytes at the beginning of a file that formats are told by.
_HEAD = 8000
#: Options that say how a text is to be read.
_TEXT_ONLY = ("separator", "decimal", "rows")
_F = TypeVar("_F", bound=Format)


def register(cls: type[_F]) -> type[_F]:
    """Class decorator: makes a format known, under its suffixes or by the beginning of its files."""
    _FORMATS.update(dict.fromkeys(cls.suffixes or (cls.__name__,), cls()))
    return cls


def read_any(path: Path, options: Options) -> Table:
    """The numbers of a file: by the format of its suffix or of its beginning, otherwise as a table of text.

    Raises:
        InputError: the file cannot be read.
    """
    inner = path.with_suffix("") if path.suffix == ".gz" else path
    known = _FORMATS.get(inner.suffix.lower())
    if known is None:
        head = read_bytes(path)[:_HEAD].decode(errors="replace")
        known = next((f for f in _FORMATS.values() if f.recognises(head)), None)
    if known is None:
        return read_table(path, options.separator, options.decimal, options.rows)
    for name in _TEXT_ONLY:
        if getattr(options, name) is not None and name not in known.heeds:
            raise InputError(f"{path}: --{name} is for tables of text; a file of this format is read without it")
    try:
        table = known.read(path, options)
        check_rows(path, len(table.values))
    except InputError:
        raise
    except (ValueError, TypeError, LookupError, EOFError, AttributeError) as error:
        raise InputError(
            f"{path}: no {type(known).__name__} file that mjsim can read ({type(error).__name__}: {error}); allowed: "
            f"{known.__doc__ or 'a file of this format'}"
        ) from None
    return table
