"""Every file that mjsim reads, spoiled at random: it is accepted with values that make sense, or refused in one sentence."""

import gzip
import math
import shutil

import numpy as np
import pytest
from commands import CAMPAIGN, OWN
from fuzzing import cases, replaced, spoiled, tried
from hypothesis import given
from hypothesis import strategies as st

from mjsim.ballbar.measurement import Instrument
from mjsim.ballbar.program import Program
from mjsim.batch.dataset import Folder
from mjsim.batch.sweep import read_sweep
from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_document, read_machine
from mjsim.campaign.traces import read_trace
from mjsim.effects import registry
from mjsim.importing.b5r import read_b5r
from mjsim.importing.b5r_runs import read_recorded
from mjsim.importing.features import beside, imported_features
from mjsim.importing.importer import import_traces
from mjsim.importing.reading import Options
from mjsim.io.resources import examples
from mjsim.nc.read import read_nc
from mjsim.nc.write import Options as NCOptions
from mjsim.nc.write import nc_program
from mjsim.workflow.history import read_history

TURN = Instrument()


@pytest.fixture(scope="module")
def campaign(good, tmp_path_factory):
    """A copy of the short campaign whose files are spoiled one at a time."""
    return shutil.copytree(good, tmp_path_factory.mktemp("fuzz") / "short")


def finite(*values):
    return all(math.isfinite(v) for v in values)


def check_campaign(c):
    assert c.tests and c.name and c.name.isprintable()
    for t in c.tests:
        assert finite(*t.table_ball, t.length, t.feed, t.half_apex, t.inclination, t.start, t.stop, t.started)
        assert 0 < Program(t).duration < 1e5
    assert finite(c.instrument.range, c.instrument.rate, c.instrument.resolution)
    for name, trace in c.traces.items():
        check_trace(trace)
        assert name in {t.name for t in c.tests}


def check_trace(trace):
    assert len(trace.time) == len(trace.deviation) == len(trace.valid) >= 50
    assert np.isfinite(trace.time).all() and np.isfinite(trace.deviation).all() and (np.diff(trace.time) > 0).all()
    assert trace.valid.sum() >= 50


def check_machine(m):
    assert m.name and m.name.isprintable()
    for d in m.drives.values():
        assert finite(d.gear, d.position_gain, d.velocity_gain, d.integral_time, d.inertia, d.viscous, d.gravity) and d.inertia > 0 < d.gear
    for e in m.effects:
        for p in e.parameters_of(e.subject):
            if p.kind == "number":
                assert p.lower <= e.values[p.name] <= p.upper


@cases(250)
@given(st.data())
def test_campaign_toml(campaign, data):
    text = data.draw(spoiled(CAMPAIGN.encode()))
    with replaced(campaign / "campaign.toml", text):
        c = tried("campaign.toml", read_campaign, campaign, campaign.parent.name)
    if c is not None:
        check_campaign(c)


TRACE = "time_s,deviation_um\n" + "".join(f"{0.01 * i:.3f},{3 * np.sin(0.1 * i):.4f}\n" for i in range(80))


