"""Every file that mjsim reads, after the accidents that happen to files: read with sensible values, or refused in
one sentence.
"""

import gzip
import json
import math
import random
import re
import shutil
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import CAMPAIGN, OWN

from mjsim.batch.dataset import check_folder, describe
from mjsim.batch.sweep import read_sweep
from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_document, read_machine
from mjsim.commands.history import read_history
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.importing.b5r import read_b5r, read_recorded
from mjsim.importing.features import beside, imported_features
from mjsim.importing.importer import import_traces
from mjsim.importing.reading import Options
from mjsim.instruments.ball_bar.files import read_trace
from mjsim.instruments.ball_bar.measurement import BallBarData
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.resources import examples
from mjsim.nc.read import read_nc
from mjsim.nc.write import nc_program

#: How often each file is spoiled; always in the same ways.
TIMES = 25
NUMBERS = (b"nan", b"-inf", b"1e400", b"0", b"-1", b"1e9", b"1,5", b"1.2.3", b"", b"true", b'"5"', b"[1]", b"text")
WORDS = (b'""', b'".."', b'"\xc3\xa9"', b"5", b"true", b'["a"]', b'"nothing"')
LINE_ENDS = (b"\r\n", b"\r", b"\n\n", b"")
ENCODINGS = ("utf-8-sig", "utf-16", "latin-1", "cp1252", "utf-32")


def spoiled(data, rng):
    """The file after one accident: cut, lines lost, doubled or exchanged, another number or word, another encoding."""
    lines, at = data.split(b"\n"), rng.randrange(len(data))
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.choice(
        ("cut", "byte", "lose", "double", "exchange", "number", "number", "word", "ends", "encoding", "delete", "empty")
    )
    if kind == "cut":
        return data[:at]
    if kind == "byte":
        return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]
    if kind == "delete":
        return data[:at] + data[at + rng.randrange(1, 60) :]
    if kind == "lose":
        return b"\n".join(lines[:i] + lines[i + 1 :])
    if kind == "double":
        return b"\n".join(lines[: i + 1] + lines[i:])
    if kind == "exchange":
        lines[i], lines[j] = lines[j], lines[i]
        return b"\n".join(lines)
    if kind == "number":
        return one_replaced(data, rb"(?<![\w.])[-+]?\d+\.?\d*", rng.choice(NUMBERS), rng)
    if kind == "word":
        return one_replaced(data, rb'"[^"\n]*"', rng.choice(WORDS), rng)
    if kind == "ends":
        return data.replace(b"\n", rng.choice(LINE_ENDS))
    if kind == "encoding":
        return data.decode("utf-8", "replace").encode(rng.choice(ENCODINGS), "replace")
    return b""


def one_replaced(data, pattern, new, rng):
    spots = [m.span() for m in re.finditer(pattern, data)]
    if not spots:
        return data
    begin, end = rng.choice(spots)
    return data[:begin] + new + data[end:]


# -- what is read, and what has to hold of it --------------------------------------------------------------------------


def finite(*values):
    return all(math.isfinite(v) for v in values)


def check_campaign(c):
    for t in c.tests:
        assert finite(*t.table_ball, t.length, t.feed, t.half_apex, t.inclination, t.start, t.stop, t.started)
        assert 0 < Program(t).duration < 1e5
    for trace in c.traces.values():
        check_trace(trace)


def check_trace(trace):
    assert len(trace.time) == len(trace.deviation) == len(trace.valid) and trace.valid.sum() >= 50
    assert np.isfinite(trace.time).all() and np.isfinite(trace.deviation).all() and (np.diff(trace.time) > 0).all()


def check_machine(machine):
    """Numbers are inside their bounds, and what was read can be written with one effect more."""
    for d in machine.drives.values():
        assert finite(d.gear, d.position_gain, d.velocity_gain, d.integral_time, d.inertia, d.viscous, d.gravity)
    for e in machine.effects:
        assert all(p.lower <= e.values[p.name] <= p.upper for p in e.parameters_of(e.subject) if p.kind == "number")
    more = machine.with_effect(registry.make("backlash.Y", width_um=1.5))
    again = read_machine(machine.path, machine_document(more, machine.path))
    assert [(e.key, e.values) for e in again.effects] == [(e.key, e.values) for e in more.effects]


