"""``mjsim batch`` as a function: run a sweep, or go on with it."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjsim.batch.dataset import Folder, opened
from mjsim.batch.scheduler import crew_of, work_off
from mjsim.batch.simulate import Outcome, Simulator, packed, run_elsewhere
from mjsim.batch.sweep import Job, Sweep, read_sweep
from mjsim.batch.tables import pq, versions
from mjsim.instruments.ball_bar.program import Program
from mjsim.progress import Progress, silent
from mjsim.simulation import callback
from mjsim.simulation.axes import TAIL
from mjsim.simulation.drive import STEP
from mjsim.threads import one_blas_thread

if TYPE_CHECKING:
    import pandas as pd

#: Finished runs are written after this time, s, and writing takes at most this share of the time.
FLUSH_S, FLUSH_SHARE = 1.0, 0.02


@dataclass(frozen=True)
class BatchResult:
    """A finished sweep.

    Attributes:
        name: Of the sweep.
        out: Its folder.
        runs: Their number.
        tests: Their number.
        simulated: Simulations of this call; the others were there already.
        failed: Simulations without figures.
        seconds: Time of this call.
        steps: MuJoCo steps of this call.
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


@one_blas_thread
def batch(
    sweep: str | Path | Sweep,
    out: str | Path,
    threads: int = 2,
    scheduler: str | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> BatchResult:
    """Run a sweep, or go on where a former call was stopped: what is in ``out`` already is not simulated again.

    Args:
        sweep: A sweep file, or what :func:`mjsim.batch.sweep.read_sweep` makes of it.
        out: Folder of the results.
        threads: Runs side by side on this machine.
        scheduler: Address of a Dask scheduler whose workers do the runs instead.
        force: Start anew even if ``out`` holds results.
        progress: Called after each run. What was there already counts as done, and a long test for more than a short
            one, so that the time left is right.

    Raises:
        InputError: The sweep file or what it names is wrong, ``out`` holds another sweep, or the cluster cannot be
            used.
        SimulationError: The cluster has lost a run for good.
        KeyboardInterrupt: The user stopped it; finished runs are in ``out``.
    """
    sweep, out, begun = sweep if isinstance(sweep, Sweep) else read_sweep(sweep), Path(out), time.monotonic()
    with (
        crew_of(ThreadPoolExecutor(threads), threads, scheduler) as crew,
        opened(sweep, out, force) as folder,
        callback.installed(),
    ):
        writer = _Writer(sweep, folder, progress)
        simulator = Simulator(sweep)
        shared: Any = crew.share(packed(sweep)) if crew.is_cluster else None

        def submit(job: Job) -> Future[Outcome]:
            if crew.is_cluster:
                return crew.executor.submit(run_elsewhere, shared, versions(), job)
            return crew.executor.submit(simulator.run, job)

        try:
            work_off(crew, writer.left, submit, lambda _, future: writer.take(crew.result(future)))
        finally:
            writer.write()
    errors = [pq.ParquetFile(f).read(columns=["error"])["error"] for f in out.glob("results/part-*")]
    failed = sum(len(e) - e.null_count for e in errors)
    seconds = time.monotonic() - begun
    return BatchResult(sweep.name, out, sweep.runs, len(sweep.tests), writer.simulated, failed, seconds, writer.stepped)


class _Writer:
    """Writes outcomes from time to time, and tells how far the sweep is."""

    def __init__(self, sweep: Sweep, folder: Folder, progress: Progress) -> None:
        self._folder, self._progress, self._steps = folder, progress, step_counts(sweep)
        self._total, self._all_steps = sweep.runs * len(sweep.tests), sweep.runs * sum(self._steps)
        done = folder.done()
        self.left = (job for job in sweep.jobs() if job not in done)
        self.simulated = self.stepped = 0
        self._before = sum(self._steps[job.test] for job in done)
        self._kept: list[Outcome] = []
        self._due = time.monotonic() + FLUSH_S
        self._tell()

    def take(self, outcome: Outcome) -> None:
        """Take what came out of a job."""
        self._kept.append(outcome)
        self.simulated += 1
        self.stepped += self._steps[outcome.job.test]
        if time.monotonic() >= self._due:
            self.write()
        self._tell()

    def write(self) -> None:
        """Write what has come since the last time."""
        begun, kept, self._kept = time.monotonic(), self._kept, []
        self._folder.write(kept)
        now = time.monotonic()
        self._due = now + max(FLUSH_S, (now - begun) / FLUSH_SHARE)

    def _tell(self) -> None:
        share = (self._before + self.stepped) / self._all_steps
        self._progress("simulating", round(self._total * share), self._total)


def step_counts(sweep: Sweep) -> list[int]:
    """MuJoCo steps of each test, as it is in the middle run where runs differ."""
    programs = (Program(sweep.test_of(Job(sweep.runs // 2, test))) for test in range(len(sweep.tests)))
    return [int((program.duration + TAIL) / STEP) for program in programs]


def estimate(sweep: Sweep, threads: int) -> tuple[int, float]:
    """MuJoCo steps of a whole sweep, and the seconds that they will take on ``threads`` cores, from one timed
    simulation.
    """
    steps = step_counts(sweep)
    shortest = min(range(len(steps)), key=steps.__getitem__)
    simulator, job = Simulator(sweep), Job(0, shortest)
    with callback.installed():
        simulator.run(job)
        begun = time.monotonic()
        simulator.run(job)
        spent = time.monotonic() - begun
    total = sum(steps) * sweep.runs
    return total, spent / steps[shortest] * total / threads
