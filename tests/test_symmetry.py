"""What must not change when the world is mirrored, shifted in time, renamed or told in another order."""

from dataclasses import replace

import numpy as np
import pytest

import mjsim
from mjsim.campaign.files import read_campaign
from mjsim.effects.registry import make
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS
from mjsim.simulation.multibody import simulate

FEED = 6000.0
NM = 1e-9


def equipped(machine, hand):
    """Effects on every stage; ``hand`` = −1 are those of the machine's image in a mirror that turns X over (and C
    to 180° − C).
    """
    for effect in (
        make("servo_gain.C", ratio=1.03),
        make("servo_delay.Y", delay_ms=0.7),
        make("backlash.X", width_um=3.0),
        make("backlash.A", width_deg=0.002),
        make("backlash.C", width_deg=0.002),
        make("pitch_error.X", components=[[1, 2.0, hand * 35.0]]),
        make("pitch_error.C", components=[[72, 2e-3, hand * 20.0], [7, 1e-3, 50.0 if hand > 0 else 130.0]]),
        make("pitch_error.A", components=[[60, 1e-3, 10.0]]),
        make("gravity_windup.A", amplitude_deg=1e-3, phase_deg=10.0),
        make("scale_error.X", ppm=40.0),
        make("squareness.XY", angle_urad=hand * 40.0),
        make("squareness.YZ", angle_urad=25.0),
        make("squareness.ZX", angle_urad=hand * 15.0),
        make("straightness.EYX", quadratic_um=3.0, cubic_um=hand * 2.0),
        make("straightness.EXY", quadratic_um=hand * 3.0, cubic_um=hand * -2.0),
        make("thermal_drift.X", amplitude_um=hand * 8.0, time_constant_s=60.0),
        make("axis_location.EX0C", value_um=hand * 30.0),
        make("axis_location.EY0A", value_um=20.0),
        make("axis_location.EB0A", value_urad=hand * -50.0),
    ):  # fmt: skip
        machine = machine.with_effect(effect)
    return machine


@pytest.mark.parametrize(
    "theta, beta, sensitive", [(15, 10, "perpendicular"), (45, 30, "parallel"), (10, 25, "perpendicular")]
)
def test_a_cone_and_its_image(machine, bare, cone, theta, beta, sensitive):
    """Y of the ball and the direction turned over: X and C run the other way, A, Y, Z the same, and the reading
    stays, friction and all.
    """
    one, other = (
        cone(theta, beta, (40, hand * 30, 155), FEED, name=f"{hand}", direction=way, sensitive=sensitive, started=20.0)
        for hand, way in ((1, "CCW"), (-1, "CW"))
    )
    for build_up in (lambda m, hand: bare(m), lambda m, hand: m, equipped):
        (a,), (b,) = simulate(build_up(machine, 1), [one]), simulate(build_up(machine, -1), [other])
        np.testing.assert_allclose(
            np.diff(b.command, axis=0), np.diff(a.command, axis=0) * [-1, 1, 1, 1, -1], atol=1e-13
        )
        assert np.ptp(a.deviation) > 3e-6
        assert np.abs(a.deviation - b.deviation).max() < 1e-3 * NM


def test_a_direction_that_matters_is_seen(machine, cone):
    """The same pair with an effect of one hand only: the image test has no blind eye."""
    one = cone(15, 10, (40, 30, 155), FEED, direction="CCW")
    other = cone(15, 10, (40, -30, 155), FEED, direction="CW")
    for effect in (
        make("squareness.XY", angle_urad=20.0),
        make("pitch_error.A", components=[[60, 1e-3, 0.0]], direction="CCW"),
    ):
        a, b = (simulate(machine.with_effect(effect), [t])[0] for t in (one, other))
        same = effect.id != "squareness.XY"  # A runs the same way in both
        assert (np.abs(a.deviation - b.deviation).max() < 1e-3 * NM) == same


def test_circles_and_turns_and_their_images(machine, circle, turn):
    """Both directions of a circle, and of a turn of C with its ball on the other side, are each other's images."""
    for effect in (
        make("servo_gain.X", ratio=1.05),
        make("backlash.Y", width_um=3.0),
        make("backlash.C", width_deg=0.002),
    ):
        machine = machine.with_effect(effect)
    circles = (circle("XY", (10, hand * 30, 155), FEED, direction=way) for hand, way in ((1, "CCW"), (-1, "CW")))
    turns = (turn("C", hand * 20, hand * 200, (80, hand * 60, 155), "radial", FEED) for hand in (1, -1))
    for pair in (circles, turns):
        a, b = (simulate(machine, [t])[0].deviation for t in pair)
        assert np.ptp(a) > 3e-6 and np.abs(a - b).max() < 1e-3 * NM


