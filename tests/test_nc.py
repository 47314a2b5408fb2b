"""NC programs: the numbers that the paper prints, the appendix' equations, the feed profile and the ball-bar
condition.
"""

import numpy as np
import pytest

from mjsim.instruments.ball_bar.follow import ACCELERATION, trapezoid
from mjsim.instruments.ball_bar.kinds import KINDS, kind_of
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.inverse import aim
from mjsim.machine.kinematics import bar_vector

DEG = np.pi / 180.0
X, Y, Z, A, C = range(5)
PHI = np.linspace(0.0, 2 * np.pi, 7201)[:-1] + 1e-4  # never exactly on a reversal
#: To the paper's units: mm/min and deg/min.
PER_MIN = np.array([60e3, 60e3, 60e3, 60 / DEG, 60 / DEG])


def plot_angle(phi):
    """The paper's plots call 180° what its appendix calls φ = 0."""
    return np.degrees(phi) + 180.0


def reversals(program, axis):
    """Plot angles (0 to 360°) at which an axis changes its direction."""
    v = program.axis_velocity(PHI)[:, axis]
    i = np.flatnonzero(v * np.roll(v, -1) < 0)
    at = PHI[i] + (PHI[1] - PHI[0]) * v[i] / (v[i] - np.roll(v, -1)[i])
    return np.sort(plot_angle(at) % 360.0)


