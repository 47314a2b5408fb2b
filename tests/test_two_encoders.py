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
from mjsim.commands.axis_log.diagnose import diagnose_logs, effects_of
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.encoders import EncoderSearch, encoder_data
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


def soft(folder, name, letter, stiffness, width, damping=0.08, seed=0):
    """A log of one axis with an elastic drive and a play behind it, by the independent integrator; µrad and N·m/µrad
    stand for µm and N/µm on a rotary axis.
    """
    rotary = letter in "AC"
    number = "stiffness_Nm_per_urad" if rotary else "stiffness_N_per_um"
    planted = [{"id": f"drive_compliance.{letter}", number: stiffness, "damping_ratio": damping}]
    axes, effects = machines.true_machine(machines.nominal(name), planted, np.random.default_rng([3, seed]))
    command, ratio = machine_logs.strokes(letter), drives.gear(axes[letter])
    numbers = drives.parameters(letter, axes[letter], effects)
    motor, behind, _ = drives._moved(np.ascontiguousarray(command * ratio).tobytes(), 60, numbers)
    noise, step = machine_logs.NOISE[rotary], machine_logs.STEP[rotary]
    both, random = [motor / ratio, stuck(behind / ratio, 1e-6 * width)], np.random.default_rng([4, seed])
    both = [step * np.round((x + noise * random.normal(size=len(x))) / step) for x in both]
    unit, of_unit = ("deg", np.pi / 180.0) if rotary else ("mm", 1e-3)
    names = ["time_s", *(f"{letter}_{what}_{unit}" for what in ("command", "actual", "load"))]
    columns = [drives.GRID * np.arange(len(command)), *(x / of_unit for x in (command, *both))]
    lines = [",".join(names), *(",".join(f"{v:.8f}" for v in row) for row in zip(*columns, strict=True)), ""]
    (folder / "traces").mkdir(parents=True)
    (folder / "traces" / "log.csv").write_text("\n".join(lines))
    machine = machines.nominal(name)
    machine["effect"] = [e for e in machine["effect"] if e["id"].startswith("friction")]
    (folder / "machine.toml").write_text(tomlkit.dumps(machine))
    control = {"kind": "axis_log", "sample_rate_Hz": 1000.0, "resolution_um": 0.1, "resolution_deg": step / np.pi * 180}
    test = {"name": "log", "kind": "log", "trace": "traces/log.csv", "axes": [letter]}
    (folder / "campaign.toml").write_text(tomlkit.dumps({"name": "soft", "instrument": control, "test": [test]}))
    return folder


def told_apart(effects, letter, stiffness, width):
    """That both were found, and their intervals hold."""
    found = {e.effect.id: e for e in effects}
    assert set(found) == {f"backlash.{letter}", f"drive_compliance.{letter}"}
    play, drive = found[f"backlash.{letter}"], found[f"drive_compliance.{letter}"]
    number = next(n for n in drive.ci95 if n.startswith("stiffness"))
    for e, name, planted in ((play, next(iter(play.ci95)), width), (drive, number, stiffness)):
        low, high = e.ci95[name]
        low, high = (x * (1e6 * np.pi / 180.0 if name.endswith("_deg") else 1.0) for x in (low, high))
        assert low < planted < high, name
    # the moving mass of the model is that of the generator
    assert drive.effect.values[number] == pytest.approx(stiffness, rel=0.01)


def test_play_and_compliance_are_told_apart(tmp_path):
    """The load rings at 90 Hz, and one encoder shows neither of the two."""
    place = soft(tmp_path, "M1", "X", 200.0, 6.0)
    result = diagnosed(place, 2)
    assert result.verdict == "identified" and result.rest == ()
    told_apart(result.effects, "X", 200.0, 6.0)
    (stiffness,) = (b for b in result.budget if b.number == "stiffness_N_per_um")
    assert stiffness.largest == "machine_model"
    log = place / "traces" / "log.csv"
    log.write_text("\n".join(line.rpartition(",")[0] for line in log.read_text().splitlines()) + "\n")
    alone = diagnosed(place, 1)
    assert {"backlash.X", "drive_compliance.X"} <= set(alone.not_testable)
    assert not {e.effect.kind for e in alone.effects} & {"backlash", "drive_compliance"}


@pytest.mark.parametrize(
    ("name", "letter", "stiffness", "width", "damping"),
    [
        ("M2", "Y", 49.0, 6.4, 0.07),
        ("M3", "Z", 330.0, 18.7, 0.09),  # the load seems to glide until its ringing is in the model
        ("M4", "Z", 110.0, 4.3, 0.09),
        ("M5", "A", 0.34, 89.0, 0.07),
        ("R11", "X", 122.0, 16.0, 0.09),
        ("R13", "Y", 320.0, 6.4, 0.08),
        ("R16", "X", 470.0, 3.0, 0.08),
        ("R17", "Y", 610.0, 18.0, 0.08),
        ("R19", "Z", 200.0, 7.9, 0.03),
    ],
)
def test_intervals_of_play_and_compliance(tmp_path, name, letter, stiffness, width, damping):
    """Drives that ring at 40 to 150 Hz."""
    place = soft(tmp_path, name, letter, stiffness, width, damping, seed=1)
    machine = read_machine(place / "machine.toml")
    data = encoder_data(axis_data(read_campaign(place), letter, machine), machine)
    told_apart(effects_of(EncoderSearch(machine, data).run(2)), letter, stiffness, width)


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
