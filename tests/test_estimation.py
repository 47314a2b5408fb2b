"""Pieces of the inference on synthetic data with known answers."""

import dataclasses
import tomllib

import numpy as np
import pytest
from independent import machines, simulate, unlisted
from noisy_traces import CIRCLE, coloured, samples

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.effects import registry
from mjsim.inference.bar_search import BarSearch
from mjsim.inference.curve_terms import CurveTerms
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.findings import explain
from mjsim.inference.fit import Fitter
from mjsim.inference.mistakes.checked_problem import trusted_problem
from mjsim.inference.nuisance_fit import fit_nuisance
from mjsim.inference.samples import GRID, Samples
from mjsim.inference.signatures import Candidate, Projector, SignatureBank, feasible_share
from mjsim.inference.spectrum import spectral_candidates
from mjsim.inference.unexplained import describe
from mjsim.inference.vibration import separate
from mjsim.instruments.ball_bar.measurement import Trace
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.model import build


def test_a_gap_becomes_invalid_samples_on_an_even_clock():
    rng = np.random.default_rng(3)
    s = samples(rng)
    keep = np.ones(len(s.time), bool)
    keep[1000:1300] = False
    cut = Samples(CIRCLE, s.time[keep], s.value[keep], s.valid[keep], 0.02)
    assert len(cut.time) == len(s.time)
    assert (~cut.valid).sum() == 300
    assert np.allclose(np.diff(cut.time), 0.005)


@pytest.mark.parametrize("rate", [200.0, 171.0, 1000.0])
@pytest.mark.parametrize("frequency", [8.0, 36.0])
def test_a_simulated_wave_keeps_its_size_between_the_points_of_the_grid(frequency, rate):
    def wave(time):
        return np.sin(2 * np.pi * frequency * time)

    time = 1.0 + np.arange(int(4 * rate)) / rate
    recorded = Samples(CIRCLE, time, np.zeros_like(time), np.ones(len(time), bool), 0.01)
    for shift in (0.0, 0.0012, 0.0025):
        modelled = recorded.sample_all(wave(GRID * np.arange(1200)), shift)
        assert np.abs(modelled - wave(time - shift)).max() < 0.003


def test_a_simulated_reading_is_followed_to_the_ends_of_the_grid():
    time = GRID * np.arange(0.0, 19.0, 0.3)
    recorded = Samples(CIRCLE, time, np.zeros_like(time), np.ones(len(time), bool), GRID)
    assert recorded.sample_all((GRID * np.arange(20)) ** 2, 0.0) == pytest.approx(time**2, abs=1e-12)


@pytest.mark.parametrize("rate", [20.0, 171.0, 200.0, 1000.0])
def test_block_means_of_a_simulated_reading_are_those_of_its_samples(rate):
    time = np.arange(int(4 * rate)) / rate
    recorded = Samples(CIRCLE, time, np.zeros_like(time), np.ones(len(time), bool), 0.02)
    for grid in np.random.default_rng(5).standard_normal((2, 802)).cumsum(axis=1):
        for shift in (0.0, 0.0012, 0.0, -0.004):
            means = recorded.average(recorded.sample_all(grid, shift))
            assert recorded.sample(grid, shift) == pytest.approx(means, abs=1e-12)


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
    problem = trusted_problem(dataclasses.replace(campaign, tests=(test,), traces={test.name: trace}), machine)
    x = fit_nuisance(problem, problem.readings(build(machine)))
    n = problem.nuisances
    assert n.trigger(x, test.name) == pytest.approx(0.011, abs=0.001)
    total = problem.offsets(0, x)
    assert np.abs(total - (problem.sensitivity[0].table @ offset + 2e-6)).max() < 0.05e-6
    assert abs(n.table_ball(x, test.setup)[0]) < 30e-6 and abs(n.length(x)) < 9e-6


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
    return trusted_problem(campaign, machine, 2), machine


