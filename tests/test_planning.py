"""The next test: what can be reached, what a test would separate, and that a planned test decides."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import mjsim
from mjsim.campaign.files import read_campaign
from mjsim.cli.main import main
from mjsim.effects.registry import make
from mjsim.inference.discrepancy import USUAL, Sizes
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.noise import usual_noise
from mjsim.inference.planning.candidates import Reach, first_round, neighbours, reachable
from mjsim.inference.planning.next_test import lacking, typical, worth
from mjsim.inference.planning.separation import Explanation, Separation, Separator
from mjsim.inference.settings import PLAN
from mjsim.instruments.ball_bar.files import test_table
from mjsim.io.resources import examples

test_table.__test__ = False


def explained(machine, effect_id, **values):
    effect = make(effect_id, **values)
    return Explanation.of_priors(
        effect_id, machine, [EffectVector(effect, effect.search.free_of(effect.parameters_of(effect.subject)))]
    )


def test_a_test_as_a_table_reads_back(tmp_path):
    """Every kind of test: written as a table of campaign.toml and read again it is the same test."""
    import tomlkit

    for name in ("healthy", "two-candidates"):
        campaign = read_campaign(examples() / name, traces=False)
        tables = [{**test_table(t), "started_s": t.started} for t in campaign.tests]
        folder = tmp_path / name
        folder.mkdir()
        (folder / "campaign.toml").write_text(tomlkit.dumps({"name": "x", "test": tables}))
        back = read_campaign(folder, traces=False).tests
        for a, b in zip(campaign.tests, back, strict=True):
            for field in ("table_ball", "length", "feed", "half_apex", "inclination", "start", "stop"):
                assert getattr(a, field) == pytest.approx(getattr(b, field), rel=1e-8, abs=1e-12)
            for field in ("name", "kind", "sensitive", "plane", "axis", "direction", "revolutions", "setup", "started"):
                assert getattr(a, field) == getattr(b, field)


def test_out_of_reach_is_not_offered(cone, circle):
    assert reachable(cone(15, 10, (50, 0, 155), revolutions=2))
    assert not reachable(circle("XY", (900, 0, 155)))
    far = circle("XY", (900, 0, 155))
    assert Reach(far.chain, [circle("XY", (950, 0, 155))]).holds(far)  # the campaign has been there
    assert not reachable(cone(15, 10, (50, 0, 155), feed=60000.0))


def test_candidates_are_different_tests(cone):
    campaign = read_campaign(examples() / "healthy", traces=False)
    offered = [*first_round(campaign.tests), *neighbours(campaign.tests[0])]
    for some in (list(first_round(campaign.tests)), list(neighbours(campaign.tests[0]))):
        assert len({t.name for t in some}) == len(some)
    kinds = {
        (t.kind, t.axis if t.kind == "rotary" else t.plane if t.kind == "circular" else t.sensitive) for t in offered
    }
    assert kinds >= {("rotary", "A"), ("rotary", "C"), ("circular", "XY"), ("circular", "YZ"), ("circular", "ZX")}
    assert kinds >= {("cone_frustum", "perpendicular"), ("cone_frustum", "parallel")}


def test_the_same_explanation_is_not_separated(m1, circle):
    one = explained(m1, "squareness.XY", angle_urad=20.0)
    assert Separator(one, one, usual_noise()).of(circle("XY", (0, 0, 155), feed=3000.0)).deviance == 0.0


def test_two_scales_need_a_plane_that_tells_them_apart(m1, circle):
    """A scale of X looks like one of Y with the other sign in the XY plane, but for the bar's length; the ZX plane
    sees X alone.
    """
    x, y = explained(m1, "scale_error.X", ppm=40.0), explained(m1, "scale_error.Y", ppm=-40.0)
    separator = Separator(x, y, usual_noise())
    same, other = (separator.of(circle(plane, (0, 0, 155), feed=3000.0, revolutions=2)) for plane in ("XY", "ZX"))
    assert same.deviance < PLAN.decisive < 0.1 * other.deviance
    assert other.difference > 0.5e-6


def test_deviance_is_the_squared_distance_of_fixed_explanations(m1, circle):
    """With nothing left to adapt, the deviance is that of the difference in the noise's own metric."""
    test = circle("XY", (0, 0, 155), feed=3000.0)
    a, b = explained(m1, "squareness.XY", angle_urad=20.0), explained(m1, "squareness.XY", angle_urad=10.0)
    fixed = replace(b, covariance=b.covariance * 1e-12)
    separator = Separator(a, fixed, usual_noise())
    full = separator.of(test).deviance
    assert full > 0.0
    half = Separator(explained(m1, "squareness.XY", angle_urad=15.0), fixed, usual_noise()).of(test).deviance
    assert full == pytest.approx(4.0 * half, rel=0.02)
    assert Separator(a, b, usual_noise()).of(test).deviance < 0.01 * full  # free, it adapts


def test_an_error_of_the_class_adapts_no_more_than_the_campaign_left_open(m1, circle):
    """An effect that has the prior of its class and is known from the campaign beside one that is free."""
    test = circle("XY", (0, 0, 155), feed=3000.0)
    a, alone = explained(m1, "squareness.XY", angle_urad=20.0), explained(m1, "squareness.XY", angle_urad=10.0)
    full = Separator(a, replace(alone, covariance=alone.covariance * 1e-12), usual_noise()).of(test).deviance

    of_class = EffectVector(make("squareness.XY", angle_urad=10.0), ("angle_urad",), (np.zeros(1), np.ones(1)))
    free = EffectVector(make("friction.A", coulomb_Nm=0.3), ("coulomb_Nm",))
    b = Explanation.of_priors("friction.A", m1, [of_class, free])
    known = np.ones(len(b.covariance))
    known[b.parameters.places(of_class.block.name)] = 1e-6
    b = replace(b, covariance=b.covariance * np.outer(known, known))
    # the set-up, the data sheet and the friction are free in one of the two only: they take little of a squareness
    assert Separator(a, b, usual_noise()).of(test).deviance > 0.5 * full


