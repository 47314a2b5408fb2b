"""A machine on which much is a little wrong: what its tolerance covers is calibrated, what lies beyond is a finding."""

import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from independent import campaign as generator
from independent import real_machines
from independent.layouts import layout

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.new import new_campaign
from mjsim.campaign.tolerance import TYPICAL_TOLERANCE, VOLUMETRIC_TOLERANCE
from mjsim.effects.friction import Friction
from mjsim.effects.torque_ripple import TorqueRipple
from mjsim.inference.bar_search import BarSearch
from mjsim.inference.budget import budgets, split_of_bars
from mjsim.inference.calibration import calibrated_effects, expected_effects
from mjsim.inference.combinations import combinations
from mjsim.inference.curve_terms import CurveTerms
from mjsim.inference.data_sheet import DATA_SHEET, calibrated, data_sheet
from mjsim.inference.discrepancy import Discrepancy, Sizes
from mjsim.inference.disturbances import without_disturbances
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.findings import _BarReader, explain
from mjsim.inference.fit import Fitter
from mjsim.inference.linearisation import Linearisation
from mjsim.inference.problem import KeptChanges, Problem
from mjsim.inference.search import _UNLIKELY, TOLD, Found, Model, names_to_tell
from mjsim.inference.signatures import SignatureBank, seeds
from mjsim.inference.spectrum import sides_of, spectral_candidates, wave
from mjsim.inference.unknown_curves import Curve, _BesideModel, priors_of
from mjsim.inference.vibration import Separated
from mjsim.machine.model import build
from mjsim.progress import silent


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """A short campaign of a real machine whose A axis has three times the play that its tolerance allows."""
    rng = np.random.default_rng(5)
    case = generator.Case(
        "real",
        "M1",
        tuple(layout("short")),
        ({"id": "backlash.A", "width_deg": 0.0024},),
        seed=7,
        within=tuple(real_machines.within("M1", rng)),
        tolerance_stated=True,
    )
    folder = tmp_path_factory.mktemp("real")
    generator.write_files(case, folder)
    campaign = read_campaign(folder)
    machine = read_machine(campaign.machine_file)
    problem = Problem.of(campaign, build(machine), threads=2)
    return case, problem, machine, explain(Separated(problem, machine, ()))


def test_a_curve_beside_a_model_is_that_of_columns_that_are_whitened_themselves(real):
    _, problem, machine, _ = real
    discrepancy = Discrepancy.of_tests(problem)
    factor = np.linspace(0.8, 1.3, len(problem.tests))
    white = replace(problem, whitening=discrepancy.whitening(Sizes(0.4e-6, 0.2e-6, factor)))
    fit = Fitter(white, machine).fit([], iterations=1)
    term = next(t for t in CurveTerms(problem, fit).own() if t.axis == "C" and t.variable == "position")
    columns = white.whiten(term.columns)
    cross = fit.design.T @ columns
    information, score = _BesideModel(white, fit).of(term)
    expected = columns.T @ columns - cross.T @ np.linalg.solve(fit.linear.precision, cross)
    np.testing.assert_allclose(information, expected, atol=1e-9 * np.abs(expected).max())
    expected = columns.T @ (fit.residual - fit.design @ fit.step)
    np.testing.assert_allclose(score, expected, atol=1e-9 * np.abs(expected).max())


def test_the_level_of_a_curve_is_not_held_for_its_size(real):
    """Set-up and locations can take up the level, which is then known badly; its shape is not."""
    _, problem, machine, _ = real
    white = replace(
        problem, whitening=Discrepancy.of_tests(problem).whitening(Sizes(0.4e-6, 0.2e-6, np.ones(len(problem.tests))))
    )
    search = BarSearch(Fitter(problem, machine))
    fit = search.fitter.with_problem(white).fit([], iterations=1)
    term = next(t for t in CurveTerms(problem, fit).own() if t.axis == "C" and t.variable == "position")
    root = next(root for name, root in priors_of(term) if name == "smooth")
    curve = Curve(term, "smooth", root, problem.whiten_sparse(term.columns.together()), 0.0, width=2.0)
    model = Model({}, fit, white, Sizes(0.4e-6, 0.2e-6, np.ones(len(problem.tests))), (curve,))
    ((_, (values, spread)),) = _BarReader(search, Found(fit, model, None), silent)._values(fit)
    columns = 2.0 * white.whiten([c @ root for c in term.columns])
    cross = fit.design.T @ columns
    information = columns.T @ columns - cross.T @ np.linalg.solve(fit.linear.precision, cross) + np.eye(root.shape[1])
    covariance = 4.0 * root @ np.linalg.solve(information, root.T)
    centred = np.eye(len(root)) - 1.0 / len(root)
    np.testing.assert_allclose(spread, np.sqrt(np.diag(centred @ covariance @ centred)), rtol=0.02)
    assert abs(values.mean()) < 1e-9 * np.abs(values).max()
    assert spread.max() < 0.6 * np.sqrt(np.diag(covariance)).min()