def hide(problem, machine, effect):
    """Add what an effect does to the measured values, as late as their clocks run."""
    with_it, without = (problem.readings(build(m)) for m in (machine.with_effect(effect), machine))
    nuisance = fit_nuisance(problem, without)
    for k, (s, a, b) in enumerate(zip(problem.samples, with_it, without, strict=True)):
        s.value = s.value + s.sample_all(a - b, problem.shift(k, nuisance))
        s.mean = s.average(s.value)


@pytest.mark.parametrize(
    ("hidden", "name", "close"),
    [
        # without the ripple in the model, the triggers move along with it
        (registry.make("torque_ripple.A", amplitude_Nm=0.4, order=3.0, phase_deg=-20.0), "phase_deg", 1.0),
        # half of a slow drift looks like any other time constant with another amplitude
        (registry.make("thermal_drift.Y", amplitude_um=20.0, time_constant_s=600.0), "time_constant_s", 30.0),
    ],
)
def test_the_shape_of_a_cause_is_fitted_to_the_end(hidden, name, close):
    problem, machine = healthy("cone45-centre-ccw", "circle-xy-ccw", "circle-xy-cw", "circle-yz-ccw")
    hide(problem, machine, hidden)
    (found,) = BarSearch(Fitter(problem, machine)).run(1).model.fit.effects
    assert found.effect.id == hidden.id
    assert found.effect.values[name] == pytest.approx(hidden.values[name], abs=close)


def test_how_soon_sticking_fades_is_fitted():
    """Three times sooner than from where the search starts; with the wrong speed, many small things were named."""
    problem, machine = healthy("cone45-centre-ccw", "circle-xy-ccw", "circle-xy-cw", "circle-yz-ccw")
    hidden = machine.effect("friction.Y").replaced(static_ratio=1.8, stribeck_velocity_rad_per_s=0.1)
    hide(problem, machine, hidden)
    (found,) = BarSearch(Fitter(problem, machine)).run(1).model.fit.effects
    assert found.effect.id == "friction.Y"
    assert found.effect.values["static_ratio"] == pytest.approx(1.8, rel=0.1)
    assert found.effect.values["stribeck_velocity_rad_per_s"] == pytest.approx(0.1, rel=0.1)


def test_the_waves_of_the_machine_file_stay_where_another_is_missing():
    problem, machine = healthy("cone45-centre-ccw", "rotary-a-tangential-ccw", "rotary-a-tangential-cw")
    known = registry.make("pitch_error.A", components=[[72.0, 0.002, 30.0]])
    hide(problem, machine, known.replaced(components=[[72.0, 0.002, 30.0], [180.0, 0.0006, -40.0]]))
    (found,) = BarSearch(Fitter(problem, machine.with_effect(known))).run(1).model.fit.effects
    waves = {round(order): (size, phase) for order, size, phase in found.effect.values["components"]}
    assert waves.keys() == {72, 180}
    assert waves[72] == pytest.approx((0.002, 30.0), rel=0.02)
    assert waves[180] == pytest.approx((0.0006, -40.0), rel=0.05)


def test_a_data_sheet_far_off_does_not_end_a_fit():
    """Linear columns may move a sheet so far that the drives are unstable; the fit starts from the printed one."""
    campaign = read_campaign(examples() / "healthy")
    campaign = dataclasses.replace(campaign, tests=tuple(t for t in campaign.tests if t.name == "circle-xy-ccw"))
    machine = read_machine(campaign.machine_file)
    fitter = Fitter(trusted_problem(campaign, machine, 2), machine)
    near = fitter.fit([], iterations=0)
    wild = dataclasses.replace(
        near, sheet_deviation=np.where(np.arange(len(near.sheet_deviation)) % 7 == 2, -57.0, 20.0)
    )
    readings = fitter.problem.readings(build(wild.machine))
    assert not all(np.isfinite(r).all() for r in readings) or max(np.abs(r).max() for r in readings) > 1.0
    fit = fitter.fit([], start=wild, iterations=0, fresh=False)
    assert np.isfinite(fit.objective) and np.isfinite(fit.step).all() and np.abs(fit.sheet_deviation).max() < 10.0


