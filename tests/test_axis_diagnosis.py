"""Diagnosis of axis logs made by independent code: planted causes are found, and nothing where nothing is."""

import signal
import time
from dataclasses import replace

import numpy as np
import pytest

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.axis_log.compare import compare_logs
from mjsim.commands.axis_log.diagnose import diagnose_logs
from mjsim.commands.calibrate import calibrate
from mjsim.inference.axis_logs.data import axis_data, noise_of, period_of
from mjsim.inference.axis_logs.entries import AxisModel, Entry
from mjsim.inference.axis_logs.fit import AxisFit
from mjsim.inference.axis_logs.together import known_together
from tests.independent.logs import CAMPAIGN, Axis, Control, csv, machine_toml, record, to_and_fro, write_campaign

FRICTION = Axis(coulomb=0.12)
PI = Control(integral_time=0.04, feedforward=1.0)


@pytest.fixture
def campaign(tmp_path):
    def make(axis, control, torque=False, identify=False, friction=0.0, noise=0.02e-6, **wrong):
        command = to_and_fro(control.sample)
        position, torques = record(axis, control, command, noise)
        (tmp_path / "strokes.csv").write_text(csv(command, position, torques if torque else None))
        (tmp_path / "campaign.toml").write_text(CAMPAIGN)
        (tmp_path / "machine.toml").write_text(machine_toml(axis, control, identify, friction, **wrong))
        return read_campaign(tmp_path), read_machine(tmp_path / "machine.toml")

    return make


@pytest.mark.parametrize("axis", [Axis(), FRICTION], ids=["plain", "friction"])
def test_the_right_machine_leaves_the_noise(campaign, axis):
    """The independent integration and the compiled loop agree to a share of an encoder step."""
    result = compare_logs(*campaign(axis, PI, friction=axis.coulomb))
    assert result.rms < 0.1e-6


@pytest.mark.parametrize("sample", [1e-3, 5e-4])
def test_an_axis_that_rests_does_not_slide_because_its_encoder_is_noisy(tmp_path, sample):
    """First samples look like a motion by chance. As if it slid from the start, half of the logs left 1 to 2 µm."""
    control = replace(PI, sample=sample)
    command = to_and_fro(sample)
    for seed in range(12):
        position, _ = record(FRICTION, control, command, 0.05e-6, seed)
        folder = write_campaign(
            tmp_path, csv(command, position, None, sample), machine_toml(FRICTION, control, False, 0.12), sample
        )
        assert compare_logs(read_campaign(folder), read_machine(folder / "machine.toml")).rms < 0.12e-6


@pytest.mark.parametrize("first", [250, 480, 495])
def test_a_log_may_begin_in_the_middle_of_a_motion(tmp_path, first):
    """While the command moves, and just after it stopped, when the axis still does."""
    slow = Control(position_gain=30.0)
    command = to_and_fro()
    position, _ = record(FRICTION, slow, command, 0.05e-6)
    folder = write_campaign(
        tmp_path, csv(command[first:], position[first:]), machine_toml(FRICTION, slow, False, 0.12), 1e-3
    )
    (data,) = axis_data(read_campaign(folder), "X", read_machine(folder / "machine.toml"))
    speed = np.polyfit(1e-3 * np.arange(-10, 11), position[first - 10 : first + 11], 3)[2]
    assert data.start[1] == pytest.approx(speed, abs=4e-4) and abs(speed) > 4e-4


def test_a_log_that_names_no_controller_ran_under_the_only_one(campaign):
    """Its numbers are fitted as those of that controller; the simulation had been that of the bare drive."""
    logs, machine = campaign(FRICTION, PI, torque=True, friction=0.12)
    nameless = replace(logs, tests=tuple(replace(t, controller=None) for t in logs.tests))
    sheets = [calibrate(c, machine).sheet for c in (logs, nameless)]
    assert sheets[0] == sheets[1] and any(n.controller == "c" for n in sheets[0])
    assert nameless.tests[0].controller is None and logs.tests[0].controller == "c"


def test_nothing_is_found_where_nothing_hides(campaign):
    result = diagnose_logs(*campaign(FRICTION, PI, friction=0.12))
    assert result.verdict == "nothing_found" and result.effects == () and result.rest == ()


def test_friction_that_is_not_in_the_model(campaign):
    result = diagnose_logs(*campaign(FRICTION, PI))
    assert [e.effect.id for e in result.effects] == ["friction.X"]
    (found,) = result.effects
    assert found.effect.values["coulomb_Nm"] == pytest.approx(0.12, rel=0.05)
    low, high = found.ci95["coulomb_Nm"]
    assert low < 0.12 < high
    assert result.after.rms < 0.2e-6 < 10.0 * result.after.rms < result.before.rms


def test_an_integral_time_that_is_not_on_the_sheet(campaign):
    result = diagnose_logs(*campaign(FRICTION, PI, friction=0.12, identify=True, integral_time=0.1))
    assert result.effects[0].effect.id == "integral_time.X"
    low, high = result.effects[0].ci95["ratio"]
    assert low < 0.4 < high and high / low < 1.5
    assert result.after.rms < 0.2e-6
    # the table of the data sheet tells the same: the number that the factor makes
    (row,) = (s for s in result.sheet if s.name == "integral_time")
    assert row.stated == 0.1 and row.known and row.ci95[0] < 0.04 < row.ci95[1] < 0.1
    assert row.found / row.stated == pytest.approx(result.effects[0].effect.values["ratio"], rel=0.03)


