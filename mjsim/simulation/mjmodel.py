"""The MuJoCo model of a machine: the MJCF, the effects' native edits, the data sheet's inertias, the callback's
parameters.
"""

from __future__ import annotations

import copy
from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np

from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.bodies import bodies_scale, model_spec, own_inertia
from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import Geometry
from mjsim.machine.plant import OP_SIZE, Plant
from mjsim.simulation import callback
from mjsim.simulation.drive import AXIS_SIZE, STEP, SUBSTEPS, discretise, substeps_of

#: Sensors of the simulated model: where the two balls are.
BALLS = ("spindle_ball_pos", "table_ball_pos")


def build_model(plant: Plant, step: float = STEP, substeps: int = SUBSTEPS) -> mujoco.MjModel:
    """Compile the machine.

    Args:
        plant: drives, transmissions and effects.
        step: MuJoCo's time step, s. substeps: drive sub-steps in it; stiff friction takes more.

    Returns:
        A model whose numeric ``mjsim`` holds everything the callback needs except the test (:func:`for_test`).
    """
    model, own = compiled(structure_of(plant), step)
    return with_numbers(model, plant, own, step, substeps)


class Structure(NamedTuple):
    """What the bodies, joints and sizes of a model follow from. Models of one structure differ in numbers alone."""

    chain: Chain
    operations: int
    width: int
    own_effects: bool


def structure_of(plant: Plant) -> Structure:
    """The structure of the model of a plant."""
    return Structure(plant.chain, len(plant.ops), plant.width, bool(plant.python_effects))


@lru_cache(maxsize=16)
def compiled(structure: Structure, step: float = STEP) -> tuple[mujoco.MjModel, np.ndarray]:
    """A model without its numbers, and its :func:`mjsim.machine.bodies.own_inertia`, (axes,). Both are kept.

    Raises:
        InputError: the machine has other axes than the model that ships.
    """
    chain, operations, width, own_effects = structure
    spec = model_spec(chain)
    spec.option.timestep = step
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    spec.nuserdata = callback.userdata_size(chain.count, operations)
    spec.add_numeric(
        name=callback.NUMERIC, data=np.zeros(callback.HEADER + chain.count * AXIS_SIZE + operations * OP_SIZE)
    )
    _strip(spec)
    if width > chain.count:
        _add_error_joints(spec, chain, width)
    _set_controls(spec, chain, ("", " own effects") if own_effects else ("",))
    model = spec.compile()
    model.actuator_gainprm[:] = 0.0
    if chain.slides_turn(width):
        _place_functional_points(model, chain, width)
    return model, own_inertia(model, chain)


def with_numbers(
    model: mujoco.MjModel, plant: Plant, own: np.ndarray, step: float = STEP, substeps: int = SUBSTEPS
) -> mujoco.MjModel:
    """A copy of ``model`` with the numbers of ``plant``; ``model`` and ``own`` as :func:`compiled` gives them."""
    model = copy.copy(model)
    if plant.geometry.location or plant.geometry.squareness:
        _displace_axes(model, plant.chain, plant.geometry)
        own = own_inertia(model, plant.chain)
    if _balanced(model):
        model.opt.gravity[:] = 0.0  # what is balanced body by body need not be computed twice at every step
    _set_inertia(model, plant, own)
    block = model.numeric(callback.NUMERIC).data
    block[:] = _block(plant, plant.op_table(), step, substeps)
    joints = plant.chain.columns[: plant.width]
    block[callback.N_JOINTS], block[callback.N_CONTROLS] = len(joints), model.nu
    for i, name in enumerate(joints):
        block[callback.JOINTS + i] = model.joint(name).dofadr[0]
    return model


def _block(plant: Plant, ops: np.ndarray, step: float, substeps: int) -> np.ndarray:
    count = plant.chain.count
    block = np.zeros(callback.HEADER + count * AXIS_SIZE + ops.size)
    block[callback.STEP_], block[callback.N_OPS], block[callback.N_AXES] = step, len(ops), count
    for i, a in enumerate(plant.chain.letters):
        at = callback.HEADER + i * AXIS_SIZE
        block[callback.SUBSTEPS_ + i] = mine = substeps_of(plant.axes[a], step, substeps)
        block[at : at + AXIS_SIZE] = discretise(plant.axes[a], step / mine)
    block[callback.HEADER + count * AXIS_SIZE :] = ops.ravel()
    assert ops.shape[1] == OP_SIZE
    return block


def _strip(spec: mujoco.MjSpec) -> None:
    """Take out what is only looked at or touched: bodies do not touch one another in a ball-bar test.

    MuJoCo would place it in every step, and every test's copy of the model would hold its meshes.
    """
    spec.compiler.discardvisual = True  # the solids' inertia stays
    touching = [g for g in spec.geoms if g.contype or g.conaffinity]
    other_sensors = [s for s in spec.sensors if s.name not in BALLS]
    for unused in (*other_sensors, *spec.tendons, *spec.cameras, *spec.lights, *touching):
        spec.delete(unused)