def test_what_lies_beyond_its_tolerance_is_the_finding(real):
    _, problem, _, joint = real
    assert [f.key for f in joint.selection.found] == ["backlash.A"]
    assert joint.unexplained is None and joint.verdict == "identified"
    fit = joint.selection.fit
    assert fit.sum_squares < 1.1 * problem.count
    free = next(f for f in fit.effects if f.effect.key == "backlash.A")
    low, high = free.interval(free.vector, fit.covariance_of(free))["width_deg"]
    assert low < 0.0024 < high


def test_what_is_beyond_its_tolerance_is_proposed_before_all_else(real):
    """Beside the machine of its class, whose play is held by its prior, the linear problem asks for more play."""
    _, problem, machine, _ = real
    search = BarSearch(Fitter(problem, machine))
    model = search._begun(calibrated_effects(machine))
    hypotheses = search._hypotheses(model, curves=False)
    odds, _ = hypotheses.linear.odds({})
    best = hypotheses.all[int(np.argmax(odds))]
    assert best.name == "backlash.A" and best.beyond is not None
    # and of no effect does it ask for more where the data hold it inside
    excess = {h.name: o for h, o in zip(hypotheses.all, odds, strict=True) if h.beyond is not None}
    assert len(excess) > 25 and sum(o > 0.0 for o in excess.values()) <= 2


def test_hypotheses_stand_beside_the_residual_of_the_fit(real):
    """Sizes that a model has got since do not change what its fit leaves; at the sizes of the fit, the linear problem
    has the evidence of the model.
    """
    _, problem, machine, _ = real
    search = BarSearch(Fitter(problem, machine))
    fit = search.fitter.fit([], exact=False)
    usual = search.discrepancy.usual.without_common()
    loud = replace(usual, slow=0.4e-6, fast=0.2e-6, factor=np.linspace(1.0, 3.0, len(problem.tests)))
    model = search._tuned(Model({}, fit, problem, loud))
    sizes = [model.sizes]
    expected = search._beside(model, sizes, curves=False)
    got = search._beside(replace(model, base=search.base_of(loud, ())), sizes, curves=False)
    assert got.levels[0][0] == expected.levels[0][0]
    np.testing.assert_array_equal(got.linear.score, expected.linear.score)
    assert expected.levels[0][0] == pytest.approx(model.evidence, abs=5.0)


def as_its_file_says(folder, *hidden):
    """A short campaign of a machine that is as its file says but for what is hidden, and that file."""
    generator.write_files(generator.Case("few", "M1", tuple(layout("short"))[:4], hidden, seed=3), folder)
    campaign = read_campaign(folder)
    return campaign, read_machine(campaign.machine_file)


def test_a_machine_as_its_file_says_has_no_small_errors(tmp_path):
    """Two causes on a machine that is otherwise as its file says: what a machine of its class may have besides is left
    out, and the evidence is larger without.
    """
    hidden = ({"id": "squareness.XY", "angle_urad": 20.0}, {"id": "backlash.X", "width_um": 1.5})
    campaign, machine = as_its_file_says(tmp_path, *hidden)
    problem = Problem.of(campaign, build(machine), threads=2)
    search = BarSearch(Fitter(problem, machine))
    usual = search._searched(search._begun(expected_effects(machine)))
    few = search._with_few(usual)
    assert {f.effect.id for f in few.fit.effects} == {"squareness.XY", "backlash.X"}
    assert few.evidence > usual.evidence + 20.0 and len(usual.fit.effects) > 30


