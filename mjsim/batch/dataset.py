"""The folder of a sweep, and the description of what is in it.

    DIR/sweep.json                    description
    DIR/results/part-00000.parquet    one row a simulation
    DIR/traces/part-00000.parquet     likewise, where traces are asked for
    DIR/.lock                         empty; held by the process that writes

Traces are written before results, so a run with results has its trace. A process that is killed leaves nothing else
behind than hidden temporary files, which the next one takes away.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from mjsim.batch.simulate import Outcome
from mjsim.batch.sweep import Job, Sweep
from mjsim.batch.tables import NUMBER, NUMBERS, TEXT, WHOLE, Columns, Table, held, schema, versions
from mjsim.errors import InputError
from mjsim.instruments.base import table_of
from mjsim.io.files import check_writable, write_whole
from mjsim.io.inputs import file_bytes

_KEYS: Columns = {"run": (WHOLE, "", "run, counted from 0"), "test": (TEXT, "", "name of the test")}
#: Columns of the results of a sweep beside the run's parameters.
RESULT_COLUMNS: Columns = {
    "duration_s": (NUMBER, "s", "duration of the test's program, rest to rest"),
    "circular_error_um": (
        NUMBER,
        "µm",
        "circular error G (ISO 230-4), about the least-squares centre; null for arcs",
    ),
    "radial_max_um": (NUMBER, "µm", "largest radial error Fmax (ISO 230-4), outward positive; null for arcs"),
    "radial_min_um": (NUMBER, "µm", "smallest radial error Fmin (ISO 230-4); null for arcs"),
    "centre_phi0_um": (NUMBER, "µm", "least-squares centre that was taken out, along φ = 0; null for arcs"),
    "centre_phi90_um": (NUMBER, "µm", "least-squares centre that was taken out, along φ = 90°; null for arcs"),
    "rms_um": (NUMBER, "µm", "root mean square of the reading over the measured part, nothing taken out"),
    "max_um": (NUMBER, "µm", "largest reading over the measured part, bar longer positive"),
    "min_um": (NUMBER, "µm", "smallest reading over the measured part"),
    "error": (TEXT, "", "why the run has no figures; null where it has"),
}
#: Columns of its traces.
TRACE_COLUMNS: Columns = {
    **_KEYS,
    "time_s": (NUMBERS, "s", "time from the program's start"),
    "phi_deg": (NUMBERS, "°", "signed angle φ of the test; the axis' command in rotary tests"),
    "deviation_um": (NUMBERS, "µm", "change of the bar's length, outward positive"),
}
#: Rows of one file of the results and of the traces: some that are rewritten in a moment.
ROWS, TRACES = 4096, 64
#: Largest description, bytes.
_LARGEST = 50_000_000


def result_columns(sweep: Sweep) -> Columns:
    """Columns of the results."""
    return {**_KEYS, **{t.name: (NUMBER, t.unit, t.meaning) for t in sweep.columns}, **RESULT_COLUMNS}


def describe(sweep: Sweep) -> dict:
    """``sweep.json``: the sweep with its text, inputs, versions, seed, and every column's unit and meaning."""
    shown = lambda columns: {k: {"unit": u, "meaning": m} for k, (_, u, m) in columns.items()}  # noqa: E731
    return {
        "name": sweep.name,
        "design": sweep.data.get("design", "grid"),
        "seed": sweep.data.get("seed", 0),
        "runs": sweep.runs,
        "tests": [table_of(t) for t in sweep.tests],
        "machine": sweep.base.name,
        "inputs_sha256": sweep.inputs,
        "versions": versions(),
        "columns": shown(result_columns(sweep)),
        "trace_columns": shown(TRACE_COLUMNS) if sweep.every else {},
        "sweep": sweep.data,
        "text": sweep.text,
    }


