"""Files of real controls, in their layouts: what is read from them, and what is said of what is not."""

import datetime as dt
import json

import numpy as np
import openpyxl
import pytest
from click.testing import CliRunner

from mjsim.campaign.files import read_campaign
from mjsim.campaign.new import new_log_campaign
from mjsim.cli.main import main
from mjsim.errors import InputError
from mjsim.importing.formats import read_any
from mjsim.importing.importer import import_trace
from mjsim.importing.logs import import_log
from mjsim.importing.reading import Options
from mjsim.importing.table import read_table
from mjsim.units import DEG, MM

N = 400
TIME = 0.002 * np.arange(N)
COMMAND = 20.0 * np.sin(2 * np.pi * 1.3 * TIME)
RATE = np.gradient(COMMAND, TIME)
ACTUAL = COMMAND - 0.01 * RATE


def campaign(tmp_path, axes):
    new_log_campaign(tmp_path / "c", axes)
    return tmp_path / "c"


def record(folder, name, axis):
    c = read_campaign(folder)
    return c.traces[name].axes[axis]


# --- tables of text --------------------------------------------------------------------------------------------------


def table(stamps, sep=";", comma=True, words=None):
    rows = []
    for i, stamp in enumerate(stamps):
        numbers = [f"{COMMAND[i]:.5f}", f"{ACTUAL[i]:.5f}"]
        numbers = [n.replace(".", ",") for n in numbers] if comma else numbers
        rows.append(sep.join([stamp, *numbers, *([words(i)] if words else [])]))
    return rows


STAMPS = {
    "iso": lambda s: f"2024-05-01 {s}",
    "zulu": lambda s: f"2024-05-01T{s}Z",
    "german": lambda s: f"01.05.2024 {s}",
    "american": lambda s: f"12/31/2024 {s}",
    "clock": lambda s: s,
}


@pytest.mark.parametrize("kind", STAMPS)
def test_dates_and_times_become_seconds(tmp_path, kind):
    """In any usual writing; without a date, the time of day goes on after midnight."""
    start = 86399.5 if kind == "clock" else 36000.0
    clock = [(start + t) % 86400.0 for t in TIME]
    stamps = [STAMPS[kind](f"{int(s // 3600):02d}:{int(s // 60) % 60:02d}:{s % 60:06.3f}") for s in clock]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["Stamp;X soll [mm];X ist [mm]", *table(stamps)]) + "\n")
    done = import_log(campaign(tmp_path, "X"), path)
    assert done.rate == pytest.approx(500.0, rel=1e-6) and done.samples == N
    assert any("times of day" in n for n in done.notes)
    got = record(tmp_path / "c", "log", "X")
    np.testing.assert_allclose(got.actual, ACTUAL * MM, atol=1e-8)


def test_columns_of_words_are_left_out_by_name(tmp_path):
    """A status beside the numbers, quoted or not, also where it begins late; a number that is spoiled is no word."""
    states = [lambda i: "Prep", lambda i: '"a, b"', lambda i: "" if i < 390 else "End"]
    for k, words in enumerate(states):
        path = tmp_path / f"{k}.csv"
        rows = table([f"{t:.3f}" for t in TIME], ",", False, words)
        path.write_text("\n".join(["time_s,X command (mm),X actual (mm),State", *rows]) + "\n")
        read = read_table(path)
        assert read.names[:3] == ("time_s", "X command (mm)", "X actual (mm)") and read.values.shape == (N, 3), k
        np.testing.assert_allclose(read.values[:, 2], ACTUAL, atol=1e-5)
    rows[200] = rows[200].replace(".", "x", 2)
    path.write_text("\n".join(["time_s,X command (mm),X actual (mm),State", *rows]) + "\n")
    with pytest.raises(InputError, match="line 202"):
        read_table(path)


