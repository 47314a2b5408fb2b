"""Angular errors of slides and axial error motion: closed forms, one place of the ball, tolerances, and the files."""

from dataclasses import replace

import numpy as np
import pytest

from mjsim.campaign.machine_file import read_machine
from mjsim.effects.registry import make
from mjsim.errors import InputError
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS, Placement, chain_of
from mjsim.machine.kinematics import spindle_ball, table_ball
from mjsim.machine.model import build
from mjsim.simulation.axes import AxesMotion
from mjsim.simulation.multibody import simulate
from mjsim.simulation.transmission import transmit

COLUMN = {name: i for i, name in enumerate(FIVE_AXIS.columns)}
URAD = 1e-6


def places(n=50, **fixed):
    """Positions of all columns without error motions, linear axes within 0.2 m."""
    q = np.zeros((n, len(FIVE_AXIS.columns)))
    q[:, :3] = np.random.default_rng(7).uniform(-0.2, 0.2, (n, 3))
    for name, value in fixed.items():
        q[:, COLUMN[name]] = value
    return q


def load(chain, effects, q):
    """Positions behind the effects of a machine, (n, columns)."""
    machine = read_machine(examples() / "hidden-backlash" / "machine.toml")
    plant = build(replace(machine, effects=tuple(effects), functional_points=chain.stated_points))
    return transmit(plant.op_table(), q[:, : plant.width], np.zeros(len(q))), plant


@pytest.mark.parametrize("about", "ABC")
def test_an_angle_times_an_arm_is_the_displacement(about):
    """A turn ε of the X slide about A, B or C moves the spindle ball by ε × arm, and the arm is Z from the point."""
    q = places()
    loaded, _ = load(FIVE_AXIS, [make(f"angular_error.E{about}X", linear_urad=10.0, quadratic_urad=4.0)], q)
    u = q[:, 0] / 0.1
    angle = URAD * (10.0 * u + 4.0 * u**2)
    moved = spindle_ball(FIVE_AXIS, loaded) - q[:, :3] * [1.0, 0.0, 1.0]  # Y moves the table
    arm = np.stack([0.0 * u, 0.0 * u, q[:, 2]], axis=1)  # Z is carried by X, and Y is on the table's side
    turn = angle[:, None] * np.eye(3)["ABC".index(about)]
    np.testing.assert_allclose(moved, np.cross(turn, arm), rtol=0, atol=3e-10)  # second order: (40 µrad)² · 0.2 m


def test_a_table_slide_turns_what_lies_on_it():
    """EBY tilts the table on the Y slide: a point at the height h moves by ε·h along X, and sideways ones by −ε·x
    along Z.
    """
    q, ball = places(), np.array([0.08, 0.03, 0.155])
    loaded, _ = load(FIVE_AXIS, [make("angular_error.EBY", linear_urad=-20.0)], q)
    angle = -20.0 * URAD * q[:, 1] / 0.1
    moved = table_ball(FIVE_AXIS, loaded, ball) - (ball - q[:, [1]] * [0.0, 1.0, 0.0])
    np.testing.assert_allclose(moved, np.outer(angle, [0.155, 0.0, -0.08]), rtol=0, atol=3e-10)


def test_the_functional_point_stays():
    """What lies in the functional point goes where the slide goes, whatever its angle; it moves with the slide."""
    point = (0.08, 0.03, 0.155)
    chain = chain_of(FIVE_AXIS.configuration, functional_points=(("Y", point),))
    assert chain.functional_point("Y") == point and chain.functional_point("X") == (0.0, 0.0, 0.0)
    q = places()
    loaded, _ = load(chain, [make(f"angular_error.E{k}Y", linear_urad=500.0) for k in "ABC"], q)
    want = np.array(point) - q[:, [1]] * [0.0, 1.0, 0.0]
    np.testing.assert_allclose(table_ball(chain, loaded, np.array(point)), want, atol=1e-17)