@cases(250)
@given(st.data())
def test_trace(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "trace.csv"
    path.write_bytes(data.draw(spoiled(TRACE.encode())))
    trace = tried("trace .csv", lambda p: read_trace(p, TURN), path)
    if trace is not None:
        check_trace(trace)


@cases(60)
@given(st.data())
def test_compressed_trace(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "trace.csv.gz"
    path.write_bytes(data.draw(spoiled(gzip.compress(TRACE.encode()))))
    trace = tried("trace .csv.gz", lambda p: read_trace(p, TURN), path)
    if trace is not None:
        check_trace(trace)


MACHINE = (
    (examples() / "hidden-backlash" / "machine.toml").read_bytes()
    + b"""
[[effect]]
id = "pitch_error.C"
components = [[72.0, 0.001, 30.0], [180.0, 0.0005, -90.0]]
direction = "CW"
"""
)


@cases(250)
@given(st.data())
def test_machine_toml(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "machine.toml"
    path.write_bytes(data.draw(spoiled(MACHINE)))
    machine = tried("machine.toml", read_machine, path)
    if machine is not None:
        check_machine(machine)
        # what is read can be written again, with one effect more and one less
        more = machine.with_effect(registry.make("backlash.Y", width_um=1.5))
        for m in (more, more.without(more.effects[0].key)):
            with replaced(path, machine_document(m, path).encode()):
                again = read_machine(path)
            assert [(e.key, e.values) for e in again.effects] == [(e.key, e.values) for e in m.effects]


SWEEP = b"""
name = "widths"
campaign = "short"
tests = ["turn"]
design = "tolerances"
samples = 3
seed = 1
traces = true
every_ms = 20
[[vary]]
parameter = "backlash.A.width_deg"
from = 0.0
to = 0.00095
count = 4
[[vary]]
parameter = "feed_mm_min"
values = [1500.0, 2000.0]
[[vary]]
parameter = "drive.C.position_gain_per_s"
from = 44.0
to = 46.0
count = 3
scale = "log"
"""
OWN_TESTS = (
    b'name = "own"\nmachine = "short/machine.toml"\ndesign = "latin_hypercube"\nsamples = 5\n'
    + b"".join(CAMPAIGN.encode().partition(b"[[test]]")[1:]).replace(b'trace = "traces/turn.csv"\n', b"")
    + b'[[vary]]\nparameter = "table_ball_mm.x"\nfrom = -10.0\nto = 20.0\n'
)


@cases(120)
@given(st.data())
def test_sweep_toml(campaign, data):
    path = campaign.parent / "sweep.toml"
    with replaced(path, data.draw(spoiled(data.draw(st.sampled_from((SWEEP, OWN_TESTS)))))):
        sweep = tried("sweep.toml", read_sweep, path, campaign.parent.name)
    if sweep is not None:
        assert np.isfinite(sweep.design.values).all() and 1 <= sweep.runs <= 1_000_000
        for t in sweep.tests:
            assert finite(*t.table_ball, t.length, t.feed)


@pytest.fixture(scope="module")
def programs(campaign):
    turn = read_campaign(campaign, traces=False).tests[0]
    return {d: nc_program(turn, NCOptions(d, step_deg=1.0)).text.encode() for d in ("fanuc", "siemens", "linuxcnc")}


@cases(200)
@given(st.data())
def test_nc_program(programs, tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "p.nc"
    dialect = data.draw(st.sampled_from(sorted(programs)))
    path.write_bytes(data.draw(spoiled(programs[dialect])))
    rollover = data.draw(st.booleans())
    nc = tried("NC program", lambda p: read_nc(p, dialect, data.draw(st.sampled_from(((), ("A",), ("A", "C")))), rollover), path)
    if nc is not None:
        assert np.isfinite(nc.motion.points).all() and (nc.motion.seconds > 0).all() and np.isfinite(nc.motion.duration)
        assert len(nc.lines) == len(nc.motion.points)


@cases(60)
@given(st.data())
def test_campaign_driven_by_an_nc_program(campaign, programs, data):
    text = CAMPAIGN.replace('kind = "rotary"\n', 'kind = "rotary"\nprogram = "p.nc"\n')
    with replaced(campaign / "campaign.toml", text.encode()), replaced(campaign / "p.nc", data.draw(spoiled(programs["fanuc"]))):
        c = tried("campaign with program", read_campaign, campaign, "p.nc", "turn.csv")
    if c is not None:
        check_campaign(c)


def table(separator, decimal, header):
    rows = [f"{0.22 + 0.01 * i:.2f}{separator}{1e-3 * 4 * np.sin(0.02 * i):.5f}" for i in range(208)]
    text = "\n".join([*header, *rows, ""])
    return (text.replace(".", ",") if decimal == "comma" else text).encode()


TABLES = [
    table(";", "comma", ["Ball bar run 2", "Feedrate (mm/min): 2000", "Time [s];Deviation [mm]"]),
    table("\t", "point", ["time\tdev", "s\tmm"]),
    table(",", "point", ["time_s,deviation_mm"]),
    table(" ", "point", []),
]


@cases(250)
@given(st.data())
def test_table_of_another_system(campaign, data):
    path = campaign.parent / "turn.txt"
    options = Options(time=data.draw(st.sampled_from((None, "1", "2"))), deviation_unit=data.draw(st.sampled_from((None, "mm"))))
    with replaced(path, data.draw(spoiled(data.draw(st.sampled_from(TABLES))))):
        got = tried("import table", lambda p: import_traces(campaign, [p], options=options, preview=True, check=False), path)
    if got:
        check_trace(got[0].trace)
        row = got[0].to_json()
        assert finite(row["rate_Hz"], row["rms_um"], row["min_um"], row["max_um"])


@cases(150)
@given(st.data())
def test_b5r(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "run.b5r"
    path.write_bytes(data.draw(spoiled(B5R)))
    got = tried("import .b5r", read_b5r, path)
    if got is not None:
        assert got.features and len(got.axes) in (0, 2)
        beside([got], {"backlash.X": {"width_um": 2.0}})


@cases(150)
@given(st.data())
def test_b5r_runs(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "recorded.b5r"
    text = B5R.replace(b"</BALLBAR_RUN>", b"<READINGS>1.5 2 -3.25 1e2 0 4 7</READINGS></BALLBAR_RUN>")
    path.write_bytes(data.draw(spoiled(text)))
    got = tried("import .b5r", read_recorded, path)
    for run in got.runs if got is not None else ():
        assert run.direction in ("CW", "CCW") and finite(run.spread, run.gap, *run.readings)
        concluded = tried("import .b5r", lambda _, run=run: got.unit(run, Options()), path)
        assert concluded is None or concluded[0] > 0


B5R = b"""<?xml version="1.0" encoding="utf-8" standalone="yes"?>
<TEST_DOCUMENT>
<TEST_SPEC NAME="360 deg 100 mm"><INSTRUMENT><PLANE VIEW="+A+B" TEST_PLANE="XY"/></INSTRUMENT></TEST_SPEC>
<OPERATOR>N. N.</OPERATOR><MACHINE_TESTED NAME="Hall 3"/>
<RUN_RESULTS><BALLBAR_RUN><RUN_DIRECTION>CCW</RUN_DIRECTION>
<FEATURE NAME="AF_CIRCULARITY" DT="UT_LENGTH_MM">0.0071</FEATURE></BALLBAR_RUN></RUN_RESULTS>
<ANALYSIS NAME="DIAGNOSTICS">
<FEATURE NAME="AF_BACKLASH_A_POS" DT="UT_LENGTH_UM"> 2.4 </FEATURE>
<FEATURE NAME="AF_SQUARENESS" DT="UT_SQUARENESS"> 12.5 </FEATURE>
</ANALYSIS></TEST_DOCUMENT>
"""
IMPORTED = (
    b'{"source": "a.b5r", "header": {"plane": "XY"}, "axes": ["X", "Y"], "features": [\n'
    b'{"name": "AF_BACKLASH_A_POS", "type": "UT_LENGTH_UM", "value": 2.4, "unit": "um", "run": "", "analysis": ""}\n]}\n'
)


@cases(120)
@given(st.data())
def test_imported_features(campaign, data):
    folder = campaign / "imported"
    folder.mkdir(exist_ok=True)
    try:
        with replaced(folder / "a.json", data.draw(spoiled(IMPORTED))):
            got = tried("imported/*.json", imported_features, campaign, "a.json")
    finally:
        folder.rmdir()
    if got:
        for row in beside(got, {"backlash.X": {"width_um": 2.0}}):
            assert isinstance(row["value"], str) or math.isfinite(row["value"])


HISTORY = (
    b'{"steps": [\n{"action": "start", "effect": "", "machine_file": "machine.toml", "effects": ["friction.X"],\n"rms_um": 1.0,'
    b' "noise_um": 0.1, "tests": {"turn": 1.0}, "model": ""},\n{"action": "add", "effect": "backlash.A", "machine_file": "machine.toml",\n'
    b'"effects": ["friction.X", "backlash.A"], "rms_um": 0.2, "noise_um": 0.1, "tests": {"turn": 0.2}, "model": ""}\n]}\n'
)


@cases(150)
@given(st.data())
def test_history(campaign, data):
    c = read_campaign(campaign, traces=False)
    c.state_folder.mkdir(exist_ok=True)
    try:
        with replaced(c.state_folder / "history.json", data.draw(spoiled(HISTORY))):
            steps = tried("history.json", lambda _: read_history(c), campaign, "history.json")
    finally:
        c.state_folder.rmdir()
    for s in steps or ():
        assert finite(s.rms_um, s.noise_um, *s.tests.values()) and s.noise_um >= 0
        assert s.label.isprintable()


@cases(80)
@given(st.data())
def test_description_of_a_data_set(campaign, data):
    import json

    from mjsim.batch.describe import describe

    path = campaign.parent / "sweep.toml"
    with replaced(path, SWEEP):
        sweep = read_sweep(path)
    out = campaign.parent / "out"
    (out / "results").mkdir(parents=True, exist_ok=True)
    text = json.dumps(describe(sweep), indent=1, ensure_ascii=False).encode()
    with replaced(out / "sweep.json", data.draw(spoiled(text))):
        tried("batch sweep.json", lambda p: Folder.check(sweep, p), out, "sweep.json")


@cases(60)
@given(st.data())
def test_effect_file(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "mine.py"
    path.write_bytes(data.draw(spoiled(OWN.format(kind="mine_spoiled").encode(), most=1)))
    before = registry.kinds()
    try:
        tried("effect file", registry.load_file, path)
    finally:
        registry.restore(before)
