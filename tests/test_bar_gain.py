"""A ball bar that reads too much: that is told, and no drive is named for it."""

from dataclasses import replace

import numpy as np
import pytest
from small_errors import small_errors_and

from mjsim.commands.diagnosis import common_sentence
from mjsim.inference.bar_gain import gain_of_bar
from mjsim.inference.calibration import calibrated_effects
from mjsim.inference.findings import explain
from mjsim.inference.fit import Fitter
from mjsim.inference.problem import Problem
from mjsim.inference.vibration import Separated
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


def test_the_shape_is_what_is_read(problem):
    tests, machine = problem
    known = read_by(tests, machine, 0.0)
    fit = Fitter(known, machine).fit([c.free for c in calibrated_effects(machine)])
    for s, shape in zip(known.samples, gain_of_bar(known, fit).readings, strict=True):
        left = s.sample(shape[:, 0], 0.0) - s.mean
        assert np.std(left[s.good]) < 0.1 * np.std(s.mean[s.good])
    certified = read_by(tests, machine, 0.0, "K 1234")
    assert not np.any(np.vstack(gain_of_bar(certified, fit).readings))


def test_a_bar_that_reads_too_much_is_told(problem):
    tests, machine = problem
    assert "bar_gain" not in explain(Separated(read_by(tests, machine, 0.0), machine, ())).common
    found = explain(Separated(read_by(tests, machine, 0.02), machine, ()))
    assert 0.01 < found.common["bar_gain"] < 0.04
    assert not found.selection.found and found.unexplained is None


def test_the_gain_is_told():
    assert "too much or too little, by some 2 %" in common_sentence({"bar_gain_percent": 2.1}, ())
