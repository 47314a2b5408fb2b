"""The compiled control callback: drives and transmissions advance, generalized forces carry the joints to the load
side.

At each instant MuJoCo calls :func:`control` (as ``mjcb_control``). It reads the axis commands of the next instant from
``ctrl`` (and behind them what a user's own effects add to the axes there), advances the motors by one step
(:mod:`mjsim.simulation.drive`), passes them through the transmission (:mod:`mjsim.simulation.transmission`), and
applies the generalized forces ``M a + bias − passive`` that bring every joint to its load-side position one step later.
MuJoCo's semi-implicit step is a leapfrog scheme when its velocities are read as half-step velocities, so the positions
are those of the drives exactly and the velocities are of second order. What the multibody model adds beyond the data
sheet (Coriolis, uncompensated gravity) acts back on the motors as load torque.

Parameters stand in the model's numeric ``mjsim``, the drives' memory in ``userdata``, which is set up at time 0:
nothing survives from an earlier run.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco
from numba import carray, cfunc, njit, types
from numba.extending import intrinsic

from mjsim.machine.plant import OP_SIZE
from mjsim.simulation.drive import AXIS_SIZE, BEHIND, GEAR, STATE_SIZE, advance, start
from mjsim.simulation.layout import find_offsets
from mjsim.simulation.transmission import MEMORY, apply_ops

#: Name of the numeric block in the model.
NUMERIC = "mjsim"
# header of the block
STEP_, N_OPS, CLOCK, N_JOINTS, N_CONTROLS, N_AXES = range(6)
#: Most axes, and most joints: the axes and error motions.
MAX_AXES, MAX_JOINTS = 6, 32
JOINTS = 8
START = JOINTS + MAX_JOINTS
SUBSTEPS_ = START + MAX_AXES
HEADER = SUBSTEPS_ + MAX_AXES
# userdata: time reached, load-side targets, accelerations that the joints need, then the drives' and operations' memory
REACHED, TARGET, WANTED, MEMORIES = 0, 1, 1 + MAX_JOINTS, 1 + 2 * MAX_JOINTS

_MODEL, _DATA = find_offsets()
_NUMERIC_DATA, _NNZ, _ADR, _COL = (_MODEL[n] // 8 for n in ("numeric_data", "M_rownnz", "M_rowadr", "M_colind"))
_QPOS, _QVEL, _CTRL, _FRC, _BIAS, _PASSIVE, _USER, _MASS, _TIME = (
    _DATA[n] // 8
    for n in ("qpos", "qvel", "ctrl", "qfrc_applied", "qfrc_bias", "qfrc_passive", "userdata", "M", "time")
)
#: More words than either structure's last field that is read.
_WORDS = 1 << 16


def userdata_size(n_axes: int, n_ops: int) -> int:
    """Numbers of userdata that the callback needs."""
    return MEMORIES + n_axes * STATE_SIZE + n_ops * MEMORY


@njit(cache=True, nogil=True, error_model="numpy")
def advance_machine(block, user, ctrl, bias, passive, time):
    """Motors and transmission one step on; the joints' targets stand in ``user`` afterwards. Idempotent at one time."""
    step = block[STEP_]
    if time > 0.0 and user[REACHED] == time + step:
        return
    n_axes, n_ops = int(block[N_AXES]), int(block[N_OPS])
    behind, kept = HEADER + n_axes * AXIS_SIZE, MEMORIES + n_axes * STATE_SIZE
    ops = block[behind : behind + n_ops * OP_SIZE].reshape((n_ops, OP_SIZE))
    drives = user[MEMORIES:kept]
    memory = user[kept : kept + n_ops * MEMORY].reshape((n_ops, MEMORY))
    q = user[TARGET : TARGET + MAX_JOINTS]
    clock = block[CLOCK] + time
    if time == 0.0:
        q[:] = 0.0
        for i in range(n_axes):
            start(
                block[HEADER + i * AXIS_SIZE : HEADER + (i + 1) * AXIS_SIZE],
                drives[i * STATE_SIZE : (i + 1) * STATE_SIZE],
                block[START + i],
            )
            q[i] = block[START + i]
        apply_ops(ops, memory, q, clock, True)
    q[n_axes:] = 0.0
    for i in range(n_axes):
        p = block[HEADER + i * AXIS_SIZE : HEADER + (i + 1) * AXIS_SIZE]
        s = drives[i * STATE_SIZE : (i + 1) * STATE_SIZE]
        joint, substeps = int(block[JOINTS + i]), int(block[SUBSTEPS_ + i])
        advance(p, s, ctrl[i], (bias[joint] - passive[joint]) / p[GEAR], step / substeps, substeps)
        q[i] = s[BEHIND] / p[GEAR]
    apply_ops(ops, memory, q, clock + step, False)
    if len(ctrl) > n_axes:  # what the user's own effects add
        for i in range(n_axes):
            q[i] += ctrl[n_axes + i]
    user[REACHED] = time + step


