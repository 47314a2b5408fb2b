"""Predicted parts: closed forms, the independent machine, what cannot be known is said."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from commands import ok, run
from independent import drives as generator_drives
from independent import kinematics as generator_kinematics
from independent import transmission as generator_transmission

from mjsim.campaign.machine_file import read_machine
from mjsim.commands.saved import SavedDiagnosis
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.data_sheet import data_sheet
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.posterior import Posterior
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS, chain_of
from mjsim.prediction.causes import contour
from mjsim.prediction.part_run import program_of
from mjsim.prediction.parts import PARTS, part
from mjsim.prediction.predict import LINEAR, ROTARY, paced, predict
from mjsim.units import MM, UM

ZERO = (0.04, 0.01, 0.12)


def effect(name, **values):
    return registry.make(name, FIVE_AXIS, **values)


@pytest.fixture(scope="module")
def machine():
    return read_machine(examples() / "hidden-backlash" / "machine.toml")


def stiff(machine):
    """The machine with drives that lag far less, so that its errors of position stand alone."""
    for a in machine.chain.letters:
        machine = machine.with_drive(a, viscous=1e-6)
        machine = machine.with_effect(effect(f"velocity_feedforward.{a}", ratio=1.0))
    return replace(machine, effects=tuple(e for e in machine.effects if e.kind != "friction"))


def test_contour_error_of_a_circle_that_is_too_large_and_late():
    t = np.linspace(0.0, 2.0 * np.pi, 4001)
    path = 0.05 * np.column_stack([np.cos(t), np.sin(t), 0 * t])
    late = 0.05 * np.column_stack([np.cos(t - 0.004), np.sin(t - 0.004), 0 * t]) * (1.0 + 2e-4)
    found = contour(path, late)
    inside = slice(50, -50)
    assert found.size[inside] == pytest.approx(10e-6, rel=3e-3)
    assert found.along[inside] == pytest.approx(-0.004 * 0.05, rel=1e-3)
    assert np.abs(np.einsum("ni,ni->n", found.normal, found.tangent))[inside].max() < 1e-9


@pytest.mark.parametrize("name", list(PARTS))
def test_parts_are_paths_that_the_machine_reaches(name):
    motion = part(name, FIVE_AXIS, np.array(ZERO))
    speed = np.linalg.norm(np.diff(motion.points[:, :3], axis=0), axis=1) / motion.seconds
    assert speed == pytest.approx(1.0 / 60.0)
    assert motion.points[:, 3].min() >= 0.0 and motion.points[:, 3].max() < 0.8
    assert np.abs(np.diff(motion.points[:, 4])).max() < 0.25


def test_pace_keeps_the_acceleration_of_the_axes_and_the_feed():
    motion = part("pocket", FIVE_AXIS, np.array(ZERO))
    _, at = paced(motion, 1e-3)
    q = motion.at(at)
    a = np.abs(np.diff(q, 2, axis=0)).max(axis=0) / 1e-6
    assert a[:3].max() < 4.0 * LINEAR and a[3:].max() < 4.0 * ROTARY
    assert (np.diff(at) >= 0).all() and at[-1] == pytest.approx(motion.duration)
    assert np.abs(np.diff(q, axis=0)).max() / 1e-3 <= 1.0 / 60.0 * (1 + 1e-6)


def test_squareness_is_the_error_of_the_square(machine):
    """A boss on a machine out of square by α: deviation α·y along x, about its zero point."""
    alpha = 50e-6
    skewed = stiff(machine).with_effect(effect("squareness.XY", angle_urad=alpha / UM))
    result = predict(part("boss", FIVE_AXIS, np.array(ZERO)), skewed, "boss", zero=ZERO)
    plain = predict(part("boss", FIVE_AXIS, np.array(ZERO)), stiff(machine), "boss", zero=ZERO)
    cause = next(c for c in result.causes if c.key == "squareness.XY")
    straight = np.abs(result.path[:, 1] - ZERO[1]) < 29.0 * MM  # on the sides along y the normal is x
    sides = straight & (np.abs(np.abs(result.path[:, 0] - ZERO[0]) - 40.0 * MM) < 1e-6)
    y = result.path[sides, 1] - ZERO[1]
    assert result.normal[sides, 0] - plain.normal[sides, 0] == pytest.approx(-alpha * y, abs=0.03 * UM)
    assert 0.3 * alpha * 40 * MM < cause.rms < alpha * 40 * MM


def test_what_is_set_up_with_the_part_is_no_error_of_it(machine):
    """A place of the rotary axes cannot be seen by three axes alone, nor can a tilt of the table at rest."""
    sound = stiff(machine)
    moved = sound
    for name, value in (("EX0C", {"value_um": 30.0}), ("EY0A", {"value_um": -20.0}), ("EC0A", {"value_urad": 40.0})):
        moved = moved.with_effect(effect(f"axis_location.{name}", **value))
    a = predict(part("pocket", FIVE_AXIS, np.array(ZERO)), sound, zero=ZERO)
    b = predict(part("pocket", FIVE_AXIS, np.array(ZERO)), moved, zero=ZERO)
    assert np.abs(a.normal - b.normal).max() < 1e-9
    cone = [predict(part("cone", FIVE_AXIS, np.array(ZERO)), m, zero=ZERO).largest[0] for m in (sound, moved)]
    assert cone[1] > cone[0] + 10 * UM


def test_the_independent_machine_makes_the_predicted_error(machine):
    """Same commands, the generator's drives, transmission and kinematics, nearest point by brute force."""
    faulty = machine
    planted = {
        "backlash.A": {"width_deg": 0.002},
        "pitch_error.C": {"components": [[72.0, 0.001, 20.0]]},
        "squareness.YZ": {"angle_urad": 20.0},
        "straightness.EZX": {"quadratic_um": 2.0, "cubic_um": 1.0},
        "axis_location.EY0C": {"value_um": 8.0},
        "axis_location.EB0A": {"value_urad": 25.0},
    }
    for name, values in planted.items():
        faulty = faulty.with_effect(effect(name, **values))
    motion = part("cone", FIVE_AXIS, np.array(ZERO))
    result = predict(motion, faulty, "cone", zero=ZERO)
    time, at = paced(motion, generator_drives.GRID)
    program = type("Given", (), {"commands": staticmethod(lambda t: motion.at(np.interp(t, time, at)))})
    data = json.loads(json.dumps({a: _drive(machine, a) for a in "XYZAC"}))
    effects = planted | {e.id: dict(e.values) for e in machine.effects}
    motor, _ = generator_drives.run(data, effects, program, time)
    load = generator_transmission.load_side(motor, 20000.0 + time, data, effects)
    every = max(1, -(-len(time) // 3000))
    true = _tip_in_part(load[::every], np.array(ZERO), data, effects)
    path = result.path
    for i in np.linspace(200, len(path) - 200, 40).astype(int):
        off = np.linalg.norm(path - true[i], axis=1)
        j = int(np.argmin(off))
        near = [_to_line(true[i], path[k], path[k + 1]) for k in (j - 1, j)]
        assert min(near) == pytest.approx(np.linalg.norm(result.normal[i]), abs=0.1 * UM)


def _drive(machine, a):
    d = machine.drives[a]
    size = {"lead_mm": 2 * np.pi / d.gear / MM} if a in "XYZ" else {"worm_teeth": d.gear}
    return size | {
        "position_gain_per_s": d.position_gain,
        "velocity_gain_Nms_per_rad": d.velocity_gain,
        "integral_time_s": d.integral_time,
        "inertia_kgm2": d.inertia,
        "viscous_Nms_per_rad": d.viscous,
        "gravity_Nm": d.gravity,
    }


def _tip_in_part(load, zero, data, effects):
    """Tip in the part's coordinates: the part stands on the table as it was probed with the rotary axes at 0."""
    rest = np.zeros((1, 5))
    rest[0, :3] = zero
    rest = generator_transmission.load_side(rest, np.array([20000.0]), data, effects)
    place = lambda q, p: generator_kinematics.table_ball(q, p, effects)  # noqa: E731
    corner = place(rest, np.zeros(3))[0]
    turn = np.column_stack([place(rest, e)[0] - corner for e in np.eye(3)])
    out = np.empty((len(load), 3))
    for i, q in enumerate(load):
        origin = place(q[None], np.zeros(3))[0]
        axes = np.column_stack([place(q[None], e)[0] - origin for e in np.eye(3)])
        on_table = np.linalg.inv(axes) @ (q[:3] - origin)
        out[i] = turn @ on_table + corner - rest[0, :3] + zero
    return out


def _to_line(p, a, b):
    """Distance of a point from the stretch between two points."""
    share = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return float(np.linalg.norm(p - a - share * (b - a)))


# -- uncertainty and verdict -------------------------------------------------------------------------------------------


def diagnosed(machine, deviation, tolerance=True):
    """A diagnosis that leaves one squareness of 100 µrad uncertain by ``deviation`` µrad (standard deviation)."""
    m = machine.with_effect(effect("squareness.XY", angle_urad=100.0))
    m = replace(m, tolerance={"squareness": {"urad": 24.0}} if tolerance else {})
    fitted = (EffectVector(m.effect("squareness.XY"), ("angle_urad",)),)
    covariance = np.diag([(deviation / 20.0) ** 2, *np.full(len(data_sheet(FIVE_AXIS)), 1e-12)])
    return SavedDiagnosis("identified", m, (), Posterior(fitted, covariance), "", 0.1 * UM)


def circle():
    """A circle of radius 30 mm about the zero point, three axes: squareness α makes it an ellipse of 15 mm · α."""
    phi = np.linspace(0.0, 2.0 * np.pi, 1001)
    points = np.zeros((1001, 5))
    points[:, :3] = ZERO
    points[:, 0] += 30.0 * MM * np.cos(phi)
    points[:, 1] += 30.0 * MM * np.sin(phi)
    return Commanded(np.full(1000, 0.02), points)


def test_interval_is_that_of_the_diagnosis(machine):
    result = predict(circle(), machine, saved=diagnosed(stiff(machine), 20.0), zero=ZERO)
    value, low, high = (x / UM for x in result.largest)
    assert value == pytest.approx(1.5, rel=0.05)
    assert high - value == pytest.approx(1.96 * 0.3, rel=0.15) and value - low == pytest.approx(1.96 * 0.3, rel=0.15)
    assert result.uncertain[0][0] == "squareness.XY" and result.uncertain[0][1] > 0.99
    again = predict(circle(), machine, saved=diagnosed(stiff(machine), 20.0), zero=ZERO)
    assert [b.high for b in again.blocks] == [b.high for b in result.blocks]


@pytest.mark.parametrize(
    ("allowed", "tolerance", "verdict"),
    [(2.5, True, "passes"), (0.6, True, "fails"), (1.6, True, "cannot say"), (2.5, False, "cannot say")],
)
def test_verdicts(machine, allowed, tolerance, verdict):
    saved = diagnosed(stiff(machine), 20.0, tolerance)
    result = predict(circle(), machine, saved=saved, tolerance=allowed * UM, zero=ZERO)
    assert result.verdict.startswith(verdict), (result.largest, result.reason)
    if verdict == "cannot say" and tolerance:
        assert "--between squareness.XY nothing" in result.reason
    assert sum(result.counts.values()) == len(result.blocks) and result.worst.verdict == result.verdict
    for b in result.blocks:  # every block by its own interval
        if b.verdict == "fails":
            assert b.low > allowed * UM
        assert (b.verdict == "passes") == (b.high <= allowed * UM and tolerance)
    if tolerance:  # where the ellipse crosses the circle, nothing deviates
        assert any(b.verdict == "passes" for b in result.blocks)


def test_an_unknown_place_of_a_rotary_axis_asks_for_half_a_turn_of_the_spindle(machine):
    m = replace(
        stiff(machine).with_effect(effect("axis_location.EX0C", value_um=6.0)), tolerance={"squareness": {"urad": 24.0}}
    )
    fitted = (EffectVector(m.effect("axis_location.EX0C"), ("value_um",)),)
    sheet = np.full(len(data_sheet(FIVE_AXIS)), 1e-12)
    unsure = SavedDiagnosis("identified", m, (), Posterior(fitted, np.diag([0.04, *sheet])), "", 0.1 * UM)
    sure = predict(part("cone", FIVE_AXIS, np.array(ZERO)), m, saved=unsure, zero=ZERO)
    result = predict(part("cone", FIVE_AXIS, np.array(ZERO)), m, saved=unsure, tolerance=sure.largest[0], zero=ZERO)
    assert result.verdict.startswith("cannot say") and "spindle_deg" in result.reason


def test_causes_add_up_to_the_deviation(machine):
    m = machine.with_effect(effect("squareness.XY", angle_urad=300.0)).with_effect(effect("scale_error.X", ppm=50.0))
    result = predict(circle(), m, zero=ZERO)
    assert sum(c.at_worst for c in result.causes) == pytest.approx(result.largest[0], rel=1e-9)
    assert sum(c.at_worst for c in result.by_axis) == pytest.approx(result.largest[0], rel=1e-9)
    assert {c.key for c in result.by_axis} == {"servo lag", *"XYZAC"}
    assert result.worst.cause == "squareness.XY" and result.worst.share < result.largest[0] + 2 * UM
    small = result.to_json(blocks=False)
    assert small["blocks"][0]["normal_um"] == round(result.largest[0] / UM, 3) and len(small["blocks"]) == 6


def test_a_longer_tool_moves_the_slide(machine):
    """Straightness of Z acts where the slide is, not where the tip is."""
    bent = stiff(machine).with_effect(effect("straightness.EXZ", quadratic_um=20.0))
    a, b = (predict(part("cone", FIVE_AXIS, np.array(ZERO)), bent, tool=t, zero=ZERO) for t in (0.0, 0.1))
    assert np.abs(a.normal - b.normal).max() > 2 * UM


# -- programs and the command ------------------------------------------------------------------------------------------

PROGRAM = """%
O1
G90 G17 G21 G94
G43.4 H1
G0 X0. Y0. Z0. A5. C0.
G1 X20. Y0. Z0. A5. C10. F1000.
X20. Y20. A5. C20.
G49
M30
%
"""


def test_nc_files_with_tool_centre_control(machine, tmp_path):
    file = tmp_path / "part.nc"
    file.write_text(PROGRAM)
    name, motion, lines, notes = program_of(str(file), FIVE_AXIS, ZERO)
    assert notes == ("words that change no motion: H (1, first in line 4)",)
    assert name == "part.nc" and motion.tip and lines.tolist() == [5, 6, 7]
    result = predict(motion, machine, name, zero=ZERO, lines=lines)
    assert {b.line for b in result.blocks} == {6, 7}
    assert result.path[0] == pytest.approx(ZERO) and result.path[-1] == pytest.approx([0.06, 0.03, 0.12])


SQUARE = "G21 G90 G94 G17 {0}\nG0 X0. Y0. Z0.\nG1 X20. F3000.\nY20.\nX0.\nY0.\nM30\n"


def squared(machine, tmp_path, mode):
    file = tmp_path / f"{mode}.nc"
    file.write_text(SQUARE.format(mode))
    name, motion, lines, _ = program_of(str(file), FIVE_AXIS, ZERO)
    return predict(motion, machine, name, zero=ZERO, lines=lines, tolerance=50 * UM)


def test_exact_stop_is_another_motion_than_path_mode(machine, tmp_path):
    """In path mode a drive cuts the corner; at an exact stop it waits until the axes are in position."""
    exact, path = (squared(machine, tmp_path, mode) for mode in ("G61", "G64"))
    assert path.largest[0] > 100 * UM and exact.largest[0] < 0.1 * path.largest[0]
    gain = machine.drives["X"].position_gain
    rest = np.log(LINEAR / gain**2 / 10e-6) / gain  # from the lag of braking to 10 µm
    assert exact.seconds - path.seconds == pytest.approx(3 * rest, abs=3 * 0.05)
    corners = np.array([[20.0, 0.0], [20.0, 20.0], [0.0, 20.0]]) * MM + ZERO[:2]
    inside = exact.time > 0.2
    for corner in corners:  # the tip itself reaches the corner to 10 µm
        tip = exact.path[:, :2] + exact.normal[:, :2]
        assert np.linalg.norm(tip - corner, axis=1)[inside].min() < 0.5 * MM


def test_the_nearest_point_at_a_corner():
    """A tip that lags behind a corner on the side before it: by brute force against every point of the path."""
    corners = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.02, 0.02, 0.0]])
    path = np.vstack([np.linspace(a, b, 2001) for a, b in pairwise(corners)])
    late = np.array([1e-3, -2e-5, 0.0])
    for i, off in ((1990, late), (2000, late), (2003, late), (2100, late * [0.0, 1.0, 1.0])):
        tip = path[i] - off
        found = contour(path, tip[None], np.array([i]))
        assert found.size[0] == pytest.approx(np.linalg.norm(path - tip, axis=1).min(), abs=1e-9), i
    apart = contour(path, path[[2003]] - late, np.array([2003]), np.array([[2001, 4001]]))
    assert apart.size[0] == pytest.approx(1e-3 - 0.0, rel=0.1), "on its own path alone"