def test_x_and_y_of_a_machine_that_has_them_alike(m1, circle):
    """X and Y with the same drives change places: a circle's reading is turned over at 45°, once the start has died
    out.
    """
    y = m1.drives["Y"]
    alike = replace(m1, drives={**m1.drives, "X": replace(y, axis="X")})
    friction = m1.effect("friction.Y").values
    alike = alike.with_effect(make("friction.X", **friction))
    one = alike.with_effect(make("backlash.X", width_um=4.0)).with_effect(make("scale_error.Y", ppm=30.0))
    other = alike.with_effect(make("backlash.Y", width_um=4.0)).with_effect(make("scale_error.X", ppm=30.0))
    a = simulate(one, [circle("XY", (0, 0, 155), FEED, revolutions=3)])[0]
    b = simulate(other, [circle("XY", (0, 0, 155), FEED, revolutions=3, direction="CW")])[0]
    angle = np.radians(np.arange(400.0, 700.0, 0.25))
    first = np.interp(angle, a.phi, a.deviation)
    second = np.interp((np.pi / 2 - angle) - 2 * np.pi, b.phi[::-1], b.deviation[::-1])
    away = np.abs(first - second)
    assert np.ptp(first) > 5e-6
    assert (
        np.quantile(away, 0.95) < 0.1 * NM and away.max() < 30 * NM
    )  # the turns of an axis fall between other milliseconds


# -- time --------------------------------------------------------------------------------------------------------------


def test_when_a_test_begins_does_not_matter(m1, cone):
    """Without effects of the clock bit for bit; with a drift it is the drift's own difference."""
    early, late = (cone(15, 10, (50, 20, 155), FEED, started=s) for s in (0.0, 3600.0))
    a, b = simulate(m1, [early])[0], simulate(m1, [late])[0]
    assert np.array_equal(a.deviation, b.deviation) and np.array_equal(a.position, b.position)
    drifting = m1.with_effect(make("thermal_drift.Y", amplitude_um=5.0, time_constant_s=60.0))
    c = simulate(drifting, [cone(15, 10, (50, 20, 155), FEED, started=7.0)])[0]
    np.testing.assert_allclose(
        c.position[:, 1] - a.position[:, 1], 5e-6 * (1 - np.exp(-(c.time + 7.0) / 60.0)), rtol=0, atol=1e-12
    )


def test_all_axes_late_is_the_whole_reading_late(m1, cone):
    test = cone(45, 30, (50, 20, 155), FEED)
    late = m1
    for axis in FIVE_AXIS.letters:
        late = late.with_effect(make(f"servo_delay.{axis}", delay_ms=8.0))
    a, b = simulate(m1, [test])[0].deviation, simulate(late, [test])[0].deviation
    assert np.abs(b[8:] - a[:-8]).max() < 1e-3 * NM


# -- order -------------------------------------------------------------------------------------------------------------


def test_the_order_of_tests_and_effects_does_not_matter(m1):
    """Same clock, same figures: the comparison of a campaign whose tests are listed in another order, with other
    order of effects.
    """
    campaign = read_campaign(examples() / "hidden-backlash")
    few = [i for i, t in enumerate(campaign.tests) if t.name.startswith("rotary")][:3]
    machine = m1.with_effect(make("backlash.A", width_deg=0.002)).with_effect(
        make("pitch_error.C", components=[[72, 1e-3, 0.0]])
    )
    turned = replace(machine, effects=machine.effects[::-1])
    results = []
    for order, m in ((few, machine), (few[::-1], turned)):
        c = replace(campaign, tests=tuple(campaign.tests[i] for i in order), as_is=True)
        results.append(mjsim.compare(c, m))
    a, b = results
    assert a.rms == pytest.approx(b.rms, rel=1e-9)
    tables = [r.to_dataframe().set_index("test").sort_index() for r in results]
    for column in tables[0].select_dtypes("number"):
        np.testing.assert_allclose(tables[0][column], tables[1][column], rtol=1e-6, atol=1e-9, err_msg=column)
