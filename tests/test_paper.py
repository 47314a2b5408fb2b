"""What Kato, Tsutsumi and Sato (IJMTM 64, 2013) state in sections 4 and 5, on simulated traces. θ = 15°, β = 10° unless
said otherwise.

Machine: M1, whose axes have equal Kpp. How traces are taken: ``paper_traces``. Sections 3, 4.1 and the conclusions on
the paper's own machine: ``test_paper_machine``.
"""

import numpy as np
import pytest
from paper_traces import (
    ANGLE,
    CENTRE,
    OFFSETS,
    UM,
    X200,
    X_200,
    Y200,
    Y_200,
    at,
    centred,
    glitches,
    nearest,
    step,
    within,
)
from scipy.signal import find_peaks

from mjsim.effects.registry import make

# --- 1: friction and servo only (section 4.1, Fig. 7, 8, 12) ---


def test_friction_shows_at_every_reversal(m1, caused, paper):
    """Projections at 131°, 151°, 209°, 229°, 0° and 180° (the equations say 148° and 212° for Y), and nowhere else.

    The motor turns back one lag after its command (0.2° of φ) and the glitch peaks once the bristles have bent: within
    2°.
    """
    found = glitches(caused(m1.effects, 15, [CENTRE])[0])
    said = paper["reversals_15_10_centre"]
    for angle in said["X_deg"]["value"]:
        assert nearest(found, angle) <= said["X_deg"]["tolerance"] + 1.0
    for angle in said["Y_deg"]["value"]:
        assert nearest(found, angle) <= said["Y_deg"]["tolerance"]
    expected = np.array([0.0, 131.15, 147.98, 180.0, 212.02, 228.85])
    assert all(nearest(found, angle) <= 3.0 for angle in expected)
    assert all(nearest(expected, angle) <= 3.0 for angle in found)


@pytest.mark.parametrize(
    ("axis", "angles"),
    [("X", [131.15, 228.85]), ("Y", [0, 147.98, 180, 212.02]), ("A", [0, 180]), ("Z", []), ("C", [])],
)
def test_each_axis_shows_at_its_own_reversals(m1, caused, axis, angles):
    """C never turns back, and Z is not seen."""
    found = glitches(caused([m1.effect(f"friction.{axis}")], 15, [CENTRE])[0])
    assert len(found) == len(angles)
    assert all(nearest(found, a) <= 3.0 for a in angles)


def test_deflection_at_180_with_equal_gains(m1, traces):
    """−11, −2 and +6 µm for X_T = +200, 0 and −200 mm: inward, a little inward, outward."""
    got = [at(centred(t), 180) for t in traces(m1, 15, [X200, CENTRE, X_200])]
    assert got == pytest.approx([-11.0, -2.0, 6.0], abs=1.0)


def test_deflection_grows_with_the_offset(m1, traces):
    got = [at(centred(t), 180) for t in traces(m1, 15, [(x, 0, 155) for x in (-200, -100, 0, 50, 100, 200)])]
    assert np.all(np.diff(got) < -0.5)


def test_equal_gains_hide_the_sign_of_y(m1, traces):
    """With one Kpp for all axes the offset in Y does not turn the deflection round."""
    plus, zero, minus = (at(centred(t), 180) for t in traces(m1, 15, [Y200, CENTRE, Y_200]))
    assert plus < 0 and zero < 0 and minus < 0
    assert abs(plus - minus) < 2.0


def test_deflection_at_180_with_a_faster_c_axis(m1, traces):
    """Kpp of C 3 % higher: −34 and +29 µm for Y_T = +200 and −200 mm; X_T keeps its signs."""
    faster = m1.with_effect(make("servo_gain.C", ratio=1.03))
    got = [at(centred(t), 180) for t in traces(faster, 15, [Y200, Y_200])]
    assert got == pytest.approx([-34.0, 29.0], abs=1.0)
    x_plus, x_minus = (at(centred(t), 180) for t in traces(faster, 15, [X200, X_200]))
    assert x_plus < -5 and x_minus > 5


def test_deflection_is_larger_at_45(m1, traces):
    """Fig. 12: the same signs, larger amounts."""
    for machine, balls in ((m1, [X200, X_200]), (m1.with_effect(make("servo_gain.C", ratio=1.03)), [Y200, Y_200])):
        small, large = ([at(centred(t), 180) for t in traces(machine, theta, balls)] for theta in (15, 45))
        assert small[0] < 0 < small[1]
        assert large[0] < small[0] and large[1] > small[1]