def test_verdicts_count_feed_moves_path_by_path(machine, tmp_path):
    """A rapid move over the part and a dwell count for nothing; each path has its own verdict."""
    file = tmp_path / "two.nc"
    file.write_text(
        "G21 G90 G94 G17\nG0 X0. Y0. Z0.\nG1 X5. F200.\nX30.\nG0 Z40.\nG4 P300\nX0. Y30.\nG0 Z0.\nG1 X20. F3000.\n"
        "Y40.\nG0 Z50.\nM30\n"
    )
    name, motion, lines, _ = program_of(str(file), FIVE_AXIS, ZERO)
    result = predict(motion, machine, name, zero=ZERO, lines=lines, tolerance=50 * UM)
    assert [(c.first, c.last) for c in result.cuts] == [(3, 4), (9, 10)] and set(result.cut_of) == {0, 1}
    assert {b.line for b in result.blocks} == {3, 4, 9, 10}
    assert result.path[:, 2].max() == pytest.approx(ZERO[2]), "no instant of the rapid moves"
    assert result.cuts[0].largest[0] < 10 * UM < 100 * UM < result.cuts[1].largest[0] == result.largest[0]
    assert [c.verdict for c in result.cuts] == ["cannot say with these measurements", "fails"]
    data = result.to_json()
    assert [p["verdict"] for p in data["paths"]] == [c.verdict for c in result.cuts]
    with pytest.raises(InputError, match="no feed block"):
        predict(replace(motion, cutting=np.zeros(len(motion.seconds), bool)), machine)