def test_without_a_friction_the_data_sheet_is_as_uncertain_as_it_says(tmp_path):
    """A template says 1.7 times the friction that there is, within what is believed of it. A friction that was in the
    model could not be taken out any more: without it the sheet's number seemed to be certain.
    """
    campaign, machine = as_its_file_says(tmp_path)
    true = machine.effect("friction.X")
    stated = true.replaced(coulomb_Nm=1.7 * true.values["coulomb_Nm"])
    machine = replace(machine.with_effect(stated), factor=2.0)
    search = BarSearch(Fitter(Problem.of(campaign, build(machine), threads=2), machine))
    sound = search.of_effects([], {})
    model = search.of_effects([EffectVector(true, ("coulomb_Nm",))], {})
    odds = search.log_odds(model, "friction.X")
    assert model.evidence < sound.evidence and odds < 0.0
    assert odds == pytest.approx(model.evidence - sound.evidence, abs=3.0)


def test_a_ripple_is_there_though_its_torque_is_known_to_a_factor_only(tmp_path):
    """All torques of a drive times one factor give the same motion, so a template leaves the ripple's amplitude within
    that factor. In the linear problem other torques could take it away, which they cannot: nothing was found.
    """
    hidden = {"id": "torque_ripple.C", "amplitude_Nm": 0.4, "order": 1.0, "phase_deg": 40.0}
    campaign, machine = as_its_file_says(tmp_path, hidden)
    machine = replace(machine, factor=2.0)
    problem = Problem.of(campaign, build(machine), threads=2)
    found = explain(Separated(problem, machine, ()))
    (ripple,) = found.selection.found
    free = next(f for f in found.selection.fit.effects if f.effect.key == ripple.key)
    low, high = free.interval(free.vector, found.selection.fit.covariance_of(free))["amplitude_Nm"]
    assert found.verdict == "identified" and ripple.key == "torque_ripple.C" and ripple.probability > 0.99
    assert low < 0.4 < high and high - low > 0.1


def test_sums_are_determined_where_their_numbers_are_not(real):
    """The planted numbers add up to the sum, which is known several times better than each of them."""
    case, _, _, joint = real
    truth = {e["id"]: e for e in real_machines.with_causes(list(case.within), case.catalogue())}
    fit = joint.selection.fit
    widths = {}
    for f in fit.effects:
        for name, (low, high) in f.interval(f.vector, fit.covariance_of(f)).items():
            if name != "components":
                widths[f.effect.id, name] = high - low
    sums = combinations(fit)
    assert sums
    for c in sums:
        low, high = c.ci95
        planted = sum(t.factor * truth.get(t.effect_id, {}).get(t.name, 0.0) for t in c.terms)
        assert abs(planted - c.value) < 0.75 * (high - low)  # three standard deviations
        assert all(abs(t.factor) * widths[t.effect_id, t.name] > 2.0 * (high - low) for t in c.terms)


def test_small_errors_are_calibrated_with_honest_intervals(real):
    case, _, _, joint = real
    truth = {e["id"]: e for e in real_machines.with_causes(list(case.within), case.catalogue())}
    fit = joint.selection.fit
    inside = []
    for f in fit.effects:
        if f.effect.key not in {c.effect.effect.key for c in joint.calibration}:
            continue
        for name, (low, high) in f.interval(f.vector, fit.covariance_of(f)).items():
            if name == "components" or name == "phase_deg" or name not in truth.get(f.effect.id, {}):
                continue
            inside.append(low <= truth[f.effect.id][name] <= high)
    assert len(inside) > 25
    assert np.mean(inside) > 0.85


def reader_of(problem, machine, fit, curves=()):
    """A reader of a model with the tolerances of the machine."""
    search = BarSearch(Fitter(problem, machine))
    model = search._model_of(fit, {c.key: c for c in calibrated_effects(machine)})
    model = search._settled(replace(model, curves=tuple(curves)))
    return _BarReader(search, Found(model.fit, model, None), silent)