def check_folder(sweep: Sweep, out: Path) -> None:
    """Refuse a folder that holds something else's results; writes nothing.

    Raises:
        InputError: It does.
    """
    file = Path(out) / "sweep.json"
    if not os.path.lexists(file):
        for folder in ("results", "traces"):
            if any((Path(out) / folder).glob("*")):
                raise InputError(f"{out}: has a folder {folder!r} but no sweep.json; name another folder for --out")
        return
    try:
        then = json.loads(
            file_bytes(file, _LARGEST, f"allowed: up to {_LARGEST / 1e6:.0f} MB; name another folder for --out")
        )
        changed = _difference(describe(sweep), then)
    except InputError:
        raise
    except (ValueError, AttributeError, TypeError):
        raise InputError(f"{file}: is no description of a sweep; name another folder for --out") from None
    if changed:
        raise InputError(
            f"{out}: was begun with another sweep: {changed}; name another folder, or give --force to start anew"
        )


def _difference(now: dict, then: dict) -> str | None:
    """In what a sweep differs from the one that a folder was begun with, or ``None``; comments and line breaks do
    not count.
    """
    if now["sweep"] != then.get("sweep"):
        a, b = now["sweep"], then.get("sweep") or {}
        keys = [k for k in sorted({*a, *b}) if a.get(k) != b.get(k)]
        return f"the sweep file has another {', '.join(map(repr, keys))}"
    for what in sorted({*now["inputs_sha256"], *then.get("inputs_sha256", {})}):
        if now["inputs_sha256"].get(what) != then.get("inputs_sha256", {}).get(what):
            return f"the {what} has changed"
    if now["tests"] != then.get("tests"):
        return "the campaign's tests have changed"
    for what, version in now["versions"].items():
        if version != then.get("versions", {}).get(what):
            return f"{what} is {version[:12]} now and was {str(then.get('versions', {}).get(what))[:12]}"
    return None


@contextmanager
def opened(sweep: Sweep, out: Path, force: bool = False) -> Iterator[Folder]:
    """The folder of a sweep, held by one process at a time.

    Args:
        sweep: What is run.
        out: The folder; made when it is missing.
        force: Forget results of another sweep, or of this one, and start anew.

    Raises:
        InputError: The folder holds another sweep's results, belongs to a running process, or cannot be written.
    """
    check_writable(out / "sweep.json", force=True)
    if not force:
        check_folder(sweep, out)
    with held(out, "mjsim batch", ".sweep.json.*", "results/.part-*", "traces/.part-*"):
        for file in [*out.glob("results/part-*.parquet"), *out.glob("traces/part-*.parquet")] if force else []:
            file.unlink()
        text = json.dumps(describe(sweep), indent=1, ensure_ascii=False) + "\n"
        write_whole(out / "sweep.json", text, force=True)
        yield Folder(sweep, out)


class Folder:
    """The results of one sweep.

    Args:
        sweep: What is run.
        out: Where they are.
    """

    def __init__(self, sweep: Sweep, out: Path) -> None:
        self._sweep, self._out, self._about = sweep, out, describe(sweep)
        self._names = [t.name for t in sweep.tests]
        places = np.arange(sweep.runs * len(self._names))
        by_run, by_order = places.reshape(sweep.runs, -1), np.empty((sweep.runs, len(self._names)), int)
        by_order[sweep.order] = places.reshape(-1, sweep.runs).T
        self._results = self._table("results", result_columns(sweep), ROWS, by_run)
        self._traces = self._table("traces", TRACE_COLUMNS, TRACES, by_order) if sweep.every else None

    def _table(self, name: str, columns: Columns, rows: int, places: np.ndarray) -> Table:
        return Table(self._out / name, schema(columns, "mjsim.sweep", self._about), rows, places, self._names)

    def done(self) -> set[Job]:
        """What is there.

        Raises:
            InputError: A file has the name of one of this sweep's, and is none.
        """
        return self._results.jobs()

    def write(self, outcomes: list[Outcome]) -> None:
        """Write finished runs."""
        if not outcomes:
            return
        keys = [o.job.run for o in outcomes], [self._names[o.job.test] for o in outcomes]
        if self._traces:
            traces = [[None if o.trace is None else o.trace[i] for o in outcomes] for i in range(3)]
            self._traces.add([*keys, *traces])
        parameters = np.array([self._sweep.parameters(o.job.run) for o in outcomes]).T
        figures = np.array([o.figures for o in outcomes]).T
        self._results.add([*keys, *parameters, [o.duration for o in outcomes], *figures, [o.error for o in outcomes]])
