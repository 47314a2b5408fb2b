"""How the work is spread over cores: one test per thread, so every thread's linear algebra stays on its own core."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import wraps
from typing import ParamSpec, TypeVar

#: ``M_ARENA_MAX`` of the GNU C library's ``mallopt``.
_MOST_HEAPS = -8
P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")


class Workers:
    """Threads that work side by side; they end with the last owner that has them.

    A diagnosis calls them more than a thousand times: starting them each time took a fifth of it on a busy machine.

    Args:
        threads: How many; with one, the calling thread does the work.
    """

    def __init__(self, threads: int) -> None:
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None
        if self._pool is not None:
            weakref.finalize(self, self._pool.shutdown, wait=False)

    def map(self, work: Callable[[T], R], items: Iterable[T]) -> list[R]:
        """``work(item)`` for every item, in order; ``work`` must not call this itself."""
        return list(map(work, items) if self._pool is None else self._pool.map(work, items))

    def start(self, work: Callable[[], R]) -> Callable[[], R]:
        """Let one thread do ``work()`` while the calling thread goes on.

        Returns:
            What waits for the result, and gives it. With one thread, the work is done when it is asked for.
        """
        return work if self._pool is None else self._pool.submit(work).result


def share_one_heap() -> None:
    """Let all threads of this process take their memory from one heap, so that one can use what another gave back.

    The C library of Linux gives every thread a heap of its own. With one, a diagnosis needs a tenth less memory and as
    much time. Other C libraries have no such setting.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(_MOST_HEAPS, 1)


def one_blas_thread(work: Callable[P, R]) -> Callable[P, R]:
    """Decorator: BLAS runs single-threaded inside. Its threads on small matrices cost three times what they save."""

    @wraps(work)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(limits=1, user_api="blas"):
            return work(*args, **kwargs)

    return limited