def test_several_header_lines_and_a_line_of_units(tmp_path):
    """An axis above its signals; units in brackets, also of those that are no positions."""
    head = ["Trace of 3 May", ";X;;;Y;", "Zeit;Soll;Ist;Strom;Soll;Ist", "[µs];[mm];[mm];[mA];[µm];[µm]"]
    rows = [
        f"{2000 * i};{c:.4f};{a:.4f};{1500 + i};{1e3 * a:.2f};{1e3 * c:.2f}"
        for i, (c, a) in enumerate(zip(COMMAND, ACTUAL, strict=True))
    ]
    path = tmp_path / "many.csv"
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    done = import_log(campaign(tmp_path, "XY"), path)
    assert {(c.axis, c.signal, c.unit) for c in done.columns if c.axis} == {
        ("X", "command", "mm"), ("X", "actual", "mm"), ("X", "current", "mA"), ("Y", "command", "um"),
        ("Y", "actual", "um"),
    }  # fmt: skip
    assert done.rate == pytest.approx(500.0)
    got = record(tmp_path / "c", "many", "X")
    np.testing.assert_allclose(got.current, 1.5 + 1e-3 * np.arange(N))
    np.testing.assert_allclose(record(tmp_path / "c", "many", "Y").command, ACTUAL * MM, atol=2e-8)


def test_a_gap_ends_a_recording_and_begins_another(tmp_path):
    """Said with its place; a short rest is left out; all have one set-up, and every command can read them."""
    time = TIME + 1.0 * (TIME >= TIME[150]) + 3.0 * (TIME >= TIME[380])
    rows = [f"{t:.3f},{c:.5f},{a:.5f}" for t, c, a in zip(time, COMMAND, ACTUAL, strict=True)]
    path = tmp_path / "gap.csv"
    path.write_text("\n".join(["t [s],X command [mm],X actual [mm]", *rows]) + "\n")
    done = import_log(campaign(tmp_path, "X"), path)
    assert done.tests == ("gap-1", "gap-2") and done.samples == 380
    said = " ".join(done.notes)
    assert "1.002 s without a sample after 0.298 s" in said and "1 recordings of less than 100 samples" in said
    logs = read_campaign(tmp_path / "c")
    assert [t.setup for t in logs.tests] == ["gap", "gap"]
    np.testing.assert_allclose(logs.traces["gap-2"].axes["X"].command, COMMAND[150:380] * MM, atol=1e-8)


def test_a_span_without_the_gap_of_a_recording_is_read(tmp_path):
    """Only the part that is used has to have an even clock."""
    folder = campaign(tmp_path, "X")
    time = TIME + 5.0 * (TIME >= TIME[300])
    rows = [f"{t:.3f},{c:.5f},{a:.5f}" for t, c, a in zip(time, COMMAND, ACTUAL, strict=True)]
    (folder / "traces" / "a.csv").write_text("\n".join(["time_s,X_command_mm,X_actual_mm", *rows]) + "\n")
    text = (folder / "campaign.toml").read_text()
    test = '\n[[test]]\nname = "a"\nkind = "log"\ntrace = "traces/a.csv"\naxes = ["X"]\n'
    (folder / "campaign.toml").write_text(text + test)
    with pytest.raises(InputError, match="without a sample"):
        read_campaign(folder)
    (folder / "campaign.toml").write_text(text + test + "span_s = [0.0, 0.5]\n")
    assert len(read_campaign(folder).traces["a"].time) == 251


@pytest.mark.parametrize(
    ("signal", "unit", "name", "value"),
    [
        ("X_load=4", "mm", "load", MM),
        ("X_velocity_command=4", "mm/min", "velocity_command", MM / 60),
        ("X_torque=4", "%", "torque_share", 0.01),
        ("X_current=4", "mA", "current", 1e-3),
        ("X_force=4", "kN", "force", 1e3),
        ("X_control=4", "mV", "control", 1e-3),
        ("X_lag=4", "um", "", 0.0),
    ],
)
def test_every_channel_can_be_said(tmp_path, signal, unit, name, value):
    numbers = RATE * 60 if "velocity" in signal else ACTUAL
    rows = [f"{t:.3f} {c:.5f} {a:.5f} {x:.5f}" for t, c, a, x in zip(TIME, COMMAND, ACTUAL, numbers, strict=True)]
    path = tmp_path / "plain.txt"
    path.write_text("\n".join(rows) + "\n")
    signals = ("X_command=2:mm", "X_actual=3:mm", f"{signal}:{unit}")
    import_log(campaign(tmp_path, "X"), path, signals=signals, options=Options(time="1"))
    got = record(tmp_path / "c", "plain", "X").channels
    assert set(got) == {"command", "actual", *([name] if name else [])}
    if name:
        np.testing.assert_allclose(got[name], numbers * value, atol=abs(2e-5 * value), rtol=1e-6)


