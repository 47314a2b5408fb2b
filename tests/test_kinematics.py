"""Three independent ways to the reading: MuJoCo's sites, mjsim.machine.kinematics, and the chain written out in 4 x
4 matrices here.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mjsim.effects.registry import make
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.kinematics import Geometry, bar_vector, reading, rotation, sensitivity, table_ball, work_to_machine
from mjsim.machine.model import build
from mjsim.simulation import bar, mjmodel

BALL = np.array([0.083, -0.047, 0.155])
LENGTH = 0.1
NM = 1e-9

#: Large values (m, rad), so that second-order terms and the order of rotations count.
LOCATION = {
    "EX0C": 3.1e-3, "EY0C": -2.3e-3, "EA0C": 4.1e-3, "EB0C": -3.7e-3, "EY0A": 2.9e-3, "EZ0A": -4.3e-3, "EB0A": 4.7e-3,
    "EC0A": -4.9e-3,
}  # fmt: skip
SQUARENESS = {"XY": 4.3e-3, "YZ": -3.3e-3, "ZX": 2.7e-3}
MOTION = ("EXC", "EYC", "EAC", "EBC")


def move(x=0.0, y=0.0, z=0.0):
    m = np.eye(4)
    m[:3, 3] = x, y, z
    return m


def spin(axis, angle):
    """Rodrigues' formula about a coordinate axis."""
    e = np.eye(3)["xyz".index(axis)]
    k = np.array([[0, -e[2], e[1]], [e[2], 0, -e[0]], [-e[1], e[0], 0]])
    m = np.eye(4)
    m[:3, :3] = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    return m


def oracle(pose, ball, length, location, square):
    """The reading at one pose (9,), from the effect catalogue's chain and nothing else.

    Table ball to machine: C; radial error motion; tilt error motion Rx Ry; location of C: Rx(EA0C), Ry(EB0C), shift; A;
    location of A: Ry(EB0A), Rz(EC0A), shift. Spindle ball: ΔX = −XY·Y + ZX·Z, ΔY = −YZ·Z.
    """
    x, y, z, a, c, exc, eyc, eac, ebc = pose
    g = location
    chain = (
        move(y=g["EY0A"], z=g["EZ0A"]) @ spin("z", g["EC0A"]) @ spin("y", g["EB0A"])
        @ spin("x", a)
        @ move(x=g["EX0C"], y=g["EY0C"]) @ spin("y", g["EB0C"]) @ spin("x", g["EA0C"])
        @ spin("x", eac) @ spin("y", ebc) @ move(x=exc, y=eyc)
        @ spin("z", c)
    )  # fmt: skip
    spindle = np.array([x - square["XY"] * y + square["ZX"] * z, y - square["YZ"] * z, z])
    return np.linalg.norm(spindle - (chain @ [*ball, 1.0])[:3]) - length


def poses(n, seed=2013):
    rng = np.random.default_rng(seed)
    half = np.array([0.25, 0.25, 0.25, 1.2, 6.0, 2e-3, 2e-3, 3e-3, 3e-3])
    return rng.uniform(-half, half, size=(n, 9))


def everywhere(machine):
    """A machine with every geometric effect at the large values; the error motions only bring their joints in."""
    for subject, value in SQUARENESS.items():
        machine = machine.with_effect(make(f"squareness.{subject}", angle_urad=value * 1e6))
    for subject, value in LOCATION.items():
        name = "value_um" if subject[1] in "XYZ" else "value_urad"
        machine = machine.with_effect(make(f"axis_location.{subject}", **{name: value * 1e6}))
    machine = machine.with_effect(make("radial_error_motion.C", amplitude_um=1.0, order=2))
    return machine.with_effect(make("tilt_error_motion.C", amplitude_urad=1.0, order=2))


def turned_slides(machine):
    """The same with angular errors and axial error motions about functional points of their own."""
    points = (("X", (0.1, -0.2, 0.3)), ("Y", (-0.1, 0.05, -0.07)), ("Z", (0.05, 0.02, 0.4)))
    machine = replace(everywhere(machine), functional_points=points)
    return machine.with_effect(make("angular_error.ECZ", linear_urad=1.0))


