"""Several instruments on one machine: each finding is told by those that show it, and a plan asks for what none of them
has shown. Campaigns of the independent generator.
"""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from commands import printed as run
from commands import read

import mjsim
from mjsim.cli.plan import show_telling
from mjsim.commands import at_rest, plan_at_rest
from mjsim.commands.diagnose import diagnose
from mjsim.commands.finding import DiagnosedEffect
from mjsim.commands.plan import plan
from mjsim.commands.plan_at_rest import plan_targets
from mjsim.inference.at_rest import RestFitter
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.planning.at_rest import Open, RestPlanner, planned_problem
from mjsim.inference.posterior import Posterior
from mjsim.report.write import report
from mjsim.units import UM
from tests.independent import positions, routes, sphere
from tests.independent.kinematics import MICRO

EVERY = plan_at_rest.tests_at_rest
LINE = {"name": "laser-x", "axis": "X", "ends": (0.0, 300.0), "count": 9, "runs": 2}


def few(patch, *names):
    """Lets a plan look at some tests only, which is faster."""
    patch.setattr(plan_at_rest, "tests_at_rest", lambda *a: [t for t in EVERY(*a) if t.name.startswith(names)])


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    """A probe, a laser along X and a log of C, on a machine with three faults: the probe alone shows the place of A,
    the laser alone the play of X, the log alone the friction of C.
    """
    errors, _, _ = routes.draw(4, False)
    errors["play"]["X"], errors["location"]["EY0A"] = 5.0 * MICRO, 40.0 * MICRO
    path = tmp_path_factory.mktemp("mixed")
    rubbing = [{"id": "friction.C", "coulomb_Nm": 0.35 * 2.5}]
    routes.write(path, 4, layout="", logged=("C",), drawn=(errors, rubbing, None))
    return path


@pytest.fixture(scope="module")
def diagnosed(mixed):
    return mjsim.diagnose(*read(mixed))


def test_each_finding_has_the_tests_that_show_it(diagnosed):
    found = {e.effect.id: e for e in diagnosed.effects}
    assert set(found) == {"friction.C", "backlash.X", "axis_location.EY0A"} and diagnosed.verdict == "identified"
    assert {k: e.tests for k, e in found.items()} == {
        "friction.C": ("strokes-c",),
        "backlash.X": ("laser-x",),
        "axis_location.EY0A": ("points",),
    }
    assert {k: e.found_by for k, e in found.items()} == {
        "friction.C": "axis_log",
        "backlash.X": "positions",
        "axis_location.EY0A": "sphere",
    }
    # of all tests at rest: the play of X leaves the laser's readings, which the error of one instrument would not show
    play, place = found["backlash.X"], found["axis_location.EY0A"]
    assert play.rms_before - play.rms_after > 0.02 * UM and play.rms_after == diagnosed.after.rms < 0.6 * UM
    assert place.rms_before > 10.0 * UM and place.rms_after == play.rms_before  # it makes most of the error
    assert {t.test.name for t in diagnosed.after.tests} == {"points", "laser-x"}
    assert sum(diagnosed.probabilities.values()) == pytest.approx(1.0, abs=1e-3)


def test_what_a_log_shows_is_testable(diagnosed):
    hidden = set(diagnosed.not_testable)
    assert not {"friction.C", "servo_gain.C", "backlash.X", "axis_location.EY0A"} & hidden
    assert {"friction.X", "servo_gain.X", "backlash.Y", "drive_compliance.C"} <= hidden


def test_the_page_names_the_findings_of_all_instruments(mixed, diagnosed, monkeypatch):
    monkeypatch.setattr("mjsim.report.write.diagnose", lambda *_: diagnosed)
    page = report(*read(mixed))
    assert page.data["verdict"] == "identified"
    assert page.data["answer"] == "Friction C, location error EY0A, backlash X."
    shown = {key: {e["id"] for e in page.data[key]["effects"]} for key in ("sphere_tests", "position_tests")}
    assert shown == {"sphere_tests": {"axis_location.EY0A"}, "position_tests": {"backlash.X"}}
    body = page.html.partition("Position tests</h2>")[2]
    assert "Backlash of an axis" in body and "Shows in laser-x" in body


def test_the_line_that_a_plan_asks_for_decides(tmp_path, monkeypatch):
    """A line 200 mm above cannot tell a scale error from a pitch angle. The plan asks for another one, and with it the
    angle is named.
    """
    errors, tolerance = {"angle": {"EBX": (40e-6, 0.0)}}, {"angular_error": {"urad": 12.0}}
    first = LINE | {"line_mm": [0.0, 0.0, 200.0]}
    few(monkeypatch, "laser-x", "ebx", "eyx")
    positions.write(tmp_path / "one", 5, errors, [first], tolerance=tolerance)
    data = plan(*read(tmp_path / "one")).to_json()
    assert data["decides"] and set(data["between"]) == {"scale_error.X", "angular_error.EBX"}
    assert {r["test"].get("component") for r in (data, *data["runners_up"])} >= {None, "EBX"}
    table = data["test"]
    ends = min(table["targets_mm"]), max(table["targets_mm"])
    asked = {k: table[k] for k in ("name", "axis", "line_mm", "runs")} | {
        "ends": ends,
        "count": len(table["targets_mm"]),
    }
    positions.write(tmp_path / "two", 5, errors, [first, asked], tolerance=tolerance)
    result = mjsim.diagnose(*read(tmp_path / "two"))
    (found,) = result.effects
    assert found.effect.id == "angular_error.EBX" and result.verdict == "identified"


