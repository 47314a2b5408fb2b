"""NC programs as posts write them: arcs, tilted planes, cycles, several paths, in the words of four controls."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.program import driven_by
from mjsim.machine.chain import FIVE_AXIS, Placement, chain_of
from mjsim.machine.kinematics import rotation, spindle_in_work, tool_direction, work_to_machine
from mjsim.nc.meanings import MEANINGS
from mjsim.nc.read import parse_nc
from mjsim.nc.write import Options, nc_program

DEG = np.pi / 180.0
UNITS = np.array([1e-3, 1e-3, 1e-3, DEG, DEG])
HEAD = "G21 G90 G94 G54\nG0 X0. Y0. Z0. A0. C0.\n"
STARTS = {
    "fanuc": HEAD,
    "linuxcnc": HEAD,
    "siemens": "G710 G90 G94 G54\nG0 X0 Y0 Z0 A0 C0\n",
    "heidenhain": "0 BEGIN PGM T MM\n1 L X+0 Y+0 Z+0 A+0 C+0 R0 FMAX\n",
}
ENDS = {"heidenhain": "\nL X+1 F100\nEND PGM T MM\n"}


def read(text, dialect="fanuc", head=None, **how):
    """A program with a start at zero; ``head`` in place of it."""
    return parse_nc((STARTS[dialect] if head is None else head) + text, Path("p.nc"), dialect, **how)


def points(nc):
    """Points in mm and degrees, in the coordinates of their blocks."""
    return nc.motion.points / UNITS


@pytest.mark.parametrize(
    ("name", "dialect"),
    [("p.mpf", "siemens"), ("p.SPF", "siemens"), ("p.ngc", "linuxcnc"), ("p.h", "heidenhain"), ("p.nc", "fanuc")],
)
def test_the_ending_says_whose_program_it_is(name, dialect):
    start = STARTS.get(dialect, STARTS["fanuc"])
    text = start + ENDS.get(dialect, "G1 X1. F100.\nM30\n")
    assert parse_nc(text, Path(name)).dialect == dialect
    if dialect != "linuxcnc":  # its words are those of Fanuc
        assert parse_nc(text, Path("p.txt")).dialect == dialect


# -- arcs --------------------------------------------------------------------------------------------------------------

PLANES = {"G17": (0, 1, 2, "X", "Y", "Z"), "G18": (2, 0, 1, "Z", "X", "Y"), "G19": (1, 2, 0, "Y", "Z", "X")}


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("code", ["G2", "G3"])
def test_arcs_and_helices_in_three_planes(plane, code):
    """A quarter from (30, 0) about the origin of the plane, clockwise or not, rising by 8 mm: a closed form."""
    i, j, k, first, second, up = PLANES[plane]
    centre = "IJK"[i]
    sign = 1.0 if code == "G3" else -1.0
    nc = read(f"G1 {first}30. F600.\n{plane} {code} {first}0. {second}{30 * sign:g}. {up}8. {centre}-30. C10.\nM30\n")
    p = points(nc)[2:]
    angle = np.arctan2(sign * p[:, j], p[:, i])
    assert np.abs(np.hypot(p[:, i], p[:, j]) - 30.0).max() < 1e-9
    assert (np.diff(angle) > 0.0).all() and angle[-1] == pytest.approx(np.pi / 2)
    np.testing.assert_allclose(p[:, k], 8.0 * angle / (np.pi / 2), atol=1e-9)
    np.testing.assert_allclose(p[:, 4], 10.0 * angle / (np.pi / 2), atol=1e-9)
    step = angle[1] - angle[0]
    assert 30.0 * (1.0 - np.cos(step / 2)) < 1.01e-4, "chords lie within 0.1 µm of the arc"
    length = np.hypot(30.0 * np.pi / 2, 8.0)
    assert nc.motion.seconds[1:].sum() == pytest.approx(60.0 * np.hypot(length, 10.0) / 600.0, rel=1e-3)


@pytest.mark.parametrize(("radius", "sweep"), [(20.0, np.pi / 2), (-20.0, 1.5 * np.pi)])
@pytest.mark.parametrize("code", ["G2", "G3"])
def test_radius_of_an_arc(radius, sweep, code):
    """A radius above 0 is the arc of less than half a turn, below 0 the other one."""
    nc = read(f"G1 X20. F600.\n{code} X0. Y20. R{radius}\nM30\n")
    p = points(nc)[1:, :2]
    length = np.linalg.norm(np.diff(p, axis=0), axis=1).sum()
    assert length == pytest.approx(20.0 * sweep, rel=1e-4)
    ends = np.array([[20.0, 0.0], [0.0, 20.0]])
    centre = np.array([0.0, 0.0]) if (code == "G3") == (radius > 0) else np.array([20.0, 20.0])
    np.testing.assert_allclose(np.linalg.norm(p - centre, axis=1), 20.0, atol=1e-9)
    np.testing.assert_allclose(p[[0, -1]], ends, atol=1e-12)


def test_whole_circles_and_turns():
    whole = points(read("G1 X10. F600.\nG2 I-10.\nM30\n"))[1:]
    assert np.linalg.norm(np.diff(whole[:, :2], axis=0), axis=1).sum() == pytest.approx(20 * np.pi, rel=1e-4)
    for dialect, text in (
        ("linuxcnc", "G1 X10 F600\nG3 X10 Y0 I-10 Z6 P3\nM2\n"),
        ("siemens", "G1 X10 F600\nG3 X10 Y0 I-10 J0 Z6 TURN=2\nM30\n"),
        ("heidenhain", "L X+10 R0 F600\nCC X+0 Y+0\nCP IPA+1080 IZ+6 DR+\nEND PGM T MM\n"),
    ):
        p = points(read(text, dialect))[1:]
        assert np.unwrap(np.arctan2(p[:, 1], p[:, 0]))[-1] == pytest.approx(6 * np.pi), dialect
        assert p[-1, 2] == pytest.approx(6.0) and p[len(p) // 2, 2] == pytest.approx(3.0, abs=0.01)


def test_arcs_that_are_none_are_said():
    spiral = read("G1 X10. F600.\nG2 X-9. Y0. I-10.\nM30\n")
    radius = np.hypot(*points(spiral)[1:, :2].T)
    assert "end is 9.000 mm" in spiral.warnings[0] and radius[-1] == pytest.approx(9.0)
    assert (np.diff(radius) < 0).all()
    line = read("G2 X10. F600.\nM30\n")
    assert len(line.motion.seconds) == 1 and "3403" in line.warnings[0]


# -- corners -----------------------------------------------------------------------------------------------------------


def test_roundings_and_chamfers_in_closed_form():
    """Of a square corner: a quarter circle of 2 mm, a chamfer with legs of 1 mm, one whose length is 1 mm."""
    for dialect, words in (("siemens", ("RND=2", "CHR=1", "CHF=1")), ("fanuc", (",R2.", ",C1.", None))):
        for word, way in zip(words, (np.pi, np.sqrt(2.0), 1.0), strict=True):
            if word is None:
                continue
            nc = read(f"G1 X10. F600. {word}\nY10.\nM30\n", dialect)
            p = points(nc)[:, :2]
            leg = {0: 2.0, 1: 1.0, 2: np.sqrt(0.5)}[words.index(word)]
            begin = int(np.argmin(np.linalg.norm(p - [10.0 - leg, 0.0], axis=1)))
            end = int(np.argmin(np.linalg.norm(p - [10.0, leg], axis=1)))
            np.testing.assert_allclose(p[[begin, end]], [[10.0 - leg, 0.0], [10.0, leg]], atol=1e-9)
            bow = np.linalg.norm(np.diff(p[begin : end + 1], axis=0), axis=1).sum()
            assert bow == pytest.approx(way, rel=1e-4)
            total = np.linalg.norm(np.diff(p, axis=0), axis=1).sum()
            assert nc.motion.duration == pytest.approx(total / 10.0, rel=1e-3)
    klartext = read("L X+10 R0 F600\nRND R2\nL Y+10\nEND PGM T MM\n", "heidenhain")
    np.testing.assert_allclose(points(klartext), points(read("G1 X10. F600. ,R2.\nY10.\nM30\n")), atol=1e-9)


# -- tilted planes and directions of the tool --------------------------------------------------------------------------

TILTS = {
    "FANUC, Euler angles": ("fanuc", "G68.2 X10. Y5. Z0. I20. J30. K-15.\nG53.1\nG43 H1 G0 X0. Y0. Z5.\n"),
    "HEIDENHAIN, Euler angles": (
        "heidenhain",
        "CYCL DEF 7.0 DATUM SHIFT\nCYCL DEF 7.1 X+10\nCYCL DEF 7.2 Y+7\nCYCL DEF 7.2 IY-2\n"
        "PLANE EULER EULPR+20 EULNU+30 EULROT-15 TURN FMAX\nL X+0 Y+0 Z+5 R0 FMAX\n",
    ),
    "Sinumerik, axis by axis": (
        "siemens",  # about Z, then the new X: MODE has the axes 3, 1, 3 in pairs of bits
        'CYCLE800(0,"T",0,55,10,5,0,20,30,-15,0,0,0,-1,,1)\nG0 X0 Y0 Z5\n',
    ),
}


@pytest.mark.parametrize("case", TILTS)
def test_tilted_planes(case):
    """The same plane in three languages: places lie at origin + Rz Rx Rz · place, the tool is normal to it."""
    dialect, text = TILTS[case]
    path = {"heidenhain": "L Z+0 F600\nL X+20\nL Y+10\n"}.get(dialect, "G1 Z0. F600.\nX20.\nY10.\n")
    nc = read(text + path + ENDS.get(dialect, "M30\n")[: 0 if dialect == "heidenhain" else None], dialect)
    turn = rotation(2, 20 * DEG) @ rotation(0, 30 * DEG) @ rotation(2, -15 * DEG)
    wanted = np.array([[0, 0, 5], [0, 0, 0], [20, 0, 0], [20, 10, 0]]) @ turn.T + [10, 5, 0]
    q = nc.motion.axes
    np.testing.assert_allclose(spindle_in_work(FIVE_AXIS, q) * 1e3, wanted, atol=1e-9)
    np.testing.assert_allclose(tool_direction(FIVE_AXIS, q), np.tile(turn[:, 2], (4, 1)), atol=1e-12)
    np.testing.assert_allclose(q[:, :3], work_to_machine(FIVE_AXIS, q, wanted * 1e-3), atol=1e-12)  # eq. A.9
    assert np.ptp(q[:, 3:], axis=0).max() == 0.0 and abs(q[0, 3]) == pytest.approx(30 * DEG)


def test_space_angles_turn_about_fixed_axes():
    nc = read("PLANE SPATIAL SPA+10 SPB+20 SPC+30 TURN FMAX\nL X+0 Y+0 Z+0 FMAX\nL X+10 F600\nEND PGM\n", "heidenhain")
    turn = rotation(2, 30 * DEG) @ rotation(1, 20 * DEG) @ rotation(0, 10 * DEG)
    np.testing.assert_allclose(
        np.diff(spindle_in_work(FIVE_AXIS, nc.motion.axes), axis=0)[0], 0.01 * turn[:, 0], atol=1e-12
    )


def test_the_shorter_way_and_the_wanted_sign():
    """The two ways to a plane differ by half a turn of the table."""
    near = read("G68.2 X0. Y0. Z0. I0. J30. K0.\nG53.1\nG0 X0. Y0. Z0.\nG1 X1. F1.\nM30\n")
    assert points(near)[0, 3:] == pytest.approx([-30.0, 0.0])
    for sign in "+-":
        text = f"PLANE SPATIAL SPA+30 SPB+0 SPC+0 TURN FMAX SEQ{sign}\nL X+0 Y+0 Z+0 FMAX\nL X+1 F100\nEND PGM\n"
        a, c = points(read(text, "heidenhain"))[0, 3:]
        assert a == pytest.approx(30.0 if sign == "+" else -30.0)
        assert abs(c) == pytest.approx(180.0 if sign == "+" else 0.0)


def test_a_frame_that_is_turned_in_its_plane():
    for dialect, text in (
        ("fanuc", "G68 X10. Y0. R90.\nG0 X10. Y0.\nG1 X15. F600.\nG69\nM30\n"),
        ("siemens", "TRANS X10\nAROT Z90\nG0 X0 Y0\nG1 X5 F600\nM30\n"),
    ):
        np.testing.assert_allclose(points(read(text, dialect))[:, :2], [[10, 0], [10, 5]], atol=1e-12)


def test_the_zero_point_stays_shifted_behind_a_tilted_plane():
    shift = "CYCL DEF 7.0 DATUM SHIFT\nCYCL DEF 7.1 X+10\nPLANE SPATIAL SPA+30 SPB+0 SPC+0 TURN FMAX\n"
    nc = read(shift + "PLANE RESET TURN FMAX\nL X+0 Y+0 Z+0 A+0 FMAX\nL X+5 F600\nEND PGM\n", "heidenhain")
    np.testing.assert_allclose(points(nc), [[10, 0, 0, 0, 0], [15, 0, 0, 0, 0]], atol=1e-9)
    nc = read("G52 X10.\nG52 Y5.\nG68 X0. Y0. R90.\nG69\nG0 X0. Y0.\nG1 X5. F600.\nM30\n")
    np.testing.assert_allclose(points(nc)[:, :2], [[10, 5], [15, 5]], atol=1e-12)


VECTORS = {
    "Sinumerik": ("siemens", "TRAORI\nG0 X0 Y0 Z5 A3=0 B3=0 C3=1\nG1 X10 Y0 Z4 A3=1 B3=0.5 C3=3 F600\nTRAFOOF\nM30\n"),
    "FANUC": ("fanuc", "G43.5 H1\nG0 X0. Y0. Z5. I0. J0. K1.\nG1 X10. Y0. Z4. I1. J.5 K3. F600.\nG49\nM30\n"),
}


@pytest.mark.parametrize("case", VECTORS)
def test_directions_of_the_tool(case):
    """The tip goes straight; the tool turns on a great circle, evenly."""
    dialect, text = VECTORS[case]
    nc = read(text, dialect)
    q = nc.motion.at(np.linspace(0.0, nc.motion.duration, 50))
    tip = spindle_in_work(FIVE_AXIS, q) * 1e3
    share = tip[:, 0] / 10.0
    np.testing.assert_allclose(tip, np.outer(1 - share, [0, 0, 5]) + np.outer(share, [10, 0, 4]), atol=1e-9)
    last = np.array([1.0, 0.5, 3.0]) / np.linalg.norm([1.0, 0.5, 3.0])
    tool = tool_direction(FIVE_AXIS, nc.motion.axes)
    np.testing.assert_allclose(tool[-1], last, atol=1e-12)
    normal = np.cross([0, 0, 1.0], last)
    assert np.abs(tool @ normal / np.linalg.norm(normal)).max() < 1e-9
    angle = np.arccos(np.clip(tool[:, 2], -1, 1))
    np.testing.assert_allclose(np.diff(angle), angle[-1] / (len(angle) - 1), rtol=1e-6)


def test_tool_centre_modes_say_the_same():
    tips = "X10{0} Y5{0} Z2{0} A10{0} C20{0}", "X20{0} Y0{0} Z1{0} A15{0} C40{0}"
    start = "G0 X0{0} Y0{0} Z0{0} A5{0} C0{0}"
    point, none = ([t.format(d) for t in (start, *tips)] for d in (".", ""))
    texts = {
        "fanuc": f"G43.4 H1\n{point[0]}\nG1 {point[1]} F600.\n{point[2]}\nG49\nM30\n",
        "siemens": f"TRAORI\n{none[0]}\nG1 {none[1]} F600\n{none[2]}\nTRAFOOF\nM30\n",
        "linuxcnc": f"M428\n{none[0]}\nG1 {none[1]} F600\n{none[2]}\nM429\nM2\n",
        "heidenhain": "L M128\nL X+0 Y+0 Z+0 A+5 C+0 FMAX\nL X+10 Y+5 Z+2 A+10 C+20 F600\n"
        "L X+20 Y+0 Z+1 A+15 C+40\nL M129\nEND PGM\n",
    }
    found = {d: read(t, d).motion for d, t in texts.items()}
    for d, motion in found.items():
        assert motion.tip is True, d
        np.testing.assert_allclose(motion.points, found["fanuc"].points, atol=1e-12)
        np.testing.assert_allclose(motion.seconds, found["fanuc"].seconds, rtol=1e-12)
    iso = "%T G71 *\nN10 G00 G40 G90 X+0 Y+0 Z+0 A+0 C+0 *\nN20 M128 *\nN30 G00 A+5 X+0 Y+0 Z+0 *\n"
    iso += "N40 G01 X+10 Y+5 Z+2 A+10 C+20 F600 *\nN50 X+20 Y+0 Z+1 A+15 C+40 *\nN60 M129 M30 *\nN99 %T G71 *\n"
    np.testing.assert_allclose(read(iso, "heidenhain", head="").motion.points, found["fanuc"].points, atol=1e-12)


def test_the_axes_rest_when_tool_centre_control_is_switched():
    """M128 and M428 change the coordinates, not the axes: the next block goes on from where these are."""
    nc = read("G0 X10 Y0 Z0 C90\nG1 Z2 F100\nM428\nG1 Z0\nM429\nG1 X11\nM2\n", "linuxcnc")
    q = points(nc)
    np.testing.assert_allclose(q[2], [0, -10, 0, 0, 90], atol=1e-12)  # in the work frame
    np.testing.assert_allclose(nc.motion.axes[2] / UNITS, [10, 0, 0, 0, 90], atol=1e-12)
    assert nc.motion.tip.tolist() == [False, True, False]
    middle = nc.motion.at(np.array([nc.motion.knots[1] + 0.5 * nc.motion.seconds[1]]))[0]
    np.testing.assert_allclose(middle / UNITS, [10, 0, 1, 0, 90], atol=1e-12)


# -- several paths -----------------------------------------------------------------------------------------------------

PATHS = (
    "G1 X10. F600.\nY10.\nG0 Z50.\nG4 P500\nX0. Y0.\nM0\nG1 Z0. F600.\nX-10.\nG28 G91 Z0.\nG90\nT2 M6\n"
    "G43 H2 G0 X0. Y0. Z20.\nG1 Z5. F300.\nG0 Z50.\nM30\n"
)


def test_paths_rapid_moves_dwells_and_stops():
    nc = read(PATHS)
    m = nc.motion
    assert [(nc.lines[a + 1], nc.lines[b + 1]) for a, b in m.paths] == [(3, 4), (9, 10), (15, 15)]
    assert m.cutting.tolist() == [True, True, False, False, False, True, True, False, True]
    assert m.seconds[m.cutting] == pytest.approx([1.0, 1.0, 5.0, 1.0, 3.0])
    dwell = int(np.flatnonzero(nc.lines[1:] == 6)[0])
    assert m.seconds[dwell] == pytest.approx(0.5) and m.stops[[dwell - 1, dwell]].all()
    assert m.stops.tolist() == [False, False, *[True] * 3, False, True, True, False], "rapid moves end in position"
    assert read(PATHS, "linuxcnc").motion.stops.tolist() == [False, False, True, *[True] * 2, False, True, True, False]
    assert "straight rapid move" in nc.warnings[0] and {"T", "M6", "H"} <= set(nc.ignored)
    np.testing.assert_allclose(m.axes[m.paths[2][0]] / UNITS, [0, 0, 20, 0, 0], atol=1e-12)
    with pytest.raises(InputError, match=r"line 12: G91 with Z before Z has a known place"):
        read(PATHS.replace("G28 G91 Z0.", "G28 Z0.\nG91 Z1."))


def test_a_test_is_driven_by_its_own_path(circle):
    """Of several paths in a file, that of the test; exact stops within it are refused."""
    test = replace(circle("XY", (0, 0, 155)), name="t")
    text = nc_program(test, Options(step_deg=2.0)).text
    alone = driven_by(test, parse_nc(text, Path("t.nc")).motion)
    before = "G0 X0. Y0. Z300. A0. C0.\nG1 X-5. F500.\nG0 Z350.\n"
    both = parse_nc(text.replace("G94\n", "G94\n" + before, 1), Path("t.nc"))
    assert len(both.motion.paths) == 2
    np.testing.assert_array_equal(driven_by(test, both.motion).commanded.points, alone.commanded.points)
    with pytest.raises(InputError, match=r"the axes stop within the path .* path mode"):
        driven_by(test, parse_nc(text.replace("G64\n", "G61\n", 1), Path("t.nc")).motion)


def test_exact_stops():
    square = "G1 X20. F3000.\nY20.\nX0.\nY0.\nM30\n"
    assert read("G64\n" + square).motion.stops is None
    assert read("G61\n" + square).motion.stops.tolist() == [True] * 4
    once = read("G1 X20. F3000.\nG9 Y20.\nX0.\nY0.\nM30\n")
    assert once.motion.stops.tolist() == [False, True, False, False]
    for dialect, text in (("siemens", "G60\n"), ("linuxcnc", "G61\n"), ("linuxcnc", "G61.1\n")):
        assert read(text + square, dialect).motion.stops.all()
    assert read("G61.1\n" + square).motion.stops is None  # of Mazak and others a path mode


# -- roll-over ---------------------------------------------------------------------------------------------------------

TURNS = "G0 A-20. C350.\nG43.4 X20. Y0. Z10. H1\nG1 Z0. F1000.\nX21. C354.\nX22. C358.\nX23. C{0}.\nX24. C{1}.\nM30\n"


def test_a_table_that_goes_over_360_degrees():
    wrapped, unwrapped = (TURNS.format(*c) for c in ((2, 6), (362, 366)))
    for how in ({}, {"rollover": True}):
        np.testing.assert_allclose(read(wrapped, **how).motion.points, read(unwrapped, **how).motion.points, atol=1e-12)
    assert "taken the short way" in read(wrapped).warnings[0] and not read(wrapped, rollover=True).warnings
    assert points(read(wrapped, rollover=False))[-1, 4] == pytest.approx(6.0)
    fanuc = "G90 C0.\nG1 X1. C-150. F100.\nX2. C540.\nX3. C-620.\nG91 X1. C380.\nC-840.\nM30\n"  # B-63534EN/02, 20.2
    moved = np.diff(points(read(fanuc, rollover=True))[:, 4])
    assert moved == pytest.approx([-150.0, -30.0, -80.0, 380.0, -840.0])
    text = "G0 X0 C350\nG1 X1 C={0} F100\nM30\n"
    for word, end in (("DC(10)", 370.0), ("ACP(10)", 370.0), ("ACN(10)", 10.0), ("AC(10)", 10.0), ("IC(10)", 360.0)):
        assert points(read(text.format(word), "siemens"))[-1, 4] == pytest.approx(end), word
    short = "L C+350 FMAX\nL M126\nL X+1 C+10 F100\nL M127\nL X+2 C+350\nEND PGM\n"
    assert points(read(short, "heidenhain", rollover=False))[:, 4] == pytest.approx([350.0, 370.0, 350.0])
    signed = "G0 C350\nG1 X1 C10 F100\nX2 C-20\nM2\n"  # a wrapped axis of LinuxCNC
    assert points(read(signed, "linuxcnc", rollover=True))[:, 4] == pytest.approx([350.0, 370.0, 20.0])
    assert points(read(signed, "linuxcnc"))[:, 4] == pytest.approx([350.0, 10.0, -20.0])


# -- cycles ------------------------------------------------------------------------------------------------------------


def heights(nc):
    """Z after every block, with * for feed blocks."""
    cutting = np.ones(len(nc.motion.seconds), bool) if nc.motion.cutting is None else nc.motion.cutting
    return [f"{z:g}{'*' if c else ''}" for z, c in zip(points(nc)[1:, 2], cutting, strict=True)]


def test_drilling_cycles_are_their_moves():
    start = "G0 Z50.\nG0 X10. Y10.\n"
    two = read(start + "G98 G81 Z-10. R2. F200.\nX20.\nG80\nG0 Z60.\nM30\n")
    assert heights(two) == ["-10*", "2", "50", "50", "2", "-10*"]
    assert points(two)[-1, :2] == pytest.approx([20.0, 10.0])
    low = read(start + "G99 G81 Z-10. R2. F200.\nX20.\nG80\nM30\n")
    assert heights(low) == ["-10*", "2", "2", "-10*"]
    assert low.motion.seconds[[0, -1]] == pytest.approx(60.0 * 12.0 / 200.0)
    peck = read(start + "G99 G83 Z-10. R2. Q5. F200.\nG80\nM30\n")
    assert heights(peck) == ["-3*", "2", "-2", "-8*", "2", "-7", "-10*"]
    assert "1 mm" in peck.warnings[0]
    chip = read("G0 Z50\nG0 X10 Y10\nG99 G73 X10 Y10 Z-10 R2 Q6 F200\nG80\nM2\n", "linuxcnc")
    assert heights(chip) == ["-4*", "-3.746", "-10*"]
    bored = read(start + "G99 G85 Z-10. R2. F200.\nG80\nM30\n")
    assert heights(bored) == ["-10*", "2*"]
    rows = read(start + "G91 G99 G81 X5. Z-12. R-48. L3 F200.\nG90 G80\nM30\n")
    assert points(rows)[np.flatnonzero(np.array(heights(rows)) == "-10*") + 1, 0] == pytest.approx([15.0, 20.0, 25.0])
    called = read("G0 X10 Y10 Z10\nF200\nMCALL CYCLE82(10,0,2,-5,,1)\nX20\nX30\nMCALL\nG0 X0\nM30\n", "siemens")
    assert heights(called) == ["-5*", "-5", "2", "10", "10", "2", "-5*"]
    assert called.motion.seconds[1] == pytest.approx(1.0)
    deep = "CYCL DEF 200 DRILLING ~\n Q200=2 ~\n Q201=-10 ~\n Q206=+200 ~\n Q202=5 ~\n Q210=0 ~\n Q203=+0 ~\n Q204=20\n"
    told = read("L X+10 Y+10 Z+20 R0 FMAX\n" + deep + "CYCL CALL\nL X+20 FMAX M3\nCYCL CALL\nEND PGM\n", "heidenhain")
    assert heights(told)[:7] == ["-3*", "2", "-2", "-8*", "2", "-7", "-10*"]


# -- words -------------------------------------------------------------------------------------------------------------

#: Words that are read, words that are listed, and words that are refused with what names them.
READ = {
    "fanuc": ["G9 G1 X5. F100.", "N0010M8", "M8;coolant", "G17G1X5.F100.", "g1 x5. f100.", "G1 X 5. F 100.", "#1=5",
              "#2=2.\nG1 X[#2*2.5] F100.", "(a (nested) comment)", "; text", "% text", "O1234(NAME)", "O<name>",
              "<PART>", "N10", "", "\t", "G1 X5. F100. ;", "X5. F100. G1", "G52 X1.", "G92 X0.", "G68 X0. Y0. R45.",
              "G28 Z0.\nG0 Z1.", "G4 P1000", "G4 X1.", "G61", "G64", "G43.4 H1", "G234 H1", "G49", "G54"],
    "siemens": ["G1 X=5 F100", "G1 X=IC(5) F100", "R1=5\nG1 X=R1 F100", "TRAORI(1)", "TRAFOOF", "TRANS X10",
                "AROT Z5", "FGROUP(X,Y,Z)", "FGREF[A]=10", "G4 F1", "G700", "G71", "g1 x5f100", ":10 G1 X5 F100",
                "G1 X5 F=500", "N10 G1 X5 F100 ; comment (with bracket)", "%_N_PART_MPF", ";$PATH=/_N_MPF_DIR",
                "G641 ADIS=0.1", "G9"],
    "linuxcnc": ["G1 X5 F100 (comment)", "G64 P0.01", "G61.1", "M428", "G43 H1", "G90.1", "G91.1", "G92 X0", "G92.1",
                 "G8", "G1 x5 F100", "(MSG, hi)", "G4 P0.5", "G4 P0.5 G0 X1"],
    "heidenhain": ["L X+5 R0 F100 M3", "L IX+5 F100", "CC X+1 Y+2", "CC X+0 Y+5\nC X+0 Y+10 DR+ F100", "LBL 1",
                   "CR X+5 R+5 DR- F100", "Q1 = +5\nL X+Q1 F100", "FN 0: Q2 = +3", "STOP", "* - a heading",
                   "; comment", "FUNCTION TCPM F TCP AXIS POS PATHCTRL AXIS\nL X+1 F100\nFUNCTION RESET TCPM",
                   "CYCL DEF 9.0 DWELL\nCYCL DEF 9.1 DWELL 2"],
}  # fmt: skip
LISTED = {
    "fanuc": {"G5 P10000": "G5", "G05.1 Q1 R5": "G5.1", "G187 P1": "G187", "M11": "M11", "S1000": "S", "T1M6": "M6",
              "G40": "G40", "G61.1": "G61.1", "M1": "M1", "D1": "D", "G97 S100": "G97"},
    "siemens": {"ORIWKS": "ORIWKS", "CYCLE832(0.01,_ORI_FINISH,0.1)": "CYCLE832(0.01,_ORI_FINISH,0.1)",
                "COMPCAD": "COMPCAD", "SOFT": "SOFT", "FFWON": "FFWON", "T=\"MILL\" D1": "T",
                "MSG(\"hello; all\")": "MSG", "STOPRE": "STOPRE", "WORKPIECE(,,,\"BOX\",112)": "WORKPIECE",
                "G642": "G642", "CUT3DC": "CUT3DC"},
    "linuxcnc": {"G64 P0.01 Q0": "G64 P0.01 Q0", "M61 Q1": "M61", "M62 P0": "M62", "M1": "M1"},
    "heidenhain": {"BLK FORM 0.1 Z X-50 Y-50 Z-40": "BLK", "TOOL CALL 3 Z S1000": "TOOL CALL", "LBL 1": "LBL",
                   "CYCL DEF 247 DATUM SETTING ~\n Q339=+1": "CYCL DEF 247",
                   "CYCL DEF 32.0 TOLERANCE": "CYCL DEF 32", "M8": "M8"},
}  # fmt: skip
REFUSED = {
    "fanuc": {"G41 D1": "G41", "G65 P9000 A1.": "G65", "M98 P2000": "M98", "M97 P10": "M97", "M200": "M200",
              "G10 L2 P1": "G10", "IF [#1 EQ 1] GOTO 5": "IF [#1 EQ 1]", "G1 X#1 F100.": "#1", "G7.1 C50.": "G7.1",
              "G12.1": "G12.1", "G33 Z5. K1.": "G33", "G51 X2.": "G51", "G1 U5. F100.": "U5",
              "G1 X5. B3. F100.": "B3", "G43.1 Z5.": "G43.1", "G95 F0.1": "G95", "G55": "G55", "G1 X5. E1 F1.": "E1",
              "TCPM": "TCPM", "G254": "G254", "G1 X5.Q1. F1.": "Q1", "G68.2 X0. P9. I0. J0. K0.": "G68.2 P9"},
    "siemens": {"G41": "G41", "SUB1": "SUB1", "L100": "L100", "EXTCALL(\"a.spf\")": "EXTCALL", "G95": "G95",
                "G33": "G33", "$P_UIFR[1]=CTRANS(X,0)": "$P_UIFR[1]", "DEF REAL A": "DEF", "WHILE R1<5": "WHILE",
                "G1 X=R9 F1": "R9", "CYCLE800(0,\"T\",0,192,0,0,0,30,0,0,0,0,0,1,,1)": "CYCLE800 with MODE 192",
                "TRAANG": "TRAANG", "SCALE X2": "SCALE", "G1 A3=1 F1": "TRAORI", "POCKET3(1,2)": "POCKET3",
                "RND=1": "RND", "G4 S3": "revolutions", "G1 POS[X]=5 F1": "POS[X]", "G505": "G505"},
    "linuxcnc": {"G43.4 H1": "G43.4", "G5 X1 Y1 I0 J0 P0 Q1": "G5", "G38.6 Z-1 F10": "G38.6", "G41.1 D5": "G41.1",
                 "G7": "G7", "M66 P0 L3": "M66", "M100": "M100", "M68 E3 Q1": "M68", "G9": "G9", "G59.1": "G59.1"},
    "heidenhain": {"L X+5 RL F100": "RL", "CALL LBL 1 REP 3": "CALL LBL 1", "CALL PGM A": "CALL PGM",
                   "APPR LT X+5": "APPR", "FN 9: IF +Q1 EQU +Q2 GOTO LBL 1": "FN 9",
                   "CYCL DEF 207 TAPPING": "CYCL DEF 207", "CT X+5 Y+5": "CT", "L X+5 F100 M136": "M136",
                   "L X+5 B+3 F100": "B3", "C X+5 Y+5 DR+": "C without its centre",
                   "FUNCTION TCPM F CONT AXIS SPAT PATHCTRL AXIS": "TCPM", "L X+Q7 F100": "Q7",
                   "CYCL DEF 8.0 MIRROR": "CYCL DEF 8", "M94": "M94", "PLANE RELATIV SPB+5 STAY": "RELATIV"},
}  # fmt: skip


def cases(table):
    return [
        pytest.param(d, text, id=f"{d} {text.splitlines()[0] if text else 'empty'}") for d in table for text in table[d]
    ]


def body(dialect, text):
    end = ENDS.get(dialect, "\nG1 X10. Y0. Z9. F1000.\nX20. Y1. A-1. C2.\nM30\n")
    return text + (end.replace("L X+1", "L X+1 Y+0 Z+9 A-1") if dialect == "heidenhain" else end)


@pytest.mark.parametrize(("dialect", "text"), cases(READ))
def test_words_that_are_read(dialect, text):
    assert len(read(body(dialect, text), dialect).motion.seconds) >= 1


@pytest.mark.parametrize(("dialect", "text"), cases(LISTED))
def test_words_that_change_nothing_are_listed_once(dialect, text):
    nc = read(body(dialect, f"{text}\n{text}"), dialect)
    word = LISTED[dialect][text]
    line, count = nc.ignored[word]
    assert (line, count) == (3, 2)
    plain = read(body(dialect, ""), dialect)
    np.testing.assert_array_equal(nc.motion.points, plain.motion.points)
    np.testing.assert_allclose(nc.motion.seconds, plain.motion.seconds)


@pytest.mark.parametrize(("dialect", "text"), cases(REFUSED))
def test_words_that_are_not_understood_are_refused_by_name(dialect, text):
    with pytest.raises(InputError) as error:
        read(body(dialect, text), dialect)
    said = str(error.value)
    assert said.startswith("p.nc, line 3: ") and "allowed" in said and REFUSED[dialect][text] in said, said


@pytest.mark.parametrize("dialect", ["fanuc", "siemens", "linuxcnc"])
def test_every_code_is_in_the_table_or_named(dialect):
    """All G codes to 999 with one decimal: none is passed over in silence."""
    table = MEANINGS[dialect].g
    for g in [*range(1000), *(n + d / 10 for n in range(100) for d in range(1, 10))]:
        if g in table or (dialect, g) == ("linuxcnc", 10):  # G10 goes to the interpreter
            continue
        with pytest.raises(InputError, match=rf"line 3: G{g:g}\b"):
            read(body(dialect, f"G{g:g}"), dialect)


def test_random_letters_are_named():
    """A word of any letter with any number in a feed block either moves an axis, is listed, or is named."""
    rng = np.random.default_rng(5)
    for letter in "ABCDEHIJKLOPQRSTUVW":
        value = rng.integers(1, 9)
        try:
            nc = read(f"G1 X5. F100. {letter}{value}.\nM30\n")
        except InputError as error:
            assert f"{letter}{value}" in str(error)
        else:
            assert letter in nc.ignored or letter in "AC"


# -- switches, units, other machines -----------------------------------------------------------------------------------


def test_blocks_with_a_stroke_are_a_switch():
    text = "G1 X10. F600.\n/X20.\n/2 Y5.\nN5 /Z1.\nX30.\nM30\n"
    assert points(read(text))[-1, :3] == pytest.approx([30.0, 5.0, 1.0])
    assert points(read(text, skip=True))[-1, :3] == pytest.approx([30.0, 0.0, 0.0])
    assert "carried out" in read(text).warnings[0] and "left out" in read(text, skip=True).warnings[0]


def test_inches_and_inverse_time():
    nc = read("g20\ng93 g1x1.f60.\ng2x2.i.5f30.\ng94\ng1y1.f10.\nm30\n")
    assert points(nc)[1:][-1, :2] == pytest.approx([50.8, 25.4])
    arc = nc.lines[1:] == 5
    assert nc.motion.seconds[0] == pytest.approx(1.0) and nc.motion.seconds[arc].sum() == pytest.approx(2.0)
    assert nc.motion.seconds[-1] == pytest.approx(6.0) and nc.feed == "G93 and G94"


def test_another_machine():
    chain = chain_of("w-C'B'X'bYZ-t")
    text = "G0 X0. Y0. Z50. B0. C0.\nG43.4 H1\nG1 Z0. F1000.\nX10. B-1. C1.\nG49\nM30\n"
    nc = read(text, head="", chain=chain)
    assert nc.motion.tip and points(nc)[-1] == pytest.approx([10.0, 0.0, 0.0, -1.0, 1.0])
    with pytest.raises(InputError, match="the word A1; allowed: X Y Z B C"):
        read(text.replace("B-1.", "A1."), head="", chain=chain)


def test_a_hint_at_the_control():
    with pytest.raises(InputError, match="say --dialect heidenhain"):
        parse_nc(STARTS["heidenhain"], Path("p.h"), "fanuc")
    with pytest.raises(InputError, match="say --dialect siemens"):
        parse_nc("G0 X0 Y0\nTRAORI\n", Path("p.mpf"), "fanuc")


# -- LinuxCNC's interpreter --------------------------------------------------------------------------------------------

INTERPRETED = """\
#<n> = 0
G21 G90 G94
o<hop> sub
  G1 X#1 Y#2 F600
