"""Simulation of ball-bar tests in the multibody model."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout

from mjsim.campaign.model import Test
from mjsim.effects.motion import Motion, MotionTracker
from mjsim.engine import callback, mjmodel
from mjsim.engine.drive import STEP, SUBSTEPS
from mjsim.engine.plant import Plant, build
from mjsim.engine.transmission import MEMORY, apply_ops
from mjsim.errors import SimulationError
from mjsim.kinematics import AXES
from mjsim.machine.model import Machine
from mjsim.motion import delayed_commands, time_grid
from mjsim.nc.program import Program

#: The control callback is one per process.
_CALLBACK = threading.Lock()


@dataclass(frozen=True)
class Simulation:
    """One simulated test on the engine's time grid.

    Attributes:
        test: the test. time: (n,) s from the program's start. phi: (n,) rad.
        command, position: commanded and actual (load-side) axis positions, (n, 5) m and rad, order X, Y, Z, A, C.
        deviation: ball-bar reading, (n,) m, positive outward: distance of the two sites less the bar's length.
    """

    test: Test
    time: np.ndarray
    phi: np.ndarray
    command: np.ndarray
    position: np.ndarray
    deviation: np.ndarray


def simulate(
    machine: Machine,
    tests: Iterable[Test],
    threads: int = 2,
    done: Callable[[Test], None] | None = None,
    step: float = STEP,
    substeps: int = SUBSTEPS,
) -> list[Simulation]:
    """Run tests of a machine in MuJoCo.

    Args:
        machine: drives and effects.
        tests: what to run. threads: tests run side by side (the compiled callback holds no GIL).
        done: called after each test, for progress. step, substeps: time discretisation, s and count.

    Raises:
        SimulationError: MuJoCo warned or a value is not finite.
    """
    plant = build(machine)
    model = mjmodel.build_model(plant, step, substeps)
    tests = list(tests)

    def one(test: Test) -> Simulation:
        result = _run(model, plant, test, step)
        if done:
            done(test)
        return result

    with _CALLBACK:
        if plant.python_effects:
            return [_run_python(model, plant, t, step, done) for t in tests]
        callback.install()
        try:
            with ThreadPoolExecutor(max(1, min(threads, len(tests)))) as pool:
                return list(pool.map(one, tests))
        finally:
            callback.uninstall()


def _prepare(model: mujoco.MjModel, plant: Plant, test: Test, step: float):
    program = Program(test)
    time = time_grid(program) if step == STEP else np.arange(int(np.ceil((program.duration + 0.1) / step)) + 1) * step
    sent = delayed_commands(program, time, plant)
    ops = plant.op_table(test)
    model = mjmodel.for_test(model, test, sent[0], ops)
    data = mujoco.MjData(model)
    first = np.zeros(callback.MAX_JOINTS)
    first[:5] = sent[0]
    apply_ops(ops, np.zeros((len(ops), MEMORY)), first, test.started, True)
    block = model.numeric(callback.NUMERIC).data
    for i in range(int(block[callback.N_JOINTS])):
        data.qpos[int(block[callback.JOINTS + i])] = first[i]
    return program, time, sent, model, data


def _run(model: mujoco.MjModel, plant: Plant, test: Test, step: float) -> Simulation:
    program, time, sent, model, data = _prepare(model, plant, test, step)
    control = np.vstack([sent[1:], sent[-1:]])[:, _actuator_order(model)]
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, initial, full)
    state, sensors = rollout.rollout(model, data, initial[None], control[None])
    q = np.vstack([initial[1 : 1 + model.nq], state[0, :-1, 1 : 1 + model.nq]])
    return _collect(program, time, model, data, q, sensors[0])


def _actuator_order(model: mujoco.MjModel) -> np.ndarray:
    """Column order of ``ctrl``: the callback reads X, Y, Z, A, C."""
    order = [model.actuator(a).id for a in AXES]
    if order != list(range(5)):
        raise SimulationError("five_axis.xml: the actuators must stand in the order X, Y, Z, A, C")
    return np.arange(5)


def _run_python(model: mujoco.MjModel, plant: Plant, test: Test, step: float, done) -> Simulation:
    """As :func:`_run`, with the user's plain-Python effects called at every step."""
    program, time, sent, model, data = _prepare(model, plant, test, step)
    block = model.numeric(callback.NUMERIC).data
    joints = block[callback.JOINTS : callback.JOINTS + 5].astype(int)
    tracker = MotionTracker(step, test.started, plant)
    data.qpos[joints] += _python_part(plant, tracker.follow(np.zeros(1), data.qpos[joints][None]))

    def control(m, d) -> None:
        if d.userdata[callback.REACHED] == d.time + step and d.time > 0:
            return
        callback.advance_machine(block, d.userdata, d.ctrl, d.qfrc_bias, d.qfrc_passive, d.time)
        q = d.userdata[callback.TARGET : callback.TARGET + 5].copy()
        d.userdata[callback.TARGET : callback.TARGET + 5] += _python_part(plant, tracker.follow(np.array([d.time + step]), q[None]))
        d.qfrc_applied[:] = 0.0
        callback.carry_joints(
            block, d.userdata, d.qpos, d.qvel, d.qfrc_bias, d.qfrc_passive, d.M, m.M_rownnz, m.M_rowadr, m.M_colind, d.qfrc_applied
        )

    ball, tool = model.site("table_ball").id, model.site("spindle_ball").id
    q = np.empty((len(time), model.nq))
    bar = np.empty((len(time), 6))
    mujoco.set_mjcb_control(control)
    try:
        for k in range(len(time)):
            q[k] = data.qpos
            data.ctrl[:] = sent[min(k + 1, len(sent) - 1)]
            mujoco.mj_step(model, data)
            bar[k, :3], bar[k, 3:] = data.site_xpos[tool], data.site_xpos[ball]
    finally:
        mujoco.set_mjcb_control(None)
    if done:
        done(test)
    return _collect(program, time, model, data, q, None, bar)