def test_what_a_bar_may_be_off_counts_for_what_is_beyond_a_limit(real):
    """One probability in the findings and in the table of the numbers against their limits."""
    _, _, machine, joint = real
    campaign = joint.data.campaign
    bars = {n: replace(bar, form=2e-6, gain_uncertainty=0.01) for n, bar in campaign.instruments.items()}
    problem = replace(joint.data, campaign=replace(campaign, instruments=bars))
    reader = reader_of(problem, machine, joint.selection.fit)
    fit = reader.model.fit
    uncertain = reader._fitted(fit, 0)
    sizes, alone = reader._sizes(uncertain), reader.of_class.sizes(fit)
    for b in budgets(uncertain, split_of_bars(reader.model.problem), reader.stated):
        if b.effect_id.startswith("axis_location"):
            assert sizes[b.effect_id] == pytest.approx(b.beyond, rel=1e-3)
    assert any(p > 2.0 * alone[key] for key, p in sizes.items() if key.startswith("axis_location"))


def test_a_curve_within_its_class_is_told_and_is_no_finding(real):
    _, _, machine, joint = real
    problem, fit = joint.data, joint.selection.fit
    term = next(t for t in CurveTerms(problem, fit).own() if t.axis == "C" and t.variable == "position")
    root = next(root for name, root in priors_of(term) if name == "smooth")
    curve = Curve(term, "smooth", root, problem.whiten_sparse(term.columns.together()), 0.0)
    reader = reader_of(problem, machine, fit, [curve.at(0.1, np.full(root.shape[1], 0.01))])
    unknown = reader._unknown(reader.model.fit)
    (small,) = unknown.further
    assert unknown.told is None and small.probability == unknown.probability < 0.01
    assert (small.axis, small.moves, small.variable) == ("C", "C", "position")
    assert small.limit == pytest.approx(0.0014 * np.pi / 180.0) and small.largest < small.limit
    assert "acts on the C axis and depends on its position: up to" in small.to_json()["summary"]


def test_derivatives_without_simulation_are_those_of_the_readings(real):
    _, problem, _, joint = real
    fit = joint.selection.fit
    linearisation = Linearisation(problem, fit.machine, fit.nuisance)
    base = problem.readings(build(fit.machine))
    for f in fit.effects:
        columns = linearisation.columns(f)
        if columns is None:
            continue
        effect, change = f.nudged(0, 0.02)
        nudged = fit.machine.effect(f.effect.key).replaced(**{n: effect.values[n] for n in f.names})
        moved = problem.readings(build(fit.machine.with_effect(nudged)))
        exact = problem.difference(base, moved, fit.nuisance)
        for cheap, full in zip(columns, exact, strict=True):
            # what is left out is of second order in the other effects
            rest = np.sqrt(np.mean((cheap[:, 0] - full / change) ** 2))
            assert rest < 0.01 * np.sqrt(np.mean((full / change) ** 2)) + 2e-9, f.effect.id


def test_derivatives_by_a_drive_are_kept_until_it_is_another_one(real):
    _, problem, _, joint = real
    fit = joint.selection.fit
    free = next(f for f in fit.effects if f.effect.key == "friction.X")

    def columns(share: float, problem: Problem = problem) -> np.ndarray:
        gain = fit.machine.drives["X"].velocity_gain
        machine = fit.machine.with_drive("X", velocity_gain=(1.0 + share) * gain)
        return np.vstack(Linearisation(problem, machine, fit.nuisance).columns(free))

    before = columns(0.0)
    assert (columns(1e-4) == before).all()
    fresh = columns(0.05, replace(problem, changes=KeptChanges()))
    assert (columns(0.05) == fresh).all()
    assert (fresh != before).any()


@pytest.mark.parametrize(
    ("effect", "size"),
    [
        (TorqueRipple("X", amplitude_Nm=0.4, order=2.0), "amplitude_Nm"),
        (Friction("X", coulomb_Nm=4.0, presliding_rad=0.003), "coulomb_Nm"),
    ],
)
def test_the_data_sheet_acts_on_the_drives_as_they_are(effect, size, real):
    """What the velocity gain does is simulated with the ripple and the friction that the model has."""
    _, problem, machine, joint = real
    before = joint.selection.fit
    effects = [*(f for f in before.effects if f.effect.key != effect.key), EffectVector(effect, (size,))]
    fit = Fitter(problem, machine).fit(effects, start=before, iterations=0, exact=True, fresh=False)
    column = next(i for i, p in enumerate(data_sheet(machine.chain)) if p.label == "velocity_gain.X")
    moved = calibrated(fit.machine, 0.1 * np.eye(len(data_sheet(machine.chain)))[column])
    change = problem.difference(fit.readings, problem.readings(build(moved)), fit.nuisance)
    exact = problem.whiten(change) / 0.1
    found = fit.design.columns(fit.parameters[DATA_SHEET])[:, column]
    assert np.linalg.norm(found - exact) < 0.05 * np.linalg.norm(exact)


