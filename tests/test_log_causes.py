"""Causes and channels of real drives in axis logs: dead time, and a recorded velocity set-point."""

from dataclasses import replace

import numpy as np
import pytest

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.axis_log.compare import checked_logs
from mjsim.commands.axis_log.diagnose import diagnose_logs
from mjsim.effects import registry
from mjsim.inference.axis_logs.candidates import Catalogue
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.gains import read_gains, speed_limit
from mjsim.inference.axis_logs.start import start_model
from mjsim.simulation.servo import smoothed
from tests.independent.logs import (
    Axis,
    Control,
    csv,
    filtered,
    machine_toml,
    record,
    short_strokes,
    to_and_fro,
    write_campaign,
)

FRICTION = Axis(coulomb=0.12)
LOOSE = Control(integral_time=0.04, feedforward=1.0)


@pytest.fixture
def diagnosed(tmp_path):
    def make(control, stated=None, late=0.0, velocity=None, torque=None, letter="X"):
        """The diagnosis of one recording; ``stated`` is the control of the machine file."""
        command = to_and_fro(control.sample)
        wait = round(late / control.sample)
        told = np.concatenate([np.full(wait, command[0]), command[: len(command) - wait]])
        actual, torques = record(FRICTION, control, told, 0.02e-6)
        text = csv(command, actual, None if torque is None else torque * torques, control.sample)
        if velocity is not None:
            rows = text.splitlines()
            set_point = velocity(command, actual, control)
            text = "\n".join(
                [rows[0] + ",X_velocity_command_mm_per_s"]
                + [f"{row},{1e3 * v:.7f}" for row, v in zip(rows[1:], set_point, strict=True)]
            )
        machine = machine_toml(FRICTION, stated or control, False, 0.12)
        write_campaign(tmp_path, text + "\n", machine, control.sample, letter)
        return diagnose_logs(read_campaign(tmp_path), read_machine(tmp_path / "machine.toml"))

    return make


@pytest.mark.parametrize("control", [Control(), LOOSE])
def test_no_control_feeds_a_speed_forward_with_the_wrong_sign(tmp_path, control):
    """A feedforward of -0.38, where none is stated, stood for a part of a dead time."""
    actual, _ = record(FRICTION, control, to_and_fro())
    folder = write_campaign(tmp_path, csv(to_and_fro(), actual), machine_toml(FRICTION, control, False, 0.12))
    machine = read_machine(folder / "machine.toml")
    data = axis_data(read_campaign(folder), "X", machine)
    causes = Catalogue(machine, data).missing(start_model(machine, data))
    (entry,) = next(c.entries for c in causes if c.effect.kind == "velocity_feedforward")
    assert control.feedforward + entry.lower == pytest.approx(0.0)


def test_causes_start_inside_their_bounds_whatever_the_sheet_says(tmp_path):
    """An inertia of a million times the true one makes a friction beyond its bound: no reason to end a diagnosis."""
    actual, _ = record(FRICTION, Control(), to_and_fro())
    folder = write_campaign(tmp_path, csv(to_and_fro(), actual), machine_toml(FRICTION, Control(), False, 0.12))
    machine = read_machine(folder / "machine.toml")
    heavy = replace(machine.drives["X"], inertia=1e6 * machine.drives["X"].inertia)
    machine = replace(machine, drives=machine.drives | {"X": heavy})
    data = axis_data(read_campaign(folder), "X", machine)
    catalogue = Catalogue(machine, data)
    (bound,) = (p.upper for p in registry.kinds()["friction"].parameters_of("X") if p.name == "coulomb_Nm")
    assert catalogue.torque > bound
    assert catalogue.missing(start_model(machine, data))


@pytest.mark.parametrize(("letter", "late", "sample"), [("X", 0.040, 1e-3), ("Z", 0.025, 5e-4)])
def test_a_dead_time_is_no_feedforward(diagnosed, letter, late, sample):
    result = diagnosed(Control(sample=sample), late=late, letter=letter)
    assert result.verdict == "identified" and [e.effect.id for e in result.effects] == [f"servo_delay.{letter}"]
    (found,) = result.effects
    low, high = found.ci95["delay_ms"]
    assert low < 1e3 * late < high and found.effect.values["delay_ms"] == pytest.approx(1e3 * late, abs=1.0)
    assert found.probability > 0.99 and result.after.rms < 0.2e-6