def test_a_wave_of_order_1_stands_in_the_place_of_a_windup():
    """The wind-up by an unbalance is a sine of A, and so is the eccentricity of its wheel: nothing tells them apart."""
    campaign = read_campaign(examples() / "healthy")
    names = ("cone45-centre-ccw", "rotary-a-tangential-ccw", "rotary-a-tangential-cw")
    campaign = dataclasses.replace(campaign, tests=tuple(t for t in campaign.tests if t.name in names))
    machine = read_machine(campaign.machine_file)
    problem = trusted_problem(campaign, machine, 2)
    fitter = Fitter(problem, machine)
    pitch = registry.make("pitch_error.A", components=[[72.0, 0.0005, 30.0]])
    windup = registry.make("gravity_windup.A", amplitude_deg=0.0003, phase_deg=40.0)
    mine = EffectVector(windup, windup.search.free_of(windup.parameters_of("A")))
    hide(problem, machine, windup)
    beside = EffectVector(pitch, ("components",))
    without = fitter.fit([beside], exact=False, iterations=1)
    bank = SignatureBank(problem, without)

    def first_orders(fit):
        waves = [r for r in spectral_candidates(problem, fit, bank, "A") if r[0].id == "pitch_error.A"]
        return [w for c, w in waves if c.effect.values["components"][0][0] == 1.0]

    (wave,) = first_orders(without)
    gain, x = Projector(without).gain(wave)
    other = Candidate(windup, mine.names)
    same, y = Projector(without).gain(problem.whiten(bank.columns(other)))
    assert gain == pytest.approx(same, rel=1e-3)
    assert np.hypot(*x) == pytest.approx(np.hypot(*y), rel=1e-3)
    assert first_orders(fitter.fit([], exact=False, iterations=1)) == []


@pytest.mark.parametrize(
    ("hidden", "told", "wrong"),
    [
        (registry.make("velocity_feedforward.X", ratio=0.08), "velocity_feedforward.X", "servo_gain.X"),
        (registry.make("velocity_feedforward.X", ratio=0.012), "servo_gain.X", "friction.X"),
        (registry.make("servo_delay.X", delay_ms=1.8), "servo_delay.X", "velocity_feedforward.X"),
    ],
)
def test_a_small_feedforward_stands_for_an_early_command_and_not_for_a_late_one(hidden, told, wrong):
    """A late command would be a feedforward below zero, which nobody sets. Nor does anybody set one of 1 %: a gain or a
    delay fits as well, and they have most of the probability.
    """
    problem, machine = healthy("circle-xy-ccw", "circle-xy-cw", "circle-yz-ccw", "cone15-parallel-ccw")
    hide(problem, machine, hidden)
    (found,) = explain(separate(problem, machine), most=1).selection.found
    said = {found.key, *found.alternatives}
    assert told in said and wrong not in said


@pytest.mark.parametrize(
    ("hidden", "tests"),
    [
        (
            registry.make("servo_delay.Z", delay_ms=45.0),
            ("cone45-centre-ccw", "rotary-a-tangential-ccw", "rotary-a-tangential-cw"),
        ),
        (registry.make("servo_delay.Y", delay_ms=30.0), ("cone45-centre-ccw", "circle-xy-ccw")),
    ],
)
def test_an_axis_that_is_very_late_is_found_whatever_the_position_gains_say(hidden, tests):
    """Such a lag drives the gains of other axes to their bounds, where no normal matrix may fail."""
    problem, machine = healthy(*tests)
    hide(problem, machine, hidden)
    selection = explain(separate(problem, machine), most=1).selection
    (found,) = selection.found
    assert found.key == hidden.key and found.probability > 0.99
    effect = next(f.effect for f in selection.fit.effects if f.effect.key == hidden.key)
    assert effect.values["delay_ms"] == pytest.approx(hidden.values["delay_ms"], abs=0.5)


