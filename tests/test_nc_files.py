"""NC programs as files: what is written, what is read back, F conventions, limits, and the feed that blocks really
give.
"""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.follow import deviation
from mjsim.instruments.ball_bar.program import Program, driven_by
from mjsim.io.resources import model_file
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.kinematics import machine_to_work, reading, work_to_machine
from mjsim.machine.model import build
from mjsim.nc.control import Control, executed, feed_report
from mjsim.nc.dialects import DIALECTS
from mjsim.nc.limits import model_limits
from mjsim.nc.read import motion_csv, parse_nc, read_nc
from mjsim.nc.write import Options, nc_program, write_nc
from mjsim.simulation.axes import AxesMotion
from mjsim.simulation.multibody import simulate

DEG = np.pi / 180.0
UNITS = np.array([1e-3, 1e-3, 1e-3, DEG, DEG])
FEEDS = [("fanuc", "a11"), ("fanuc", "inverse"), ("fanuc", "tcp"), ("siemens", "a11"), ("siemens", "inverse"),
    ("siemens", "tcp"),
         ("linuxcnc", "inverse"), ("linuxcnc", "tcp")]  # fmt: skip


@pytest.fixture(scope="module")
def tests(cone, circle, turn):
    """One test of every kind, method and direction."""
    made = [
        *(cone(th, be, (20, -10, 155), sensitive=s, direction=d)
          for th, be in ((15, 10), (45, 30)) for s in ("perpendicular", "parallel") for d in ("CCW", "CW")),
        cone(10, 25, (0, 30, 155)),
        circle("XY", (10, 20, 155)), circle("YZ", (0, 0, 155), direction="CW"), circle("ZX", (0, 0, 155), feed=3000.0),
        *(turn("C", 0, 360, (80, 60, 155), s) for s in ("tangential", "radial", "axial")),
        *(turn("A", 20, -90, (0, 0, 155), s) for s in ("tangential", "radial", "axial")),
    ]  # fmt: skip
    return [replace(t, name=f"t{i}") for i, t in enumerate(made)]


def back(test, options, **reading):
    """What is written, and that text read again."""
    written = nc_program(test, options)
    return written, parse_nc(written.text, Path("t.nc"), options.dialect, options.reversed, options.rollover, **reading)


def words(text, letter):
    """Values of one address in the feed blocks."""
    blocks = [line.split() for line in text.splitlines() if line.startswith("N")]
    return np.array([float(w[1:]) for b in blocks for w in b if w[0] == letter])


# -- the round trip ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dialect", "feed"), FEEDS)
def test_round_trip(tests, dialect, feed):
    """Positions to half a unit of the last printed digit; block times to half a unit of F's last digit; tool tip:
    to a chord's.
    """
    for test in tests:
        if feed == "tcp" and test.kind == "rotary":
            continue
        o = Options(dialect, feed, step_deg=1.0, whole_cycles=False)
        written, nc = back(test, o)
        program = Program(test)
        phi = np.linspace(*program.ends, len(nc.motion.points))
        assert abs(phi[1] - phi[0]) == pytest.approx(DEG)
        exact = program.path(phi)
        np.testing.assert_array_equal(nc.motion.points, written.motion.points)
        meant = exact.copy()
        if feed == "tcp":
            meant[:, :3] = machine_to_work(FIVE_AXIS, exact, exact[:, :3])
        half = 0.5 * 10.0 ** -DIALECTS[dialect].decimals
        assert (np.abs(nc.motion.points - meant) <= 1.001 * half * UNITS).all()
        ideal = written.motion.seconds
        f = words(written.text, "F")
        off = np.abs(nc.motion.seconds / ideal - 1.0)
        if feed == "tcp":
            chord = abs(phi[1] - phi[0]) ** 2 / 24 + 2 * np.sqrt(3) * half * 1e-3 / (test.feed * ideal[0])
            assert off.max() <= 1.01 * chord
        else:
            assert len(f) == len(ideal)
            assert (off <= 1.001 * 0.5 * 10.0 ** -DIALECTS[dialect].feed_decimals / f + 1e-12).all()
        assert nc.motion.duration == pytest.approx(ideal.sum(), rel=off.max() + 1e-12)
        assert (nc.feed, nc.motion.tip) == ("G93" if feed == "inverse" else "G94", feed == "tcp")


