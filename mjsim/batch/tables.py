"""Result tables in Parquet, with unit and meaning of every column inside; and the versions that results depend on."""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

import mjsim
from mjsim.batch.sweep import Job
from mjsim.errors import InputError
from mjsim.io.extras import need
from mjsim.io.files import locked, write_whole
from mjsim.io.resources import model_file

need("batch", "batch", "pyarrow", "pandas")

import pyarrow as pa  # noqa: E402
import pyarrow.parquet as pq  # noqa: E402

#: Columns of a table: name -> type, unit, meaning.
Columns = dict[str, tuple[pa.DataType, str, str]]
TEXT, NUMBER, WHOLE, TRUTH, NUMBERS = pa.string(), pa.float64(), pa.int64(), pa.bool_(), pa.list_(pa.float64())
#: Names of the files of a table that grows.
_NAME = re.compile(r"part-\d{5}\.parquet", re.ASCII)


@cache
def versions() -> dict[str, str]:
    """What a result depends on beside its input: versions, and the SHA-256 of the machine's model with its solids."""
    folder, digest = model_file().parent, hashlib.sha256()
    for file in sorted(p for p in folder.rglob("*") if p.suffix in (".xml", ".stl")):
        digest.update(f"{file.relative_to(folder).as_posix()}\0".encode() + file.read_bytes())
    return {
        "mjsim": mjsim.__version__,
        "mujoco": mujoco.__version__,
        "numpy": np.__version__,
        "model": digest.hexdigest(),
    }


def check_versions(worker: str, wanted: dict[str, str], found: dict[str, str] | None = None) -> None:
    """Refuse a worker whose results would differ.

    Args:
        worker: Who it is.
        wanted: :func:`versions` where the results go.
        found: Those of the worker; of this computer where it is left out.

    Raises:
        InputError: It has others.
    """
    found = versions() if found is None else found
    for what in wanted:
        if found.get(what) != wanted[what]:
            raise InputError(
                f"worker {worker} has {what} {str(found.get(what))[:12]}, this machine {wanted[what][:12]}; "
                "allowed: the same on all, results would differ"
            )


def schema(columns: Columns, name: str, about: dict) -> pa.Schema:
    """The Parquet schema of some columns, with units and meanings inside, and ``about`` as JSON under ``name``."""
    fields = [pa.field(k, kind, metadata={"unit": u, "meaning": m}) for k, (kind, u, m) in columns.items()]
    return pa.schema(fields, metadata={name: json.dumps(about, ensure_ascii=False)})


def write_table(file: Path, table: pa.Table) -> None:
    """Write a Parquet file, whole or not at all."""
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    write_whole(file, buffer.getvalue(), force=True)


@contextmanager
def held(folder: Path, command: str, *strays: str) -> Iterator[None]:
    """A folder of results, held by one process at a time.

    Args:
        folder: Made when it is missing.
        command: What writes there, for the message.
        strays: Patterns of what a killed process may have left half-written; it is taken away.

    Raises:
        InputError: Another process holds it, or it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = locked(folder, command)
    try:
        for file in (f for pattern in strays for f in folder.glob(pattern)):
            file.unlink()
        yield
    finally:
        lock.release()


class Table:
    """A table that grows, in Parquet files of so many rows each.

    Every file is whole and in order at any time: new rows are merged into it, and it is replaced. So an unfinished
    table can be read like a finished one, and the order in which rows come changes nothing.

    Args:
        folder: Of its files.
        schema: Its columns; the first two are a run and the name of a test.
        rows: Of one file.
        places: (runs, tests) which row of the whole table a simulation is.
        tests: Names of the tests.
    """

    def __init__(self, folder: Path, schema: pa.Schema, rows: int, places: np.ndarray, tests: Sequence[str]) -> None:
        self._folder, self._schema, self._rows, self._places = folder, schema, rows, places
        self._tests = {name: i for i, name in enumerate(tests)}

    def _keys(self, table: pa.Table) -> tuple[list[int], list[int]]:
        """Runs and tests of some rows."""
        runs, tests = (table[name].to_pylist() for name in self._schema.names[:2])
        return runs, [self._tests[name] for name in tests]

    def add(self, columns: Sequence[Sequence]) -> None:
        """Write rows; one that is there already is replaced."""
        arrays = [pa.array(c, kind, from_pandas=True) for c, kind in zip(columns, self._schema.types, strict=True)]
        new = pa.table(arrays, schema=self._schema)
        part_of = self._places[self._keys(new)] // self._rows
        for part in np.unique(part_of):
            file = self._folder / f"part-{part:05d}.parquet"
            table = new.filter(pa.array(part_of == part))
            if file.exists():
                table = pa.concat_tables([table, pq.ParquetFile(file).read().cast(self._schema)])
            first = np.unique(self._places[self._keys(table)], return_index=True)[1]  # in order, each once
            write_table(file, table.take(pa.array(first)).combine_chunks())

    def jobs(self) -> set[Job]:
        """What is there; a file that cannot be read (a power cut) is taken away, and so computed again.

        Raises:
            InputError: A file has the name of one of this table's, and is none.
        """
        out: set[Job] = set()
        for file in sorted(self._folder.glob("part-*.parquet")):
            foreign = InputError(f"{file}: is no file of this sweep; move it away, or name another folder for --out")
            if not _NAME.fullmatch(file.name) or not file.is_file():
                raise foreign
            try:
                table = pq.ParquetFile(file).read(columns=self._schema.names[:2])
            except (pa.ArrowException, OSError):
                file.unlink()
                continue
            try:
                runs, tests = self._keys(table)
                if not all(0 <= run < len(self._places) for run in runs):
                    raise foreign
            except (KeyError, TypeError):
                raise foreign from None
            out.update(map(Job, runs, tests))
        return out