o<hop> endsub
G0 X0 Y0 Z0 A0 C0
o100 while [#<n> lt 3]
  o<hop> call [#<n>*10] [5]
  #<n> = [#<n>+1]
o100 endwhile
G2 X30 Y5 I5
G0 C90
M428
G1 Z-1
M429
G1 X40
M2
"""


@pytest.mark.skipif(
    shutil.which("rs274") is None, reason="rs274 of the Debian package linuxcnc-uspace is not installed"
)
def test_loops_and_subprograms_through_the_interpreter(tmp_path):
    nc = parse_nc(INTERPRETED, tmp_path / "p.ngc", "linuxcnc")
    plain = parse_nc(
        "G21 G90 G94\nG0 X0 Y0 Z0 A0 C0\nG1 X0 Y5 F600\nX10\nX20\nG2 X30 Y5 I5\n"
        "G0 C90\nM428\nG1 Z-1\nM429\nG1 X40\nM2\n",
        Path("p.ngc"),
        "linuxcnc",
    )
    np.testing.assert_allclose(nc.motion.points, plain.motion.points, rtol=0, atol=1e-7)
    np.testing.assert_allclose(nc.motion.seconds, plain.motion.seconds, rtol=1e-4)
    np.testing.assert_array_equal(nc.motion.tip, plain.motion.tip)
    assert nc.lines[[1, 2, 3]].tolist() == [4, 4, 4] and nc.lines[-1] == 16
    (tmp_path / "far.ngc").write_text("o<far> sub\nG1 X7 F600\no<far> endsub\nM2\n")
    near = parse_nc("G21 G0 X0 Y0 Z0 A0 C0\no<far> call\nM2\n", tmp_path / "p.ngc", "linuxcnc")
    assert points(near)[-1, 0] == pytest.approx(7.0)
    for text, words in (
        ("G0 X0\nG1 X[1/0] F1\nM2\n", "line 2: LinuxCNC's interpreter refuses it"),
        ("#1=1\nG38.2 Z-1 F10\nM2\n", "STRAIGHT_PROBE"),
        ("#1=1\nG0 X0\nG1 W#1 F10\nM2\n", "line 3: a move of W"),
        ("#1=1\nG1 B5 F10\nM2\n", "a move of B"),
        ("#1=#<_hal[some.pin]>\nM2\n", "the HAL pin some.pin"),
    ):
        with pytest.raises(InputError, match=words.replace("[", r"\[")):
            parse_nc(text, tmp_path / "p.ngc", "linuxcnc")


BRIDGE = """[RS274NGC]
[KINS]
KINEMATICS = 5axiskins coordinates=xyzbcw
[TRAJ]
LINEAR_UNITS = mm
[EMCIO]
TOOL_TABLE = tools.tbl
"""


@pytest.mark.skipif(
    shutil.which("rs274") is None, reason="rs274 of the Debian package linuxcnc-uspace is not installed"
)
def test_w_of_a_bridge_mill_moves_the_tool_along_itself(tmp_path):
    """LinuxCNC's 5axiskins.c: the joints are where the pivot is, ``s2r`` away from the place in the program."""
    (tmp_path / "mill.ini").write_text(BRIDGE)
    (tmp_path / "tools.tbl").write_text("T1 P1 Z100 D10 ; a drill\n")
    chain = chain_of("w-bYXZCB-t", (("B", Placement(sense="opposite")),), 0.25)

    def read(text):
        return parse_nc(text, tmp_path / "p.ngc", "linuxcnc", chain=chain, ini=tmp_path / "mill.ini")

    zero = "#1=-7\nT1 M6 G43\nG53 G0 Z0\nG10 L20 P0 Z0\n"
    nc = read(zero + "G0 X10 Y20 Z30 B0 C0 W0\nG0 B-35 C50\nG1 W#1 F100\nG0 W3\nG1 Z31 W3\nM2\n")
    p, t = np.radians(180.0 + 35.0), np.radians(50.0)
    ray = np.array([np.sin(p) * np.cos(t), np.sin(p) * np.sin(t), np.cos(p)])
    for (x, y, z), w, at in (((10, 20, -70), -7, 1), ((10, 20, -70), 3, 2), ((10, 20, -69), 3, 3)):
        joints = np.array([x, y, z]) - (250.0 + w) * ray - [0.0, 0.0, 250.0]
        np.testing.assert_allclose(nc.motion.axes[at, :3] * 1e3, joints, rtol=0, atol=2e-4)
    assert nc.motion.seconds[0] == pytest.approx(7 / 100 * 60)
    for text, words in (
        ("#1=0\nG0 X0 Y0 Z0 B0 C0\nG0 W5 B10\nM2\n", "line 3: W and another axis in one block"),
        ("#1=0\nG0 X0 Y0 Z0 B0 C0\nG1 F9 W5 X1\nM2\n", "W and another axis in one block"),
        ("#1=0\nM429\nG1 F9 W5\nM2\n", "without tool centre point control"),
        ("#1=0\nG0 A5\nM2\n", "line 2: a move of A"),
        ("#1=0\nG0 V5\nM2\n", "line 2: a move of V"),
    ):
        with pytest.raises(InputError, match=words):
            read(text)


@pytest.mark.parametrize(("option", "tip"), [("", True), (" sparm=identityfirst", False)])
def test_the_configuration_says_whether_tool_centre_point_control_is_on_at_the_start(tmp_path, option, tip):
    (tmp_path / "mill.ini").write_text(f"[KINS]\nKINEMATICS = xyzac-trt-kins{option}\n")
    text = "G21 G90\nG0 X0 Y0 Z0 A0 C0\nG1 X1 A10 F100\nM2\n"
    nc = parse_nc(text, tmp_path / "p.ngc", "linuxcnc", ini=tmp_path / "mill.ini")
    assert np.all(nc.motion.tip) == tip


@pytest.mark.skipif(
    shutil.which("rs274") is None, reason="rs274 of the Debian package linuxcnc-uspace is not installed"
)
def test_g53_3_turns_and_goes_at_once(tmp_path):
    """To the place in the plane, on a head whose axis leans by 55° as that of LinuxCNC's example does."""
    lean = np.radians(55.0)
    chain = chain_of("w-bXYZCB-t", (("B", Placement((0.0, np.sin(lean), np.cos(lean)))),), 0.25)
    text = "#1=30\nG0 X0 Y0 Z100 B0 C0\nG68.2 X50 Y50 Z-50 Q121 I#1 J15\nG53.3 X10 Y20 Z100\nG0 Z90\nM2\n"
    nc = parse_nc(text, tmp_path / "p.ngc", "linuxcnc", chain=chain)
    turn = Rotation.from_euler("XY", [30.0, 15.0], degrees=True)
    assert nc.lines.tolist()[-3:] == [2, 4, 5]
    for at, place in ((-2, (10, 20, 100)), (-1, (10, 20, 90))):
        tip = spindle_in_work(chain, nc.motion.axes[[at]])[0]
        np.testing.assert_allclose(tip * 1e3, turn.apply(place) + np.array([50, 50, -50]), rtol=0, atol=1e-6)
        tool = tool_direction(chain, nc.motion.axes[[at]])[0]
        np.testing.assert_allclose(tool, turn.apply([0, 0, 1]), rtol=0, atol=1e-9)


def test_without_the_interpreter_it_is_said(monkeypatch, tmp_path):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(InputError, match=r"rs274 \(Debian package linuxcnc-uspace\) reads them and is not installed"):
        parse_nc(INTERPRETED, tmp_path / "p.ngc", "linuxcnc")