def test_a_fit_that_begins_far_away_ends_where_one_from_the_truth_does():
    """What it leaves falls from a million times the noise to the noise, and priors count less with each step."""
    problem, machine = healthy("cone45-centre-ccw", "circle-xy-ccw")
    hide(problem, machine, registry.make("servo_delay.Y", delay_ms=30.0))
    problem = separate(problem, machine).problem
    near, far = (registry.make("servo_delay.Y", delay_ms=ms) for ms in (30.0, 5.0))
    near, far = (
        Fitter(problem, machine).fit([EffectVector(e, ("delay_ms",))], iterations=12, exact=True) for e in (near, far)
    )
    assert far.objective == pytest.approx(near.objective, abs=0.5)
    assert far.effects[0].effect.values["delay_ms"] == pytest.approx(30.0, abs=0.001)


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


@pytest.mark.parametrize("true", [0.0, 2.0, 30.0])
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
    problem = trusted_problem(campaign, machine, 2)
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
    campaign = read_campaign(examples() / "healthy")
    machine = read_machine(campaign.machine_file)
    tests = tuple(t for t in campaign.tests if t.name in ("circle-xy-ccw", "cone15-x50-ccw", "cone15-parallel-ccw"))
    problem = trusted_problem(
        dataclasses.replace(campaign, tests=tests, traces={t.name: campaign.traces[t.name] for t in tests}),
        machine,
    )
    floating = []
    for s, m, sens in zip(problem.samples, problem.motions, problem.sensitivity, strict=True):
        speed = np.abs(np.gradient(m.commands[::5, 1], m.time[5]))
        floating.append(s.without(-s.sample_all(sens.axes[:, 0] * 2e-6 * np.sqrt(speed / 0.0167), 0.0)))
    problem = dataclasses.replace(problem, samples=tuple(floating))
    told = explain(separate(problem, machine)).unexplained
    assert told.axes == ("Y", "X") and told.variable == "velocity" and "X axis" in told.summary
    planted = np.sqrt(np.mean(np.concatenate([s.left_out for s in problem.samples]) ** 2))
    assert 0.1 * planted < told.rms < planted  # the set-up takes its share


def with_creep(machine, problem, *effects):
    """Tests of a machine with a creep after each reversal of X, by the independent generator, and further effects."""
    model = machines.nominal(machine.name)
    described = {t["name"]: t for t in tomllib.loads((examples() / "healthy" / "campaign.toml").read_text())["test"]}
    creep, more = (unlisted.ReversalCreep("X", 30.0),), machines.by_id([*model["effect"], *effects])
    creeping = []
    for s in problem.samples:
        of = described[s.test.name], model["drive"]
        has = simulate.reading(*of, more, s.time, unlisted=creep)
        creeping.append(s.without(simulate.reading(*of, machines.by_id(model["effect"]), s.time) - has))
    return dataclasses.replace(problem, samples=tuple(creeping))


def test_beside_an_unknown_cause_nothing_is_named_that_its_curve_may_be():
    """A creep after each reversal is neither play nor friction, and is one curve."""
    machine, problem = two_cones()
    found = explain(separate(with_creep(machine, problem), machine))
    assert (found.verdict, found.selection.found) == ("unknown", [])
    assert (found.unexplained.axes, found.unexplained.variable) == (("X",), "time_since_reversal")


def test_beside_an_unknown_cause_an_error_beyond_its_limit_is_named():
    """An axis of rotation that is off by twice its limit is no part of a creep."""
    machine, problem = two_cones()
    machine = dataclasses.replace(machine, tolerance={"axis_location": {"value_um": 12.0}})
    off = {"id": "axis_location.EY0C", "value_um": 24.0}
    found = explain(separate(with_creep(machine, problem, off), machine))
    (location,) = found.selection.found
    assert (location.key, found.verdict) == ("axis_location.EY0C", "identified") and location.probability > 0.99
    assert (found.unexplained.axes, found.unexplained.variable) == (("X",), "time_since_reversal")


