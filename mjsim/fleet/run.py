"""``mjsim fleet`` as a function: diagnose many campaigns, or go on with it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mjsim.fleet import page, tables
from mjsim.fleet.jobs import Job, Options, campaigns_in, job_of
from mjsim.fleet.local import TIME_LIMIT_S, run_local
from mjsim.io.files import check_writable, locked, write_whole
from mjsim.io.inputs import file_bytes
from mjsim.progress import Progress, silent
from mjsim.report.write import need_report

if TYPE_CHECKING:
    import pandas as pd

_LARGEST = 50_000_000
_PAGE, _RESULTS = "fleet.html", "diagnoses"


@dataclass(frozen=True)
class FleetResult:
    """The diagnoses of a fleet.

    Attributes:
        out: Folder of the results.
        campaigns: One entry for each campaign, as plain data.
        diagnosed: Campaigns of this call; the others were there already.
        failed: Campaigns without a diagnosis.
        seconds: Time of this call.
        files: The tables and the page.
    """

    out: Path
    campaigns: tuple[dict, ...]
    diagnosed: int
    failed: int
    seconds: float
    files: tuple[Path, ...]

    def to_dataframe(self, table: str = "findings") -> pd.DataFrame:
        """One table: ``campaigns``, ``findings`` or ``calibration``."""
        import pandas as pd

        return pd.read_parquet(self.out / f"{table}.parquet")

    def to_json(self) -> dict:
        """What ``mjsim fleet --json`` prints."""
        return {
            "out": str(self.out),
            "campaigns": len(self.campaigns),
            "diagnosed": self.diagnosed,
            "failed": self.failed,
            "seconds": round(self.seconds, 2),
            "files": [str(f) for f in self.files],
            "results": [
                {
                    "folder": c["folder"],
                    "machine": c.get("machine"),
                    "date": c.get("date"),
                    "verdict": c.get("verdict"),
                    "findings": list(dict.fromkeys(f["effect"] for f in c.get("findings", ()))),
                    "error": c.get("error"),
                }
                for c in self.campaigns
            ],
        }


def fleet(
    folders: Sequence[str | Path] | str | Path,
    out: str | Path,
    cores: int = 2,
    scheduler: str | None = None,
    max_effects: int | None = None,
    as_is: bool = False,
    time_limit: float = TIME_LIMIT_S,
    progress: Progress = silent,
) -> FleetResult:
    """Diagnose many campaigns, or go on where a former call was stopped.

    A campaign whose files, options and version of mjsim are those of a result in ``out`` is not diagnosed again. One
    that failed is.

    Args:
        folders: Campaigns, or folders with campaigns below them.
        out: Folder of the results.
        cores: Campaigns side by side on this machine.
        scheduler: Address of a Dask scheduler whose workers diagnose instead.
        max_effects: At most so many missing effects are looked for in each; without it as many as the data prove.
        as_is: Do not look for wrong units, signs or directions first.
        time_limit: Seconds after which a campaign is given up, on this machine.
        progress: Called after each campaign.

    Raises:
        InputError: A folder has no campaign, ``out`` cannot be written or is used by another process, or the cluster
            cannot be used.
        KeyboardInterrupt: The user stopped it; finished diagnoses are in ``out``.
    """
    need_report()
    out, begun = Path(out), time.monotonic()
    options = Options(max_effects, as_is)
    given = [folders] if isinstance(folders, (str, Path)) else list(folders)
    check_writable(out / _PAGE, force=True)
    jobs = [job_of(folder, options) for folder in campaigns_in([Path(f) for f in given])]
    with _held(out):
        done = {job.key: row for job in jobs if (row := _known(out, job)) is not None}
        todo = [job for job in jobs if job.key not in done]
        before = len(jobs) - len(todo)
        progress("diagnosing", before, len(jobs))

        def deliver(job: Job, row: dict) -> None:
            done[job.key] = row
            write_whole(_file(out, job), json.dumps(row, ensure_ascii=False, indent=1) + "\n", force=True)
            progress("diagnosing", before + sum(j.key in done for j in todo), len(jobs))

        if todo:
            _run(todo, options, cores, scheduler, time_limit, deliver)
        rows = [{**done[job.key], "folder": str(job.folder)} for job in jobs]
        files = tables.write(out, rows)
        progress("writing the page", 0, 1)
        write_whole(out / _PAGE, page.render(rows), force=True)
    failed = sum(row.get("error") is not None for row in rows)
    return FleetResult(out, tuple(rows), len(todo), failed, time.monotonic() - begun, (*files, out / _PAGE))


def _run(
    todo: Sequence[Job],
    options: Options,
    cores: int,
    scheduler: str | None,
    time_limit: float,
    deliver: Callable[[Job, dict], None],
) -> None:
    if scheduler is None:
        run_local(todo, options, cores, deliver, time_limit)
        return
    from mjsim.batch.cluster import connected
    from mjsim.fleet.cluster import run_on_cluster

    with connected(scheduler) as client:
        run_on_cluster(client, todo, options, deliver)


def _file(out: Path, job: Job) -> Path:
    return out / _RESULTS / f"{job.key}.json"


def _known(out: Path, job: Job) -> dict | None:
    """The result of an earlier call, unless it is missing, damaged or a failure."""
    file = _file(out, job)
    if not file.is_file():
        return None
    try:
        row = json.loads(file_bytes(file, _LARGEST, f"allowed: up to {_LARGEST / 1e6:.0f} MB; move it away"))
    except ValueError:
        return None
    return row if isinstance(row, dict) and row.get("error") is None and "verdict" in row else None


@contextmanager
def _held(out: Path) -> Iterator[None]:
    """The folder of the results, held by one process at a time."""
    (out / _RESULTS).mkdir(parents=True, exist_ok=True)
    lock = locked(out, "mjsim fleet")
    try:
        for stray in (out / _RESULTS).glob(".*.json.*"):
            stray.unlink()
        yield
    finally:
        lock.release()
