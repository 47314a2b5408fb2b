"""What holds for the whole process while a user's own code runs: ``print`` goes to stderr, memory has an end."""

from __future__ import annotations

import resource
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

#: Share of the memory that is free now that the process may still take.
_SHARE = 0.9
#: The system is asked again after this time, s.
_ASK_AGAIN_S = 1.0

_change = threading.Lock()
_inside = 0
_before: tuple = ()
_asked, _enough = -_ASK_AGAIN_S, None


@contextmanager
def confined() -> Iterator[None]:
    """Inside, ``sys.stdout`` is stderr and the process cannot take more memory than there is.

    Both belong to the process: the first of several users changes them, the last one puts them back.
    """
    global _inside, _before
    with _change:
        _inside += 1
        if _inside == 1:
            _before = sys.stdout, resource.getrlimit(resource.RLIMIT_AS)
            sys.stdout = sys.stderr
            _limit_memory(*_before[1])
    try:
        yield
    finally:
        with _change:
            _inside -= 1
            if _inside == 0:
                sys.stdout = _before[0]
                with suppress(ValueError, OSError):
                    resource.setrlimit(resource.RLIMIT_AS, _before[1])


def _limit_memory(soft: int, hard: int) -> None:
    """An allocation that the machine cannot serve fails with a MemoryError, before the system ends the whole process."""
    global _asked, _enough
    if time.monotonic() - _asked > _ASK_AGAIN_S:
        _asked, _enough = time.monotonic(), _available()
    if _enough is not None:
        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_AS, (_enough if soft < 0 else min(soft, _enough), hard))


def _available() -> int | None:
    """Bytes of address space that the process has and could still fill; ``None`` where the system does not tell."""
    try:
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        lines = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        return taken + int(_SHARE * int(lines["MemAvailable"].split()[0]) * 1024)
    except (OSError, ValueError, KeyError, IndexError):
        return None