def _python_part(plant: Plant, motion: Motion) -> np.ndarray:
    """What the plain-Python effects add at one instant, (5,) m and rad."""
    total = np.zeros(5)
    for effect in plant.python_effects:
        try:
            add = np.asarray(effect.position_error(motion), float)
        except Exception as error:  # the user's code can raise anything
            raise SimulationError(f"effect {effect.id}: position_error raised {type(error).__name__}: {error}") from error
        if add.shape != (1, 5) or not np.isfinite(add).all():
            where = f"at {motion.time[0]:.3f} s"
            raise SimulationError(f"effect {effect.id}: position_error gave {add!r} {where}; allowed: finite numbers, shape (n, 5)")
        total += add[0]
    return total


def _collect(program: Program, time: np.ndarray, model, data, q: np.ndarray, sensors, bar: np.ndarray | None = None) -> Simulation:
    for kind, warning in zip(mujoco.mjtWarning.__members__, data.warning, strict=False):
        if warning.number:
            raise SimulationError(
                f"test {program.test.name}: MuJoCo warned {warning.number} times ({kind}); check the machine's drive data"
            )
    if bar is None:
        bar = np.hstack([sensors[:, _sensor(model, n)] for n in ("spindle_ball_pos", "table_ball_pos")])
    deviation = np.linalg.norm(bar[:, :3] - bar[:, 3:], axis=1) - program.test.length
    if not np.isfinite(deviation).all():
        raise SimulationError(f"test {program.test.name}: the simulated reading is not finite; check gains and inertias of the drives")
    position = q[:, [model.joint(a).qposadr[0] for a in AXES]]
    return Simulation(program.test, time, program.phi(time), program.commands(time), position, deviation)


def _sensor(model: mujoco.MjModel, name: str) -> slice:
    s = model.sensor(name)
    return slice(int(s.adr[0]), int(s.adr[0]) + 3)
