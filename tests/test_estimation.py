"""Pieces of the inference on synthetic data with known answers."""

import dataclasses

import numpy as np
import pytest

from mjsim.ballbar.measurement import BallBarTest, Trace
from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.effects import registry
from mjsim.estimation.candidate_models import CandidateModels
from mjsim.estimation.criteria import feasible_share
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fitter
from mjsim.estimation.mistakes.checked_problem import trusted_problem
from mjsim.estimation.noise import estimate_noise
from mjsim.estimation.nuisance import TRIGGERS
from mjsim.estimation.outliers import mark_outliers, readmit_outliers
from mjsim.estimation.samples import GRID, Samples, revolution_time
from mjsim.estimation.selection import ModelSelection
from mjsim.estimation.signatures import Candidate, Projector, SignatureBank
from mjsim.io.resources import examples
from mjsim.machine.model import build

CIRCLE = BallBarTest("c", "circular", (0.0, 0.0, 0.155), 0.1, 1 / 60, revolutions=2)


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


def test_free_vector_round_trip():
    effect = registry.make("pitch_error.C", components=[[72, 0.0025, 30.0], [180, 0.0005, -120.0]])
    free = EffectVector(effect, ("components",))
    back = free.at(free.vector).values["components"]
    assert np.allclose(back, effect.values["components"])
    wave = registry.make("radial_error_motion.C", amplitude_um=2.0, order=3.0, phase_deg=50.0)
    free = EffectVector(wave, wave.search.free)
    assert free.at(free.vector).values == pytest.approx(wave.values)
    low, high = free.interval(free.vector, np.diag([1e-4, 1e-4]))["amplitude_um"]
    assert low == pytest.approx(2.0 - 1.96e-2, abs=3e-4) and high == pytest.approx(2.0 + 1.96e-2, abs=3e-4)


def test_nuisances_are_recovered_by_a_problem_of_known_offsets():
    """A trace made from the machine's own reading with known ball offsets, bar length and trigger gives them back."""
    from mjsim.estimation.nuisance_fit import fit_nuisance
    from mjsim.machine.chain import FIVE_AXIS
    from mjsim.machine.kinematics import reading
    from mjsim.simulation.axes import AxesMotion

    campaign = read_campaign(examples() / "healthy", traces=False)
    machine = read_machine(campaign.machine_file)
    test = next(t for t in campaign.tests if t.name == "cone15-x50-ccw")
    motion = AxesMotion(test)
    q = motion.load(build(machine))
    offset = np.array([12e-6, -7e-6, 4e-6])
    d = reading(FIVE_AXIS, q, np.asarray(test.table_ball) + offset, test.length) + 2e-6
    lo, hi = motion.program.measured_span
    time = np.arange(np.ceil(lo / 0.005), np.floor(hi / 0.005)) * 0.005
    value = np.interp(time - 0.011, motion.time, d) + coloured(
        len(time), 0.05e-6, 0.05, 0.005, np.random.default_rng(5)
    )
    trace = Trace(time, value, np.ones(len(time), bool))
    problem = trusted_problem(dataclasses.replace(campaign, tests=(test,), traces={test.name: trace}), build(machine))
    x = fit_nuisance(problem, problem.readings(build(machine)))
    n = problem.nuisances
    assert n.trigger(x, test.name) == pytest.approx(0.011, abs=0.001)
    total = problem.offsets(0, x)
    assert np.abs(total - (problem.sensitivity[0].table @ offset + 2e-6)).max() < 0.05e-6
    assert abs(n.table_ball(x, test.setup)[0]) < 30e-6 and abs(n.length(x)) < 9e-6


