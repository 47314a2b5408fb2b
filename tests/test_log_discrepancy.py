"""What a model leaves of axis logs: its size, what it makes of the verdict, and that it is said."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.cli.main import main
from mjsim.commands.axis_log.diagnose import diagnose_logs
from mjsim.inference.axis_logs.candidates import Catalogue
from mjsim.inference.axis_logs.data import AxisData, LogNoise, axis_data
from mjsim.inference.axis_logs.discrepancy import allowed_in, discrepancy_of
from mjsim.inference.axis_logs.entries import AxisModel, Entry
from mjsim.inference.axis_logs.probability import probability_known
from mjsim.inference.axis_logs.start import start_model
from tests.independent.logs import Axis, Control, csv, filtered, machine_toml, record, to_and_fro, write_campaign

FRICTION = Axis(coulomb=0.12)
MILLISECOND = Control()
PI = Control(integral_time=0.04, feedforward=1.0)
QUICK = Control(integral_time=0.04, feedforward=1.0, sample=5e-4)


@pytest.fixture
def folder(tmp_path):
    def make(axis, control, position=None, friction=None, letter="X"):
        """A campaign of one recording; ``position`` makes of time and actual position what is recorded."""
        command = to_and_fro(control.sample)
        actual, _ = record(axis, control, command, 0.02e-6)
        time = control.sample * np.arange(len(command))
        if position is not None:
            actual = 1e-7 * np.round(position(time, actual) / 1e-7)
        table = csv(command, actual, None, control.sample)
        machine = machine_toml(axis, control, False, axis.coulomb if friction is None else friction)
        return write_campaign(tmp_path, table, machine, control.sample, letter)

    return make


def diagnosed(place):
    return diagnose_logs(read_campaign(place), read_machine(place / "machine.toml"))


def jitter(lag, spread, seed):
    """A recorder that reads late, and never at the same instant."""

    def late(time, actual):
        return np.interp(time - lag - np.random.default_rng(seed).normal(scale=spread, size=len(time)), time, actual)

    return late


@pytest.mark.parametrize(
    ("letter", "control", "lag", "spread"),
    [("Y", MILLISECOND, 0.0, 1e-3), ("Z", QUICK, 1e-3, 2e-4)],
)
def test_a_recorder_with_a_shaking_clock_is_unknown(folder, letter, control, lag, spread):
    result = diagnosed(folder(FRICTION, control, jitter(lag, spread, 3), letter=letter))
    assert result.verdict == "unknown" and result.probabilities["unknown"] > 0.99
    assert all(e.probability < 0.95 for e in result.effects)
    (rest,) = result.rest
    assert rest.axis == letter and rest.probability > 0.99 and rest.left > 10.0 * rest.allowed
    assert rest.left == pytest.approx(result.after.rms, rel=0.5)  # of block means


@pytest.mark.parametrize(("place", "width"), [(0.01, 0.001), (0.02, 0.003)])
def test_a_cause_outside_the_catalogue_is_never_identified(folder, place, width):
    """Chips on the way: a place that the slide is held back at, whichever way it goes."""

    def held_back(time, actual):
        speed = np.gradient(actual, time)
        return actual - 40e-6 * np.tanh(speed / 0.01) * np.exp(-(((actual - place) / width) ** 2))

    result = diagnosed(folder(FRICTION, MILLISECOND, held_back))
    assert result.verdict == "unknown" and result.rest[0].left > 3.0 * result.rest[0].allowed
    assert not any(e.probability >= 0.95 for e in result.effects)


@pytest.mark.parametrize(
    ("kind", "time", "letter", "control"),
    [("servo_delay", 0.035, "Z", MILLISECOND), ("command_filter", 0.01, "X", PI)],
)
def test_a_cause_that_the_catalogue_lacks_has_no_other_name(tmp_path, monkeypatch, kind, time, letter, control):
    """A filter with a feedforward left 5 µm of the 2 mm of a dead time, and each had its name with 95 %."""
    missing = Catalogue.missing
    monkeypatch.setattr(Catalogue, "missing", lambda *given: [c for c in missing(*given) if c.effect.kind != kind])
    command, late = to_and_fro(control.sample), round(time / control.sample)
    told = filtered(command, control.sample, "lag_ms", time)
    if kind == "servo_delay":
        told = np.concatenate([np.full(late, command[0]), command[:-late]])
    actual, _ = record(FRICTION, control, told, 0.05e-6)
    machine = machine_toml(FRICTION, control, False, FRICTION.coulomb)
    result = diagnosed(write_campaign(tmp_path, csv(command, actual), machine, control.sample, letter))
    assert result.verdict == "unknown" and not any(e.probability >= 0.5 for e in result.effects)


def test_a_fault_is_improbable_beside_an_unlisted_cause_and_friction_is_not(folder):
    """Each explains 9 of 10 µm; the Coulomb torque of a data sheet that is wrong is a fault too."""
    place = folder(FRICTION, MILLISECOND)
    machine = read_machine(place / "machine.toml")
    data = axis_data(read_campaign(place), "X", machine)
    causes = {c.key: c for c in Catalogue(machine, data).missing(start_model(machine, data))}
    less = SimpleNamespace(rms=10e-6)

    def known(key, left):
        fit = SimpleNamespace(rms=1e-6, discrepancy=SimpleNamespace(probability=left))
        return probability_known(causes[key], fit, less)

    for fault in ("servo_delay.X", "servo_gain.X", "friction.X shape torque"):
        assert known(fault, 0.0) == 1.0 and known(fault, 1.0) < 0.01
    for usual in ("constant_force.X", "friction.X shape", "torque_ripple.X order 1"):
        assert known(usual, 1.0) == pytest.approx(0.9)


def test_a_sound_machine_leaves_what_it_may(folder):
    place = folder(FRICTION, MILLISECOND)
    result = diagnosed(place)
    assert result.verdict == "nothing_found" and result.probabilities["nothing_found"] > 0.99
    run = CliRunner().invoke(main, ["diagnose", str(place), "--json"])
    assert json.loads(run.stdout)["probabilities"] == result.probabilities


def test_a_finding_has_a_probability(folder):
    result = diagnosed(folder(FRICTION, MILLISECOND, friction=0.0))
    assert result.verdict == "identified" and result.effects[0].probability > 0.99
    assert result.probabilities["identified"] > 0.99


def test_what_is_left_is_said_first(folder):
    place = folder(FRICTION, MILLISECOND, jitter(2e-3, 5e-4, 1))
    lines = CliRunner().invoke(main, ["diagnose", str(place)]).output.splitlines()
    assert lines[0].startswith("Unknown: more is left than a sound machine leaves")
    said = " ".join(" ".join(lines[1:6]).split())
    assert "µm RMS are left, and a sound machine leaves at most" in said and "The largest error is at" in said


def data_of(count, noise=0.1e-6):
    time = 1e-3 * np.arange(count)
    return AxisData(None, "X", time, None, 1, (0.0, 0.0), LogNoise(noise, ""), 0.1e-6, 0.07)


def found_in(rows, allowed, noise=0.1e-6):
    model = AxisModel(None, "X", (Entry("zero", "zero", 0.0, "a", 1.0, scale=1e-7),))
    design = np.full((len(rows), 1), 1e-7)
    return discrepancy_of(model, [rows], [design], [noise], [allowed])


def test_the_size_of_a_correlated_rest_is_known_as_well_as_its_length_tells():
    random = np.random.default_rng(5)
    noise = 0.1e-6 * random.standard_normal(4000)
    assert found_in(noise, 0.05e-6).left[0] < 0.03e-6 and found_in(noise, 0.05e-6).probability < 0.5
    slow = np.convolve(random.standard_normal(4100), np.hanning(101), "valid")
    slow *= 1e-6 / slow.std()
    assert found_in(noise + slow, 0.5e-6).left[0] == pytest.approx(1e-6, rel=0.1)
    sure, open_ = found_in(noise + slow, 0.5e-6).probability, found_in(noise + slow, 1e-6).probability
    assert sure > 0.99 and 0.2 < open_ < 0.8
    # the shorter, the less is known
    assert found_in((noise + slow)[:400], 0.9e-6 * np.std(slow[:400]) / 1e-6).probability < 0.9


def test_a_model_that_has_run_away_has_an_evidence():
    """An unstable loop: all its derivatives are alike, and huge beside what the priors allow."""
    entries = tuple(Entry("drive", name, 0.0, deviation=0.1) for name in ("inertia", "viscous", "velocity_gain"))
    rows, wild = np.random.default_rng(2).normal(size=(2, 400))
    found = discrepancy_of(AxisModel(None, "X", entries), [rows], [1e12 * np.outer(wild, np.ones(3))], [1.0], [1.0])
    assert np.isfinite(found.evidence) and found.evidence < 0.0


def test_what_a_column_explains_is_evidence_only_beside_what_is_left():
    """A wave of 0.1 µm: certain in white noise of 0.1 µm, and nothing beside a rest of 1 µm that is as fast."""
    random = np.random.default_rng(8)
    time = 1e-3 * np.arange(4000)
    wave = np.sin(2 * np.pi * 5.0 * time)
    rest = np.convolve(random.standard_normal(4100), np.hanning(101), "valid")
    rest *= 1e-6 / rest.std()
    gains = []
    for left in (0.1e-6 * random.standard_normal(4000), rest):
        rows = left + 0.1e-6 * wave
        entry = Entry("torque_ripple.X", "sine", 0.0, deviation=30.0, scale=1e-7)
        one = discrepancy_of(AxisModel(None, "X", (entry,)), [rows], [1e-7 * wave[:, None]], [1e-7], [1e-6])
        none = discrepancy_of(AxisModel(None, "X", ()), [rows], [np.zeros((4000, 0))], [1e-7], [1e-6])
        gains.append(one.evidence - none.evidence)
    assert gains[0] > 50.0 > 7.0 > gains[1]


def test_a_sound_machine_may_leave_what_its_friction_tolerance_does(tmp_path):
    (tmp_path / "machine.toml").write_text(machine_toml(FRICTION, MILLISECOND, False, 0.12))
    machine = read_machine(tmp_path / "machine.toml")
    entry = Entry("friction.X", "coulomb_Nm", 0.12, deviation=0.05, log=True)
    model, column = AxisModel(machine, "X", (entry,)), np.full((100, 1), 1e-6)
    assert allowed_in(machine, model, [column], [data_of(100)]) == pytest.approx([np.hypot(0.1e-6, 0.4e-6)])
    # friction that does more than a pitch error of the class
    assert allowed_in(machine, model, [9.0 * column], [data_of(100)]) == pytest.approx([np.hypot(0.1e-6, 0.6e-6)])
    (tmp_path / "machine.toml").write_text(
        machine_toml(FRICTION, MILLISECOND, False, 0.12)
        + "\n[tolerance]\nfriction = { ratio = 0.1 }\npitch_error = { um = 0.6 }\n"
    )
    tight = read_machine(tmp_path / "machine.toml")
    assert allowed_in(tight, model, [column], [data_of(100)]) == pytest.approx([np.hypot(0.1e-6, 0.1e-6)])
