"""The error of the tool over the volume: closed forms, a set-up, corrections, uncertainty, and the files."""

from dataclasses import replace

import numpy as np
import pytest
from commands import as_json, ok, run

from mjsim.compensation.controls import control
from mjsim.compensation.tables import wanted_of
from mjsim.effects.registry import make
from mjsim.errors import InputError
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.posterior import Posterior
from mjsim.machine.chain import FIVE_AXIS
from mjsim.plots.volumetric import volumetric_figure
from mjsim.prediction.volumetric import Sender, grid_of, volumetric_error

RANGES = {a: (-0.2, 0.2) for a in FIVE_AXIS.linear}
URAD = 1e-6


@pytest.fixture(scope="module")
def machine(m1, bare):
    return bare(m1)


@pytest.fixture(scope="module")
def grid():
    return grid_of(FIVE_AXIS, RANGES, 0.1)


def test_a_slide_that_pitches_moves_the_tip_by_the_arm_and_turns_the_tool(machine, grid):
    q = grid.points
    angle = URAD * (30.0 * q[:, 0] / 0.1 + 10.0 * (q[:, 0] / 0.1) ** 2)
    effect = make("angular_error.EBX", linear_urad=30.0, quadratic_urad=10.0)
    error = volumetric_error(machine.with_effect(effect), grid)
    np.testing.assert_allclose(error.shift, np.outer(angle * q[:, 2], [1, 0, 0]), rtol=0, atol=2e-9)
    np.testing.assert_allclose(error.turn, np.outer(angle, [0, 1, 0]), rtol=0, atol=1e-8)
    # a tool that is 80 mm longer: the tip goes the other way at Z = 80 mm less
    longer = volumetric_error(machine.with_effect(effect), replace(grid, tool=0.08))
    arm = q[:, 2] - 0.08
    np.testing.assert_allclose(longer.shift, np.outer(angle * arm, [1, 0, 0]), rtol=0, atol=2e-9)


def test_an_error_of_the_set_up_is_none_of_the_part(machine, grid):
    """Where the rotary axes stand at 0, a turned table is aligned away; where they do not, it shows."""
    turned = machine.with_effect(make("axis_location.EC0A", value_urad=40.0))
    assert np.abs(volumetric_error(turned, grid).shift).max() < 1e-15
    tilted = volumetric_error(turned, replace(grid, rotary={"A": 0.5}))
    assert 1e-6 < np.abs(tilted.shift).max() < 40e-6


@pytest.mark.parametrize("tool", [0.0, 0.08])
def test_corrections_of_a_control_that_knows_the_arm_take_the_shift_and_leave_the_turn(machine, grid, tool):
    effects = [make("angular_error.EBX", linear_urad=30.0), make("squareness.YZ", angle_urad=25.0)]
    erring = machine.with_effects(effects)
    wanted, _ = wanted_of(erring, effects)
    who = control("csv")
    made = who.corrections(wanted, RANGES | {"A": (-1.0, 1.0), "C": (0.0, 6.0)})
    how = replace(who.arithmetic(FIVE_AXIS), tool=tool)
    error = volumetric_error(erring, replace(grid, tool=tool), None, made, how)
    assert error.corrected_shift is not None and error.corrected_turn is not None
    assert np.abs(error.shift).max() > 5e-6 > 1000 * np.abs(error.corrected_shift).max()
    np.testing.assert_allclose(error.corrected_turn, error.turn, rtol=0, atol=1e-8)


def test_the_uncertainty_is_that_of_the_posterior(machine, grid):
    """An angle that is known to 3 µrad over 100 mm: k = 2 at the arm Z."""
    effect = make("angular_error.EBX", linear_urad=30.0)
    free = EffectVector(effect, ("linear_urad",))
    sheet = 5 * 7  # numbers of the data sheet, which move nothing that stands still
    covariance = np.zeros((1 + sheet, 1 + sheet))
    covariance[0, 0] = 0.3**2  # typical sizes of 10 µrad
    error = volumetric_error(machine.with_effect(effect), grid, Posterior((free,), covariance))
    q = grid.points
    want = 2.0 * np.abs(3.0 * URAD * q[:, 0] / 0.1 * q[:, 2])
    assert error.uncertainty is not None
    np.testing.assert_allclose(error.uncertainty, np.outer(want, [1, 0, 0]), rtol=0, atol=1e-9)


