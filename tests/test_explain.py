"""One effect in detail: its signature is what it changes, what looks like it does, and the reason says why."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from commands import refused, run
from independent import campaign as generator
from independent.layouts import layout

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.cli.explain import show
from mjsim.commands.explain import explain
from mjsim.effects.registry import make
from mjsim.inference.problem import Problem
from mjsim.machine.model import build
from mjsim.plots.signature import SignatureTrace, signature_figure
from mjsim.units import DEG, UM

WIDTH = 0.0016


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Two tests of a machine with play of A that its file does not have."""
    folder = tmp_path_factory.mktemp("explain")
    tests = tuple(layout("sparse-cones"))
    generator.write_files(
        generator.Case("explained", "M1", tests, ({"id": "backlash.A", "width_deg": WIDTH},), seed=3), folder
    )
    campaign = read_campaign(folder)
    return campaign, read_machine(campaign.machine_file)


def diagnosed(*effects, alternatives=(), not_testable=(), unexplained=None):
    """What a diagnosis would say."""
    found = [SimpleNamespace(effect=e, free=("width_deg",), alternatives=alternatives) for e in effects]
    return SimpleNamespace(
        effects=found,
        calibration=(),
        not_testable=not_testable,
        unexplained=unexplained,
        explained_shares={e.key: 1.0 / len(effects) for e in effects},
    )


@pytest.fixture(scope="module")
def named(measured):
    found = make("backlash.A", width_deg=WIDTH)
    return explain(*measured, "backlash.A", result=diagnosed(found, alternatives=("worm_wear.A",)))


def test_the_signature_is_what_the_effect_changes_beyond_the_set_up(measured, named):
    campaign, machine = measured
    low, high = named.ci95["width_deg"]
    assert named.role == "named" and low < WIDTH < high and named.fitted
    assert "cannot tell it from worm_wear.A" in named.reason and named.probability > 0.999
    problem = Problem.of(campaign, build(machine))
    with_it = problem.readings(build(machine.with_effect(named.effect)))
    changes = problem.difference(problem.readings(build(machine)), with_it, problem.nuisances.mean)
    for t, change in zip(named.tests, changes, strict=True):
        # set-up errors are smooth: the steps at the reversals of A are all there, wherever the trigger puts them
        steps, there = (np.abs(np.diff(x)) for x in (change, t.signature))
        assert there[there > 0.1 * UM].sum() == pytest.approx(steps[steps > 0.1 * UM].sum(), rel=0.1)
        assert t.rms_with < 0.12 * UM < t.rms_without
        assert t.rms_without**2 == pytest.approx(t.signature_rms**2 + t.rms_with**2, rel=0.05)


def test_what_looks_like_it_is_ranked_by_cosine(named):
    values = list(named.alike.values())
    assert "backlash.A" not in named.alike and values == sorted(values, reverse=True)
    assert 0.0 <= values[-1] and values[0] <= 1.0


def test_a_gain_is_a_delay_and_a_feedforward_on_these_tests(measured):
    found = explain(*measured, "servo_delay.A", result=diagnosed(make("backlash.A", width_deg=WIDTH)))
    assert found.alike["velocity_feedforward.A"] > 0.99 and found.alike["servo_gain.A"] > 0.97
    assert found.role == "not named" and "The data do not need it" in found.reason
    low, high = found.ci95["delay_ms"]
    assert low < 0.0 < high and not found.fitted and found.probability < 0.01


def test_an_effect_that_was_not_looked_for_is_estimated_all_the_same(measured):
    found = explain(*measured, "backlash.A", result=diagnosed())
    assert found.role == "not named" and found.probability > 0.999
    assert found.estimate.values["width_deg"] == pytest.approx(WIDTH, rel=0.2)  # a linear step from a model without it
    assert "more than 99.9 %" in found.reason


def test_of_what_the_machine_file_has_the_data_need_no_other_size(measured, capsys):
    """What is shown is a departure: after `add`, the data had been said not to need the effect."""
    campaign, machine = measured
    known = machine.with_effect(make("backlash.A", width_deg=WIDTH))
    found = explain(campaign, known, "backlash.A", result=diagnosed())
    assert found.role == "in the machine file" and found.reason.startswith("The data do not need another size.")
    assert found.probability < 0.01 and not found.fitted
    show(found.to_json())
    text = " ".join(capsys.readouterr().out.split())
    assert "In the machine file. The data" in text and "at a typical departure from the file, to width_deg" in text


def test_what_nothing_moves_is_not_testable(tmp_path):
    (circle,) = layout("sparse-circles")[:1]
    generator.write_files(generator.Case("circle", "M1", (circle,), seed=4), tmp_path)
    campaign = read_campaign(tmp_path)
    found = explain(campaign, read_machine(campaign.machine_file), "backlash.A", result=diagnosed())
    assert found.role == "not testable" and "It changes no reading" in found.reason
    assert found.tests == () and found.alike == {} and found.to_json()["probability"] == 0.0


def test_a_pitch_error_is_shown_with_both_phases(measured):
    found = explain(*measured, "pitch_error.C", result=diagnosed(make("backlash.A", width_deg=WIDTH)))
    assert found.role == "not named" and found.estimate.values["components"][0][0] > 0
    assert found.tests[0].signature_rms > 0.0


def test_tables_and_text(named, capsys):
    show(named.to_json())
    text = capsys.readouterr().out
    assert "backlash.A: Backlash of an axis" in text and "signature RMS µm" in text and "at its fitted size" in text
    frame = named.to_dataframe()
    assert list(frame.columns) == ["test", "phi_deg", "signature_um", "residual_um", "valid"]
    assert len(frame) == sum(len(t.phi) for t in named.tests)
    assert np.ptp(frame.phi_deg[frame.test == named.tests[0].test.name]) == pytest.approx(720.0, abs=3.0)


def test_the_picture_has_a_panel_for_each_test(named):
    traces = [SignatureTrace(t.test.name, t.phi / DEG, t.signature / UM, t.residual / UM) for t in named.tests]
    traces[0] = replace(traces[0], reversals={"A": [180.0], "C": [180.2]})
    figure = signature_figure(traces, "backlash.A", "note")
    assert len(figure.axes) == len(traces)
    assert "AC" in [t.get_text() for t in figure.axes[0].texts]
    with pytest.raises(ValueError, match="at least one"):
        signature_figure([], "nothing")


def test_what_cannot_be_explained_is_refused(good):
    refused(good, ["explain", good, "backlash.Q"], "backlash exists for")
    refused(good, ["explain", good, "play.A"], "unknown effect 'play.A'")
    refused(good, ["explain", good, "vibration.X"], "no signature along the path")
    assert run("explain", "--help").exit_code == 0
