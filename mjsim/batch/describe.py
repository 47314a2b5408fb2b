"""The description of a sweep's results: what every column means, and everything that the numbers depend on."""

from __future__ import annotations

import hashlib
import json
from functools import cache

import mujoco
import numpy as np

import mjsim
from mjsim.batch.arrow import pa
from mjsim.batch.sweep import Sweep
from mjsim.instruments.ball_bar.files import test_table
from mjsim.io.resources import model_file

#: Columns of the results beside the run's parameters -> type, unit, meaning.
RESULT_COLUMNS = {
    "duration_s": (pa.float64(), "s", "duration of the test's program, rest to rest"),
    "circular_error_um": (
        pa.float64(),
        "µm",
        "circular error G (ISO 230-4), about the least-squares centre; null for arcs",
    ),
    "radial_max_um": (
        pa.float64(),
        "µm",
        "largest radial error Fmax (ISO 230-4), outward positive; null for arcs",
    ),
    "radial_min_um": (pa.float64(), "µm", "smallest radial error Fmin (ISO 230-4); null for arcs"),
    "centre_phi0_um": (pa.float64(), "µm", "least-squares centre that was taken out, along φ = 0; null for arcs"),
    "centre_phi90_um": (pa.float64(), "µm", "least-squares centre that was taken out, along φ = 90°; null for arcs"),
    "rms_um": (pa.float64(), "µm", "root mean square of the reading over the measured part, nothing taken out"),
    "max_um": (pa.float64(), "µm", "largest reading over the measured part, bar longer positive"),
    "min_um": (pa.float64(), "µm", "smallest reading over the measured part"),
    "error": (pa.string(), "", "why the run has no figures; null where it has"),
}
_LIST = pa.list_(pa.float64())
#: Columns of the traces beside run and test.
TRACE_COLUMNS = {
    "time_s": (_LIST, "s", "time from the program's start"),
    "phi_deg": (_LIST, "°", "signed angle φ of the test; the axis' command in rotary tests"),
    "deviation_um": (_LIST, "µm", "change of the bar's length, outward positive"),
}
_KEYS = {"run": (pa.int64(), "", "run, counted from 0"), "test": (pa.string(), "", "name of the test")}


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


def describe(sweep: Sweep) -> dict:
    """``sweep.json``: the sweep with its text, inputs, versions, seed, and every column's unit and meaning."""
    shown = lambda columns: {k: {"unit": u, "meaning": m} for k, (_, u, m) in columns.items()}  # noqa: E731
    return {
        "name": sweep.name,
        "design": sweep.data.get("design", "grid"),
        "seed": sweep.data.get("seed", 0),
        "runs": sweep.runs,
        "tests": [test_table(t) for t in sweep.tests],
        "machine": sweep.recipe.base.name,
        "inputs_sha256": sweep.inputs,
        "versions": versions(),
        "columns": shown(result_columns(sweep)),
        "trace_columns": shown({**_KEYS, **TRACE_COLUMNS}) if sweep.every else {},
        "sweep": sweep.data,
        "text": sweep.text,
    }


def result_columns(sweep: Sweep) -> dict[str, tuple]:
    """Columns of the results: type, unit, meaning."""
    return {**_KEYS, **{t.name: (pa.float64(), t.unit, t.meaning) for t in sweep.columns}, **RESULT_COLUMNS}


def schema(columns: dict[str, tuple], description: dict) -> pa.Schema:
    """The Parquet schema of some columns, with units, meanings and the whole description inside."""
    fields = [
        pa.field(k, kind, metadata={"unit": unit, "meaning": meaning}) for k, (kind, unit, meaning) in columns.items()
    ]
    return pa.schema(fields, metadata={"mjsim.sweep": json.dumps(description, ensure_ascii=False)})


def trace_columns() -> dict[str, tuple]:
    """Columns of the traces: type, unit, meaning."""
    return {**_KEYS, **TRACE_COLUMNS}


def difference(now: dict, then: dict) -> str | None:
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
