"""A recorded torque or current as a second channel of an axis log: what it says beside the positions."""

from dataclasses import replace

import numpy as np
import pytest

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.axis_log.diagnose import diagnose_logs
from mjsim.inference.axis_logs.candidates import Catalogue
from mjsim.inference.axis_logs.data import axis_data, output_row
from mjsim.inference.axis_logs.derivatives import torque_direction
from mjsim.inference.axis_logs.entries import PER_TORQUE
from mjsim.inference.axis_logs.fit import LogFitter
from mjsim.inference.axis_logs.gains import read_gains
from mjsim.inference.axis_logs.separability import intervals
from mjsim.inference.axis_logs.start import start_model
from tests.independent.logs import Axis, Control, csv, machine_toml, record, short_strokes, write_campaign

AXIS = Axis(coulomb=0.12)
#: Four times as fast as the recorder: no gain can be read from its output.
FAST = Control(integral_time=0.04, feedforward=1.0, sample=2.5e-4)


def recorded(folder, column, number=1.0, axis=AXIS, control=FAST, every=4, noise=0.02, step=1e-7):
    """A recording of an axis whose inertia and velocity gain the machine file has a third too small, and nothing is
    believed by more than a factor of five. ``number`` is the channel's per N·m.
    """
    command = short_strokes(control.sample)
    actual, torque = record(axis, control, command, 0.2 * step, step=step)
    torque = number * (torque + noise * np.random.default_rng(2).normal(size=len(torque)))
    sample = every * control.sample
    text = csv(command[::every], actual[::every], torque[::every] if column else None, sample)
    machine = machine_toml(axis, control, True, axis.coulomb, velocity_gain=0.04, inertia=3e-4)
    write_campaign(folder, text.replace("X_torque_Nm", column or "-"), machine, sample)
    file = folder / "campaign.toml"
    file.write_text(file.read_text().replace("resolution_um = 0.1", f"resolution_um = {1e6 * step:g}"))
    return read_campaign(folder), read_machine(folder / "machine.toml")


def fitted(campaign, machine, axis="X"):
    data = axis_data(campaign, axis, machine)
    assert not any(g.channel == "torque" for g in read_gains(machine, data))
    fitter = LogFitter(machine, data, 1)
    return fitter, fitter.fit(start_model(machine, data))


def spread(fit, label):
    """Width of an interval of a positive number, in its logarithm."""
    _, low, high = intervals(fit)[label]
    return np.log(high / low)


@pytest.mark.parametrize(("column", "number"), [("X_torque_Nm", 1.0), ("X_force_N", 2.0 * np.pi / 0.01)])
def test_a_recorded_torque_narrows_inertia_by_more_than_five_without_a_law(tmp_path, column, number):
    _, alone = fitted(*recorded(tmp_path, ""))
    fitter, fit = fitted(*recorded(tmp_path, column, number))
    for label, true in (
        ("drive.inertia", AXIS.inertia),
        ("drive.viscous", AXIS.viscous),
        ("controller.c.velocity_gain", FAST.velocity_gain),
        ("friction.X.coulomb_Nm", AXIS.coulomb),
    ):
        assert 5.0 * spread(fit, label) < spread(alone, label), label
        value, low, high = intervals(fit)[label]
        assert low < true < high and value == pytest.approx(true, rel=0.03)
    assert np.sqrt(fit.mean_squares[1]) / fitter.noise[1] == pytest.approx(1.0, abs=0.2)
    assert fit.rms == pytest.approx(alone.rms, rel=0.02)


def test_a_torque_may_count_against_the_direction_of_the_position(tmp_path):
    campaign, machine = recorded(tmp_path, "X_torque_Nm", -1.0)
    (d,) = axis_data(campaign, "X", machine)
    given = campaign.traces["strokes"].axes["X"].torque
    assert d.record.torque == pytest.approx(-given)
    campaign, machine = recorded(tmp_path, "X_force_N", 2.0 * np.pi / 0.01)
    assert axis_data(campaign, "X", machine)[0].record.force is campaign.traces["strokes"].axes["X"].force