@njit(cache=True, nogil=True, error_model="numpy")
def carry_joints(block, user, qpos, qvel, bias, passive, mass, nnz, adr, col, force):
    """Generalized forces that bring every joint to its target in one semi-implicit step."""
    step, n = block[STEP_], int(block[N_JOINTS])
    rate = user[WANTED : WANTED + MAX_JOINTS]
    for i in range(n):
        j = int(block[JOINTS + i])
        rate[j] = ((user[TARGET + i] - qpos[j]) / step - qvel[j]) / step
        force[j] = bias[j] - passive[j]
    for i in range(n):
        for k in range(adr[i], adr[i] + nnz[i]):
            j = col[k]
            force[i] += mass[k] * rate[j]
            if j != i:
                force[j] += mass[k] * rate[i]


@intrinsic
def _doubles(typingctx, address):
    """Integer address to a pointer to double."""
    signature = types.CPointer(types.float64)(types.int64)

    def codegen(context, builder, sig, args):
        return builder.inttoptr(args[0], context.get_value_type(sig.return_type))

    return signature, codegen


@intrinsic
def _ints(typingctx, address):
    """Integer address to a pointer to int."""
    signature = types.CPointer(types.int32)(types.int64)

    def codegen(context, builder, sig, args):
        return builder.inttoptr(args[0], context.get_value_type(sig.return_type))

    return signature, codegen


@intrinsic
def _double_at(typingctx, pointer, word):
    """The double that stands ``word`` 8-byte words behind a pointer."""
    signature = types.float64(pointer, types.int64)

    def codegen(context, builder, sig, args):
        place = builder.gep(args[0], [args[1]])
        return builder.load(builder.bitcast(place, context.get_value_type(types.CPointer(types.float64))))

    return signature, codegen


@cfunc(types.void(types.CPointer(types.int64), types.CPointer(types.int64)), cache=True)
def control(model, data):
    m, d = carray(model, (_WORDS,)), carray(data, (_WORDS,))
    block = carray(_doubles(m[_NUMERIC_DATA]), (1 << 20,))
    n = int(block[N_JOINTS])
    if n == 0:  # a model still in the making: MuJoCo's compiler steps it once
        return
    user = carray(_doubles(d[_USER]), (1 << 20,))
    qpos, qvel = carray(_doubles(d[_QPOS]), (n,)), carray(_doubles(d[_QVEL]), (n,))
    bias, passive = carray(_doubles(d[_BIAS]), (n,)), carray(_doubles(d[_PASSIVE]), (n,))
    time = _double_at(data, _TIME)
    advance_machine(block, user, carray(_doubles(d[_CTRL]), (int(block[N_CONTROLS]),)), bias, passive, time)
    nnz, adr = carray(_ints(m[_NNZ]), (n,)), carray(_ints(m[_ADR]), (n,))
    size = adr[n - 1] + nnz[n - 1]
    carry_joints(
        block,
        user,
        qpos,
        qvel,
        bias,
        passive,
        carray(_doubles(d[_MASS]), (size,)),
        nnz,
        adr,
        carray(_ints(m[_COL]), (size,)),
        carray(_doubles(d[_FRC]), (n,)),
    )


@cfunc(types.float64(), cache=True)
def no_clock():
    """A clock that stands still. MuJoCo times the parts of every step, which takes a sixth of a simulation, and
    nobody reads those times.
    """
    return 0.0


def install() -> None:
    """Make the compiled callback MuJoCo's control callback, and stop its clock (process-wide)."""
    global _former_clock
    _former_clock = mujoco.get_mjcb_time()
    mujoco.set_mjcb_control(_POINTER)
    mujoco.set_mjcb_time(_NO_CLOCK)


def uninstall() -> None:
    """Take every control callback out again, and give MuJoCo back the clock that it had."""
    mujoco.set_mjcb_control(None)
    mujoco.set_mjcb_time(_former_clock)


@contextmanager
def installed() -> Iterator[None]:
    """The callback is MuJoCo's control callback inside.

    It is one per process: the first of several users puts it in, the last takes it out. MuJoCo's warnings are not heard
    inside.
    """
    global _users
    with silent():
        with _CHANGE:
            _users += 1
            if _users == 1:
                install()
        try:
            yield
        finally:
            with _CHANGE:
                _users -= 1
                if not _users:
                    uninstall()


@contextmanager
def silent() -> Iterator[None]:
    """MuJoCo's warnings are not heard inside, unless somebody has set a handler for them.

    MuJoCo counts warnings in its data, where they become one sentence. As they are, they would stand on stderr and in a
    file MUJOCO_LOG.TXT in the user's current folder.
    """
    with _CHANGE:
        _handlers.append(mujoco.get_mju_user_warning())
        if len(_handlers) == 1:
            mujoco.set_mju_user_warning(_handlers[0] or _unheard)
    try:
        yield
    finally:
        with _CHANGE:
            former = _handlers.pop()
            if not _handlers:
                mujoco.set_mju_user_warning(former)


def _unheard(message: str) -> None:
    """A warning of MuJoCo's."""


_CHANGE = threading.Lock()
_users = 0
_handlers: list = []
_former_clock: Callable[[], float] | None = None

_POINTER = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(control.address)
_NO_CLOCK = ctypes.CFUNCTYPE(ctypes.c_double)(no_clock.address)
