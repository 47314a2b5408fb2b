"""``mjsim batch`` as a function: run a sweep, or go on with it."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjsim.batch.arrow import pq
from mjsim.batch.dataset import Folder
from mjsim.batch.local import run_local
from mjsim.batch.sweep import Sweep, read_sweep
from mjsim.batch.workshop import Outcome, Workshop
from mjsim.instruments.ball_bar.program import Program
from mjsim.simulation import callback
from mjsim.simulation.axes import TAIL
from mjsim.simulation.drive import STEP

if TYPE_CHECKING:
    import pandas as pd

#: ``progress(simulations done, all, steps done, all)``; what an earlier process has done counts as done.
Progress = Callable[[int, int, int, int], None]
#: Finished runs are written after this time, s, or this share of the time so far, so that long sweeps do not make too
#: many files.
FLUSH_S, FLUSH_SHARE = 1.0, 0.002
#: Steps of MuJoCo that a chunk for a cluster has about: some seconds of work.
_CHUNK_STEPS = 1_000_000
_LARGEST_CHUNK = 64


@dataclass(frozen=True)
class BatchResult:
    """A finished sweep.

    Attributes:
        name: of the sweep. out: its folder. runs, tests: their numbers.
        simulated: simulations of this call; the others were there already. failed: simulations without figures.
        seconds: time of this call. steps: MuJoCo steps of this call.
    """

    name: str
    out: Path
    runs: int
    tests: int
    simulated: int
    failed: int
    seconds: float
    steps: int

    @property
    def files(self) -> list[Path]:
        """Every file of the result."""
        return [
            self.out / "sweep.json",
            *sorted(self.out.glob("results/part-*")),
            *sorted(self.out.glob("traces/part-*")),
        ]

    def to_dataframe(self) -> pd.DataFrame:
        """The results: one row per run and test, units in the columns' names."""
        import pandas as pd

        return pd.read_parquet(self.out / "results")

    def traces(self) -> pd.DataFrame:
        """The traces, one row per run and test, each column an array; empty where none were asked for."""
        import pandas as pd

        folder = self.out / "traces"
        return pd.read_parquet(folder) if any(folder.glob("part-*")) else pd.DataFrame()


def batch(
    sweep: str | Path | Sweep,
    out: str | Path,
    threads: int = 2,
    scheduler: str | None = None,
    force: bool = False,
    progress: Progress = lambda *_: None,
) -> BatchResult:
    """Run a sweep, or go on where a former call was stopped: what is in ``out`` already is not simulated again.

    Args:
        sweep: a sweep file (or what :func:`mjsim.batch.sweep.read_sweep` makes of it). out: folder of the results.
        threads: runs side by side on this machine. scheduler: address of a Dask scheduler whose workers do the runs
            instead.
        force: start anew even if ``out`` holds results. progress: called after each run.

    Raises:
        InputError: the sweep file or what it names is wrong, ``out`` holds another sweep, or the cluster cannot be
            used.
        KeyboardInterrupt: the user stopped it; finished runs are in ``out``.
    """
    sweep = sweep if isinstance(sweep, Sweep) else read_sweep(sweep)
    with _cluster(scheduler) as client, Folder(sweep, Path(out), force) as folder:
        done = folder.done()
        steps = [step_count(sweep, i) for i in range(len(sweep.tests))]
        writer = _Writer(folder, done, sweep.runs * len(sweep.tests), steps, sweep.runs, progress)
        jobs = (j for j in sweep.jobs() if (j.run, j.test) not in done)
        try:
            if not writer.left:
                pass
            elif client is None:
                run_local(Workshop(sweep.recipe, sweep.every), jobs, min(threads, writer.left), writer.take)
            else:
                from mjsim.batch.cluster import run_on_cluster

                run_on_cluster(
                    client, sweep.recipe, sweep.every, jobs, chunk_size(sweep, steps, writer.left), writer.take
                )
        finally:
            writer.flush()
        folder.finish()
    return writer.result(sweep, Path(out))


def _cluster(scheduler: str | None) -> AbstractContextManager[Any]:
    """A client of the scheduler, or ``None``."""
    if scheduler is None:
        return nullcontext()
    from mjsim.batch.cluster import connected

    return connected(scheduler)


class _Writer:
    """Counts outcomes and writes them as shards, each key once."""

    def __init__(self, folder: Folder, done: set, total: int, steps: list[int], runs: int, progress: Progress) -> None:
        self._folder, self._seen, self._total, self._progress = folder, set(done), total, progress
        self._steps, self._all_steps = steps, sum(steps) * runs
        self._stepped = sum(steps[t] for _, t in done)
        self._before, self._stepped_before = len(done), self._stepped
        self._kept: list[Outcome] = []
        self._begun = self._flushed = time.monotonic()
        self._tell()

    @property
    def left(self) -> int:
        """Simulations that are not there yet."""
        return self._total - len(self._seen)

    def take(self, outcomes: list[Outcome]) -> None:
        for o in outcomes:
            if (o.run, o.test) not in self._seen:
                self._seen.add((o.run, o.test))
                self._kept.append(o)
                self._stepped += self._steps[o.test]
        now = time.monotonic()
        if now - self._flushed >= max(FLUSH_S, FLUSH_SHARE * (now - self._begun)):
            self.flush()
        self._tell()

    def flush(self) -> None:
        kept, self._kept = self._kept, []
        self._folder.write(kept)
        self._flushed = time.monotonic()

    def _tell(self) -> None:
        self._progress(len(self._seen), self._total, self._stepped, self._all_steps)

    def result(self, sweep: Sweep, out: Path) -> BatchResult:
        errors = [pq.ParquetFile(f).read(columns=["error"])["error"] for f in out.glob("results/part-*")]
        failed = sum(len(e) - e.null_count for e in errors)
        spent = time.monotonic() - self._begun
        simulated, stepped = len(self._seen) - self._before, self._stepped - self._stepped_before
        return BatchResult(sweep.name, out, sweep.runs, len(sweep.tests), simulated, failed, spent, stepped)


def step_count(sweep: Sweep, test: int) -> int:
    """MuJoCo steps of one test, as it is in the middle run where runs differ."""
    return int((Program(sweep.test_of(sweep.runs // 2, test)).duration + TAIL) / STEP)


def chunk_size(sweep: Sweep, steps: list[int], left: int) -> int:
    """Jobs of one chunk: some seconds of work, and enough chunks that no worker is idle for long."""
    mean = max(1.0, sum(steps) / len(steps))
    return max(1, min(_LARGEST_CHUNK, round(_CHUNK_STEPS / mean), left // 16))


def estimate(sweep: Sweep, threads: int) -> tuple[int, float]:
    """MuJoCo steps of a whole sweep, and the seconds that they will take on ``threads`` cores, from one timed
    simulation.
    """
    steps = [step_count(sweep, i) for i in range(len(sweep.tests))]
    shortest = min(range(len(steps)), key=steps.__getitem__)
    workshop, job = Workshop(sweep.recipe, sweep.every), sweep.job(0, shortest)
    with callback.installed():
        workshop.run(job)
        begun = time.monotonic()
        workshop.run(job)
        spent = time.monotonic() - begun
    total = sum(steps) * sweep.runs
    return total, spent / steps[shortest] * total / threads
