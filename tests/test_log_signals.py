"""What the channels of a log are like, and loops that cannot be: said with numbers, handled or refused."""

import re
from dataclasses import replace

import numpy as np
import pytest
from test_control_files import run

from mjsim.campaign.files import read_campaign
from mjsim.errors import SimulationError
from mjsim.instruments.axis_log import signals
from mjsim.instruments.axis_log.instrument import log_mistakes
from mjsim.instruments.axis_log.measurement import AxisRecord, LogTest, Recorder, Recording
from mjsim.machine.chain import chain_of
from mjsim.machine.control import Control, Law
from mjsim.machine.plant import AxisPlant
from mjsim.simulation.servo import ServoStart, follow
from mjsim.simulation.stability import check_loop, outermost_pole
from mjsim.units import DEG, MM
from tests.independent.logs import CAMPAIGN, Axis, csv, machine_toml, record, short_strokes, to_and_fro, write_campaign
from tests.independent.logs import Control as Controller

CHAIN = chain_of("XYC")
TIME = 0.001 * np.arange(4000)
COMMAND = 30.0 * MM * np.sin(2 * np.pi * 0.7 * TIME)
ACTUAL = COMMAND - 0.02 * np.gradient(COMMAND, TIME) + 1e-7 * np.random.default_rng(1).standard_normal(len(TIME))


def found(time=TIME, resolution=1e-7, **axes):
    """Findings of one log by kind, as read_recording makes it."""
    records = {a: r if isinstance(r, AxisRecord) else AxisRecord(**r) for a, r in axes.items()}
    test = LogTest("log", tuple(axes), None, "log", "x", None, CHAIN)
    recording = signals.without_holds(Recording(time, records))
    recorder, recordings = Recorder(1000.0, resolution, 1e-4 * DEG), {"log": recording}
    found = signals.findings((test,), recordings, recorder)
    return {f.kind: f for f in found}, recording, log_mistakes((test,), recordings, recorder.rate)


