"""How long work tells its caller that it gets on."""

from __future__ import annotations

from collections.abc import Callable

#: Called as ``progress(stage, done, total)``.
Progress = Callable[[str, int, int], None]


def silent(stage: str, done: int, total: int) -> None:
    """Progress that shows nothing."""