def test_what_tests_leave_open_of_an_unknown_cause_is_told_with_its_probability():
    machine, problem = two_cones()
    fit = Fitter(problem, machine).fit([])
    position, speed = (
        next(t for t in CurveTerms(problem, fit).of("C", "C") if t.variable == v) for v in ("position", "velocity")
    )
    position.coefficients, position.precision = np.cos(position.knots), np.eye(len(position.knots))
    told = describe(problem, fit, position, 0.6, [(speed, 0.35)])
    assert (told.probability, told.alternatives) == (0.6, ((("C",), "velocity", 0.35),))
    assert (
        "60 % sure; these tests leave open that it acts on the C axis and depends on its velocity (35 %)"
        in told.summary
    )


def two_cones():
    """A sound machine, and two of its tests in which C goes round."""
    campaign = read_campaign(examples() / "healthy")
    machine = read_machine(campaign.machine_file)
    tests = tuple(t for t in campaign.tests if t.name in ("cone15-y50-ccw", "cone15-x50-ccw"))
    problem = trusted_problem(
        dataclasses.replace(campaign, tests=tests, traces={t.name: campaign.traces[t.name] for t in tests}),
        machine,
    )
    return machine, problem


@pytest.mark.parametrize("axis", ["X", "Y"])
def test_a_fit_that_begins_without_friction_finds_it(axis):
    """Next to none, the damping of the bristles is all that friction does, and a derivative there leads nowhere."""
    machine, problem = two_cones()
    friction = machine.effect(f"friction.{axis}")
    stated = EffectVector(friction, ("coulomb_Nm",)).vector
    none = EffectVector(friction.replaced(coulomb_Nm=0.0), ("coulomb_Nm",)).with_prior(stated, np.array([16.0]))
    fit = Fitter(problem, machine).fit([none], iterations=16)
    assert fit.effects[0].vector == pytest.approx(stated, rel=0.1)
    assert fit.sum_squares < 1.02 * Fitter(problem, machine).fit([]).sum_squares


@pytest.mark.parametrize("moves", ["X", "C", "table y", "table radial"])
def test_the_written_effect_does_what_its_term_did(moves, tmp_path):
    """The effect file of a term, simulated, changes the reading by what the term says."""
    from mjsim.effects.registry import load_file
    from mjsim.inference.curve_terms import CurveTerms, radial_curves
    from mjsim.inference.fit import Fitter
    from mjsim.inference.unexplained import effect_source

    machine, problem = two_cones()
    fit = Fitter(problem, machine).fit([])
    terms = CurveTerms(problem, fit)
    if moves == "table radial":
        (term,) = radial_curves(terms)
    else:
        term = next(t for t in terms.of("C", moves) if t.variable == "position" and t.period)
    values = 3.0 * np.cos(term.knots) * term.unit
    path = tmp_path / "own.py"
    path.write_text(effect_source(problem.chain, term, values, "A test.", "own.py"))
    own = load_file(path)("C", gain=1.0)
    changed = problem.difference(
        problem.readings(build(machine)), problem.readings(build(machine.with_effect(own))), fit.nuisance
    )
    for got, columns in zip(changed, term.columns, strict=True):
        want = columns @ (values / term.unit)
        assert np.std(want) > 0.2e-6
        assert np.abs(got - want).max() < 0.03 * np.abs(want).max() + 0.01e-6


