"""Jobs side by side: in threads or processes of this machine, or on a running Dask cluster.

All three are executors of ``concurrent.futures``, and :func:`work_off` is how all of them are kept busy. The workers of
a cluster need no shared disk. One that dies takes nothing with it but the jobs that it was working on, which the
cluster gives to others.
"""

from __future__ import annotations

import json
import logging
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import IO, Any, TypeVar

from mjsim.batch.tables import check_versions, versions
from mjsim.errors import InputError, SimulationError, shortened
from mjsim.io.extras import need

#: Seconds after which a scheduler that does not answer is given up.
TIMEOUT_S = 5.0
#: Jobs that wait for each thread, beside the one that it works on.
AHEAD = 2
_ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
_J = TypeVar("_J")
_R = TypeVar("_R")


@dataclass(frozen=True)
class Crew:
    """Who does the jobs.

    Attributes:
        executor: Begins them.
        size: How many it works on at once; workers of a cluster may come and go.
        share: Makes a value that all jobs need an argument of them; it travels to each worker of a cluster once.
        is_cluster: Whether they are other computers, which may be lost.
    """

    executor: Executor
    size: Callable[[], int]
    share: Callable[[Any], Any] = lambda value: value
    is_cluster: bool = False

    def result(self, future: Future[_R]) -> _R:
        """What came out of a job.

        Raises:
            SimulationError: The cluster has lost it. What the job itself raises is raised as it is.
        """
        try:
            return future.result()
        except (InputError, SimulationError):
            raise
        except Exception as error:  # whatever a cluster makes of it: a worker lost for the fourth time, itself gone
            if not self.is_cluster:
                raise
            what = shortened(f"the cluster gave it back: {type(error).__name__}: {error}", 400)
            raise SimulationError(f"{what}; run the same command to go on") from None


def work_off(
    crew: Crew, jobs: Iterable[_J], submit: Callable[[_J], Future], deliver: Callable[[_J, Future], None]
) -> None:
    """Keep a crew busy until all jobs are done.

    Where the calling thread is interrupted or ``deliver`` raises, no further job begins. What was running is delivered
    if it still ends well, and the exception goes on.

    Args:
        crew: Shut down where the work is interrupted.
        jobs: Taken as they are needed.
        submit: Gives a job to the crew's executor.
        deliver: Gets each job with its future once that is done, in the calling thread.
    """
    jobs, flight = iter(jobs), {}
    try:
        while True:
            for job in islice(jobs, max(0, (1 + AHEAD) * crew.size() - len(flight))):
                flight[submit(job)] = job
            if not flight:
                return
            for future in wait(flight, return_when=FIRST_COMPLETED).done:
                deliver(flight.pop(future), future)
    finally:
        running = [future for future in flight if not future.cancel()]
        if flight:
            crew.executor.shutdown(wait=False)
        with ExitStack() as late:  # each of them, also where the first one raises
            for future in wait(running).done:
                if future.exception() is None:
                    late.callback(deliver, flight[future], future)


@contextmanager
def crew_of(here: Executor, count: int, scheduler: str | None) -> Iterator[Crew]:
    """The workers of a cluster where its scheduler is named, else those of this machine.

    Args:
        here: Threads or processes of this machine.
        count: How many they are.
        scheduler: Address of a Dask scheduler, or ``None``.

    Raises:
        InputError: As :func:`connected`.
    """
    if scheduler is None:
        with here:
            yield Crew(here, lambda: count)
        return
    with connected(scheduler) as client:
        known, asked = 1, -math.inf

        def size() -> int:
            nonlocal known, asked
            if time.monotonic() - asked > TIMEOUT_S:
                known, asked = max(1, sum(client.nthreads().values())), time.monotonic()
            return known

        def share(value: Any) -> Any:
            return client.submit(_same, value, pure=False)

        yield Crew(client.get_executor(pure=False, retries=0), size, share, is_cluster=True)


