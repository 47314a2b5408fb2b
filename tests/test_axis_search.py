"""The search on axis logs: its evidence, its descent, waves over the motor's angle, and prediction of other logs."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine, write_machine
from mjsim.cli.main import main
from mjsim.commands.axis_log.compare import compare_logs
from mjsim.commands.axis_log.diagnose import diagnose_logs
from mjsim.commands.axis_log.diagnosis import little_known
from mjsim.errors import InputError
from mjsim.inference.axis_logs.descent import Descended, Priors, bounded_step, descend
from mjsim.inference.axis_logs.discrepancy import discrepancy_of
from mjsim.inference.axis_logs.entries import AxisModel
from mjsim.inference.axis_logs.fit import independent_count
from mjsim.machine.model import build
from mjsim.report.write import _finding, _sheet_row
from mjsim.simulation.servo import ServoStart, block_means, follow, sampled
from tests.independent.logs import CAMPAIGN, Axis, Control, csv, machine_toml, record, to_and_fro

CONTROL = Control()
FRICTION = Axis(coulomb=0.12)


@pytest.fixture
def folder(tmp_path):
    def make(axis, friction=0.12, **machine):
        command = to_and_fro(CONTROL.sample)
        (tmp_path / "strokes.csv").write_text(csv(command, *record(axis, CONTROL, command, 0.02e-6)))
        (tmp_path / "campaign.toml").write_text(CAMPAIGN)
        (tmp_path / "machine.toml").write_text(machine_toml(axis, CONTROL, False, friction, **machine))
        return tmp_path

    return make


def diagnosed(folder):
    return diagnose_logs(read_campaign(folder), read_machine(folder / "machine.toml"))


def test_a_torque_ripple_is_found_with_its_order(folder):
    result = diagnosed(folder(Axis(coulomb=0.12, ripple=0.03, ripple_order=3.0, ripple_phase=0.7)))
    (found,) = result.effects
    assert found.effect.id == "torque_ripple.X" and found.effect.values["order"] == 3.0
    low, high = found.ci95["amplitude_Nm"]
    assert low < 0.03 < high
    assert found.effect.values["phase_deg"] == pytest.approx(np.degrees(0.7), abs=3.0)
    assert 5.0 * result.after.rms < result.before.rms and result.after.rms < 0.1e-6
    open_ = replace(found, undetermined=("amplitude_Nm",)).to_json(result.machine)
    assert ["amplitude_Nm", "not determined", "–"] in _finding(found, open_)["rows"]
    row = _sheet_row(replace(result.sheet[0], known=False).to_json())
    assert (row["found"], row["ends"], row["source"]) == ("not determined", "–", "the data sheet")
    assert little_known("X", ["drive.inertia"]) == "X: the logs say little about drive.inertia"


def test_viscous_friction_by_direction_is_no_constant_force(folder):
    result = diagnosed(folder(Axis(coulomb=0.12, viscous_share=0.3)))
    assert [e.effect.id for e in result.effects] == ["viscous_direction.X"]
    assert result.effects[0].effect.values["share_ratio"] == pytest.approx(0.3, abs=0.02)


def test_friction_after_a_rest_is_found(folder):
    result = diagnosed(folder(Axis(coulomb=0.12, excess=0.8, way=0.05, rest=1.0)))
    assert [e.effect.id for e in result.effects] == ["rest_friction.X"]
    (found,) = result.effects
    low, high = found.ci95["excess_ratio"]
    assert low < 0.8 < high and result.after.rms < 0.1e-6


@pytest.mark.parametrize("ratio", [0.5, 2.5])
def test_a_coulomb_torque_that_is_not_that_of_the_data_sheet_is_found(folder, ratio):
    """As a number of its own, and not as another shape of the friction that the data sheet allows. Positions fix ratios
    of torques: it is known as well as the velocity gain (2 %) and the inertia (3 %) of the data sheet.
    """
    (found,) = diagnosed(folder(Axis(coulomb=0.12 * ratio))).effects
    assert found.effect.id == "friction.X" and found.probability > 0.95
    low, high = found.ci95["coulomb_Nm"]
    assert low < 0.12 * ratio < high and 1.04 < high / low < 1.07
    assert found.effect.values["static_ratio"] == 1.0


def test_a_fitted_machine_predicts_a_log_that_begins_elsewhere_on_the_screw(folder, tmp_path):
    """The encoder of another day has another zero: the phase of a wave is a nuisance, its amplitude is not."""
    ripple = Axis(coulomb=0.12, ripple=0.03, ripple_phase=0.7)
    place = folder(ripple)
    write_machine(diagnosed(place).machine, place / "machine.toml", tmp_path / "fitted.toml")
    fitted = read_machine(tmp_path / "fitted.toml")
    command = to_and_fro(CONTROL.sample)[::-1].copy()
    other = Axis(coulomb=0.12, ripple=0.03, ripple_phase=-2.0)
    (place / "strokes.csv").write_text(csv(command, *record(other, CONTROL, command, 0.02e-6, seed=2)))
    campaign = read_campaign(place)
    sheet = compare_logs(campaign, read_machine(place / "machine.toml"))
    predicted = compare_logs(campaign, fitted)
    assert predicted.rms < 0.3e-6 < 0.1 * sheet.rms


def test_part_of_a_recording(folder):
    place = folder(FRICTION)
    text = (place / "campaign.toml").read_text()
    (place / "campaign.toml").write_text(text + "span_s = [0.5, 1.25]\n")
    campaign = read_campaign(place)
    recording = campaign.traces["strokes"]
    assert recording.time[0] == 0.0 and recording.time[-1] == pytest.approx(0.75)
    assert compare_logs(campaign, read_machine(place / "machine.toml")).rms < 1e-6
    for span, said in (("[1.0, 0.5]", "growing"), ("[90.0, 99.0]", "leaves 0 samples")):
        (place / "campaign.toml").write_text(text + f"span_s = {span}\n")
        with pytest.raises(InputError, match=said):
            read_campaign(place)


def test_one_log_of_several_is_chosen(folder):
    place = folder(FRICTION)
    text = (place / "campaign.toml").read_text()
    again = text[text.index("[[test]]") :].replace('"strokes"', '"again"')
    (place / "campaign.toml").write_text(text + "\n" + again)
    run = CliRunner().invoke(main, ["compare", str(place), "--test", "again", "--no-plots", "--json"])
    assert run.exit_code == 0 and [t["name"] for t in json.loads(run.stdout)["tests"]] == ["again"]
    run = CliRunner().invoke(main, ["compare", str(place), "--test", "none", "--no-plots"])
    assert run.exit_code == 1 and "it has: strokes, again" in run.output


def test_block_means_are_those_of_the_samples(folder):
    place = folder(FRICTION)
    campaign, machine = read_campaign(place), read_machine(place / "machine.toml")
    recording = campaign.traces["strokes"]
    axis = build(machine.under("c")).axes["X"]
    command = sampled(axis, recording.time, recording.axes["X"].command)
    motion = follow(axis, recording.time, recording.axes["X"].command, ServoStart(0.0))
    for shift in (0.0, 2.4e-4, -1.7e-3):
        found, torque = block_means(axis, command, ServoStart(0.0), shift, 4)
        wanted = motion.at(recording.time - shift)[: 4 * len(found)].reshape(-1, 4).mean(axis=1)
        assert found == pytest.approx(wanted, abs=1e-12)
        assert torque == pytest.approx(motion.torque, abs=1e-12)


def test_the_evidence_counts_what_is_independent():
    """White residuals of twice the size: n log 2. A slow misfit beside them hides little of it, and what is below the
    noise counts nothing.
    """
    random = np.random.default_rng(1)
    white, n = random.normal(size=4096), 4096

    def gained(less, more, noise):
        none = AxisModel(None, "X")
        less, more = (discrepancy_of(none, [r], [np.zeros((n, 0))], [noise], ()).evidence for r in (less, more))
        return more - less

    assert gained(2.0 * white, white, 0.1) == pytest.approx(n * np.log(2.0), rel=0.01)
    slow = 30.0 * np.sin(2 * np.pi * 3.0 * np.arange(n) / n)
    assert gained(2.0 * white + slow, white + slow, 0.1) > 0.9 * n * np.log(2.0)
    assert gained(2.0 * white, white, 20.0) < 0.01 * n
    assert independent_count(white, np.inf) == pytest.approx(n, rel=0.1)
    assert independent_count(np.repeat(white, 8), np.inf) == pytest.approx(n, rel=0.1)


def test_a_bounded_step_is_the_minimum_within_the_bounds():
    normal = np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 1.0]])
    gradient = np.array([1.0, -2.0, 4.0])
    free = bounded_step(normal, gradient, 0.0, np.full(3, -9.0), np.full(3, 9.0))
    assert normal @ free == pytest.approx(gradient)
    held = bounded_step(normal, gradient, 0.0, np.full(3, -9.0), np.array([9.0, 9.0, 1.0]))
    assert held[2] == 1.0
    assert (gradient - normal @ held)[:2] == pytest.approx(0.0, abs=1e-12)
    assert (gradient - normal @ held)[2] > 0.0


def test_the_descent_finds_a_curved_minimum():
    t = np.linspace(0.0, 1.0, 200)
    truth = np.array([1.3, 4.0])
    noise = 1e-3 * np.random.default_rng(2).normal(size=200)

    def model(x):
        return x[0] * np.exp(-x[1] * t)

    measured = model(truth) + noise
    wide = Priors(
        np.ones(2),
        np.full(2, np.inf),
        np.full(2, 0.01),
        np.full(2, 10.0),
        np.full(2, 1.0),
        np.ones(2),
        np.zeros((2, 2)),
    )

    def columns(x, residual):
        return (np.column_stack([np.exp(-x[1] * t), -t * model(x)]),)

    begin = np.array([0.3, 1.0])
    start = Descended(begin, [measured - model(begin)], ())
    found = descend(start, wide, [200.0], [0.0], lambda x: [measured - model(x)], columns, 30)
    assert found.vector == pytest.approx(truth, rel=0.01)


def test_an_axis_that_stands_still_says_nothing(folder):
    place = folder(FRICTION)
    still = np.zeros(1500)
    (place / "strokes.csv").write_text(csv(still, still + 0.02e-6 * np.random.default_rng(4).normal(size=1500)))
    result = diagnosed(place)
    assert result.verdict == "nothing_found" and not result.sheet
    assert result.after.rms < 0.05e-6


def test_report_and_export_of_logs(folder, tmp_path):
    place = folder(Axis(coulomb=0.12, ripple=0.03, ripple_phase=0.7))
    page, tables = tmp_path / "report.html", tmp_path / "tables"
    run = CliRunner().invoke(main, ["report", str(place), "-o", str(page)])
    assert run.exit_code == 0, run.output
    text = page.read_text(encoding="utf-8")
    assert "Torque ripple of X." in text and "torque_ripple.X" in text and "http" not in text.replace("http-equiv", "")
    assert text.count("data:image/png") == 1 and "+ torque_ripple.X order 1" in text
    run = CliRunner().invoke(main, ["export", str(place), "--out", str(tables)])
    assert run.exit_code == 0, run.output
    rows = np.genfromtxt(tables / "strokes-X.csv", delimiter=",", names=True)
    assert rows["residual_um"] == pytest.approx(1e3 * (rows["measured_mm"] - rows["simulated_mm"]), abs=2e-3)
    assert (tables / "figures.csv").read_text().splitlines()[1].startswith("strokes,X,um,")
