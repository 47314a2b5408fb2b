"""Results kept on disk by the content that they follow from, so that a second run is quick.

A key is a fingerprint of everything that a result depends on, :func:`code` among it. A changed trace, machine file or
version of mjsim therefore never gets an old result. Nothing is kept unless a block of :func:`cached` runs, as in the
commands.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import secrets
import struct
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from datetime import date
from functools import cache
from importlib.metadata import version
from pathlib import Path, PurePath
from typing import Any, TypeVar

import numpy as np

import mjsim
from mjsim.io.resources import model_file

T = TypeVar("T")
#: Environment: ``off``, or the folder of the cache. Its largest size in MB.
FOLDER, LIMIT = "MJSIM_CACHE", "MJSIM_CACHE_MB"
_MB, _LIMIT_MB = 1_000_000, 1000


class Store:
    """A folder of results, shared by all processes of a user. Files appear whole; what cannot be read is missing.

    Args:
        folder: Of the cache.
        limit: Its largest size, bytes; the results used longest ago go first.
    """

    def __init__(self, folder: Path, limit: int) -> None:
        self.folder, self.limit = folder, limit
        self.hits: Counter[str] = Counter()

    def get(self, kind: str, key: str) -> Any | None:
        """What was kept under a key, or ``None``."""
        file = self._file(kind, key)
        try:
            with file.open("rb") as stream:
                out = np.load(stream, allow_pickle=False) if kind in ARRAYS else pickle.load(stream)
            os.utime(file)
        except Exception:  # missing, or of another version, or damaged: computed again
            return None
        self.hits[kind] += 1
        return out

    def put(self, kind: str, key: str, value: Any) -> None:
        """Keep a result; nothing happens where it cannot be written."""
        file = self._file(kind, key)
        new = file.with_name(f".{file.name}.{secrets.token_hex(4)}")
        try:
            file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with new.open("wb") as stream:
                if kind in ARRAYS:
                    np.save(stream, value, allow_pickle=False)
                else:
                    pickle.dump(value, stream, protocol=pickle.HIGHEST_PROTOCOL)
            os.replace(new, file)
            self._shrink(kind)
        except Exception:  # no room, no permission, or something that cannot be written, as a class of the user's own
            with contextlib.suppress(OSError):
                new.unlink(missing_ok=True)

    def _file(self, kind: str, key: str) -> Path:
        return self.folder / kind / f"{key}.{'npy' if kind in ARRAYS else 'pickle'}"

    def seconds(self, work: str) -> float | None:
        """How long a unit of some work took last time, s; ``None`` where that is not known."""
        try:
            return float((self.folder / "seconds" / work).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None

    def took(self, work: str, seconds: float) -> None:
        """Keep how long a unit of some work took, s."""
        with contextlib.suppress(OSError):
            (self.folder / "seconds").mkdir(exist_ok=True)
            (self.folder / "seconds" / work).write_text(f"{seconds:.6g}", encoding="utf-8")

    def _shrink(self, kind: str) -> None:
        """Take the oldest results of a kind away until it keeps to its share of the folder."""
        found = []
        for file in (self.folder / kind).glob("*"):
            with contextlib.suppress(OSError):  # another process may have taken it away
                state = file.stat()
                found.append((state.st_mtime, state.st_size, file))
        size = sum(s for _, s, _ in found)
        for _, mine, file in sorted(found):
            if size <= SHARES.get(kind, 1.0) * self.limit:
                return
            with contextlib.suppress(OSError):
                file.unlink()
            size -= mine


#: Kinds of results that are one array each; the others are pickled. Shares of the cache that kinds may take.
ARRAYS = ("readings", "signatures")
SHARES = {"diagnoses": 0.5, "readings": 0.25, "signatures": 0.25}
_store: Store | None = None


def store() -> Store | None:
    """The store of the block of :func:`cached` that runs, if one does."""
    return _store


@contextmanager
def cached(
    folder: str | Path | None = None, limit_mb: float | None = None, wanted: bool = True
) -> Iterator[Store | None]:
    """Keep results on disk while the block runs, and use those that are there.

    Args:
        folder: Of the cache; by default that of the environment variable ``MJSIM_CACHE``, or ``mjsim`` in the user's
            folder for caches. ``MJSIM_CACHE=off`` switches it off. Only the user may be able to write there, because
            what is kept is loaded as Python objects.
        limit_mb: Largest size; by default that of ``MJSIM_CACHE_MB``, or 1000 MB.
        wanted: Without it, nothing is kept or used in the block.
    """
    global _store
    before, _store = _store, _opened(folder, limit_mb) if wanted else None
    try:
        yield _store
    finally:
        _store = before


def _opened(folder: str | Path | None, limit_mb: float | None) -> Store | None:
    said = os.environ.get(FOLDER, "")
    if folder is None and said.lower() in ("off", "0", "no"):
        return None
    usual = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "mjsim"
    place = Path(folder or said or usual)
    try:
        limit = float(limit_mb if limit_mb is not None else os.environ.get(LIMIT, _LIMIT_MB))
        place.mkdir(parents=True, exist_ok=True, mode=0o700)
    except (OSError, ValueError, RuntimeError):
        return None
    return Store(place, int(limit * _MB))


def remembered(kind: str, depends_on: Callable[[], Iterable], make: Callable[[], T]) -> T:
    """The result of ``make``, or what was kept of it.

    Args:
        kind: Folder in the cache.
        depends_on: Everything that the result follows from; asked only where a cache is used.
        make: Computes the result.
    """
    if _store is None:
        return make()
    try:
        key = fingerprint(code(), *depends_on())
    except TypeError:  # something without a fingerprint, as an effect of the user's own in Python
        return make()
    found = _store.get(kind, key)
    if found is not None:
        return found
    out = make()
    _store.put(kind, key, out)
    return out


def fingerprint(*things: Any) -> str:
    """SHA-256 of plain data, arrays, and objects of mjsim.

    Raises:
        TypeError: something else is among them.
    """
    digest = hashlib.sha256()
    for thing in things:
        _feed(digest, thing)
    return digest.hexdigest()


def _feed(digest: Any, thing: Any) -> None:
    kind = type(thing)
    digest.update(f"<{kind.__module__}.{kind.__qualname__}".encode())
    if thing is None or isinstance(thing, (str, bool, int, PurePath, date)):
        digest.update(str(thing).encode("utf-8", "surrogateescape") + b"\0")
    elif isinstance(thing, bytes):
        digest.update(thing)
    elif isinstance(thing, float):
        digest.update(struct.pack("<d", thing))
    elif isinstance(thing, np.ndarray) and thing.dtype != object:
        digest.update(f"{thing.dtype.str}{thing.shape}".encode())
        digest.update(np.ascontiguousarray(thing).tobytes())
    elif isinstance(thing, np.generic):
        digest.update(thing.tobytes())
    elif isinstance(thing, (list, tuple, frozenset, set)):
        for item in sorted(thing) if isinstance(thing, (set, frozenset)) else thing:
            _feed(digest, item)
    elif isinstance(thing, dict):
        for name, item in thing.items():
            _feed(digest, name)
            _feed(digest, item)
    elif kind.__module__.partition(".")[0] == "mjsim" and (is_dataclass(thing) or hasattr(thing, "__dict__")):
        names = [f.name for f in fields(thing)] if is_dataclass(thing) else sorted(vars(thing))
        for name in names:
            digest.update(f"{name}=".encode())
            _feed(digest, getattr(thing, name))
    else:
        raise TypeError(f"no fingerprint of {kind.__module__}.{kind.__qualname__}")
    digest.update(b">")


@cache
def code() -> str:
    """Versions of mjsim and of the packages below it, and when each of mjsim's files was last changed.

    The times make a checkout and a reinstalled package safe: both may change while the version stays.
    """
    files = [*Path(mjsim.__file__).parent.rglob("*.py"), *model_file().parent.glob("*.xml")]
    changed = sorted((file, file.stat().st_mtime_ns) for file in files)
    return fingerprint(mjsim.__version__, [version(p) for p in ("numpy", "scipy", "mujoco")], changed)