def _set_controls(spec: mujoco.MjSpec, chain: Chain, suffixes: tuple[str, ...]) -> None:
    """Replace the viewer's actuators: one control per suffix and axis, in the order in which the callback reads them.

    By themselves they move nothing.
    """
    for viewers in (*spec.actuators, *spec.keys):
        spec.delete(viewers)
    for suffix in suffixes:
        for axis in chain.letters:
            spec.add_actuator(name=axis + suffix, target=axis, trntype=mujoco.mjtTrn.mjTRN_JOINT)


def _balanced(model: mujoco.MjModel) -> bool:
    """Whether gravity is compensated at every body that moves."""
    return bool((model.body_gravcomp[model.body_weldid != 0] == 1.0).all())


def _add_error_joints(spec: mujoco.MjSpec, chain: Chain, width: int) -> None:
    """Joints for the error motions of motions of ``width`` columns.

    Those of a rotary axis are on its side towards the bed: tilt outermost, then displacement; the axis itself stays
    innermost. A slide carries the functional point about which it turns, so that its tilts are innermost.
    """
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    motions = chain.motions[: width - chain.count]
    for axis in dict.fromkeys(m.axis for m in motions):
        old = spec.joint(axis)
        body = old.parent
        kept = {k: getattr(old, k) for k in ("axis", "armature", "type")}  # before it is deleted
        spec.delete(old)
        mine = [m for m in motions if m.axis == axis]
        rotary, work = chain.is_rotary(axis), chain.axis(axis) in chain.work
        tilts, moves = ([m for m in mine if m.rotation == kind] for kind in (True, False))
        for m in (*(tilts if rotary else ()), *moves):
            # a slide that carries the table: the error is that of the spindle ball relative to it
            sign = -1.0 if work and not rotary else 1.0
            direction = chain.axis(axis).centreline if m.axial else np.eye(3)[m.along]
            body.add_joint(name=m.name, type=hinge if m.rotation else slide, axis=sign * direction)
        body.add_joint(name=axis, **kept)
        for m in () if rotary else tilts:
            body.add_joint(name=m.name, type=hinge, axis=np.eye(3)[m.along])


def _place_functional_points(model: mujoco.MjModel, chain: Chain, width: int) -> None:
    """Put the joints of the slides' angular errors where they turn about, in the compiled model: only there is known
    where a body is.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    origin = data.site("spindle_ball").xpos  # of the machine frame
    for m in (m for m in chain.motions[: width - chain.count] if m.name in chain.angular):
        joint = model.joint(m.name)
        joint.pos[:] = origin + chain.functional_point(m.axis) - data.xpos[int(joint.bodyid[0])]


def _displace_axes(model: mujoco.MjModel, chain: Chain, geometry: Geometry) -> None:
    """Location errors move and turn the frames of the rotary axes, squareness turns the joints of the linear ones.

    This is done in the compiled model: the compiler would normalise a turned joint axis and so scale its travel by 1 +
    α²/2.
    """
    for axis in chain.rotary:
        body = model.body(int(model.joint(axis).bodyid[0]))
        shift, turn = geometry.displacement(chain, axis)
        body.pos[:] += shift
        mujoco.mju_mat2Quat(body.quat, (rotation_of(body.quat) @ turn).ravel())
    for error in chain.squareness:
        # a slide that carries the table: moving it by +α is moving the spindle ball by −α relative to it
        side = -1.0 if chain.axis(error.axis) in chain.work else 1.0
        model.joint(error.axis).axis[error.along] += side * error.sign * geometry.squareness.get(error.name, 0.0)


def rotation_of(quat: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a unit quaternion (4,)."""
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, quat)
    return out.reshape(3, 3)


def _set_inertia(model: mujoco.MjModel, plant: Plant, own: np.ndarray) -> None:
    """Bodies' own inertia plus armature add up to J·gear² (armature is never negative: solids are scaled down
    instead).
    """
    dofs = [model.joint(a).dofadr[0] for a in plant.chain.letters]
    want = plant.whole_inertia()
    scale = bodies_scale(own, want)
    if scale < 1.0:
        model.body_mass *= scale
        model.body_inertia *= scale
        mujoco.mj_setConst(model, mujoco.MjData(model))
    model.dof_armature[dofs] = want - scale * own


def for_test(model: mujoco.MjModel, test: BallBarTest, start: np.ndarray, ops: np.ndarray) -> mujoco.MjModel:
    """A copy of ``model`` for one test: ball on the table, campaign clock, first command (axes,), its operations
    (n, OP_SIZE).
    """
    model = copy.copy(model)
    set_test(model, test, start, ops)
    return model


def set_test(model: mujoco.MjModel, test: BallBarTest, start: np.ndarray, ops: np.ndarray) -> None:
    """As :func:`for_test`, in ``model`` itself."""
    model.body("table_fixture").pos[:] = test.table_ball
    block = model.numeric(callback.NUMERIC).data
    block[callback.CLOCK] = test.started
    block[callback.START : callback.START + len(start)] = start
    block[callback.HEADER + len(start) * AXIS_SIZE :] = ops.ravel()
