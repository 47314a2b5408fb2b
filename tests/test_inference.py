"""Pieces of the inference on synthetic data with known answers."""

import dataclasses

import numpy as np
import pytest

from mjsim.campaign.files import read_campaign
from mjsim.campaign.model import Test, Trace
from mjsim.effects import registry
from mjsim.inference.free import FreeEffect
from mjsim.inference.outliers import mark_outliers
from mjsim.inference.problem import Problem
from mjsim.inference.samples import Samples, estimate_noise, revolution_time
from mjsim.machine.files import read_machine
from mjsim.resources import examples

CIRCLE = Test("c", "circular", (0.0, 0.0, 0.155), 0.1, 1 / 60, revolutions=2)


def coloured(n, rms, tau, dt, rng):
    a, out, x = np.exp(-dt / tau), np.empty(n), rng.normal(0, rms)
    for i in range(n):
        x = a * x + rng.normal(0, rms * np.sqrt(1 - a * a))
        out[i] = x
    return out


def samples(rng, rms=0.1e-6, signal=3e-6, seconds=None):
    turn = revolution_time(CIRCLE)
    time = 1.0 + np.arange(int((seconds or 2 * turn) / 0.005)) * 0.005
    phi = 2 * np.pi * time / turn
    value = signal * np.cos(3 * phi) + signal * np.sign(np.sin(phi)) + coloured(len(time), rms, 0.05, 0.005, rng)
    return Samples(CIRCLE, time, value, np.ones(len(time), bool), 0.02)


def test_noise_is_seen_through_a_large_repeatable_signal():
    rng = np.random.default_rng(1)
    noise = estimate_noise([samples(rng) for _ in range(4)], 0.1e-6)
    assert noise.rms == pytest.approx(0.1e-6, rel=0.08)


def test_whitened_noise_is_white_with_unit_variance():
    rng = np.random.default_rng(2)
    all_of_them = [samples(rng, signal=0.0) for _ in range(4)]
    noise = estimate_noise(all_of_them, 0.1e-6)
    white = np.concatenate([noise.whiten(s, s.mean) for s in all_of_them])
    assert np.std(white) == pytest.approx(1.0, abs=0.03)
    for lag in (1, 2, 5):
        assert abs(np.mean(white[lag:] * white[:-lag])) < 0.03


def test_a_gap_becomes_invalid_samples_on_an_even_clock():
    rng = np.random.default_rng(3)
    s = samples(rng)
    keep = np.ones(len(s.time), bool)
    keep[1000:1300] = False
    cut = Samples(CIRCLE, s.time[keep], s.value[keep], s.valid[keep], 0.02)
    assert len(cut.time) == len(s.time)
    assert (~cut.valid).sum() == 300
    assert np.allclose(np.diff(cut.time), 0.005)


def test_a_knock_is_left_out_and_what_repeats_is_not():
    rng = np.random.default_rng(4)
    s = samples(rng, signal=0.0)
    turn = round(revolution_time(CIRCLE) / 0.005)
    knock, glitch = np.zeros(len(s.time)), np.zeros(len(s.time))
    knock[2000:2060] = 8e-6
    for at in (4000, 4000 + turn):
        glitch[at : at + 40] = 8e-6
    assert mark_outliers(s, s.value + knock + glitch, 0.1e-6) == 1
    assert not s.valid[2000:2060].any()
    assert s.valid[4000:4040].all() and s.valid[4000 + turn : 4040 + turn].all()


def test_free_vector_round_trip():
    effect = registry.make("pitch_error.C", components=[[72, 0.0025, 30.0], [180, 0.0005, -120.0]])
    free = FreeEffect(effect, ("components",))
    back = free.at(free.vector).values["components"]
    assert np.allclose(back, effect.values["components"])
    wave = registry.make("radial_error_motion.C", amplitude_um=2.0, order=3.0, phase_deg=50.0)
    free = FreeEffect(wave, wave.free)
    assert free.at(free.vector).values == pytest.approx(wave.values)
    low, high = free.interval(free.vector, np.diag([1e-4, 1e-4]))["amplitude_um"]
    assert low == pytest.approx(2.0 - 1.96e-2) and high == pytest.approx(2.0 + 1.96e-2)


def test_nuisances_are_recovered_by_a_problem_of_known_offsets():
    """A trace made from the machine's own reading with known ball offsets, bar length and trigger gives them back."""
    from mjsim.engine.plant import build
    from mjsim.inference.nuisance import fit_nuisance
    from mjsim.inference.problem import LENGTH, TABLE_BALL, TRIGGER
    from mjsim.kinematics import reading
    from mjsim.motion import TestMotion

    campaign = read_campaign(examples() / "healthy", traces=False)
    machine = read_machine(campaign.machine_file)
    test = next(t for t in campaign.tests if t.name == "cone15-x50-ccw")
    motion = TestMotion(test)
    q = motion.load(build(machine))
    offset = np.array([12e-6, -7e-6, 4e-6])
    d = reading(q, np.asarray(test.table_ball) + offset, test.length) + 2e-6
    lo, hi = motion.program.measured_span
    time = np.arange(np.ceil(lo / 0.005), np.floor(hi / 0.005)) * 0.005
    value = np.interp(time - 0.011, motion.time, d) + coloured(len(time), 0.05e-6, 0.05, 0.005, np.random.default_rng(5))
    trace = Trace(time, value, np.ones(len(time), bool))
    problem = Problem(dataclasses.replace(campaign, tests=(test,), traces={test.name: trace}), machine)
    x = fit_nuisance(problem, problem.readings(build(machine)))
    assert TRIGGER * x[problem.layout.trigger(test.name)] == pytest.approx(0.011, abs=0.001)
    total = problem.offsets(0, x)
    assert np.abs(total - (problem.sensitivity[0].table @ offset + 2e-6)).max() < 0.05e-6
    assert TABLE_BALL * abs(x[0]) < 30e-6 and LENGTH * abs(x[problem.layout.length]) < 9e-6