def test_a_recorder_may_be_a_few_samples_late(diagnosed):
    assert diagnosed(Control(), late=0.003).verdict == "nothing_found"


def set_point(command, actual, control):
    return control.position_gain * (command - actual) + control.feedforward * np.gradient(command, control.sample)


@pytest.mark.parametrize(("letter", "share", "sample"), [("X", 1.05, 1e-3), ("Z", 0.7, 5e-4)])
def test_a_set_point_without_a_position_gain_says_the_feedforward(diagnosed, letter, share, sample):
    """It was taken before the position controller, three samples late. A gain of 4e-7 1/s had been read in it, and the
    answer was "unknown".
    """

    def before_the_controller(command, actual, control):
        rate = control.feedforward * np.gradient(command, control.sample)
        return np.concatenate([np.zeros(3), rate[:-3]])

    control = Control(feedforward=share, sample=sample)
    result = diagnosed(control, replace(control, feedforward=0.0), velocity=before_the_controller, letter=letter)
    (found,) = result.effects
    low, high = found.ci95["ratio"]
    assert result.verdict == "identified" and found.effect.id == f"velocity_feedforward.{letter}"
    assert low < share < high and high - low < 0.005
    assert any(f"has {share:g} times the commanded speed in it" in s.sentence for s in result.signals)


def test_a_velocity_set_point_says_the_position_gain(diagnosed):
    control = Control(integral_time=0.04, feedforward=1.0)
    result = diagnosed(control, velocity=set_point)
    (row,) = (s for s in result.sheet if s.name == "position_gain")
    assert row.source == "recorded output" and row.found == pytest.approx(45.0, rel=0.003)
    assert not any(f.kind == "not used" for f in result.signals)


@pytest.mark.parametrize("gain", [30.0, 60.0])
def test_a_wrong_position_gain_is_that_of_the_set_point(diagnosed, gain):
    result = diagnosed(Control(position_gain=gain), stated=Control(position_gain=45.0), velocity=set_point)
    (found,) = result.effects
    assert found.effect.id == "servo_gain.X"
    assert found.effect.values["ratio"] == pytest.approx(gain / 45.0, rel=0.003)


def test_a_channel_that_says_nothing_is_named_with_the_reason(diagnosed):
    """A velocity set-point of another loop, and a torque that does not follow from the stated law."""
    control = Control(integral_time=0.04, feedforward=1.0)

    def strange(command, actual, control):
        random = np.random.default_rng(2).normal(size=len(command))
        return np.gradient(command, control.sample) + 0.02 * random

    said = [f.sentence for f in diagnosed(control, velocity=strange).signals if f.kind == "not used"]
    assert len(said) == 1 and "velocity command of X is recorded and not used" in said[0]
    assert "following error" in said[0]


@pytest.mark.parametrize(("share", "gain", "letter", "sample"), [(0.5, 0.1, "Y", 1e-3), (0.2, 0.08, "Z", 5e-4)])
def test_a_friction_that_grows_with_the_torque(tmp_path, share, gain, letter, sample):
    """A screw of bad efficiency is no friction that rises with the speed."""
    axis, control = Axis(coulomb=0.05, loss=share), replace(LOOSE, velocity_gain=gain, sample=sample)
    command = short_strokes(sample)
    actual, _ = record(axis, control, command, 0.02e-6)
    write_campaign(
        tmp_path, csv(command, actual, None, sample), machine_toml(axis, control, False, 0.05), sample, letter
    )
    result = diagnose_logs(read_campaign(tmp_path), read_machine(tmp_path / "machine.toml"))
    assert [e.effect.id for e in result.effects] == [f"torque_loss.{letter}"] and result.verdict == "identified"
    (found,) = result.effects
    low, high = found.ci95["share_ratio"]
    assert low < share < high and found.effect.values["share_ratio"] == pytest.approx(share, rel=0.05)
    assert result.after.rms < 0.2e-6


# --- current ---------------------------------------------------------------------------------------------------------


