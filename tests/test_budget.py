"""Errors of the instrument, and where the uncertainty of a number comes from."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from commands import cut

import mjsim
from mjsim.cli.compare import show_conformity
from mjsim.effects.registry import kinds, make
from mjsim.inference.at_rest import RestFitter, RestProblem, split_at_rest
from mjsim.inference.budget import Budget, _numbers, budgets, split_of_bars, split_rows
from mjsim.inference.considered import harmonics, moves_of_models, with_instrument
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fitter
from mjsim.inference.parameters import Block, Parameters
from mjsim.inference.posterior import beyond
from mjsim.inference.problem import Problem
from mjsim.inference.whitening import Whitening, shrinkage
from mjsim.instruments.ball_bar.measurement import BallBarData, Trace
from mjsim.instruments.sphere.instrument import LOBES
from mjsim.machine.model import build
from mjsim.units import UM
from tests.independent import sphere

#: Angles of C, rad, at the four points.
ANGLES = (0.0, math.pi / 3.0, 2.0 * math.pi / 3.0, math.pi)


def test_forms_have_the_same_variance_in_every_direction():
    rng = np.random.default_rng(1)
    unit = rng.normal(size=(200, 3))
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    forms = harmonics(unit)
    assert (forms[:, :5] ** 2).sum(axis=1) == pytest.approx(1.0)
    assert (forms[:, 5:] ** 2).sum(axis=1) == pytest.approx(1.0)
    assert harmonics(-unit)[:, :5] == pytest.approx(forms[:, :5])
    assert harmonics(-unit)[:, 5:] == pytest.approx(-forms[:, 5:])


def test_an_axis_from_four_points_has_the_budget_of_a_hand_calculation(tmp_path):
    """The centre of C from points on half a turn: e + R s − p, with the centre e, the place s of the sphere on the
    table and the tip p of the probe, as complex numbers of X and Y. With S = Σ exp(iφ), the variance of e is
    σ² / (4 − |S|² / 4) with s to be found, σ² / 4 with s known, and that of p beside it.
    """
    noise, tip, tolerance = 2.0, 1.5, 40.0  # µm
    sphere.write(tmp_path, 1)
    (tmp_path / "traces" / "points.csv").write_text(
        "X_mm,Y_mm,Z_mm,A_deg,C_deg,dx_um,dy_um,dz_um\n"
        + "".join(f"{150 * math.cos(c):.6f},{-150 * math.sin(c):.6f},100,0,{math.degrees(c)},3,-2,1\n" for c in ANGLES)
    )
    (tmp_path / "campaign.toml").write_text(
        'name = "four points"\n[instrument]\nkind = "sphere"\n'
        f"repeatability_um = {noise}\nprobe_offset_um = {tip}\n"
        '[[test]]\nname = "c"\nkind = "sphere"\ntrace = "traces/points.csv"\nsphere_mm = [150.0, 0.0, 100.0]\n'
    )
    campaign = mjsim.read_campaign(tmp_path)
    machine = mjsim.read_machine(campaign.machine_file)
    problem = RestProblem.of(campaign)
    kind = kinds()["axis_location"]
    free = [EffectVector(kind(f"E{x}0C", value_um=0.0), ("value_um",)) for x in "XY"]
    typical = free[0].specs["value_um"].scale
    free = [f.with_prior(np.zeros(1), np.array([tolerance / typical])) for f in free]
    fit = RestFitter(problem, machine).fit(free)
    found, _ = budgets(fit, split_at_rest(problem), instruments=("touch probe",))

    def with_tolerance(variance):
        return 1.0 / (1.0 / variance + 1.0 / tolerance**2)

    harmonic = abs(np.exp(1j * np.array(ANGLES)).sum()) ** 2
    points, known = noise**2 / (4.0 - harmonic / 4.0), noise**2 / 4.0  # with the sphere to be found, and known
    off = tip**2 + (LOBES / UM) ** 2
    total = with_tolerance(points + off)
    assert found.standard == pytest.approx(math.sqrt(total), rel=0.01)
    weight = total / (points + off)  # of the points beside the tolerance
    assert found.rows["noise"] == pytest.approx(weight * math.sqrt(points), rel=0.01)
    assert found.rows["instrument"] == pytest.approx(math.sqrt(total - with_tolerance(points)), rel=0.01)
    assert found.rows["set_up"] == pytest.approx(math.sqrt(total - with_tolerance(known + off)), rel=0.01)
    assert found.rows["not_understood"] == found.rows["choice_of_model"] == 0.0
    assert found.rows["other_errors"] < 0.01 * found.standard
    assert found.largest == "instrument" and "certificate" in found.sentence


def test_noise_and_discrepancy_split_as_their_covariances_do():
    """The noise of an estimate is the square of its weights on the values, times their noise alone."""
    rng = np.random.default_rng(2)
    rows, factor = [slice(0, 4), slice(4, 7)], np.array([1.0, 1.5])
    parts, roots = [], []
    for at, louder in zip(rows, factor, strict=True):
        n = at.stop - at.start
        shrink, vectors, _ = shrinkage((square := rng.normal(size=(n, n))) @ square.T / louder**2)
        parts.append((vectors, shrink))
        roots.append(louder * (np.eye(n) + vectors @ np.diag(shrink / (1.0 - shrink)) @ vectors.T))
    weights = rng.normal(size=7)
    split = list(split_rows(Whitening(factor, tuple(parts)), rows, weights))
    for (noise, beside), at, root, louder in zip(split, rows, roots, factor, strict=True):
        on_values = np.linalg.solve(root.T, weights[at])
        assert noise == pytest.approx(louder**2 * on_values @ on_values)
        assert noise + beside == pytest.approx(weights[at] @ weights[at]) and beside > 0.0


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    """A fit of the hidden backlash to one test, and its problem by what the certificate of the bar says."""
    campaign = mjsim.read_campaign(cut(tmp_path_factory.mktemp("worn") / "campaign"))
    machine = mjsim.read_machine(campaign.machine_file)
    problem = Problem.of(campaign, build(machine))
    free = EffectVector(kinds()["backlash"]("A", width_deg=0.002), ("width_deg",))
    fit = Fitter(problem, machine).fit([free.with_prior(np.zeros(1), np.ones(1))])

    def certified(**stated):
        bar = replace(campaign.instrument, **{"gain_uncertainty": 0.0, "form": 0.0, "hysteresis": 0.0} | stated)
        return replace(problem, campaign=replace(campaign, instruments={"ball_bar": bar})), fit

    return certified


def test_no_number_is_better_known_than_the_instrument_allows(worn):
    """The estimate stays. What the certificate states is in its row, and a gain error is one of every number."""
    problem, fit = worn()
    exact = with_instrument(problem, fit)
    assert exact.covariance == pytest.approx(fit.covariance)
    problem, fit = worn(gain_uncertainty=0.002)
    known = budgets(with_instrument(problem, fit), split_of_bars(problem))[0]
    plain = budgets(exact, split_of_bars(problem))[0]
    assert known.value == plain.value == fit.effects[0].effect.values["width_deg"]
    assert known.rows["instrument"] == pytest.approx(0.001 * known.value, rel=0.1)
    assert known.standard**2 == pytest.approx(plain.standard**2 + known.rows["instrument"] ** 2, rel=1e-3)
    assert known.rows["noise"] == pytest.approx(plain.rows["noise"])
    usual = budgets(
        with_instrument(*worn(gain_uncertainty=3e-3, form=0.7e-6, hysteresis=0.1e-6)), split_of_bars(problem)
    )[0]
    assert usual.largest == "instrument" and usual.standard > 1.5 * plain.standard
    # what the readings show of the instrument themselves is not uncertain
    loose = budgets(with_instrument(*worn(hysteresis=10e-6)), split_of_bars(problem))[0]
    assert loose.rows["instrument"] < 10.0 * plain.standard


def test_the_known_errors_of_a_bar_are_taken_off():
    bar = BallBarData(gain=0.01, temperature=25.0, expansion=12e-6)
    trace = Trace(np.zeros(1), np.array([101e-6]), np.ones(1, bool))
    assert bar.corrected(trace, 0.1).deviation == pytest.approx(100e-6 + 0.1 * 12e-6 * 5.0)
    assert BallBarData().corrected(trace, 0.1) is trace
    assert "no certificate" in bar.source and BallBarData(certificate="K 17").source == "K 17"


def test_other_models_widen_what_is_known():
    """A number that is 1 or 3 with the same probability has the variance of its model and 1."""
    one = Parameters((Block.normal("a", ["x"]), Block.normal("only here", ["y"])))
    other = Parameters((Block.normal("a", ["x"]),))
    fit = SimpleNamespace(parameters=one, vector=np.array([1.0, 5.0]), considered={}, effects=())
    rival = SimpleNamespace(fit=SimpleNamespace(parameters=other, vector=np.array([3.0]), effects=()), evidence=-7.0)
    moves = moves_of_models(fit, {"cause": [("another", rival)]}, -7.0)
    assert moves @ moves.T == pytest.approx(np.diag([1.0, 0.0]))
    rival.evidence = -70.0
    assert moves_of_models(fit, {"cause": [("another", rival)]}, -7.0).size == 0


@pytest.mark.parametrize(("off", "sd", "chance"), [(0.0, 0.5, 0.0455), (1.0, 1e-3, 0.5), (3.0, 1.0, 0.9773)])
def test_the_probability_of_conformity_is_that_of_the_normal_distribution(off, sd, chance):
    assert beyond(np.array([off]), np.array([[sd**2]]), 1.0) == pytest.approx(chance, abs=1e-4)


def test_numbers_are_told_against_their_limits(capsys):
    def known(effect, chance):
        return Budget(effect, "width_um", "µm", 1.0, 0.1, {"noise": 0.1}, 0.0, 1.0, chance).to_json()

    rows = [known("backlash.X", 0.01), known("backlash.Y", 0.99), known("backlash.Z", 0.4), known("friction.X", None)]
    show_conformity(rows)
    said = " ".join(capsys.readouterr().out.split())
    assert "Of 3 numbers with a limit, 1 lie within it" in said
    assert "1 beyond: backlash.Y width_um (99 %); 1 open: backlash.Z width_um (40 %)" in said
    show_conformity(rows[3:])
    assert capsys.readouterr().out == ""


def test_an_infinite_stiffness_has_no_row():
    """Off is infinite for the file and zero for the fit: there is no uncertainty in N/µm. A finite one has one."""
    names = ("stiffness_N_per_um", "damping_ratio")
    rows = {
        size: [row[0] for row in _numbers(EffectVector(make("drive_compliance.X", stiffness_N_per_um=size), names))]
        for size in (np.inf, 100.0)
    }
    assert rows == {np.inf: ["damping_ratio"], 100.0: list(names)}
