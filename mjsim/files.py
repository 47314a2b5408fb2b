"""Writing files whole or not at all, and never over the user's without being told to."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mjsim.errors import InputError


def check_writable(path: Path, force: bool = False) -> None:
    """Say before the work that :func:`write_whole` would refuse ``path``; writes nothing.

    Raises:
        InputError: as :func:`write_whole`.
    """
    if path.exists() and not force:
        raise InputError(f"{path}: exists already; name another file or give --force to replace it")
    folder = next((p for p in Path(path).absolute().parents if os.path.lexists(p)), Path("/"))
    if not folder.is_dir():
        raise InputError(f"{path}: cannot be written: {folder} is not a folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{path}: cannot be written: no permission to write in {folder}")


def write_whole(path: Path, content: str | bytes, force: bool = False) -> None:
    """Write ``content`` to a temporary neighbour and move it into place; links are followed and permissions kept.

    Raises:
        InputError: the file exists and ``force`` is false, or the folder cannot be written.
    """
    with whole(path, force) as neighbour:
        neighbour.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def whole(path: Path, force: bool = False) -> Iterator[Path]:
    """A temporary neighbour of ``path`` for a writer that needs a file; it takes the place of ``path`` when the block ends well.

    Raises:
        InputError: as :func:`write_whole`, also for an ``OSError`` inside the block.
    """
    path = Path(path)
    if path.exists() and not force:
        raise InputError(f"{path}: exists already; name another file or give --force to replace it")
    shown, path = path, Path(os.path.realpath(path))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        os.close(handle)
    except OSError as error:
        raise InputError(f"{shown}: cannot be written: {error.strerror}") from None
    try:
        yield Path(name)
        os.chmod(name, path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_mask())
        os.replace(name, path)
    except BaseException as error:  # also when the user stops the program: no temporary file stays behind
        Path(name).unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise InputError(f"{shown}: cannot be written: {error.strerror}") from None
        raise


def _mask() -> int:
    """The process' permission mask."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
