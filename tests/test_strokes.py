"""A seat that changes when an axis turns back, but not each time alike: it does not repeat with the path."""

import numpy as np
import pytest
from independent import campaign as generator
from independent import real_machines
from independent.layouts import arrange, circle
from independent.odd_causes import AlternatingKey

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.effects import registry
from mjsim.inference.disturbances import without_disturbances
from mjsim.inference.findings import explain
from mjsim.inference.problem import Problem
from mjsim.inference.vibration import separate
from mjsim.machine.model import build
from mjsim.machine.plant import Motion

#: Half of the tests do without Y: from these the noise is known.
CIRCLES = tuple(
    arrange([circle(plane, way, ball=(x, 0)) for plane in ("XY", "ZX") for x in (0, 40) for way in ("CW", "CCW")])
)


def measured(folder, *causes):
    """The problem and the machine of one with the small errors of its class and some causes."""
    within = tuple(real_machines.within("M1", np.random.default_rng(6)))
    case = generator.Case("real", "M1", CIRCLES, causes, seed=9, within=within, tolerance_stated=True)
    generator.write_files(case, folder)
    campaign = read_campaign(folder)
    machine = read_machine(campaign.machine_file)
    return Problem.of(campaign, build(machine), threads=2), machine


@pytest.fixture(scope="module")
def loose_key(tmp_path_factory):
    """A key of Y with two seats 3 µm from the middle: whenever Y starts back it goes to the other one."""
    return measured(tmp_path_factory.mktemp("key"), AlternatingKey("Y", 3.0))


def struck(problem, seconds):
    """The tests with the ball 3 µm off since such an instant of each, s."""
    samples = [s.copy() for s in problem.samples]
    for s, at in zip(samples, seconds, strict=True):
        s.value = s.value + 3e-6 * (s.time > at)
        s.mean = s.average(s.value)
    return problem.with_samples(samples, problem.tests, problem.outliers)


def test_jumps_at_the_reversals_of_one_axis_are_no_accidents(loose_key):
    problem, machine = loose_key
    found = without_disturbances(problem, problem.readings(build(machine)))
    assert not any(found.outliers.values())


def slow(problem):
    """The noise at the lowest frequencies, m."""
    noise = problem.noise_of(0)
    return noise.innovation / (1.0 - noise.ar.sum())


def test_a_seat_that_changes_is_no_noise(loose_key):
    """The noise is the same from tests that show it as from those that do not."""
    problem, machine = loose_key
    showing = problem.only(range(4))
    loud = showing.with_noise_of_samples()
    quiet = without_disturbances(showing, showing.readings(build(machine)))
    true = slow(problem)
    assert slow(loud) > 5.0 * true
    assert slow(quiet) == pytest.approx(true, rel=0.3)


def test_jumps_at_any_other_instant_are_accidents(tmp_path):
    problem, machine = measured(tmp_path)
    knocked = struck(problem, np.linspace(18.0, 24.0, len(problem.samples)))
    found = without_disturbances(knocked, problem.readings(build(machine)))
    assert all(found.outliers.values())


@pytest.fixture(scope="module")
def explained(loose_key):
    return explain(separate(*loose_key))


def test_a_loose_key_is_in_no_catalogue_and_on_its_axis(explained):
    assert not explained.selection.found
    told = explained.unexplained
    assert told is not None and told.axes == ("Y",) and told.variable == "stroke"
    assert told.to_json()["variable"] == "direction"
    assert told.left < 0.2 * told.rms
    assert not any(explained.data.outliers.values())


def test_its_effect_file_has_the_seat_of_every_stroke(loose_key, explained, tmp_path):
    """By the campaign's clock: nothing else says which stroke it is."""
    told = explained.unexplained
    file = tmp_path / f"{told.stem}.py"
    file.write_text(told.source)
    known = registry.kinds()
    try:
        effect = registry.load_file(file)("Y", gain=1.0)
    finally:
        registry.restore(known)
    problem = loose_key[0]
    test, column = problem.tests[0], problem.chain.index("Y")
    clock = test.started + problem.samples[0].time
    zeros = np.zeros((len(clock), len(problem.chain.letters)))
    motion = Motion(clock - test.started, clock, *[zeros] * 5, problem.chain.letters)
    seat = effect.position_error(motion)[:, column]
    assert np.ptp(seat) == pytest.approx(6e-6, rel=0.1)
