"""``mjsim machine new`` and the catalogue of a machine."""

import json
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from click.testing import CliRunner

from mjsim.animation.scene import Stage
from mjsim.campaign.machine_file import read_machine
from mjsim.cli.main import main
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import Placement, chain_of
from mjsim.units import DEG


def run(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.mark.parametrize(
    ("options", "chain"),
    [
        (["w-C'A'Y'bXZ-t"], chain_of("w-C'A'Y'bXZ-t")),
        (["w-C'bXYZB-t", "--tool-length", "240"], chain_of("w-C'bXYZB-t", (), 0.24)),
        (["w-bXYZCA-t", "--offset", "A", "0", "0", "10"], None),
        (["w-C'B'Y'bXZ-t", "--direction", "B", "0", "1", "1"], None),
        (["XY"], chain_of("XY")),
    ],
)
def test_a_new_machine_reads_back(tmp_path, options, chain):
    folder = tmp_path / "new"
    result = run("machine", "new", "--configuration", *options, "-o", folder, "--json")
    assert result.exit_code == 0, result.output
    machine = read_machine(folder / "machine.toml")
    assert machine.chain.configuration == options[0] and json.loads(result.output)["axes"] == list(
        machine.chain.letters
    )
    assert chain is None or machine.chain.counter_clockwise == chain
    if machine.chain.spatial:
        model = mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
        assert [model.joint(a).name for a in machine.chain.letters] == list(machine.chain.letters)
    again = run("machine", "new", "--configuration", *options, "-o", folder)
    assert again.exit_code == 1 and "not empty" in again.output


def test_options_place_axes(tmp_path):
    run("machine", "new", "--configuration", "w-bXYZCA-t", "--offset", "A", "0", "0", "10", "-o", tmp_path / "a")
    assert read_machine(tmp_path / "a" / "machine.toml").chain.axis("A").point == pytest.approx((0, 0, 0.26))
    run("machine", "new", "--configuration", "w-C'B'Y'bXZ-t", "--direction", "B", "0", "1", "1", "-o", tmp_path / "b")
    chain = read_machine(tmp_path / "b" / "machine.toml").chain
    assert chain.axis("B").unit == pytest.approx(
        chain_of("w-C'B'Y'bXZ-t", (("B", Placement((0, 1, 1))),)).axis("B").unit
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["w-C'D'Y'bXZ-t"], "is unknown"),
        (["w-C'A'Y'bXZ-t", "--tool-length", "200"], "does not turn"),
        (["w-C'bXYZB-t", "--tool-length", "-1"], "allowed: above 0"),
        (["w-C'A'Y'bXZ-t", "--direction", "A", "0", "0", "1"], "within 60"),
        (["w-C'A'Y'bXZ-t", "--offset", "B", "0", "0", "1"], "cannot be placed"),
    ],
)
def test_wrong_options_write_nothing(tmp_path, options, said):
    result = run("machine", "new", "--configuration", *options, "-o", tmp_path / "new")
    assert result.exit_code == 1 and said in result.output and not (tmp_path / "new").exists()


def test_the_catalogue_of_a_machine(tmp_path):
    run("machine", "new", "--configuration", "w-C'bXYZB-t", "-o", tmp_path / "m")
    listed = json.loads(run("effects", "--machine", tmp_path / "m" / "machine.toml", "--json").output)["effects"]
    of = {e["kind"]: e["subjects"] for e in listed}
    assert of["axis_location"] == ["EX0C", "EY0C", "EA0C", "EB0C", "EZ0B", "EA0B", "EC0B"]
    assert of["gravity_windup"] == ["B"] and of["tilt_error_motion"] == ["B", "C"]
    for subject, said in (
        ("EZ0B", "B centreline displaced along Z, on Z"),
        ("EA0C", "C centreline turned about X, on"),
    ):
        shown = run("effects", f"axis_location.{subject}", "--machine", tmp_path / "m" / "machine.toml").output
        assert f"subject: {said}" in shown
    assert "subject" not in run("effects", "backlash.B", "--machine", tmp_path / "m" / "machine.toml").output
    result = run("effects", "backlash.A", "--machine", tmp_path / "m" / "machine.toml")
    assert result.exit_code == 1 and "X, Y, Z, B, C" in result.output


