"""Writing files whole or not at all, and never over the user's without being told to."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from mjsim.errors import InputError

#: Folders in one another; Python makes them by recursion.
_DEEPEST = 200


def check_writable(path: Path, force: bool = False) -> None:
    """Say before the work that :func:`write_whole` would refuse ``path``; writes nothing.

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

    Raises:
        InputError: the file exists and ``force`` is false, it is no regular file, or the folder cannot be written.
    """
    _check_free(path, force)
    with together() as staged:
        staged.append(_Neighbour(Path(path)))
        staged[-1].make().write_bytes(content.encode("utf-8", "replace") if isinstance(content, str) else content)


def write_all(contents: Mapping[Path, str | bytes], force: bool = False) -> None:
    """Write several files: all of them, or none.

    Raises:
        InputError: as :func:`write_whole`, for any of them.
    """
    with together():
        for path, content in contents.items():
            write_whole(path, content, force)


_STAGED: ContextVar[list[_Neighbour] | None] = ContextVar("staged", default=None)


@contextmanager
def together() -> Iterator[list[_Neighbour]]:
    """What is written inside appears at the end of the block: all of it, or nothing where the block raises.

    Every file stands beside its place before the first one is moved there, so that a full disk is found out in time; what was moved
    is moved back where a later one cannot be. A block inside another one belongs to it.

    Raises:
        InputError: a file cannot be written.
    """
    outer = _STAGED.get()
    if outer is not None:
        yield outer
        return
    staged: list[_Neighbour] = []
    token = _STAGED.set(staged)
    now = None
    try:
        yield staged
        for now in staged:
            now.move()
    except BaseException as error:  # also when the user stops the program: no temporary file stays behind
        for one in reversed(staged):
            one.undo()
        if isinstance(error, OSError) and staged:
            raise InputError(f"{(now or staged[-1]).shown}: cannot be written: {error.strerror or error}") from None
        raise
    finally:
        _STAGED.reset(token)
    try:
        for one in staged:
            one.forget()
    except BaseException:  # everything is in its place: an interrupt ends the tidying up a little later
        for one in staged:
            one.forget()
        raise


@contextmanager
def whole(path: Path, force: bool = False) -> Iterator[Path]:
    """A temporary neighbour of ``path`` for a writer that needs a file; it takes the place of ``path`` when the block ends well.

    Raises:
        InputError: as :func:`write_whole`, also for an ``OSError`` inside the block.
    """
    _check_free(path, force)
    one = _Neighbour(Path(path))
    try:
        yield one.make()
        one.move()
    except BaseException as error:
        one.undo()
        if isinstance(error, OSError):
            raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
        raise
    one.forget()


def _check_free(path: Path, force: bool) -> None:
    """Refuse a place that is taken, or that no file can have."""
    if len(Path(path).parts) > _DEEPEST:
        raise InputError(f"{path}: cannot be written: {len(Path(path).parts)} folders in one another; allowed: up to {_DEEPEST}")
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    except ValueError:
        raise InputError(f"{path}: is no file name") from None
    if not stat.S_ISREG(mode):
        what = "a folder" if stat.S_ISDIR(mode) else "no regular file"
        raise InputError(f"{path}: cannot be written: exists already and is {what}; name another file")
    if not force:
        raise InputError(f"{path}: exists already; name another file or give --force to replace it")


class _Neighbour:
    """A hidden file beside its place, whose name is known before it is there: whenever the program is stopped, it can be taken away."""

    def __init__(self, shown: Path) -> None:
        self.shown, self.path = shown, Path(os.path.realpath(shown))
        mark = f".{self.path.name[:80]}.{secrets.token_hex(6)}"
        self._new, self._former = self.path.with_name(mark), self.path.with_name(mark + ".former")
        self._folders: list[Path] = []
        self._moving = False

    def make(self) -> Path:
        """The empty neighbour, and the folders that it needs."""
        self._folders = [p for p in self.path.parents if not os.path.lexists(p)]
        self.path.parent.mkdir(parents=True, exist_ok=True)
        os.close(os.open(self._new, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
        return self._new

    def move(self) -> None:
        """Take the place; what stood there is kept until :meth:`forget`."""
        there = self.path.exists()
        os.chmod(self._new, self.path.stat().st_mode & 0o777 if there else 0o666 & ~_mask())
        if there:
            try:
                os.link(self.path, self._former)
            except OSError:  # a file system without hard links
                shutil.copy2(self.path, self._former)
        self._moving = True
        os.replace(self._new, self.path)

    def undo(self) -> None:
        """Everything as it was before."""
        with contextlib.suppress(OSError):
            if self._moving and not os.path.lexists(self._new):
                if self._former.exists():
                    os.replace(self._former, self.path)
                else:
                    self.path.unlink()
        for file in (self._new, self._former):
            with contextlib.suppress(OSError):
                file.unlink(missing_ok=True)
        for folder in self._folders:
            with contextlib.suppress(OSError):
                folder.rmdir()

    def forget(self) -> None:
        """The former file is no longer needed."""
        with contextlib.suppress(OSError):
            self._former.unlink(missing_ok=True)


def _mask() -> int:
    """The process' permission mask."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