def test_a_signature_is_that_of_a_small_change_whatever_the_model_has(real):
    """An effect that the fit has put into the model and may take out again looks as it does beside the model."""
    _, problem, machine, joint = real
    delay = next(c for c in seeds(machine) if c.effect.id == "servo_delay.X")
    fit = joint.selection.fit
    late = EffectVector(delay.effect.replaced(delay_ms=-0.3), delay.names)
    with_delay = Fitter(problem, machine).fit([*fit.effects, late], start=fit, iterations=0, exact=False, fresh=False)
    without, beside = (SignatureBank(problem, f).columns(delay) for f in (fit, with_delay))
    for a, b in zip(without, beside, strict=True):
        assert np.allclose(a, b, atol=0.02 * np.abs(a).max() + 1e-12)


def test_a_knock_shows_once_the_waves_are_fitted(real):
    """A knock on the bar that is no higher than what the worm gear does all the time."""
    _, problem, machine, joint = real
    fit = joint.selection.fit
    samples = [s.copy() for s in problem.samples]
    k = len(samples) - 1
    since = samples[k].time - np.quantile(samples[k].time, 0.4)
    struck = samples[k].value + np.where(since < 0.0, 0.0, 8e-6 * np.exp(-since / 0.05) * np.cos(150.0 * since))
    samples[k].value, samples[k].mean = struck, samples[k].average(struck)
    knocked = problem.with_samples(samples, problem.tests, problem.outliers)
    assert not any(without_disturbances(knocked, problem.readings(build(machine))).outliers.values())
    seen = without_disturbances(knocked, fit.readings, fit.nuisance)
    assert [seen.outliers[t.name] for t in problem.tests] == [int(j == k) for j in range(len(problem.tests))]
    left_out = ~seen.samples[k].valid
    assert left_out[np.searchsorted(since, 0.0)] and left_out.sum() < 0.1 * len(left_out)
    assert without_disturbances(problem, fit.readings, fit.nuisance) is problem


def test_a_ripple_is_looked_for_at_the_orders_of_a_pitch_error(real):
    """Once a pitch error is fitted, the spectrum of the residual is blind at its orders."""
    _, problem, _, joint = real
    fit, bank = joint.selection.fit, joint.selection.bank
    orders = {row[0] for row in fit.machine.effect("pitch_error.X").values["components"]}
    waves = [c for c, _ in spectral_candidates(problem, fit, bank, "X") if c.effect.kind == "torque_ripple"]
    assert orders <= {c.effect.values["order"] for c in waves}


def finding_of(hidden, rows, folder):
    """The only finding on a real machine whose tolerance is stated, with its intervals."""
    within = tuple(e for e in real_machines.within("M1", np.random.default_rng(6)) if e["id"] != hidden["id"])
    tests = tuple({**t, "feed_mm_min": 6000.0} for t in rows if t["kind"] == "rotary")
    generator.write_files(
        generator.Case("real", "M1", tests, (hidden,), seed=8, within=within, tolerance_stated=True), folder
    )
    campaign = read_campaign(folder)
    machine = read_machine(campaign.machine_file)
    joint = explain(Separated(Problem.of(campaign, build(machine), threads=2), machine, ()))
    (found,) = (f for f in joint.selection.fit.effects if f.effect.key in {x.key for x in joint.selection.found})
    return found, found.interval(found.vector, joint.selection.fit.covariance_of(found))


def test_a_wave_is_added_to_those_of_its_pitch_error(real):
    """Its columns hold nothing of the waves that the model has."""
    _, problem, machine, joint = real
    fit = joint.selection.fit
    pitch = fit.machine.effect("pitch_error.A")
    assert all(size > 0.0 for _, size, _ in pitch.values["components"])

    def columns(bank):
        return bank.whitened([wave(pitch, 50.0)], [sides_of(bank, pitch, 50.0)])[0][1]

    beside, alone = columns(joint.selection.bank), columns(SignatureBank(problem, Fitter(problem, machine).fit([])))
    assert np.linalg.norm(beside - alone) < 0.05 * np.linalg.norm(alone)