def test_a_head_table_machine_is_drawn_along_a_test():
    """Every pose of a cone: the balls are drawn where the kinematics say, and the picture shows the machine."""
    chain = chain_of("w-C'bXYZB-t")
    test = BallBarTest("t", "cone_frustum", (0.05, 0.0, 0.155), 0.1, 0.02, 15 * DEG, 10 * DEG, chain=chain)
    q = Program(test).path(np.linspace(0.0, 6.0, 7))
    with Stage(test, 160, 120) as stage:
        pictures = []
        for row in q:
            balls = stage.pose(row, 1e-3)
            assert np.linalg.norm(balls.spindle - balls.table) == pytest.approx(0.1, abs=1e-9)
            assert np.linalg.norm(balls.ghost - balls.table) == pytest.approx(0.101, abs=1e-9)
            pictures.append(stage.render("overview", 160, 120, balls).astype(int))
        assert pictures[0].std() > 20
        assert all(np.abs(a - b).max() > 50 for a, b in pairwise(pictures))
    turn = BallBarTest("t", "rotary", (0.1, 0.0, 0.155), 0.1, 0.02, chain=chain, axis="B", sensitive="radial", stop=0.5)
    with Stage(turn, 160, 120) as stage:
        assert stage.model.body(stage.carrier).name == "table"


def test_nc_programs_of_a_head_table_machine_come_back(tmp_path):
    """Written, read and compared with the test; signs and limits are those of its own axes."""
    run("machine", "new", "--configuration", "w-C'bXYZB-t", "-o", tmp_path / "c")
    cone = 'half_apex_deg = 15\ninclination_deg = 10\nsensitive_direction = "perpendicular"\ndirection = "CW"\n'
    (tmp_path / "c" / "campaign.toml").write_text(
        f'name = "x"\n[[test]]\nname = "t"\nkind = "cone_frustum"\n{cone}table_ball_mm = [50, 0, 155]\n'
        "bar_length_mm = 100\nfeed_mm_min = 1000\nrevolutions = 1\n"
    )
    common = ("--test", "t", "--reversed", "B")
    for mode in ("a11", "tcp"):
        file = tmp_path / f"{mode}.nc"
        written = run("nc", "write", tmp_path / "c", *common, "--feed-mode", mode, "-o", file)
        assert written.exit_code == 0, written.output
        assert "PIVOT OF THE HEAD 250 MM" in file.read_text()
        back = run("nc", "read", file, "--campaign", tmp_path / "c", *common, "--json")
        assert back.exit_code == 0, back.output
        found = json.loads(back.output)["deviation"]
        assert max(found["position_um"].values()) < 5.0 and set(found["angle_urad"]) == {"B", "C"}
    wrong = run("nc", "write", tmp_path / "c", "--test", "t", "--reversed", "A", "-o", tmp_path / "x.nc")
    assert wrong.exit_code == 1 and "reversed axis 'A'; allowed: B, C" in wrong.output
    wrong = run("nc", "write", tmp_path / "c", "--test", "t", "--limit", "A", "0", "1", "-o", tmp_path / "x.nc")
    assert wrong.exit_code == 1 and "no such axis; allowed: X, Y, Z, B, C" in wrong.output


@pytest.mark.parametrize("configuration", ["w-C'A'Y'bXZ-t", "w-C'B'Y'bXZ-t"])
def test_a_chain_is_made_again_from_its_placements(configuration):
    chain = chain_of(configuration)
    assert chain.placements == () and chain_of(configuration, chain.placements) == chain
    placed = chain_of("w-C'bXYZB-t", (("B", Placement((0, 1, 1), (0.001, 0, 0.02))),), 0.3)
    again = chain_of("w-C'bXYZB-t", placed.placements, placed.tool_length)
    assert again.axis("B").unit == pytest.approx(placed.axis("B").unit, abs=1e-15)
    assert again.axis("B").point == pytest.approx(placed.axis("B").point, abs=1e-15)
