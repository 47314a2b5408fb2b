"""Campaigns in which one instrument has measured and another is only planned, and what follows a diagnosis of both."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from commands import cut
from independent import logs, machine_logs
from independent.campaign import Case

import mjsim
from mjsim.campaign.machine_file import read_machine
from mjsim.cli.main import main
from mjsim.commands.axis_log.diagnosis import LogDiagnosis
from mjsim.commands.ball_bar.compare import _both_ways
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.finding import DiagnosedEffect
from mjsim.commands.saved import read_saved
from mjsim.inference.data_sheet import data_sheet
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.posterior import Posterior
from mjsim.inference.unexplained import Unexplained
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.units import DEG

BAR_TEST = """
[[test]]
name = "planned-circle"
kind = "circular"
plane = "XY"
direction = "CCW"
table_ball_mm = [0.0, 0.0, 155.0]
bar_length_mm = 100.0
feed_mm_min = 1000.0
"""
TEST = "cone15-centre-ccw"


def run(*arguments):
    result = CliRunner().invoke(main, [*map(str, arguments)])
    assert result.exit_code == 0, result.output
    return result.stdout


def campaign(folder, traces):
    """One ball-bar test, measured or planned, beside a recorded log of C."""
    cut(folder, (TEST,), traces, "two-candidates")
    hidden = ({"id": "servo_gain.C", "ratio": 1.03},)
    machine_logs.add(Case("two-candidates", "M2", (), hidden, seed=5), folder, "C", False)
    return folder


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    return campaign(tmp_path_factory.mktemp("planned") / "campaign", False)


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    return campaign(tmp_path_factory.mktemp("both") / "campaign", True)


@pytest.mark.parametrize("command", [("check",), ("compare", "--no-plots"), ("report", "--no-diagnose")])
def test_a_planned_test_does_not_hide_a_recorded_log(planned, tmp_path, command):
    more = ["-o", tmp_path / "page.html"] if command[0] == "report" else []
    data = json.loads(run(command[0], planned, *command[1:], *more, "--json"))
    assert [t["name"] for t in data["tests"]] == ["strokes-c"]
    if "not_measured" in data:
        assert data["not_measured"] == [TEST]


def test_a_recorded_log_beside_a_planned_test_is_exported_and_opened(planned, tmp_path):
    files = json.loads(run("export", planned, "--out", tmp_path / "tables", "--json"))["files"]
    assert [f.rpartition("/")[2] for f in files] == ["strokes-c-C.csv", "figures.csv"]
    assert mjsim.open_workbench(planned).quick().of("axis_log") is not None


def test_one_test_of_any_instrument_is_chosen(both):
    data = json.loads(run("compare", both, "--test", "strokes-c", "--no-plots", "--json"))
    assert [t["name"] for t in data["tests"]] == ["strokes-c"] and "axis_logs" not in data
    result = CliRunner().invoke(main, ["compare", str(both), "--test", "nothing"])
    assert result.exit_code == 1 and f"no test 'nothing' with a trace; it has: {TEST}, strokes-c" in result.output


def test_a_planned_test_does_not_stop_a_diagnosis_or_a_plan(planned, monkeypatch):
    """Both begin with the search on the log."""

    class Searched(Exception):
        pass

    def search(campaign, *_, **__):
        assert [t.name for t in campaign.of("axis_log").measured] == ["strokes-c"]
        raise Searched

    monkeypatch.setattr("mjsim.commands.diagnose.diagnose_logs", search)
    c = mjsim.read_campaign(planned)
    for command in (mjsim.diagnose, mjsim.plan):
        with pytest.raises(Searched):
            command(c, read_machine(c.machine_file))


def test_calibrate_fits_the_data_sheet_to_logs(tmp_path):
    """The drive has half of the inertia that the file states; a fit within [identify] finds it."""
    control, axis = logs.Control(), logs.Axis(coulomb=0.12)
    command = logs.to_and_fro(control.sample)
    (tmp_path / "strokes.csv").write_text(logs.csv(command, *logs.record(axis, control, command, 0.02e-6)))
    (tmp_path / "campaign.toml").write_text(logs.CAMPAIGN)
    (tmp_path / "machine.toml").write_text(logs.machine_toml(axis, control, True, 0.12, inertia=2.0 * axis.inertia))
    given = json.loads(run("compare", tmp_path, "--no-plots", "--json"))
    data = json.loads(run("compare", tmp_path, "--calibrate", "--no-plots", "--json"))
    assert data["rms_as_given_um"] == pytest.approx(given["rms_um"], rel=1e-5) and "calibration" not in data
    assert data["rms_um"] < 0.2 * given["rms_um"]
    (inertia,) = (row for row in data["data_sheet"] if row["name"] == "inertia")
    assert inertia["ratio"] == pytest.approx(0.5, rel=0.05)
    assert "data sheet" in run("compare", tmp_path, "--calibrate", "--no-plots")


REST = """
import numpy as np
import mjsim

@mjsim.register
class Rest(mjsim.Effect):
    kind = "rest_of_test"
    subjects = ("A",)
    title = definition = source = signature = "test"
    parameters = (mjsim.Parameter("gain", "gain", 0.0, 2.0, neutral=0.0, scale=1.0),)

    def position_error(self, motion):
        return np.zeros_like(motion.position)