def test_the_unit_of_a_velocity_is_held_against_the_motion(tmp_path):
    """Stated wrong or not at all, it is concluded and said; a number that is no unit's is left out and said."""
    for name, factor, head, said in (
        ("a", 60.0, "v", "is in mm/min"),
        ("b", 60.0, "v [mm/s]", "is in mm/min"),
        ("c", 1.17 * 2, "v", "which is no unit"),
    ):
        rows = [
            f"{t:.3f};{c:.5f};{a:.5f};{factor * v:.5f}" for t, c, a, v in zip(TIME, COMMAND, ACTUAL, RATE, strict=True)
        ]
        path = tmp_path / f"{name}.csv"
        path.write_text("\n".join([f"t [s];X soll [mm];X ist [mm];X {head}", *rows]) + "\n")
        folder = tmp_path / "c" if (tmp_path / "c").exists() else campaign(tmp_path, "X")
        done = import_log(folder, path)
        assert any(said in n for n in done.notes), done.notes
        got = record(folder, name, "X").velocity
        if name == "c":
            assert got is None
        else:
            np.testing.assert_allclose(got, RATE * MM, rtol=1e-3, atol=1e-6)


# --- spreadsheets ----------------------------------------------------------------------------------------------------


def test_a_spreadsheet_with_dates_units_and_words(tmp_path):
    """The first sheet with a table of numbers is read as any other table."""
    book = openpyxl.Workbook()
    book.active.append(["Notes only"])
    sheet = book.create_sheet("Data")
    sheet.append(["Zeitstempel", "X soll", "X ist", "Status"])
    sheet.append([None, "mm", "mm", None])
    start = dt.datetime(2024, 5, 1, 10)
    for t, c, a in zip(TIME, COMMAND, ACTUAL, strict=True):
        sheet.append([start + dt.timedelta(seconds=float(t)), float(c), float(a), "ok"])
    book.save(tmp_path / "log.xlsx")
    done = import_log(campaign(tmp_path, "X"), tmp_path / "log.xlsx")
    assert "sheet 'Data' of 2" in done.notes[0] and any('text: column 4 "Status"' in n for n in done.notes)
    assert done.rate == pytest.approx(500.0)
    np.testing.assert_allclose(record(tmp_path / "c", "log", "X").actual, ACTUAL * MM, atol=1e-10)
    (tmp_path / "no.xlsx").write_bytes(b"PK nothing")
    with pytest.raises(InputError, match="no workbook"):
        import_log(tmp_path / "c", tmp_path / "no.xlsx")


def test_a_ball_bar_trace_of_a_spreadsheet(tmp_path, good):
    """The same reader serves traces: here with times of day in place of seconds."""
    import shutil

    shutil.copytree(good, tmp_path / "g")
    c = read_campaign(tmp_path / "g")
    test = c.tests[0]
    trace = c.traces[test.name]
    book = openpyxl.Workbook()
    book.active.append(["Time", "Deviation [µm]"])
    for t, d in zip(trace.time - trace.time[0], trace.deviation, strict=True):
        book.active.append([dt.datetime(2024, 5, 1) + dt.timedelta(seconds=float(t)), float(d / 1e-6)])
    book.save(tmp_path / "run.xlsx")
    done = import_trace(tmp_path / "g", tmp_path / "run.xlsx", test=test.name, preview=True, check=False)
    np.testing.assert_allclose(done.trace.deviation, trace.deviation, atol=1e-9)


# --- controls --------------------------------------------------------------------------------------------------------


def sinumerik():
    """A trace as SINUMERIK Operate saves it, of axis 7: measured positions at every second record only."""
    said = [
        ("s1", "f1", "Position setpoint (64 bit)", "/Nck/!SD/nckServoDataCmdPos2ndEnc64 [u1, 7]", "posn"),
        ("s2", "f2", "Actual position value for measuring system 1.", "/Nck/!SEMA/measPos1 [u1, 7]", "posn"),
        ("s3", "f3", "Actual position value for measuring system 2.", "/Nck/!SEMA/measPos2 [u1, 7]", "posn"),
        (
            "s4",
            "f4",
            "Velocity setpoint controller input (64 bit)",
            "/Nck/!SD/nckServoDataCmdVelCtrlIn64 [u1, 7]",
            "velo",
        ),
        ("s5", "f5", "Axis status", "/Channel/!SEMA/aaStat [u1, 7]", "none"),
    ]
    signals = "".join(f'<signal key="{k}" description="{d}" name="{n}" unitsType="{u}"/>' for k, _, d, n, u in said)
    data = "".join(f'<dataSignal id="{i}" key="{k}" name="{n}" unitsType="{u}"/>' for k, i, _, n, u in said)
    recs = []
    for i in range(N):
        held = f'f2="{ACTUAL[i]:.6f}" f3="{ACTUAL[i] + 0.5:.6f}"' if i % 2 == 0 else ""
        own = f'f1="{COMMAND[i]:.6f}" f4="{RATE[i] / 6:.6f}" {held}' + (' f5="4"' if i == 0 else "")
        recs.append(f'<rec time="{TIME[i]:.6f}" {own}/>')
    body = f"<traceDisplaySetup_V20><signals>{signals}</signals></traceDisplaySetup_V20>"
    return f"<traceSession>{body}<traceData><dataFrame>{data}{''.join(recs)}</dataFrame></traceData></traceSession>"