def test_the_usual_step_through_a_file(tests, tmp_path):
    """0.1° with the dialect's decimals: the program is the test's to fractions of a µm, and takes its time."""
    test = tests[0]
    for name in DIALECTS:
        write_nc(test, tmp_path / name, Options(name))
        nc = read_nc(tmp_path / name, name)
        off = deviation(driven_by(test, nc.motion), Program(test))
        # LinuxCNC would shorten blocks of 10.1 ms to 10 ms: its blocks last just above that
        assert len(nc.motion.seconds) == (3842 if name == "linuxcnc" else 3800)
        assert max(off["position_um"].values()) < 0.6 and max(off["angle_urad"].values()) < 5 and off["time_ms"] < 0.03
        assert off["feed_mm_min"] == pytest.approx(1000.0, rel=1e-6)
        assert Program(driven_by(test, nc.motion)).duration == pytest.approx(Program(test).duration, abs=1e-4)


def test_the_same_text_every_time(tests):
    for test in tests[:3]:
        for name in DIALECTS:
            text = nc_program(test, Options(name), machine="M1 (Kopie) Ü").text
            assert text == nc_program(test, Options(name), machine="M1 (Kopie) Ü").text
            assert text.isascii() and text.endswith("\n") and "-0.0000 " not in text
            assert test.name.upper() in text.upper() and "M1 [KOPIE] ?" in text.upper()
    fanuc = nc_program(tests[0]).text
    assert fanuc == fanuc.upper() and fanuc.startswith("%\nO0001\n(") and fanuc.endswith("M30\n%\n")
    assert "O0042" in nc_program(tests[0], Options(number=42)).text


def test_signs_of_the_rotary_axes(tests):
    test = tests[0]
    plain, turned = nc_program(test), nc_program(test, Options(reversed=("A", "C")))
    for a in FIVE_AXIS.letters:
        np.testing.assert_array_equal(words(turned.text, a), words(plain.text, a) * (-1 if a in "AC" else 1))
    _, nc = back(test, Options(reversed=("C",)))
    np.testing.assert_array_equal(nc.motion.points, plain.motion.points)
    with pytest.raises(InputError, match=r'no program of test "t0".*A and C counted the other way, the balls keep'):
        driven_by(test, parse_nc(turned.text, Path("t.nc")).motion)
    with pytest.raises(InputError, match="reversed axis 'X'; allowed: A, C"):
        parse_nc(plain.text, Path("t.nc"), "fanuc", ("X",))


@pytest.mark.parametrize("dialect", ["fanuc", "siemens"])
def test_rollover(tests, dialect):
    """C within a turn, read as the short way: the unwrapped motion up to whole turns."""
    for test in (tests[0], tests[1], tests[12]):
        o = Options(dialect, rollover=True, step_deg=0.5)
        written, nc = back(test, o)
        c = [
            float(w.strip("C=D()"))
            for line in written.text.splitlines()
            if line[:1] in "NG"
            for w in line.split()
            if w[0] == "C"
        ]
        assert 0.0 <= min(c) and max(c) < 360.0
        away = (nc.motion.points - nc_program(test, replace(o, rollover=False)).motion.points)[:, 4] / DEG
        assert np.ptp(away) < 1e-9 and abs(away[0] / 360.0 - round(away[0] / 360.0)) < 1e-9
        driven_by(test, nc.motion)
    if dialect == "siemens":  # DC( ) says so itself
        np.testing.assert_array_equal(parse_nc(written.text, Path("t"), "siemens").motion.points, nc.motion.points)
    else:
        with pytest.raises(InputError, match="φ goes from"):
            driven_by(test, parse_nc(written.text, Path("t"), rollover=False).motion)
        implied = parse_nc(written.text, Path("t"))  # feed moves of more than half a turn say so themselves
        np.testing.assert_array_equal(implied.motion.points, nc.motion.points)
        assert "taken the short way" in implied.warnings[0]


# -- F words -----------------------------------------------------------------------------------------------------------


def test_a11_against_closed_forms(circle, turn):
    """A circle's block is a chord; a turning C adds its degrees to the chord of X and Y."""
    step = 0.5 * DEG
    test = circle("XY", (10, 20, 155), feed=1200.0)
    f = words(nc_program(test, Options("siemens", decimals=9, feed_decimals=6, step_deg=0.5)).text, "F")
    assert f == pytest.approx(np.full(760, 1200.0 * np.sin(step / 2) / (step / 2)), rel=1e-8)
    for sensitive, radius in (("tangential", np.hypot(100, 100)), ("radial", 200.0), ("axial", 100.0)):
        test = turn("C", 0, 90, (80, 60, 155), sensitive)
        minutes = 100.0 * step / 1000.0
        want = np.hypot(2 * radius * np.sin(step / 2), 0.5) / minutes
        f = words(nc_program(test, Options("siemens", decimals=9, feed_decimals=6, step_deg=0.5)).text, "F")
        assert f == pytest.approx(np.full(180, want), rel=1e-8)


