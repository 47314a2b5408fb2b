"""LinuxCNC as a real control: what it tells the axes, as a commanded motion and as an axis log; the model of its block
times; programs that it does not shorten.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from mjsim.campaign.driven import with_record
from mjsim.campaign.files import read_campaign
from mjsim.cli.main import main
from mjsim.errors import InputError
from mjsim.instruments.axis_log.files import read_recording
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.kinds import KINDS
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.resources import examples
from mjsim.linuxcnc import inside
from mjsim.linuxcnc.configuration import Settings, check_settings, kinematics, write_configuration
from mjsim.linuxcnc.record import Record, held_against
from mjsim.linuxcnc.run import _Busy, _starved, missing, run_program
from mjsim.machine.chain import FIVE_AXIS, Placement, chain_of
from mjsim.nc.control import block_times, linuxcnc
from mjsim.nc.read import parse_nc
from mjsim.nc.write import Options, nc_program
from mjsim.units import DEG, MM

UNITS = np.array([MM, MM, MM, DEG, DEG])
#: What LinuxCNC 2.9.0~pre1 made of 200 blocks of C with 20 000 °/s²: step °, asked ms, mean of what it took ms.
MEASURED = [
    (0.3, 10.01, 10.0), (0.3, 10.95, 10.0), (0.3, 9.99, 9.0), (0.3, 20.2, 20.0), (0.3, 8.1, 8.0), (0.4, 6.8, 6.5),
    (0.05, 0.5, 2.5), (0.1, 0.5, 3.5), (0.15, 0.5, 4.0), (0.2, 0.5, 4.833), (0.25, 0.5, 5.217), (0.3, 3.2, 5.658),
    (0.4, 0.5, 6.5), (0.6, 0.5, 8.0),
]  # fmt: skip


def run(*arguments):
    result = CliRunner().invoke(main, list(map(str, arguments)))
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def cone():
    c = read_campaign(examples() / "healthy", traces=False)
    test = next(t for t in c.tests if t.name == "cone15-x50-ccw")
    return replace(test, revolutions=1, feed=3000.0 * MM / 60.0)


def campaign(folder, feed=3000.0, more=""):
    """A campaign with one cone at a feed."""
    shutil.copy(examples() / "healthy" / "machine.toml", folder)
    (folder / "campaign.toml").write_text(
        f'name = "c"\n[[test]]\nname = "cone"\nkind = "cone_frustum"\ntable_ball_mm = [50.0, 0.0, 155.0]\n'
        f"bar_length_mm = 100.0\nfeed_mm_min = {feed}\nhalf_apex_deg = 15.0\ninclination_deg = 10.0\n"
        f'sensitive_direction = "perpendicular"\ndirection = "CCW"\nrevolutions = 1\n{more}'
    )
    return folder


def recorded(test, rest=0.3):
    """A log of a control that follows a test's own program, with a rapid approach and rest before and after."""
    program = Program(test)
    time = np.arange(0.0, program.duration, 1e-3)
    q = program.commands(time)
    near = np.linspace(0.0, 1.0, 400)[:, None] * q[0]
    return np.vstack([near, np.repeat(q[:1], int(rest * 1e3), axis=0), q, np.repeat(q[-1:], int(rest * 1e3), axis=0)])


def record_of(q, chain=FIVE_AXIS):
    kind = np.full(len(q), 2)
    return Record(q, q, np.ones(len(q), int), kind, chain, 0.0)


# -- the model of its block times --------------------------------------------------------------------------------------


def test_block_times_are_the_measured_ones():
    acceleration = 20_000.0 * UNITS
    for step, asked, took in MEASURED:
        points = np.zeros((11, 5))
        points[:, 4] = np.arange(11) * step * DEG
        motion = Commanded(np.full(10, asked * 1e-3), points)
        assert block_times(motion, linuxcnc(FIVE_AXIS, acceleration))[0] * 1e3 == pytest.approx(took, rel=0.07)
        if asked > 6.0:
            assert block_times(motion, linuxcnc(FIVE_AXIS, acceleration))[0] * 1e3 == pytest.approx(took, abs=1e-9)


def test_blocks_of_linear_axes_take_their_time():
    points = np.zeros((3, 5))
    points[:, 0] = np.arange(3) * 1.7 * MM
    motion = Commanded(np.array([0.01047, 0.0105]), points)
    assert block_times(motion, linuxcnc(FIVE_AXIS, np.ones(5))) == pytest.approx([0.01047, 0.0105])
    with pytest.raises(InputError, match="one for each of X, Y, Z, A, C"):
        linuxcnc(FIVE_AXIS, np.ones(3))