def sites(model, q, names):
    """Distance of the two sites less the bar's length at joint poses ``q`` (n, len(names)), joints set by name."""
    model.body("table_fixture").pos[:] = BALL
    data = mujoco.MjData(model)
    at = [model.joint(n).qposadr[0] for n in names]
    out = np.empty(len(q))
    for i, row in enumerate(q):
        data.qpos[at] = row
        mujoco.mj_kinematics(model, data)
        out[i] = np.linalg.norm(data.site("spindle_ball").xpos - data.site("table_ball").xpos) - LENGTH
    return out


def test_mujoco_agrees_with_every_geometric_effect_on(machine, bare):
    plant = build(everywhere(bare(machine)))
    assert plant.geometry.location == pytest.approx(LOCATION) and plant.geometry.squareness == pytest.approx(SQUARENESS)
    q = poses(1000)
    names = (*FIVE_AXIS.letters, *MOTION)
    assert [FIVE_AXIS.columns.index(n) for n in names] == list(range(9))
    got = sites(mjmodel.build_model(plant), q, names)
    want = reading(FIVE_AXIS, q, BALL, LENGTH, plant.geometry)
    assert np.abs(got - want).max() < NM


def test_three_ways_to_the_reading_agree_on_slides_that_turn(m1, bare):
    """MuJoCo's joints, the compiled chain and the written-out one, with all 24 columns, and with fewer of them."""
    plant = build(turned_slides(bare(m1)))
    chain, model = plant.chain, mjmodel.build_model(plant)
    assert plant.width == len(chain.columns) == 24
    rng = np.random.default_rng(43)
    half = np.concatenate([[0.25, 0.25, 0.25, 1.2, 6.0], np.full(19, 2e-3)])
    q = rng.uniform(-half, half, size=(200, 24))
    for width in chain.widths:
        q[:, width:] = 0.0
        want = reading(chain, q[:, :width], BALL, LENGTH, plant.geometry)
        assert np.abs(sites(model, q, chain.columns) - want).max() < 1e-14
        compiled = bar.reading(chain, np.ascontiguousarray(q[:, :width]), BALL, LENGTH, plant.geometry)
        assert np.abs(compiled - want).max() < 1e-15
        q = rng.uniform(-half, half, size=(200, 24))


def test_mujoco_agrees_on_the_ideal_machine(machine, bare):
    q = poses(1000, seed=1)[:, :5]
    got = sites(mjmodel.build_model(build(bare(machine))), q, FIVE_AXIS.letters)
    assert np.abs(got - reading(FIVE_AXIS, q, BALL, LENGTH)).max() < 1e-14


@pytest.mark.parametrize("subject", [*LOCATION, *SQUARENESS])
def test_mujoco_agrees_effect_by_effect(m1, bare, subject):
    """Alone, an error cannot hide behind another one."""
    if subject in SQUARENESS:
        effect = make(f"squareness.{subject}", angle_urad=SQUARENESS[subject] * 1e6)
    else:
        effect = make(
            f"axis_location.{subject}", **{"value_um" if subject[1] in "XYZ" else "value_urad": LOCATION[subject] * 1e6}
        )
    plant = build(bare(m1).with_effect(effect))
    q = poses(100, seed=3)[:, :5]
    got = sites(mjmodel.build_model(plant), q, FIVE_AXIS.letters)
    assert np.abs(got - reading(FIVE_AXIS, q, BALL, LENGTH, plant.geometry)).max() < NM
    assert np.abs(got - reading(FIVE_AXIS, q, BALL, LENGTH)).max() > 10e-6  # and it does something


def test_kinematics_agree_with_the_chain_written_out():
    q = poses(1000, seed=5)
    got = reading(FIVE_AXIS, q, BALL, LENGTH, Geometry(LOCATION, SQUARENESS))
    want = np.array([oracle(row, BALL, LENGTH, LOCATION, SQUARENESS) for row in q])
    assert np.abs(got - want).max() < 1e-12
    still = np.hstack([q[:, :5], np.zeros((1000, 4))])
    want = np.array([oracle(row, BALL, LENGTH, LOCATION, SQUARENESS) for row in still])
    assert np.abs(reading(FIVE_AXIS, q[:, :5], BALL, LENGTH, Geometry(LOCATION, SQUARENESS)) - want).max() < 1e-12


