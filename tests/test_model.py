"""The machine's MuJoCo model: it compiles cleanly, its kinematics are the closed form, its inertias the data
sheet's, its parts solid.
"""

import subprocess
import sys
import warnings
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.model import build
from mjsim.machine.modelling import machine_xml
from mjsim.simulation.mjmodel import build_model

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts" / "figures"))

import build_solids  # noqa: E402
from build_solids import cylinder, differences, loft, write_folder  # noqa: E402

XML = ROOT / "models" / "five_axis.xml"
SCENE = ROOT / "models" / "scene.xml"
AXES = "XYZAC"
#: Joints, actuators and sensors: the tool's side of the tree, then the table's.
ORDER = "XZYAC"

# J [kg m2] and gear [rad/m or rad/rad] of the data sheet.
DATA_SHEET = {
    "X": (0.0100, 2 * np.pi / 0.010),
    "Y": (0.0130, 2 * np.pi / 0.010),
    "Z": (0.0105, 2 * np.pi / 0.010),
    "A": (0.0042, 60),
    "C": (0.0036, 72),
}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(XML))


@pytest.fixture(scope="module")
def scene() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(SCENE))


def rx(a: float) -> np.ndarray:
    return np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])


def rz(c: float) -> np.ndarray:
    return np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])


def set_pose(model: mujoco.MjModel, data: mujoco.MjData, pose) -> None:
    for name, value in zip(AXES, pose, strict=True):
        data.joint(name).qpos[0] = value
    mujoco.mj_forward(model, data)


def random_poses(n: int) -> np.ndarray:
    rng = np.random.default_rng(2013)
    half = np.array([0.6, 0.6, 0.3, np.radians(100), 2 * np.pi])
    return rng.uniform(-half, half, size=(n, 5))


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """The joint-space inertia, rows and columns in the order X Y Z A C."""
    dof = [model.joint(name).dofadr[0] for name in AXES]
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full[np.ix_(dof, dof)]


@pytest.fixture
def engine_warnings():
    """What MuJoCo's own warning channel says during a test."""
    heard: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(heard.append)
    yield heard
    mujoco.set_mju_user_warning(before)


def raised(data: mujoco.MjData) -> dict[str, int]:
    """MuJoCo's warnings of a run."""
    return {mujoco.mjtWarning(k).name: int(w.number) for k, w in enumerate(data.warning) if w.number}


@pytest.mark.parametrize("file", [XML, SCENE], ids=lambda file: file.stem)
def test_compiles_and_rests_at_home_without_warnings(engine_warnings, file):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    start = data.qpos.copy()
    for _ in range(1000):
        mujoco.mj_step(model, data)
    assert not raised(data) and not engine_warnings
    assert np.abs(data.qacc).max() < 1e-9
    np.testing.assert_allclose(data.qpos, start, rtol=0, atol=1e-12)  # nothing sags: gravity is counterbalanced
    assert data.ncon == 0


def test_options(model, scene, m1):
    """The machine alone sets none, so that it takes those of what it is attached to."""
    assert model.opt.timestep == mujoco.MjSpec().option.timestep and scene.opt.timestep == 0.001
    simulated = build_model(build(m1))
    for checked in (model, scene, simulated):
        assert checked.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
        assert not checked.dof_damping.any() and not checked.dof_frictionloss.any() and not checked.jnt_stiffness.any()
    assert simulated.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    assert (scene.vis.global_.offwidth, scene.vis.global_.offheight) == (1920, 1080)
    for body in range(1, model.nbody):
        assert model.body_gravcomp[body] == (model.body(body).name not in ("bed", "column"))