def test_deflection_is_symmetric_about_the_0_180_line(quiet, traces):
    """Without friction and with X offsets only, nothing tells the upper half from the lower one but the direction
    of motion.
    """
    trace = centred(traces(quiet, 15, [X200])[0])
    smooth = np.abs(ANGLE - 180) > 3
    assert np.abs(trace - np.roll(trace[::-1], 1))[smooth].max() < 0.1 * np.ptp(trace)


# --- 2: backlash of A only (Fig. 10a, 13, 16b, 17b) ---

WIDTH = 0.004
BACKLASH = [make("backlash.A", width_deg=WIDTH)]


def test_backlash_of_a_steps_at_0_and_180(caused):
    """Two steps, flat between them apart from the slow change of the sensitivity."""
    trace = caused(BACKLASH, 15, [CENTRE])[0]
    assert step(trace, 0) * step(trace, 180) < 0
    assert min(abs(step(trace, a)) for a in (0, 180)) > 5 * max(abs(step(trace, a)) for a in range(20, 161, 5))
    assert min(abs(step(trace, a)) for a in (0, 180)) > 5 * max(abs(step(trace, a)) for a in range(200, 341, 5))


def test_backlash_step_height_in_closed_form(caused):
    """At both angles the bar points along Y: the step is the play times the ball's height over the A axis, 155 mm · cos
    A.

    A is θ + β = 25° at 0° and θ − β = 5° at 180°. 3 % for the change of the sensitivity over the 5° before and after
    the step.
    """
    trace = caused(BACKLASH, 15, [CENTRE])[0]
    for angle, a in ((0, 25.0), (180, 5.0)):
        assert abs(step(trace, angle)) == pytest.approx(
            np.radians(WIDTH) * 155e-3 * np.cos(np.radians(a)) / UM, rel=0.03
        )


def test_backlash_of_a_hardly_depends_on_the_centre(caused):
    """Steps at 0° and 180°: the same for Y_T = ±200 mm; within 20 % for the offsets of ±50 mm in X.

    The equations do not bear the paper's word for X_T = ±200 mm at 0°: there the step changes by 60 %.
    """
    centre = caused(BACKLASH, 15, [CENTRE])[0]
    for ball, limit in ((Y200, 0.05), (Y_200, 0.05), ((50, 0, 155), 0.2), ((-50, 0, 155), 0.2)):
        trace = caused(BACKLASH, 15, [ball])[0]
        for angle in (0, 180):
            assert step(trace, angle) == pytest.approx(step(centre, angle), rel=limit)
    for ball in (X200, X_200):
        assert step(caused(BACKLASH, 15, [ball])[0], 180) == pytest.approx(step(centre, 180), rel=0.2)


def test_backlash_of_a_at_45(caused):
    """Fig. 13b: with Y offsets the step at 0° is considerably smaller than that at 180°; in the parallel method it
    is not (Fig. 17b).
    """
    for ball in (Y200, Y_200):
        square, level = (caused(BACKLASH, 45, [ball], s)[0] for s in ("perpendicular", "parallel"))
        assert abs(step(square, 0)) < 0.5 * abs(step(square, 180))
        assert abs(step(level, 0)) > 2 * abs(step(square, 0))


def test_backlash_of_a_at_45_with_x_offset(caused):
    """Fig. 16b: the step at 0° hardly depends on the method, the one at 180° is lower in the perpendicular one.

    Fig. 13a: the traces for +200 and −200 mm differ.
    """
    square, level = (caused(BACKLASH, 45, [X200], s)[0] for s in ("perpendicular", "parallel"))
    assert step(square, 0) == pytest.approx(step(level, 0), rel=0.1)
    assert abs(step(square, 180)) < 0.7 * abs(step(level, 180))
    other = caused(BACKLASH, 45, [X_200])[0]
    assert np.std(square - other) > 0.5 * np.std(square)


# --- 3: pitch error of A only (Fig. 10b, 14) ---

PITCH_A = [make("pitch_error.A", components=[[60, 0.002, 0.0]])]


@pytest.mark.parametrize("theta", [15, 45])
def test_pitch_error_of_a_is_mirrored(caused, theta):
    """A comes back the way it went: mirror-symmetric about the 0–180° line but for the drive's lag (4 % of the
    wheel's wave at 15°).
    """
    trace = caused(PITCH_A, theta, [CENTRE])[0]
    difference = trace - np.roll(trace[::-1], 1)
    assert np.std(difference) < {15: 0.1, 45: 0.3}[theta] * np.std(trace)  # A is three times as fast at 45°


