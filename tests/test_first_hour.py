"""What a new user does wrong or asks first: the answer has to be a sentence that helps."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from commands import as_json, ok, run

import mjsim
from mjsim.campaign.files import read_campaign
from mjsim.cli.compare import left_out_sentence
from mjsim.cli.main import main
from mjsim.cli.plan import show
from mjsim.commands import edit
from mjsim.commands.check import evidence_of
from mjsim.importing.sources import test_keys as keys_of_header
from mjsim.inference.planning.next_test import Plan
from mjsim.inference.planning.separation import Separation
from mjsim.instruments.ball_bar.program import Program, range_warning, speed_warnings

NAME = "circle-xy-ccw"


@pytest.fixture
def folder(tmp_path):
    mjsim.new_campaign(tmp_path / "mine")
    return tmp_path / "mine"


def table(path, test, share=1.0, header="time_s,deviation_um"):
    """A plausible trace for a share of the test's duration."""
    begin, end = Program(test).measured_span
    time = np.arange(begin, begin + share * (end - begin), 0.02)
    deviation = 3.0 * np.cos(time) + 0.1 * np.random.default_rng(1).standard_normal(len(time))
    path.write_text(header + "\n" + "".join(f"{t:.4f},{d:.4f}\n" for t, d in zip(time, deviation, strict=True)))
    return path


def the_test(folder, name):
    return next(t for t in read_campaign(folder, traces=False).tests if t.name == name)


def refusal(*arguments):
    """What a command that must fail says."""
    result = run(*arguments)
    assert result.exit_code == 1 and not result.stdout, result.output
    return result.stderr


# --- a wrong trace ---------------------------------------------------------------------------------------------------


def test_import_asks_where_a_trace_does_not_last_as_long_as_its_test(folder, tmp_path):
    """A cone's trace, 3.4 % shorter, under a circle: import and check ask, and check does not call it right."""
    file = table(tmp_path / "cone.csv", the_test(folder, "cone15-centre-ccw"))
    (trace,) = as_json("import", file, "--campaign", folder, "--test", NAME)["traces"]
    assert any("the trace lasts 72.8" in q and "cone15-centre-ccw" in q for q in trace["questions"])
    data = as_json("check", folder)
    assert any(q.startswith(f"{NAME}: the trace lasts") for q in data["questions"])
    said = ok("check", folder).stdout
    assert "duration" in said and f"{NAME} cannot be checked" in said and " ok" not in said
    assert "circle-xy-cw" in data["not_measured"]


def test_a_trace_of_the_right_length_is_not_asked_about(folder, tmp_path):
    (trace,) = as_json(
        "import", table(tmp_path / "a.csv", the_test(folder, NAME)), "--campaign", folder, "--test", NAME
    )["traces"]
    assert not any("lasts" in q for q in trace["questions"])


@pytest.mark.parametrize(
    ("factor", "agreement", "said"),
    [(None, None, "no friction"), (0.05, 0.03, "agree little"), (9.0, 0.9, "times the model")],
)
def test_ok_needs_evidence(factor, agreement, said):
    assert said in evidence_of(SimpleNamespace(factor=factor, agreement=agreement))
    assert not evidence_of(SimpleNamespace(factor=1.1, agreement=0.9))


def test_what_was_left_out_is_said_with_its_share():
    rows = [{"test": "a", "samples": 50, "of": 100, "disturbances": 1, "saturated": 0}]
    assert (
        left_out_sentence(rows, 1000)
        == "Left out as disturbed or missing: 50 of 1000 samples (5 %): a 50 of 100 (1 knock)."
    )


def test_compare_names_the_tests_without_a_trace(folder, tmp_path):
    ok("import", table(tmp_path / "a.csv", the_test(folder, NAME)), "--campaign", folder, "--test", NAME)
    said = ok("compare", folder, "--no-plots", "--as-is").stdout
    assert "Not compared, because campaign.toml names no trace for them: circle-xy-cw, " in " ".join(said.split())


# --- add -------------------------------------------------------------------------------------------------------------


def test_an_effect_that_makes_the_model_worse_is_not_added(folder, tmp_path, monkeypatch):
    ok("import", table(tmp_path / "a.csv", the_test(folder, NAME)), "--campaign", folder, "--test", NAME)
    before = (folder / "machine.toml").read_bytes()
    real = edit.compare_bars
    rms = iter([0.901e-6, 0.930e-6, 0.901e-6, 0.930e-6])
    monkeypatch.setattr(edit, "compare_bars", lambda *a, **k: replace(real(*a, **k), rms=next(rms)))
    said = refusal("add", folder, "backlash.X", "--as-is")
    assert "backlash.X makes the model worse" in said and "0.901 to 0.930" in said and "--force" in said
    assert (folder / "machine.toml").read_bytes() == before and not (folder / ".mjsim" / "history.json").exists()
    ok("add", folder, "backlash.X", "--as-is", "--force")
    assert b"backlash.X" in (folder / "machine.toml").read_bytes()


# --- plan ------------------------------------------------------------------------------------------------------------