def with_current(folder, column, factor, drive="", identify=True):
    """A machine whose sheet says too small a velocity gain and inertia, with a channel that is its torque times a
    ``factor``.
    """
    command = to_and_fro()
    actual, torque = record(FRICTION, LOOSE, command, 0.02e-6)
    rows = csv(command, actual, torque * factor).replace("X_torque_Nm", column)
    stated = replace(LOOSE, integral_time=0.06)
    machine = machine_toml(FRICTION, stated, identify, 0.12, velocity_gain=0.04, inertia=3e-4)
    place = write_campaign(folder, rows, machine.replace("[drive.X]", f"[drive.X]\n{drive}"))
    return read_campaign(place), read_machine(place / "machine.toml")


def gains_of(campaign, machine):
    return read_gains(machine, axis_data(checked_logs(campaign, machine), "X", machine))


@pytest.mark.parametrize(("column", "factor"), [("X_current_A", -7.3), ("X_current_percent", 41.0)])
def test_a_current_of_unknown_constant_and_sign_says_the_law_and_no_velocity_gain(tmp_path, column, factor):
    (found,) = gains_of(*with_current(tmp_path, column, factor))
    assert set(found.values) == {"position_gain", "integral_time"}
    assert found.values["position_gain"] == pytest.approx(LOOSE.position_gain, rel=0.03)
    assert found.values["integral_time"] == pytest.approx(LOOSE.integral_time, rel=0.03)


def test_a_known_torque_constant_makes_a_torque_of_a_current(tmp_path):
    (found,) = gains_of(*with_current(tmp_path, "X_current_A", 1.0 / 0.37, "torque_constant_Nm_per_A = 0.37"))
    assert found.values["velocity_gain"] == pytest.approx(LOOSE.velocity_gain, rel=0.02)


@pytest.mark.parametrize(("drive", "narrower"), [("", False), ("torque_constant_Nm_per_A = 0.37", True)])
def test_a_current_narrows_inertia_only_with_its_constant(tmp_path, drive, narrower):
    campaign, machine = with_current(tmp_path, "X_current_A", 1.0 / 0.37, drive)
    result = diagnose_logs(campaign, machine)
    numbers = {s.name: s for s in result.sheet}
    low, high = numbers["inertia"].ci95
    assert (high / low < 1.2) == narrower and numbers["inertia"].known == narrower
    assert low < FRICTION.inertia < high
    assert numbers["integral_time"].found == pytest.approx(LOOSE.integral_time, rel=0.03)
    said = [f.sentence for f in result.signals if f.kind == "used"]
    assert len(said) == (not narrower) and all("a number that is not known, of either sign" in s for s in said)


# --- limits of a drive -----------------------------------------------------------------------------------------------


def limited(folder, stated, limits, with_torque=False, letter="X"):
    """The diagnosis of a drive with limits that the machine file does not state."""
    command = short_strokes(stated.sample)
    actual, torque = record(FRICTION, replace(stated, **limits), command, 0.02e-6)
    text = csv(command, actual, torque if with_torque else None, stated.sample)
    place = write_campaign(folder, text, machine_toml(FRICTION, stated, False, 0.12), stated.sample, letter)
    return diagnose_logs(read_campaign(place), read_machine(place / "machine.toml"))


@pytest.mark.parametrize(
    ("control", "limit", "with_torque", "letter"),
    [
        (Control(), 1.2, True, "X"),
        (Control(position_gain=60.0, sample=5e-4), 1.4, False, "Y"),
    ],
)
def test_a_torque_limit_that_is_not_stated_is_no_wrong_gain(tmp_path, control, limit, with_torque, letter):
    result = limited(tmp_path, control, {"clip": limit}, with_torque, letter)
    assert [e.effect.id for e in result.effects] == [f"current_clip.{letter}"]
    low, high = result.effects[0].ci95["torque_Nm"]
    assert low < limit < high and high < 1.1 * low