@pytest.mark.parametrize(
    ("theta", "key"), [(15, "A_peaks_between_0_and_180_15_10"), (45, "A_peaks_between_0_and_180_45_30")]
)
def test_cycles_of_the_60_tooth_wheel(caused, paper, theta, key):
    assert paper["worm"]["A_teeth"] == 60
    trace = caused(PITCH_A, theta, [CENTRE])[0]
    for half in (trace[:1800], trace[1800:]):
        peaks, _ = find_peaks(half, prominence=0.2 * np.ptp(half))
        assert len(peaks) == paper["worm"][key]


def test_pitch_error_of_a_does_not_depend_on_the_centre(caused):
    """At 15°: the same three cycles at all offsets, the same shape within 20 % at the offsets of ±50 mm."""
    centre = caused(PITCH_A, 15, [CENTRE])[0]
    for trace in caused(PITCH_A, 15, OFFSETS):
        for half in (trace[:1800], trace[1800:]):
            assert len(find_peaks(half, prominence=0.2 * np.ptp(half))[0]) == 3
    for trace in caused(PITCH_A, 15, [(50, 0, 155), (-50, 0, 155), (0, 50, 155), (0, -50, 155)]):
        assert np.std(trace - centre) < 0.2 * np.std(centre)


def test_pitch_error_of_a_at_45_depends_on_the_centre(caused):
    """Fig. 14: with X offsets the right half changes; with Y_T > 0 the error appears in the upper half, with Y_T <
    0 in the lower one.
    """
    x_plus, x_minus, plus, minus = caused(PITCH_A, 45, OFFSETS)
    upper, lower = within(20, 160), within(200, 340)
    assert np.std(plus[upper]) > 2 * np.std(plus[lower])
    assert np.std(minus[lower]) > 2 * np.std(minus[upper])
    right, left = within(300, 60), within(120, 240)
    assert np.std((x_plus - x_minus)[right]) > 2 * np.std((x_plus - x_minus)[left])


# --- 4: pitch error of C only (Fig. 11, 15, 16d, 17d) ---

AMPLITUDE = 0.0025


@pytest.fixture(scope="module")
def wave_of_c(caused):
    """``wave_of_c(theta, ball, sensitive)``: local amplitude (µm) and phase (rad) of the 72-tooth wheel's wave in the
    reading.

    Two simulations a quarter of a wave apart give both at every angle.
    """

    def run(theta, ball, sensitive="perpendicular"):
        sine, cosine = (
            caused([make("pitch_error.C", components=[[72, AMPLITUDE, p]])], theta, [ball], sensitive)[0]
            for p in (0.0, 90.0)
        )
        return np.hypot(sine, cosine), np.unwrap(np.arctan2(sine, cosine))

    return run


def test_pitch_error_of_c_is_hidden_on_the_centreline(caused):
    for theta in (15, 45):
        for sensitive in ("perpendicular", "parallel"):
            trace = caused(
                [make("pitch_error.C", components=[[72, AMPLITUDE, 0.0], [360, AMPLITUDE, 0.0]])],
                theta,
                [CENTRE],
                sensitive,
            )[0]
            assert np.abs(trace).max() < 0.01


@pytest.mark.parametrize("theta", [15, 45])
@pytest.mark.parametrize(("x", "y"), [(1, 0), (0, 1)])
def test_pitch_error_of_c_is_proportional_to_the_offset(wave_of_c, theta, x, y):
    near, far = (wave_of_c(theta, (x * r, y * r, 155))[0] for r in (50, 200))
    np.testing.assert_allclose(far, 4 * near, rtol=0, atol=0.01 * far.max())
    back = wave_of_c(theta, (-x * 200, -y * 200, 155))[0]
    np.testing.assert_allclose(back, far, rtol=0, atol=0.01 * far.max())


def test_pitch_error_of_c_with_x_offset(wave_of_c):
    """Largest at 90° and 270°, smallest at 0° and 180°; there the amplitude is the angle times the offset."""
    size, _ = wave_of_c(15, X200)
    top = np.radians(AMPLITUDE) * 200e-3 / UM
    for angle in (90, 270):
        assert at(size, angle) == pytest.approx(size.max(), rel=0.05)
        assert at(size, angle) == pytest.approx(top, rel=0.05)
    for angle in (0, 180):
        assert at(size, angle) < 0.05 * size.max()