def test_a_plan_begins_with_the_verdict_and_ends_with_steps(folder, capsys):
    test = the_test(folder, "cone15-centre-ccw")
    choices = (Separation(test, 500.0, 1e-6), Separation(replace(test, name="longer"), 900.0, 2e-6))
    show(Plan(("servo_gain.C", "servo_delay.C"), choices, "Reason."), "mine")
    said = capsys.readouterr().out
    assert said.startswith("This test decides between servo_gain.C and servo_delay.C: cone15-centre-ccw.")
    assert (
        "separation over the whole test: 22 σ" in " ".join(said.split())
        and "Highest axis speeds: X " in said
        and "°/s" in said
    )
    assert "20 σ" in said and said.rstrip().endswith("5. mjsim diagnose mine")


# --- Python ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axis", "changes", "said"),
    [
        ("B", {"position_gain": 40.0}, "allowed: X, Y, Z, A, C"),
        ("C", {"position_gain_per_s": 40.0}, "it is called position_gain here"),
        ("C", {"position_gain": -40.0}, "above 0"),
        ("C", {"viscous": float("nan")}, "0 or more"),
    ],
)
def test_a_drive_that_cannot_be_is_refused_at_once(folder, axis, changes, said):
    with pytest.raises(mjsim.InputError, match=said):
        mjsim.read_machine(folder / "machine.toml").with_drive(axis, **changes)


def test_a_single_test_is_answered_with_what_to_pass(folder):
    with pytest.raises(mjsim.InputError, match=r"pass \[test\]"):
        mjsim.simulate(mjsim.read_machine(folder / "machine.toml"), the_test(folder, NAME))


# --- import ----------------------------------------------------------------------------------------------------------


def test_several_files_name_their_tests(folder, tmp_path):
    files = [table(tmp_path / f"{x}.csv", the_test(folder, n)) for x, n in (("a", NAME), ("b", "circle-xy-cw"))]
    said = ok("import", f"{files[0]}={NAME}", f"{files[1]}=circle-xy-cw", "--campaign", folder).stdout
    assert said.count("(its trace is new in campaign.toml)") == 2
    assert {t.name for t in read_campaign(folder).measured} == {NAME, "circle-xy-cw"}


def test_german_headers_are_read():
    header = ("Vorschub [mm/min]: 1000,0", "Ebene: XY", "Drehrichtung: im Uhrzeigersinn", "Nennlänge: 100 mm")
    assert keys_of_header(header) == {"feed_mm_min": 1000.0, "plane": "XY", "direction": "CW", "bar_length_mm": 100.0}


def test_all_that_a_new_test_needs_is_asked_for_at_once(folder, tmp_path):
    said = refusal("import", table(tmp_path / "new.csv", the_test(folder, NAME)), "--campaign", folder)
    for option in ("--plane", "--direction", "--half-apex", "--axis", "--table-ball", "--length", "--feed", "--test"):
        assert option in said


# --- batch, nc, speeds -----------------------------------------------------------------------------------------------


def test_batch_shows_a_table_and_counts_what_keeps_a_limit(folder, tmp_path):
    (folder / "sweep.toml").write_text(
        f'name = "s"\ncampaign = "campaign.toml"\ntests = ["{NAME}"]\n'
        '[[vary]]\nparameter = "drive.X.position_gain_per_s"\nvalues = [40.0, 45.0]\n'
    )
    said = ok("batch", folder / "sweep.toml", "--out", tmp_path / "out", "--limit", "circular_error_um<=1000").stdout
    assert "lowest" in said and "median" in said and "circular_error_um<=1000: 2 of 2 simulations (100.0 %)" in said
    wrong = CliRunner().invoke(
        main, ["batch", str(folder / "sweep.toml"), "--out", str(tmp_path / "o"), "--limit", "roundness<6"]
    )
    assert wrong.exit_code == 2 and "circular_error_um" in wrong.stderr


@pytest.mark.parametrize(("name", "line"), [("a.mpf", "FGROUP(X,Y)"), ("a.nc", "G710")])
def test_a_siemens_program_is_recognised(tmp_path, name, line):
    (tmp_path / name).write_text(f"{line}\nG1 X1 F100\nX2\n")
    assert ok("nc", "read", tmp_path / name).stdout.startswith("dialect siemens: ")
    assert "--dialect siemens" in refusal("nc", "read", tmp_path / name, "--dialect", "fanuc")


def test_an_axis_that_has_to_move_too_fast_is_warned_about(folder):
    """θ just above β: the circle passes close to the table's axis, which has to turn fast."""
    cone = replace(
        the_test(folder, "cone15-centre-ccw"),
        half_apex=np.radians(15.2),
        inclination=np.radians(15.0),
        feed=3000 / 60e3,
    )
    assert any(": C has to move at " in w and "°/s" in w for w in speed_warnings(cone))
    assert not speed_warnings(the_test(folder, "cone15-centre-ccw"))
    assert "±1 mm" in range_warning(cone, np.array([0.0, 2e-3]), 1e-3) and not range_warning(cone, np.zeros(3), 1e-3)
    text = (folder / "campaign.toml").read_text()
    text = text.replace("half_apex_deg = 15.0 ", "half_apex_deg = 15.2 ", 1).replace(
        "inclination_deg = 10.0", "inclination_deg = 15.0", 1
    )
    (folder / "campaign.toml").write_text(text)
    result = ok("nc", folder, "--test", "cone15-centre-ccw", "-o", folder / "cone.nc", "--json")
    assert any("C has to move at" in w for w in json.loads(result.stdout)["warnings"])
    assert (
        "C has to move at"
        in ok("simulate", folder, "--test", "cone15-centre-ccw", "--out", folder / "s", "--no-plots").stderr
    )
