"""Jobs on the cores of this machine: threads that share a workshop; MuJoCo and the compiled callback hold no GIL."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from queue import SimpleQueue

from mjsim.batch.workshop import Job, Outcome, Workshop
from mjsim.simulation import callback
from mjsim.threads import one_blas_thread


@one_blas_thread
def run_local(workshop: Workshop, jobs: Iterable[Job], threads: int, deliver: Callable[[list[Outcome]], None]) -> None:
    """Run all jobs; ``deliver`` gets each outcome as it comes, in the calling thread.

    When the calling thread is interrupted or ``deliver`` raises, the runs in flight are finished and delivered, and the
    exception goes on.
    """
    todo, lock, stop = iter(jobs), threading.Lock(), threading.Event()
    finished: SimpleQueue[Outcome | BaseException | None] = SimpleQueue()

    def work() -> None:
        try:
            while not stop.is_set():
                with lock:
                    job = next(todo, None)
                if job is None:
                    break
                finished.put(workshop.run(job))
        except BaseException as error:  # a mistake in mjsim itself, or no memory: the calling thread says so
            finished.put(error)
        finally:
            finished.put(None)

    with callback.installed():
        pool = [threading.Thread(target=work, daemon=True) for _ in range(threads)]
        for thread in pool:
            thread.start()
        try:
            _collect(finished, threads, deliver)
        finally:
            stop.set()
            for thread in pool:
                thread.join()
            late = []
            while not finished.empty():
                late.append(finished.get())
            deliver([o for o in late if isinstance(o, Outcome)])


def _collect(finished: SimpleQueue, threads: int, deliver: Callable[[list[Outcome]], None]) -> None:
    working = threads
    while working:
        item = finished.get()
        if item is None:
            working -= 1
        elif isinstance(item, BaseException):
            raise item
        else:
            deliver([item])
