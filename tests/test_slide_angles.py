"""Turns of the slides as a part of what is in no model: what they leave in the readings, and whether they are seen."""

from dataclasses import replace

import numpy as np
import pytest
from small_errors import small_errors_and

from mjsim.commands.diagnosis import common_sentence
from mjsim.effects.registry import make
from mjsim.inference.findings import explain
from mjsim.inference.slide_angles import turns_of_slides
from mjsim.inference.vibration import Separated
from mjsim.machine.model import build

#: About X, Y and Z, as the letters of ISO 230-1 are.
ABOUT = "ABC"


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    """Tests of a machine on which everything is a little wrong, whose slides do not turn."""
    return problem_of(tmp_path_factory.mktemp("still"), 0.0)


def problem_of(folder, urad):
    """The tests of a machine of the generator whose file states no angular errors, and whose slides turn by so much."""
    rng = np.random.default_rng(11)
    turns = [
        {"id": f"angular_error.E{about}{axis}", "linear_urad": urad * s, "quadratic_urad": urad * q}
        for axis in "XYZ"
        for about, s, q in zip(ABOUT, rng.standard_normal(3), rng.standard_normal(3), strict=True)
    ]
    tests, machine, errors = small_errors_and(folder, turns if urad else ())
    return tests, machine, {e["id"]: e for e in errors}


@pytest.mark.parametrize("axis", "XYZ")
@pytest.mark.parametrize("about", ABOUT)
def test_a_straight_turn_leaves_what_an_angular_error_does(problem, axis, about):
    tests, machine, _ = problem
    machine = replace(machine, effects=())
    turned = machine.with_effect(make(f"angular_error.E{about}{axis}", machine.chain, linear_urad=10.0))
    expected = [b - a for a, b in zip(*(tests.readings(build(m)) for m in (machine, turned)), strict=True)]
    first = 3 * (4 * "XYZ".index(axis) + ABOUT.index(about))
    found = [columns[:, first] for columns in turns_of_slides(tests, machine).readings]
    # Legendre's three first polynomials together have this mean square
    found = [10e-6 * np.sqrt(1 / 3 + 1 / 5 + 1 / 7) * f for f in found]
    size = max(map(np.ptp, expected))
    for a, b in zip(found, expected, strict=True):
        # a constant part is a length of the bar
        assert a - a.mean() == pytest.approx(b - b.mean(), abs=1e-9 + 0.01 * size)
    # the spindle's ball is on its centreline: neither a yaw of X about that nor any turn of Z moves it
    assert (size > 0.2e-6) == (axis != "Z" and about + axis != "CX")


def test_shapes_are_zero_where_their_axis_stands_at_zero(problem):
    tests, machine, _ = problem
    for motion, columns in zip(tests.motions, turns_of_slides(tests, machine).readings, strict=True):
        for i, shapes in enumerate(np.split(columns, 3, axis=1)):
            place = motion.commands[::5, i]
            at = np.flatnonzero(np.diff(np.sign(place)))
            assert np.abs(shapes[at]).max(initial=0.0) < 0.02 * np.abs(columns).max()


def test_slides_that_turn_are_seen_and_those_that_do_not_are_not(problem, tmp_path):
    """Without the turns the model names a squareness, a location and a straightness, and errors of locations are five
    standard deviations.
    """
    tests, machine, _ = problem
    assert not explain(Separated(tests, machine, ())).common  # nor does it drift, nor does its friction vary
    turning, machine, truth = problem_of(tmp_path, 12.0)
    found = explain(Separated(turning, machine, ()))
    assert 3e-6 < found.common["slide_turns"] < 30e-6
    assert not found.selection.found and found.unexplained is None
    fit = found.selection.fit
    for kind in ("axis_location", "squareness", "straightness"):
        errors = [
            (f.vector[i] - p.encode(truth[f.effect.id][p.name])) / np.sqrt(fit.covariance_of(f)[i, i])
            for f in fit.effects
            if f.effect.kind == kind
            for i, p in enumerate(q for q in f.effect.parameters_of(f.effect.subject) if q.name in f.names)
        ]
        assert np.sqrt(np.mean(np.square(errors))) < 1.3, kind


def test_who_states_no_limit_is_told_how_each_turn_is_fitted():
    assert common_sentence({"slide_turns_urad": 0.0}, ()) == ""
    told = {"slide_turns_urad": 11.3}
    assert "11 µrad" in common_sentence(told, ())
    assert "limit of angular_error in [tolerance]" in common_sentence(told, ())
    assert "[tolerance]" not in common_sentence(told, ["backlash.A", "angular_error.EAX"])
