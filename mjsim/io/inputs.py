"""What a user gives: files of bounded size, places inside a folder, values cut to what fits in a sentence."""

from __future__ import annotations

import os
from pathlib import Path

from mjsim.errors import InputError, shortened


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
        raise InputError(f"{path}: {what}: a folder stands there; allowed: a file") from None
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path}: {what}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def inside(folder: Path, path: Path) -> bool:
    """Whether ``path`` lies in ``folder`` after all links have been followed."""
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def shown(value: object, longest: int = 80) -> str:
    """A value as it was found, cut to what fits in a sentence."""
    text = repr(value)
    return shortened(text if len(text) <= longest else f"{text[: longest - 10]} … ({len(text)} characters)")


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.0f} MB" if size >= 1e6 else f"{size} bytes"