def check_program(nc):
    assert (
        np.isfinite(nc.motion.points).all() and (nc.motion.seconds > 0).all() and len(nc.lines) == len(nc.motion.points)
    )


def check_sweep(sweep):
    assert np.isfinite(sweep.values).all() and 1 <= sweep.runs <= 1_000_000


def import_table(path):
    short = next(p / "short" for p in path.parents if (p / "short").is_dir())
    return import_traces(short, [path], "turn", options=Options(time="1"), preview=True, check=False)


def check_runs(recorded):
    for run in recorded.runs if recorded is not None else ():
        assert run.direction in ("CW", "CCW") and finite(run.spread, run.gap, *run.readings)


TRACE = ("time_s,deviation_um\n" + "".join(f"{0.01 * i:.3f},{3 * np.sin(0.1 * i):.4f}\n" for i in range(80))).encode()
TABLE = "Ball bar run 2\nFeedrate (mm/min): 2000\nTime [s];Deviation [mm]\n" + "".join(
    f"{0.22 + 0.01 * i:.2f};{1e-3 * 4 * np.sin(0.02 * i):.5f}\n".replace(".", ",") for i in range(208)
)
MACHINE = (examples() / "hidden-backlash" / "machine.toml").read_bytes() + (
    b'[[effect]]\nid = "pitch_error.C"\ncomponents = [[72.0, 0.001, 30.0], [180.0, 0.0005, -90.0]]\ndirection = "CW"\n'
)
SWEEP = b"""name = "widths"
campaign = "short"
tests = ["turn"]
design = "tolerances"
samples = 3
seed = 1
[[vary]]
parameter = "backlash.A.width_deg"
from = 0.0
to = 0.00095
count = 4
[[vary]]
parameter = "feed_mm_min"
values = [1500.0, 2000.0]
"""
B5R = b"""<?xml version="1.0" encoding="utf-8" standalone="yes"?>
<TEST_DOCUMENT>
<TEST_SPEC NAME="360 deg 100 mm"><INSTRUMENT><PLANE VIEW="+A+B" TEST_PLANE="XY"/></INSTRUMENT></TEST_SPEC>
<RUN_RESULTS><BALLBAR_RUN><RUN_DIRECTION>CCW</RUN_DIRECTION>
<FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_MM">0.0071</FEATURE></BALLBAR_RUN></RUN_RESULTS>
<ANALYSIS NAME="DIAGNOSTICS"><FEATURE NAME="AF_BACKLASH_A_POS" DT="UT_LENGTH_UM"> 2.4 </FEATURE></ANALYSIS>
</TEST_DOCUMENT>
"""
RUNS = B5R.replace(b"</BALLBAR_RUN>", b"<READINGS>1.5 2 -3.25 1e2 0 4 7</READINGS></BALLBAR_RUN>")
IMPORTED = (
    b'{"source": "a.b5r", "header": {"plane": "XY"}, "axes": ["X", "Y"], "features": [\n'
    b'{"name": "AF_BACKLASH_A_POS", "type": "UT_LENGTH_UM", "value": 2.4, "unit": "um", "run": "", "analysis": '
    b'""}\n]}\n'
)
HISTORY = (
    b'{"steps": [\n{"action": "start", "effect": "", "machine_file": "machine.toml", "effects": ["friction.X"],\n'
    b'"rms_um": 1.0, "noise_um": 0.1, "tests": {"turn": 1.0}, "model": ""}\n]}\n'
)


@dataclass
class Kind:
    """A kind of file: its place below a folder with the short campaign, its content, who reads it, what holds of
    the result.
    """

    place: str
    content: Any
    read: Any
    check: Any = lambda value: None
    named: str = ""