def rotation(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array({"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}[axis])


# --- what the paper prints ---


@pytest.mark.parametrize(("theta", "beta"), [(15, 10), (45, 30)])
@pytest.mark.parametrize("sensitive", ["perpendicular", "parallel"])
def test_travel_of_a(paper, cone, theta, beta, sensitive):
    said = paper["axis_travel"][f"A_range_deg_{theta}_{beta}"]
    q = KINDS["cone_frustum"].path(
        cone(theta, beta, (30, -20, 155), sensitive=sensitive), np.linspace(0, 2 * np.pi, 3601)
    )
    assert np.ptp(q[:, A]) / DEG == pytest.approx(said["value"], abs=said["tolerance"])


@pytest.mark.parametrize("direction", ["CW", "CCW"])
@pytest.mark.parametrize("revolutions", [1, 3])
def test_travel_of_c(paper, cone, direction, revolutions):
    said = paper["axis_travel"]["C_range_deg_per_revolution"]
    phi = np.linspace(0, 2 * np.pi * revolutions, 3600 * revolutions + 1) * (1 if direction == "CCW" else -1)
    for theta, beta in ((15, 10), (45, 30)):
        c = KINDS["cone_frustum"].path(
            cone(theta, beta, (0, 0, 155), direction=direction, revolutions=revolutions), phi
        )[:, C]
        assert abs(c[-1] - c[0]) / DEG / revolutions == pytest.approx(said["value"], abs=said["tolerance"])
        assert np.all(np.diff(c) * (c[-1] - c[0]) > 0)  # it never turns back
        assert np.abs(np.diff(c)).max() < 1 * DEG  # unwrapped: no jump of a turn


def test_c_swings_where_the_cone_leans_more_than_it_opens(cone):
    q = KINDS["cone_frustum"].path(cone(15, 30, (0, 0, 155)), np.linspace(0, 2 * np.pi, 3601))
    assert abs(q[-1, C] - q[0, C]) < 1e-9
    assert np.ptp(q[:, C]) < np.pi
    assert len(np.flatnonzero(np.diff(np.sign(np.diff(q[:, C]))))) == 2


def test_radius_of_the_measurement_circle(paper, cone):
    said = paper["axis_travel"]["measurement_circle_radius_mm_45"]
    assert KINDS["cone_frustum"].radius(cone(45, 30, (0, 0, 155))) * 1e3 == pytest.approx(
        said["value"], abs=said["tolerance"]
    )
    assert KINDS["cone_frustum"].radius(cone(45, 30, (0, 0, 155), sensitive="parallel")) == 0.1


@pytest.mark.parametrize("axis", ["X", "Y", "A"])
def test_reversals_of_the_centred_cone(paper, cone, axis):
    said = paper["reversals_15_10_centre"][f"{axis}_deg"]
    got = reversals(Program(cone(15, 10, (0, 0, 155))), "XYZAC".index(axis))
    for angle in said["value"]:
        distance = np.abs((got - angle + 180) % 360 - 180).min()
        assert distance <= said["tolerance"], (axis, angle, got)
    allowed = {"X": 2, "Y": 4, "A": 2}[axis]  # Y also turns back at 0° and 180°
    assert len(got) == allowed


def test_y_reverses_where_the_equations_say(cone):
    """The paper's text prints 151° and 209°; its own equations give 148.0° and 212.0°."""
    got = reversals(Program(cone(15, 10, (0, 0, 155))), Y)
    assert got == pytest.approx([0.0, 148.0, 180.0, 212.0], abs=0.05) or got == pytest.approx(
        [148.0, 180.0, 212.0, 360.0], abs=0.05
    )


@pytest.mark.parametrize(
    ("name", "axis", "ball"),
    [
        ("C_max_deg_per_min", C, (0, 0, 155)),
        ("X_max_mm_per_min_XT_200", X, (200, 0, 155)),
        ("Y_max_mm_per_min_YT_200", Y, (0, 200, 155)),
        ("X_max_mm_per_min_XT_minus_50", X, (-50, 0, 155)),
        ("X_max_mm_per_min_YT_50", X, (0, 50, 155)),
        ("Y_max_mm_per_min_YT_50", Y, (0, 50, 155)),
    ],
)
def test_feed_speeds(paper, cone, name, axis, ball):
    said = paper["feed_15_10"][name]
    speed = np.abs(Program(cone(15, 10, ball)).axis_velocity(PHI)[:, axis] * PER_MIN[axis])
    assert speed.max() == pytest.approx(said["value"], abs=said["tolerance"])
    if "at_deg" in said:
        # a few degrees for the reading of the graph: the maxima are flat
        assert plot_angle(PHI[speed.argmax()]) % 360 == pytest.approx(said["at_deg"], abs=3.0)


def test_every_printed_nc_number_is_tested(paper):
    assert set(paper["axis_travel"]) == {
        "A_range_deg_15_10",
        "A_range_deg_45_30",
        "C_range_deg_per_revolution",
        "measurement_circle_radius_mm_45",
    }
    assert set(paper["reversals_15_10_centre"]) == {"X_deg", "Y_deg", "A_deg"}
    assert set(paper["feed_15_10"]) == {
        "C_max_deg_per_min",
        "X_max_mm_per_min_XT_200",
        "Y_max_mm_per_min_YT_200",
        "X_max_mm_per_min_XT_minus_50",
        "X_max_mm_per_min_YT_50",
        "Y_max_mm_per_min_YT_50",
    }


def test_c_speed_does_not_depend_on_the_centre(cone):
    """Section 4.1: the velocity of the C axis is not affected by X_T or Y_T; nor is that of A."""
    centre = Program(cone(15, 10, (0, 0, 155))).axis_velocity(PHI)[:, [A, C]]
    for ball in ((200, 0, 155), (0, -200, 155)):
        np.testing.assert_allclose(Program(cone(15, 10, ball)).axis_velocity(PHI)[:, [A, C]], centre, rtol=0, atol=1e-9)


def test_y_stands_still_at_180_whatever_the_x_offset(cone):
    """Section 4.1, Fig. 9b."""
    for x in (-200, -50, 0, 50, 200):
        v = Program(cone(15, 10, (x, 0, 155))).axis_velocity(np.array([0.0]))[0]
        assert abs(v[Y]) < 1e-9 < abs(v[X])


# --- the appendix' equations ---


@pytest.mark.parametrize("sensitive", ["perpendicular", "parallel"])
@pytest.mark.parametrize(("theta", "beta"), [(15, 10), (45, 30), (15, 30), (30, 0)])
def test_commands_written_out(cone, theta, beta, sensitive):
    """A.1 to A.9 with plain trigonometry at single points."""
    L, ball = 100.0, np.array([37.0, -64.0, 155.0])
    th, be = theta * DEG, beta * DEG
    test = cone(theta, beta, ball, sensitive=sensitive)
    for phi in np.array([3.0, 71.0, 144.0, 233.0, 331.0]) * DEG:
        if sensitive == "perpendicular":
            p, apex = (
                np.array([L * np.cos(th) * np.cos(phi), L * np.cos(th) * np.sin(phi), L * np.sin(th)]),
                L / np.sin(th),
            )
        else:
            p, apex = np.array([L * np.cos(phi), L * np.sin(phi), 0.0]), L / np.tan(th)
        lean = np.array([[np.cos(be), 0, np.sin(be)], [0, 1, 0], [-np.sin(be), 0, np.cos(be)]])
        p, top = lean @ p + ball, lean @ np.array([0, 0, apex]) + ball
        i, j, k = (top - p) / np.linalg.norm(top - p)
        a = np.arccos(k)
        c = (1.0 if i >= 0 else -1.0) * np.arccos(j / np.hypot(i, j))
        xyz = rotation("x", a) @ rotation("z", c) @ p
        got = KINDS["cone_frustum"].path(test, np.array([phi]))[0]
        np.testing.assert_allclose(got[:3] * 1e3, xyz, rtol=0, atol=1e-10)
        assert got[3] == pytest.approx(a, abs=1e-12)
        assert (got[4] - c + np.pi) % (2 * np.pi) - np.pi == pytest.approx(0, abs=1e-12)


def test_tool_axis_formula():
    """sgn(i)·arccos(j/√(i²+j²)) of A.7 is the arc tangent of i over j, for directions all over the upper half
    sphere.
    """
    rng = np.random.default_rng(7)
    d = rng.normal(size=(2000, 3))
    d[:, 2] = np.abs(d[:, 2])
    d /= np.linalg.norm(d, axis=1)[:, None]
    for i, j, k in d:
        a, c = aim(FIVE_AXIS, np.array([[i, j, k]]))[0, 3:]
        assert a == pytest.approx(np.arccos(k), abs=1e-14)
        assert c == pytest.approx(
            (1.0 if i >= 0 else -1.0) * np.arccos(j / np.hypot(i, j)), abs=1e-7
        )  # arccos is blunt at ±1


def test_c_keeps_its_value_on_the_pole():
    """Where the tool axis is the C axis, C is arbitrary; it must not jump."""
    angle = np.linspace(-0.3, 0.3, 61)
    a, c = aim(FIVE_AXIS, np.column_stack([np.zeros(61), np.abs(np.sin(angle)), np.cos(angle)])).T[3:]
    assert a[30] == 0 and np.all(c == 0)
    a, c = aim(FIVE_AXIS, np.tile([0.0, 0.0, 1.0], (3, 1))).T[3:]
    assert np.all(a == 0) and np.isfinite(c).all()


@pytest.mark.parametrize("sensitive", ["perpendicular", "parallel"])
def test_tool_axis_stands_on_the_spindle(cone, sensitive):
    """The cone's generating line, turned by C and then A, is the spindle's direction +Z."""
    for theta, beta in ((15, 10), (45, 30), (10, 25)):
        test = cone(theta, beta, (20, 10, 155), sensitive=sensitive)
        q = KINDS["cone_frustum"].path(test, PHI[::90])
        th, be = theta * DEG, beta * DEG
        for phi, (*_, a, c) in zip(PHI[::90], q, strict=True):
            line = np.array([-np.sin(th) * np.cos(phi), -np.sin(th) * np.sin(phi), np.cos(th)])  # towards the apex
            line = np.array(
                [np.cos(be) * line[0] + np.sin(be) * line[2], line[1], np.cos(be) * line[2] - np.sin(be) * line[0]]
            )
            np.testing.assert_allclose(rotation("x", a) @ rotation("z", c) @ line, [0, 0, 1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("direction", ["CW", "CCW"])
def test_feed_words(cone, direction):
    """Eq. A.10 and A.11, block by block, with the chord between the points as the distance L_W."""
    test = cone(15, 10, (50, 20, 155), direction=direction)
    phi = np.arange(0, 360.05, 0.1) * DEG * (1 if direction == "CCW" else -1)
    q = KINDS["cone_frustum"].path(test, phi)
    R = 100.0 * np.cos(15 * DEG)
    for n in (0, 900, 1777, 3599):
        dx, dy, dz = (q[n + 1, :3] - q[n, :3]) * 1e3
        da, dc = np.degrees(q[n + 1, 3:] - q[n, 3:])
        p = [R * np.array([np.cos(f), np.sin(f)]) for f in phi[n : n + 2]]
        minutes = np.linalg.norm(p[1] - p[0]) / 1000.0
        f = np.sqrt(dx**2 + dy**2 + dz**2 + da**2 + dc**2) / minutes
        assert Program(test).feed_words(phi)[n] == pytest.approx(f, rel=1e-5)  # chord against arc: 1 + (0.1°)²/24


# --- the ball-bar condition ---


def all_tests(cone, circle, turn):
    return [
        cone(15, 10, (0, 0, 155)), cone(45, 30, (50, -30, 155)), cone(15, 30, (0, 40, 155)),
        cone(15, 10, (50, 20, 155), sensitive="parallel"), cone(45, 30, (0, 200, 155), sensitive="parallel",
            direction="CW"),
        circle("XY", (10, 20, 155)), circle("YZ", (0, 0, 155)), circle("ZX", (-30, 0, 155), direction="CW"),
        *(turn("C", 0, 360, (80, 60, 155), s) for s in ("tangential", "radial", "axial")),
        *(turn("A", 0, -90, (10, 60, 155), s) for s in ("tangential", "radial", "axial")),
    ]  # fmt: skip


def test_balls_are_one_bar_apart(cone, circle, turn):
    for test in all_tests(cone, circle, turn):
        program = Program(test)
        q = program.commands(np.linspace(-0.5, program.duration + 0.5, 4001))
        d = np.linalg.norm(bar_vector(FIVE_AXIS, q, np.array(test.table_ball)), axis=1)
        assert np.abs(d - test.length).max() < 1e-14, test
        assert np.isfinite(q).all()


@pytest.mark.parametrize(("theta", "beta"), [(15, 10), (45, 30)])
def test_perpendicular_and_parallel(cone, theta, beta):
    """Perpendicular: the bar stays in the machine's XY plane. Parallel: it leaves it by the half apex angle."""
    for ball in ((0, 0, 155), (50, -80, 155)):
        square, level = (cone(theta, beta, ball, sensitive=s) for s in ("perpendicular", "parallel"))
        up = [
            bar_vector(FIVE_AXIS, KINDS["cone_frustum"].path(t, PHI), np.array(t.table_ball))[:, 2]
            for t in (square, level)
        ]
        assert np.abs(up[0]).max() < 1e-14
        np.testing.assert_allclose(up[1], -0.1 * np.sin(theta * DEG), rtol=0, atol=1e-14)


@pytest.mark.parametrize(("plane", "axes"), [("XY", (X, Y)), ("YZ", (Y, Z)), ("ZX", (Z, X))])
def test_circular(circle, plane, axes):
    test = circle(plane, (10, 20, 155))
    q = KINDS["circular"].path(test, PHI)
    want = np.zeros((len(PHI), 5))
    want[:, :3] = test.table_ball
    want[:, axes[0]] += 0.1 * np.cos(PHI)
    want[:, axes[1]] += 0.1 * np.sin(PHI)
    np.testing.assert_allclose(q, want, rtol=0, atol=1e-16)


@pytest.mark.parametrize(("axis", "ball"), [("C", (80, 60, 155)), ("A", (10, 60, 45))])
def test_rotary_directions(turn, axis, ball):
    """The bar points along r, a or a × r of the turning axis, in machine axes."""
    for sensitive in ("radial", "axial", "tangential"):
        test = turn(axis, 0, 80, ball, sensitive)
        phi = np.linspace(0, 80, 9) * DEG
        bar = bar_vector(FIVE_AXIS, KINDS["rotary"].path(test, phi), np.array(test.table_ball)) / 0.1
        for f, b in zip(phi, bar, strict=True):
            p = rotation("z" if axis == "C" else "x", f) @ ball
            a = np.array([0, 0, 1.0] if axis == "C" else [1.0, 0, 0])
            r = p - a * (a @ p)
            r /= np.linalg.norm(r)
            np.testing.assert_allclose(
                b, {"radial": r, "axial": a, "tangential": np.cross(a, r)}[sensitive], rtol=0, atol=1e-14
            )


# --- the feed profile ---


@pytest.mark.parametrize(("length", "feed"), [(0.6, 1 / 60), (0.6, 0.1), (0.01, 0.2), (1e-4, 1 / 60)])
def test_trapezoid(length, feed):
    duration, travel = trapezoid(length, feed)
    t = np.linspace(0, duration, 200001)
    s = travel(t)
    v, h = np.gradient(s, t), t[1]
    reached = min(feed, np.sqrt(0.5 * length))
    assert s[0] == 0 and s[-1] == pytest.approx(length, abs=1e-15)
    assert np.all(np.diff(s) >= -1e-16)
    assert v.max() == pytest.approx(reached, rel=1e-4)
    assert duration == pytest.approx(length / reached + reached / 0.5, rel=1e-12)
    up, down = t < reached / 0.5 - 2 * h, t > duration - reached / 0.5 + 2 * h
    a = np.diff(s, 2) / h**2
    assert np.abs(a).max() == pytest.approx(0.5, rel=1e-3)
    np.testing.assert_allclose(s[up], 0.25 * t[up] ** 2, rtol=0, atol=1e-14)
    np.testing.assert_allclose(length - s[down], 0.25 * (duration - t[down]) ** 2, rtol=0, atol=1e-14)
    np.testing.assert_allclose(v[~(up | down)][3:-3], reached, rtol=1e-3 if reached < feed else 1e-6)


def test_profile_holds_its_ends():
    duration, travel = trapezoid(0.3, 0.02)
    np.testing.assert_array_equal(travel(np.array([-5.0, 0.0])), 0.0)
    assert np.all(travel(np.array([duration, duration + 7.0])) == 0.3)


def test_triangular_when_short():
    duration, travel = trapezoid(0.002, 1.0)
    assert duration == pytest.approx(2 * np.sqrt(0.002 / ACCELERATION))
    assert travel(np.array([duration / 2]))[0] == pytest.approx(0.001)


def test_acceleration_is_the_documented_one():
    assert ACCELERATION == 0.5


@pytest.mark.parametrize("direction", ["CW", "CCW"])
@pytest.mark.parametrize("feed", [500.0, 1000.0, 8000.0])
def test_measured_span_of_whole_revolutions(cone, circle, direction, feed):
    """The program runs from 10° before φ = 0 to 10° past the last turn; the trace is the turns."""
    sign = 1 if direction == "CCW" else -1
    fields = {"feed": feed, "direction": direction, "revolutions": 2}
    for test in (cone(15, 10, (50, 0, 155), **fields), circle("XY", (0, 0, 155), **fields)):
        program = Program(test)
        first, last = program.measured_span
        phi = program.phi(np.array([0.0, first, last, program.duration]))
        np.testing.assert_allclose(phi / DEG, sign * np.array([-10.0, 0.0, 720.0, 730.0]), rtol=0, atol=1e-9)
        middle = np.linspace(first + 0.6, last - 0.6, 500)
        speed = np.gradient(program.phi(middle), middle) * kind_of(test).radius(test)
        np.testing.assert_allclose(speed * 60e3, sign * feed, rtol=1e-6)


@pytest.mark.parametrize("feed", [300.0, 1000.0, 8000.0])
@pytest.mark.parametrize(("axis", "start", "stop"), [("C", 0, 360), ("C", 400, -20), ("A", 20, -80), ("A", 0, 5)])
def test_measured_span_of_rotary_tests(turn, axis, start, stop, feed):
    """Rotary traces leave out 2° at both ends, on the ramp or past it."""
    program = Program(turn(axis, start, stop, (80, 60, 155), feed=feed))
    first, last = program.measured_span
    sign = np.sign(stop - start)
    phi = program.phi(np.array([0.0, first, last, program.duration])) / DEG
    np.testing.assert_allclose(phi, [start, start + 2 * sign, stop - 2 * sign, stop], rtol=0, atol=1e-9)


def test_axis_velocity_is_the_command_rate(cone):
    program = Program(cone(45, 30, (50, 20, 155), direction="CW"))
    t = np.linspace(5.0, 20.0, 51)
    h = 1e-4
    rate = (program.commands(t + h) - program.commands(t - h)) / (2 * h)
    rate[:, C] = (rate[:, C] * 2 * h + np.pi) % (2 * np.pi) / (2 * h) - np.pi / (2 * h)
    np.testing.assert_allclose(program.axis_velocity(program.phi(t)), rate, rtol=0, atol=1e-6)
