"""Axis logs as controls save them: small files in the layout that public readers agree on."""

import shutil

import numpy as np
import pytest

from mjsim.campaign.files import read_campaign
from mjsim.errors import InputError
from mjsim.importing.formats import read_any
from mjsim.importing.logs import columns_of, import_log
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.machine.chain import FIVE_AXIS, chain_of
from tests.independent.logs import CAMPAIGN, Axis, Control, machine_toml, record, to_and_fro

N = 400


@pytest.fixture(scope="module")
def motion():
    """Command and actual position of an axis, mm."""
    command = to_and_fro()[:N]
    actual, _ = record(Axis(coulomb=0.1), Control(), command)
    return 1e3 * command, 1e3 * actual


@pytest.fixture
def folder(tmp_path):
    axis, control = Axis(), Control()
    (tmp_path / "machine.toml").write_text(machine_toml(axis, control, identify=False, friction=0.1, integral_time=0.1))
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.replace('trace = "strokes.csv"\n', ""))
    return tmp_path


def sinumerik(command, actual):
    """The actual position changes at every instant; a command that stands still is left out."""
    rows = []
    for i, (a, b) in enumerate(zip(command, actual, strict=True)):
        same = i and f"{a:.6f}" == f"{command[i - 1]:.6f}"
        rows.append(f'<rec time="{0.002 * i:.3f}"{"" if same else f" f1={chr(34)}{a:.6f}{chr(34)}"} f2="{b:.6f}"/>')
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<traceSession version="2.0"><traceDisplaySetup_V20><signals>'
        '<signal key="k1" name="/Nck/nckServoDataPosCmd[u1, 1]" description="X Position setpoint" color="00ff0000"/>'
        '<signal key="k2" name="/Nck/nckServoDataPosAct[u1, 1]" description="X Position actual value" color="0"/>'
        '</signals></traceDisplaySetup_V20><traceData dataFrames="1"><dataFrame>'
        '<frameHeader startTime="2024-05-02T13:56:24" stopInc="0.8" dropOuts="0"/>'
        '<dataSignal id="f1" key="k1" interval="0.002"/><dataSignal id="f2" key="k2" interval="0.002"/>'
        + "\n".join(rows)
        + "</dataFrame></traceData></traceSession>\n"
    )


def twincat(command, actual, separator="\t", decimal=",", ticks=False):
    """Two blocks: the positions every millisecond, a temperature every 5 ms."""
    head = [
        ["Name", "table"], ["File", "x.csv"],
        ["Starttime of export", "132959733843760000", "Montag, 2. Mai 2022", "15:56:24.376"],
        ["Endtime of export", "132959733853750000", "Montag, 2. Mai 2022", "15:56:25.375"], [], [],
        ["Name", "AxisX.SetPos", "AxisX.ActPos", "Name", "Temperature"],
        ["SymbolComment", "", "", "SymbolComment", ""],
        ["SampleTime[ms]", "1", "1", "SampleTime[ms]", "5"],
        ["Unit", "mm (Length)", "mm (Length)", "Unit", "(None)"], [],
    ]  # fmt: skip
    for i, (a, b) in enumerate(zip(command, actual, strict=True)):
        time = f"{132959733843760000 + 10_000 * i}" if ticks else f"{i}"
        slow = [f"{5 * i}", "20.5"] if i < N // 5 else []
        head.append([time, f"{a:.6f}", f"{b:.6f}", *slow])
    text = "\n".join(separator.join(r) for r in head[:4]) + "\n\n\n"
    table = "\n".join(separator.join(r) for r in head[6:])
    return text + (table if decimal == "." else table.replace(".", ",").replace("AxisX,", "AxisX.")) + "\nEOF\n"


