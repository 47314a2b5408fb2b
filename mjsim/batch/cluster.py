"""Jobs on a running Dask cluster: chunks go to its workers, outcomes come back to the local folder; workers need no
shared disk.

A worker that dies takes nothing with it but the chunks that it was working on, which the scheduler gives to others.
Effects of the user's own travel as the text of their files.
"""

from __future__ import annotations

import logging
import math
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

from mjsim.batch.describe import versions
from mjsim.batch.recipe import Recipe
from mjsim.batch.workshop import Job, Outcome, Workshop
from mjsim.effects import registry
from mjsim.errors import InputError, SimulationError
from mjsim.io.extras import need
from mjsim.machine.model import Machine
from mjsim.simulation import callback
from mjsim.threads import one_blas_thread

#: Seconds after which a scheduler that does not answer is given up.
TIMEOUT_S = 5.0
#: Chunks that each thread of the cluster has waiting, beside the one that it works on.
AHEAD = 2


def run_on_cluster(client: Any, recipe: Recipe, every: int, jobs: Iterable[Job], size: int, deliver: Callable) -> None:
    """Run all jobs on a cluster; ``deliver`` gets the outcomes of each chunk as they come.

    Args:
        client: of :func:`connected`. recipe, every: as :class:`Workshop` takes them. size: jobs of one chunk.

    Raises:
        InputError: a worker that joined later has other versions.
        SimulationError: a chunk failed on the cluster, or the scheduler went away.
    """
    shop, mine = client.submit(_unpack, _pack(recipe), every, pure=False), versions()

    def submit(chunk: list[Job]) -> Any:
        return client.submit(_work, shop, chunk, mine, pure=False, retries=0)

    feed(client, submit, _chunks(jobs, size), lambda _, future: deliver(_result(future)))


def _chunks(jobs: Iterable[Job], size: int) -> Iterator[list[Job]]:
    jobs = iter(jobs)
    while chunk := list(islice(jobs, size)):
        yield chunk


def feed(client: Any, submit: Callable[[Any], Any], parts: Iterator, deliver: Callable[[Any, Any], None]) -> None:
    """Keep a cluster busy with parts of some work.

    Args:
        client: of :func:`connected`.
        submit: hands one part to the client and returns its future.
        parts: of the work; taken as the cluster needs them.
        deliver: gets each part with its future, once that is done.
    """
    from distributed import as_completed

    flight = as_completed(loop=client.loop)
    open_futures: dict[str, tuple[Any, Any]] = {}
    wanted, asked = 0, -math.inf

    def send() -> None:
        nonlocal wanted, asked
        if time.monotonic() - asked > TIMEOUT_S:  # workers may come and go
            wanted, asked = (1 + AHEAD) * max(1, sum(client.nthreads().values())), time.monotonic()
        while len(open_futures) < wanted and (part := next(parts, None)) is not None:
            future = submit(part)
            open_futures[future.key] = part, future
            flight.add(future)

    try:
        send()
        while open_futures:
            future = next(flight)
            deliver(open_futures[future.key][0], future)
            del open_futures[future.key]
            future.release()
            send()
    finally:
        client.cancel([future for _, future in open_futures.values()])


def _result(future: Any) -> list[Outcome]:
    try:
        return future.result()
    except (InputError, SimulationError):
        raise
    except (
        Exception
    ) as error:  # whatever the cluster makes of it: a worker lost for the fourth time, the scheduler gone
        raise SimulationError(
            f"the cluster gave a chunk back: {type(error).__name__}: {error}; run the same command to go on"
        ) from None


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
        _check_versions(worker, found, versions())


def _check_versions(worker: str, found: dict[str, str], wanted: dict[str, str]) -> None:
    for what in wanted:
        if found.get(what) != wanted[what]:
            raise InputError(
                f"worker {worker} has {what} {str(found.get(what))[:12]}, this machine {wanted[what][:12]}; "
                "allowed: the same on all, results would differ"
            )


# -- on the workers ----------------------------------------------------------------------------------------------------


class Shop:
    """A workshop on a worker. Dask may hand it from one worker to another: it travels as what it was made from."""

    def __init__(self, packed: tuple, every: int) -> None:
        self._made_from = packed, every
        self.workshop = Workshop(_recipe(packed), every)

    def __reduce__(self) -> tuple:
        return Shop, self._made_from


def _unpack(packed: tuple, every: int) -> Shop:
    return Shop(packed, every)


@one_blas_thread
def _work(shop: Shop, chunk: list[Job], wanted: dict[str, str]) -> list[Outcome]:
    _check_versions("that joined later", versions(), wanted)
    with callback.installed():
        return [shop.workshop.run(job) for job in chunk]


def _pack(recipe: Recipe) -> tuple:
    """A recipe as plain data: an effect class of the user's cannot be pickled, its text can."""
    m, effects = recipe.base, []
    folder = Path(m.path).parent if m.path else Path()
    for e in m.effects:
        file = m.effect_files.get(e.id)
        text = None if file is None else (folder / file).read_bytes()
        effects.append((e.kind, e.subject, e.values, None if file is None else Path(file).name, text))
    return m.name, m.drives, m.configuration, effects, recipe.targets


def _recipe(packed: tuple) -> Recipe:
    name, drives, configuration, effects, targets = packed
    made = []
    with tempfile.TemporaryDirectory(prefix="mjsim-") as scratch:
        for kind, subject, values, file, text in effects:
            if text is None:
                if kind not in registry.kinds():
                    raise InputError(
                        f"a worker does not know the effect {kind!r}; install the package that brings it on all workers"
                    )
                cls = registry.kinds()[kind]
            else:
                place = Path(scratch) / file
                place.write_bytes(text)
                cls = registry.load_file(place)
            made.append(cls(subject, **values))
    return Recipe(Machine(name, drives, tuple(made), None, configuration), targets)
