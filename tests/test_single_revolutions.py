"""Tests of one revolution of a rotary axis: nothing repeats, so the model has to tell the machine from an accident."""

import numpy as np
import pytest
from independent import campaign as generator
from independent import real_machines
from independent.layouts import layout
from independent.unlisted import EccentricPlay, EncoderStep, ToothPatch

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.inference.disturbances import without_disturbances
from mjsim.inference.findings import explain
from mjsim.inference.problem import Problem
from mjsim.inference.vibration import separate
from mjsim.machine.model import build


def measured(folder, *causes, stated=True, without=(), tests="feeds"):
    """The problem and the machine of a real machine with some causes, and the rotary tests of a layout."""
    within = tuple(e for e in real_machines.within("M1", np.random.default_rng(6)) if e["id"] not in without)
    tests = tuple(t for t in layout(tests) if t["kind"] == "rotary")
    case = generator.Case("real", "M1", tests, causes, seed=8, within=within, tolerance_stated=stated)
    generator.write_files(case, folder)
    campaign = read_campaign(folder)
    machine = read_machine(campaign.machine_file)
    return Problem.of(campaign, build(machine), threads=2), machine


def test_play_that_varies_over_a_turn_is_in_no_catalogue(tmp_path):
    """Neither of two opposite pitch errors is named, on a machine whose tolerance is not stated."""
    problem, machine = measured(tmp_path, EccentricPlay("C", 8.0), stated=False, without=["backlash.C"])
    explained = explain(separate(problem, machine))
    assert explained.unexplained is not None
    assert explained.unexplained.axes == ("C",) and explained.unexplained.variable == "direction"
    assert not any(f.key.startswith("pitch_error.C") for f in explained.selection.found)


def test_waves_on_a_part_of_the_worm_wheel_are_in_no_catalogue(tmp_path):
    """Waves of many neighbouring orders imitate them, each within the tolerance of the pitch error."""
    explained = explain(separate(*measured(tmp_path, ToothPatch("C", 8.0))))
    assert not explained.selection.found
    assert explained.unexplained is not None
    assert explained.unexplained.axes == ("C",) and explained.unexplained.variable == "position"
    assert explained.unexplained.left < 0.2 * explained.unexplained.rms


def test_a_ball_in_another_seat_shows_once_the_waves_are_fitted(tmp_path):
    """A lasting jump that is lower than the waves of the worm gear: nothing of the machine is named instead."""
    problem, machine = measured(tmp_path)
    samples = [s.copy() for s in problem.samples]
    struck = samples[1]
    since = struck.time - np.quantile(struck.time, 0.4)
    struck.value = struck.value + 2e-6 * np.clip(since / 0.02, 0.0, 1.0)
    struck.mean = struck.average(struck.value)
    knocked = problem.with_samples(samples, problem.tests, problem.outliers)
    assert not any(without_disturbances(knocked, problem.readings(build(machine))).outliers.values())
    explained = explain(separate(knocked, machine))
    assert explained.data.outliers == {t.name: int(k == 1) for k, t in enumerate(problem.tests)}
    assert not explained.selection.found and explained.unexplained is None


def test_what_two_tests_show_at_one_place_of_an_axis_is_no_accident(tmp_path):
    """A damaged stretch of an encoder looks like a knock in each of two tests, and like one in a single test."""
    sound, machine = measured(tmp_path / "sound", tests="cradle")
    damaged, _ = measured(tmp_path / "damaged", EncoderStep("A", 150.0, from_deg=11.0, to_deg=18.0), tests="cradle")
    readings = sound.readings(build(machine))
    assert not any(without_disturbances(damaged, readings).outliers.values())
    showing = ("rotary-a-tangential-centre-ccw", "rotary-a-tangential-x40-cw")
    for name in showing:
        mixed = [d if d.test.name == name else s for s, d in zip(sound.samples, damaged.samples, strict=True)]
        alone = without_disturbances(sound.with_samples(mixed, sound.tests, sound.outliers), readings)
        assert {n: count > 0 for n, count in alone.outliers.items()} == {t.name: t.name == name for t in sound.tests}


def as_its_file_says(folder, tests):
    """The problem and the readings of a machine that has noise alone."""
    generator.write_files(generator.Case("ideal", "M1", tests, seed=8), folder)
    campaign = read_campaign(folder)
    plant = build(read_machine(campaign.machine_file))
    problem = Problem.of(campaign, plant, threads=2)
    return problem, problem.readings(plant)


