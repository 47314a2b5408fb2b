"""The machine's MuJoCo model: it compiles cleanly, its kinematics are the closed form, its inertias the data sheet's."""

import importlib.util
import subprocess
import sys
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

ROOT = Path(__file__).resolve().parent.parent
XML = ROOT / "models" / "five_axis.xml"
SCRIPT = ROOT / "scripts" / "build_model.py"
AXES = "XYZAC"

# J [kg m2] and gear [rad/m or rad/rad] of the data sheet.
DATA_SHEET = {
    "X": (0.0100, 2 * np.pi / 0.010),
    "Y": (0.0130, 2 * np.pi / 0.010),
    "Z": (0.0105, 2 * np.pi / 0.010),
    "A": (0.0042, 60),
    "C": (0.0036, 72),
}

_spec = importlib.util.spec_from_file_location("build_model", SCRIPT)
build_model = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(build_model)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(XML))


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


def test_compiles_and_steps_without_warnings(engine_warnings):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = mujoco.MjModel.from_xml_path(str(XML))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    start = data.qpos.copy()
    for _ in range(1000):
        mujoco.mj_step(model, data)
    raised = {mujoco.mjtWarning(k).name: int(w.number) for k, w in enumerate(data.warning) if w.number}
    assert not raised and not engine_warnings
    assert np.abs(data.qacc).max() < 1e-9
    np.testing.assert_allclose(data.qpos, start, rtol=0, atol=1e-12)  # nothing sags: gravity is counterbalanced
    assert data.ncon == 0


def test_options(model):
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    assert model.opt.timestep == 0.001
    assert (model.vis.global_.offwidth, model.vis.global_.offheight) == (1920, 1080)
    assert not model.dof_damping.any() and not model.dof_frictionloss.any() and not model.jnt_stiffness.any()
    assert not model.geom_contype.any() and not model.geom_conaffinity.any()
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
    for k, name in enumerate(AXES):
        joint = model.joint(name)
        assert model.body(int(joint.bodyid[0])).name == of[name]
        np.testing.assert_array_equal(joint.axis, axis[name])
        np.testing.assert_array_equal(joint.pos, 0)
        assert model.actuator(k).name == name and model.actuator_trnid[k, 0] == joint.id
        assert bool(joint.limited[0]) == (name != "C")
    for body in ("y_slide", "cradle", "table", "x_slide", "z_slide", "spindle"):
        np.testing.assert_array_equal(model.body(body).pos, 0)
        np.testing.assert_array_equal(model.body(body).quat, (1, 0, 0, 0))
    np.testing.assert_array_equal(model.body("table_fixture").pos, (0, 0, 0.155))


def test_ball_distance_is_the_closed_form(model):
    data = mujoco.MjData(model)
    p = np.array([0, 0, 0.155])
    for x, y, z, a, c in random_poses(200):
        set_pose(model, data, (x, y, z, a, c))
        expected = np.linalg.norm(np.array([x, y, z]) - rx(a) @ rz(c) @ p)
        measured = data.sensor("spindle_ball_pos").data - data.sensor("table_ball_pos").data
        assert abs(np.linalg.norm(measured) - expected) < 1e-12
        assert abs(data.ten_length[model.tendon("ball_bar").id] - expected) < 1e-12


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


def test_viewer_actuators_are_stable_and_damped(model):
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    target = np.array([-0.2, 0.2, 0.4, np.radians(60), np.radians(180)])
    data.ctrl[:] = target
    start = np.array([0.1, 0, 0.155, 0, 0])
    overshoot = 0.0
    for _ in range(1500):
        mujoco.mj_step(model, data)
        done = (np.array([data.joint(n).qpos[0] for n in AXES]) - start) / (target - start)
        overshoot = max(overshoot, done.max() - 1)
    assert overshoot < 0.02
    np.testing.assert_allclose(done, 1, atol=1e-6)


def test_assets_are_closed_and_reproducible():
    files = sorted((XML.parent / "assets").glob("*.stl"))
    assert files
    for path in files:
        mesh = trimesh.load_mesh(path)
        assert mesh.is_watertight, path.name
        assert mesh.is_winding_consistent, path.name
        assert mesh.volume > 0, path.name
    done = subprocess.run([sys.executable, str(SCRIPT), "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_asset_is_used(model):
    used = {model.mesh(k).name for k in range(model.nmesh)}
    assert used == {path.stem for path in (XML.parent / "assets").glob("*.stl")}


@pytest.mark.parametrize("method", ["perpendicular", "parallel"])
@pytest.mark.parametrize("theta, beta", [(15, 10), (15, 30), (45, 10), (45, 30)])
def test_nothing_collides_in_the_papers_tests(theta, beta, method):
    """Convex piece against convex piece, tool side against table side, over cone-frustum circles (A.5 to A.9)."""
    spec = mujoco.MjSpec.from_file(str(XML))
    side = {"x_slide": 0, "z_slide": 0, "spindle": 0, "y_slide": 1, "cradle": 1, "table": 1}
    pieces: tuple[list[str], list[str]] = ([], [])
    parts = build_model.build()
    hollow = {"table_top", "table_scale", "table_mark"}  # inside the disc below, or paint
    disc = build_model.cylinder("z", build_model.TABLE_RADIUS, 0.055, build_model.TABLE_TOP)
    solids = {(body, mesh): parts[mesh] for body in side for mesh in build_model.bodies()[body] if mesh not in hollow | {"ball"}}
    for (body, mesh), made in (solids | {("table", "disc"): [disc]}).items():
        for k, (vertices, faces) in enumerate(made):
            name = f"{mesh}_{k}"
            spec.add_mesh(name=f"piece_{name}", uservert=vertices.ravel(), userface=faces.ravel())
            spec.body(body).add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"piece_{name}", mass=0)
            pieces[side[body]].append(name)
    model = spec.compile()
    data = mujoco.MjData(model)
    tool, work = ([model.geom(name).id for name in names] for names in pieces)

    th, be, length = np.radians(theta), np.radians(beta), 0.1
    tilt = np.array([[np.cos(be), 0, np.sin(be)], [0, 1, 0], [-np.sin(be), 0, np.cos(be)]])
    for xt, yt in ((0, 0), (0.2, 0), (0, 0.2), (-0.2, 0), (0, -0.2), (0.2, 0.2)):
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
            for one in tool:
                for other in work:
                    reach = model.geom_rbound[one] + model.geom_rbound[other]
                    if np.linalg.norm(data.geom_xpos[one] - data.geom_xpos[other]) > reach:
                        continue
                    gap = mujoco.mj_geomDistance(model, data, one, other, 0.05, None)
                    assert gap > 0.005, (model.geom(one).name, model.geom(other).name, xt, yt, np.degrees(phi))