@pytest.mark.parametrize(
    ("cause", "value"),
    [
        (unlisted.Crosstalk("X", 2.0, moves="Y"), lambda a: 2.0 * a / 0.010),
        (unlisted.SlideFloat("X", 3.0, moves="Y"), lambda v: 3.0 * np.sqrt(60.0 * np.abs(v))),
        (unlisted.ReversalCreep("X", 10.0), lambda since: 10.0 * np.exp(-(10.0**since))),
    ],
    ids=["acceleration", "velocity", "time since a reversal"],
)
def test_a_curve_follows_the_motion_that_the_machine_makes(cause, value):
    """A cause of the independent generator acts on what the drives do, and is a curve of that: their lag behind the
    command is no part of its shape. At a reversal the two may differ by the instant from which it counts.
    """
    machine, problem = two_cones()
    model = machines.nominal(machine.name)
    described = {t["name"]: t for t in tomllib.loads((examples() / "healthy" / "campaign.toml").read_text())["test"]}
    terms = CurveTerms(problem, Fitter(problem, machine).fit([]))
    coarse = next(t for t in terms.of(cause.axis, cause.moves or cause.axis) if t.variable == cause.variable[0])
    *_, term = terms.finer(coarse, 8 * len(coarse.knots))
    for k, (s, columns) in enumerate(zip(problem.samples, term.columns, strict=True)):
        of = described[s.test.name], model["drive"], machines.by_id(model["effect"])
        at = s.time - problem.shift(k, terms.fit.nuisance)
        want = s.average(simulate.reading(*of, at, unlisted=(cause,)) - simulate.reading(*of, at))
        calm = np.abs(terms.motions[k].velocity[:, terms.chain.index(cause.axis)]) > 1e-3
        assert np.std(want) > 0.2e-6
        assert np.std((columns @ value(term.knots) - want)[calm]) < 0.02 * np.std(want)


def with_an_oval_table(size):
    """The same machine and tests with a table that pushes the ball outwards twice per turn, µm."""
    from mjsim.inference.curve_terms import CurveTerms, radial_curves
    from mjsim.inference.fit import Fitter

    machine, problem = two_cones()
    (term,) = radial_curves(CurveTerms(problem, Fitter(problem, machine).fit([])))
    oval = size * np.cos(2.0 * term.knots - 0.5)
    samples = []
    for s, columns in zip(problem.samples, term.columns, strict=True):
        samples.append(s.without(-np.interp(s.time, s.centre, columns @ oval)))
    return machine, dataclasses.replace(problem, samples=tuple(samples))


def test_one_unknown_cause_stands_in_the_place_of_several_that_imitate_it():
    """Error motions of two orders and a pitch error do nearly what one oval table does."""
    from mjsim.inference.bar_search import BarSearch
    from mjsim.inference.fit import Fitter

    machine, problem = with_an_oval_table(3.0)
    found = BarSearch(Fitter(problem, machine)).run().model
    assert not found.fit.effects
    assert [(c.term.moves, c.prior) for c in found.curves] == [("table radial", "lobes")]


def test_an_oval_table_is_one_wave_along_the_radius():
    """Two waves per turn are explained best by two waves per turn, not by a curve of any shape."""
    from mjsim.inference.curve_terms import RADIAL
    from mjsim.inference.fit import Fitter
    from mjsim.inference.unknown_curves import best_curves

    machine, problem = with_an_oval_table(3.0)
    odds, best = best_curves(problem, Fitter(problem, machine).fit([]), problem)[0]
    assert (best.term.moves, best.prior) == (RADIAL, "lobes") and odds > 100.0
    waves = np.abs(np.fft.rfft(best.root, axis=0))
    assert waves.argmax(axis=0).tolist() == [2, 2]


def test_one_machine_may_have_several_unknown_causes(tmp_path):
    """Effect files of different axes, motions and variables are effects of different kinds."""
    from mjsim.effects.registry import load_file
    from mjsim.inference.curve_terms import CurveTerm
    from mjsim.inference.unexplained import effect_source

    kinds = set()
    terms = (("C", "C", "position"), ("X", "X", "position"), ("C", "Z", "position"), ("C", "C", "velocity"))
    for number, (axis, moves, variable) in enumerate(terms):
        term = CurveTerm(axis, moves, variable, np.array([-1.0, 1.0]), None, [])
        path = tmp_path / f"unknown{number}.py"
        path.write_text(effect_source(FIVE_AXIS, term, np.zeros(2), "A test.", path.name))
        kinds.add(load_file(path).kind)
    assert len(kinds) == len(terms)


