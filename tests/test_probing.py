"""Programs that probe a sphere on LinuxCNC, and what LinuxCNC writes of them."""

import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from commands import printed as run
from commands import refused

import mjsim
from mjsim.errors import InputError
from mjsim.instruments.sphere.measurement import SphereTest, centre_of, centres_of_log, sides_of_points
from mjsim.io.resources import examples
from mjsim.linuxcnc.configuration import Settings
from mjsim.linuxcnc.run import missing, run_program
from mjsim.machine.chain import chain_of
from mjsim.nc.probing import Probing, probing_program
from mjsim.units import DEG, MM, UM

HOW = Probing(sphere=25.0 * MM, tip=6.0 * MM)
TEST = SphereTest(
    "ball",
    (0.11, 0.02, 0.09),
    angles=((0.0, 0.0), (-90.0 * DEG, 0.0), (30.0 * DEG, 60.0 * DEG), (30.0 * DEG, 60.0 * DEG)),
    approach=((1, 1), (-1, 1), (1, -1), (-1, 1)),
    spindle=(0.0, np.pi, np.pi, 0.0),
)
CAMPAIGN = """name = "probed"
[instrument]
kind = "sphere"
[[test]]
name = "ball"
kind = "sphere"
sphere_mm = [110.0, 20.0, 90.0]
angles_deg = [[0.0, 0.0], [-90.0, 0.0], [30.0, 60.0], [30.0, 60.0]]
approach = [[1, 1], [-1, 1], [1, -1], [-1, 1]]
spindle_deg = [0.0, 180.0, 180.0, 0.0]
"""


def test_the_spindle_is_turned_before_the_first_point():
    """Its angle at the start is not known: the first point needs its own as the others do."""
    turned = [line for line in probing_program(TEST, HOW)[0].splitlines() if line.startswith(("M19", "(point"))]
    assert turned == [
        "(point 1)", "M19 R0.000", "(point 2)", "M19 R180.000", "(point 3)", "(point 4)", "M19 R0.000"
    ]  # fmt: skip
    assert "M19" not in probing_program(replace(TEST, spindle=()), HOW)[0]


@pytest.fixture(scope="module")
def program():
    """Text, and every move as mjsim's own reader has it: code, number of the point, start and end (axes,) m and rad."""
    text, read = probing_program(TEST, HOW)
    lines, moves, point = text.splitlines(), [], 0
    points, at = read.motion.axes, read.lines
    for i in range(1, len(points)):
        said = lines[at[i] - 1]
        point = sum(line.startswith("(point") for line in lines[: at[i]]) - 1
        moves.append((said.split()[0], point, points[i - 1], points[i]))
    return text, moves


def touched(moves, off):
    """Where a probe switches on spheres that are ``off`` (n, 3) m their places."""
    out, planned = [], TEST.planned.position
    for code, point, start, end in moves:
        centre, way = planned[point, :3] + off[point], end[:3] - start[:3]
        if code != "G38.2":
            continue
        unit, away = way / np.linalg.norm(way), start[:3] - centre
        along = -away @ unit - np.sqrt(HOW.reach**2 - away @ away + (away @ unit) ** 2)
        assert 0.0 < along < np.linalg.norm(way)
        out.append(np.concatenate([start[:3] + along * unit, start[3:]]))
    return np.array(out)


def test_every_position_is_touched_from_its_free_sides(program):
    _, moves = program
    sides = sides_of_points(TEST)
    assert [len(s) for s in sides] == [5, 4, 5, 5]
    assert not (sides[1] == (0.0, -1.0, 0.0)).all(axis=1).any()  # the stem: the table has turned by -90 degrees
    made = [
        (p, np.round((a[:3] - b[:3]) / np.linalg.norm(a[:3] - b[:3]))) for code, p, a, b in moves if code == "G38.2"
    ]
    assert [p for p, _ in made] == [i for i, s in enumerate(sides) for _ in s]
    assert np.array_equal([way for _, way in made], np.vstack(sides))


def test_nothing_else_comes_near_the_sphere(program):
    """All other moves keep the clearance, and the rotary axes move with the probe above everything."""
    _, moves = program
    planned, before = TEST.planned.position, ""
    for code, point, start, end in moves:
        touched_before, before = before == "G38.2", code
        path = start + np.linspace(0.0, 1.0, 50)[:, None] * (end - start)
        turns = np.ptp(path[:, 3:], axis=0).any()
        if turns:
            assert path[:, 2].min() >= planned[:, 2].max() + HOW.safe - 1e-6
        elif code != "G38.2" and not touched_before:  # a touch goes back where it came from
            away = np.linalg.norm(path[:, :3] - planned[point, :3], axis=1)
            assert away.min() >= HOW.reach + HOW.clearance - 1e-6


