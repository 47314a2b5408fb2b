"""Axis logs in a campaign: what the files may hold, and what is refused with which sentence."""

import gzip

import numpy as np
import pytest

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_document, read_machine
from mjsim.commands.axis_log.compare import checked_logs
from mjsim.errors import InputError, SimulationError
from mjsim.instruments.axis_log.measurement import circle_part, radial_deviation, recorded_axes
from mjsim.machine.model import build
from mjsim.simulation.stability import check_stable

MACHINE = """\
name = "table"
configuration = "XY"

[identify]
factor = 5.0

[drive.X]
lead_mm = 10.0
inertia_kgm2 = 0.0004
viscous_Nms_per_rad = 0.009   # from the sheet

[drive.Y]
lead_mm = 10.0
inertia_kgm2 = 0.0003
viscous_Nms_per_rad = 0.009

[controller.slow.X]
position_gain_per_s = 45.0
velocity_gain_Nms_per_rad = 0.05
integral_time_s = 0.08
velocity_feedforward = 1.0
torque_lag_s = 0.003
sample_time_s = 0.001

[controller.slow.Y]
R = [1.0]
S = [1.25]
T = [1.25]
sample_time_s = 0.001
clip_V = 5.0
torque_per_V = 0.64
"""
CAMPAIGN = """\
name = "table"

[instrument]
kind = "axis_log"
sample_rate_Hz = 1000.0
resolution_um = 0.1

[[test]]
name = "round"
kind = "log"
trace = "round.csv.gz"
axes = ["X", "Y"]
controller = "slow"
circle = { plane = "XY", centre_mm = [0.0, 0.0], radius_mm = 10.0, direction = "CCW" }
"""


def circle_csv(turns=1.1):
    time = np.arange(0.0, 2.0, 1e-3)
    phi = 2 * np.pi * turns * np.clip((time - 0.2) / 1.6, 0.0, 1.0)
    x, y = 10.0 * np.cos(phi), 10.0 * np.sin(phi)
    columns = [time, x, x + 0.001, y, y - 0.002 * np.sin(2 * phi)]
    rows = "\n".join(",".join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True))
    return f"time_s,X_command_mm,X_actual_mm,Y_command_mm,Y_actual_mm\n{rows}\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "machine.toml").write_text(MACHINE)
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    (tmp_path / "round.csv.gz").write_bytes(gzip.compress(circle_csv().encode()))
    return tmp_path


def edit(folder, name, old, new):
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new))


def test_a_log_is_read(folder):
    campaign = read_campaign(folder)
    (test,) = campaign.measured
    recording = campaign.traces["round"]
    assert test.axes == recorded_axes(campaign.measured) == ("X", "Y") and test.setup == "round"
    assert recording.step == pytest.approx(1e-3) and len(recording.time) == 2000
    assert recording.axes["X"].command[0] == pytest.approx(0.01)
    assert campaign.instruments["axis_log"].resolution == pytest.approx(1e-7)


def test_controllers_are_read_and_written_back(folder):
    machine = read_machine(folder / "machine.toml")
    assert machine.factor == 5.0 and machine.controllers.keys() == {"slow"}
    x, y = (build(machine.under("slow")).axes[a] for a in "XY")
    assert (x.position_gain, x.feedforward, x.control.torque_lag) == (45.0, 1.0, 0.003)
    assert y.control.clip == pytest.approx(3.2) and y.control.law.S[0] * y.gear * 1e-3 == pytest.approx(1.25)
    assert machine_document(machine, machine.file) == MACHINE
    changed = machine.controllers["slow"] | {"X": machine.controllers["slow"]["X"].with_control(loop_delay=0.002)}
    machine.controllers["slow"] = changed
    text = machine_document(machine, machine.file)
    assert "loop_delay_s = 0.002" in text and "# from the sheet" in text


def test_a_slower_position_loop_is_read(folder):
    edit(folder, "machine.toml", "torque_lag_s = 0.003", "position_sample_time_s = 0.004")
    control = read_machine(folder / "machine.toml").controllers["slow"]["X"].control
    assert (control.sample_time, control.position_sample_time) == (0.001, 0.004)


def test_the_circle_of_a_log(folder):
    campaign = read_campaign(folder)
    test, recording = campaign.of("axis_log").tests[0], campaign.traces["round"]
    part = circle_part(test, recording)
    assert part.phi[-1] - part.phi[0] == pytest.approx(2.2 * np.pi, abs=0.05)
    x, y = (recording.axes[a].actual[part.samples] for a in "XY")
    deviation = radial_deviation(test.circle, x, y)
    phi = part.phi
    want = -2e-6 * np.sin(2 * phi) * np.sin(phi)
    basis = np.column_stack([np.cos(phi), np.sin(phi), np.ones_like(phi)])
    want -= basis @ np.linalg.lstsq(basis, want, rcond=None)[0]
    assert deviation == pytest.approx(want, abs=2e-9)


