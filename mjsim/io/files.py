"""Writing files whole or not at all, and never over the user's without being told to."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import BaseFileLock, FileLock, Timeout

from mjsim.errors import InputError


def check_writable(path: Path, force: bool = False) -> None:
    """Say before the work that :func:`write_whole` would refuse ``path``; writes nothing.

    Args:
        path: the file to be.
        force: an existing file may be replaced.

    Raises:
        InputError: as :func:`write_whole`.
    """
    _check_free(path, force)
    folder = next((p for p in Path(path).absolute().parents if os.path.lexists(p)), Path("/"))
    if not folder.is_dir():
        raise InputError(f"{path}: cannot be written: {folder} is not a folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{path}: cannot be written: no permission to write in {folder}")


def write_whole(path: Path, content: str | bytes, force: bool = False) -> None:
    """Write ``content`` to a temporary neighbour and move it into place; links are followed and permissions kept.

    Args:
        path: the file; folders that it needs are made.
        content: bytes, or text that becomes UTF-8.
        force: replace an existing file.

    Raises:
        InputError: the file exists and ``force`` is false, it is no regular file, or the folder cannot be written.
    """
    write_all({path: content}, force)


def write_all(contents: Mapping[Path, str | bytes], force: bool = False) -> None:
    """Write several files; where one cannot be written, none is.

    Raises:
        InputError: as :func:`write_whole`, for any of them.
    """
    with together(force) as write:
        for path, content in contents.items():
            write(path, content)


@contextmanager
def together(force: bool = False) -> Iterator[Callable[[Path, str | bytes], None]]:
    """A function ``write(path, content)`` whose files appear at the end of the block; none of them where the block
    raises.

    Every file stands beside its place before the first one is moved there, so that a full disk is found out in time.

    Raises:
        InputError: as :func:`write_whole`, for any of them.
    """
    waiting: list[_Neighbour] = []

    def write(path: Path, content: str | bytes) -> None:
        _check_free(path, force)
        waiting.append(_Neighbour(Path(path)))
        waiting[-1].make().write_bytes(content.encode("utf-8", "replace") if isinstance(content, str) else content)

    with _cleaned(waiting):
        yield write
        for one in waiting:
            one.move()


@contextmanager
def whole(path: Path, force: bool = False) -> Iterator[Path]:
    """A temporary neighbour of ``path`` for a writer that needs a file; it takes the place of ``path`` when the block
    ends well.

    Raises:
        InputError: as :func:`write_whole`, also for an ``OSError`` inside the block.
    """
    _check_free(path, force)
    one = _Neighbour(Path(path))
    with _cleaned([one]):
        yield one.make()
        one.move()


def locked(folder: Path, command: str) -> BaseFileLock:
    """Hold a folder until the lock is released, or the process ends in whatever way.

    Args:
        folder: Where only one process at a time may write; the lock is on its file ``.lock``.
        command: What writes there, for the sentence.

    Returns:
        The lock, which is held; ``release()`` gives it back.

    Raises:
        InputError: Another process holds it, or the folder cannot be written.
    """
    lock = FileLock(Path(folder) / ".lock", timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise InputError(f"{folder}: another {command} is writing there; allowed: one at a time") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return lock


@contextmanager
def _cleaned(waiting: list[_Neighbour]) -> Iterator[None]:
    """Takes temporary files away where the block raises, also when the user stops the program; an OSError becomes a
    sentence.
    """
    try:
        yield
    except BaseException as error:
        for one in reversed(waiting):
            one.remove()
        if isinstance(error, OSError) and waiting:
            raise InputError(f"{waiting[-1].shown}: cannot be written: {error.strerror or error}") from None
        raise


def _check_free(path: Path, force: bool) -> None:
    """Refuse a place that is taken, or that no file can have."""
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    if not stat.S_ISREG(mode):
        what = "a folder" if stat.S_ISDIR(mode) else "no regular file"
        raise InputError(f"{path}: cannot be written: exists already and is {what}; name another file")
    if not force:
        raise InputError(f"{path}: exists already; name another file or give --force to replace it")


class _Neighbour:
    """A hidden file beside its place, whose name is known before it is there: whenever the program is stopped, it
    can be taken away.
    """

    def __init__(self, shown: Path) -> None:
        self.shown, self.path = shown, Path(os.path.realpath(shown))
        self._new = self.path.with_name(f".{self.path.name[:80]}.{secrets.token_hex(6)}")
        self._folders: list[Path] = []
        self._appeared = False

    def make(self) -> Path:
        """The empty neighbour, and the folders that it needs."""
        self._folders = [p for p in self.path.parents if not os.path.lexists(p)]
        self.path.parent.mkdir(parents=True, exist_ok=True)
        os.close(os.open(self._new, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
        return self._new

    def move(self) -> None:
        """Take the place, with the permissions of the file that stood there."""
        there = self.path.exists()
        os.chmod(self._new, self.path.stat().st_mode & 0o777 if there else 0o666 & ~_mask())
        os.replace(self._new, self.path)
        self._appeared = not there

    def remove(self) -> None:
        """Take the neighbour away, a file that was not there before, and the folders that were made for it and are
        empty.
        """
        with suppress(OSError):
            (self.path if self._appeared else self._new).unlink(missing_ok=True)
        for folder in self._folders:
            with suppress(OSError):
                folder.rmdir()


def _mask() -> int:
    """The process' permission mask."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def finite(value: Any) -> Any:
    """The same data with ``None`` for numbers that JSON does not have."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    return None if isinstance(value, float) and value - value != 0.0 else value