def test_a_constant_force_is_told_from_a_direction_by_the_sticking(campaign):
    result = diagnose_logs(*campaign(Axis(coulomb=0.12, constant=0.05), Control(), friction=0.12))
    ids = {e.effect.id: e for e in result.effects}
    found = ids.get("constant_force.X") or ids["friction_direction.X"]
    if found.effect.kind == "constant_force":
        assert found.effect.values["torque_Nm"] == pytest.approx(0.05, rel=0.1)
    assert result.after.rms < 0.3e-6


def test_gains_come_from_the_recorded_torque(campaign):
    """With the torque recorded, inertia and velocity gain are both found, each in its interval."""
    c, m = campaign(FRICTION, PI, torque=True, identify=True, inertia=9e-4, velocity_gain=0.03)
    result = diagnose_logs(c, m)
    numbers = {s.name: s for s in result.sheet}
    assert numbers["velocity_gain"].source == "recorded output"
    assert numbers["velocity_gain"].found == pytest.approx(0.06, rel=0.01)
    assert numbers["inertia"].found == pytest.approx(4.5e-4, rel=0.03) and numbers["inertia"].known
    assert not any("inertia" in label for i in result.inseparable for label in i.labels)


def test_without_a_torque_inertia_and_gain_are_not_separable(campaign):
    c, m = campaign(FRICTION, PI, identify=True, inertia=9e-4, velocity_gain=0.12)
    result = diagnose_logs(c, m)
    labels = {label for i in result.inseparable for label in i.labels}
    assert {"drive.inertia", "controller.c.velocity_gain"} <= labels
    numbers = {s.name: s for s in result.sheet}
    assert not numbers["inertia"].known
    ratio = numbers["inertia"].found / numbers["velocity_gain"].found
    assert ratio == pytest.approx(4.5e-4 / 0.06, rel=0.05)
    assert "torque" in result.to_json()["next_test"]["test"]["motion"]


def test_a_search_of_logs_that_is_stopped_ends_at_once(campaign, monkeypatch):
    """It had gone on to its end in a thread of its own, for minutes."""
    went_on = []

    def search(self, most):
        signal.raise_signal(signal.SIGINT)
        time.sleep(0.5)
        went_on.append(self.axis)

    monkeypatch.setattr("mjsim.inference.axis_logs.search.AxisSearch.run", search)
    with pytest.raises(KeyboardInterrupt):
        diagnose_logs(*campaign(FRICTION, PI))
    assert not went_on


def test_noise_from_repeats_rest_and_declared():
    from mjsim.instruments.axis_log.measurement import AxisRecord

    time = 1e-3 * np.arange(4000)
    command = 0.01 * np.sin(2 * np.pi * time)
    random = np.random.default_rng(3)
    noise = random.normal(scale=2e-7, size=4000)
    assert period_of(command, 1e-7) == 1000
    found = noise_of(time, AxisRecord(command, command + noise), 1e-7)
    assert found.source == "from 4 repeats of the motion" and found.rms == pytest.approx(2e-7, rel=0.05)
    rest = np.where(time < 2.0, command, 0.0)
    found = noise_of(time, AxisRecord(rest, rest + 0.2 * noise), 1e-7)
    assert "rest" in found.source and found.rms == pytest.approx(0.4e-7, rel=0.1)
    settling = rest + np.where(time < 2.0, 0.0, 1e-5 * np.exp(-(time - 2.0)))
    for scale in (0.2, 1.0, 10.0):  # noise of more steps than an axis at rest may show, and one that still settles
        found = noise_of(time, AxisRecord(rest, settling + scale * noise), 1e-7)
        assert found.rms == pytest.approx(scale * 2e-7, rel=0.2)
    chirp = 0.01 * np.sin(2 * np.pi * time**2)
    assert "declared" in noise_of(time, AxisRecord(chirp, chirp + noise), 1e-7).source


def test_a_number_that_is_known_only_together_with_another(tmp_path):
    """Two entries of which the sum is known: the interval of the first holds zero, and where the second is as found
    it does not.
    """
    entries = [Entry("rising_friction.X", n, v, deviation=10.0) for n, v in (("torque_Nm", 1.0), ("other", 2.0))]
    rising = '\n[[effect]]\nid = "rising_friction.X"\ntorque_Nm = 1.0\nvelocity_rad_per_s = 5.0\n'
    (tmp_path / "machine.toml").write_text(machine_toml(FRICTION, PI, False) + rising)
    model = AxisModel(read_machine(tmp_path / "machine.toml"), "X", tuple(entries))
    design = np.column_stack([np.ones(50), np.ones(50)])
    fit = AxisFit(model, (np.zeros(50),), (design,), (50.0,), (1.0,), (1.0,))
    found = known_together(fit, "rising_friction.X")
    assert found is not None and found.others == ("other",)
    assert found.ci95 == pytest.approx((1.0 - 1.96 / np.sqrt(50.0), 1.0 + 1.96 / np.sqrt(50.0)), rel=1e-2)
    poor = AxisFit(model, (np.zeros(50),), (design,), (50.0,), (0.1,), (1.0,))
    open_ = known_together(poor, "rising_friction.X")  # too little is known of the sum as well
    assert open_ is not None and open_.others == ()
