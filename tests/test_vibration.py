"""Vibrations: found between revolutions, with frequency, axis and phase; not found where there is none."""

from dataclasses import replace

import numpy as np
import pytest

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.compare import compare
from mjsim.commands.diagnosis import hum_sentence
from mjsim.effects.registry import make
from mjsim.inference.mistakes.checked_problem import trusted_problem
from mjsim.inference.settings import DIAGNOSIS
from mjsim.inference.vibration import Hum, Record, is_news, line_near, phased, separate
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.model import build

TESTS = ("circle-xy-ccw", "circle-xy-cw", "cone15-parallel-ccw")


@pytest.fixture(scope="module")
def healthy():
    campaign = read_campaign(examples() / "healthy")
    tests = tuple(t for t in campaign.tests if t.name in TESTS)
    return replace(campaign, tests=tests, traces={t.name: campaign.traces[t.name] for t in tests})


def shaken(campaign, machine, axis, amplitude, frequency):
    """The campaign with a vibration of one axis laid over its traces, or a hum of the instrument where ``axis`` is
    empty; phases 1, 2, 3 rad.
    """
    traces = {}
    for k, t in enumerate(campaign.tests):
        trace = campaign.traces[t.name]
        problem = trusted_problem(replace(campaign, tests=(t,), traces={t.name: trace}), machine, threads=1)
        grid = problem.sensitivity[0].axes[:, "XYZ".index(axis or "X")]
        weight = np.interp(trace.time, 0.005 * np.arange(len(grid)), grid) if axis else 1.0
        wave = amplitude * weight * np.sin(2 * np.pi * frequency * trace.time + k + 1.0)
        traces[t.name] = replace(trace, deviation=trace.deviation + wave)
    return replace(campaign, traces=traces)


def test_an_axis_that_no_test_sees_is_not_named(healthy):
    """Circles in XY say nothing about Z: the noise would look like a large wave of it."""
    flat = tuple(t for t in healthy.tests if t.plane == "XY" and t.kind == "circular")
    campaign = replace(healthy, tests=flat, traces={t.name: healthy.traces[t.name] for t in flat})
    machine = read_machine(campaign.machine_file)
    problem = trusted_problem(shaken(campaign, machine, "X", 0.05e-6, 43.7), machine)
    (line,) = separate(problem, machine).lines
    assert "vibration.Z" not in {line.effect.id, *line.alternatives}
    assert line.effect.values["amplitude_um"] < 0.1


@pytest.mark.parametrize(
    ("axis", "amplitude", "frequency"), [("X", 0.3e-6, 43.7), ("Y", 0.6e-6, 6.1), ("Z", 0.8e-6, 71.0)]
)
def test_a_planted_vibration_is_found(healthy, axis, amplitude, frequency):
    machine = read_machine(healthy.machine_file)
    problem = trusted_problem(shaken(healthy, machine, axis, amplitude, frequency), machine)
    separated = separate(problem, machine)
    assert separated.machine == machine and len(separated.lines) == 1
    line = separated.lines[0]
    assert line.effect.id == f"vibration.{axis}" and not line.alternatives
    assert line.effect.values["frequency_Hz"] == pytest.approx(frequency, abs=0.002)
    assert line.effect.values["amplitude_um"] == pytest.approx(amplitude * 1e6, rel=0.05)
    low, high = line.ci95["amplitude_um"]
    assert 0.0 < high - low < 0.1
    if axis != "Z":  # the phase, at the program's start, but for the trigger's few ms
        expected = [k + 1.0 for k in range(len(TESTS))]
        got = [line.effect.phases[t.name] for t in healthy.tests]
        shift = np.angle(np.exp(1j * (np.array(got) - expected)))
        assert np.abs(shift).max() < 2 * np.pi * frequency * 0.05 + 0.2


def test_a_hum_of_the_instrument_is_no_vibration_of_an_axis(healthy):
    """The mains are in the signal wherever the machine stands; an axis shows by where the bar points."""
    machine = read_machine(healthy.machine_file)
    both = shaken(shaken(healthy, machine, "", 0.08e-6, 50.02), machine, "Y", 0.3e-6, 31.4)
    separated = separate(trusted_problem(both, machine), machine)
    (hum,), (line,) = separated.hums, separated.lines
    assert hum.frequency == pytest.approx(50.02, abs=0.002)
    assert hum.amplitude == pytest.approx(0.08e-6, rel=0.05) and not hum.alternatives
    assert line.effect.id == "vibration.Y" and line.effect.values["amplitude_um"] == pytest.approx(0.3, rel=0.05)
    quiet = separate(trusted_problem(healthy, machine), machine).problem
    assert separated.problem.noise.rms == pytest.approx(quiet.noise.rms, rel=0.01)
    row = {"amplitude_um": 0.08, "frequency_Hz": 50.02, "alternatives": []}
    assert "hums: 0.08 µm at 50.02 Hz" in hum_sentence([row]) and hum_sentence([]) == ""


@pytest.mark.parametrize("axis", ["", "Y"])
def test_a_slender_cone_tells_a_hum_from_a_vibration(axis):
    """The bar keeps near one axis there, and yet turns a little."""
    campaign = read_campaign(examples() / "healthy")
    tests = tuple(t for t in campaign.tests if t.name in ("cone15-centre-ccw", "cone15-y50-ccw"))
    campaign = replace(campaign, tests=tests, traces={t.name: campaign.traces[t.name] for t in tests})
    machine = read_machine(campaign.machine_file)
    separated = separate(trusted_problem(shaken(campaign, machine, axis, 0.05e-6, 50.02), machine), machine)
    assert [line.effect.subject for line in separated.lines] == [*axis]
    assert len(separated.hums) == (not axis)


