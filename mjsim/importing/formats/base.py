"""What a file format is, and which one reads a file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar, TypeVar

from mjsim.campaign.traces import read_bytes
from mjsim.importing.reading import Options
from mjsim.importing.table import Table, read_table


class Format(ABC):
    """A file format of recorded traces.

    Class attributes:
        suffixes: endings of its files, in small letters, as ``(".mpr",)``. A ``.gz`` behind them is ignored. Empty for
            a format whose files end as others do: it tells them by their beginning.
    """

    suffixes: ClassVar[tuple[str, ...]] = ()

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
        option.

        Args:
            path: the file; :func:`mjsim.campaign.traces.read_bytes` reads it, up to a size limit.
            options: what the user said about the file.

        Raises:
            InputError: names the file, the place, what was found and what is allowed.
        """


_FORMATS: dict[str, Format] = {}
#: Bytes at the beginning of a file that formats are told by.
_HEAD = 8000
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
    return known.read(path, options) if known else read_table(path, options.separator, options.decimal, options.rows)