@pytest.mark.parametrize("feed", [700.0, 1000.0, 1234.5, 3000.0])
def test_programs_have_steps_that_are_not_shortened(cone, feed):
    """Every block lasts whole milliseconds and 0.2 ‰ to 1 ‰ more, and the test keeps its time."""
    test = replace(cone, feed=feed * MM / 60.0)
    written = nc_program(test, Options(dialect="linuxcnc"))
    cycles = written.motion.seconds[0] * 1e3
    assert 1e-4 < cycles / np.floor(cycles) - 1.0 < 1e-3
    plain = nc_program(test, Options(dialect="linuxcnc", whole_cycles=False)).motion
    assert written.motion.duration == pytest.approx(plain.duration, rel=1e-9)
    assert len(written.motion.seconds) >= len(plain.seconds)
    kept = block_times(written.motion, linuxcnc(FIVE_AXIS, 1e9 * UNITS)).sum()
    assert kept == pytest.approx(written.motion.duration, rel=1e-3)
    assert "G64 P0.001 Q0\n" in written.text


def test_tool_centre_programs_switch_the_kinematics(cone):
    text = nc_program(cone, Options(dialect="linuxcnc", feed="tcp", step_deg=1.0)).text
    lines = text.splitlines()
    assert lines.index("G0 A0. C0.") + 1 == lines.index("M428") < lines.index("M0") < lines.index("M429")
    assert "G43.4" not in text and "%" not in text
    assert parse_nc(text, Path("t.nc"), "linuxcnc").motion.tip


# -- a record as the commanded motion ----------------------------------------------------------------------------------


def test_a_record_of_the_tests_own_motion_is_that_motion(cone, tmp_path):
    """Approach and rest are left out, and the clock is that of the control."""
    (tmp_path / "r.csv").write_text(record_of(recorded(cone)).to_csv())
    driven, own = Program(with_record(tmp_path / "r.csv", cone)), Program(cone)
    assert driven.duration == pytest.approx(own.duration, abs=0.01)
    assert np.diff(driven.measured_span) == pytest.approx(np.diff(own.measured_span), abs=2e-3)
    time = np.linspace(1.0, own.duration - 1.0, 500)
    shift = driven.measured_span[0] - own.measured_span[0]
    assert np.abs(driven.commands(time + shift) - own.commands(time)).max() < 3e-6
    assert driven.test.feed == pytest.approx(cone.feed, rel=1e-3)


def test_a_record_is_an_axis_log(cone, tmp_path):
    record = record_of(recorded(cone))
    (tmp_path / "r.csv").write_text(record.to_csv())
    log = read_recording(tmp_path / "r.csv", LogTest("r", FIVE_AXIS.letters))
    assert log.step == pytest.approx(1e-3)
    for i, axis in enumerate(FIVE_AXIS.letters):
        assert np.ptp(log.axes[axis].command) == pytest.approx(np.ptp(record.told[record.feed, i]), abs=1e-9)
        assert (log.axes[axis].actual == log.axes[axis].command).all()
    (tmp_path / "r.csv").write_text(record.to_csv(record.told + 1e-4))
    log = read_recording(tmp_path / "r.csv", LogTest("r", FIVE_AXIS.letters))
    assert log.axes["X"].actual - log.axes["X"].command == pytest.approx(1e-4, abs=1e-9)


def test_driven_by_in_a_campaign(cone, tmp_path):
    folder = campaign(tmp_path, more='driven_by = "r.csv"\n')
    (folder / "r.csv").write_text(record_of(recorded(cone)).to_csv())
    assert read_campaign(folder, traces=False).tests[0].commanded.clocked
    (folder / "r.csv").write_text(record_of(recorded(cone) + 1.0).to_csv())
    with pytest.raises(InputError, match=r'r.csv: is no record of test "cone": nothing moves while'):
        read_campaign(folder, traces=False)
    campaign(tmp_path, more='driven_by = "r.csv"\nprogram = "p.nc"\n')
    with pytest.raises(InputError, match="program and driven_by; allowed: one of them"):
        read_campaign(folder, traces=False)


# -- the settings ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (Settings({"B": 100.0}), "no such axis; allowed: X, Y, Z, A, C"),
        (Settings({"X": 0.0}), "allowed: 1 to 1000000"),
        (Settings(speed=1000.0), "allowed: 0.1 to 50"),
        (Settings(corrections=Path("nowhere")), "no such folder"),
    ],
)
def test_settings_are_checked(settings, said):
    with pytest.raises(InputError, match=said):
        check_settings(settings, FIVE_AXIS)


