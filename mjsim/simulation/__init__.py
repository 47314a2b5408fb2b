"""Drives and transmissions, compiled, inside MuJoCo."""

from __future__ import annotations

import contextlib
from pathlib import Path


def forget_stale_code(folder: Path) -> None:
    """Drop compiled code that is older than any source of ``folder``.

    Numba looks at the compiled function's own file only; the callback also contains code and constants of its neighbours.
    """
    newest = max(p.stat().st_mtime for p in folder.glob("*.py"))
    for index in (folder / "__pycache__").glob("*.nbi"):
        with contextlib.suppress(OSError):
            if index.stat().st_mtime < newest:
                index.unlink()


forget_stale_code(Path(__file__).resolve().parent)