@pytest.fixture(scope="module")
def ideal(tmp_path_factory):
    """Tests that take 10 to 13 s."""
    return as_its_file_says(tmp_path_factory.mktemp("ideal"), layout("cradle"))


def struck(problem, knocks):
    """The problem with a knock in some tests.

    Args:
        problem: Of sound tests.
        knocks: By the name of a test: where in it (share of its time), frequency of the ringing (Hz), and how far the
            ball creeps to another seat (m).
    """
    samples = [s.copy() for s in problem.samples]
    for s in samples:
        if s.test.name not in knocks:
            continue
        place, frequency, seat = knocks[s.test.name]
        since = s.time - np.quantile(s.time, place)
        after = np.maximum(since, 0.0)
        ringing = 20e-6 * np.exp(-after / 0.05) * np.cos(2.0 * np.pi * frequency * after) * (since >= 0.0)
        s.value = s.value + ringing + seat * np.clip(after / 0.02, 0.0, 1.0)
        s.mean = s.average(s.value)
    return problem.with_samples(samples, problem.tests, problem.outliers)


@pytest.mark.parametrize("place", [0.2, 0.35, 0.65, 0.8])
@pytest.mark.parametrize("name", [t["name"] for t in layout("cradle") if t["kind"] == "rotary"])
def test_noise_at_the_same_place_of_an_axis_is_no_witness(ideal, name, place):
    """A knock has put the ball into another seat: only one side of it counts, whatever the noise of others is like."""
    problem, readings = ideal
    seen = without_disturbances(struck(problem, {name: (place, 14.0, 1.5e-6)}), readings)
    assert {n: count > 0 for n, count in seen.outliers.items()} == {t.name: t.name == name for t in problem.tests}
    s = next(s for s in seen.samples if s.test.name == name)
    since = s.time - np.quantile(s.time, place)
    assert s.valid[since < -0.3].any() != s.valid[since > 0.6].any()


def test_two_knocks_at_one_place_of_an_axis_are_accidents(ideal):
    """They ring with different frequencies, as nothing of the machine would in two tests."""
    problem, readings = ideal
    names = ("rotary-a-tangential-centre-ccw", "rotary-a-tangential-x40-cw")  # 0 to 90 and 90 to -30 degrees
    at_31_deg = {names[0]: (0.35, 9.0, 0.0), names[1]: (0.4875, 21.0, 0.0)}
    seen = without_disturbances(struck(problem, at_31_deg), readings)
    assert {n: count for n, count in seen.outliers.items() if count} == dict.fromkeys(names, 1)


def displaced(problem, name, heights):
    """The problem with one test that jumps: by heights (m) at shares of its time."""
    samples = [s.copy() for s in problem.samples]
    s = next(s for s in samples if s.test.name == name)
    for place, height in heights:
        s.value = s.value + height * np.clip((s.time - np.quantile(s.time, place)) / 0.02, 0.0, 1.0)
    s.mean = s.average(s.value)
    return problem.with_samples(samples, problem.tests, problem.outliers)


SHORT = "rotary-a-tangential-x40-cw"


def test_two_seats_in_a_short_test_are_both_found(tmp_path):
    """They fill so much of 6 s that neither must be compared with the other."""
    fast = tuple({**t, "feed_mm_min": 3000.0} for t in layout("cradle") if t["kind"] == "rotary")
    problem, readings = as_its_file_says(tmp_path, fast)
    knocked = displaced(problem, SHORT, ((0.34, 3.7e-6), (0.54, -1.7e-6)))
    seen = without_disturbances(knocked, readings)
    assert seen.outliers == {t.name: 2 * (t.name == SHORT) for t in problem.tests}


@pytest.mark.parametrize("second", [-3.7e-6, 3.7e-6])
def test_what_jumps_again_by_as_much_is_the_machine_s(ideal, second):
    """As at both ends of a damaged stretch of an encoder, and at each reversal."""
    problem, readings = ideal
    twice = displaced(problem, SHORT, ((0.3, 3.7e-6), (0.6, second)))
    assert without_disturbances(twice, readings) is twice
    once = displaced(problem, SHORT, ((0.3, 3.7e-6),))
    assert without_disturbances(once, readings).outliers[SHORT] == 1
