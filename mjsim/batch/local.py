"""Jobs on the cores of this machine: threads that take one after another, in the order in which they are given."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from queue import SimpleQueue
from typing import Generic, TypeVar

from mjsim.batch.workshop import Job, Outcome, Workshop
from mjsim.simulation import callback
from mjsim.threads import one_blas_thread

_J = TypeVar("_J")
_R = TypeVar("_R")


class Crew(Generic[_J, _R]):
    """Threads that work off jobs; iterating gives each result as it comes, in the calling thread.

    Args:
        jobs: The jobs.
        workers: What each thread does with a job. What one raises, the iteration raises.
    """

    def __init__(self, jobs: Iterable[_J], workers: Sequence[Callable[[_J], _R]]) -> None:
        self._jobs, self._lock, self._stopped = iter(jobs), threading.Lock(), threading.Event()
        self._finished: SimpleQueue[tuple[_R] | BaseException | None] = SimpleQueue()
        self._threads = [threading.Thread(target=self._work, args=(w,), daemon=True) for w in workers]
        for thread in self._threads:
            thread.start()

    def _work(self, worker: Callable[[_J], _R]) -> None:
        try:
            while not self._stopped.is_set():
                with self._lock:
                    job = next(self._jobs, None)
                if job is None:
                    break
                self._finished.put((worker(job),))
        except BaseException as error:  # a mistake in mjsim itself, or no memory: the calling thread says so
            self._finished.put(error)
        finally:
            self._finished.put(None)

    def __iter__(self) -> Iterator[_R]:
        working = len(self._threads)
        while working:
            item = self._finished.get()
            if item is None:
                working -= 1
            elif isinstance(item, BaseException):
                raise item
            else:
                yield item[0]

    def stop(self) -> None:
        """Begin no further job."""
        self._stopped.set()

    def late(self) -> list[_R]:
        """Results of the jobs in flight, once all threads have ended."""
        for thread in self._threads:
            thread.join()
        items = [self._finished.get() for _ in range(self._finished.qsize())]
        return [item[0] for item in items if isinstance(item, tuple)]


@one_blas_thread
def run_local(workshop: Workshop, jobs: Iterable[Job], threads: int, deliver: Callable[[list[Outcome]], None]) -> None:
    """Run all jobs of a sweep; MuJoCo and the compiled callback hold no GIL.

    When the calling thread is interrupted or ``deliver`` raises, the runs in flight are finished and delivered, and the
    exception goes on.

    Args:
        workshop: Shared by all threads.
        jobs: The jobs.
        threads: Side by side.
        deliver: Gets each outcome as it comes, in the calling thread.
    """
    with callback.installed():
        crew = Crew(jobs, [workshop.run] * threads)
        try:
            for outcome in crew:
                deliver([outcome])
        finally:
            crew.stop()
            deliver(crew.late())