@pytest.mark.parametrize("subject", [*LOCATION, *SQUARENESS])
def test_kinematics_agree_effect_by_effect(subject):
    location = {k: v if k == subject else 0.0 for k, v in LOCATION.items()}
    square = {k: v if k == subject else 0.0 for k, v in SQUARENESS.items()}
    q = poses(50, seed=6)
    geometry = (
        Geometry({subject: LOCATION[subject]}, {})
        if subject in LOCATION
        else Geometry({}, {subject: SQUARENESS[subject]})
    )
    want = np.array([oracle(row, BALL, LENGTH, location, square) for row in q])
    assert np.abs(reading(FIVE_AXIS, q, BALL, LENGTH, geometry) - want).max() < 1e-12


def test_ideal_machine_is_equation_a9():
    rng = np.random.default_rng(9)
    for _ in range(100):
        a, c = rng.uniform(-3, 3, 2)
        x, y, z = p = rng.uniform(-0.3, 0.3, 3)
        want = [
            np.cos(c) * x - np.sin(c) * y,
            np.sin(c) * np.cos(a) * x + np.cos(c) * np.cos(a) * y - np.sin(a) * z,
            np.sin(c) * np.sin(a) * x + np.cos(c) * np.sin(a) * y + np.cos(a) * z,
        ]
        np.testing.assert_allclose(
            work_to_machine(FIVE_AXIS, np.array([[0, 0, 0, a, c]]), p)[0], want, rtol=0, atol=1e-15
        )


def test_rotation_matrices():
    for along, axis in enumerate("xyz"):
        for a in (0.0, 0.3, -2.0):
            np.testing.assert_allclose(rotation(along, a), spin(axis, a)[:3, :3], rtol=0, atol=1e-15)


# --- closed forms ---


def test_neutral_geometry_is_the_ideal_machine():
    q = poses(200, seed=11)
    zero = Geometry(dict.fromkeys(LOCATION, 0.0), dict.fromkeys(SQUARENESS, 0.0))
    np.testing.assert_allclose(
        reading(FIVE_AXIS, q[:, :5], BALL, LENGTH, zero), reading(FIVE_AXIS, q[:, :5], BALL, LENGTH), rtol=0, atol=1e-15
    )


def test_table_offset_seen_by_a_circle():
    """A ball that sits e off its place turns the reading of an XY circle into |L u − e| − L."""
    phi = np.linspace(0, 2 * np.pi, 361)
    q = np.zeros((361, 5))
    q[:, :3] = BALL + LENGTH * np.column_stack([np.cos(phi), np.sin(phi), 0 * phi])
    ex, ey, ez = e = np.array([30e-6, -20e-6, 50e-6])
    want = np.sqrt((LENGTH * np.cos(phi) - ex) ** 2 + (LENGTH * np.sin(phi) - ey) ** 2 + ez**2) - LENGTH
    np.testing.assert_allclose(reading(FIVE_AXIS, q, BALL + e, LENGTH), want, rtol=0, atol=1e-15)


def test_offset_of_the_c_centreline_turns_with_nothing():
    """With A = 0 a displaced C centreline displaces the table ball by the same vector at every C."""
    c = np.linspace(-6, 6, 50)
    q = np.zeros((50, 5))
    q[:, 4] = c
    shift = table_ball(FIVE_AXIS, q, BALL, Geometry({"EX0C": 3e-5, "EY0C": -4e-5})) - table_ball(FIVE_AXIS, q, BALL)
    np.testing.assert_allclose(shift, np.tile([3e-5, -4e-5, 0], (50, 1)), rtol=0, atol=1e-16)


def test_offset_of_the_a_centreline():
    """A displaced A centreline displaces the ball by the same vector at every A and C (the C axis goes with it)."""
    q = poses(50, seed=4)[:, :5]
    shift = table_ball(FIVE_AXIS, q, BALL, Geometry({"EY0A": 3e-5, "EZ0A": -4e-5})) - table_ball(FIVE_AXIS, q, BALL)
    np.testing.assert_allclose(shift, np.tile([0, 3e-5, -4e-5], (50, 1)), rtol=0, atol=1e-16)