def test_a_torque_that_is_two_percent_off_does_not_make_the_inertia_surer_than_that(tmp_path):
    _, fit = fitted(*recorded(tmp_path, "X_torque_Nm", 1.02))
    low, high = intervals(fit)["drive.inertia"][1:]
    assert low < AXIS.inertia < high and high / low > 1.05


@pytest.mark.parametrize("number", [-3.0, 40.0])
def test_a_number_and_a_sign_that_are_not_known_are_found_and_leave_inertia_open(tmp_path, number):
    _, alone = fitted(*recorded(tmp_path, ""))
    _, fit = fitted(*recorded(tmp_path, "X_current_A", number))
    found = next(e.value for e in fit.model.entries if e.owner == PER_TORQUE)
    inertia = intervals(fit)["drive.inertia"][0]
    assert found * inertia == pytest.approx(number * AXIS.inertia, rel=0.02)
    assert spread(fit, "drive.inertia") == pytest.approx(spread(alone, "drive.inertia"), rel=0.1)


def test_a_current_says_what_share_of_the_torque_is_lost(tmp_path):
    """Beside an encoder of 2 µm, with a number that is not known."""
    axis, control = replace(AXIS, loss=0.3), replace(FAST, velocity_gain=0.03, integral_time=0.08)

    def share(column):
        campaign, machine = recorded(tmp_path, column, -3.0, axis, control, step=2e-6)
        data = axis_data(campaign, "X", machine)
        fitter = LogFitter(machine, data, 1)
        cause = next(c for c in Catalogue(machine, data).missing(start_model(machine, data)) if _is_loss(c))
        return intervals(fitter.fit(cause.extend(start_model(machine, data))))["torque_loss.X.share_ratio"]

    (_, *alone), (_, *with_current) = share(""), share("X_current_A")
    assert with_current[0] < 0.3 < with_current[1]
    assert np.ptp(with_current) < np.ptp(alone)


def _is_loss(cause):
    return cause.effect.kind == "torque_loss"


def test_all_torques_together_are_known_no_better_than_the_number_of_the_channel(tmp_path):
    """At a torque limit, derivatives by single numbers have kinks: they must not fix what no recording shows."""
    control = replace(FAST, clip=1.5)
    campaign, machine = recorded(tmp_path, "X_torque_Nm", control=control, noise=0.002)
    data = axis_data(campaign, "X", machine)
    fitter, start = LogFitter(machine, data, 1), start_model(machine, data)
    cause = next(c for c in Catalogue(machine, data).missing(start) if c.effect.kind == "current_clip")
    fit = fitter.polished(fitter.fit(cause.extend(start)), 1)
    way = torque_direction(fit.model, fit.model.vector)
    assert all(np.abs(d @ way).max() < 1e-5 * np.abs(d).max() for d in fit.design)
    for label, true in (("drive.inertia", AXIS.inertia), ("current_clip.X.torque_Nm", 1.5)):
        value, low, high = intervals(fit)[label]
        assert low < true < high and value == pytest.approx(true, rel=0.02)
        assert np.log(high / low) == pytest.approx(2.0 * 1.96 * 0.02, rel=0.2)


def test_the_noise_of_a_row_is_that_of_its_samples(tmp_path):
    campaign, machine = recorded(tmp_path, "X_current_A", 5.0, noise=0.03)
    (d,) = axis_data(campaign, "X", machine)
    row = output_row(d)
    assert row is not None and row.noise.rms == pytest.approx(0.15, rel=0.1)
    assert output_row(replace(d, record=replace(d.record, current=np.ones(len(d.time))))) is None


def test_a_user_is_told_what_a_torque_without_a_law_is_used_for(tmp_path):
    campaign, machine = recorded(tmp_path, "X_torque_Nm", -1.0)
    result = diagnose_logs(campaign, machine, max_effects=1)
    law, sign = sorted((f.sentence for f in result.signals if f.kind == "used"), reverse=True)
    assert "held against the torque of the model; no gain of the control is read from it" in law
    assert "the torque of X counts against the direction of the position; its sign is turned" in sign
    assert result.verdict == "nothing_found"
    (inertia,) = (s for s in result.sheet if s.name == "inertia")
    assert inertia.known and inertia.source == "motion"
