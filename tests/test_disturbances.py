"""The noise of a measurement, and what happened once in it: knocks, and a ball that sits elsewhere afterwards."""

import dataclasses

import numpy as np
import pytest
from noisy_traces import CIRCLE, samples

from mjsim.inference.disturbances import largest_jump, leave_out_shorter_side, mark_outliers, readmit_outliers
from mjsim.inference.noise import estimate_noise
from mjsim.inference.samples import Samples, revolution_time


def test_noise_is_seen_through_a_large_repeatable_signal():
    rng = np.random.default_rng(1)
    noise = estimate_noise([samples(rng) for _ in range(4)], 0.1e-6)
    assert noise.rms == pytest.approx(0.1e-6, rel=0.08)


def test_a_jump_in_one_of_two_tests_does_not_make_the_noise_larger():
    """A ball that a knock has put 2 µm higher; with a greater noise nobody would look for it."""
    rng = np.random.default_rng(10)
    sound, knocked = samples(rng), samples(rng)
    jump = 2e-6 * (knocked.time > knocked.time[6000])
    knocked = Samples(CIRCLE, knocked.time, knocked.value + jump, knocked.valid, knocked.block)
    assert estimate_noise([sound, knocked], 0.1e-6).rms == pytest.approx(0.1e-6, rel=0.08)


def test_whitened_noise_is_white_with_unit_variance():
    rng = np.random.default_rng(2)
    all_of_them = [samples(rng, signal=0.0) for _ in range(4)]
    noise = estimate_noise(all_of_them, 0.1e-6)
    white = np.concatenate([noise.whiten(s, s.mean) for s in all_of_them])
    assert np.std(white) == pytest.approx(1.0, abs=0.03)
    for lag in (1, 2, 5):
        assert abs(np.mean(white[lag:] * white[:-lag])) < 0.03


