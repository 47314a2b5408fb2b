"""The curve of an unknown cause is the one that explains most beside everything that a machine may have."""

from dataclasses import replace

import numpy as np
import pytest
from independent.unlisted import EccentricPlay, SuddenShift, ToothPatch
from rotary_fits import fitter_of, free

from mjsim.estimation import curve_choice
from mjsim.estimation.calibration import expected_effects
from mjsim.estimation.curve_choice import best_curve_again, best_curve_beside, curve_instead
from mjsim.estimation.curve_fit import fit_beside_simple
from mjsim.estimation.curve_shape import changes
from mjsim.estimation.curve_terms import CurveTerms
from mjsim.estimation.nuisance import TRIGGERS


def calibrated(fitter, machine, *findings):
    """A model of all that a machine may have, and of findings."""
    keys = {f.effect.key for f in findings}
    return fitter.fit([*findings, *(c.free for c in expected_effects(machine) if c.key not in keys)])


def test_a_patch_of_worn_teeth_is_found_on_its_axis(tmp_path):
    """It is narrow: with few knots a curve of another axis explains more."""
    patch = ToothPatch("C", amplitude=6.0, order=30.0, centre_deg=120.0, width_deg=10.0)
    fitter, machine = fitter_of((patch,), tmp_path, "r")
    _, curve = best_curve_beside(fitter, calibrated(fitter, machine))
    assert (curve.axes, curve.moves, curve.variable, len(curve.knots)) == (("C",), "C", "position", 288)
    place = np.degrees(curve.knots[np.argmax(np.abs(curve.coefficients - np.median(curve.coefficients)))])
    assert place == pytest.approx(120.0, abs=10.0)


@pytest.fixture(scope="module")
def play(tmp_path_factory):
    """A fitter and the calibrated model of a machine whose play changes with the position of C."""
    fitter, machine = fitter_of((EccentricPlay("C", 8.0),), tmp_path_factory.mktemp("play"))
    return fitter, machine, calibrated(fitter, machine)


@pytest.fixture(scope="module")
def curve_of_play(play):
    """The curve that is chosen beside that model."""
    fitter, _, fit = play
    return best_curve_beside(fitter, fit)[1]


def test_a_trigger_that_follows_the_unknown_does_not_decide_on_it(play):
    """Ranked where it had pushed a trigger to, what an axis does looks like something else."""
    fitter, _, fit = play
    at, nuisance = fitter.problem.nuisances[TRIGGERS], fit.nuisance.copy()
    nuisance[at.start] = 3.9
    pushed = fitter.fit(fit.effects, start=replace(fit, nuisance=nuisance), iterations=0, fresh=False)
    believed = curve_choice._with_believed_triggers(fitter, pushed)
    assert believed.nuisance[at.start] == 0.0
    assert np.array_equal(believed.nuisance[at][1:], pushed.nuisance[at][1:])
    model, curve = best_curve_beside(fitter, pushed)
    assert abs(model.nuisance[at.start]) < 3.0
    assert curve.axes == ("C",) and curve.signed


def test_the_curve_is_chosen_again_only_where_triggers_have_moved(play, monkeypatch):
    fitter, _, fit = play
    monkeypatch.setattr(curve_choice, "best_curve_beside", lambda _, model: model.nuisance)
    assert best_curve_again(fitter, fit, fit) is None
    nuisance = fit.nuisance.copy()
    nuisance[fitter.problem.nuisances[TRIGGERS]] += 0.5
    assert np.array_equal(best_curve_again(fitter, fit, replace(fit, nuisance=nuisance)), nuisance)


def test_a_fixture_that_slips_is_found_by_its_time(tmp_path):
    """It slips in the first of three tests."""
    fitter, _ = fitter_of((SuddenShift("X", 5.0, at_s=577.0),), tmp_path, "rotary-c")
    fit, curve = best_curve_beside(fitter, fitter.fit([]))
    assert (curve.axis, curve.moves, curve.variable) == ("", "X", "clock_time")
    _, simple, _ = fit_beside_simple(fitter, fit, curve)
    ((place, size),) = changes(simple.coefficients)
    assert np.interp(place, np.arange(len(curve.knots)), curve.knots) == pytest.approx(577.0, abs=1.0)
    assert simple.shape == "steps" and size == pytest.approx(5.0, rel=0.02)


def test_where_nothing_is_left_there_is_no_curve(tmp_path):
    fitter, machine = fitter_of((), tmp_path)
    assert best_curve_beside(fitter, calibrated(fitter, machine)) is None


def instead_of_finding(fitter, machine, named, curve):
    """What stands in place of a finding beside a curve."""
    fit = calibrated(fitter, machine, named)
    curve = next(CurveTerms(fitter.problem, fit).finer(curve, 1))
    assert curve.axes == ("C",) and curve.signed
    return curve_instead(fitter, fit, curve, [named.effect.key], expected_effects(machine))


def test_a_finding_that_is_part_of_the_unknown_goes(play, curve_of_play):
    fitter, machine, _ = play
    named = free(machine, "axis_location.EX0C", value_um=1.0)
    fit, curve = instead_of_finding(fitter, machine, named, curve_of_play)
    assert curve.axes == ("C",) and curve.signed
    assert next(f for f in fit.effects if f.effect.key == "axis_location.EX0C").prior is not None


def test_a_finding_that_is_a_cause_of_its_own_stays(curve_of_play, tmp_path):
    waves = {"id": "pitch_error.C", "components": [[240.0, 0.003, 50.0]]}
    fitter, machine = fitter_of((EccentricPlay("C", 8.0), waves), tmp_path)
    named = free(machine, "pitch_error.C", components=waves["components"])
    assert instead_of_finding(fitter, machine, named, curve_of_play) is None
