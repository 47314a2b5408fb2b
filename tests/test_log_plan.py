"""The next motion to record: what it separates, and plans across ball bar and logs."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from test_joint import candidates, with_log

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.cli.main import main
from mjsim.commands import plan as planning
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.fit import LogFitter
from mjsim.inference.axis_logs.gains import read_gains
from mjsim.inference.axis_logs.planning import LogPlanner, unmeasured
from mjsim.inference.axis_logs.start import start_model
from mjsim.inference.settings import DIAGNOSIS, PLAN
from mjsim.instruments.axis_log.motions import Circle, Motion, proposals
from mjsim.machine.chain import usual_speed
from tests.independent.logs import CAMPAIGN, Axis, Control, csv, machine_toml, record, to_and_fro

FRICTION = Axis(coulomb=0.12)


def logged(folder, control, torque=False, identify=False, **wrong):
    command = to_and_fro(control.sample)
    position, torques = record(FRICTION, control, command)
    (folder / "strokes.csv").write_text(csv(command, position, torques if torque else None))
    (folder / "campaign.toml").write_text(CAMPAIGN)
    (folder / "machine.toml").write_text(machine_toml(FRICTION, control, identify, FRICTION.coulomb, **wrong))
    return read_campaign(folder), read_machine(folder / "machine.toml")


def test_motions_are_what_their_programs_say(m1):
    for axis in ("X", "C"):
        fastest = usual_speed(m1.chain)[m1.chain.index(axis)]
        for motion in proposals(m1.chain, axis):
            command = motion.command(1e-3)
            assert np.abs(np.diff(command)).max() <= 1.0001 * fastest * 1e-3
            assert command[0] == 0.0 and command[-1] == motion.moves[-1][0]
            if isinstance(motion, Circle):
                assert np.ptp(command) == pytest.approx(0.02, rel=1e-6) and "G2 X0 Y0 I10 " in motion.program()[2]
                continue
            words = [line for line in motion.program() if line.startswith("G1")]
            assert len(words) == motion.repeats * len(motion.moves)
            assert sum(float(w.split()[1][1:]) for w in words) == pytest.approx(0.0, abs=1e-6)
            assert axis in motion.words and motion.name.split("-")[-2] == axis.lower()


def test_a_trapezoid_keeps_its_acceleration():
    command = Motion("X", "strokes", ((0.06, 0.2), (0.0, 0.2)), 1, False).command(1e-3)
    assert np.abs(np.diff(command, 2)).max() == pytest.approx(2.0 * 1e-6, rel=0.01)
    assert np.abs(np.diff(command)).max() == pytest.approx(0.2e-3, rel=1e-6)


def test_only_a_torque_makes_inertia_and_gain_known(tmp_path):
    """Positions fix ratios of torques: no motion changes that, a recorded torque does."""
    campaign, machine = logged(tmp_path, Control(), identify=True)
    data = axis_data(campaign, "X", machine)
    fitter = LogFitter(machine, data, 1)
    fit = fitter.polished(fitter.fit(start_model(machine, data)))
    rows = LogPlanner(machine, "X", [fit], data[0]).known(("drive.inertia", "controller.c.velocity_gain"))
    assert rows[0].motion.torque and rows[0].decides and rows[0].left < 0.1
    assert all(r.left > 0.5 for r in rows if not r.motion.torque and r.motion.gain == 1.0)


def test_a_log_of_an_axis_that_has_none_is_planned(m2, monkeypatch):
    """Position gain against command delay: any motion that accelerates decides; slow constant speeds do not."""
    told = [m for m in proposals(m2.chain, "C") if m.kind in ("strokes", "slow reversals")]
    monkeypatch.setattr(LogPlanner, "motions", lambda self: told)
    fits = [unmeasured(m2, "C", m) for m in candidates(m2)]
    rows = {r.motion.kind: r for r in reversed(LogPlanner(m2, "C", fits).apart())}
    assert rows["strokes"].decides and rows["strokes"].deviance > 5.0 * rows["slow reversals"].deviance
    assert rows["strokes"].minutes < 2.0


def test_plan_across_instruments(tmp_path, monkeypatch):
    """The recording that decides in a minute comes before a ball-bar test that decides in four."""
    campaign = read_campaign(with_log(tmp_path))
    machine = read_machine(campaign.machine_file)
    test = SimpleNamespace(name="cone", duration=60.0)
    bars = SimpleNamespace(
        choices=(SimpleNamespace(test=test, deviance=500.0, difference=2e-7),),
        decides=True,
        settings=PLAN,
        to_json=lambda most: {"between": ["a", "b"], "test": {"name": "cone"}, "difference_um": 0.2,
                              "separation": 22.4, "minutes": 4.3, "runners_up": []},
    )  # fmt: skip
    monkeypatch.setattr(planning, "worth", lambda s: (1.0, min(s.deviance, 400.0) / 4.3))
    data = planning._across(campaign, machine, candidates(machine), bars, 1, DIAGNOSIS).to_json()
    assert data["instrument"] == "axis_log" and data["decides"] and data["test"]["axes"] == ["C"]
    assert "ball_bar" in {row["instrument"] for row in data["runners_up"]}
    assert data["program"][0] == "G91" and "difference_deg" in data
    stricter = replace(DIAGNOSIS, plan=replace(PLAN, decisive=1e12, certain=1e13))
    bars.settings, bars.decides = stricter.plan, False
    monkeypatch.setattr(LogPlanner, "motions", lambda self: list(proposals(self.chain, self.axis))[:1])
    data = planning._across(campaign, machine, candidates(machine), bars, 1, stricter).to_json()
    assert data["enough"] == 1e6 and not any(row["decides"] for row in (data, *data["runners_up"]))


def test_plan_command_for_logs(tmp_path):
    logged(tmp_path, Control(), identify=True, inertia=9e-4, velocity_gain=0.12)
    run = CliRunner().invoke(main, ["plan", str(tmp_path), "--json", "--quiet"])
    assert run.exit_code == 0, run.output
    data = json.loads(run.stdout)
    assert "drive.inertia" in data["between"] and data["test"]["name"].endswith("-torque")
    assert data["decides"] and data["left"] < 0.25
    run = CliRunner().invoke(main, ["plan", str(tmp_path), "--between", "loop_delay.X", "torque_ripple.X"])
    assert run.exit_code == 0 and "NC program" in run.output and "σ" in run.output
    run = CliRunner().invoke(main, ["plan", str(tmp_path), "--between", "loop_delay.X", "backlash.X"])
    assert run.exit_code == 1 and "allowed for this axis' logs" in run.output


def test_gains_are_read_from_an_output_that_comes_late(tmp_path):
    control = Control(delay_samples=3)
    campaign, machine = logged(tmp_path, control, torque=True)
    (read,) = read_gains(machine, axis_data(campaign, "X", machine))
    assert read.explained > 0.9999
    assert read.values["position_gain"] == pytest.approx(control.position_gain, rel=1e-4)
    assert read.values["velocity_gain"] == pytest.approx(control.velocity_gain, rel=1e-4)


def test_of_two_zeros_that_change_places_the_data_sheet_says_which_is_which(tmp_path):
    """With full feedforward, the position gain and one over the integral time are two zeros of one law."""
    control = Control(integral_time=0.0229, position_gain=60.0, feedforward=1.0)
    campaign, machine = logged(tmp_path, control, torque=True, integral_time=0.00916)
    (read,) = read_gains(machine, axis_data(campaign, "X", machine))
    assert read.values["position_gain"] == pytest.approx(60.0, rel=1e-3)
    assert read.values["integral_time"] == pytest.approx(0.0229, rel=1e-3)


def test_a_reading_that_contradicts_the_sheet_is_no_prior(tmp_path):
    """The cause is looked for instead: a prior outside its bounds would pull at every other number."""
    control = Control(integral_time=0.0229, position_gain=60.0, feedforward=1.0)
    campaign, machine = logged(tmp_path, control, torque=True, integral_time=0.00916)
    data = axis_data(campaign, "X", machine)
    entries = {e.name: e for e in start_model(machine, data, read_gains(machine, data)).entries}
    assert entries["integral_time"].mean == pytest.approx(np.log(0.00916))
    for e in entries.values():
        assert e.bounds[0] <= e.mean <= e.bounds[1]


def test_a_log_as_a_video(tmp_path):
    """The whole trace stands in the last frame; the first has almost nothing of it."""
    from mjsim.animation.recording import animate_recording

    campaign, machine = logged(tmp_path, Control(), inertia=6e-4)
    film = animate_recording(campaign, "strokes", tmp_path / "log.gif", machine, size="480x360", seconds=0.5)
    assert film.frames == 5 and film.seconds == pytest.approx(0.5) and film.magnification >= 1.0
    from PIL import Image

    with Image.open(tmp_path / "log.gif") as image:
        assert image.n_frames == 5 and image.size == (480, 360)
        first = np.array(image.convert("L"), float)
        image.seek(4)
        last = np.array(image.convert("L"), float)
    assert (last < 128).sum() > (first < 128).sum() + 300