def test_tilted_c_axis_of_a_ball_on_the_axis():
    """EB0C = β moves a ball at height h on the C axis by (h sinβ, 0, −h (1 − cosβ)) at A = 0, EA0C = α by (0, −h
    sinα, −h (1 − cosα)).
    """
    q = np.zeros((1, 5))
    h, t = 0.155, 1e-3
    p = np.array([0.0, 0.0, h])
    for name, want in (
        ("EB0C", [h * np.sin(t), 0, -h * (1 - np.cos(t))]),
        ("EA0C", [0, -h * np.sin(t), -h * (1 - np.cos(t))]),
    ):
        np.testing.assert_allclose(table_ball(FIVE_AXIS, q, p, Geometry({name: t}))[0] - p, want, rtol=0, atol=1e-16)


@pytest.mark.parametrize(("plane", "first", "second", "sign"), [("XY", 0, 1, -1), ("YZ", 1, 2, -1), ("ZX", 2, 0, 1)])
def test_squareness_on_a_circle(plane, first, second, sign):
    """ΔX = −α Y, ΔY = −α Z, ΔX = +α Z about the ball: ±α L sinφ cosφ to first order, an ellipse at 45° in that
    plane.
    """
    phi = np.linspace(0, 2 * np.pi, 361)
    alpha = 50e-6
    q = np.zeros((361, 5))
    q[:, first], q[:, second] = LENGTH * np.cos(phi), LENGTH * np.sin(phi)
    got = reading(FIVE_AXIS, q, np.zeros(3), LENGTH, Geometry({}, {plane: alpha}))
    np.testing.assert_allclose(got, sign * alpha * LENGTH * np.sin(phi) * np.cos(phi), rtol=0, atol=LENGTH * alpha**2)


# --- sensitivities ---


def test_sensitivity_against_central_differences():
    rng = np.random.default_rng(12)
    q = poses(200, seed=12)[:, :5]
    # on the nominal bar: the spindle ball one bar away from the table ball
    u = rng.normal(size=(200, 3))
    q[:, :3] = table_ball(FIVE_AXIS, q, BALL) + LENGTH * u / np.linalg.norm(u, axis=1)[:, None]
    s = sensitivity(FIVE_AXIS, q, BALL)
    h = 1e-6
    for k in range(5):
        d = np.zeros(5)
        d[k] = h
        numeric = (reading(FIVE_AXIS, q + d, BALL, LENGTH) - reading(FIVE_AXIS, q - d, BALL, LENGTH)) / (2 * h)
        np.testing.assert_allclose(s.axes[:, k], numeric, rtol=0, atol=1e-8)
    for k in range(3):
        d = np.eye(3)[k] * h
        numeric = (reading(FIVE_AXIS, q, BALL + d, LENGTH) - reading(FIVE_AXIS, q, BALL - d, LENGTH)) / (2 * h)
        np.testing.assert_allclose(s.table[:, k], numeric, rtol=0, atol=1e-8)
    b = bar_vector(FIVE_AXIS, q, BALL)
    np.testing.assert_allclose(s.spindle, b / np.linalg.norm(b, axis=1)[:, None], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(s.axes[:, :3], s.spindle)


def test_perpendicular_method_does_not_see_z(cone):
    from mjsim.instruments.ball_bar.program import Program

    for theta, beta in ((15, 10), (45, 30)):
        test = cone(theta, beta, (50, -40, 155))
        q = Program(test).commands(np.linspace(0, 40, 2001))
        s = sensitivity(FIVE_AXIS, q, np.array(test.table_ball))
        assert np.abs(s.axes[:, 2]).max() < 1e-12
        assert np.all(np.abs(s.axes[:, :2]).max(axis=0) > 0.3)


def test_the_compiled_reading_is_the_reference():
    """Axis positions, table motion and every geometric error at once: the fast path that the search uses."""
    from mjsim.simulation.bar import reading as compiled

    rng = np.random.default_rng(5)
    q = rng.uniform(-1.0, 1.0, (400, 9)) * np.array([0.3, 0.3, 0.3, 2.0, 7.0, 1e-3, 1e-3, 1e-3, 1e-3])
    for columns in (5, 9):
        for geometry in (Geometry(), Geometry(LOCATION, SQUARENESS)):
            want = reading(FIVE_AXIS, q[:, :columns], BALL, LENGTH, geometry)
            np.testing.assert_allclose(
                compiled(FIVE_AXIS, q[:, :columns], BALL, LENGTH, geometry), want, rtol=0, atol=1e-14
            )