def test_the_joints_are_the_axes_in_order(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "joints.ini").write_text("; said\n[JOINT_3]\nCOMP_FILE = comp-a.txt\nCOMP_FILE_TYPE = 1\n")
    (tmp_path / "in" / "comp-a.txt").write_text("0 0 0\n1 0 0\n")
    write_configuration(tmp_path, FIVE_AXIS, Settings({"A": 1234.0}, corrections=tmp_path / "in"), False)
    ini = (tmp_path / "machine.ini").read_text()
    joint = ini.partition("[JOINT_3]")[2].partition("[AXIS_C]")[0]
    assert "TYPE = ANGULAR" in joint and "COMP_FILE = comp-a.txt" in joint and (tmp_path / "comp-a.txt").exists()
    assert "MAX_ACCELERATION = 1234.000" in ini.partition("[AXIS_A]")[2].partition("[JOINT_3]")[0]
    assert kinematics(FIVE_AXIS, False) == "trivkins coordinates=XYZAC"
    with pytest.raises(InputError, match="no kinematics with tool centre point control"):
        kinematics(chain_of("XY"), True)


def test_a_missing_control_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    folder = campaign(tmp_path)
    status, said = run("control", "linuxcnc", folder, "--test", "cone", "-o", folder / "r.csv")
    assert status == 1 and not (folder / "r.csv").exists()
    assert said.startswith("mjsim: LinuxCNC cannot run here: the program linuxcncsvr (run: ") and said.count("\n") == 1


def test_a_record_that_depends_on_the_pace_is_not_taken():
    """A path of 1000 blocks of 10 cycles: 200 blocks are queued at its begin, and more as they are done."""
    line = np.concatenate([np.full(50, 2), np.repeat(np.arange(3, 1003), 10)])
    feed = np.arange(len(line)) >= 50

    def asked(every, stall=(0, 0), steady=False):
        """Cycles, blocks at the last addition and times; nothing is added in the stall."""
        out, end, told = [(10, 1, 0.0), (40, 200, 0.1)], 202, 200
        for cycle in range(50, len(line), every):
            more = min(1002, line[cycle] + 200 - (0 if steady else cycle % 7))
            if more > end and not stall[0] <= cycle < stall[1]:
                end = min(more, end + 80)  # it is filled in steps
                told = end - line[cycle]
            out.append((cycle + 1, told, 0.1 + 0.01 * cycle / every))
        return np.array(out, float)

    assert not _starved(line, feed, asked(200))
    assert not _starved(line, feed, asked(200, steady=True))  # as many blocks come as go
    assert not _starved(line, feed, asked(200, (3000, 3600)))
    assert _starved(line, feed, asked(200, (3000, 6000)))
    assert _starved(line, feed, asked(200, (3000, 6000), steady=True))
    assert not _starved(line, feed, asked(200, (9000, 20_000)))  # all blocks are there
    late = asked(200, (3000, 4900))
    late[late[:, 0] > 4800, 2] += 1.0  # nobody asked for a second
    assert _starved(line, feed, late)
    assert not _starved(line, np.zeros(len(line), bool), asked(200))


def test_a_control_that_is_stuck_is_started_again(monkeypatch):
    speeds = []

    def recorded(folder, chain, settings, faster):
        speeds.append(settings.speed)
        if len(speeds) < stuck:
            raise _Busy("it stands still at line 2 of the program")
        return record_of(np.zeros((2, 5)))

    monkeypatch.setattr("mjsim.linuxcnc.run.needed", lambda: None)
    monkeypatch.setattr("mjsim.linuxcnc.run._recorded", recorded)
    stuck = 2
    assert len(run_program("M30\n").told) == 2 and speeds == [20.0, 5.0]
    stuck = 9
    with pytest.raises(InputError, match=r"LinuxCNC: it stands still at line 2 of the program, also at 1 times"):
        run_program("M30\n")


@pytest.mark.parametrize(
    ("said", "again"), [("Queue is not empty after probing", True), ("Linear move on line 3 exceeds X", False)]
)
def test_what_only_a_busy_computer_makes_the_control_say_is_tried_again(said, again):
    messages = iter([(11, said)])
    loop = inside.Loop.__new__(inside.Loop)
    loop.c, loop.stream = SimpleNamespace(error=OSError), None
    loop.stat = SimpleNamespace(poll=lambda: None)
    loop.errors = SimpleNamespace(poll=lambda: next(messages, None))
    with pytest.raises(inside.Failure, match=said) as failure:
        loop.poll()
    assert isinstance(failure.value, inside.Stuck) == again


# -- the control itself ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def there():
    if what := missing():
        pytest.skip(f"LinuxCNC cannot run here: {what} is missing")


