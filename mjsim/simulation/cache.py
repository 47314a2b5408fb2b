"""Compiled code that is older than its sources; only a checkout whose files change one by one has any."""

from __future__ import annotations

import contextlib
from pathlib import Path

_HERE = Path(__file__).resolve().parent


def forget_stale_code(folder: Path = _HERE, constants: Path = _HERE.parent / "machine") -> None:
    """Drop Numba's cache files that are older than a source of ``folder`` or of the ``constants`` that it compiles in.

    Numba looks at a compiled function's own file only, but the callback contains code and constants of its neighbours.
    An installed package changes as a whole, and Numba sees that by itself; the command line and the tests call this for
    a checkout.
    """
    newest = max(p.stat().st_mtime for place in (folder, constants) for p in place.glob("*.py"))
    for index in (folder / "__pycache__").glob("*.nbi"):
        with contextlib.suppress(OSError):
            if index.stat().st_mtime < newest:
                index.unlink()
