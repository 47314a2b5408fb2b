"""Ctrl-C and SIGTERM: both end a command as an exception does, so that what is half-written is taken away."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Terminated(KeyboardInterrupt):
    """SIGTERM."""


_stop: KeyboardInterrupt | None = None


@contextmanager
def caught() -> Iterator[None]:
    """Inside, Ctrl-C and SIGTERM raise; one that the caller ignores (a job in the background) stays ignored.

    Only a process' main thread can have that.
    """
    global _stop
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: object) -> None:
        global _stop
        _stop = Terminated() if number == signal.SIGTERM else KeyboardInterrupt()
        raise _stop

    _stop = None
    wanted = [n for n in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(n) is not signal.SIG_IGN]
    former = {n: signal.signal(n, stop) for n in wanted}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler or signal.SIG_DFL)


def raise_again() -> None:
    """Raise once more what came in: Python drops an exception that is raised inside a destructor or a library's
    callback.
    """
    if _stop is not None:
        raise _stop


def status(stop: KeyboardInterrupt) -> int:
    """Exit status of a stopped command."""
    return 143 if isinstance(stop, Terminated) else 130
