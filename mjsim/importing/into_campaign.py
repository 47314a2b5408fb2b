"""A campaign with one more trace: its CSV, and its ``[[test]]`` table, with comments and order of campaign.toml
kept.
"""

from __future__ import annotations

import gzip
import os
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import AoT

from mjsim.campaign.files import campaign_from
from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.instruments.ball_bar.files import check_span, saturated
from mjsim.instruments.ball_bar.kinds import KINDS, all_keys
from mjsim.instruments.ball_bar.measurement import BallBarData, BallBarTest, Trace
from mjsim.io.files import check_writable, write_all
from mjsim.io.inputs import inside, is_file, shown
from mjsim.io.toml import parse, read_text
from mjsim.units import UM

# -- what the command line calls the keys of a ``[[test]]`` table ------------------------------------------------------


def options() -> dict[str, str]:
    """Key -> option, in the order of a ``[[test]]`` table: those of single kinds lie between ``kind`` and the table
    ball.
    """
    return {
        "kind": "--kind",
        **{name: keys[0].flag for name, keys in all_keys().items()},
        "table_ball_mm": "--table-ball",
        "bar_length_mm": "--length",
        "feed_mm_min": "--feed",
        "setup": "--setup",
        "started_s": "--started",
        "spindle_deg": "--spindle",
    }


_BEFORE = ("name", "trace", "setup", "started_s", "spindle_deg", "kind")
_COMMON = ("table_ball_mm", "bar_length_mm", "feed_mm_min")


def _order() -> list[str]:
    """Order of the keys in a new table."""
    return [*_BEFORE, *all_keys(), *_COMMON]


@dataclass(frozen=True)
class Entry:
    """Where a trace goes.

    Attributes:
        test: its test.
        file: the trace's file.
        added: whether campaign.toml gets a table, or a ``trace`` key, for it.
        new_test: whether it gets a table.
        text: campaign.toml as it will be.
    """

    test: BallBarTest
    file: Path
    added: bool
    new_test: bool
    text: str


def campaign_file(folder: Path) -> Path:
    """The campaign.toml of a folder, or the path itself.

    Raises:
        InputError: there is none.
    """
    file = folder / "campaign.toml" if os.path.isdir(folder) or not folder.suffix else folder
    if not is_file(file):
        raise InputError(f"{file}: no such campaign; `mjsim new campaign {folder}` starts one")
    return file


def test_name(file: Path) -> str:
    """A test's name from a file's: letters, digits and ``_ . + -``."""
    name = re.sub(r"[^A-Za-z0-9_.+-]+", "-", file.name.removesuffix(".gz").rpartition(".")[0] or file.name).strip(
        "-._+"
    )
    return name or "test"


def entry(file: Path, text: str, name: str, keys: dict, header: dict, source: Path) -> Entry:
    """Find or make the test of a trace.

    Args:
        file: campaign.toml. text: its text, with earlier imports in it. name: of the test. keys: of its table, from
            options.
        header: the same, from the measurement file ``source``.

    Raises:
        InputError: the test is not in the campaign and keys are missing, or it is and keys are given.
    """
    document = tomlkit.parse(text)
    tables = document.get("test", [])
    table = next((t for t in tables if t.get("name") == name), None)
    if table is not None:
        if keys:
            given = ", ".join(options()[k] for k in keys)
            raise InputError(
                f'{file}: [[test]] "{name}" is there already and says how it was run; leave out {given}, or give '
                f"another --test"
            )
        added = "trace" not in table
        if added:
            table["trace"] = f"traces/{name}.csv"
    else:
        added = True
        new = _complete(file, name, {**{k: v for k, v in header.items() if k in _order()}, **keys}, source)
        _append(document, new)
    out = tomlkit.dumps(document)
    if "\r\n" in text:
        out = out.replace("\r\n", "\n").replace("\n", "\r\n")
    campaign = campaign_from(file, tomllib.loads(out), traces=False)
    test = next(t for t in campaign.tests if t.name == name)
    return Entry(test, _trace_file(file, test), added, table is None, out)


def test_text(table: dict[str, Any]) -> str:
    """The table of a test for campaign.toml; lists of points in lines of eight."""
    lines = ["[[test]]"]
    for key, value in table.items():
        if isinstance(value, list) and value and isinstance(value[0], list):
            rows = [str(value[i : i + 8])[1:-1] for i in range(0, len(value), 8)]
            lines.append(f"{key} = [\n  " + ",\n  ".join(rows) + ",\n]")
        elif isinstance(value, dict):
            inline = tomlkit.inline_table()
            inline.update(value)
            lines.append(f"{key} = {inline.as_string()}")
        else:
            lines.append(tomlkit.dumps({key: value}).rstrip())
    return "\n".join(lines)


def put_test(folder: Path, table: dict[str, Any]) -> Path:
    """Write a planned test into campaign.toml, in the place of the table with its name, or behind all others.

    Args:
        folder: Of the campaign.
        table: Of the test.

    Returns:
        The file.

    Raises:
        InputError: The campaign cannot have this test, or has it with a trace.
    """
    file = campaign_file(folder)
    text = read_text(file)
    document = tomlkit.parse(text)
    old = next((t for t in document.get("test", []) if t.get("name") == table["name"]), None)
    if old is None:
        out = f"{text.rstrip()}\n\n{test_text(table)}\n"
    else:
        made: Any = tomlkit.parse(test_text(table))["test"]
        for key, value in made[0].items():
            old[key] = value
        out = f"{tomlkit.dumps(document).rstrip()}\n"
    campaign_from(file, tomllib.loads(out), traces=False)
    write_all({file: out}, force=True)
    return file