def test_where_the_bar_points_one_way_a_hum_may_be_a_vibration():
    """No axis is named there, and that it may be one is told."""
    time = np.arange(4000) / 200.0
    ways = np.zeros((len(time), 4))
    ways[:, 1], ways[:, 3] = -1.0, 1.0
    noise = 0.1e-6 * np.random.default_rng(4).standard_normal(len(time))
    wave = 0.1e-6 * np.sin(2.0 * np.pi * 50.02 * time + 1.0)
    record = Record("one", time, noise + wave, ways, np.full(2001, 1e-14), 200.0)
    hum = line_near([record], 50.0, FIVE_AXIS, DIAGNOSIS)
    assert isinstance(hum, Hum) and hum.alternatives == ("vibration.Y",)
    assert hum.amplitude == pytest.approx(0.1e-6, rel=0.1)


@pytest.mark.parametrize("frequency", [2.5, 6.47, 13.2, 27.3])
def test_the_amplitude_is_that_of_the_vibration(healthy, frequency):
    """What takes the slow part off the residual takes nothing off the vibration: within 0.3 %, noise included."""
    machine = read_machine(healthy.machine_file)
    problem = trusted_problem(shaken(healthy, machine, "X", 20e-6, frequency), machine)
    (line,) = separate(problem, machine).lines
    assert line.effect.values["amplitude_um"] == pytest.approx(20.0, rel=0.003)


def test_traces_of_different_rates_are_searched_together(healthy):
    """Two tests recorded at half the third one's rate: the spectra are laid over each other at the same frequencies."""
    machine = read_machine(healthy.machine_file)
    campaign = shaken(healthy, machine, "X", 0.3e-6, 31.3)
    coarse = {
        n: replace(t, time=t.time[::2], deviation=t.deviation[::2], valid=t.valid[::2])
        for n, t in campaign.traces.items()
    }
    mixed = replace(campaign, traces={**coarse, TESTS[2]: campaign.traces[TESTS[2]]})
    (line,) = separate(trusted_problem(mixed, machine), machine).lines
    assert line.effect.id == "vibration.X"
    assert line.effect.values["frequency_Hz"] == pytest.approx(31.3, abs=0.005)


def test_a_healthy_machine_does_not_vibrate(healthy):
    machine = read_machine(healthy.machine_file)
    assert separate(trusted_problem(healthy, machine), machine).lines == ()


def test_what_is_left_out_can_be_restored(healthy):
    machine = read_machine(healthy.machine_file)
    problem = trusted_problem(shaken(healthy, machine, "X", 0.5e-6, 30.71), machine)
    before = [s.mean.copy() for s in problem.samples]
    data = separate(problem, machine).problem
    assert data.noise.rms < 0.8 * problem.noise.rms  # a vibration does not count as noise
    assert max(np.abs(s.mean - b).max() for s, b in zip(data.samples, before, strict=True)) > 0.05e-6
    restored = data.restored()
    assert restored.noise is data.noise
    for s, b in zip((*restored.samples, *problem.samples), 2 * before, strict=True):
        np.testing.assert_array_equal(s.mean, b)


def test_a_vibration_that_the_machine_has_gets_its_phases(healthy):
    """The machine file has size and frequency; every test has its own phase, found anew."""
    machine = read_machine(healthy.machine_file)
    known = machine.with_effect(make("vibration.X", amplitude_um=0.5, frequency_Hz=30.71))
    problem = trusted_problem(shaken(healthy, machine, "X", 0.5e-6, 30.71), known)
    with_phases = phased(problem, known)
    assert set(with_phases.effect("vibration.X").phases) == set(TESTS)
    with_it, without = ([r for r in problem.readings(build(m))] for m in (with_phases, machine))
    from mjsim.inference.nuisance_fit import fit_nuisance

    nuisance = fit_nuisance(problem, without)
    spread = [np.sqrt(np.mean(np.concatenate(problem.residual(r, nuisance)) ** 2)) for r in (with_it, without)]
    assert spread[0] < 0.9 * spread[1]
    separated = separate(problem, known)
    assert not any(e.kind == "vibration" for e in separated.machine.effects)
    (line,) = separated.lines
    assert not is_news(line, known) and is_news(line, machine)


def test_reversals_decide_the_trigger_beside_a_vibration(healthy):
    """Half a period of the vibration is 13 ms; a trigger 20 ms off would put every reversal in a wrong place."""
    machine = read_machine(healthy.machine_file)
    late = {name: replace(t, time=t.time + 0.02) for name, t in healthy.traces.items()}
    campaign = shaken(replace(healthy, traces=late), machine, "X", 1.5e-6, 38.0)
    sound = compare(healthy, machine)
    shaking = compare(campaign, machine.with_effect(make("vibration.X", amplitude_um=1.5, frequency_Hz=38.0)))
    for before, after in zip(sound.tests, shaking.tests, strict=True):
        assert after.trigger - before.trigger == pytest.approx(0.02, abs=0.001)
    assert shaking.rms == pytest.approx(sound.rms, rel=0.02)
    assert shaking.noise == pytest.approx(sound.noise, rel=0.02)
