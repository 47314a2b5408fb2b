"""``mjsim fleet`` as a function: diagnose many campaigns, or go on with it.

The result are three tables: campaigns, findings, calibrated numbers; and a page with the trend of every machine. Each
core has a process of its own, so that a crash costs one campaign.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mjsim.batch import diagnoses, fleet_page
from mjsim.batch.diagnoses import Job, Options, campaigns_in, diagnosed_elsewhere, files_of, job_of
from mjsim.batch.scheduler import Processes, crew_of, work_off
from mjsim.batch.tables import NUMBER, TEXT, TRUTH, WHOLE, Columns, held, pa, schema, versions, write_table
from mjsim.errors import SimulationError
from mjsim.io.files import check_writable, write_whole
from mjsim.io.inputs import file_bytes
from mjsim.progress import Progress, silent
from mjsim.report.write import need_report

if TYPE_CHECKING:
    import pandas as pd

#: Seconds after which a campaign is given up.
TIME_LIMIT_S = 3600.0
_LARGEST = 50_000_000
_PAGE, _RESULTS = "fleet.html", "diagnoses"
#: Columns that all tables begin with: type, unit, meaning.
_WHOSE = {
    "machine": (TEXT, "", "name in machine.toml"),
    "configuration": (TEXT, "", "of the axes"),
    "campaign": (TEXT, "", "name in campaign.toml"),
    "date": (TEXT, "", "day of measuring, ISO 8601; null where campaign.toml has none"),
    "folder": (TEXT, "", "of the campaign"),
}
_SIZE = {
    "effect": (TEXT, "", "key of the effect, such as backlash.A"),
    "number": (TEXT, "", "which size of the effect: a parameter, or a wave such as order 60 (its amplitude)"),
    "unit": (TEXT, "", "of value, low, high, expected and limit"),
    "value": (NUMBER, "see unit", "estimate"),
    "low": (NUMBER, "see unit", "lower end of its 95 % interval"),
    "high": (NUMBER, "see unit", "upper end of its 95 % interval"),
    "expected": (NUMBER, "see unit", "value in the machine file, or neutral; null without a tolerance"),
    "limit": (NUMBER, "see unit", "tolerance; null without one"),
}
#: Table -> its columns.
TABLES: dict[str, Columns] = {
    "campaigns": {
        **_WHOSE,
        "tests": (WHOLE, "", "measured tests"),
        "verdict": (TEXT, "", "identified, ambiguous, unknown or nothing_found; null where the diagnosis failed"),
        "unexplained": (TEXT, "", "what is left that no effect of the catalogue explains"),
        "noise_um": (NUMBER, "µm", "RMS of the noise of one sample"),
        "rms_before_um": (NUMBER, "µm", "RMS residual of the machine as given"),
        "rms_after_um": (NUMBER, "µm", "RMS residual of the final model"),
        "seconds": (NUMBER, "s", "time of the diagnosis"),
        "error": (TEXT, "", "why there is no diagnosis; null where there is one"),
    },
    "findings": {
        **_WHOSE,
        **_SIZE,
        "share": (NUMBER, "", "share of the whole effect in the explained squared error, 0 to 1"),
        "alternatives": (TEXT, "", "effects that the tests cannot tell from it, with a comma between them"),
    },
    "calibration": {
        **_WHOSE,
        **_SIZE,
        "used_percent": (NUMBER, "%", "departure from expected over limit"),
        "observable": (TRUTH, "", "whether the tests say more about it than the tolerance does"),
        "rms_um": (NUMBER, "µm", "RMS over all tests of what the effect changes once the set-up is fitted"),
    },
}


def rows_of(table: str, campaigns: Iterable[dict]) -> list[dict]:
    """Rows of one table from the results of the campaigns."""
    out = []
    for c in campaigns:
        whose = {name: c.get(name) for name in _WHOSE}
        if table == "campaigns":
            out.append({name: c.get(name) for name in TABLES[table]})
            continue
        for row in c.get(table, ()):
            row = {**whose, **row}
            if "alternatives" in row:
                row["alternatives"] = ", ".join(row["alternatives"])
            out.append({name: row.get(name) for name in TABLES[table]})
    return out


def write_tables(folder: Path, campaigns: Sequence[dict]) -> list[Path]:
    """Write all tables as Parquet files into ``folder``."""
    files = []
    for name, columns in TABLES.items():
        made = schema(columns, "mjsim.fleet", {"versions": versions()})
        files.append(folder / f"{name}.parquet")
        write_table(files[-1], pa.Table.from_pylist(rows_of(name, campaigns), schema=made))
    return files


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
    with held(out, "mjsim fleet", f"{_RESULTS}/.*.json.*"):
        done = {job.key: row for job in jobs if (row := _known(out, job)) is not None}
        todo = [job for job in jobs if job.key not in done]
        progress("diagnosing", len(jobs) - len(todo), len(jobs))

        if todo:
            count = min(cores, len(todo))
            here = Processes(count, diagnoses.__name__, time_limit)
            with crew_of(here, count, scheduler) as crew:

                def submit(job: Job) -> Future[dict]:
                    if crew.is_cluster:
                        return crew.executor.submit(diagnosed_elsewhere, files_of(job.folder), options)
                    return here.submit(here.ask, {"folder": str(job.folder), "options": vars(options)})

                def deliver(job: Job, future: Future[dict]) -> None:
                    try:
                        found = crew.result(future)
                    except SimulationError as error:  # a process or a worker was lost
                        found = {"error": str(error), "seconds": None}
                    done[job.key] = row = {"campaign": job.folder.name, "machine": "", **found}
                    write_whole(_file(out, job), json.dumps(row, ensure_ascii=False, indent=1) + "\n", force=True)
                    progress("diagnosing", sum(j.key in done for j in jobs), len(jobs))

                work_off(crew, todo, submit, deliver)
        rows = [{**done[job.key], "folder": str(job.folder)} for job in jobs]
        files = write_tables(out, rows)
        progress("writing the page", 0, 1)
        write_whole(out / _PAGE, fleet_page.render(rows), force=True)
    failed = sum(row.get("error") is not None for row in rows)
    return FleetResult(out, tuple(rows), len(todo), failed, time.monotonic() - begun, (*files, out / _PAGE))


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