def test_a11_of_a_cone(tests):
    """Eq. A.11 from the positions that are printed, and from the exact ones of the program."""
    test = tests[2]
    o = Options("siemens", decimals=8, step_deg=0.5)
    written = nc_program(test, o)
    q = written.motion.points / UNITS
    minutes = abs(np.diff(Program(test).ends)[0]) / 760 * 100.0 / 1000.0
    f = words(written.text, "F")
    np.testing.assert_allclose(f, np.sqrt((np.diff(q, axis=0) ** 2).sum(axis=1)) / minutes, rtol=0, atol=0.5001e-4)
    np.testing.assert_allclose(f, Program(test).feed_words(np.linspace(*Program(test).ends, 761)), rtol=1e-6)


def test_inverse_time_and_tool_tip_words(tests):
    test = tests[0]
    radius = 100.0 * np.cos(15 * DEG)
    assert words(nc_program(test, Options("fanuc", "inverse", 1.0)).text, "F") == pytest.approx(
        1000.0 / (radius * DEG), abs=0.5e-3
    )
    text = nc_program(test, Options("fanuc", "tcp")).text
    assert list(words(text, "F")) == [1000.0]
    lines = text.splitlines()
    assert (
        lines.index("G0 A0. C0.") + 1
        == lines.index("G43.4 H1")
        < lines.index("G49", lines.index("G43.4 H1"))
        < lines.index("M30")
    )
    x, y, z = (words(text, a) for a in "XYZ")
    beta = 10 * DEG  # the circle leans about Y around the table ball
    away = np.array([np.cos(beta) * (x - 20) - np.sin(beta) * (z - 155), y + 10])
    np.testing.assert_allclose(np.hypot(*away), radius, rtol=0, atol=2e-4)


HEAD = "G90 G21 G94\nG0 X0. Y0. Z0. A0. C0.\n"
TIMES = {
    "five axes": ("fanuc", "G1 X2. Y3. Z6. A1. C10. F100", np.sqrt(4 + 9 + 36 + 1 + 100) / 100),
    "Fanuc's own example": ("fanuc", "G91 G1 X20. C40. F300.", 0.14907),
    "inverse time": ("fanuc", "G93 G1 X2. C10. F4.", 0.25),
    "F before": ("fanuc", "F50\nG1 X2.", 0.04),
    "tool tip on the work": ("fanuc", "G43.4 H1\nG0 X0. Y0. Z0.\nG1 X3. Y4. C90. F100", 0.05),
    "inches": ("fanuc", "G20 G1 X3. Y4. F10", 0.5),
    "LinuxCNC counts X, Y, Z": ("linuxcnc", "G1 X3 Y4 A90 C10 F100", 0.05),
    "LinuxCNC, rotary axes only": ("linuxcnc", "G1 A3 C4 F100", 0.05),
    "Sinumerik, all by default": ("siemens", "G1 X3 A4 F100", 0.05),
    "Sinumerik, FGROUP": ("siemens", "FGROUP(X,Y,Z)\nG1 X3 Y4 A40 F100", 0.05),
    "Sinumerik, FGREF": ("siemens", "FGROUP(X,A)\nFGREF[A]=100\nFGREF[A]=114.591559\nG1 X3 A2 F100", 0.05),
}


@pytest.mark.parametrize("case", TIMES)
def test_time_of_a_block(case):
    dialect, text, minutes = TIMES[case]
    head = HEAD.replace("G21", "G710") if dialect == "siemens" else HEAD
    motion = parse_nc(head + text + "\nM30\n", Path("t.nc"), dialect).motion
    assert motion.seconds == pytest.approx([60.0 * minutes], rel=2e-5)


# -- reading what others write -----------------------------------------------------------------------------------------