@pytest.mark.parametrize("n", [2, 3, 8])
def test_a_held_channel_is_released(n):
    """By straight lines between the instants of reading, wherever in the recording they begin."""
    at = np.maximum((np.arange(len(TIME)) - 1) // n * n + 1, 0)
    kinds, recording, mistakes = found(X={"command": COMMAND, "actual": ACTUAL[at], "torque": COMMAND[at]})
    assert dict(recording.held) == {("X", "actual"): n, ("X", "torque"): n} and not mistakes
    assert f"each {n} ms" in kinds["held"].sentence
    bent = 30.0 * MM * (2 * np.pi * 0.7) ** 2 * (n * 1e-3) ** 2 / 8  # of a straight line from a sine
    np.testing.assert_allclose(recording.axes["X"].actual[n:-n], ACTUAL[n:-n], atol=1e-6 + bent)
    np.testing.assert_array_equal(recording.axes["X"].torque, COMMAND[at])  # a torque may really stand still


def test_coarse_steps_and_slow_motion_are_no_hold():
    """An encoder of 10 µm that moves slowly repeats its values as well; and its step is said and taken."""
    slow = 1.0 * MM * np.sin(2 * np.pi * 0.7 * TIME)
    coarse = np.round(slow / 1e-5) * 1e-5
    kinds, recording, _ = found(X={"command": slow, "actual": coarse})
    assert not recording.held and "steps of 10 µm in the file, resolution_um = 0.1" in kinds["step"].sentence
    assert "step" not in found(X={"command": COMMAND, "actual": ACTUAL})[0]
    steady = 50.0 * MM * TIME  # a grid of its own: the way of one sample
    assert "step" not in found(X={"command": steady, "actual": steady + 1e-4})[0]


def test_the_larger_step_of_an_encoder_is_taken(tmp_path):
    axis, control = Axis(coulomb=0.1), Controller(integral_time=0.04)
    command = to_and_fro()
    position, _ = record(axis, control, command)
    coarse = np.round(position / 2e-6) * 2e-6
    (tmp_path / "machine.toml").write_text(machine_toml(axis, control, identify=False, friction=0.1))
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    (tmp_path / "strokes.csv").write_text(csv(command, coarse))
    logs = read_campaign(tmp_path)
    assert logs.instrument.step_of(logs.tests[0].chain, "X") == pytest.approx(2e-6, rel=1e-3)
    assert logs.instrument.stated_step_of(logs.tests[0].chain, "X") < 1e-6


def test_clock_limits_copies_and_impossible_values():
    late = TIME + np.where(np.arange(len(TIME)) % 7 == 3, 2e-4, 0.0)
    late[2000:] += 0.003
    kinds, _, _ = found(late, X={"command": COMMAND, "actual": ACTUAL})
    assert "3 samples are missing in 1 places" in kinds["clock"].sentence and "0.2 ms" in kinds["clock"].sentence
    assert "clock" not in found(X={"command": COMMAND, "actual": ACTUAL})[0]

    torque = np.clip(8.0 * np.sin(2 * np.pi * 0.7 * TIME), -5.0, 5.0)
    kinds, _, mistakes = found(X={"command": COMMAND, "actual": ACTUAL, "torque": torque, "control": 1.5 * torque})
    assert "stands at 7.5 V" in kinds["limit"].sentence and not mistakes
    assert "a copy of the torque of X, times 1.5" in kinds["copy"].sentence
    stuck = np.where(TIME < 3.0, 1.0, 2.0)
    still = {"command": np.full(len(TIME), 0.1), "actual": np.full(len(TIME), 0.1)}
    assert "limit" not in found(X={**still, "torque": stuck}, Y={"command": COMMAND, "actual": ACTUAL})[0]

    _, _, mistakes = found(X={"command": COMMAND, "actual": COMMAND})
    assert [m.kind for m in mistakes] == ["copy"] and "nothing was measured" in mistakes[0].sentence
    kinds, _, mistakes = found(X={"command": COMMAND, "actual": COMMAND, "load": ACTUAL})
    assert not mistakes and kinds["copy"].sentence.endswith("a copy of the command of X: it says nothing more")
    _, _, mistakes = found(X={"command": COMMAND, "actual": ACTUAL}, Y={"command": 2 * COMMAND, "actual": ACTUAL})
    assert "copy" in [m.kind for m in mistakes]

    _, _, mistakes = found(X={"command": COMMAND, "actual": ACTUAL, "current": 10753.0 * np.sin(TIME)})
    assert "reaches 10,75" in mistakes[0].sentence and "correct the column's unit" in mistakes[0].sentence
    fast = 60.0 * np.gradient(COMMAND, TIME)
    _, _, mistakes = found(X={"command": COMMAND, "actual": ACTUAL, "velocity_command": fast})
    assert mistakes[0].kind == "impossible" and "60 times" in mistakes[0].sentence


def test_every_channel_is_used_or_said_not_to_be():
    """With the reason; what the diagnosis uses is not listed."""
    names = AxisRecord.__dataclass_fields__
    every = {name: ACTUAL * (i + 1) + np.sin(i * TIME) for i, name in enumerate(names)}
    every |= {"command": COMMAND, "actual": ACTUAL}
    test = LogTest("log", ("X",), None, "log", "x", None, CHAIN)
    said = signals.not_used(test, Recording(TIME, {"X": AxisRecord(**every)}))
    assert [f.sentence for f in said] == [
        "log: the velocity of X is recorded and not used by diagnose: the position says the same"
    ]


# --- loops -----------------------------------------------------------------------------------------------------------

PLANT = AxisPlant(2 * np.pi / 0.01, 45.0, 0.3, 0.02, 0.004, 0.01, 0.0, control=Control(sample_time=0.001))


@pytest.mark.parametrize(
    ("change", "stable"),
    [
        ({}, True),
        ({"velocity_gain": 9.0}, False),
        ({"position_gain": 3000.0}, False),
        ({"control": Control(sample_time=0.001, loop_delay=0.012)}, False),
        ({"control": Control(sample_time=0.001, loop_delay=0.0015)}, True),
        ({"control": Control(sample_time=0.001, torque_lag=0.03)}, False),
        ({"integral_time": np.inf}, True),
        ({"integral_time": 1e-4}, False),
        ({"control": Control(), "velocity_gain": 9.0}, True),
    ],
)
def test_the_poles_say_what_the_simulation_does(change, stable):
    """A small step grows without end exactly where a pole is outside the unit circle."""
    axis = replace(PLANT, **change)
    step = axis.control.sample_time or 1e-4
    time = step * np.arange(int(3.0 / step))
    with np.errstate(all="ignore"):
        moved = follow(axis, time, np.full(len(time), 1e-6) * (time > 0.01), ServoStart(0.0)).position
    grows = not np.isfinite(moved).all() or np.abs(moved[-200:]).max() > 1e-4
    assert grows == (not stable) == (abs(outermost_pole(axis, step)) > 1.0)
    if stable:
        check_loop(axis, "here", step)
    else:
        with pytest.raises(SimulationError, match=r"here: the .* loop swings itself up at .* Hz, e-fold every"):
            check_loop(axis, "here", step)


@pytest.mark.parametrize(("letter", "sample", "times"), [("X", 1e-3, 100.0), ("Y", 5e-4, 60.0), ("Z", 2e-3, 40.0)])
def test_an_unstable_machine_file_is_refused_before_anything_is_simulated(tmp_path, letter, sample, times):
    """By compare and diagnose, in one sentence that names table, loop and remedy; the remedy is right."""
    axis, control = Axis(coulomb=0.1), Controller(integral_time=0.04, sample=sample)
    command = short_strokes(sample)
    text = machine_toml(axis, control, identify=False, friction=0.1)
    gain = float(re.findall(r"velocity_gain_Nms_per_rad = (\S+)", text)[-1])
    head, _, tail = text.partition("[controller.")
    unstable = head + "[controller." + tail.replace(f"= {gain}", f"= {times * gain}")
    write_campaign(tmp_path, csv(command, record(axis, control, command)[0], None, sample), unstable, sample, letter)
    for command_name in ("compare", "diagnose"):
        status, said = run(command_name, tmp_path)
        said = " ".join(said.split())
        assert status == 1 and f"[controller.c.{letter}]: the velocity loop swings itself up" in said, said
    allowed = float(re.search(r"stable with these: velocity_gain_Nms_per_rad below about (\S+)", said)[1])
    assert gain < allowed < times * gain


@pytest.mark.parametrize("digits", [6, 9, 15])
def test_a_law_with_rounded_coefficients_integrates(digits):
    """R sums up to rounding: the axis begins at rest, as with the exact law."""
    pole = 0.824175824175824
    R = np.round([1.0, -1.0 - pole, pole], digits)
    S = tuple(c * 0.942 / (2 * np.pi) for c in (246.679, -488.5107, 241.8552))
    law = Control(sample_time=4e-4, law=Law(tuple(R), S, S), clip=1.5)
    axis = AxisPlant(2 * np.pi / 0.942e-3, 1.0, 0.0706, np.inf, 1.8e-5, 7e-5, 0.0, control=law)
    time = 4e-4 * np.arange(2000)
    command = 5 * MM + 0.2 * MM * np.sin(2 * np.pi * 2 * (time - 0.1)) * (time > 0.1)
    moved = follow(axis, time, command, ServoStart(5 * MM)).position
    assert np.abs(moved - command).max() < 0.05 * MM
