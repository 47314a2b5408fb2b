"""A worm wheel that is worn on one flank: what the effect is, and that the paper's deflection (section 3.1) is named
and removed.

The campaign is the independent generator's; the pitch errors of A and C are in the machine's file already, as if
identified before.
"""

from dataclasses import replace

import numpy as np
import pytest
from independent import campaign as generator
from independent import kato2013
from motions import load

import mjsim
from mjsim.campaign.machine_file import read_machine, write_machine
from mjsim.effects.registry import make
from mjsim.errors import InputError
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.model import build
from mjsim.simulation.axes import AxesMotion
from mjsim.simulation.multibody import simulate
from mjsim.simulation.transmission import transmit

DEG = np.pi / 180.0
SHAPE = {"depth_deg": 0.003, "centre_deg": 30.0, "width_deg": 4.0}
#: Feed of the cones, mm/min; the paper's own is a third of it.
QUICK = 3000.0
#: Those of the campaign's tests that pass the worn place, but for one.
TESTS = ("rotary-a-tangential-centre-ccw", "rotary-a-tangential-centre-cw", "cone15-centre-ccw", "cone15-x50-ccw")


# --- the effect ---


@pytest.fixture(scope="module")
def motion(cone):
    """A whole cone test: A goes up and down between 15° and 75° twice."""
    return AxesMotion(cone(45, 30, (60, 30, 155), feed=8000, revolutions=2))


@pytest.fixture(scope="module")
def motor(motion, m1):
    """The motors' own positions, with friction: what the transmission starts from."""
    return motion.load(build(m1))


def dent(x, **shape):
    return shape["depth_deg"] * DEG * np.exp(-0.5 * ((x / DEG - shape["centre_deg"]) / shape["width_deg"]) ** 2)


def share(x, way):
    """How much of a one-way effect acts along the travel ``x`` rad: it comes and goes over 0.05°."""
    out = np.zeros(len(x))
    for i in range(1, len(x)):
        out[i] = np.clip(out[i - 1] + way * (x[i] - x[i - 1]) / (0.05 * DEG), 0.0, 1.0)
    return out


@pytest.mark.parametrize(("direction", "way"), [("CW", -1.0), ("CCW", 1.0)])
def test_one_flank_acts_one_way(motion, motor, m1, direction, way):
    x = motor[:, 3]
    got = load(motion, m1, make("worm_wear.A", **SHAPE, direction=direction))
    np.testing.assert_array_equal(np.delete(got, 3, axis=1), np.delete(motor, 3, axis=1))
    acts = share(x, way)
    np.testing.assert_allclose(got[:, 3], x - dent(x, **SHAPE) * acts, rtol=0, atol=1e-13)
    assert 0.3 < acts.mean() < 0.7 and np.ptp(got[acts == 0.0, 3] - x[acts == 0.0]) == 0.0


def test_two_flanks_make_a_whole_tooth(motion, motor, m1):
    """Equal wear of both flanks is wear without a direction, away from the reversals; unequal wear is felt as each
    flank carries.
    """
    x = motor[:, 3]
    equal = load(motion, m1, *(make("worm_wear.A", **SHAPE, direction=d) for d in ("CW", "CCW")))[:, 3]
    started = int(np.argmax(np.abs(x - x[0]) > 0.05 * DEG))
    plain = load(motion, m1, make("worm_wear.A", **SHAPE))[:, 3]
    np.testing.assert_allclose(equal[started:], plain[started:], rtol=0, atol=1e-14)
    other = {"depth_deg": -0.001, "centre_deg": 50.0, "width_deg": 2.0}
    both = load(
        motion, m1, make("worm_wear.A", **SHAPE, direction="CW"), make("worm_wear.A", **other, direction="CCW")
    )[:, 3]
    np.testing.assert_allclose(
        both, x - dent(x, **SHAPE) * share(x, -1.0) - dent(x, **other) * share(x, 1.0), rtol=0, atol=1e-13
    )


def test_without_a_direction_only_the_place_counts(motion, motor, m1):
    """The same motion backwards gives the same positions, to the last bit; with a worn flank it does not."""
    clock = np.zeros(len(motor))

    def there_and_back(**direction):
        ops = build(replace(m1, effects=(make("worm_wear.A", **SHAPE, **direction),))).op_table()
        return transmit(ops, motor, clock), transmit(ops, motor[::-1].copy(), clock)[::-1]

    np.testing.assert_array_equal(*there_and_back())
    there, back = there_and_back(direction="CW")
    assert np.abs(there - back).max() > 0.9 * 0.003 * DEG


def test_no_depth_is_no_wear(m1, bare, cone):
    machine, test = bare(m1), cone(15, 10, (60, 30, 155), feed=20000)
    effect = make("worm_wear.A", depth_deg=0.0, centre_deg=7.5, width_deg=1.5, direction="CW")
    assert effect.is_neutral and effect.key == "worm_wear.A[CW]"
    with_it, without = (simulate(m, [test])[0] for m in (machine.with_effect(effect), machine))
    np.testing.assert_array_equal(with_it.deviation, without.deviation)
    np.testing.assert_array_equal(with_it.position, without.position)


