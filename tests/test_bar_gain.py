"""A ball bar that reads too much: that is seen, and no drive is named for it."""

from dataclasses import replace

import numpy as np
import pytest
from small_errors import small_errors_and

from mjsim.commands.diagnosis import common_sentence
from mjsim.inference.bar_gain import gain_of_bar
from mjsim.inference.bar_search import BarSearch
from mjsim.inference.fit import Fitter
from mjsim.inference.problem import Problem
from mjsim.machine.model import build


def read_by(tests, machine, gain, certificate=""):
    """The same tests by a bar with a gain, and such a certificate."""
    given = tests.campaign
    traces = {n: replace(t, deviation=(1.0 + gain) * t.deviation) for n, t in given.traces.items()}
    bars = {n: replace(bar, certificate=certificate) for n, bar in given.instruments.items()}
    return Problem.of(replace(given, traces=traces, instruments=bars), build(machine), threads=2)


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    tests, machine, _ = small_errors_and(tmp_path_factory.mktemp("small"), ())
    return tests, machine


def test_the_shape_is_what_the_machine_as_given_reads(problem):
    tests, machine = problem
    known = read_by(tests, machine, 0.0)
    for shape, reading in zip(gain_of_bar(known, machine).readings, known.readings(build(machine)), strict=True):
        assert shape[:, 0] == pytest.approx(reading)
    certified = read_by(tests, machine, 0.0, "K 1234")
    assert not np.any(np.vstack(gain_of_bar(certified, machine).readings))


@pytest.mark.parametrize(("gain", "least", "most"), [(0.0, 0.0, 0.0), (0.03, 0.01, 0.06)])
def test_a_bar_that_reads_too_much_is_seen(problem, gain, least, most):
    """Most of what a bar reads is the set-up's, which takes up a gain. The little that is left shows it."""
    tests, machine = problem
    search = BarSearch(Fitter(read_by(tests, machine, gain), machine))
    model = search.run().model
    assert least <= search.discrepancy.told(model.sizes, 0.0).get("bar_gain", 0.0) <= most
    assert {f.effect.key for f in model.fit.effects} == set(model.expected)


def test_the_gain_is_told():
    assert "too much or too little, by some 2 %" in common_sentence({"bar_gain_percent": 2.1}, ())