def test_a_plan_between_two_effects_that_a_user_names(tmp_path, monkeypatch):
    few(monkeypatch, "laser-x", "laser-y")
    positions.write(tmp_path, 5, {}, [LINE])
    data = json.loads(run("plan", tmp_path, "--between", "nothing", "backlash.Y", "--json"))
    assert data["between"] == ["backlash.Y", "nothing"] and data["decides"] and data["test"]["axis"] == "Y"
    assert data["reason"] == "It is the only one within reach that makes backlash.Y show."
    said = " ".join(run("plan", tmp_path, "--between", "servo_gain.X", "nothing", code=1).split())
    assert "no test at rest within reach separates them at all" in said


@pytest.fixture(scope="module")
def probed(tmp_path_factory):
    """A probed machine with 5 µm of play in X, and what is to be measured next; one ball-bar test is looked at."""
    path, patch = tmp_path_factory.mktemp("probed"), pytest.MonkeyPatch()
    errors = sphere.draw(np.random.default_rng(1))
    sphere.write(path, 1, errors | {"play": errors["play"] | {"X": 5.0 * MICRO}})
    campaign, machine = read(path)
    few(patch, "laser", "sphere", "calibrator")
    (bar, *_) = plan_at_rest._bar_tests(machine)
    patch.setattr(plan_at_rest, "_bar_tests", lambda machine: [bar])
    patch.setattr("mjsim.commands.plan.diagnose", lambda *a: found.append(diagnose(*a)) or found[-1])
    found: list = []
    data = plan(campaign, machine).to_json()
    patch.undo()
    return campaign, found[0], data


def test_a_plan_asks_for_what_a_probe_cannot_show(probed):
    """Play of a linear axis cancels in a probed centre. The plan asks for the laser, which finds it beside the probe
    (above), and for a ball bar.
    """
    _, result, data = probed
    assert result.verdict == "nothing_found" and "backlash.X" in result.not_testable
    rows = [data, *data["runners_up"]]
    assert {r["instrument"] for r in rows} == {"ball_bar", "positions", "sphere"}
    asked = next(r for r in rows if r["test"].get("axis") == "X" and "component" not in r["test"])
    ((name, known),) = ((k["id"], k) for k in asked["known"])
    assert name == "backlash.X" and known["half_width95"] < 0.5 * known["half_width95_now"]


def test_the_text_of_a_plan_says_what_to_do(probed, capsys):
    campaign, _, data = probed
    show_telling(data, campaign)
    said = " ".join(capsys.readouterr().out.split())
    assert "Nothing that was found is open." in said and "backlash.X" in said
    assert "The campaign has no ball bar yet: call its tables [instrument.NAME]" in said
    assert f"mjsim import FILE --campaign {campaign.folder} --test" in said


def test_what_a_plan_promises_is_what_a_fit_of_the_test_knows(tmp_path):
    """Half widths after one line, of a machine that nobody has measured: those of the least squares of its readings."""
    positions.write(tmp_path, 1, {}, [LINE])
    campaign, machine = read(tmp_path)
    test = plan_targets(campaign, machine, "X", {"X": (0.0, 300.0)}).test
    planner = RestPlanner(campaign, machine)
    left = Open(machine, None, planner.expected)
    told = {(k.effect_id, k.parameter): k for k in planner.told(test, left).known}
    problem = planned_problem(campaign, test)
    fit = RestFitter(problem, machine).fit([f for f in planner.expected if problem.shows(machine, f)], iterations=0)
    for f in (f for f in fit.effects if f.effect.id in ("scale_error.X", "backlash.X")):
        ((name, spec),) = ((n, f.specs[n]) for n in f.names)
        known = 1.96 * spec.scale * float(np.sqrt(fit.covariance_of(f)[0, 0]))
        assert told[f.effect.id, name].after == pytest.approx(known, rel=1e-3)


def test_points_do_not_take_back_waves_that_they_do_not_show(probed, monkeypatch):
    """A ball bar has found a pitch error of 72 waves per turn of C. Points of a sphere are too far apart for it."""
    campaign, points, _ = probed
    machine = read(campaign.folder)[1]
    effect = mjsim.make_effect("pitch_error.C", machine.chain, components=[[72.0, 0.004, 30.0]])
    wave = EffectVector(effect, ("components",))
    sheet = len(points.posterior.sheet)
    known = Posterior((wave,), np.diag([1e-4, 1e-4, *np.ones(sheet)]))
    ci = wave.interval(wave.vector, known.part(range(2)))
    found = DiagnosedEffect(effect, wave.names, ci, 3.0 * UM, 0.1 * UM, (), ("cone",), probability=1.0)
    bars = SimpleNamespace(instrument="ball_bar")
    monkeypatch.setattr(at_rest, "compare_bars", lambda *_: bars)
    beside = replace(points, before=bars, effects=(found,), calibration=(), posterior=known, verdict="identified")
    result = at_rest.diagnose_at_rest(campaign, machine, beside=beside)
    (kept,) = result.effects
    assert kept.effect.id == "pitch_error.C" and result.verdict == "identified"
    assert 72.0 in [row[0] for row in kept.effect.values["components"]] and kept.tests == ("cone",)
    assert "pitch_error.C" not in {c.effect.effect.id for c in result.calibration}
