"""The uncertainty budget of the numbers that axis logs tell."""

import math

import numpy as np
import pytest
from independent.logs import Axis, Control, csv, machine_toml, record, to_and_fro, write_campaign

import mjsim
from mjsim.effects.registry import make
from mjsim.inference.axis_logs.budget import log_budget
from mjsim.inference.axis_logs.entries import DRIVE, ZERO, AxisModel, Entry
from mjsim.inference.axis_logs.fit import AxisFit

#: Places of the readings of a line, and the noise of one.
X, NOISE = np.linspace(1.0, 2.0, 50), 2e-7
#: Of y = zero + slope · x: variance of the slope with an unknown zero, and with a known one.
OPEN, KNOWN = NOISE**2 / np.sum((X - X.mean()) ** 2), NOISE**2 / np.sum(X**2)


def line(machine, deviation: float = np.inf, misfit: float = 1.0) -> AxisFit:
    """A line with a zero and a slope, which is called an inertia, fitted to one recording.

    Args:
        machine: Any.
        deviation: Prior of the zero.
        misfit: RMS of what is left, over the noise.
    """
    zero = Entry(ZERO, ZERO, 0.0, "log", deviation)
    model = AxisModel(machine, "X", (zero, Entry(DRIVE, "inertia", 3.0)))
    design = np.column_stack([np.ones(len(X)), X])
    return AxisFit(model, (np.zeros(len(X)),), (design,), (len(X),), (1.0 / (misfit * NOISE),), (NOISE,))


def test_a_line_has_the_budget_of_a_hand_calculation(m1):
    """What would go if the zero were known is the difference of the two variances."""
    (b,) = log_budget(line(m1))
    assert (b.effect_id, b.number, b.unit, b.value) == ("drive.X", "inertia", "kg·m²", 3.0)
    assert b.standard == pytest.approx(math.sqrt(OPEN), rel=0.01)
    assert b.rows["noise"] == pytest.approx(math.sqrt(OPEN), rel=0.01)
    assert b.rows["set_up"] == pytest.approx(math.sqrt(OPEN - KNOWN), rel=0.01)
    assert all(b.rows[row] < 1e-6 * b.standard for row in ("not_understood", "data_sheet", "other_errors"))
    assert b.remedies[b.largest].endswith(("the same motion", "(`mjsim plan`)"))
    (known,) = log_budget(line(m1, deviation=1e-12))
    assert known.standard == pytest.approx(math.sqrt(KNOWN), rel=0.01) and known.rows["set_up"] < 0.01 * known.standard


def test_a_number_of_the_data_sheet_that_no_log_shows_is_as_sure_as_the_sheet(m1):
    model = AxisModel(m1, "X", (Entry(DRIVE, "inertia", 3.0, deviation=0.03, log=True),))
    (b,) = log_budget(AxisFit(model, (np.zeros(5),), (np.zeros((5, 1)),), (5,), (1.0 / NOISE,), (NOISE,)))
    assert b.standard == pytest.approx(0.09) and b.rows["data_sheet"] == pytest.approx(0.09)


def test_a_diagnosis_of_logs_says_where_the_uncertainty_of_its_numbers_comes_from(tmp_path):
    """A wrong position gain: the total is that of the printed interval, and nobody knows it better than its parts."""
    axis, control = Axis(coulomb=0.12), Control(position_gain=40.0)
    command = to_and_fro(control.sample)
    actual, _ = record(axis, control, command, 0.02e-6)
    machine = machine_toml(axis, Control(position_gain=45.0), False, 0.12)
    write_campaign(tmp_path, csv(command, actual, None, control.sample) + "\n", machine, control.sample, "X")
    campaign = mjsim.read_campaign(tmp_path)
    result = mjsim.diagnose(campaign, mjsim.read_machine(campaign.machine_file))
    (found,) = result.effects
    b = result.budget[0]
    assert b.effect_id == found.effect.id == "servo_gain.X"
    low, high = found.ci95[b.number]
    assert b.standard == pytest.approx((high - low) / 3.92, rel=0.02)
    assert {"noise", "set_up", "data_sheet", "other_errors", "not_understood"} == set(b.rows)
    assert max(b.rows.values()) <= b.standard * 1.0001
    assert any(row["id"] == "drive.X" and row["number"] == "inertia" for row in result.to_json()["budget"])


def test_what_is_left_beyond_the_noise_is_not_understood(m1):
    """Three times the noise is left: a ninth of the variance is noise."""
    (b,) = log_budget(line(m1, misfit=3.0))
    assert b.standard == pytest.approx(3.0 * math.sqrt(OPEN), rel=0.01)
    assert b.rows["noise"] == pytest.approx(math.sqrt(OPEN), rel=0.01)
    assert b.rows["not_understood"] == pytest.approx(math.sqrt(8.0 * OPEN), rel=0.01)


def test_a_logarithm_and_a_wave_have_the_units_of_their_numbers(m1):
    """A drive's number that is fitted by its logarithm has a share; a wave is told by its amplitude."""
    wave = make("torque_ripple.X", amplitude_Nm=0.05, order=1.0, phase_deg=np.degrees(np.arctan2(0.03, 0.04)))
    parts = (Entry("torque_ripple.X", "cosine", 0.04), Entry("torque_ripple.X", "sine", 0.03))
    model = AxisModel(m1.with_effect(wave), "X", (Entry(DRIVE, "inertia", 3.0, log=True), *parts))
    design = np.eye(3)
    fit = AxisFit(model, (np.zeros(3),), (design,), (3,), (np.array([10.0, 100.0, 50.0]),), (0.001,))
    inertia, ripple = log_budget(fit)
    assert inertia.standard == pytest.approx(3.0 * 0.1)
    assert (ripple.number, ripple.unit, ripple.value) == ("amplitude_Nm", "N·m", pytest.approx(0.05))
    assert ripple.standard == pytest.approx(math.hypot(0.8 * 0.01, 0.6 * 0.02))