def test_chain(model):
    """w-C'A'Y'bXZ-t."""

    def chain(site: str) -> list[str]:
        body, names = int(model.site(site).bodyid[0]), []
        while body:
            names.append(model.body(body).name)
            body = int(model.body_parentid[body])
        return names

    assert chain("table_ball") == ["table_fixture", "table", "cradle", "y_slide", "bed"]
    assert chain("spindle_ball") == ["spindle", "z_slide", "x_slide", "column"]
    of = {"X": "x_slide", "Y": "y_slide", "Z": "z_slide", "A": "cradle", "C": "table"}
    axis = {"X": (1, 0, 0), "Y": (0, -1, 0), "Z": (0, 0, 1), "A": (1, 0, 0), "C": (0, 0, 1)}
    assert model.njnt == model.nu == 5
    for name in AXES:
        joint = model.joint(name)
        assert model.body(int(joint.bodyid[0])).name == of[name]
        np.testing.assert_array_equal(joint.axis, axis[name])
        np.testing.assert_array_equal(joint.pos, 0)
        assert bool(joint.limited[0]) == (name != "C")
    for body in ("y_slide", "cradle", "table", "x_slide", "z_slide", "spindle"):
        np.testing.assert_array_equal(model.body(body).pos, 0)
        np.testing.assert_array_equal(model.body(body).quat, (1, 0, 0, 0))
    np.testing.assert_array_equal(model.body("table_fixture").pos, (0, 0, 0.155))


def test_joints_actuators_and_sensors_have_one_order(model):
    assert [model.joint(k).name for k in range(model.njnt)] == list(ORDER)
    assert [model.actuator(k).name for k in range(model.nu)] == list(ORDER)
    assert [model.sensor(k).name for k in range(5)] == [f"{a}_pos" for a in ORDER]
    np.testing.assert_array_equal(model.jnt_qposadr, range(5))
    np.testing.assert_array_equal(model.actuator_trnid[:, 0], range(5))
    home = model.key("home")
    np.testing.assert_array_equal(home.qpos, home.ctrl)
    assert model.actuator_forcelimited.all() and model.actuator_ctrllimited.all()


def test_the_machine_alone_has_nothing_of_a_scene(model, scene):
    assert not (model.nlight or model.ncam or model.ntex)
    assert model.geom_bodyid.all()  # no geom in the world body: no floor
    assert {scene.camera(k).name for k in range(scene.ncam)} == {"overview", "closeup", "side"}
    assert scene.nlight == 2 and scene.geom("floor").type == mujoco.mjtGeom.mjGEOM_PLANE
    np.testing.assert_array_equal(scene.body_inertia, model.body_inertia)


def test_visual_and_collision_geoms(model):
    """Solids to look at and to weigh in group 2, weightless simple shapes to touch in group 3, as in MuJoCo
    Menagerie.
    """
    touching = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    mesh = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    np.testing.assert_array_equal(mesh, ~touching)
    np.testing.assert_array_equal(model.geom_group, np.where(touching, 3, 2))
    spec = mujoco.MjSpec.from_file(str(XML))
    for geom in [g for g in spec.geoms if g.contype]:
        assert geom.mass == 0
        spec.delete(geom)
    bare = spec.compile()
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat"):
        np.testing.assert_array_equal(getattr(bare, field), getattr(model, field))  # to the last bit


def test_attaches_to_another_model(engine_warnings):
    """A cell with a machine, moved and turned, still moves as the machine alone."""
    cell = mujoco.MjSpec()
    cell.option.timestep = 0.002
    cell.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.1])
    frame = cell.worldbody.add_frame(pos=[3.0, -1.0, 1.151], euler=[0, 0, 30])
    cell.attach(mujoco.MjSpec.from_file(str(XML)), prefix="m1/", frame=frame)
    model = cell.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("m1/home").id)
    for _ in range(200):
        mujoco.mj_step(model, data)
    assert abs(data.sensor("m1/ball_bar_length").data[0] - 0.1) < 1e-9
    assert not raised(data) and not engine_warnings and data.ncon == 0


def test_ball_distance_is_the_closed_form(model):
    data = mujoco.MjData(model)
    p = np.array([0, 0, 0.155])
    for x, y, z, a, c in random_poses(200):
        set_pose(model, data, (x, y, z, a, c))
        expected = np.linalg.norm(np.array([x, y, z]) - rx(a) @ rz(c) @ p)
        measured = data.sensor("spindle_ball_pos").data - data.sensor("table_ball_pos").data
        assert abs(np.linalg.norm(measured) - expected) < 1e-12
        assert abs(data.ten_length[model.tendon("ball_bar").id] - expected) < 1e-12
        assert abs(data.sensor("ball_bar_length").data[0] - expected) < 1e-12