def test_vtk_and_csv_hold_the_same_places_and_numbers(machine):
    grid = grid_of(FIVE_AXIS, {"X": (-0.1, 0.1), "Y": (0.0, 0.1), "Z": (0.0, 0.15)}, 0.05)
    error = volumetric_error(machine.with_effect(make("squareness.XY", angle_urad=50.0)), grid)
    lines = error.vtk_text("Mühle").splitlines()
    assert lines[:4] == ["# vtk DataFile Version 3.0", "M?hle: error of the tool; mm, um, urad", "ASCII",
                         "DATASET RECTILINEAR_GRID"]  # fmt: skip
    assert lines[4] == "DIMENSIONS 5 3 4"
    ends = [np.array(lines[k].split(), float) for k in (6, 8, 10)]
    assert lines[11] == "POINT_DATA 60" and lines[12] == "VECTORS error_um double"
    vectors = np.array([row.split() for row in lines[13:73]], float)
    head, *rows = error.csv_text().splitlines()
    table = dict(zip(head.split(","), np.array([r.split(",") for r in rows], float).T, strict=True))
    for k, (h, j, i) in enumerate(np.ndindex(4, 3, 5)):  # x fastest
        place = [table[f"{a}_mm"][k] for a in "XYZ"]
        assert place == pytest.approx([ends[0][i], ends[1][j], ends[2][h]])
        assert vectors[k] == pytest.approx([-50.0 * place[1] / 1000.0, 0.0, 0.0], abs=1e-5)
        assert vectors[k][0] == pytest.approx(table["error_x_um"][k])


def test_bad_grids_are_refused():
    with pytest.raises(InputError, match="range of X"):
        grid_of(FIVE_AXIS, {**RANGES, "X": (0.1, 0.1)}, 0.1)
    with pytest.raises(InputError, match="places; allowed"):
        grid_of(FIVE_AXIS, RANGES, 0.001)


def test_a_sender_without_corrections_changes_nothing(grid):
    assert Sender().sent(grid.points) is not None
    np.testing.assert_array_equal(Sender().axes(np.zeros((1, 5))), np.eye(3))


def test_the_command_writes_a_map_of_a_planned_campaign(tmp_path):
    """Without a trace it is the machine of the file; its tolerance says how well that is known."""
    ok("new", "campaign", tmp_path / "plan")
    file = tmp_path / "plan" / "machine.toml"
    text = file.read_text(encoding="utf-8")
    before, rest = text.split("# [tolerance]")
    table, drives = rest.split("[drive.", 1)
    stated = "".join(line.removeprefix("# ") for line in table.splitlines(keepends=True))
    file.write_text(before + "[tolerance]" + stated + "[drive." + drives, encoding="utf-8")
    out = tmp_path / "map"
    data = as_json("export", tmp_path / "plan", "--volumetric", "--step", "80", "--out", out)
    assert data["basis"] == "by the machine file and its tolerance" and data["largest_U95_um"] > 1.0
    assert sorted(p.name for p in out.iterdir()) == ["volumetric.csv", "volumetric.png", "volumetric.vtk"]
    failed = run("export", tmp_path / "plan", "--control", "csv", "--out", tmp_path / "other")
    assert failed.exit_code == 1 and "with --volumetric" in failed.output
    failed = run("export", tmp_path / "plan", "--volumetric", "--range", "C", "0", "9", "--out", tmp_path / "other")
    assert failed.exit_code == 1 and "range of C; allowed: X, Y, Z" in failed.output


def test_the_picture_has_a_box_for_each_state(machine, grid):
    error = volumetric_error(machine.with_effect(make("squareness.XY", angle_urad=50.0)), grid)
    alone = volumetric_figure(error, "as it is")
    both = volumetric_figure(replace(error, corrected_shift=0.1 * error.shift, corrected_turn=error.turn), "both")
    assert [len(f.axes) for f in (alone, both)] == [2, 3]  # boxes and the scale of colours