def test_the_noise_is_as_strong_at_low_frequencies_as_it_was_made():
    """There it decides how well a number is known, and drift between the revolutions is taken out there."""
    rng = np.random.default_rng(3)
    power = []
    for _ in range(20):
        short = [samples(rng, signal=0.0) for _ in range(5)]
        noise = estimate_noise(short, 0.1e-6)
        spectra = [np.abs(np.fft.rfft(noise.whiten(s, s.mean))) ** 2 / len(s.mean) for s in short]
        power.append(np.mean([spectrum[1 : len(spectrum) // 20] for spectrum in spectra]))
    assert np.mean(power) == pytest.approx(1.0, abs=0.05)


def test_what_is_left_out_does_not_make_the_noise_smaller():
    """Most tests of a campaign with a third or a half of the trace left out, as after a knock."""
    rng = np.random.default_rng(9)
    all_of_them = [samples(rng, signal=0.0) for _ in range(6)]
    whole = estimate_noise(all_of_them, 0.1e-6)
    for s, share in zip(all_of_them, (0.3, 0.3, 0.3, 0.48, 0.48, 0.0), strict=True):
        s.valid[: int(share * len(s.valid))] = False
        s.refresh()
    part = estimate_noise(all_of_them, 0.1e-6)
    assert part.rms == pytest.approx(whole.rms, rel=0.1)
    assert part.block_rms == pytest.approx(whole.block_rms, rel=0.1)


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


def test_what_the_fitted_model_follows_was_no_knock():
    """Of two stretches that were left out the model explains one: that one counts again."""
    rng = np.random.default_rng(7)
    s = samples(rng, signal=0.0)
    given = s.valid.copy()
    given[6000:6010] = False  # a gap of the recording is none of its business
    s.valid &= given
    for at in (2000, 4000):
        s.valid[at : at + 60] = False
    s.refresh()
    rest = s.value.copy()
    rest[2020:2040] += 8e-6
    assert readmit_outliers(s, given, rest, 0.1e-6) == 1
    assert not s.valid[2000:2060].any() and s.valid[4000:4060].all() and not s.valid[6000:6010].any()
    assert s.good[np.searchsorted(s.edges, 4030, "right") - 1]
    assert not s.good[np.searchsorted(s.edges, 2030, "right") - 1]
    assert readmit_outliers(s, given, rest, 0.1e-6) == 0


def test_a_ball_in_another_seat_is_left_out_and_a_step_that_repeats_is_not():
    """A lasting jump: the shorter side goes. The machine's own steps come back in the other revolution and stay."""
    rng = np.random.default_rng(6)
    s = samples(rng, signal=3e-6)
    own = s.value.copy()
    seat = np.where(s.time > s.time[6000], 1.5e-6, 0.0)
    s.value = own + seat
    at = largest_jump(s, s.value, 0.1e-6)
    assert abs(at - 6000) < 20
    leave_out_shorter_side(s, at, s.value.copy())
    longer = s.valid[: 6000 - 100], s.valid[6000 + 100 :]
    assert longer[0].mean() + longer[1].mean() == pytest.approx(1.0, abs=0.02)
    assert s.valid.mean() > 0.5
    t = samples(rng, signal=3e-6)
    assert largest_jump(t, t.value, 0.1e-6) is None


@pytest.mark.parametrize("revolution", [0, 1])
def test_a_ball_in_another_seat_is_found_where_the_machine_steps_the_other_way(revolution):
    """The machine's own step at the same angle, in both revolutions, makes the smaller step that of the knock."""
    s = samples(np.random.default_rng(8), signal=0.0)
    turn = round(revolution_time(CIRCLE) / 0.005)
    at = 2000 + revolution * turn
    own = 2e-6 * ((np.arange(len(s.time)) - 2000) % turn < turn // 2)
    s.value = s.value + own - 1.5e-6 * (np.arange(len(s.time)) >= at)
    assert abs(largest_jump(s, s.value, 0.1e-6) - at) < 20


@pytest.mark.parametrize("revolution", [0, 1])
def test_a_ball_that_moves_while_the_signal_is_lost_is_found(revolution):
    s = samples(np.random.default_rng(11))
    at = 2000 + revolution * round(revolution_time(CIRCLE) / 0.005)
    s.value = s.value + 1.5e-6 * (np.arange(len(s.time)) >= at)
    assert largest_jump(s, s.value, 0.1e-6) == pytest.approx(at, abs=20)
    s.valid[at - 200 : at + 200] = False
    s.refresh()
    assert abs(largest_jump(s, s.value, 0.1e-6) - at) <= 201
    lost = samples(np.random.default_rng(11))
    lost.valid[at - 200 : at + 200] = False
    assert largest_jump(lost, lost.value, 0.1e-6) is None


@pytest.mark.parametrize("after_the_seam", [-60, -5, 0, 5, 60])
def test_a_ball_that_moves_between_the_revolutions_is_found(after_the_seam):
    """Nearly all of the second revolution lies as far from the first one."""
    s = samples(np.random.default_rng(12), signal=0.0)
    at = round(revolution_time(CIRCLE) / 0.005) + after_the_seam
    s.value = s.value + 1.5e-6 * (np.arange(len(s.time)) >= at)
    assert largest_jump(s, s.value, 0.1e-6) == pytest.approx(at, abs=20)


@pytest.mark.parametrize(
    ("signal", "moves", "is_seen"),
    [
        (0.0, lambda place: 1.5e-6 * (place >= 0.0), True),
        (0.0, lambda place: 1.5e-6 * np.clip(place + 0.5, 0.0, 1.0), False),
        (3e-6, lambda place: 1.5e-6 * np.clip(place + 0.5, 0.0, 1.0), False),
    ],
    ids=["jump", "drift", "drift-and-a-step-of-the-machine"],
)
def test_a_ball_that_moves_where_only_one_revolution_has_a_signal(signal, moves, is_seen):
    """``moves``: shift over the place along the test, in revolutions from the end of the first."""
    s = samples(np.random.default_rng(11), signal=signal)
    turn = round(revolution_time(CIRCLE) / 0.005)
    at = turn - 300
    s.valid[at + turn - 300 :] = False
    s.refresh()
    s.value = s.value + moves((np.arange(len(s.time)) - at) / turn)
    found = largest_jump(s, s.value, 0.1e-6)
    assert found == pytest.approx(at, abs=20) if is_seen else found is None


@pytest.mark.parametrize(("height", "is_seen"), [(3e-6, True), (0.0, False)])
@pytest.mark.parametrize("seconds", [0.5, 2.0])
def test_a_ball_that_moves_while_the_only_revolution_has_no_signal_is_found(seconds, height, is_seen):
    """What the reading does in the same time elsewhere, here a slow drift of 0.2 µm/s, is no jump."""
    s = samples(np.random.default_rng(13), signal=0.0, seconds=10.0)
    once = dataclasses.replace(CIRCLE, revolutions=1)
    value = s.value + 0.2e-6 * s.time - height * (np.arange(len(s.time)) >= 1200)
    lost = (np.arange(len(s.time)) >= 1200 - int(seconds / 0.005)) & (np.arange(len(s.time)) < 1200)
    single = Samples(once, s.time, value, ~lost, s.block)
    found = largest_jump(single, value, 0.1e-6)
    assert found == 1200 if is_seen else found is None