def test_the_rotary_axes_come_from_the_planned_side(program):
    _, moves = program
    last = {}
    for _, point, start, end in moves:
        step = end[3:] - start[3:]
        if np.abs(step).max() > 1e-9 and np.allclose(end[3:], TEST.planned.position[point, 3:], atol=1e-6):
            last[point] = np.sign(step)
    # a motion begins with its first feed, at the first point
    assert np.array_equal([last[i] for i in range(1, 4)], TEST.planned.side[1:])
    text, _ = program
    assert "G0 A-2.0000 C-2.0000\nG0 A0.0000 C0.0000" in text


def test_what_linuxcnc_writes_becomes_points(program, tmp_path):
    """Places at which the probe has switched give the centres back, whatever the pre-travel is."""
    _, moves = program
    off = np.random.default_rng(1).normal(0.0, 30.0 * UM, (4, 3))
    rows = touched(moves, off)
    (tmp_path / "machine.toml").write_bytes((examples() / "healthy" / "machine.toml").read_bytes())
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    nine = np.zeros((len(rows), 9))
    nine[:, :3], nine[:, [3, 5]] = rows[:, :3] / MM, rows[:, 3:] / DEG
    log = tmp_path / "ball.txt"
    log.write_text("\n".join(" ".join(f"{v:.6f}" for v in row) for row in nine) + "\n")
    run("import", log, "--campaign", tmp_path, "--points", "--test", "ball")
    points = mjsim.read_campaign(tmp_path).traces["ball"]
    assert np.abs(points.deviation - off).max() < 0.01 * UM
    assert np.array_equal(points.side, TEST.planned.side) and np.allclose(points.spindle, TEST.planned.spindle)
    log.write_text("\n".join(log.read_text().splitlines()[:-1]) + "\n")
    said = " ".join(run("import", log, "--campaign", tmp_path, "--points", "--test", "ball", "--force", code=1).split())
    assert "18 touches; allowed: the 19 of its program, in their order, or 34 with the ways down" in said


def test_a_program_needs_the_diameters(tmp_path):
    """Of another sphere than is there, the probe would hit it."""
    (tmp_path / "machine.toml").write_bytes((examples() / "healthy" / "machine.toml").read_bytes())
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    command = ["nc", tmp_path, "--test", "ball", "--dialect", "linuxcnc", "-o", tmp_path / "ball.ngc"]
    assert "--tip is missing" in refused(tmp_path, [*command, "--sphere", 30])
    run(*command, "--sphere", 30, "--tip", 4)
    assert (tmp_path / "ball.ngc").is_file()


def test_a_centre_follows_from_four_touches():
    ways = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0]], float)
    centre, distance = centre_of(np.array([0.1, -0.2, 0.3]) + 0.0155 * ways)
    assert centre == pytest.approx([0.1, -0.2, 0.3], abs=1e-12) and distance == pytest.approx(0.0155, abs=1e-12)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"angles": ()}, "no positions are planned"),
        ({"angles": ((179.0 * DEG, 0.0),) * 4}, "point 1: the stem of the sphere is in the way"),
        ({"chain": chain_of("w-C'bXYZA-t", tool_length=0.25)}, "the head turns with"),
    ],
)
def test_what_cannot_be_probed_is_refused(changed, message):
    with pytest.raises(InputError, match=message):
        probing_program(replace(TEST, **changed), HOW)


@pytest.mark.skipif(shutil.which("rs274") is None, reason="rs274 of the package linuxcnc-uspace is not installed")
def test_linuxcnc_reads_the_same(program, tmp_path):
    """LinuxCNC's own interpreter takes the program, and probes to the same places."""
    text, moves = program
    (tmp_path / "ball.ngc").write_text(text)
    done = subprocess.run(["rs274", "-g", "ball.ngc"], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    found = re.findall(r"STRAIGHT_PROBE\(([^)]*)\)", done.stdout)
    assert done.returncode == 0, done.stderr
    x = np.array([[float(v) for v in row.split(",")[:3]] for row in found])
    assert x == pytest.approx(np.array([end[:3] / MM for code, _, _, end in moves if code.startswith("G38")]), abs=1e-3)


@pytest.mark.slow
def test_linuxcnc_probes_a_sphere(program):
    """A real LinuxCNC runs the program with a simulated probe. The centres that it finds are right within what the
    probe moves in a cycle of the control, 1.7 µm.
    """
    if what := missing():
        pytest.skip(f"LinuxCNC cannot run here: {what} is missing")
    text, _ = program
    off = np.random.default_rng(1).normal(0.0, 30.0 * UM, (4, 3))
    places = iter((TEST.planned.position[:, :3] + off) / MM)
    lines = []
    for line in text.splitlines():
        lines.append(line)
        if line.startswith("(point"):
            lines += [f"M68 E{i} Q{v:.6f}" for i, v in enumerate(next(places))]
    told = "\n".join(line for line in lines if not line.startswith("M19")) + "\n"
    record = run_program(told, TEST.chain, Settings(probe=HOW.reach / MM))
    found = centres_of_log(TEST, record.probed * MM)
    assert np.abs(found - TEST.planned.position[:, :3] - off).max() < 1.7 * UM
