"""The time-step study: what the shipped step and sub-steps cost in the reading, against a step of a quarter and 20
times finer sub-steps.

Limits of the reading: 0.05 µm outside 50 ms of a reversal, 0.5 µm inside, with every effect of the first set on. The
drive equations' own solution by another method is in test_drive.py.
"""

import numpy as np
import pytest

from mjsim.effects.registry import make
from mjsim.simulation.drive import STEP, SUBSTEPS
from mjsim.simulation.multibody import simulate

FINE_STEP, FINE_SUBSTEPS = STEP / 4, 10


def first_set(machine):
    """The machine with its friction and every other effect of the first set, sizes as real machines have them or
    larger.
    """
    effects = []
    for k, axis in enumerate("XYZAC"):
        effects += [
            make(f"viscous_friction.{axis}", ratio=1.5),
            make(f"servo_gain.{axis}", ratio=[1.02, 0.98, 1.01, 1.03, 0.97][k]),
            make(f"velocity_gain.{axis}", ratio=0.9),
            make(f"servo_delay.{axis}", delay_ms=[0.7, -0.4, 0.3, 1.1, -1.3][k]),
            make(f"velocity_feedforward.{axis}", ratio=0.3),
        ]
    effects += [make("backlash.A", width_deg=0.002), make("backlash.C", width_deg=0.003)]
    effects += [make("pitch_error.A", components=[[60, 1.5e-3, 20.0], [360, 5e-4, 0.0]])]
    effects += [make("pitch_error.C", components=[[72, 2.5e-3, 20.0], [360, 5e-4, 0.0]])]
    effects += [make(f"squareness.{s}", angle_urad=40.0) for s in ("XY", "YZ", "ZX")]
    effects += [make(f"axis_location.{s}", value_um=30.0) for s in ("EX0C", "EY0C", "EY0A", "EZ0A")]
    effects += [make(f"axis_location.{s}", value_urad=30.0) for s in ("EA0C", "EB0C", "EB0A", "EC0A")]
    for effect in effects:
        machine = machine.with_effect(effect)
    assert sum(e.kind == "friction" for e in machine.effects) == 5
    assert not any(e.is_neutral for e in machine.effects)
    return machine


@pytest.fixture(scope="module")
def tests(cone):
    return [
        cone(15, 10, (50, 0, 155), feed=2000, name="15-x50"),
        cone(45, 30, (0, 100, 155), feed=2000, name="45-y100"),
        cone(15, 10, (50, 30, 155), feed=3000, name="15-fast"),
        cone(45, 30, (30, -20, 155), feed=3000, sensitive="parallel", direction="CW", name="45-parallel-fast"),
    ]


@pytest.fixture(scope="module")
def fine(machine, tests):
    """The reading for dt towards 0."""
    return simulate(first_set(machine), tests, step=FINE_STEP, substeps=FINE_SUBSTEPS)


def errors(machine, tests, fine, step, substeps):
    """Per test: reading's error (n,) m on the coarser of the two grids, and the reference's rows that it belongs to."""
    for reference, got in zip(fine, simulate(first_set(machine), tests, step=step, substeps=substeps), strict=True):
        every = round(STEP / FINE_STEP)
        own = round(STEP / step)
        n = min(len(reference.time[::every]), len(got.time[::own]))
        np.testing.assert_allclose(reference.time[::every][:n], got.time[::own][:n], rtol=0, atol=1e-9)
        yield (
            got.deviation[::own][:n] - reference.deviation[::every][:n],
            reference.time[::every][:n],
            reference.command[::every][:n],
        )


def test_shipped_step(machine, tests, fine, away_from_reversals):
    for test, (error, time, command) in zip(tests, errors(machine, tests, fine, STEP, SUBSTEPS), strict=True):
        clear = away_from_reversals(time, command)
        assert 0.7 < clear.mean() < 0.995, test.name
        assert np.abs(error[clear]).max() < 0.05e-6, test.name
        assert np.abs(error[~clear]).max() < 0.5e-6, test.name


def test_mujoco_step_alone(machine, tests, fine, away_from_reversals):
    """With fine sub-steps what is left is MuJoCo's step: the command taken as a parabola, play looked at once per
    step.
    """
    for error, time, command in errors(machine, tests, fine, STEP, 40):
        clear = away_from_reversals(time, command)
        assert np.abs(error[clear]).max() < 0.02e-6
        assert np.abs(error[~clear]).max() < 0.1e-6


def test_second_order_in_the_substep(machine, tests, fine, away_from_reversals):
    """Halving the sub-step divides the error by four where motion is smooth."""
    rms = {}
    for substeps in (1, 2, 4):
        rms[substeps] = [
            np.sqrt(np.mean(error[away_from_reversals(time, command) & (time > 1.0) & (time < time[-1] - 1.0)] ** 2))
            for error, time, command in errors(machine, tests, fine, STEP, substeps)
        ]
    for k in range(len(tests)):
        assert np.log2(rms[1][k] / rms[2][k]) == pytest.approx(2.0, abs=0.2)
        assert np.log2(rms[2][k] / rms[4][k]) == pytest.approx(2.0, abs=0.3)


def test_the_reference_has_converged(machine, tests, fine):
    """The reference itself moves by less than a tenth of the tightest limit when its sub-steps are four times
    coarser.
    """
    for reference, got in zip(
        fine, simulate(first_set(machine), tests, step=FINE_STEP, substeps=FINE_SUBSTEPS // 4), strict=True
    ):
        assert np.abs(reference.deviation - got.deviation).max() < 0.002e-6