def _trace_file(file: Path, test: BallBarTest) -> Path:
    path = file.parent / (test.trace or f"traces/{test.name}.csv")
    place = f'{file}: [[test]] "{test.name}" trace = {shown(test.trace)}'
    if Path(test.trace or "").is_absolute() or not inside(file.parent, path):
        raise InputError(f"{place} leaves the campaign's folder; allowed: a path inside it")
    if path.suffix in (".toml", ".py", ".json"):
        raise InputError(f"{place} is no trace's file; allowed: a path that ends in .csv or .csv.gz")
    return path


def _complete(file: Path, name: str, keys: dict, source: Path) -> dict:
    """The keys of a new table; what is missing is asked for by its options."""
    kind = keys.get("kind")
    specific = set(keys) & set(all_keys())
    possible = [k.name for k in KINDS.values() if specific and specific <= {key.name for key in k.keys}]
    if kind is None and len(possible) == 1:  # a plane is given: a circle
        kind = keys["kind"] = possible[0]
    common = [options()[k] for k in _COMMON if k not in keys]
    if kind not in KINDS:
        needs = [
            f"--kind {k.name} ({', '.join(options()[n] for n in k.needed if n not in keys)})" for k in KINDS.values()
        ]
        raise InputError(
            f'{source}: test "{name}" is not in {file}; say how it was run: {" or ".join(needs)}'
            f"{', and ' + ', '.join(common) if common else ''}; or name a test of the campaign with --test"
        )
    missing = [*(options()[k] for k in KINDS[kind].needed if k not in keys), *common]
    if missing:
        raise InputError(f'{source}: test "{name}" is new in {file}; {kind} needs {", ".join(missing)} as well')
    return {"name": name, "trace": f"traces/{name}.csv", **{k: keys[k] for k in _order() if k in keys}}


def _append(document: tomlkit.TOMLDocument, new: dict) -> None:
    if "test" not in document:
        document.append("test", tomlkit.aot())
    tables = document["test"]
    inline = not isinstance(tables, AoT)
    table = tomlkit.inline_table() if inline else tomlkit.table()
    for key in sorted(new, key=_order().index):
        table[key] = new[key]
    if not inline and len(tables) and not tables[-1].as_string().endswith("\n\n"):
        tables[-1].add(tomlkit.nl())
    tables.append(table)


def checked_trace(
    source: Path, test: BallBarTest, time: np.ndarray, deviation: np.ndarray, instrument: BallBarData
) -> Trace:
    """The trace as reading it back will give it.

    Raises:
        InputError: it has too few samples, most are beyond the sensor's range, or it does not fit the test's program.
    """
    if len(time) < 50:
        raise InputError(f"{source}: {len(time)} samples in the measured part; allowed: at least 50")
    known = np.isfinite(deviation)
    valid = known & (np.abs(np.nan_to_num(deviation)) < instrument.range * (1 - 1e-9)) & ~saturated(deviation)
    if valid.sum() < max(50, 0.5 * known.sum()):
        raise InputError(
            f"{source}: only {int(valid.sum())} of {len(valid)} samples are inside the sensor's range of "
            f"±{instrument.range * 1e3:g} mm "
            f"(median {np.nanmedian(deviation) / UM:.6g} µm); check --deviation-unit, and --absolute where the "
            f"column holds lengths"
        )
    trace = Trace(time, np.nan_to_num(deviation), valid, int((known & ~valid).sum()))
    check_span(source, test, trace)
    return trace


def trace_bytes(file: Path, time: np.ndarray, deviation: np.ndarray) -> bytes:
    """``time_s,deviation_um`` as CSV, compressed where the file's name says so: 1 µs and 0.1 nm."""
    rows = "".join(f"{t:.6f},{d / UM:.4f}\n" for t, d in zip(time, deviation, strict=True))
    data = ("time_s,deviation_um\n" + rows).encode()
    return gzip.compress(data, mtime=0) if file.suffix == ".gz" else data


def write(file: Path, text: str, traces: dict[Path, bytes], force: bool = False) -> None:
    """Write traces and campaign.toml: all of them or none. campaign.toml comes last; it is edited, which is the
    purpose.

    Raises:
        InputError: a trace is there already and ``force`` is false, or a file cannot be written.
    """
    for path in traces:
        check_writable(path, force)
    edited: dict[Path, str | bytes] = {} if text == read_text(file) else {file: text}
    write_all({**traces, **edited}, force=True)


def read_document(folder: Path) -> tuple[Path, str, Campaign | None]:
    """campaign.toml of a folder, its text, and the ball-bar tests of the campaign; ``None`` where it has no test yet.

    Raises:
        InputError: it is missing or wrong.
    """
    file = campaign_file(folder)
    data = parse(file)
    campaign = campaign_from(file, data, traces=False).of(BallBarTest.instrument) if data.get("test") else None
    return file, read_text(file), campaign