def test_pitch_error_of_c_with_y_offset(wave_of_c):
    """The other way round, and its period is longest at 0° and shortest at 180°."""
    size, phase = wave_of_c(15, Y200)
    for angle in (0, 180):
        assert at(size, angle) > 0.9 * size.max()
    assert size[within(60, 120)].min() < 0.05 * size.max()
    assert size[within(240, 300)].min() < 0.05 * size.max()
    for angle in (90, 270):
        assert at(size, angle) < 0.3 * size.max()
    # cycles per degree where the wave is large (the phase jumps by half a turn where it changes its sign)
    rate = np.abs(np.diff(phase, append=phase[-1]))
    period = {
        a: 0.2 * np.pi / np.median(rate[(ANGLE > a - 3) & (ANGLE < a + 3)]) for a in (5, 40, 140, 180, 220, 320, 355)
    }
    assert period[5] > period[40] > period[140] > period[180] < period[220] < period[320] < period[355]
    # C turns at 1750°/min where the circle goes at 593°/min, and 72 waves to the turn
    assert period[180] == pytest.approx(
        360 / 72 * (1000 / (100 * np.cos(np.radians(15))) * 180 / np.pi) / 1750, rel=0.05
    )


def test_pitch_error_of_c_at_45_with_y_offset(wave_of_c):
    """Perpendicular: much reduced from 270° to 90°. Parallel: largest at 0°."""
    for ball in (Y200, Y_200):
        square, level = (wave_of_c(45, ball, s)[0] for s in ("perpendicular", "parallel"))
        right, left = within(270, 90), within(90, 270)
        assert np.sqrt(np.mean(square[right] ** 2)) < 0.5 * np.sqrt(np.mean(square[left] ** 2))
        assert square[within(300, 60)].max() < 0.4 * square.max()
        assert at(level, 0) > 0.98 * level.max()
        assert at(level, 0) > 3 * at(square, 0)


def test_pitch_error_of_c_at_45_with_x_offset(wave_of_c):
    """Fig. 15a: as at 15°, largest at 90° and 270°."""
    size, _ = wave_of_c(45, X200)
    assert min(at(size, 90), at(size, 270)) > 5 * max(at(size, 0), at(size, 180))


# --- 5: the sensitive direction (section 5.2) ---

ON_Z = [
    make("thermal_drift.Z", amplitude_um=20.0, time_constant_s=5.0),
    make("servo_gain.Z", ratio=1.1),
    make("backlash.Z", width_um=10.0),
    make("friction.Z", coulomb_Nm=5.0, presliding_rad=0.003),
    make("straightness.EZX", quadratic_um=10.0),
    make("pitch_error.Z", components=[[1, 10.0, 0.0]]),
]


@pytest.mark.parametrize("effect", ON_Z, ids=lambda e: e.id)
@pytest.mark.parametrize("theta", [15, 45])
def test_perpendicular_method_cannot_see_z(caused, effect, theta):
    """What is left is of second order: 20 µm of Z turn a bar of 100 mm into 2 nm; the parallel method sees sin θ of
    it.
    """
    square, level = (caused([effect], theta, [(50, 20, 155)], s)[0] for s in ("perpendicular", "parallel"))
    assert np.abs(square).max() < 0.005
    assert np.abs(level).max() > 0.3


CAUSES = {
    "friction and lag": None,
    "backlash of A": BACKLASH,
    "pitch error of A": PITCH_A,
    "pitch error of C": [make("pitch_error.C", components=[[72, AMPLITUDE, 0.0]])],
}


@pytest.mark.parametrize("cause", CAUSES)
@pytest.mark.parametrize("ball", [X200, Y200])
def test_methods_hardly_differ_at_15(m1, caused, traces, cause, ball):
    """The difference between the methods, as a share of the trace, is below 30 % at 15° and two to ten times that
    at 45°.
    """

    def share(theta):
        square, level = (
            traces(m1, theta, [ball], s)[0]
            if cause == "friction and lag"
            else caused(CAUSES[cause], theta, [ball], s)[0]
            for s in ("perpendicular", "parallel")
        )
        return np.std(square - level) / np.std(square)

    assert share(15) < 0.3
    assert share(45) > 1.4 * share(15)


def test_deflection_is_larger_in_the_perpendicular_method(m1, traces):
    """Fig. 16a and 17a, θ = 45°."""
    for ball in (X200, Y200):
        square, level = (at(traces(m1, 45, [ball], s)[0], 180) for s in ("perpendicular", "parallel"))
        assert square < level < 0