WANTED = np.array([[10, 0, 5, 0, 0], [11.5, -0.5, 5, 0, 2], [11.5, -1, 5, -0.25, 2]], float)
SPELLINGS = {
    "plain": "G90 G21 G94\nG0 X10. Y0. Z5. A0. C0.\nG1 X11.5 Y-.5 C2. F600\nY-1. A-.25\nM30\n",
    "lower case, no spaces, numbers": (
        "n10g90g21g94\nn20g0x10.y0.z5.a0.c0.\nn30g1x11.5y-.5c2.f600\nn40y-1.a-.25\nn50m30\n"
    ),
    "blanks within words": "G90 G21\nG0 X 10. Y 0 Z+5. A0 C 0\nG01 X +11.5 Y -0.5 C2.0 F 600.\nY-1. A-0.25\n",
    "Windows": "G90\r\nG0 X10. Y0. Z5. A0. C0.\r\nG1 X11.5 Y-.5 C2. F600\r\nY-1. A-.25\r\nM2\r\n",
    "comments": "%\nO1234 (PART; ONE)\n(X99.) G90 (ABS) G0 X10. (A) Y0. Z5. A0. C0. ; G91 (\n"
    "G1 X11.5 Y-.5 (F1) C2. F600\n\n;\nY-1. A-.25\nM30\nthis is not read\n%\n",
    "incremental": "G0 X10. Y0. Z5. A0. C0.\nG91\nG1 X1.5 Y-.5 C2. F600\nG1 Y-.5 A-.25\nG90 G28 Z0.\nM30",
    "inches": "G20 G90\nG0 X.3937007874 Y0. Z.19685039370 A0. C0.\nG21\nG1 X11.5 Y-.5 C2. F600\nY-1. A-.25\n",
    "several G in a block, zero point, look-ahead": "G17 G90 G40 G49 G80 G94 G54\nG5.1 Q1\nT1 M6\nS100 M5\nG43 H1 D1\n"
    "G0 X10. Y0. Z5. A0. C0.\nG4 P500\nM1\nG1 G54 G64 X11.5 Y-.5 C2. F600 M8\nY-1. A-.25 M9\nM0\nG0 Z200.\nM30",
    "no motion in between": "G0 X10. Y0. Z5. A0. C0.\nG1 X10. F600\nX11.5 Y-.5 C2.\nF600\nX11.5\nY-1. A-.25\n",
    "byte order mark": "\ufeffG0 X10. Y0. Z5. A0. C0.\nG1 X11.5 Y-.5 C2. F600\nY-1. A-.25\n",
}


@pytest.mark.parametrize("case", SPELLINGS)
def test_spellings(tmp_path, case):
    (tmp_path / "t.nc").write_bytes(SPELLINGS[case].encode())
    nc = read_nc(tmp_path / "t.nc")
    np.testing.assert_allclose(nc.motion.points / UNITS, WANTED, rtol=0, atol=1e-9)
    np.testing.assert_allclose(nc.motion.seconds, np.sqrt([1.5**2 + 0.5**2 + 2**2, 0.5**2 + 0.25**2]) / 10.0, rtol=1e-9)
    assert nc.unnamed == ()


def test_comments_in_another_encoding(tmp_path):
    (tmp_path / "t.nc").write_bytes("(Prüfung)\nG0 X0. Y0.\nG1 X1. F60.\n".encode("latin-1"))
    nc = read_nc(tmp_path / "t.nc")
    assert nc.motion.duration == pytest.approx(1.0) and nc.unnamed == ("Z", "A", "C")
    assert nc.place(0).endswith("line 2") and nc.place(1).endswith("line 3")


def test_sinumerik_spellings():
    text = (
        "%_N_T_MPF\n; (comment\nG90 G710 g94 fgroup(x,y,z,a,c) fgref[a]=57.2958\nTRAORI\n"
        "G0 X=1.0 Y0 Z0 A0 C=DC(350)\nG1 X2 C=DC(10) F60\nTRAFOOF\nM17\n"
    )
    nc = parse_nc(text, Path("t.mpf"), "siemens")
    assert nc.motion.tip
    np.testing.assert_allclose(nc.motion.points / UNITS, [[1, 0, 0, 0, 350], [2, 0, 0, 0, 370]], atol=1e-9)
    assert nc.motion.seconds == pytest.approx([1.0])
    q = nc.motion.at(np.array([0.5]))[0]
    np.testing.assert_allclose(q[:3], work_to_machine(FIVE_AXIS, q[None], np.array([[1.5e-3, 0, 0]]))[0], atol=1e-15)