def tncscope(command, actual):
    """Positions every 0.6 ms, a current every 1.2 ms."""

    def curve(number, kind, unit, count, cycle):
        keys = {"CHANNELTYPE": kind, "AXISTYPE": "X", "DIMENSION": unit, "COUNT": count, "CYCLETIME": cycle}
        return [f"%[CURVE{number}]", *(f"%{k}={v}" for k, v in keys.items()), "%"]

    lines = ["%[GLOBAL]", "%VERSION=1", "%", *curve(1, "s nominal", "mm", N, 600), *curve(2, "s actual", "mm", N, 600)]
    lines += [*curve(3, "I nominal", "A", N // 2, 1200), "%[DATA]"]
    rows = zip(command, actual, strict=True)
    lines += [f"{600 * i};{a:.6f};{b:.6f};{0.5 if i < N // 2 else 0.0};" for i, (a, b) in enumerate(rows)]
    return "\n".join(lines) + "\n"


CASES = {
    "trace.xml": (sinumerik, 500.0),
    "scope.csv": (twincat, 1000.0),
    "servo.sco": (tncscope, 1.0 / 0.6e-3),
}


@pytest.mark.parametrize("name", CASES)
def test_a_file_of_the_maker_into_a_campaign(folder, motion, name):
    """Columns, units and times are found, without an option."""
    write, rate = CASES[name]
    (folder / name).write_text(write(*motion), encoding="cp1252")
    options = ("X_command=2:mm", "X_actual=3:mm") if name == "trace.xml" else ()  # it has no units
    done = import_log(folder, folder / name, signals=options, controller="c")
    assert done.rate == pytest.approx(rate) and done.samples == N
    assert {(c.axis, c.signal) for c in done.columns} == {("", "time"), ("X", "command"), ("X", "actual")}
    record = read_campaign(folder).traces[done.test].axes["X"]
    np.testing.assert_allclose(record.command, motion[0] * 1e-3, atol=1e-9)
    np.testing.assert_allclose(record.actual, motion[1] * 1e-3, atol=1e-9)


def test_a_sinumerik_trace_says_what_it_has(tmp_path, motion):
    (tmp_path / "t.xml").write_text(sinumerik(*motion))
    table = read_any(tmp_path / "t.xml", Options())
    assert table.names == ("time", "X Position setpoint [u1, 1]", "X Position actual value [u1, 1]")
    assert "units are not in the file" in " ".join(table.notes)
    with pytest.raises(InputError, match=r"command position of X\) has no unit; say --signal X_command=2:mm"):
        columns_of(table, FIVE_AXIS, (), Options())
    for broken, said in (("<a>", "no readable XML"), ("<a/>", "no trace of a SINUMERIK")):
        (tmp_path / "t.xml").write_text(broken)
        with pytest.raises(InputError, match=said):
            read_any(tmp_path / "t.xml", Options())
    (tmp_path / "t.xml").write_text('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>')
    with pytest.raises(InputError, match="entities"):
        read_any(tmp_path / "t.xml", Options())


@pytest.mark.parametrize(("separator", "decimal"), [("\t", ","), (";", "."), (",", "."), (";", ",")])
@pytest.mark.parametrize("ticks", [False, True])
def test_every_kind_of_twincat_export(tmp_path, motion, separator, decimal, ticks):
    (tmp_path / "s.csv").write_text(twincat(*motion, separator, decimal, ticks))
    table = read_any(tmp_path / "s.csv", Options())
    assert table.names == ("time", "AxisX.SetPos", "AxisX.ActPos") and table.units == ("ms", "mm", "mm")
    np.testing.assert_allclose(table.values[:, 0], np.arange(N), atol=1e-9)
    np.testing.assert_allclose(table.values[:, 2], motion[1], atol=1e-6)
    assert "1 channels with other times left out" in table.notes


def test_wrong_tnc_files(tmp_path, motion):
    good = tncscope(*motion)
    for bad, said in (
        (good.replace("%[DATA]", ""), "no %.CURVE. sections"),
        (good.replace("%CYCLETIME=1200", "%CYCLETIME=0"), "%CYCLETIME='0'; allowed: a number above 0"),
        (good.replace("600;", "600;x", 1), "no row of numbers"),
        (good.replace(";0.5;", ";", 3), "no row of numbers|rows of another length"),
    ):
        (tmp_path / "s.sco").write_text(bad)
        with pytest.raises(InputError, match=said):
            read_any(tmp_path / "s.sco", Options())


def test_halsampler_with_sample_numbers(folder, motion):
    rows = [f"{i + 17} {a:.6f} {b:.6f} " for i, (a, b) in enumerate(zip(*motion, strict=True))]
    (folder / "h.txt").write_text("\n".join(rows) + "\n")
    table = read_any(folder / "h.txt", Options())
    assert table.names == ("sample", "pin 0", "pin 1")
    signals = ("X_command=pin 0:mm", "X_actual=pin 1:mm")
    with pytest.raises(InputError, match="--rate HZ"):
        import_log(folder, folder / "h.txt", signals=signals, controller="c")
    done = import_log(folder, folder / "h.txt", signals=signals, controller="c", options=Options(rate=1000.0))
    assert done.samples == N and done.rate == pytest.approx(1000.0)
    (folder / "h.txt").write_text("\n".join([*rows[:50], "overrun", *rows[60:]]) + "\n")
    with pytest.raises(InputError, match=r"line 51: the recorder lost samples \(1 times\)"):
        read_any(folder / "h.txt", Options())
    assert len(read_any(folder / "h.txt", Options(rows=(1, 50))).values) == 50
    (folder / "h.txt").write_text("\n".join([*rows[:50], *rows[60:]]) + "\n")
    with pytest.raises(InputError, match="line 51: the number of the sample does not count on"):
        read_any(folder / "h.txt", Options())


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("Z velocity command [mm/s]", ("Z", "velocity_command")),
        ("Z Drehzahl Istwert", ("Z", "velocity")),
        ("Z_velocity_command_mm_per_s", ("Z", "velocity_command")),
        ("X velocity command [mm/s]", None),
        ("Z acceleration command", None),
        ("Lagesollwert X [mm]", ("X", "command")),
        ("s actual Y [mm]", ("Y", "actual")),
        ("v actual Z [mm/min]", ("Z", "velocity")),
        ("Torque Z [Nm]", ("Z", "torque")),
        ("Torque Z [%]", ("Z", "torque")),
        ("Z_load_mm", ("Z", "load")),
        ("Load Z [%]", None),
        ("Torque setpoint Z [Nm]", None),
        ("Torque Z", None),
        ("Current Z [A]", ("Z", "current")),
    ],
)
def test_what_a_columns_name_says(tmp_path, name, found):
    """A velocity is no position, a torque without a unit is not taken, and neither is an axis without a position."""
    names = ("time_s", "Z soll [mm]", "Z ist [mm]", name)
    values = np.zeros((3, 4))
    table = Table(tmp_path, names, ("",) * 4, values, np.arange(3), (), ())
    try:
        columns, _ = columns_of(table, FIVE_AXIS, (), Options())
    except InputError as error:  # one position of an axis without the other
        assert found is not None and found[1] in ("command", "actual") and "no " in str(error)
        return
    assert [(c.axis, c.signal) for c in columns if c.place == 3] == ([] if found is None else [found])