def test_a_set_point_that_stands_says_the_limit_and_still_the_gain(tmp_path):
    command, control = short_strokes(), Control(fastest=90.0)
    actual, _ = record(FRICTION, control, command, 0.02e-6)
    most = 90.0 * FRICTION.lead / (2.0 * np.pi)
    v = np.clip(set_point(command, actual, control), -most, most)
    rows = csv(command, actual).splitlines()
    table = [rows[0] + ",X_velocity_command_mm_per_s"]
    table += [f"{row},{1e3 * x:.7f}" for row, x in zip(rows[1:], v, strict=True)]
    write_campaign(tmp_path, "\n".join(table) + "\n", machine_toml(FRICTION, Control(), False, 0.12))
    campaign, machine = read_campaign(tmp_path), read_machine(tmp_path / "machine.toml")
    data = axis_data(checked_logs(campaign, machine), "X", machine)
    assert speed_limit(machine, data) == pytest.approx(90.0, rel=1e-3)
    (gains,) = read_gains(machine, data)
    assert gains.values["position_gain"] == pytest.approx(45.0, rel=0.005)


@pytest.mark.parametrize(
    ("control", "limits", "letter"),
    [
        (Control(sample=5e-4), {"fastest": 70.0}, "Z"),
        (LOOSE, {"no_load": 150.0, "stall": 2.0}, "Y"),
        (Control(), {"no_load": 100.0, "stall": 20.0}, "X"),
    ],
)
def test_a_limit_of_speed_or_voltage_is_found_without_a_current(tmp_path, control, limits, letter):
    """The shape of the speed tells them apart: at a speed limit it is flat, at full voltage it still grows."""
    result = limited(tmp_path, control, limits, letter=letter)
    kind, other = ("speed_limit", "voltage_limit") if "fastest" in limits else ("voltage_limit", "speed_limit")
    (found,) = result.effects
    assert found.effect.id == f"{kind}.{letter}" and found.probability > 0.99 and result.verdict == "identified"
    assert f"{other}.{letter}" not in found.others
    names = {"fastest": "speed_rad_per_s", "no_load": "no_load_rad_per_s", "stall": "stall_Nm"}
    for name, value in limits.items():
        low, high = found.ci95[names[name]]
        assert found.effect.values[names[name]] == pytest.approx(value, rel=5e-3) and high < 1.1 * low


def test_a_late_command_says_nothing_of_the_samples_of_a_velocity(tmp_path):
    """The law explains a torque that answers an earlier command in part, with any number of samples alike."""
    axis = replace(FRICTION, inertia=4.8e-4, viscous=0.0065, coulomb=0.078, presliding=0.0021)
    control, command = Control(43.0, 0.08), to_and_fro()
    actual, torque = record(axis, control, np.concatenate([np.zeros(27), command[:-27]]), 0.05e-6)
    write_campaign(tmp_path, csv(command, actual, torque), machine_toml(axis, control, False, 0.078))
    campaign, machine = read_campaign(tmp_path), read_machine(tmp_path / "machine.toml")
    for gains in read_gains(machine, axis_data(checked_logs(campaign, machine), "X", machine)):
        assert gains.velocity_samples == 1


# --- encoder of the motor --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("control", "order", "amplitude", "letter"),
    [(LOOSE, 2.0, 0.2, "X"), (Control(), 1.0, 0.35, "Y"), (replace(LOOSE, sample=5e-4), 4.0, 0.15, "Z")],
)
def test_an_encoder_that_reads_wrong_is_no_torque_ripple(tmp_path, control, order, amplitude, letter):
    """Both are waves over the motor's angle. That of a torque does not grow with the speed."""
    axis = replace(FRICTION, misread=np.radians(amplitude), misread_order=order, misread_phase=-1.0)
    (found,) = one_axis(tmp_path, axis, control, letter).effects
    assert found.effect.id == f"encoder_error.{letter}" and found.probability > 0.99 and not found.others
    assert found.effect.values["order"] == pytest.approx(order, abs=0.02)
    low, high = found.ci95["amplitude_deg"]
    assert low < amplitude < high < 1.05 * low


def test_a_torque_ripple_is_no_wrong_encoder(tmp_path):
    axis = replace(FRICTION, ripple=0.04, ripple_order=2.0, ripple_phase=0.4)
    (found,) = one_axis(tmp_path, axis, LOOSE, "X").effects
    assert found.effect.id == "torque_ripple.X" and found.probability > 0.99 and not found.others