WRONG = [
    ("campaign.toml", 'axes = ["X", "Y"]', 'axes = ["X", "Z"]', "axes = .*allowed: each of X, Y"),
    ("campaign.toml", 'controller = "slow"', 'controllers = "slow"', "did you mean 'controller'"),
    ("campaign.toml", 'plane = "XY"', 'plane = "XX"', "two linear axes"),
    ("machine.toml", "R = [1.0]\n", "", "key 'R' is missing"),
    ("machine.toml", "position_gain_per_s = 45.0\n", "", "key 'position_gain_per_s' is missing"),
    ("machine.toml", "R = [1.0]", "position_gain_per_s = 4.0\nR = [1.0]", "allowed: a law R, S, T or the gains"),
    ("machine.toml", "clip_V = 5.0", "clip_V = 5.0\nclip_Nm = 5.0", "one of the two"),
    ("machine.toml", "torque_lag_s = 0.003", "position_sample_time_s = 0.0015", "multiples of sample_time_s, 0.001"),
    ("machine.toml", "torque_lag_s = 0.003", "position_sample_time_s = 0.05", "below 2 / position_gain_per_s, 0.044"),
    ("machine.toml", "clip_V = 5.0", "clip_V = 5.0\nposition_sample_time_s = 0.002", "whose set-points it holds"),
    ("machine.toml", "[controller.slow.Y]", "[controller.slow.Z]", "unknown key 'Z'"),
]


@pytest.mark.parametrize(("name", "old", "new", "said"), WRONG)
def test_wrong_tables(folder, name, old, new, said):
    edit(folder, name, old, new)
    with pytest.raises(InputError, match=said):
        read_campaign(folder)
        read_machine(folder / "machine.toml")


COLUMNS = "time_s,X_command_mm,X_actual_mm,Y_command_mm,Y_actual_mm"
WRONG_TRACES = [
    (COLUMNS, "t,X_command_mm,X_actual_mm,Y_command_mm,Y_actual_mm", "line 1: the first column is 't'"),
    (COLUMNS, "time_s,X_command_mm,X_actual_mm,Y_command_mm,Y_acutal_mm", "column 'Y_acutal_mm'; allowed"),
    (COLUMNS, "time_s,X_command_mm,X_actual_mm,Y_command_mm,Y_load_mm", "column Y_actual_mm is missing"),
    (COLUMNS, "time_s,X_command_deg,X_actual_deg,Y_command_mm,Y_actual_mm", "linear axis is in mm"),
    ("0.003000,", "0.003000,x,", "line 5: 6 columns"),
    ("0.003000,", "0.001500,", "line 5: time_s = 0.0015 after 0.002"),
    ("0.003000,10", "0.003000,ten", "line 5: X_command_mm = 'ten.000000'; allowed: a number"),
]


@pytest.mark.parametrize(("old", "new", "said"), WRONG_TRACES)
def test_wrong_traces(folder, old, new, said):
    text = circle_csv()
    assert old in text
    (folder / "round.csv.gz").write_bytes(gzip.compress(text.replace(old, new, 1).encode()))
    with pytest.raises(InputError, match=said):
        read_campaign(folder)


def test_time_in_samples_is_refused(folder):
    text = circle_csv().splitlines()
    counted = [text[0], *(f"{i},{line.partition(',')[2]}" for i, line in enumerate(text[1:]))]
    (folder / "round.csv.gz").write_bytes(gzip.compress("\n".join(counted).encode()))
    with pytest.raises(InputError, match="time_s is in ms, or say --as-is"):
        checked_logs(read_campaign(folder), read_machine(folder / "machine.toml"))


def test_a_circle_that_is_not_there(folder):
    edit(folder, "campaign.toml", "radius_mm = 10.0", "radius_mm = 11.0")
    campaign = read_campaign(folder)
    with pytest.raises(InputError, match="check centre_mm and radius_mm"):
        circle_part(campaign.of("axis_log").tests[0], campaign.traces["round"])
    edit(folder, "campaign.toml", 'radius_mm = 11.0, direction = "CCW"', 'radius_mm = 10.0, direction = "CW"')
    with pytest.raises(InputError, match="runs round its circle CCW"):
        circle_part(read_campaign(folder).of("axis_log").tests[0], campaign.traces["round"])


def test_ball_bar_simulations_refuse_what_they_cannot_compute(folder):
    with pytest.raises(SimulationError, match="axis logs only"):
        check_stable(build(read_machine(folder / "machine.toml").under("slow")))
