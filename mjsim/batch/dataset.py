"""The folder of a sweep: shards that appear whole, what is done already, and one data set at the end.

    DIR/sweep.json                     description
    DIR/results/part-s000001.parquet   shards of an unfinished sweep: whole or not there, no run twice
    DIR/results/part-00000.parquet     the finished data set
    DIR/traces/                        likewise, where traces are asked for
    DIR/.lock                          empty; held by the process that writes

A process that is killed leaves nothing else behind than hidden temporary files, which the next one takes away. A shard
of traces is written before its shard of results, so a run with results has its trace.
"""

from __future__ import annotations

import io
import json
import os
import re
from pathlib import Path

import numpy as np

from mjsim.batch.arrow import integers, lists, numbers, pa, pq, texts
from mjsim.batch.describe import describe, difference, result_columns, schema, trace_columns
from mjsim.batch.sweep import Sweep
from mjsim.batch.workshop import Outcome
from mjsim.errors import InputError
from mjsim.io.files import check_writable, locked, write_whole
from mjsim.io.inputs import file_bytes

#: Largest description, bytes, and the names of the data set's files.
_LARGEST, _NAME = 50_000_000, re.compile(r"part-s?\d{1,9}\.parquet", re.ASCII)
_SHARD, _NEW = "part-s", ".new-part-"
#: Rows of one file of the finished data set.
ROWS, TRACES = 200_000, 256


class Folder:
    """The result folder of one sweep, held by one process at a time; use it in a ``with`` block.

    Args:
        out: the folder; made when it is missing. force: forget results of another sweep (or of this one) and start
            anew.

    Raises:
        InputError: the folder holds another sweep's results, belongs to a running process, or cannot be written.
    """

    def __init__(self, sweep: Sweep, out: Path, force: bool = False) -> None:
        self.sweep, self.out, self._force = sweep, Path(out), force
        self.description = describe(sweep)
        self.results, self.traces = self.out / "results", self.out / "traces"
        self._schema = schema(result_columns(sweep), self.description)
        self._trace_schema = schema(trace_columns(), self.description)
        self._tests = [t.name for t in sweep.tests]
        self._last = 0

    def __enter__(self) -> Folder:
        check_writable(self.out / "sweep.json", force=True)
        self.check(self.sweep, self.out, self._force)
        self.out.mkdir(parents=True, exist_ok=True)
        self._lock = locked(self.out, "mjsim batch")
        if self._force:
            for folder in (self.results, self.traces):
                for file in [*folder.glob("part-*.parquet"), *folder.glob(".*part-*"), *folder.glob(".commit")]:
                    file.unlink()
        for file in self.out.glob(".sweep.json.*"):
            file.unlink()
        write_whole(
            self.out / "sweep.json", json.dumps(self.description, indent=1, ensure_ascii=False) + "\n", force=True
        )
        for folder in (self.results, *([self.traces] if self.sweep.every else [])):
            folder.mkdir(exist_ok=True)
            _recover(folder)
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    @staticmethod
    def check(sweep: Sweep, out: Path, force: bool = False) -> None:
        """Refuse a folder that holds something else's results; writes nothing.

        Raises:
            InputError: it does.
        """
        file = Path(out) / "sweep.json"
        if force:
            return
        if not os.path.lexists(file):
            for folder in ("results", "traces"):
                if any((Path(out) / folder).glob("*")):
                    raise InputError(f"{out}: has a folder {folder!r} but no sweep.json; name another folder for --out")
            return
        try:
            then = json.loads(
                file_bytes(file, _LARGEST, f"allowed: up to {_LARGEST / 1e6:.0f} MB; name another folder for --out")
            )
            changed = difference(describe(sweep), then)
        except InputError:
            raise
        except (ValueError, AttributeError, TypeError):
            raise InputError(f"{file}: is no description of a sweep; name another folder for --out") from None
        if changed:
            raise InputError(
                f"{out}: was begun with another sweep: {changed}; name another folder, or give --force to start anew"
            )

    def done(self) -> set[tuple[int, int]]:
        """(run, test) of everything that is there; shards that cannot be read (a power cut) are taken away and so
        computed again.

        Raises:
            InputError: a file has the name of one of this sweep's, and is none.
        """
        out: set[tuple[int, int]] = set()
        index = {name: i for i, name in enumerate(self._tests)}
        for file in sorted(self.results.glob("part-*.parquet")):
            foreign = InputError(f"{file}: is no file of this sweep; move it away, or name another folder for --out")
            if not _NAME.fullmatch(file.name) or not file.is_file():
                raise foreign
            try:
                keys = pq.ParquetFile(file).read(columns=["run", "test"])
            except (pa.ArrowException, OSError):
                file.unlink()
                continue
            try:
                rows = {
                    (int(r), index[t]) for r, t in zip(keys["run"].to_pylist(), keys["test"].to_pylist(), strict=True)
                }
            except (KeyError, TypeError, ValueError):
                raise foreign from None
            if not all(0 <= r < self.sweep.runs for r, _ in rows):
                raise foreign
            out |= rows
            self._last = max(self._last, _number(file))
        if self.sweep.every:
            for file in self.traces.glob(f"{_SHARD}*.parquet"):
                if not (self.results / file.name).exists():
                    file.unlink()
        return out

    def write(self, outcomes: list[Outcome]) -> None:
        """Write finished runs as one more shard."""
        if not outcomes:
            return
        self._last += 1
        name = f"{_SHARD}{self._last:06d}.parquet"
        if self.sweep.every:
            _write(self.traces / name, self._trace_table(outcomes))
        _write(self.results / name, self._table(outcomes))

    def _table(self, outcomes: list[Outcome]) -> pa.Table:
        parameters = np.array([self.sweep.parameters(o.run) for o in outcomes]).reshape(len(outcomes), -1)
        figures = np.array([o.figures for o in outcomes]).reshape(len(outcomes), -1)
        of_run = [numbers(p) for p in (*parameters.T, [o.duration for o in outcomes], *figures.T)]
        return pa.table([*self._keys(outcomes), *of_run, texts([o.error for o in outcomes])], schema=self._schema)

    def _trace_table(self, outcomes: list[Outcome]) -> pa.Table:
        traces = [lists([None if o.trace is None else o.trace[i] for o in outcomes]) for i in range(3)]
        return pa.table([*self._keys(outcomes), *traces], schema=self._trace_schema)

    def _keys(self, outcomes: list[Outcome]) -> list[pa.Array]:
        return [integers([o.run for o in outcomes]), texts([self._tests[o.test] for o in outcomes])]

    def finish(self) -> None:
        """Make one data set of all shards: results in the order of runs, traces in the order of tests."""
        if self.sweep.every:
            _consolidate(self.traces, self._trace_schema, self._tests, ("test", "run"), TRACES)
        _consolidate(self.results, self._schema, self._tests, ("run", "test"), ROWS)