def test_sinumerik_trace_of_one_rotary_axis(tmp_path):
    """Axis number, both encoders and the velocity in rpm without a hand-set number; held positions are released."""
    (tmp_path / "t.xml").write_text(sinumerik())
    done = import_log(campaign(tmp_path, "C"), tmp_path / "t.xml")
    assert [(c.axis, c.signal, c.unit) for c in done.columns if c.axis] == [
        ("C", "command", "deg"), ("C", "actual", "deg"), ("C", "load", "deg"), ("C", "velocity_command", "rpm"),
    ]  # fmt: skip
    assert any("axis 7 of the file is taken for C" in n for n in done.notes)
    assert any('"Axis status [u1, 7]"' in n for n in done.notes)
    recording = read_campaign(tmp_path / "c").traces["t"]
    assert dict(recording.held) == {("C", "actual"): 2, ("C", "load"): 2}
    got = recording.axes["C"]
    np.testing.assert_allclose(got.velocity_command, RATE * DEG, atol=1e-6)
    np.testing.assert_allclose(got.actual[:-1], ACTUAL[:-1] * DEG, atol=6e-3 * DEG)  # 4 ms of a sine: ω² A t²/8
    status, said = run("check", tmp_path / "c")
    assert status == 0 and "held" in said and "every second sample" in said and "4 ms" in said


def test_the_axis_of_a_file_can_be_said(tmp_path):
    (tmp_path / "t.xml").write_text(sinumerik())
    folder = campaign(tmp_path, "XC")
    with pytest.raises(InputError, match="no column names an axis"):
        import_log(folder, tmp_path / "t.xml")
    status, said = run("import", tmp_path / "t.xml", "--campaign", folder, "--log", "--file-axis", "7=C")
    assert status == 0, said
    assert read_campaign(folder).tests[0].axes == ("C",)
    with pytest.raises(InputError, match="an axis of the file \\(7\\)"):
        import_log(folder, tmp_path / "t.xml", "u", options=Options(axes=(("8", "C"),)))


def edge(gap=0):
    names = ["CYCLE", "DES_POS|1", "ENC_POS|1", "TORQUE|1", "CMD_SPEED|1", "DES_POS|6", "ENC_POS|6"]
    axes = ["Cycle", *["X1"] * 4, "SP1", "SP1"]
    listed = [{"Name": n, "Type": "DOUBLE", "Axis": a, "Address": n} for n, a in zip(names, axes, strict=True)]
    rows = [[1000 + i + gap * (i >= 200), COMMAND[i], ACTUAL[i], 0.1 * i, 1.17 * RATE[i], 0.0, 0.0] for i in range(N)]
    payload = [{"HFData": rows[:150]}, {"HFBlockEvent": {"GCode": "G1"}}, {"HFData": rows[150:]}]
    return json.dumps({"Header": {"CycleTimeMs": 2, "SignalListHFData": listed}, "Payload": payload})


def test_sinumerik_edge_capture(tmp_path):
    """Axes by their names, lost cycles as a gap; a velocity in no known unit is not taken; the spindle is left out."""
    (tmp_path / "e.json").write_text(edge(gap=3860))
    done = import_log(campaign(tmp_path, "XZ"), tmp_path / "e.json")
    assert done.tests == ("e-1", "e-2") and done.rate == pytest.approx(500.0)
    said = " ".join(done.notes)
    assert "7.722 s without a sample" in said and "1.17" in said and "does not have: SP1" in said
    got = record(tmp_path / "c", "e-2", "X")
    np.testing.assert_allclose(got.actual, ACTUAL[200:] * MM, atol=1e-10)
    np.testing.assert_allclose(got.torque, 0.1 * np.arange(200, N), rtol=1e-6)
    (tmp_path / "bad.json").write_text(edge().replace('"HFData"', '"Nothing"'))
    with pytest.raises(InputError, match="HFData has no rows"):
        import_log(tmp_path / "c", tmp_path / "bad.json")