def test_machine_files_hold_one_wear_per_flank(m1, tmp_path):
    flanks = [
        make("worm_wear.A", **SHAPE, direction="CW"),
        make("worm_wear.A", **{**SHAPE, "depth_deg": 0.001}, direction="CCW"),
    ]
    path = tmp_path / "machine.toml"
    write_machine(m1.with_effect(flanks[0]).with_effect(flanks[1]), m1.path, path)
    worn = [e for e in read_machine(path).effects if e.kind == "worm_wear"]
    assert [e.values for e in worn] == [e.values for e in flanks]
    path.write_text(path.read_text().replace('direction = "CCW"', 'direction = "CW"'))
    with pytest.raises(InputError, match=r"worm_wear.A.*twice"):
        read_machine(path)
    with pytest.raises(InputError, match=r"direction = 'up'; allowed: .*CW"):
        make("worm_wear.A", **SHAPE, direction="up")


# --- the paper's deflection ---


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """``measured(name, *wear)``: campaign with that wear hidden in it, and the machine whose pitch errors are known.

    The cones are quicker than the paper's.
    """

    def measure(name, *wear):
        case = kato2013.case()
        tests = tuple(
            {**t, "feed_mm_min": QUICK} if t["kind"] == "cone_frustum" else t for t in case.tests if t["name"] in TESTS
        )
        assert len(tests) == len(TESTS)
        folder = tmp_path_factory.mktemp(name)
        generator.write_files(replace(case, tests=tests, hidden=(*kato2013.pitch_effects(), *wear)), folder)
        machine = read_machine(folder / "machine.toml")
        for e in kato2013.pitch_effects():
            machine = machine.with_effect(make(e["id"], **{k: v for k, v in e.items() if k != "id"}))
        write_machine(machine, folder / "machine.toml", folder / "machine.toml", force=True)
        return mjsim.read_campaign(folder), read_machine(folder / "machine.toml")

    return measure


def deflection(comparison, name, low, high):
    """Mean residual between two angles of the paper's plots, m, from the level of the whole test."""
    t = next(t for t in comparison.tests if t.test.name == name)
    angle = (np.degrees(t.phi) + 180.0) % 360.0
    return float(np.mean(t.residual[(angle > low) & (angle < high) & t.valid]) - np.median(t.residual[t.valid]))


def test_the_deflection_is_one_worn_flank_and_goes_with_it(measured):
    campaign, machine = measured("worn", kato2013.WEAR)
    result = mjsim.diagnose(campaign, machine)
    assert result.verdict == "identified"
    (found,) = result.effects
    true = kato2013.WEAR
    values = found.effect.values
    assert found.effect.id == "worm_wear.A" and values["direction"] == true["direction"] == "CW"
    assert abs(values["centre_deg"] - true["centre_deg"]) < 0.5
    assert values["depth_deg"] == pytest.approx(true["depth_deg"], rel=0.1)
    assert values["width_deg"] == pytest.approx(true["width_deg"], rel=0.1)
    assert set(found.ci95) == {"depth_deg", "centre_deg", "width_deg"}
    assert found.alternatives == () and result.unexplained is None
    assert "cone15-centre-ccw" in found.tests and "rotary-a-tangential-centre-ccw" not in found.tests
    assert not result.to_json()["left_out"]  # a test that passes the place once, quickly, shows a dent and no knock
    assert result.after.rms < 1.1 * result.noise < 0.2 * result.before.rms
    # and with the effect in the machine file
    change = mjsim.add(campaign, "worm_wear.A")
    for name in ("cone15-centre-ccw", "cone15-x50-ccw"):
        before, after = (deflection(c, name, 147, 163) for c in (change.before, change.after))
        assert before < -3e-6  # inward
        assert abs(after) < 0.2e-6
        assert abs(deflection(change.before, name, 197, 213)) < 0.2 * abs(
            before
        )  # not mirrored: it is no matter of the place alone
    worn = [e for e in read_machine(campaign.machine_file).effects if e.kind == "worm_wear"]
    assert [e.values["direction"] for e in worn] == ["CW"]
    assert change.after.rms < 1.5 * result.noise  # the drives' own departures from their data sheet are left


@pytest.mark.slow
def test_flanks_worn_differently_at_one_place(measured):
    """Wear of both and the difference of one: nothing else, and each way the depth that was hidden."""
    deep, shallow = kato2013.WEAR, {**kato2013.WEAR, "direction": "CCW", "depth_deg": -0.002}
    effects = [e.effect for e in mjsim.diagnose(*measured("unequal", deep, shallow)).effects]
    assert {e.id for e in effects} == {"worm_wear.A"} and len(effects) == 2
    assert sorted("direction" in e.values for e in effects) == [False, True]
    for true, way in ((deep, -1.0), (shallow, 1.0)):
        depth = sum(e.values["depth_deg"] for e in effects if e.direction_sign(FIVE_AXIS) in (0.0, way))
        assert depth == pytest.approx(true["depth_deg"], rel=0.1)


def test_a_new_table_shows_nothing(measured):
    assert kato2013.case(worn=False).hidden == kato2013.pitch_effects()
    result = mjsim.diagnose(*measured("new"))
    assert result.verdict == "nothing_found" and result.effects == () and result.unexplained is None