def _same(value: Any) -> Any:
    return value


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """A client of the scheduler at ``address``, e.g. ``tcp://127.0.0.1:8786``, whose workers have been looked at; its
    log stays silent.

    Raises:
        InputError: the extra is not installed, no scheduler or worker is there, or versions differ.
    """
    need("--scheduler", "distributed", "distributed")
    from distributed import Client
    from distributed.comm.addressing import parse_address, parse_host_port

    for name in [n for n in logging.root.manager.loggerDict if n.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters comes as an exception
    try:
        parse_host_port(parse_address(address)[1])
        client = Client(address, timeout=TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError, RuntimeError) as error:
        reason = "" if isinstance(error, OSError) else f" ({type(error).__name__}: {error})"
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answered within {TIMEOUT_S:g} s{reason}; "
            "allowed: the address that `dask scheduler` prints, e.g. tcp://host:8786"
        ) from None
    try:
        _check_workers(client, address)
        yield client
    finally:
        client.close(timeout=TIMEOUT_S)


def _check_workers(client: Any, address: str) -> None:
    if not client.scheduler_info(n_workers=-1)["workers"]:
        raise InputError(
            f"--scheduler {address}: the scheduler has no workers; start some with `dask worker {address}`"
        )
    try:
        there = client.run(versions)
    except Exception as error:  # what a worker without mjsim raises depends on how far it gets
        raise InputError(
            f"--scheduler {address}: a worker cannot run mjsim ({type(error).__name__}: {error}); install the same "
            f"mjsim on all workers"
        ) from None
    for worker, found in there.items():
        check_versions(worker, versions(), found)


class Processes(ThreadPoolExecutor):
    """Processes that answer questions, each a line of JSON; one that dies costs the question that it was working on.

    Args:
        count: Side by side.
        module: What each runs, as ``python -m`` does.
        time_limit: Seconds for one answer.
    """

    def __init__(self, count: int, module: str, time_limit: float) -> None:
        super().__init__(count)
        self._module, self._limit, self._ended = module, time_limit, False
        self._idle: list[tuple[subprocess.Popen[str], IO[str]]] = []
        self._alive: set[subprocess.Popen[str]] = set()

    def ask(self, question: dict) -> dict:
        """The answer of one process; called in one of the threads.

        Raises:
            SimulationError: It has died, or took too long.
        """
        process, errors = self._idle.pop() if self._idle else self._begin()
        if self._ended:
            process.kill()
        assert process.stdin and process.stdout
        late = threading.Event()

        def stop() -> None:  # a pipe has no time limit on Windows, a process can be ended everywhere
            late.set()
            process.kill()

        alarm = threading.Timer(self._limit, stop)
        alarm.daemon = True
        alarm.start()
        try:
            process.stdin.write(json.dumps(question) + "\n")
            process.stdin.flush()
            line = process.stdout.readline()
        except (OSError, ValueError):  # its input is closed: it has died; Windows has another error for that
            line = ""
        finally:
            alarm.cancel()
        if line and not late.is_set() and not self._ended:
            self._idle.append((process, errors))
            return json.loads(line)
        status = process.wait()
        self._alive.discard(process)
        if late.is_set():
            raise SimulationError(f"stopped after {self._limit:g} s, the limit for one campaign")
        if status < 0:
            why = f"signal {signal.Signals(-status).name}; not enough memory is the usual reason"
        else:
            errors.seek(0)
            said = [line for line in errors.read().splitlines() if line.strip()]
            why = f"status {status}: {said[-1] if said else 'no message'}"
        raise SimulationError(shortened(f"its process ended with {why}", 400))

    def _begin(self) -> tuple[subprocess.Popen[str], IO[str]]:
        errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", self._module],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors,
                text=True, encoding="utf-8", env={**os.environ, **_ONE_THREAD},
                start_new_session=True, creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
            )  # fmt: skip
        except OSError as error:
            raise SimulationError(f"no process for a campaign could be started: {error.strerror or error}") from None
        self._alive.add(process)
        return process, errors

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes, whatever they do."""
        self._ended = True
        for process in list(self._alive):
            process.kill()
        super().shutdown(wait, cancel_futures=cancel_futures)
        for process in list(self._alive):
            process.kill()
            process.wait()