def test_a_ball_in_another_seat_is_left_out_and_a_step_that_repeats_is_not():
    """A lasting jump: the shorter side goes. The machine's own steps come back in the other revolution and stay."""
    from mjsim.estimation.outliers import largest_jump, leave_out_shorter_side

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
    from mjsim.estimation.outliers import largest_jump

    s = samples(np.random.default_rng(8), signal=0.0)
    turn = round(revolution_time(CIRCLE) / 0.005)
    at = 2000 + revolution * turn
    own = 2e-6 * ((np.arange(len(s.time)) - 2000) % turn < turn // 2)
    s.value = s.value + own - 1.5e-6 * (np.arange(len(s.time)) >= at)
    assert abs(largest_jump(s, s.value, 0.1e-6) - at) < 20


@pytest.mark.parametrize("revolution", [0, 1])
def test_a_ball_that_moves_while_the_signal_is_lost_is_found(revolution):
    from mjsim.estimation.outliers import largest_jump

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
    from mjsim.estimation.outliers import largest_jump

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
    from mjsim.estimation.outliers import largest_jump

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
    from mjsim.estimation.outliers import largest_jump

    s = samples(np.random.default_rng(13), signal=0.0, seconds=10.0)
    once = dataclasses.replace(CIRCLE, revolutions=1)
    value = s.value + 0.2e-6 * s.time - height * (np.arange(len(s.time)) >= 1200)
    lost = (np.arange(len(s.time)) >= 1200 - int(seconds / 0.005)) & (np.arange(len(s.time)) < 1200)
    single = Samples(once, s.time, value, ~lost, s.block)
    found = largest_jump(single, value, 0.1e-6)
    assert found == 1200 if is_seen else found is None


def test_an_estimate_beyond_the_bounds_goes_back_towards_them():
    """A velocity gain between 0.1 and 5, in twentieths; a gap cannot be below zero."""
    machine = read_machine(examples() / "healthy" / "machine.toml")

    def share(effect, x):
        return feasible_share(machine, np.array([x]), Candidate(effect, effect.search.free_of(type(effect).parameters)))

    gain, gap = registry.make("velocity_gain.C", ratio=1.05), registry.make("backlash.A", width_deg=0.001)
    assert share(gain, -10.0) == 1.0
    assert share(gain, -20.0) == pytest.approx(18.0 / 20.0)
    assert share(gain, 100.0) == pytest.approx(80.0 / 100.0)
    assert share(gap, -1.0) == 0.0 and share(gap, 1.0) == 1.0


def healthy(*names):
    """Tests of the healthy example, and its machine."""
    campaign = read_campaign(examples() / "healthy")
    campaign = dataclasses.replace(campaign, tests=tuple(t for t in campaign.tests if t.name in names))
    machine = read_machine(campaign.machine_file)
    return trusted_problem(campaign, build(machine), 2), machine


def hide(problem, machine, effect):
    """Add what an effect does to the measured values."""
    with_it, without = (problem.readings(build(m)) for m in (machine.with_effect(effect), machine))
    for s, a, b in zip(problem.samples, with_it, without, strict=True):
        s.value = s.value + np.interp(s.time, np.arange(len(a)) * GRID, a - b)
        s.mean = s.average(s.value)


def test_a_wave_is_found_from_triggers_that_followed_it():
    """Without the ripple in the model, the triggers move along with it; a fit from there ends half a wave off."""
    problem, machine = healthy("cone45-centre-ccw", "circle-xy-ccw", "circle-xy-cw", "rotary-a-tangential-ccw")
    ripple = registry.make("torque_ripple.A", amplitude_Nm=0.4, order=3.0, phase_deg=-20.0)
    hide(problem, machine, ripple)
    models = CandidateModels(Fitter(problem, machine))
    start = models.start()
    nuisance = start.nuisance.copy()
    nuisance[problem.nuisances[TRIGGERS]] = [-3.0, 3.0, 3.5, 0.0]
    start = dataclasses.replace(start, nuisance=nuisance)
    seed = Candidate(ripple.replaced(amplitude_Nm=0.15, phase_deg=-152.0), ripple.search.free)
    fit = models.refit([EffectVector(seed.effect, seed.names)], start, seed)
    assert fit.effects[0].effect.values["phase_deg"] == pytest.approx(-20.0, abs=1.0)


def test_a_data_sheet_far_off_does_not_end_a_fit():
    """Linear columns may move a sheet so far that the drives are unstable; the fit starts from the printed one."""
    campaign = read_campaign(examples() / "healthy")
    campaign = dataclasses.replace(campaign, tests=tuple(t for t in campaign.tests if t.name == "circle-xy-ccw"))
    machine = read_machine(campaign.machine_file)
    fitter = Fitter(trusted_problem(campaign, build(machine), 2), machine)
    near = fitter.fit([], iterations=0)
    wild = dataclasses.replace(
        near, sheet_deviation=np.where(np.arange(len(near.sheet_deviation)) % 7 == 2, -57.0, 20.0)
    )
    readings = fitter.problem.readings(build(wild.machine))
    assert not all(np.isfinite(r).all() for r in readings) or max(np.abs(r).max() for r in readings) > 1.0
    fit = fitter.fit([], start=wild, iterations=0, fresh=False)
    assert np.isfinite(fit.objective) and np.isfinite(fit.step).all() and np.abs(fit.sheet_deviation).max() < 10.0


def test_a_fit_that_was_stopped_in_a_valley_is_carried_on():
    """Half of a slow drift looks like any other time constant with another amplitude."""
    problem, machine = healthy("circle-xy-ccw", "circle-xy-cw", "circle-yz-ccw", "cone15-parallel-ccw")
    hide(problem, machine, registry.make("thermal_drift.Y", amplitude_um=20.0, time_constant_s=600.0))
    models = CandidateModels(Fitter(problem, machine))
    seed = registry.make("thermal_drift.Y", amplitude_um=28.0, time_constant_s=1000.0)
    stopped = models.fitter.fit([EffectVector(seed, seed.search.free)], iterations=1)
    done = models.settled(stopped)
    assert done.linear.gain(done.step) < 0.5 < stopped.linear.gain(stopped.step)
    assert done.effects[0].effect.values["time_constant_s"] == pytest.approx(600.0, rel=0.05)
    assert models.settled(done) is done


def test_a_wave_of_order_1_stands_in_the_place_of_a_windup():
    """The wind-up by an unbalance is a sine of A, and so is the eccentricity of its wheel: nothing tells them apart."""
    campaign = read_campaign(examples() / "healthy")
    names = ("cone45-centre-ccw", "rotary-a-tangential-ccw", "rotary-a-tangential-cw")
    campaign = dataclasses.replace(campaign, tests=tuple(t for t in campaign.tests if t.name in names))
    machine = read_machine(campaign.machine_file)
    selection = ModelSelection(Fitter(trusted_problem(campaign, build(machine), 2), machine))
    pitch = registry.make("pitch_error.A", components=[[72.0, 0.0005, 30.0]])
    windup = registry.make("gravity_windup.A", amplitude_deg=0.0003, phase_deg=40.0)
    mine = EffectVector(windup, windup.search.free_of(windup.parameters_of("A")))
    hide(selection.problem, machine, windup)
    beside = EffectVector(pitch, ("components",))
    without = selection.fitter.fit([beside], exact=False, iterations=1)
    bank = SignatureBank(selection.problem, without)
    ((gain, x, candidate),) = selection.first_order(without, "A", bank)
    assert candidate.id == "pitch_error.A" and candidate.effect.values["components"][0][0] == 1.0
    other = Candidate(windup, mine.names)
    ((same, y),) = Projector(without).gains([selection.problem.whiten(bank.columns(other))])
    assert gain == pytest.approx(same - selection.penalty(other), rel=1e-3)
    assert np.hypot(*x) == pytest.approx(np.hypot(*y), rel=1e-3)
    alone = selection.fitter.fit([], exact=False, iterations=1)
    assert selection.first_order(alone, "A", bank) == []


@pytest.mark.parametrize(
    ("hidden", "wrong"),
    [
        (registry.make("velocity_feedforward.X", ratio=0.08), "servo_gain.X"),
        (registry.make("servo_delay.X", delay_ms=1.8), "velocity_feedforward.X"),
    ],
)
def test_a_small_feedforward_stands_for_an_early_command_and_not_for_a_late_one(hidden, wrong):
    """A late command would be a feedforward below zero, which nobody sets."""
    problem, machine = healthy("circle-xy-ccw", "circle-xy-cw", "circle-yz-ccw", "cone15-parallel-ccw")
    hide(problem, machine, hidden)
    _, selection = ModelSelection(Fitter(problem, machine)).run(1)
    (found,) = selection.found
    said = {found.key, *found.alternatives}
    assert hidden.id in said and wrong not in said


def test_a_stiffness_is_fitted_as_its_compliance():
    """Off is infinite for the file and zero for the fit; intervals come back in the file's unit, low to high."""
    soft = registry.make("drive_compliance.X", stiffness_N_per_um=50.0, damping_ratio=0.1)
    free = EffectVector(soft, soft.search.free_of(soft.parameters_of("X")))
    assert free.vector == pytest.approx([2.0, 2.0])
    assert free.neutral == pytest.approx([0.0]) and free.linear == [0]
    assert free.at(np.array([4.0, 2.0])).values["stiffness_N_per_um"] == pytest.approx(25.0)
    assert free.at(np.array([-0.1, 2.0])).is_neutral
    low, high = free.interval(free.vector, np.diag([0.25, 1e-6]))["stiffness_N_per_um"]
    assert low < 50.0 < high and low == pytest.approx(100.0 / 2.98, rel=1e-3)


def test_a_time_constant_is_fitted_as_its_logarithm():
    """It is above zero and known to a factor: its interval is as wide to both sides in ratios, within the bounds."""
    drift = registry.make("thermal_drift.Z", amplitude_um=30.0, time_constant_s=240.0)
    free = EffectVector(drift, drift.search.free)
    assert free.at(free.vector).values["time_constant_s"] == pytest.approx(240.0)
    low, high = free.interval(free.vector, np.diag([0.1, 0.25]))["time_constant_s"]
    assert low < 240.0 < high and low * high == pytest.approx(240.0**2)
    assert free.interval(free.vector, np.diag([0.1, 1e6]))["time_constant_s"] == [5.0, 20000.0]
    assert free.linear == [0]


@pytest.mark.parametrize("true", [0.0, 0.7, 2.0, 4.0, 30.0])
def test_the_interval_of_an_amplitude_holds_it(true):
    """Nineteen of twenty, be the wave small or large; below the noise at least as many."""
    rng = np.random.default_rng(7)
    ripple = registry.make("torque_ripple.A", amplitude_Nm=1.0, order=3.0, phase_deg=0.0)
    free = EffectVector(ripple, ripple.search.free)
    scale = free.specs["amplitude_Nm"].scale
    spread = np.array([[1.0, 0.3], [0.3, 0.5]])
    found = rng.multivariate_normal([true * 0.8, -true * 0.6], spread, size=2000)
    held, widths = 0, []
    for v in found:
        out = free.interval(v, spread)
        low, high = (x / scale for x in out["amplitude_Nm"])
        held += low <= true <= high
        widths.append(out["phase_deg"][1] - out["phase_deg"][0])
    assert 0.94 < held / 2000 and (true < 30.0 or held / 2000 < 0.96)
    assert max(widths) <= 360.0 and (true < 30.0 or max(widths) < 9.0)


def test_a_step_ends_at_a_bound_and_the_others_make_the_best_of_it():
    """A gap cannot be below zero: a play that the data deny stays at zero, and the friction is fitted as alone."""
    campaign = read_campaign(examples() / "healthy")
    names = ("circle-xy-ccw", "circle-xy-cw")
    campaign = dataclasses.replace(campaign, tests=tuple(t for t in campaign.tests if t.name in names))
    machine = read_machine(campaign.machine_file)
    problem = trusted_problem(campaign, build(machine), 2)
    play, friction = registry.make("backlash.X", width_um=1.0), machine.effect("friction.X")
    hide(problem, machine, play.replaced(width_um=0.5))
    less = {s.test.name: s for s in problem.samples}
    for s in less.values():  # the other way round
        s.value = 2.0 * np.asarray(campaign.traces[s.test.name].deviation) - s.value
        s.mean = s.average(s.value)
    fitter = Fitter(problem, machine)
    free = [EffectVector(friction, ("coulomb_Nm",)), EffectVector(play, ("width_um",))]
    both, alone = fitter.fit(free, iterations=20), fitter.fit(free[:1], iterations=20)
    assert both.effects[1].effect.values["width_um"] == 0.0
    assert both.effects[0].effect.values["coulomb_Nm"] == pytest.approx(
        alone.effects[0].effect.values["coulomb_Nm"], rel=1e-2
    )
    assert both.objective == pytest.approx(alone.objective, rel=2e-3)


def test_a_generic_curve_finds_the_axis_and_the_variable():
    """A float of X with Y's speed, laid over a healthy campaign: the term says so, and so does the effect file it
    writes.
    """
    from mjsim.estimation.curve_search import best_curve_term
    from mjsim.estimation.fit import Fitter
    from mjsim.estimation.selection import ModelSelection
    from mjsim.estimation.unexplained import describe

    campaign = read_campaign(examples() / "healthy")
    machine = read_machine(campaign.machine_file)
    tests = tuple(t for t in campaign.tests if t.name in ("circle-xy-ccw", "cone15-x50-ccw", "cone15-parallel-ccw"))
    problem = trusted_problem(
        dataclasses.replace(campaign, tests=tests, traces={t.name: campaign.traces[t.name] for t in tests}),
        build(machine),
    )
    clean = ModelSelection(Fitter(problem, machine)).start()
    assert best_curve_term(problem, clean) is None
    floating = []
    for s, m, sens in zip(problem.samples, problem.motions, problem.sensitivity, strict=True):
        speed = np.abs(np.gradient(m.commands[::5, 1], m.time[5]))
        floating.append(s.without(-s.sample_all(sens.axes[:, 0] * 2e-6 * np.sqrt(speed / 0.0167), 0.0)))
    problem = dataclasses.replace(problem, samples=tuple(floating))
    fit = ModelSelection(Fitter(problem, machine)).start()
    term = best_curve_term(problem, fit)
    assert (term.axis, term.moves, term.variable) == ("Y", "X", "velocity")
    told = describe(problem, fit, term)
    assert told.axes == ("Y", "X") and told.variable == "velocity" and "X axis" in told.summary
    planted = np.sqrt(np.mean(np.concatenate([s.left_out for s in problem.samples]) ** 2))
    assert 0.1 * planted < told.rms < planted  # the set-up takes its share


@pytest.mark.parametrize("moves", ["X", "C", "table y"])
def test_the_written_effect_does_what_its_term_did(moves, tmp_path):
    """The effect file of a term, simulated, changes the reading by what the term says."""
    from mjsim.effects.registry import load_file
    from mjsim.estimation.curve_terms import CurveTerms
    from mjsim.estimation.effect_file import effect_source
    from mjsim.estimation.fit import Fitter
    from mjsim.estimation.selection import ModelSelection

    campaign = read_campaign(examples() / "healthy")
    machine = read_machine(campaign.machine_file)
    tests = tuple(t for t in campaign.tests if t.name == "cone15-x50-ccw")
    problem = trusted_problem(
        dataclasses.replace(campaign, tests=tests, traces={t.name: campaign.traces[t.name] for t in tests}),
        build(machine),
    )
    fit = ModelSelection(Fitter(problem, machine)).start()
    term = next(t for t in CurveTerms(problem, fit).of("C", moves) if t.variable == "position" and t.period)
    values = 3.0 * np.cos(term.knots) * term.unit
    path = tmp_path / "own.py"
    path.write_text(effect_source(problem.chain, term, values, "A test.", "own.py"))
    own = load_file(path)("C", gain=1.0)
    got = problem.difference(
        problem.readings(build(machine)), problem.readings(build(machine.with_effect(own))), fit.nuisance
    )[0]
    want = term.columns[0] @ (values / term.unit)
    assert np.std(want) > 0.2e-6
    assert np.abs(got - want).max() < 0.03 * np.abs(want).max() + 0.01e-6


def test_a_ball_in_another_seat_has_a_length_of_its_own():
    """A knock moves the ball along the bar as well, by an amount that the jump alone does not tell exactly."""
    from mjsim.estimation.nuisance import AFTER_KNOCK, Nuisances

    knocked = dataclasses.replace(CIRCLE, name="d", setup=f"d {AFTER_KNOCK}")
    n = Nuisances.of_tests([CIRCLE, knocked], 4.0)
    x = np.zeros(n.size)
    x[n.of_test(knocked)[6]] = 1.0
    assert n.length(x, knocked.setup) == pytest.approx(3e-6)
    assert n.length(x, CIRCLE.setup) == n.length(x) == 0.0