KINDS = {
    "campaign": Kind("short/campaign.toml", CAMPAIGN.encode(), lambda p: read_campaign(p.parent), check_campaign),
    "machine": Kind("machine.toml", MACHINE, read_machine, check_machine),
    "trace": Kind("trace.csv", TRACE, lambda p: read_trace(p, BallBarData()), check_trace),
    "compressed trace": Kind("trace.csv.gz", gzip.compress(TRACE), lambda p: read_trace(p, BallBarData()), check_trace),
    "sweep": Kind("sweep.toml", SWEEP, read_sweep, check_sweep, "campaign.toml"),
    "NC program": Kind("p.nc", None, read_nc, check_program),
    "table": Kind("turn.txt", TABLE.encode(), import_table, lambda got: check_trace(got[0].trace)),
    ".b5r": Kind("run.b5r", B5R, read_b5r, lambda got: beside([got], {"backlash.X": {"width_um": 2.0}})),
    "runs in .b5r": Kind("recorded.b5r", RUNS, read_recorded, check_runs),
    "features": Kind("short/imported/a.json", IMPORTED, lambda p: imported_features(p.parent.parent)),
    "history": Kind(
        "short/.mjsim/history.json", HISTORY, lambda p: read_history(read_campaign(p.parent.parent, traces=False))
    ),
    "data set": Kind("out/sweep.json", None, lambda p: check_folder(sweep_of(p.parent.parent), p.parent), named="out"),
    "effect": Kind("mine.py", OWN.format(kind="mine_spoiled").encode(), registry.load_file),
}


@cache
def sweep_of(folder):
    return read_sweep(folder / "sweep.toml")


def content_of(name, kind, folder):
    """The content of a file; two are made from the campaign."""
    if name == "NC program":
        return nc_program(read_campaign(folder / "short", traces=False).tests[0]).text.encode()
    if name == "data set":
        (folder / "sweep.toml").write_bytes(SWEEP)
        return json.dumps(describe(read_sweep(folder / "sweep.toml")), indent=1).encode()
    return kind.content


@pytest.fixture
def folder(good, tmp_path):
    shutil.copytree(good, tmp_path / "short")
    return tmp_path


@pytest.mark.parametrize("name", KINDS)
def test_spoiled(folder, name):
    kind = KINDS[name]
    path, whole = folder / kind.place, content_of(name, kind, folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(whole)
    kind.check(kind.read(path))
    refusals = 0
    for number in range(TIMES):
        path.write_bytes(spoiled(whole, random.Random(number)))
        try:
            value = kind.read(path)
        except InputError as error:
            refusals += 1
            text = str(error)
            assert 10 < len(text) < 690 and "\n" not in text
            assert any(n and n in text for n in (path.name, kind.named, "turn.csv")), text
        else:
            kind.check(value)
    assert refusals > 0


# -- what stands where a file is expected ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [n for n in KINDS if n not in ("history", "features", "data set")])
def test_no_file_there(folder, name):
    """Nothing, a folder, a path below a file, a file without permission."""
    kind = KINDS[name]
    path = folder / "other" / Path(kind.place).name
    path.parent.mkdir()
    for make in (lambda: None, path.mkdir, path.rmdir):
        make()
        with pytest.raises(InputError, match=re.escape(path.parent.name)):
            kind.read(path)
    path.parent.rmdir()
    path.parent.write_text("a file")
    with pytest.raises(InputError):
        kind.read(path)


@pytest.mark.parametrize("name", ["campaign", "machine", "trace", "NC program", ".b5r"])
def test_a_file_that_may_not_be_read(folder, name, monkeypatch):
    """Also where the tests run as root, who may read everything."""
    kind = KINDS[name]
    path = folder / kind.place
    path.write_bytes(content_of(name, kind, folder))

    def refuse(self):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(InputError, match=rf"{path.name}: cannot be read: Permission denied"):
        kind.read(path)


@pytest.mark.parametrize(
    ("name", "allowed"), [("machine", "5 MB"), ("trace", "thin the trace"), ("NC program", "20 MB")]
)
def test_a_file_that_is_too_large(folder, name, allowed):
    """Its size is enough to refuse it (the file is sparse)."""
    path = folder / KINDS[name].place
    with open(path, "wb") as file:
        file.truncate(10**12)
    with pytest.raises(InputError, match=f"{path.name}: 1000000 MB; .*{allowed}"):
        KINDS[name].read(path)