"""


@pytest.fixture(scope="module")
def diagnosed(both, tmp_path_factory):
    """The campaign after ``mjsim diagnose --write`` has found a cause with both instruments, and an unknown one."""
    folder, c = tmp_path_factory.mktemp("diagnosed"), mjsim.read_campaign(both)
    given = read_machine(c.machine_file)
    gain = mjsim.make_effect("servo_gain.C", given.chain, ratio=1.03)
    wave = mjsim.make_effect("viscous_friction.C", given.chain, ratio=1.2)
    machine = given.with_effect(gain).with_effect(wave)
    before, after = mjsim.compare(c, given), mjsim.compare(c, machine)
    x = np.linspace(-90.0, 90.0, 5)
    rest = Unexplained(("A",), "position", None, 1e-6, (TEST,), (), "Something is left.", (x, x, x), ("A, °", "µm"),
                       source=REST)  # fmt: skip
    found = (
        DiagnosedEffect(gain, ("ratio",), {"ratio": [1.029, 1.031]}, 2e-6, 1e-6, (), (TEST,), decided_by="axis_log"),
        DiagnosedEffect(wave, ("ratio",), {"ratio": [1.1, 1.3]}, 2e-5, 1e-5, (), ("strokes-c",),
                        found_by="axis_log", decided_by="axis_log"),
    )  # fmt: skip
    free = EffectVector(gain, ("ratio",))
    posterior = Posterior((free,), 0.01 * np.eye(1 + len(data_sheet(given.chain))))
    bars, recorded = (tuple(r.of(name) for r in (before, after)) for name in ("ball_bar", "axis_log"))
    seen = LogDiagnosis(c, "identified", found[1:], (), (), (), (), machine, *recorded, {})
    result = Diagnosis(c, "identified", 1e-7, found, rest, (), machine, *bars, (*bars,), posterior=posterior, logs=seen)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mjsim.commands.diagnose.diagnose", lambda *_, **__: result)
        text = run("diagnose", both)
        data = json.loads(run("diagnose", both, "--write", folder / "fitted.toml", "--json"))
    return result, data, folder / "fitted.toml", text


def test_a_diagnosis_of_both_instruments_is_kept_and_written(both, diagnosed, monkeypatch):
    found, data, fitted, text = diagnosed
    assert data["unexplained"]["effect_file"] in text.replace("\n  ", "") and "axis log" in text
    assert (both / ".mjsim" / "diagnosis.json").is_file()
    assert data["unexplained"]["effect_file"].endswith(".py") and data["unexplained"]["plot"].endswith(".png")
    assert "rest_of_test.A" in {e.id for e in read_machine(fitted).effects}
    c = mjsim.read_campaign(both)
    saved = read_saved(c, read_machine(c.machine_file))
    assert saved is not None and {e.key for e in saved.machine.effects} >= {e.effect.key for e in found.effects}
    monkeypatch.setattr("mjsim.compensation.compensate.diagnose", lambda *_, **__: pytest.fail("diagnosed again"))
    assert mjsim.compensate(c, read_machine(c.machine_file), "csv").saved.verdict == found.verdict


def test_both_instruments_are_in_one_result(both, diagnosed):
    found, data, _, _ = diagnosed
    assert found.logs is not None and found.before.instrument == "ball_bar"
    assert [e["id"] for e in data["effects"]] == ["servo_gain.C", "viscous_friction.C"]
    assert "rms_before_um" in data["effects"][0] and "rms_before_deg" in data["effects"][1]
    assert [t["name"] for t in data["axis_logs"]["tests"]] == ["strokes-c"]
    assert [e.effect.id for e in found.of_bars().effects] == ["servo_gain.C"]


def test_the_sentence_says_how_much_tells_two_apart(diagnosed):
    found, *_ = diagnosed
    effect = replace(found.effects[0], worse={"ball_bar": {"a": 1.0}, "axis_log": {"a": 2.0}}, decided_by="axis_log")
    assert "that of a differs by -1.0 in the ball bar and by -2.0 in the axis log" in effect.evidence
    assert effect.evidence.endswith("; 3 together are odds of 20 to 1.")


def test_the_part_of_a_report_is_kept_beside_logs(both, tmp_path):
    page, program = tmp_path / "page.html", tmp_path / "part.nc"
    program.write_text("G90 G21\nG0 X0. Y0. Z155. A0. C0.\nG1 X5. F1000.\nM30\n")
    part = ["--part", program]
    data = json.loads(run("report", both, "-o", page, "--no-diagnose", *part, "--json"))
    assert len(data["parts"]) == 1 and data["axis_logs"]["tests"][0]["name"] == "strokes-c"


def test_paths_that_differ_are_no_pair():
    """Both directions of one path make the bidirectional figures of ISO 230-4, and nothing else does."""
    circle = BallBarTest("there", "circular", (0.0, 0.0, 0.155), 0.1, 0.02)
    back = replace(circle, name="back", direction="CW", started=99.0, trace="other.csv")
    assert _both_ways(circle, back) and not _both_ways(back, circle)
    others = ({"spindle": 90 * DEG}, {"more": {"lean": 0.4}}, {"setup": "second"}, {"feed": 0.01})
    for change in (*others, {"commanded": Commanded(np.ones(1), np.zeros((2, circle.chain.count)))}):
        assert not _both_ways(circle, replace(back, **change)), change
