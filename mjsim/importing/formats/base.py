"""What a file format is, and which one reads a file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar, TypeVar

from mjsim.importing.reading import Options
from mjsim.importing.table import Table, read_table


class Format(ABC):
    """A file format of recorded traces.

    Class attributes:
        suffixes: endings of its files, in small letters, as ``(".mpr",)``. A ``.gz`` behind them is ignored.
    """

    suffixes: ClassVar[tuple[str, ...]]

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
_F = TypeVar("_F", bound=Format)


def register(cls: type[_F]) -> type[_F]:
    """Class decorator: makes a format known under its suffixes."""
    _FORMATS.update(dict.fromkeys(cls.suffixes, cls()))
    return cls


def read_any(path: Path, options: Options) -> Table:
    """The numbers of a file: by the format of its suffix, otherwise as a table of text.

    Raises:
        InputError: the file cannot be read.
    """
    inner = path.with_suffix("") if path.suffix == ".gz" else path
    known = _FORMATS.get(inner.suffix.lower())
    return known.read(path, options) if known else read_table(path, options.separator, options.decimal, options.rows)