def one_axis(folder, axis, control, letter):
    """The diagnosis of one axis; its machine file lacks what its encoder reads wrong, and what its control holds."""
    command = to_and_fro(control.sample)
    text = csv(command, record(axis, control, command, 0.02e-6)[0], None, control.sample)
    write_campaign(folder, text, machine_toml(axis, control, False, 0.12), control.sample, letter)
    return diagnose_logs(read_campaign(folder), read_machine(folder / "machine.toml"))


# --- position loop slower than the velocity loop ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("control", "every", "letter"),
    [(LOOSE, 4, "X"), (Control(), 8, "Y"), (replace(LOOSE, sample=5e-4), 6, "Z")],
)
def test_a_held_set_point_is_no_delay(tmp_path, control, every, letter):
    (found,) = one_axis(tmp_path, FRICTION, replace(control, every=every), letter).effects
    assert found.effect.id == f"held_set_point.{letter}" and found.probability > 0.99 and not found.others
    assert found.effect.values["time_ms"] == pytest.approx(1e3 * every * control.sample)


def test_a_delay_in_the_loop_is_no_held_set_point(tmp_path):
    (found,) = one_axis(tmp_path, FRICTION, replace(LOOSE, delay_samples=3), "X").effects
    assert found.effect.id == "loop_delay.X" and found.probability > 0.99 and not found.others


def test_a_motor_at_full_voltage_runs_as_fast_as_its_load_lets_it(tmp_path):
    """At 84 rad/s of the 120 that it has without load, while 160 are commanded: millimetres behind."""
    axis = Axis(inertia=4.81e-4, viscous=0.00947, coulomb=0.102, presliding=0.0067)
    control = Control(44.87, 0.0683, 0.049, 1.0)
    actual, torque = record(axis, replace(control, no_load=120.6, stall=2.988), to_and_fro(), 0.05e-6)
    write_campaign(tmp_path, csv(to_and_fro(), actual, torque), machine_toml(axis, control, False, 0.102))
    result = diagnose_logs(read_campaign(tmp_path), read_machine(tmp_path / "machine.toml"))
    assert [e.effect.id for e in result.effects] == ["voltage_limit.X"] and result.after.rms < 0.3e-6
    assert result.effects[0].effect.values["no_load_rad_per_s"] == pytest.approx(120.6, rel=5e-3)


# --- filter of the command -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "time"), [("lag_ms", 4e-3), ("lag_ms", 20e-3), ("mean_ms", 8e-3), ("mean_ms", 32e-3)])
def test_a_filter_of_the_command_has_its_closed_form(kind, time):
    command = to_and_fro()
    ours = smoothed(command, 1e-3, time if kind == "lag_ms" else 0.0, time if kind == "mean_ms" else 0.0)
    assert np.abs(ours - filtered(command, 1e-3, kind, time)).max() < 4e-6  # a hundredth of a sample at 0.3 m/s
    ramp = np.arange(0.0, 0.5, 1e-3)
    behind = ramp - smoothed(ramp, 1e-3, time if kind == "lag_ms" else 0.0, time if kind == "mean_ms" else 0.0)
    assert behind[-1] == pytest.approx(time if kind == "lag_ms" else 0.5 * time, rel=1e-6)


@pytest.mark.parametrize(
    ("control", "kind", "time", "letter"),
    [
        (LOOSE, "mean_ms", 24e-3, "Y"),
        (Control(sample=5e-4), "lag_ms", 12e-3, "Z"),
    ],
)
def test_a_filter_of_the_command_is_no_wrong_gain(tmp_path, control, kind, time, letter):
    command = short_strokes(control.sample)
    actual, _ = record(FRICTION, control, filtered(command, control.sample, kind, time), 0.02e-6)
    text, machine = csv(command, actual, None, control.sample), machine_toml(FRICTION, control, False, 0.12)
    place = write_campaign(tmp_path, text, machine, control.sample, letter)
    result = diagnose_logs(read_campaign(place), read_machine(place / "machine.toml"))
    assert [e.effect.id for e in result.effects] == [f"command_filter.{letter}"]
    low, high = result.effects[0].ci95[kind]
    assert low < 1e3 * time < high and result.after.rms < 0.3e-6
