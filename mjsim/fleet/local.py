"""The campaigns of a fleet on the cores of this machine: one process a core, so that a crash costs one campaign."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from typing import IO

from mjsim.batch.local import Crew
from mjsim.errors import SimulationError, shortened
from mjsim.fleet.jobs import Job, Options

#: Seconds after which a campaign is given up.
TIME_LIMIT_S = 3600.0
_ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}


def run_local(
    jobs: Sequence[Job],
    options: Options,
    cores: int,
    deliver: Callable[[Job, dict], None],
    time_limit: float = TIME_LIMIT_S,
) -> None:
    """Diagnose all campaigns; ``deliver`` gets each result as it comes, in the calling thread.

    Args:
        jobs: The campaigns.
        options: How they are diagnosed.
        cores: Processes side by side.
        deliver: Told of each result.
        time_limit: Seconds after which a campaign is given up.
    """
    processes = [_Process(options, time_limit) for _ in range(min(cores, len(jobs)))]
    crew = Crew(jobs, [p.diagnose for p in processes])
    try:
        for job, row in crew:
            deliver(job, row)
    finally:
        crew.stop()
        for process in processes:
            process.end()
        crew.late()
        for process in processes:  # one that was begun meanwhile
            process.end()


class _Process:
    """A process that diagnoses one campaign after another; begun again where it dies."""

    def __init__(self, options: Options, time_limit: float) -> None:
        self._options, self._limit = options, time_limit
        self._process: subprocess.Popen[str] | None = None
        self._errors: IO[str] | None = None

    def diagnose(self, job: Job) -> tuple[Job, dict]:
        """A campaign with its result; that the process has died is one as well."""
        process = self._process or self._begin()
        order = json.dumps({"folder": str(job.folder), "options": vars(self._options)})
        assert process.stdin and process.stdout
        row: dict = {"folder": str(job.folder), "campaign": job.folder.name, "machine": "", "seconds": None}
        late = threading.Event()

        def stop() -> None:  # a pipe has no time limit on Windows, a process can be ended everywhere
            late.set()
            process.kill()

        alarm = threading.Timer(self._limit, stop)
        alarm.daemon = True
        alarm.start()
        try:
            process.stdin.write(order + "\n")
            process.stdin.flush()
            line = process.stdout.readline()
        except (OSError, ValueError):  # its input is closed: it has died; Windows has another error for that
            line = ""
        finally:
            alarm.cancel()
        if line and not late.is_set():
            return job, json.loads(line)
        status = process.wait()
        self._process = None
        if late.is_set():
            return job, row | {"error": f"stopped after {self._limit:g} s, the limit for one campaign"}
        if status < 0:
            why = f"signal {signal.Signals(-status).name}; not enough memory is the usual reason"
        else:
            why = f"status {status}: {self._last_words()}"
        return job, row | {"error": shortened(f"its process ended with {why}", 400)}

    def _last_words(self) -> str:
        """The last line that the process wrote about its end."""
        if self._errors is None:
            return ""
        self._errors.seek(0)
        return next((line for line in reversed(self._errors.read().splitlines()) if line.strip()), "no message")

    def _begin(self) -> subprocess.Popen[str]:
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "mjsim.fleet.one"],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors,
                text=True, encoding="utf-8", env={**os.environ, **_ONE_THREAD},
                start_new_session=True, creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
            )  # fmt: skip
        except OSError as error:
            raise SimulationError(f"no process for a campaign could be started: {error.strerror or error}") from None
        return self._process

    def end(self) -> None:
        """End the process, whatever it does."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