REFUSED = {
    "arc that is too small": ("G2 X9. Y0. R4. F1.", 3, "R4", "9 mm apart"),
    "full circle by its radius": ("G2 R4. F1.", 3, "R4", "I, J, K"),
    "cycle without its depth": ("G81 X1. R1. F100", 3, "depth Z"),
    "fine boring": ("G76 X1. Z-1. R1. Q1. F100", 3, "G76"),
    "cutter compensation": ("G41 D1", 3, "G41", "no cutter compensation"),
    "another zero point": ("G54\nG55", 4, "G55", "one of G54 to G59"),
    "feed per revolution": ("G95", 3, "G95"),
    "polar coordinates": ("G16", 3, "G16"),
    "scaling": ("G51 X2.", 3, "G51"),
    "offsets by program": ("G10 L2 P1 X0.", 3, "G10"),
    "tool tip, another control's": ("TRAORI", 3, "TRAORI"),
    "variable without a value": ("G1 X#1 F100", 3, "#1", "no value"),
    "branch": ("IF [#1 EQ 1] GOTO 5", 3, "IF [#1", "without branches"),
    "macro": ("G65 P9000", 3, "G65"),
    "call": ("M98 P100", 3, "M98", "other programs"),
    "the maker's M code": ("M200", 3, "M200"),
    "open comment": ("G1 X1. (half", 3, "(half", "other half"),
    "word twice": ("G1 X1. X2. F1", 3, "the word X twice"),
    "B axis": ("G1 B1. F1", 3, "B1", "X Y Z A C"),
    "radius": ("G1 X1. R1. F1", 3, "R1"),
    "no number": ("G1 X F1", 3, "X F1"),
    "two points": ("G1 X1.2.3 F1", 3, "X1.2.3"),
    "comma": ("G1 X1.,5 F1", 3, "',5 F1'"),
    "not finite": ("G1 X" + "9" * 400 + ". F1", 3, "can hold"),
    "text": ("hello world", 3, "'hello world'", "words of a letter and a number"),
    "no decimal point": ("G1 X100 F1", 3, "X100 without a decimal point", "3401", "X100."),
    "no decimal point in inverse time": ("G93\nG1 X1. F5", 4, "F5 without a decimal point"),
    "no feed": ("G1 X1.", 3, "before any F"),
    "feed of nothing": ("G1 X1. F0", 3, "F0", "above 0"),
    "negative feed": ("G1 X1. F-5", 3, "F-5"),
    "no F in inverse time": ("G93\nG1 X1. F5.\nX2.", 5, "no F", "each"),
    "F of the other mode": ("F100\nG93\nG94\nG1 X1.", 6, "before any F"),
    "incremental from nowhere": ("G28 X0.\nG91 X1.", 4, "G91 with X"),
    "place of the machine": ("G1 X1. F1\nG53 Z0.\nG1 X2.", 5, "before Z has a known place"),
    "tool tip at turned axes": ("G0 A5.\nG43.4 H1\nG1 Z1. F1", 5, "before X has a known place"),
    "length of the tool off": ("G43 H1\nG1 X1. F1\nG49\nG1 Z2.", 6, "before X has a known place"),
    "tool tip rests": ("G43.4 H1\nG0 X0. Y0. Z0.\nG1 A1. F1", 5, "tool tip rests"),
    "tilted plane, tool upright": ("G68.2 X0. Y0. Z0. I0. J30. K0.\nG1 X1. F1", 4, "30.00° off"),
    "orientation without a plane": ("G53.1", 3, "G53.1 without a tilted plane"),
    "corner without a contour": ("G0 X1. ,R1.", 3, ",R in a block without a contour"),
    "corner that is too long": ("G1 X1. ,R5. F1\nY1.", 4, "5 mm", "shorter"),
    "nothing to do": ("M30", None, "no block with a feed"),
    "nothing known": ("G28 X0.\nG1 X1. F1", None, "no block with a feed"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(tmp_path, case):
    body, line, *found = REFUSED[case]
    file = tmp_path / "t.nc"
    file.write_text(HEAD + body + "\nM30\n")
    with pytest.raises(InputError) as error:
        read_nc(file, "fanuc")
    text = str(error.value)
    assert text.startswith(f"{file}, line {line}: " if line else f"{file}: ") and "allowed" in text and "\n" not in text
    assert all(word in text for word in found), text


def test_axis_that_comes_late():
    with pytest.raises(InputError, match="line 3: A for the first time, within the path"):
        parse_nc("G0 X0. Y0.\nG1 X1. F1\nA1.\n", Path("t.nc"))
    nc = parse_nc("G1 X1. F1\nX2.\n", Path("t.nc"))  # from somewhere: the path begins at the first place that is said
    assert nc.motion.points[:, 0] == pytest.approx([1e-3, 2e-3]) and "begins at its end" in nc.warnings[0]


@pytest.mark.parametrize("data", [b"", b"\0\1\2", bytes(range(1, 256)) * 20, b"\n" * 5000])
def test_files_that_are_no_programs(tmp_path, data):
    (tmp_path / "t.nc").write_bytes(data)
    with pytest.raises(InputError, match=r"t\.nc"):
        read_nc(tmp_path / "t.nc")
    with pytest.raises(InputError, match="a folder stands there; allowed: a file"):
        read_nc(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        read_nc(tmp_path / "missing.nc")


# -- limits and options ------------------------------------------------------------------------------------------------


def test_limits_are_the_joints(tests):
    model = mujoco.MjModel.from_xml_path(str(model_file()))
    limits = model_limits()
    for i, a in enumerate(FIVE_AXIS.letters):
        joint = model.joint(a)
        low, high = joint.range if model.jnt_limited[joint.id] else (-np.inf, np.inf)
        assert (limits.low[i], limits.high[i]) == (pytest.approx(low), pytest.approx(high))


def test_limits(tests, tmp_path):
    test = tests[0]
    limits = model_limits().changed({"A": (0.0, 20.0)}, {})
    with pytest.raises(
        InputError,
        match=r'test "t0", block N\d+ \(φ = \d+.\d+°\): A = 20.\d+° leaves .* to 25.0000°\); allowed: 0 to 20°',
    ):
        write_nc(test, tmp_path / "t.nc", limits=limits)
    assert not (tmp_path / "t.nc").exists()
    fast = model_limits().changed({"A": (5.0 - 1e-4, 25.0 + 1e-4)}, {"C": 1500.0})
    (warning,) = nc_program(test, limits=fast).warnings
    speed = np.abs(np.diff(words(nc_program(test).text, "C"))).max() / (nc_program(test).motion.seconds[0] / 60)
    assert f"up to {speed:.1f}°/min" in warning and "C is faster than its 1500°/min" in warning
    assert nc_program(test, limits=model_limits().changed({}, {"C": 2000.0})).warnings == []
    for travel, speeds in (({"X": (1.0, 1.0)}, {}), ({}, {"X": 0.0})):
        with pytest.raises(InputError, match="allowed"):
            model_limits().changed(travel, speeds)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (Options("heidenhain"), "'heidenhain'; allowed: fanuc, siemens, linuxcnc"),
        (Options("linuxcnc", "a11"), "allowed: inverse, tcp"),
        (Options(feed="g95"), "allowed: a11, inverse, tcp"),
        (Options("linuxcnc", rollover=True), "linuxcnc"),
        (Options(step_deg=0.0), "allowed: 0.001 to 10"),
        (Options(step_deg=float("nan")), "allowed: 0.001 to 10"),
        (Options(step_deg=0.002), "allowed: up to 99998"),
        (Options(step_deg=0.005, decimals=1), "a block of 0.005° moves no axis"),
        (Options(decimals=12), "allowed: 1 to 9"),
        (Options(feed_decimals=-1), "allowed: 0 to 9"),
        (Options(number=0), "allowed: 1 to 9999"),
        (
            Options(feed="inverse", step_deg=0.05),
            "allowed for fanuc: up to 9999.999 1/min, by a step of at least 0.06°",
        ),
    ],
)
def test_options_that_do_not_fit(tests, options, text):
    with pytest.raises(InputError) as error:
        nc_program(tests[0], options)
    assert text in str(error.value)


def test_tool_tip_rests_in_a_rotary_test(turn):
    with pytest.raises(InputError, match="F has no meaning"):
        nc_program(turn("C", 0, 90, (80, 60, 155)), Options(feed="tcp"))


# -- what blocks do ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [0.1, 0.5, 2.0])
def test_chord_error_in_closed_form(circle, turn, step):
    """Half-way along a block the spindle ball is R(1 - cos(step/2)) inside its circle about the turning axis, or
    about the ball.
    """
    sag = 1.0 - np.cos(step * DEG / 2)
    fine = Options("siemens", decimals=9, feed_decimals=6, step_deg=step)
    cases = [(circle("XY", (10, 20, 155)), 0.1), (circle("ZX", (0, 0, 155)), 0.1)]
    cases += [
        (turn("C", 0, 90, (80, 60, 155), s), r) for s, r in (("tangential", 0.1), ("radial", 0.2), ("axial", 0.0))
    ]
    cases += [(turn("A", 0, 90, (30, 0, 155), s), r) for s, r in (("tangential", 0.1), ("radial", 0.255))]
    for test, radius in cases:
        report = feed_report(test, back(test, fine)[1].motion)
        sideways = 0.5 * (0.155 * sag) ** 2 / 0.1  # what lies across the bar lengthens it in second order
        assert report.reading.max() == pytest.approx(0.0, abs=3e-12 + 2 * sideways)
        assert report.reading.min() == pytest.approx(-radius * sag, abs=3e-12 + 2 * sideways)
        if test.kind == "circular":
            assert report.position[:3].max() == pytest.approx(0.1 * sag, rel=0.03)


def test_chord_error_of_a_cone_is_quadratic(tests):
    deep = [
        -feed_report(tests[2], back(tests[2], Options("siemens", decimals=9, step_deg=s))[1].motion).reading.min()
        for s in (0.5, 1.0, 2.0)
    ]
    assert deep[1] / deep[0] == pytest.approx(4.0, rel=0.02) and deep[2] / deep[1] == pytest.approx(4.0, rel=0.05)
    assert 0.1 * (1 - np.cos(0.5 * DEG)) < deep[1]  # C turns faster than φ: deeper than a plain circle's


def test_feed_by_the_blocks(circle):
    test = circle("XY", (0, 0, 155), feed=1000.0)
    motion = back(test, Options("siemens", decimals=8, feed_decimals=6, step_deg=0.1))[1].motion
    block = 0.1 * DEG * 0.1 / test.feed
    plain = feed_report(test, motion)
    assert plain.mean == pytest.approx(test.feed, rel=1e-8) and plain.feed == pytest.approx(test.feed, rel=2e-6)
    assert plain.duration == pytest.approx(plain.ideal, rel=1e-8)
    whole = feed_report(test, motion, Control(cycle=2e-3, whole_cycles=True))
    assert block == pytest.approx(10.472e-3, rel=1e-4)
    assert whole.mean == pytest.approx(test.feed * block / 12e-3, rel=1e-6) and whole.seconds == pytest.approx(
        (12e-3, 12e-3)
    )
    over = feed_report(test, motion, Control(cycle=2e-3))
    assert over.mean == pytest.approx(test.feed, rel=1e-5) and over.feed == pytest.approx(test.feed, rel=1e-5)
    slow = feed_report(test, motion, Control(block_time=15e-3))
    assert slow.mean == pytest.approx(test.feed * block / 15e-3, rel=1e-6)
    assert slow.duration == pytest.approx(3800 * 15e-3)
    turn_of_axis = 2 * np.sin(0.05 * DEG) * test.feed  # the velocity turns by one step from block to block
    assert plain.jump[0] == pytest.approx(turn_of_axis, rel=1e-3) and plain.jump[3] == 0.0
    data = plain.to_json()
    assert data["nominal_mm_min"] == pytest.approx(1000.0) and data["reading_um"]["min"] == pytest.approx(
        -0.0381, abs=2e-4
    )


def test_coarse_f_makes_ripple(tests):
    """F of whole mm/min: every block's time is off by up to half a unit, and the feed with it."""
    test = tests[0]
    written, nc = back(test, Options("siemens", decimals=8, feed_decimals=0, step_deg=0.5))
    report = feed_report(test, nc.motion)
    exact = np.linalg.norm(np.diff(written.motion.points / UNITS, axis=0), axis=1) / (written.motion.seconds / 60)
    ratio = np.round(exact) / exact
    per_block = report.feed.reshape(-1, 4).mean(axis=1) / test.feed
    np.testing.assert_allclose(per_block, ratio[20:-20], rtol=0, atol=3e-5)
    assert np.ptp(report.feed) / report.mean > 2e-4


def test_set_points_lie_on_the_blocks(tests):
    motion = back(tests[0], Options(step_deg=1.0))[1].motion
    given = executed(motion, Control(cycle=3e-3))
    np.testing.assert_allclose(given.points, motion.at(given.knots), rtol=0, atol=1e-11)
    np.testing.assert_array_equal(given.points[[0, -1]], motion.points[[0, -1]])
    tip = back(tests[0], Options(step_deg=1.0, feed="tcp"))[1].motion
    np.testing.assert_allclose(
        executed(tip, Control(cycle=3e-3)).points[100], tip.at(np.array([0.3]))[0], rtol=0, atol=1e-11
    )


@pytest.mark.parametrize(
    "control",
    [
        Control(cycle=1e-6),
        Control(cycle=-1.0),
        Control(block_time=-1.0),
        Control(block_time=np.nan),
        Control(whole_cycles=True),
    ],
)
def test_controls_that_do_not_exist(tests, control):
    with pytest.raises(InputError, match="allowed"):
        feed_report(tests[0], nc_program(tests[0], Options(step_deg=5.0)).motion, control)


# -- as the commanded motion -------------------------------------------------------------------------------------------


def test_driven_programs_are_the_tests_own_ones(tests):
    """Angle, axes and measured part of a fine program, at every instant, ramps included."""
    for test in (*tests[:8:2], *tests[8:11], *tests[12::2]):
        own = Program(test)
        driven = Program(
            driven_by(test, back(test, Options("siemens", step_deg=0.1, decimals=8, feed_decimals=6))[1].motion)
        )
        time = np.linspace(-0.2, own.duration + 0.2, 501)
        assert driven.duration == pytest.approx(own.duration, abs=2e-6)
        np.testing.assert_allclose(driven.measured_span, own.measured_span, rtol=0, atol=2e-6)
        np.testing.assert_allclose(driven.phi(time), own.phi(time), rtol=0, atol=3e-6)
        away = driven.commands(time) - own.commands(time)
        assert np.abs(away[:, :3]).max() < 2e-6 and np.abs(away[:, 3:]).max() < 2e-5, test
        bar = reading(FIVE_AXIS, driven.commands(time), np.array(test.table_ball), test.length)
        assert np.abs(bar).max() < 1.5e-6


def test_simulated_reading_of_a_program_read_back(turn, m1):
    """In the multibody model: the built-in program's reading to what chord and digits allow; coarse digits show."""
    test = turn("A", 0, 25, (0, 0, 155), feed=3000.0)
    fine, coarse = (
        driven_by(test, back(test, Options("siemens", step_deg=0.1, decimals=d, feed_decimals=5))[1].motion)
        for d in (7, 2)
    )
    plain, read, rough = simulate(m1, [test, fine, coarse])
    assert len(plain.time) == len(read.time)
    sag = 0.1 * (1 - np.cos(0.05 * DEG))
    assert np.abs(read.deviation - plain.deviation).max() < 2 * sag  # 0.08 µm
    assert np.abs(read.position - plain.position).max() < 2.5 * sag
    np.testing.assert_allclose(read.phi, plain.phi, rtol=0, atol=1e-6)
    assert np.abs(rough.deviation - plain.deviation).max() > 5 * sag


def test_searches_see_the_same_motion(cone, m1):
    """The drives alone, as a diagnosis uses them, on a cone program at the usual step and decimals."""
    test = cone(45, 30, (0, 0, 155), feed=4000.0)
    driven = driven_by(test, back(test, Options("siemens"))[1].motion)
    plant = build(m1)
    assert np.abs(AxesMotion(driven).reading(plant) - AxesMotion(test).reading(plant)).max() < 0.25e-6


def test_programs_of_other_tests(cone, tests):
    test = tests[0]
    span = Program(test).measured_ends
    motion = nc_program(test, Options(step_deg=1.0)).motion
    with pytest.raises(InputError, match=r"mean feed is 1000 mm/min.*feed_mm_min = 1050 within 2%"):
        driven_by(replace(test, feed=1050 / 60e3), motion)
    assert driven_by(replace(test, feed=1010 / 60e3), motion).feed == pytest.approx(test.feed, rel=1e-6)
    with pytest.raises(InputError, match=r"balls are .* mm apart; allowed: the bar's 100 ± 1 mm"):
        driven_by(replace(test, table_ball=(0.0, 0.0, 0.155)), motion)
    with pytest.raises(InputError, match="φ that only falls"):
        driven_by(replace(test, direction="CW"), motion)
    with pytest.raises(InputError, match=r"measured from 0.000° to 720.000°"):
        driven_by(replace(test, revolutions=2), motion)
    bare = Commanded(motion.seconds[10:-10], motion.points[10:-10])  # no run-in: from φ = 0 to 360°, but for the digits
    own = Program(driven_by(test, bare))
    assert own.measured_span == pytest.approx((0.0, own.duration), abs=1e-2)
    with pytest.raises(InputError, match=r"runs from φ = 1.000° to 360"):
        driven_by(test, Commanded(bare.seconds[1:], bare.points[1:]))
    half = Commanded(motion.seconds[:100], motion.points[:101])
    with pytest.raises(InputError, match=r"x.nc: runs from φ = -10.000° to 90.\d+°"):
        driven_by(test, half, "x.nc")
    assert span == pytest.approx((0.0, 2 * np.pi))


def test_csv_of_a_motion(tests):
    motion = nc_program(tests[0], Options(step_deg=1.0)).motion
    rows = motion_csv(motion).splitlines()
    assert rows[0] == "time_s,X_mm,Y_mm,Z_mm,A_deg,C_deg"
    table = np.array([r.split(",") for r in rows[1:]], float)
    np.testing.assert_allclose(table[:, 1:], motion.axes / UNITS, rtol=0, atol=1e-7)
    assert table[-1, 0] == pytest.approx(motion.duration)