def test_the_command(tmp_path, machine):
    file = examples() / "hidden-backlash" / "machine.toml"
    out = ok(
        "predict", "cone", "--machine", file, "--tolerance", 500, "-o", tmp_path / "a.png", "--csv", tmp_path / "a.csv"
    )
    said = " ".join(out.stdout.split())
    assert "Cutting forces are not included" in said and "cannot say with these measurements" in said
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "a.csv").read_text().startswith("x_mm,y_mm,z_mm,normal_x_um")
    turns = tmp_path / "turns.nc"
    turns.write_text("G21 G90 G94\nG0 A5. C350.\nG43.4 H1 X0. Y0. Z0.\nG1 X1. C358. F600.\nX2. C6.\nG49\nM30\n")
    short = json.loads(ok("predict", turns, "--machine", file, "--rollover", "--json").stdout)
    back = json.loads(ok("predict", turns, "--machine", file, "--no-rollover", "--json").stdout)
    assert short["duration_s"] < 1.0 < back["duration_s"] and short["notes"] == [
        "words that change no motion: H (1, first in line 3)"
    ]
    mirrored = json.loads(ok("predict", turns, "--machine", file, "--reversed", "C", "--json").stdout)
    assert "the short way" in mirrored["notes"][0]
    data = json.loads(ok("predict", "pocket", "--machine", file, "--json").stdout)
    assert data["verdict"] is None and data["cutting_forces"] == "not included" and len(data["blocks"]) > 100
    for arguments, words in (
        (("cone",), "no machine is given"),
        (("s_shape", "--machine", file), "or one of cone, s-shape, sphere, boss, pocket"),
        ((tmp_path, "--machine", file), "a folder stands there"),
        (("cone", "--machine", file, "--tolerance", "-1"), "allowed: above 0"),
    ):
        refused = run("predict", *arguments)
        assert refused.exit_code == 1 and words in refused.stderr


def test_machines_with_a_head_are_refused(machine):
    chain = chain_of("w-C'bXYZB-t")
    motion = Commanded(np.ones(1), np.zeros((2, 5)), False, chain)
    with pytest.raises(InputError, match="allowed"):
        predict(motion, replace(machine, configuration=chain.configuration))
    with pytest.raises(InputError, match="unknown part"):
        part("gear", FIVE_AXIS, np.zeros(3))