def test_a_moved_fixture_follows_equation_a9(model):
    spec = mujoco.MjSpec.from_file(str(XML))
    p = np.array([0.2, -0.13, 0.155])
    spec.body("table_fixture").pos = p
    moved = spec.compile()
    data = mujoco.MjData(moved)
    for x, y, z, a, c in random_poses(50):
        set_pose(moved, data, (x, y, z, a, c))
        expected = rx(a) @ rz(c) @ p - [0, y, 0]
        np.testing.assert_allclose(data.site("table_ball").xpos, expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(moved.body_mass, model.body_mass)  # the fixture weighs nothing


def test_home_has_the_nominal_bar_length(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    assert abs(data.ten_length[model.tendon("ball_bar").id] - 0.1) < 1e-12
    for name, value in zip(AXES, (0.1, 0, 0.155, 0, 0), strict=True):
        assert data.joint(name).qpos[0] == value
        assert data.actuator(name).ctrl[0] == value


def test_mass_matrix_is_the_data_sheets(model):
    data = mujoco.MjData(model)
    expected = np.array([j * gear**2 for j, gear in DATA_SHEET.values()])
    for pose in [np.zeros(5), *random_poses(20)]:
        set_pose(model, data, pose)
        m = mass_matrix(model, data)
        np.testing.assert_allclose(np.diag(m), expected, rtol=1e-6)
        scaled = m / np.sqrt(np.outer(np.diag(m), np.diag(m)))
        assert np.abs(scaled - np.diag(np.diag(scaled))).max() < 1e-6


def test_masses_and_balance(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert (model.dof_armature > 0).all()
    assert model.body("x_slide").subtreemass < 1500
    assert model.body("z_slide").subtreemass < 800
    assert model.body("y_slide").subtreemass < 1500
    total = {name: j * gear**2 for name, (j, gear) in DATA_SHEET.items()}
    assert total["A"] - model.dof_armature[model.joint("A").dofadr[0]] < 12
    assert total["C"] - model.dof_armature[model.joint("C").dofadr[0]] < 6
    cradle, table = data.body("cradle").subtree_com, data.body("table").subtree_com
    assert np.abs(cradle[1:]).max() < 1e-6  # on the A centreline
    assert np.abs(table[:2]).max() < 1e-6  # on the C centreline


def test_viewer_actuators_are_stable_and_damped(scene):
    model = scene
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    target = np.array([-0.2, 0.2, 0.4, np.radians(60), np.radians(180)])
    for name, value in zip(AXES, target, strict=True):
        data.actuator(name).ctrl[0] = value
    start = np.array([0.1, 0, 0.155, 0, 0])
    overshoot = 0.0
    for _ in range(3000):
        mujoco.mj_step(model, data)
        done = (np.array([data.joint(n).qpos[0] for n in AXES]) - start) / (target - start)
        overshoot = max(overshoot, done.max() - 1)
    assert overshoot < 0.02
    np.testing.assert_allclose(done, 1, atol=1e-6)


def test_assets_are_closed_and_reproducible(tmp_path):
    files = sorted((XML.parent / "assets").glob("*.stl"))
    assert files
    for path in files:
        mesh = trimesh.load_mesh(path)
        assert mesh.is_watertight, path.name
        assert mesh.is_winding_consistent, path.name
        assert mesh.volume > 0, path.name
    done = subprocess.run(
        [sys.executable, ROOT / "scripts" / "figures" / "build_solids.py", "--check"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_folder_is_written_whole_and_compared(tmp_path):
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets" / "old.stl").write_bytes(b"of another machine")
    (tmp_path / "README.md").write_text("mine")
    machine = build_solids.machine()
    write_folder(machine, tmp_path)
    assert differences(machine, tmp_path) == [] and (tmp_path / "README.md").read_text() == "mine"
    assert (tmp_path / "five_axis.xml").read_bytes() == XML.read_bytes()
    (tmp_path / "scene.xml").write_text("<mujoco/>")
    (tmp_path / "assets" / "ball.stl").unlink()
    assert differences(machine, tmp_path) == ["assets/ball.stl", "scene.xml"]


def test_every_asset_is_used(model):
    used = {model.mesh(k).name for k in range(model.nmesh)}
    assert used == {path.stem for path in (XML.parent / "assets").glob("*.stl")}


#: Bodies that can meet: the tool's side and the table's.
TOOL_SIDE = ("column", "x_slide", "z_slide", "spindle")
TABLE_SIDE = ("bed", "y_slide", "cradle", "table", "table_fixture")


@pytest.fixture(scope="module")
def solids() -> tuple[mujoco.MjModel, dict[str, list[int]]]:
    """The machine with every convex piece of its solids as a geom, and the pieces' numbers by body."""
    spec = mujoco.MjSpec.from_file(str(XML))
    machine = build_solids.machine()
    hollow = {"table_top", "table_scale", "table_mark"}  # inside the disc below, or paint
    made = {(b.name, p.mesh): p.pieces for b in machine.bodies for p in b.parts if p.mesh not in hollow}
    made["table", "disc"] = [
        cylinder("z", build_solids.DIMENSIONS.table_radius, 0.055, build_solids.DIMENSIONS.table_top)
    ]
    names: dict[str, list[str]] = {}
    for (body, mesh), pieces in made.items():
        for k, (vertices, faces) in enumerate(c for piece in pieces for c in convex(piece)):
            name = f"{body} {mesh} {k}"
            spec.add_mesh(name=name, uservert=vertices.ravel(), userface=faces.ravel())
            spec.body(body).add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, mass=0, contype=0, conaffinity=0
            )
            names.setdefault(body, []).append(name)
    model = spec.compile()
    return model, {body: [model.geom(n).id for n in listed] for body, listed in names.items()}


def convex(piece: tuple[np.ndarray, np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    """A turned piece with a neck, ring by ring; MuJoCo takes the convex hull of a mesh."""
    vertices, _ = piece
    rings = vertices.reshape(-1, 64, 3) if len(vertices) % 64 == 0 else ()
    return [loft(pair) for pair in pairwise(rings) if not np.allclose(pair[0].mean(axis=0), pair[1].mean(axis=0))] or [
        piece
    ]


def gaps(model: mujoco.MjModel, data: mujoco.MjData, ones: list[int], others: list[int], reach: float = 0.05):
    """The distances (m) of geoms that are near each other, with their names; negative where they overlap."""
    for one in ones:
        for other in others:
            if (
                np.linalg.norm(data.geom_xpos[one] - data.geom_xpos[other])
                <= model.geom_rbound[one] + model.geom_rbound[other]
            ):
                gap = mujoco.mj_geomDistance(model, data, one, other, reach, None)
                yield gap, (model.geom(one).name, model.geom(other).name)


def of(pieces: dict[str, list[int]], bodies: tuple[str, ...]) -> list[int]:
    return [k for body in bodies for k in pieces[body]]


@pytest.mark.parametrize("method", ["perpendicular", "parallel"])
@pytest.mark.parametrize("theta, beta", [(15, 10), (15, 30), (45, 10), (45, 30)])
def test_nothing_collides_in_the_papers_tests(solids, theta, beta, method):
    """Convex piece against convex piece, tool side against table side, over cone-frustum circles (A.5 to A.9)."""
    model, pieces = solids
    data = mujoco.MjData(model)
    sphere = mujoco.mjtGeom.mjGEOM_SPHERE
    ball = {model.geom("spindle ball 0").id, model.geom("table_fixture ball 0").id}
    tool = [k for k in of(pieces, ("x_slide", "z_slide", "spindle")) if k not in ball]
    work = [k for k in of(pieces, ("y_slide", "cradle", "table")) if k not in ball]

    th, be, length = np.radians(theta), np.radians(beta), 0.1
    tilt = np.array([[np.cos(be), 0, np.sin(be)], [0, 1, 0], [-np.sin(be), 0, np.cos(be)]])
    for xt, yt in ((0, 0), (0.2, 0), (0, 0.2), (-0.2, 0), (0, -0.2), (0.2, 0.2)):
        model.body("table_fixture").pos[:2] = xt, yt
        for phi in np.radians(np.arange(0, 360, 30)):
            if method == "perpendicular":
                p = length * np.array([np.cos(th) * np.cos(phi), np.cos(th) * np.sin(phi), np.sin(th)])
                apex = length / np.sin(th)
            else:
                p = length * np.array([np.cos(phi), np.sin(phi), 0])
                apex = length / np.tan(th)
            p, apex = tilt @ p, tilt @ [0, 0, apex]
            t = apex - p
            t /= np.linalg.norm(t)
            a, c = np.arccos(t[2]), np.arctan2(t[0], t[1])
            xyz = rx(a) @ rz(c) @ (p + np.array([xt, yt, 0.155]))
            set_pose(model, data, (*xyz, a, c))
            assert abs(data.sensor("ball_bar_length").data[0] - length) < 1e-12
            # nor do the shapes for collisions touch, which are a little larger; as above, without the balls
            assert not [c for c in data.contact[: data.ncon] if sphere not in model.geom_type[c.geom]], (xt, yt, phi)
            for gap, names in gaps(model, data, tool, work):
                assert gap > 0.005, (names, xt, yt, np.degrees(phi))
    model.body("table_fixture").pos[:2] = 0.0


def test_where_solids_overlap_their_shapes_touch(solids):
    """No part can pass through another unnoticed: 150 poses all over the travel, half of them with the spindle near
    the table.
    """
    model, pieces = solids
    data = mujoco.MjData(model)
    tool, work = of(pieces, TOOL_SIDE), of(pieces, TABLE_SIDE)
    rng = np.random.default_rng(7)
    low = np.array([-0.6, -0.6, -0.3, -np.radians(100), -np.pi])
    high = np.array([0.6, 0.6, 0.7, np.radians(100), np.pi])
    overlaps = 0
    for k in range(150):
        pose = rng.uniform(low, high)
        if k % 2:
            pose[:3] = rng.uniform((-0.6, -0.5, -0.3), (0.6, 0.5, 0.1))
        set_pose(model, data, pose)
        deepest = min(gaps(model, data, tool, work, 0.0), default=(0.0, ("", "")))
        if deepest[0] < -0.001:
            overlaps += 1
            assert data.ncon > 0, (deepest, pose)
    assert overlaps > 25  # it is no empty test


@pytest.mark.parametrize(
    "axis, ends", [("X", (-0.6, 0.6)), ("Y", (-0.6, 0.6)), ("Z", (-0.3, 0.7)), ("A", (-1.745, -0.8, 0.8, 1.745))]
)
def test_slides_are_free_up_to_their_ends(solids, axis, ends):
    """What slides or turns on its neighbours goes through nothing of its own side."""
    model, pieces = solids
    data = mujoco.MjData(model)
    for end in ends:
        pose = dict.fromkeys(AXES, 0.0) | {"Z": 0.7} | {axis: end}
        set_pose(model, data, pose.values())
        for side in (TOOL_SIDE, TABLE_SIDE):
            for i, one in enumerate(side):
                for gap, names in gaps(model, data, pieces[one], of(pieces, side[i + 1 :])):
                    assert gap > -1e-4, (names, axis, end)


#: Where somebody pushes the sliders of the viewer to, and the two bodies that meet; the rest stays at home.
CRASHES = {
    "down on the table": ({"Z": -0.3}, {"spindle", "table"}),
    "down on the ball": ({"X": 0.0, "Z": -0.3}, {"spindle", "table_fixture"}),
    "table tilted and spindle down": ({"A": 1.6, "Z": -0.3}, {"spindle", "table"}),
    "table tilted into the head": ({"A": 1.745, "Y": -0.2, "X": 0.2, "Z": -0.3}, {"table", "z_slide"}),
    "into the cradle's cheek": ({"X": 0.5, "Z": -0.3}, {"spindle", "cradle"}),
    "into the motor of A": ({"X": 0.6, "Y": 0.3, "Z": -0.3}, {"spindle", "y_slide"}),
}


@pytest.mark.parametrize("crash", CRASHES)
def test_parts_do_not_pass_through_each_other(scene, engine_warnings, crash):
    sliders, bodies = CRASHES[crash]
    data = mujoco.MjData(scene)
    mujoco.mj_resetDataKeyframe(scene, data, scene.key("home").id)
    for name, value in sliders.items():
        data.actuator(name).ctrl[0] = value
    deepest, met = 0.0, set()
    for _ in range(3000):
        mujoco.mj_step(scene, data)
        for contact in data.contact[: data.ncon]:
            deepest = min(deepest, contact.dist)
            met.add(frozenset(scene.body(int(scene.geom_bodyid[g])).name for g in contact.geom))
    assert bodies in met
    assert deepest > -0.0015  # at full speed; what is pressed together afterwards holds within micrometres
    assert all(c.dist > -1e-5 for c in data.contact[: data.ncon])
    assert np.abs(data.qvel).max() < 0.05  # it comes to a stand
    assert not raised(data) and not engine_warnings


def test_random_jogging(scene, engine_warnings):
    """Any sliders in any order: shallow contacts, no warning, and afterwards the machine still goes home."""
    data = mujoco.MjData(scene)
    home = scene.key("home").id
    mujoco.mj_resetDataKeyframe(scene, data, home)
    rng = np.random.default_rng(11)
    low, high = scene.actuator_ctrlrange.T
    deepest = 0.0
    for _ in range(6):
        data.ctrl[:] = rng.uniform(low, high)
        for _ in range(700):
            mujoco.mj_step(scene, data)
            deepest = min([deepest, *(c.dist for c in data.contact[: data.ncon])])
    assert -0.003 < deepest < 0.0
    data.actuator("Z").ctrl[0] = 0.7  # up first
    for _ in range(3000):
        mujoco.mj_step(scene, data)
    data.ctrl[:] = scene.key("home").ctrl
    for _ in range(4000):
        mujoco.mj_step(scene, data)
    np.testing.assert_allclose(data.qpos, scene.key("home").qpos, rtol=0, atol=1e-5)
    assert not raised(data) and not engine_warnings


def test_the_builder_gives_the_shipped_machine(model):
    """For its own chain the builder makes the same joints in the same order, carried by the same ones, with the same
    sites, actuators, sensors and key frame; all kinematics agree. Solids, travel and weights are the shipped file's.
    """
    built = mujoco.MjModel.from_xml_string(machine_xml(FIVE_AXIS))

    def structure(m):
        carried = {}
        for what, body in [
            *((m.joint(i).name, m.jnt_bodyid[i]) for i in range(m.njnt)),
            *((m.site(i).name, m.site_bodyid[i]) for i in range(m.nsite)),
        ]:
            carried[what] = []
            while body:
                carried[what] += [m.joint(i).name for i in range(m.njnt) if m.jnt_bodyid[i] == body]
                body = m.body_parentid[body]
        return {
            "carried": carried,
            "joints": [(m.joint(i).name, int(m.jnt_type[i]), m.jnt_axis[i].tolist()) for i in range(m.njnt)],
            "actuators": [(m.actuator(i).name, m.joint(m.actuator_trnid[i, 0]).name) for i in range(m.nu)],
            "sensors": [m.sensor(i).name for i in range(m.nsensor)],
            "tendons": [m.tendon(i).name for i in range(m.ntendon)],
            "home": m.key("home").qpos.tolist(),
        }

    assert structure(built) == structure(model)
    rng, data = np.random.default_rng(4), [mujoco.MjData(m) for m in (model, built)]
    for _ in range(1000):
        q, places = np.append(rng.uniform(-0.3, 0.3, 3), rng.uniform(-2.0, 2.0, 2)), []
        for m, d in zip((model, built), data, strict=True):
            d.qpos[:] = q
            mujoco.mj_kinematics(m, d)
            sites = [d.site(n) for n in ("table_ball", "spindle_ball")]
            places.append(np.concatenate([np.append(s.xpos, s.xmat) for s in sites]))
        np.testing.assert_allclose(places[1], places[0], rtol=0, atol=1e-12)
