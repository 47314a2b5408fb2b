"""Pitch error from two encoders of one axis: guide logs of worm gears, and an axis that runs forth and back."""

import json
from pathlib import Path

import numpy as np
import pytest
from test_control_files import guide_log, run

from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.model import Campaign
from mjsim.campaign.new import new_log_campaign
from mjsim.errors import InputError
from mjsim.inference.pitch.encoders import TURNS, identify_from_encoders
from mjsim.instruments.axis_log.measurement import AxisRecord, LogTest, Recorder, Recording
from mjsim.machine.chain import chain_of
from mjsim.units import DEG

CHAIN = chain_of("C")
RATE = 2 * np.pi / 86164.0905


def logs_of(*recordings):
    """Logs of the axis C from (time, motor, load) in s and rad."""
    tests = tuple(LogTest(f"g{i}", ("C",), None, "one", "x", None, CHAIN) for i in range(len(recordings)))
    made = {
        t.name: Recording(r[0], {"C": AxisRecord(r[1], r[1], load=r[2])})
        for t, r in zip(tests, recordings, strict=True)
    }
    folder = Path("nowhere")
    return Campaign("guide", folder, folder / "machine.toml", tests, made, {"axis_log": Recorder(0.5)})


def star(waves, minutes, seed, noise=0.4, step=2.0, drift=(3.0, -20.0, 5.0)):
    """A motor that turns with the sky, and a load with waves (order, arc seconds, phase), drift, uneven samples."""
    random = np.random.default_rng(seed)
    time = np.cumsum(step * random.uniform(0.8, 1.4, int(60 * minutes / step / 1.1)))
    motor = RATE * time
    u = time / time[-1]
    error = sum(c * u**k for k, c in enumerate(drift))
    error += sum(a * np.sin(n * motor + p) for n, a, p in waves) + noise * random.standard_normal(len(time))
    return time, motor, motor + error * DEG / 3600


@pytest.mark.parametrize(
    ("teeth", "minutes", "waves"),
    [
        (225, 130, [(225, 1.8, 0.3), (450, 0.3, 1.0), (675, 0.35, 2.0), (1125, 0.5, 0.0)]),
        (180, 45, [(180, 8.0, 1.0), (360, 0.8, 0.0), (478.5, 4.0, 2.0)]),
        (360, 28, [(360, 4.0, 1.0), (720, 1.6, 2.0), (1080, 0.7, 2.0)]),
        (180, 90, [(705.0, 4.2, 1.0), (360, 1.2, 0.5), (540, 0.9, 0.5), (900, 0.6, 0.2), (1800, 0.5, 0.2)]),
        (135, 80, [(135, 6.0, 1.0), (270, 1.0, 2.0)]),
    ],
)
def test_teeth_of_a_worm_wheel(teeth, minutes, waves):
    """Within 1 %, from four turns of the worm on, beside gears of the train, with drift: also where only its
    multiples are seen, and a gear of the train is the largest."""
    found = identify_from_encoders(logs_of(star(waves, minutes, teeth + minutes)), "C")
    order, sd = found.worm
    assert order == pytest.approx(teeth, rel=0.01) and abs(order - teeth) < 4 * sd, (order, sd)
    for n, a, _ in waves:
        near = min(found.waves, key=lambda w: abs(w.order - n))
        size = near.amplitude / DEG * 3600
        assert abs(near.order - n) < 4.5 * near.order_sd + 0.2 and size == pytest.approx(a, abs=0.3), (n, near)
    assert found.left / DEG * 3600 < 0.45


def test_two_recordings_have_drifts_of_their_own():
    a, b = star([(225, 2.0, 0.3)], 60, 1), star([(225, 2.0, 0.3)], 50, 2, drift=(-40.0, 30.0))
    motor = b[1] + 0.31
    load = (
        motor
        + 2.0 * np.sin(225 * motor + 0.3) * DEG / 3600
        + (b[2] - b[1])
        - 2.0 * np.sin(225 * b[1] + 0.3) * DEG / 3600
    )
    found = identify_from_encoders(logs_of(a, (b[0], motor, load)), "C")
    assert found.worm[0] == pytest.approx(225, rel=0.005) and len(found.waves) == 1
    assert found.waves[0].phase == pytest.approx(0.3, abs=0.25)


@pytest.mark.parametrize("seed", range(6))
def test_noise_and_drift_name_nothing(seed):
    """White and red noise of a mount without a periodic error: no wave, or none of four turns."""
    time, motor, load = star([], 70, seed, noise=0.5)
    red = np.random.default_rng(100 + seed).standard_normal(len(time))
    red = np.convolve(red, np.exp(-np.arange(60) / 15.0), mode="full")[: len(time)] * 0.05 * (seed % 2)
    found = identify_from_encoders(logs_of((time, motor, load + red * DEG / 3600)), "C")
    assert len(found.waves) <= (seed % 2), [w.order for w in found.waves]


def test_a_wave_of_too_few_turns_is_drift():
    """Three turns in the recording: it is found, and not called a worm."""
    found = identify_from_encoders(logs_of(star([(100, 5.0, 0.0)], 43, 7)), "C")
    assert found.worm is None and found.slow and max(w.turns for w in found.slow) < TURNS


def test_an_axis_that_runs_forth_and_back_over_a_turn():
    """A cyclic error of order 4 beside play and latency of the second encoder: whole orders, from one turn on."""
    time = np.arange(0.0, 40.0, 0.01)
    motor = np.pi * (1.0 - np.cos(2 * np.pi * time / 20.0))
    rate = np.gradient(motor, time)
    error = 0.3 * np.sin(4 * motor + 1.0) + 0.2 * np.sin(motor) + 0.15 * np.sign(rate)
    load = motor + error * DEG - 0.02 * rate + 0.01 * DEG * np.random.default_rng(1).standard_normal(len(time))
    found = identify_from_encoders(logs_of((time, motor, load)), "C")
    assert {w.order for w in found.waves} == {1.0, 4.0}
    four = next(w for w in found.waves if w.order == 4.0)
    assert four.amplitude == pytest.approx(0.3 * DEG, rel=0.03) and four.phase == pytest.approx(1.0, abs=0.03)


def test_the_command_on_a_guide_log(tmp_path):
    """From the file to the teeth and a machine file; without a load side it is said what is needed."""
    time, motor, load = star([(180, 8.0, 0.5), (360, 1.0, 0.0)], 50, 3, step=4.0)
    (tmp_path / "g.txt").write_text(guide_log((load - motor) / DEG * 3600, time))
    folder = tmp_path / "mount"
    new_log_campaign(folder, "C")
    status, said = run("import", tmp_path / "g.txt", "--campaign", folder, "--log")
    assert status == 0, said
    status, said = run("identify", "pitch-error", folder, "--write", folder / "found.toml")
    assert status == 0 and "number of teeth" in said, said
    status, said = run("identify", "pitch-error", folder, "--json")
    worm = json.loads(said)["axes"]["C"]["worm"]
    assert worm["order"] == pytest.approx(180, rel=0.01) and worm["period_s"] == pytest.approx(478.7, rel=0.01)
    effect = next(e for e in read_machine(folder / "found.toml").effects if e.id == "pitch_error.C")
    order, amplitude, _ = effect.values["components"][0]
    assert order == pytest.approx(180, rel=0.01) and amplitude == pytest.approx(8.0 / 3600, rel=0.05)
    bare = logs_of((time, motor, motor))
    bare.traces["g0"].axes["C"].__dict__["load"] = None
    with pytest.raises(InputError, match="C_load_deg"):
        identify_from_encoders(bare, "C")