@pytest.mark.parametrize("where", ["channel", "global"])
def test_tncscope_rows_follow_the_sampling(tmp_path, where):
    """The cycle of a current is that of its controller: the rows come by SAMPLING, here 3 ms."""
    lines = ["%TNCscopeNT data file", "%[GLOBAL]", "%VERSION=2.0", *(["%SAMPLING=3000"] if where == "global" else [])]
    for kind, unit in (("s ist", "mm"), ("s soll", "mm"), ("v soll", "mm/min"), ("I ist", "Ampere")):
        cycle = 100 if unit == "Ampere" else 3000
        lines += ["%[CURVE1]", f"%CHANNELTYPE={kind}", "%AXISTYPE=Y", f"%DIMENSION={unit}", f"%COUNT={N}"]
        lines += [f"%CYCLETIME={cycle}", *(["%SAMPLING=3000"] if where == "channel" else [])]
    lines.append("%[DATA]")
    rate = np.gradient(COMMAND, 0.003 * np.arange(N))
    lines += [
        f" {3000.0 * i:.9e}; {ACTUAL[i]:.9e}; {COMMAND[i]:.9e}; {60 * rate[i]:.9e}; {0.01 * i:.9e}; " for i in range(N)
    ]
    (tmp_path / "y.sco").write_text("\n".join(lines) + "\n")
    done = import_log(campaign(tmp_path, "Y"), tmp_path / "y.sco")
    assert done.rate == pytest.approx(1 / 0.003) and done.samples == N
    got = record(tmp_path / "c", "y", "Y")
    np.testing.assert_allclose(got.current, 0.01 * np.arange(N), atol=1e-6)
    np.testing.assert_allclose(got.velocity_command, rate * MM, rtol=1e-5, atol=1e-7)


def test_epics_values_come_at_times_of_their_own(tmp_path):
    """camonitor and arget; the slower variable keeps its last value."""
    start = dt.datetime(2024, 5, 1, 23, 59, 59, 900000)
    for name, line in (("cam", "{pv} {date} {time} {value}"), ("arget", "{short} {time} {pv} {value}")):
        rows = []
        for i, t in enumerate(TIME):
            at = start + dt.timedelta(seconds=float(t))
            date, time = at.strftime("%Y-%m-%d"), at.strftime("%H:%M:%S.%f")
            for pv, value in (("M1:C.VAL", COMMAND[i]), *([("M1:C.RBV", ACTUAL[i])] if i % 4 == 0 else [])):
                rows.append(line.format(pv=pv, date=date, short=date[5:], time=time, value=f"{value:.5f}"))
        path = tmp_path / f"{name}.txt"
        path.write_text("\n".join(rows) + "\n")
        folder = tmp_path / "c" if (tmp_path / "c").exists() else campaign(tmp_path, "C")
        done = import_log(folder, path, signals=("C_command=M1:C.VAL:deg", "C_actual=M1:C.RBV:deg"))
        assert done.rate == pytest.approx(500.0, rel=1e-4) and done.samples == N
        got = record(folder, name, "C")
        np.testing.assert_allclose(got.command, COMMAND * DEG, atol=1e-6)
        np.testing.assert_allclose(got.actual[: N - 4 : 4], ACTUAL[: N - 4 : 4] * DEG, atol=1e-6)


def test_epics_archiver_table(tmp_path):
    """A time and a column for each variable, with gaps marked as no number; slow sampling is no mistake."""
    head = ["; Generated by an archive export", "# Time\tC:SET [deg]\tC:RBV [deg]"]
    rows = [
        f"05/01/2024 {10 + i // 360:02d}:{i // 6 % 60:02d}:{10 * (i % 6):02d}.000000000\t{0.1 * i:.4f}\t"
        + ("#N/A" if i == 7 else f"{0.1 * i - 0.02:.4f}")
        for i in range(N)
    ]
    path = tmp_path / "arch.txt"
    path.write_text("\n".join([*head, *rows]) + "\n")
    done = import_log(campaign(tmp_path, "C"), path, signals=("C_command=2:deg", "C_actual=3:deg"))
    assert done.rate == pytest.approx(0.1) and done.samples == N - 1
    status, said = run("check", tmp_path / "c")
    assert status == 0 and "1 samples are missing" in said


