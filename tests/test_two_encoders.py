"""What stands between the encoders of motor and load: play, waves, scale, found in their difference alone."""

import json

import numpy as np
import pytest
import tomlkit
from click.testing import CliRunner
from independent import drives, machine_logs, machines

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.cli.main import main
from mjsim.commands.axis_log.diagnose import diagnose_logs
from tests.independent.logs import Axis, Control, csv, machine_toml, record, to_and_fro, write_campaign

FRICTION = Axis(coulomb=0.12)
STEP = 1e-7


def stuck(motor, width):
    """A load with much friction: it stays in the play until a flank takes it along."""
    out, y = np.empty(len(motor)), motor[0]
    for i, x in enumerate(motor):
        y = min(max(y, x - width / 2), x + width / 2)
        out[i] = y
    return out


def gliding(motor, step, width, brake):
    """A load that only a small force brakes while it is free: at the flanks it takes the motor's speed."""
    speed = np.diff(motor, prepend=motor[0]) / step
    out, y, v = np.empty(len(motor)), motor[0], 0.0
    for i, x in enumerate(motor):
        v -= np.sign(v) * min(brake * step, abs(v))
        y += v * step
        if abs(y - x) > width / 2:
            y, v = x + np.sign(y - x) * width / 2, speed[i]
        out[i] = y
    return out


@pytest.fixture
def folder(tmp_path):
    def make(load_of, control=None, letter="X"):
        control = control or Control(integral_time=0.04, feedforward=1.0)
        command = to_and_fro(control.sample)
        motor, _ = record(FRICTION, control, command, 0.02e-6)
        load = load_of(motor, control.sample)
        load = STEP * np.round((load + 0.02e-6 * np.random.default_rng(9).normal(size=len(load))) / STEP)
        rows = csv(command, motor, None, control.sample).splitlines()
        table = [rows[0] + ",X_load_mm", *(f"{row},{1e3 * y:.7f}" for row, y in zip(rows[1:], load, strict=True))]
        machine = machine_toml(FRICTION, control, False, 0.12)
        return write_campaign(tmp_path, "\n".join(table) + "\n", machine, control.sample, letter)

    return make


def diagnosed(place, most=None):
    return diagnose_logs(read_campaign(place), read_machine(place / "machine.toml"), most)


@pytest.mark.parametrize(("letter", "width", "sample"), [("Y", 4e-6, 1e-3), ("Z", 25e-6, 2e-3)])
def test_play_between_the_encoders(folder, letter, width, sample):
    place = folder(lambda motor, step: stuck(motor, width), Control(sample=sample), letter)
    result = diagnosed(place)
    assert result.verdict == "identified" and [e.effect.id for e in result.effects] == [f"backlash.{letter}"]
    (found,) = result.effects
    assert found.effect.values["width_um"] == pytest.approx(width * 1e6, rel=0.03) and found.probability > 0.99
    low, high = found.ci95["width_um"]
    assert low < width * 1e6 < high and high - low < 0.1 * width * 1e6
    # what is between the encoders takes nothing from the drive
    assert result.before.rms < 0.2e-6


@pytest.mark.parametrize(("load_of", "noise"), [(stuck, 0.1e-6), (stuck, 0.02e-6), (gliding, 0.1e-6)])
def test_noise_of_an_encoder_makes_no_play_wider(tmp_path, load_of, noise):
    """The load follows the motor, not the noise of its encoder: it stays at its flank while the motor stands still."""
    control, width = Control(integral_time=0.04, feedforward=1.0), 12e-6
    command = to_and_fro(control.sample)
    motor, _ = record(FRICTION, control, command, 0.0, step=1e-12)
    load = load_of(motor, width) if load_of is stuck else load_of(motor, control.sample, width, 0.05)
    random = np.random.default_rng(3)
    motor, load = (STEP * np.round((x + noise * random.normal(size=len(x))) / STEP) for x in (motor, load))
    rows = csv(command, motor).splitlines()
    table = [rows[0] + ",X_load_mm", *(f"{row},{1e3 * y:.7f}" for row, y in zip(rows[1:], load, strict=True))]
    place = write_campaign(tmp_path, "\n".join(table) + "\n", machine_toml(FRICTION, control, False, 0.12))
    (found,) = diagnosed(place).effects
    low, high = found.ci95["width_um"]
    assert found.effect.id == "backlash.X" and low <= 12.0 <= high and high - low < 0.2