def _number(file: Path) -> int:
    """Number of a shard; 0 for a file of a finished data set."""
    return int(file.stem.removeprefix(_SHARD)) if file.name.startswith(_SHARD) else 0


def _write(path: Path, table: pa.Table) -> None:
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    write_whole(path, buffer.getvalue(), force=True)


def _consolidate(folder: Path, wanted: pa.Schema, tests: list[str], order: tuple[str, str], rows: int) -> None:
    """Rewrite the shards of a folder as files of ``rows`` rows in order.

    The new files are hidden until all are there; from the commit mark on, a killed process' successor ends the work. At
    no time has the folder a run twice.
    """
    shards = sorted(folder.glob(f"{_SHARD}*.parquet"))
    if not shards:
        return
    files = [*shards, *(f for f in sorted(folder.glob("part-*.parquet")) if f not in shards)]
    keys = [pq.ParquetFile(f).read(columns=["run", "test"]) for f in files]
    run = np.array([r for k in keys for r in k["run"].to_pylist()], int)
    rank = {name: i for i, name in enumerate(tests)}
    test = np.array([rank[t] for k in keys for t in k["test"].to_pylist()], int)
    source = np.repeat(np.arange(len(files)), [len(k) for k in keys])
    row = np.concatenate([np.arange(len(k)) for k in keys])
    by = {"run": run, "test": test}
    sequence = np.lexsort([by[order[1]], by[order[0]]])
    twice = (np.diff(run[sequence]) == 0) & (
        np.diff(test[sequence]) == 0
    )  # only where a shard was lost and computed again
    sequence = sequence[np.concatenate([[True], ~twice])]
    for part, begin in enumerate(range(0, len(sequence), rows)):
        chosen = sequence[begin : begin + rows]
        _write(folder / f"{_NEW}{part:05d}.parquet", _gather(files, source[chosen], row[chosen]).cast(wanted))
    write_whole(folder / ".commit", "", force=True)
    _recover(folder)


def _gather(files: list[Path], source: np.ndarray, row: np.ndarray) -> pa.Table:
    """Row ``row[i]`` of file ``source[i]``, for every i, in that order."""
    used = np.unique(source)
    tables = [pq.ParquetFile(files[f]).read().take(integers(row[source == f])) for f in used]
    place = np.argsort(np.concatenate([np.flatnonzero(source == f) for f in used]))
    return pa.concat_tables(tables).take(integers(place))


def _recover(folder: Path) -> None:
    """End or undo what a killed process began, and take its temporary files away."""
    commit = folder / ".commit"
    if commit.exists():
        new = sorted(folder.glob(f"{_NEW}*.parquet"))
        for file in folder.glob(f"{_SHARD}*.parquet"):
            file.unlink()
        for file in new:
            os.replace(file, folder / file.name.removeprefix(".new-"))
        commit.unlink()
    for file in [*folder.glob(".*part-*"), *folder.glob("..commit*")]:
        file.unlink()