def guide_log(error, time, rate=5.0, scale=2.0, dec=60.0, aggression=0.7):
    """A PHD2 log: what a guider does with an error (arc seconds of the axis) of a mount, and one dither."""
    rows, pulses, moved = [], 0.0, 0.0
    for i, (t, e) in enumerate(zip(time, error * np.cos(np.radians(dec)) / scale, strict=True), start=1):
        seen = e - pulses - moved
        ms = round(1e3 * abs(aggression * seen) / rate)
        way = "W" if seen > 0 else "E"
        rows.append(f'{i},{t:.3f},"Mount",0.0,0.0,{seen:.6f},0.0,0.0,0.0,{ms},{way if ms else ""},0,,,,1000,20.0,0')
        pulses += np.sign(seen) * ms * 1e-3 * rate
        if i == len(time) // 2:
            moved = 3.0
            rows.append("INFO: DITHER by 3.000, 0.500, new lock pos = 10.0, 10.0")
    head = [
        "PHD2 version 2.6.3, Log version 2.5. Log enabled at 2017-02-07 19:00:00", "",
        "Guiding Begins at 2017-02-07 19:09:49", f"Pixel scale = {scale} arc-sec/px, Binning = 1",
        f"Mount = mount,  connected, xAngle = 0.0, xRate = {rate:.3f}, yAngle = 90.0, yRate = {rate:.3f},",
        f"Dec = {dec} deg, Hour angle = 1.0 hr, Pier side = West, Rotator pos = N/A",
        "Frame,Time,mount,dx,dy,RARawDistance,DECRawDistance,RAGuideDistance,DECGuideDistance,RADuration,RADirection,"
        "DECDuration,DECDirection,XStep,YStep,StarMass,SNR,ErrorCode",
    ]  # fmt: skip
    return "\n".join([*head, *rows, "Guiding Ends at 2017-02-07 21:00:00"]) + "\n"


def test_a_guide_log_without_its_pulses(tmp_path):
    """Distance and pulses add up to what the axis did by itself, in degrees of the axis, over dithers."""
    time = 2.0 * np.arange(1, N + 1)
    error = 8.0 * np.sin(2 * np.pi * time / 300.0)
    (tmp_path / "g.txt").write_text(guide_log(error, time))
    done = import_log(campaign(tmp_path, "C"), tmp_path / "g.txt")
    assert done.rate == pytest.approx(0.5) and any("1 moves of the lock" in n for n in done.notes)
    assert not done.questions  # the motor is taken to follow its command; the star was measured
    got = record(tmp_path / "c", "g", "C")
    np.testing.assert_allclose((got.load - got.actual) / DEG * 3600, error, atol=0.01)
    assert (got.command[-1] - got.command[0]) / DEG == pytest.approx((time[-1] - time[0]) / 86164.0905 * 360, rel=1e-6)


def run(*arguments):
    result = CliRunner().invoke(main, list(map(str, arguments)))
    return result.exit_code, result.output


def test_a_new_campaign_of_logs_takes_its_rate_from_the_first_file(tmp_path):
    folder = tmp_path / "c"
    status, said = run("new", "campaign", folder, "--logs", "C")
    assert status == 0 and "--log --preview" in said
    rows = [f"{i};{c:.5f};{a:.5f}" for i, (c, a) in enumerate(zip(COMMAND, ACTUAL, strict=True))]
    (tmp_path / "a.csv").write_text("\n".join(["Zeit [ms];Soll [deg];Ist [deg]", *rows]) + "\n")
    status, said = run("import", tmp_path / "a.csv", "--campaign", folder, "--log")
    assert status == 0, said
    assert read_campaign(folder).instruments["axis_log"].rate == pytest.approx(1000.0)
    status, said = run("check", folder)
    assert status == 0 and "No mistake" in said


def test_formats_are_told_by_their_beginning(tmp_path):
    """A guide log, a capture and a monitor are known whatever their files are called."""
    (tmp_path / "a").write_text(guide_log(np.ones(N), 2.0 * np.arange(N)))
    (tmp_path / "b").write_text(edge())
    assert "PHD2" in read_any(tmp_path / "a", Options()).notes[0]
    assert "Edge" in read_any(tmp_path / "b", Options()).notes[0]
