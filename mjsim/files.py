"""Writing files whole or not at all, and never over the user's without being told to."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from mjsim.errors import InputError


def write_whole(path: Path, content: str | bytes, force: bool = False) -> None:
    """Write ``content`` to a temporary neighbour and move it into place.

    Raises:
        InputError: the file exists and ``force`` is false, or the folder cannot be written.
    """
    path = Path(path)
    if path.exists() and not force:
        raise InputError(f"{path}: exists already; name another file or give --force to replace it")
    data = content.encode() if isinstance(content, str) else content
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)
        os.replace(name, path)
    except OSError as error:
        Path(name).unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
