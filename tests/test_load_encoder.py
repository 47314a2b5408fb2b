"""The position loop closed on an encoder at the load: a play inside that loop."""

from dataclasses import replace

import numpy as np
import pytest

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.axis_log.diagnose import diagnose_logs
from mjsim.machine.control import Control, Law
from mjsim.machine.plant import AxisPlant
from mjsim.simulation.axes import motor_of
from mjsim.simulation.servo import ServoStart, follow
from tests.independent.logs import Axis, csv, machine_toml, record_both, short_strokes, write_campaign
from tests.independent.logs import Control as Digital

GEAR, PLAY, SPEED, KPP = 2.0 * np.pi / 0.010, 20e-6, 2e-3, 40.0
AXIS = AxisPlant(GEAR, KPP, 0.1, 1e9, 2e-5, 0.0, 0.0, feedforward=1.0)
PLAYING = replace(AXIS, encoder="load", play=0.5 * PLAY * GEAR)
TIME = np.arange(0.0, 5.0, 1e-3)


def there_and_back(stop: float = 0.5):
    """A ramp that turns back at 1 s at once, and stands still at the end."""
    return SPEED * np.clip(np.minimum(TIME, 2.0 - TIME), -stop, None)


def of_log(axis, command=None):
    command = there_and_back() if command is None else command
    return follow(replace(axis, control=Control(sample_time=5e-5)), TIME, command, ServoStart(0.0)).at(TIME)


@pytest.mark.parametrize("moved", [of_log, lambda a: motor_of(a, TIME, there_and_back())], ids=["log", "ball bar"])
def test_play_inside_the_loop_is_taken_out_at_rest_and_not_while_the_axis_turns_back(moved):
    """While the motor crosses the play w, the load stands still and its error e = v t grows. With full feedforward the
    motor runs at v + Kpp e, so that v T + Kpp v T²/2 = w when it has crossed; e then decays by exp(−Kpp t).
    """
    error = there_and_back() - moved(PLAYING)
    crossing = (np.sqrt(1.0 + 2.0 * KPP * PLAY / SPEED) - 1.0) / KPP
    # a little earlier, the load had come to where the ramp turns; the velocity loop needs a moment to turn the motor
    assert -error[(TIME > 1.0) & (TIME < 1.2)].min() == pytest.approx(SPEED * crossing, rel=0.08)
    after = (TIME > 1.0 + crossing + 0.02) & (TIME < 1.0 + crossing + 0.06)
    rate = np.polyfit(TIME[after], np.log(-error[after]), 1)[0]
    assert rate == pytest.approx(-KPP, rel=0.06)
    assert abs(error[-1]) < 1e-9 and abs(error[(TIME > 0.8) & (TIME < 1.0)]).max() < 0.1e-6


def test_the_motor_runs_ahead_by_half_of_the_play():
    motor, load = of_log(replace(PLAYING, encoder="both")), of_log(PLAYING)
    behind = (TIME > 0.8) & (TIME < 1.0)
    assert motor[behind] - load[behind] == pytest.approx(0.5 * PLAY, abs=1e-9)


def test_without_play_both_encoders_are_one():
    assert np.array_equal(of_log(replace(PLAYING, play=0.0)), of_log(AXIS))
    still = motor_of(AXIS, TIME, there_and_back())
    assert np.array_equal(motor_of(replace(PLAYING, play=0.0), TIME, there_and_back()), still)


def test_a_law_and_a_lag_see_the_load():
    """The same cascade written as a law, whose velocity is the load's too, and with a lag: the play is out at rest."""
    h = 5e-5
    law = Law((1.0,), (KPP + 1.0 / h, -1.0 / h), (KPP + 1.0 / h, -1.0 / h))
    controls = [Control(sample_time=h, law=law), Control(sample_time=h, torque_lag=5e-4)]
    for control in controls:
        moved = follow(replace(PLAYING, control=control), TIME, there_and_back(), ServoStart(0.0))
        assert abs(there_and_back()[-1] - moved.position[-1]) < 0.2e-6
    outside = follow(replace(AXIS, control=controls[1]), TIME, there_and_back(), ServoStart(0.0)).position
    assert abs(there_and_back()[-1] - outside[-1]) < 1e-9


def test_a_spring_inside_the_loop_is_taken_out():
    """The load behind a spring under a constant torque on the motor's side: the load stands where it should."""
    sprung = replace(AXIS, load_inertia=1e-5, stiffness=20.0, damping=0.01, encoder="load")
    load = motor_of(sprung, TIME, there_and_back())
    assert abs(load[-1] - there_and_back()[-1]) < 1e-9


def diagnosed(folder, encoder, width, letter="X", sample=1e-3):
    """A log of an axis with play inside its loop: of the load alone, or of motor and load."""
    axis, control = Axis(coulomb=0.12, play=width), Digital(feedforward=1.0, on_load=True, sample=sample)
    command = short_strokes(sample)
    motor, load, _ = record_both(axis, control, command, 0.02e-6)
    rows = csv(command, load if encoder == "load" else motor, None, sample).splitlines()
    if encoder == "both":
        rows = [rows[0] + ",X_load_mm", *(f"{row},{1e3 * y:.7f}" for row, y in zip(rows[1:], load, strict=True))]
    machine = machine_toml(axis, control, False, 0.12).replace("[drive.X]", f'[drive.X]\nencoder = "{encoder}"')
    place = write_campaign(folder, "\n".join(rows) + "\n", machine, sample, letter)
    return diagnose_logs(read_campaign(place), read_machine(place / "machine.toml"))


@pytest.mark.parametrize(
    ("encoder", "width", "letter", "sample"),
    [("load", 20e-6, "Z", 5e-4), ("both", 10e-6, "Y", 1e-3)],
)
def test_play_inside_the_loop_is_found(tmp_path, encoder, width, letter, sample):
    result = diagnosed(tmp_path, encoder, width, letter, sample)
    assert [e.effect.id for e in result.effects] == [f"backlash.{letter}"]
    low, high = result.effects[0].ci95["width_um"]
    assert low < 1e6 * width < high and high - low < 0.1e6 * width
    assert result.after.rms < 0.3e-6


def test_a_load_without_play_has_none(tmp_path):
    result = diagnosed(tmp_path, "load", 0.0)
    assert result.verdict == "nothing_found" and "backlash.X" not in result.not_testable
    assert "pitch_error.X" in result.not_testable