def test_waves_and_scale_between_the_encoders(folder):
    """Once per turn of a screw of 10 mm, and a scale error."""

    def load(motor, step):
        return motor * (1.0 + 150e-6) + 3e-6 * np.sin(2 * np.pi * motor / 0.010 + 0.6)

    result = diagnosed(folder(load))
    found = {e.effect.id: e.effect for e in result.effects}
    assert set(found) == {"scale_error.X", "pitch_error.X"}
    assert found["scale_error.X"].values["ppm"] == pytest.approx(150.0, rel=0.05)
    (wave,) = found["pitch_error.X"].values["components"]
    assert wave == pytest.approx([1.0, 3.0, np.degrees(0.6)], rel=0.05)


def test_what_a_sound_transmission_has_is_no_finding(folder):
    result = diagnosed(folder(lambda motor, step: stuck(motor, 0.3e-6) + 0.2e-6 * np.sin(2 * np.pi * motor / 0.010)))
    assert result.verdict == "nothing_found" and result.effects == () and result.rest == ()


def soft(folder, stiffness, width):
    """A log of X of the paper's machine with an elastic drive and a play behind it, by the independent integrator."""
    planted = [{"id": "drive_compliance.X", "stiffness_N_per_um": stiffness, "damping_ratio": 0.08}]
    axes, effects = machines.true_machine(machines.nominal("M1"), planted, np.random.default_rng([3, 0]))
    command, ratio = machine_logs.strokes("X"), drives.gear(axes["X"])
    numbers = drives.parameters("X", axes["X"], effects)
    motor, behind, _ = drives._moved(np.ascontiguousarray(command * ratio).tobytes(), 60, numbers)
    both, random = [motor / ratio, stuck(behind / ratio, width)], np.random.default_rng(4)
    both = [STEP * np.round((x + 0.02e-6 * random.normal(size=len(x))) / STEP) for x in both]
    names = ["time_s", "X_command_mm", "X_actual_mm", "X_load_mm"]
    columns = [drives.GRID * np.arange(len(command)), *(1e3 * x for x in (command, *both))]
    lines = [",".join(names), *(",".join(f"{v:.7f}" for v in row) for row in zip(*columns, strict=True)), ""]
    (folder / "traces").mkdir(parents=True)
    (folder / "traces" / "log.csv").write_text("\n".join(lines))
    (folder / "machine.toml").write_text(tomlkit.dumps(machines.nominal("M1")))
    control = {"kind": "axis_log", "sample_rate_Hz": 1000.0, "resolution_um": 0.1, "resolution_deg": 1e-4}
    test = {"name": "log", "kind": "log", "trace": "traces/log.csv", "axes": ["X"]}
    (folder / "campaign.toml").write_text(tomlkit.dumps({"name": "soft", "instrument": control, "test": [test]}))
    return diagnosed(folder, 2)


def test_play_and_compliance_are_told_apart(tmp_path):
    """The load rings at 100 Hz, which the model leaves."""
    found = {e.effect.id: e.effect.values for e in soft(tmp_path / "both", 200.0, 6e-6).effects}
    assert set(found) == {"backlash.X", "drive_compliance.X"}
    assert found["backlash.X"]["width_um"] == pytest.approx(6.0, rel=0.01)
    assert found["drive_compliance.X"]["stiffness_N_per_um"] == pytest.approx(200.0, rel=0.01)


def test_something_else_between_the_encoders_is_unknown(folder):
    """A scale that slips by 15 µm in the middle of the recording."""

    def load(motor, step):
        return motor + np.where(np.arange(len(motor)) > 0.6 * len(motor), 15e-6, 0.0)

    place = folder(load)
    result = diagnosed(place)
    assert result.verdict == "unknown" and any(r.between for r in result.rest)
    run = CliRunner().invoke(main, ["diagnose", str(place), "--json"])
    said = json.loads(run.stdout)
    assert said["unexplained"]["summary"].startswith("Between the encoders of X, ")
    assert said["encoders"][0]["axis"] == "X" and "backlash.X" not in said["not_testable"]