def test_what_a_model_has_is_no_news(m1):
    """A test that shall make an effect show is looked at with more of it than the model has."""
    stated, more = m1.effect("friction.C"), lacking("friction.C", m1).effect
    (size,) = (p.scale for p in stated.parameters_of("C") if p.name == "coulomb_Nm")
    assert more.values["coulomb_Nm"] == pytest.approx(stated.values["coulomb_Nm"] + size)
    assert more.values["presliding_rad"] == stated.values["presliding_rad"]
    assert lacking("backlash.C", m1).effect.values == typical("backlash.C", m1.chain).effect.values


def test_what_no_model_has_hides_a_small_difference(m1, circle):
    """A wave of 0.07 µm is seen in the noise, and lost beside what an ordinary machine leaves."""
    test = circle("XY", (0, 0, 155), feed=3000.0)
    a, b = explained(m1, "squareness.XY", angle_urad=20.0), explained(m1, "squareness.XY", angle_urad=10.0)
    fixed = replace(b, covariance=b.covariance * 1e-12)

    def deviance(left, truth=a):
        return Separator(truth, fixed, usual_noise(), left=left).of(test).deviance

    full, one = deviance(None), np.ones(1)
    assert deviance(Sizes(0.0, 0.0, one)) == full
    assert deviance(Sizes(1e-9, 1e-9, one)) == pytest.approx(full, rel=0.01)
    small = explained(m1, "squareness.XY", angle_urad=11.0)
    usual = Sizes(USUAL, USUAL, one)
    assert deviance(usual, small) < 1.0 < deviance(None, small)
    assert Separator(a, b, usual_noise(), left=usual).most(test) >= deviance(usual) > 9.0


def test_no_test_does_more_than_with_its_set_up_alone_adapted(m1, circle, cone):
    """What a test is looked at for first is never less than what it would do."""
    a, b = explained(m1, "squareness.XY", angle_urad=20.0), explained(m1, "backlash.Y", width_um=4.0)
    separator = Separator(a, b, usual_noise())
    for test in (circle("XY", (0, 0, 155)), circle("ZX", (0, 0, 155)), cone(15, 10, (50, 0, 155))):
        assert separator.of(test).deviance <= separator.most(test) * (1.0 + 1e-9)


def test_short_decisive_tests_come_first(cone):
    short, long = cone(15, 10, (0, 0, 155), feed=4000.0), cone(15, 10, (0, 0, 155), feed=500.0, revolutions=2)
    rows = [
        Separation(long, 5000.0, 1e-6),
        Separation(short, 500.0, 1e-6),
        Separation(short, 0.5 * PLAN.decisive, 1e-6),
    ]
    assert sorted(rows, key=worth, reverse=True) == [rows[1], rows[0], rows[2]]


def test_unknown_or_equal_effects_are_refused():
    cases = (
        (("servo_gain.C", "servo_gain.Q"), "servo_gain exists for"),
        (("backlash.A", "backlash.A"), "two different effects"),
    )
    for pair, said in cases:
        result = CliRunner().invoke(main, ["plan", str(examples() / "healthy"), "--between", *pair])
        assert result.exit_code == 1 and said in result.stderr and not result.stdout


def test_nothing_may_be_named_first(monkeypatch, circle):
    """Without traces as with them: the plan makes the effect show."""
    made = Separation(circle("XY", (0, 0, 155)), 10 * PLAN.decisive, 1e-6)
    monkeypatch.setattr(
        "mjsim.inference.planning.next_test.choose", lambda separator, threads, progress, settings: ([made], 1)
    )
    campaign = replace(read_campaign(examples() / "healthy", traces=False), traces={})
    plan = mjsim.plan(campaign, mjsim.read_machine(campaign.machine_file), between=("nothing", "squareness.XY"))
    assert plan.between == ("squareness.XY", "nothing") and "makes squareness.XY show" in plan.reason


def test_the_planned_test_decides(fast_plans, tmp_path, monkeypatch):
    """C's backlash is a lag's twin where the table turns one way per test. The planned test, measured by the
    generator, names it. Slow feeds are left out of what may be planned: such tests take long to simulate.
    """
    monkeypatch.setattr("mjsim.inference.planning.candidates.FEEDS", (4000 / 60e3, 6000 / 60e3))
    import sys
    from pathlib import Path

    sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "scripts" / "proofs"))
    from plan_proof import prove

    first, second = prove("backlash.C", tmp_path, lambda text: None)
    assert first.verdict == "ambiguous"
    assert {"backlash.C", "servo_delay.C"} <= {first.effects[0].effect.id, *first.effects[0].alternatives}
    assert first.next_test["decides"] and first.next_test["difference_um"] > 0.1  # the noise of one sample
    assert json.dumps(first.next_test)
    assert second.verdict == "identified"
    assert [e.effect.id for e in second.effects] == ["backlash.C"]
    width = second.effects[0].effect.values["width_deg"]
    assert width == pytest.approx(0.002, rel=0.03)