@pytest.mark.parametrize(
    ("shape", "variable", "slopes", "beyond"),
    [
        ("bends", "acceleration", (2.0, 2.0), 2.0),  # straight: it goes on
        ("bends", "acceleration", (2.0, 1.0), 1.0),  # each end goes on as it is
        ("bends", "acceleration", (1.0, 0.0), 0.0),
        ("free", "acceleration", (2.0, 2.0), 0.0),
        ("bends", "time_since_reversal", (2.0, 2.0), 0.0),  # it has settled
    ],
)
def test_a_straight_end_of_a_curve_goes_on_beyond_what_was_measured(shape, variable, slopes, beyond, tmp_path):
    from mjsim.inference.curve_terms import CurveTerm
    from mjsim.inference.unexplained import effect_source

    knots, curve = np.array([-1.0, 0.0, 1.0]), np.array([-slopes[0], 0.0, slopes[1]])
    term = CurveTerm("X", "Y", variable, knots, None, [], coefficients=curve, shape=shape)
    file = {}
    source = effect_source(FIVE_AXIS, term, curve * term.unit, "A test.", "own.py")
    exec(source.partition("@mjsim.register")[0], file)

    def at(x):
        return np.interp(x, file["KNOTS"], file["VALUES"]) / term.unit

    assert [at(x) for x in (-1.0, 1.0)] == pytest.approx([-slopes[0], slopes[1]])
    assert at(3.0) - at(1.0) == pytest.approx(2.0 * beyond)
    assert at(-1.0) - at(-3.0) == pytest.approx(2.0 * slopes[0] * (shape == "bends" and variable == "acceleration"))


def test_a_short_bend_at_the_end_of_a_curve_does_not_go_on():
    from mjsim.inference.curve_terms import CurveTerm
    from mjsim.inference.unexplained import _continued

    knots, curve = np.linspace(-1.0, 1.0, 21), np.zeros(21)
    curve[-2:] = 1.0, 2.0
    term = CurveTerm("X", "Y", "velocity", knots, None, [], coefficients=curve, shape="bends")
    x, values = _continued(term, curve)
    assert x[-1] == 1.0 and values[-1] == 2.0
    assert x[0] < -5.0 and values[0] == pytest.approx(0.0, abs=1e-12)


def test_a_free_curve_is_bridged_where_no_test_goes():
    from mjsim.inference.curve_terms import CurveTerm
    from mjsim.inference.unexplained import bridged

    knots, values = np.arange(5.0), np.array([0.0, 4.0, 0.0, 8.0, 0.0])
    reached = np.array([False, True, False, True, False])
    term = CurveTerm("X", "X", "velocity", knots, None, [])
    assert bridged(term, values, reached).tolist() == [4.0, 4.0, 6.0, 8.0, 8.0]
    term.period = 5.0  # from the last place it goes round to the first
    assert bridged(term, values, reached) == pytest.approx([16.0 / 3, 4.0, 6.0, 8.0, 20.0 / 3])
    term.shape = "bends"
    assert np.array_equal(bridged(term, values, reached), values)


def test_a_ball_in_another_seat_has_a_length_of_its_own():
    """A knock moves the ball along the bar as well, by an amount that the jump alone does not tell exactly."""
    from mjsim.inference.nuisance import AFTER_KNOCK, Nuisances

    knocked = dataclasses.replace(CIRCLE, name="d", setup=f"d {AFTER_KNOCK}")
    n = Nuisances.of_tests([CIRCLE, knocked], 4.0)
    x = np.zeros(n.size)
    x[n.of_test(knocked)[6]] = 1.0
    assert n.length(x, knocked.setup) == pytest.approx(3e-6)
    assert n.length(x, CIRCLE.setup) == n.length(x) == 0.0
