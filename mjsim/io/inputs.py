"""What a user gives: regular files of bounded size, places inside a folder, values cut to what fits in a sentence.

A reader never opens anything else than a regular file: a FIFO without a writer would be waited for, a device would never end.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from mjsim.errors import InputError, shortened


def file_bytes(path: Path, largest: int, hint: str, what: str = "no such file", head: int | None = None) -> bytes:
    """Content of a regular file.

    Args:
        path: the file; links are followed. largest: bytes allowed. hint: what is allowed, for the sentence on a file that is too large.
        what: the sentence where there is none. head: only so many bytes of its beginning, of whatever size it is.

    Raises:
        InputError: it is not there, no regular file, not readable, or too large.
    """
    try:
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe, a socket or a device"
            raise InputError(f"{path}: {what}: {kind} stands there; allowed: a regular file")
        if head is None and status.st_size > largest:
            raise InputError(f"{path}: {_megabytes(status.st_size)}; {hint}")
        with open(path, "rb") as file:
            data = file.read(largest + 1 if head is None else head)
    except InputError:
        raise
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path}: {what}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:  # a NUL in its name
        raise InputError(f"{path}: {what}") from None
    if head is None and len(data) > largest:  # it has grown meanwhile
        raise InputError(f"{path}: more than {_megabytes(largest)}; {hint}")
    return data


def is_file(path: Path) -> bool:
    """Whether a regular file stands there; ``False`` as well for names that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def inside(folder: Path, path: Path) -> bool:
    """Whether ``path`` lies in ``folder`` after all links have been followed; links that lead round in a circle are taken as they are."""
    try:
        return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))
    except (OSError, ValueError):
        return False


def shown(value: object, longest: int = 80) -> str:
    """A value as it was found, cut to what fits in a sentence."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # tables in tables; whole numbers of more than some thousand digits
        return "something nested too deeply" if isinstance(value, (dict, list)) else "a number of too many digits"
    return shortened(text if len(text) <= longest else f"{text[: longest - 10]} … ({len(text)} characters)")


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.0f} MB" if size >= 1e6 else f"{size} bytes"
