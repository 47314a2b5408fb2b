"""Structures that ring when axes accelerate: closed forms, and a mode that is found where there is one."""

import math

import numpy as np
import pytest
from independent import chain_campaigns

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.inference.findings import explain
from mjsim.inference.problem import Problem
from mjsim.inference.resonance import driving, swing
from mjsim.inference.unexplained import FurtherCurve
from mjsim.inference.vibration import Separated
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.model import build

STEP = 0.005
TIME = STEP * np.arange(400)
BALL = np.array([0.05, 0.0, 0.155])


@pytest.mark.parametrize(("frequency", "damping"), [(8.0, 0.02), (13.0, 0.05), (35.0, 0.3)])
def test_an_acceleration_that_rises_evenly_has_the_response_of_the_textbooks(frequency, damping):
    omega, jerk = 2.0 * math.pi * frequency, 3.0
    damped = omega * math.sqrt(1.0 - damping**2)
    wave = 2.0 * damping / omega * np.cos(damped * TIME) + (2.0 * damping**2 - 1.0) / damped * np.sin(damped * TIME)
    ramp = TIME - 2.0 * damping / omega + np.exp(-damping * omega * TIME) * wave
    found = swing(jerk * TIME[:, None], frequency, damping, STEP)[:, 0]
    np.testing.assert_allclose(found, -jerk / omega**2 * ramp, atol=1e-10)


def test_far_below_its_frequency_it_follows_the_acceleration():
    acceleration = np.sin(2.0 * math.pi * 0.5 * TIME)[:, None]
    sag = -acceleration / (2.0 * math.pi * 30.0) ** 2
    settled = TIME > 0.5
    np.testing.assert_allclose(
        swing(acceleration, 30.0, 0.2, STEP)[settled], sag[settled], atol=0.02 * np.abs(sag).max()
    )


def test_at_its_frequency_it_swings_by_one_over_twice_its_damping():
    time = STEP * np.arange(4000)
    omega = 2.0 * math.pi * 10.0
    found = swing(np.sin(omega * time)[:, None], 10.0, 0.05, STEP)[time > 10.0]
    assert np.abs(found).max() == pytest.approx(1.0 / (2.0 * 0.05 * omega**2), rel=0.01)


def test_the_step_does_not_matter_where_the_acceleration_is_straight():
    rng = np.random.default_rng(1)
    coarse = rng.standard_normal((60, 2))
    coarse[0] = 0.0
    fine = np.column_stack([np.interp(np.arange(591) / 10.0, np.arange(60), c) for c in coarse.T])
    np.testing.assert_allclose(swing(fine, 17.0, 0.04, 0.1 * STEP)[::10], swing(coarse, 17.0, 0.04, STEP), atol=1e-9)


def test_what_shakes_it_is_the_slides_and_what_the_table_carries():
    """A circle at 2 rad/s in X and Y, while the table turns as fast under its ball."""
    angle = 2.0 * TIME
    q = np.zeros((len(TIME), 5))
    q[:, 0], q[:, 1], q[:, 4] = 0.1 * np.cos(angle), 0.1 * np.sin(angle), angle
    found = driving(FIVE_AXIS, q, BALL, STEP)[1:-1]
    assert found.shape[1] == 6
    np.testing.assert_allclose(np.linalg.norm(found[:, :3], axis=1), 0.1 * 4.0, rtol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(found[:, 3:], axis=1), 0.05 * 4.0, rtol=1e-4)


@pytest.mark.parametrize("frequencies", [(13.0, 13.0), (13.0, 17.0), ()])
def test_modes_are_found_where_there_are_some(tmp_path, frequencies):
    """Spindle head and table ring on a machine with its small errors; the independent generator's modes share no code
    with ours. Without them there is none.
    """
    chain_campaigns.write(chain_campaigns.ringing(*frequencies), tmp_path)
    campaign = read_campaign(tmp_path)
    machine = read_machine(campaign.machine_file)
    found = explain(Separated(Problem.of(campaign, build(machine)), machine, ()))
    assert not found.selection.found
    assert found.unexplained is None
    modes = sorted(curve.mode for curve in found.further if curve.mode)
    assert len(modes) == len(frequencies)
    for mode, frequency in zip(modes, frequencies, strict=True):
        assert mode == pytest.approx((frequency, 0.03), rel=0.15)
    assert found.discrepancy < 0.1e-6


def test_it_is_told_with_its_frequency():
    mode = FurtherCurve("", "structure", "swing", 1.2e-6, 0.0, 0.3e-6, 1.0, (13.04, 0.051))
    assert mode.summary == (
        "The structure swings at 13.0 Hz (damping ratio 0.051) when axes accelerate: up to 1.2 µm, 0.30 µm RMS in the "
        "readings."
    )
    assert mode.to_json().items() >= {"frequency_Hz": 13.04, "damping_ratio": 0.051, "rms_um": 0.3}.items()
    assert "frequency_Hz" not in FurtherCurve("C", "Z", "position", 5e-7, 6e-7, 1e-7, 0.01).to_json()
