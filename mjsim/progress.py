"""How long work tells its caller that it gets on."""

from __future__ import annotations

import itertools
from collections.abc import Callable

#: Called as ``progress(stage, done, total)``.
Progress = Callable[[str, int, int], None]


def silent(stage: str, done: int, total: int) -> None:
    """Progress that shows nothing."""


def counted(progress: Progress, stage: str, total: int) -> Callable[..., None]:
    """What tells ``progress`` of one more piece of ``total`` that is done, each time that it is called."""
    done = itertools.count(1)
    return lambda *_: progress(stage, next(done), total)