def test_an_error_motion_of_another_order_is_the_finding(tmp_path):
    """A table that wobbles three times per turn, on a machine whose tolerance is calibrated for two."""
    hidden = {"id": "tilt_error_motion.C", "amplitude_urad": 30.0, "order": 3.0, "phase_deg": -40.0}
    found, intervals = finding_of(hidden, layout("table"), tmp_path)
    assert found.effect.id == "tilt_error_motion.C" and found.effect.values["order"] == 3.0
    low, high = intervals["amplitude_urad"]
    assert low < 30.0 < high


def test_a_worm_wheel_that_is_worn_on_one_flank_is_the_finding(tmp_path):
    """Neither pitch errors of one direction nor something unknown."""
    hidden = {"id": "worm_wear.A", "depth_deg": 0.004, "centre_deg": 33.0, "width_deg": 3.5, "direction": "CW"}
    found, intervals = finding_of(hidden, layout("cradle"), tmp_path)
    assert found.effect.key == "worm_wear.A[CW]"
    for name in ("depth_deg", "centre_deg", "width_deg"):
        low, high = intervals[name]
        assert low < hidden[name] < high


def test_a_large_servo_fault_is_the_finding(tmp_path):
    """The lag moves every mark, and triggers follow it into false minima; nothing linear shows the cause from there."""
    hidden = {"id": "velocity_feedforward.A", "ratio": 0.4}
    found, intervals = finding_of(hidden, layout("cradle"), tmp_path)
    assert found.effect.id == hidden["id"]
    low, high = intervals["ratio"]
    assert low < hidden["ratio"] < high


def test_every_kind_and_subject_of_the_table_is_calibrated(real):
    _, _, machine, _ = real
    keys = {c.key for c in calibrated_effects(machine)}
    chain = machine.chain
    assert {f"backlash.{a}" for a in chain.letters} <= keys
    assert {f"straightness.{name}" for name in chain.straightness} <= keys
    assert not any(k.startswith(("servo_gain", "worm_wear")) for k in keys)


def test_the_prior_of_a_wave_has_two_orders_per_tooth(real):
    _, _, machine, _ = real
    wave = next(c for c in calibrated_effects(machine) if c.key == "pitch_error.C")
    teeth = machine.drives["C"].gear
    assert [row[0] for row in wave.free.effect.values["components"]] == [teeth, 2 * teeth]
    assert wave.deviation == pytest.approx(np.full(4, 0.0007 / 0.001))


def test_a_machine_without_the_table_has_what_a_typical_one_has(real):
    _, _, machine, _ = real
    without = replace(machine, tolerance={})
    typical = replace(machine, tolerance=TYPICAL_TOLERANCE)
    assert not calibrated_effects(without)
    assert {c.key for c in expected_effects(without)} == {c.key for c in calibrated_effects(typical)}


def test_the_typical_table_is_the_one_of_a_new_campaign(tmp_path):
    new_campaign(tmp_path / "new")
    text = (tmp_path / "new" / "machine.toml").read_text(encoding="utf-8")
    table = text.split("# [tolerance]")[1].split("[drive.")[0]
    stated = "\n".join(line.removeprefix("# ") for line in table.splitlines())
    assert tomllib.loads(stated) == TYPICAL_TOLERANCE | VOLUMETRIC_TOLERANCE


def test_a_cause_has_no_share_of_what_is_not_told():
    """Of three explanations the third is too improbable to be told; the first has no more for it."""
    evidence = np.log([0.90, 0.07, 0.03])
    rivals = [(name, SimpleNamespace(evidence=e)) for name, e in zip("bc", evidence[1:], strict=True)]
    mine, told = names_to_tell(rivals, evidence[0], "a")
    assert mine == pytest.approx(0.90)
    assert {name: share for name, (share, _) in told.items()} == {"b": pytest.approx(0.07)}


def test_what_explains_the_data_as_well_is_told_whatever_its_size():
    """A size that makes no sense by itself costs less than would keep it from being told."""
    mine, told = names_to_tell([("odd", SimpleNamespace(evidence=-_UNLIKELY))], 0.0, "a")
    assert mine < TOLD and list(told) == ["odd"]