def test_a_constant_arm_is_straightness_squareness_and_scale_by_another_name(m1, bare, circle):
    """At one place of the table ball, a Y slide that pitches, rolls and yaws reads as three other errors."""
    x, y, z = ball = (0.06, -0.04, 0.155)
    linear, quadratic = 15.0, 6.0  # of every angle
    angles = [make(f"angular_error.E{k}Y", linear_urad=linear, quadratic_urad=quadratic) for k in "ABC"]
    # the ball moves by ε × (x, y, z): the spindle ball seen from it the other way, per 100 mm of Y
    along = -(np.cross([1.0, 1.0, 1.0], ball))
    others = [
        make("squareness.XY", angle_urad=-linear * along[0] / 0.1),  # ΔX = −α·Y
        make("straightness.EXY", quadratic_um=quadratic * along[0]),
        make("scale_error.Y", ppm=linear * along[1] / 0.1),
        make("straightness.EZY", quadratic_um=quadratic * along[2]),
    ]
    tests = [circle(plane, (1e3 * x, 1e3 * y, 1e3 * z), 3000.0, name=plane) for plane in ("XY", "YZ")]
    machine = bare(m1)
    given = simulate(machine.with_effects(angles), tests)
    named = simulate(machine.with_effects(others), tests)
    # what squareness has no name for, ΔZ over Y, and ΔY over its own square, are added by hand
    for a, b, plain in zip(given, named, simulate(machine, tests), strict=True):
        unit = bar_directions(plain, ball)
        travel = plain.position[:, 1] / 0.1
        extra = unit[:, 2] * URAD * linear * along[2] * travel + unit[:, 1] * URAD * quadratic * along[1] * travel**2
        assert np.ptp(a.deviation - plain.deviation) > 1e-6
        np.testing.assert_allclose(a.deviation, b.deviation + extra, atol=2e-9)


def bar_directions(simulation, ball):
    """Unit vectors of the bar, (n, 3)."""
    bar = simulation.position[:, :3] - np.array(ball)
    return bar / np.linalg.norm(bar, axis=1)[:, None]


@pytest.mark.parametrize("axis", FIVE_AXIS.rotary)
def test_axial_error_motion_is_along_the_axis(axis):
    q = places(**{axis: np.linspace(-1.5, 1.5, 50)})
    still = places(**{axis: q[:, COLUMN[axis]]})
    ball = np.array([0.05, 0.02, 0.1])
    loaded, _ = load(FIVE_AXIS, [make(f"axial_error_motion.{axis}", amplitude_um=3.0, order=2, phase_deg=40.0)], q)
    moved = table_ball(FIVE_AXIS, loaded, ball) - table_ball(FIVE_AXIS, still[:, :15], ball)
    want = 3e-6 * np.cos(2.0 * q[:, COLUMN[axis]] + np.radians(40.0))
    along = FIVE_AXIS.axis(axis).direction
    np.testing.assert_allclose(moved, np.outer(want, along), atol=1e-16)


def test_axial_error_motion_of_a_tilted_axis_follows_its_centreline():
    chain = chain_of("w-C'B'X'bYZ-t", (("B", Placement((0.0, 1.0, 1.0))),))
    q = np.zeros((1, len(chain.columns)))
    q[0, chain.columns.index("EYB")] = 1e-3
    at = chain.count + len(chain.motions) - len(chain.angular)
    moved = table_ball(chain, q[:, :at], np.zeros(3)) - table_ball(chain, q[:, : chain.count], np.zeros(3))
    np.testing.assert_allclose(moved[0], 1e-3 * np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0), atol=1e-18)


def test_both_engines_give_the_same_reading(m1, bare, cone):
    """All eleven errors at once. A slide that turns loads the drives a little, as a table that wobbles does."""
    machine = replace(bare(m1), functional_points=(("X", (0.1, -0.1, 0.2)), ("Z", (0.05, 0.1, 0.3))))
    turns = [make(f"angular_error.{name}", linear_urad=30.0, quadratic_urad=-20.0) for name in FIVE_AXIS.angular]
    runs = [make(f"axial_error_motion.{a}", amplitude_um=3.0, order=2) for a in FIVE_AXIS.rotary]
    machine = machine.with_effects([*turns, *runs])
    test = replace(cone(15, 10, (50, 20, 155), 6000.0, sensitive="parallel"), chain=machine.chain)
    (multibody,) = simulate(machine, [test])
    alone = AxesMotion(test)
    assert np.abs(alone.reading(build(machine)) - multibody.deviation).max() < 1e-9
    assert np.ptp(multibody.deviation - alone.reading(build(replace(machine, effects=())))) > 5e-6


def test_a_machine_file_states_functional_points(tmp_path):
    text = (examples() / "hidden-backlash" / "machine.toml").read_text()
    path = tmp_path / "machine.toml"
    path.write_text(text + "\n[axis.X]\nfunctional_point_mm = [10.0, -20.0, 300.0]\n")
    machine = read_machine(path)
    assert machine.chain.functional_point("X") == pytest.approx((0.01, -0.02, 0.3))
    assert machine.chain != FIVE_AXIS and machine.chain.nominal == FIVE_AXIS
    path.write_text(text + "\n[axis.C]\nfunctional_point_mm = [10.0, -20.0, 300.0]\n")
    with pytest.raises(InputError, match=r"\[axis.C\] functional_point_mm"):
        read_machine(path)
    path.write_text(text + "\n[axis.X]\ndirection = [1.0, 0.0, 0.0]\n")
    with pytest.raises(InputError, match="cannot be placed"):
        read_machine(path)