def test_linuxcnc_runs_a_test(there, tmp_path):
    """Through the command line: the record drives the test, and the model foretells its time, feed and deviation."""
    folder = campaign(tmp_path)
    where = (folder, "--test", "cone", "--step-deg", "0.3")
    status, said = run("control", "linuxcnc", *where, "-o", folder / "r.csv", "--json")
    assert status == 0, said
    data = json.loads(said)
    real, model = data["linuxcnc"], data["model"]
    assert real["duration_s"] == pytest.approx(model["duration_s"], rel=2e-3)
    assert 2800.0 < real["mean_mm_min"] < 2950.0  # blends of steps of 0.3° keep to 1 µm of the corners
    assert real["mean_mm_min"] == pytest.approx(model["mean_mm_min"], rel=2e-3)
    assert real["reading_um"]["min"] == pytest.approx(model["reading_um"]["min"], abs=0.1)
    for axis, value in real["position_um"].items():
        assert value == pytest.approx(model["position_um"][axis], abs=0.2)
    campaign(tmp_path, more='driven_by = "r.csv"\n')
    driven = Program(read_campaign(folder, traces=False).tests[0])
    assert driven.duration == pytest.approx(real["duration_s"], abs=0.01)
    like = ("--dialect", "linuxcnc", "--like", "linuxcnc", "--record", folder / "r.csv")
    status, said = run("nc", "feed", *where, *like, "--json")
    assert status == 0 and json.loads(said)["record"]["mean_mm_min"] == pytest.approx(real["mean_mm_min"], rel=1e-4)
    status, said = run("control", "linuxcnc", *where, "-o", folder / "r.csv")
    assert status == 1 and "--force" in said


def test_linuxcnc_slows_down_as_the_model_says(there, cone):
    """With 5 m/s² the blocks where C is fast take longer; with tool centre point control as well."""
    settings = Settings(dict.fromkeys(FIVE_AXIS.letters, 5000.0))
    how = Options(dialect="linuxcnc", feed="tcp", step_deg=0.3)
    written = nc_program(cone, how)
    held = held_against(cone, written.motion, run_program(written.text, FIVE_AXIS, settings, tip=True), settings)
    assert held.lasted > 1.02 * held.by_f
    assert held.model.duration == pytest.approx(held.lasted, rel=0.01)
    assert held.record.mean == pytest.approx(held.model.mean, rel=0.01)
    assert held.record.feed.min() == pytest.approx(held.model.feed.min(), rel=0.15)


def test_tool_centre_point_of_another_chain(there, cone):
    """xyzbc-trt-kins turns the tip as mjsim's kinematics do: the balls keep their distance to the chords."""
    chain = chain_of("w-C'B'X'bYZ-t")
    test = replace(next(iter(KINDS["cone_frustum"].proposals(chain, 0.1, 0.155))), revolutions=1, feed=cone.feed)
    written = nc_program(test, Options(dialect="linuxcnc", feed="tcp", step_deg=0.5))
    record = run_program(written.text, chain, Settings(), tip=True)
    held = held_against(test, written.motion, record, Settings())
    assert np.abs(held.record.reading).max() < 1.5e-6
    assert held.lasted == pytest.approx(held.model.duration, rel=0.01)


@pytest.mark.parametrize("feed", ["inverse", "tcp"])
def test_both_senses_of_the_axes(there, cone, feed):
    """The joints differ by the sign of what turns and by nothing else, with tool centre point control as well."""
    iso = chain_of(FIVE_AXIS.configuration, tuple((a, Placement(sense="iso")) for a in FIVE_AXIS.rotary))
    try:
        kinematics(iso, feed == "tcp")
    except InputError as error:
        pytest.skip(str(error))
    told, readings = [], []
    for chain in (FIVE_AXIS, iso):
        test = replace(cone, chain=chain)
        written = nc_program(test, Options(dialect="linuxcnc", feed=feed, step_deg=0.5))
        record = run_program(written.text, chain, Settings(), tip=feed == "tcp")
        told.append(record.told[record.feed])
        readings.append(held_against(test, written.motion, record, Settings()).record.reading)
    np.testing.assert_allclose(told[1], told[0] * [1, 1, 1, -1, -1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(readings[1], readings[0], rtol=0, atol=1e-12)
    assert np.abs(readings[0]).max() < 10e-6


def test_what_linuxcnc_refuses_is_one_sentence(there):
    with pytest.raises(InputError, match=r"LinuxCNC: .*(limit|exceed)"):
        run_program("G21 G90\nG0 X5000\nM0\nG1 X4000 F100\nM30\n", FIVE_AXIS)