def test_a_following_error_stands_for_the_other_position(folder, motion):
    """Command less actual position, in another unit than the position; where both are there it is not needed."""
    from_actual = ("t [ms];X ist [mm];Schleppabstand X [µm]", motion[1], 1e3 * (motion[0] - motion[1]))
    from_command = ("t [ms];X soll [mm];X following error [um]", motion[0], 1e3 * (motion[0] - motion[1]))
    for name, (head, position, lag) in {"a": from_actual, "b": from_command}.items():
        rows = [f"{i};{p:.7f};{e:.5f}" for i, (p, e) in enumerate(zip(position, lag, strict=True))]
        (folder / f"{name}.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
        done = import_log(folder, folder / f"{name}.csv", controller="c")
        assert "following error" in done.notes[-1]
        record = read_campaign(folder).traces[name].axes["X"]
        np.testing.assert_allclose(record.command, motion[0] * 1e-3, atol=1e-9)
        np.testing.assert_allclose(record.actual, motion[1] * 1e-3, atol=1e-9)
    names = ("t [s]", "X soll [mm]", "X ist [mm]", "X lag [mm]")
    table = Table(folder, names, ("",) * 4, np.zeros((3, 4)), np.arange(3), (), ())
    assert [c.signal for c in columns_of(table, FIVE_AXIS, (), Options())[0]] == ["time", "command", "actual"]


@pytest.mark.parametrize(
    ("signal", "said"),
    [
        ("X_command=2:furlong", "allowed units for command of X: um, mm, inch, mil, uin"),
        ("A_command=2:mm", "allowed units for command of A: deg, rad"),
        ("X_torque=2:kg", "allowed units for torque of X: Nm, mNm, %"),
    ],
)
def test_units_that_cannot_be(tmp_path, signal, said):
    table = Table(tmp_path, ("t [s]", "b"), ("",) * 2, np.zeros((3, 2)), np.arange(3), (), ())
    with pytest.raises(InputError, match=said):
        columns_of(table, FIVE_AXIS, (signal,), Options())


def test_one_axis_need_not_be_named(tmp_path):
    table = Table(tmp_path, ("t [s]", "Soll [mm]", "Ist [mm]"), ("",) * 3, np.zeros((3, 3)), np.arange(3), (), ())
    columns, _ = columns_of(table, chain_of("X"), (), Options())
    assert [(c.axis, c.signal) for c in columns] == [("", "time"), ("X", "command"), ("X", "actual")]
    with pytest.raises(InputError, match="no column names an axis"):
        columns_of(table, FIVE_AXIS, (), Options())


def test_an_untagged_table_is_a_table(folder, motion):
    rows = [f"{a:.6f} {b:.6f}" for a, b in zip(*motion, strict=True)]
    (folder / "h.txt").write_text("\n".join(rows) + "\n")
    assert read_any(folder / "h.txt", Options()).names == ("", "")
    shutil.copy(folder / "h.txt", folder / "h.log")
    assert len(read_any(folder / "h.log", Options()).values) == N
