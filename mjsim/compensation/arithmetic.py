"""The arithmetic of a control: how it adds corrections to the commands of the axes, cycle by cycle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from mjsim.compensation.tables import Corrections, Table
from mjsim.machine.kinematics import Geometry, bar_vector, machine_to_work, spindle_ball

#: Command change in one cycle below which an axis counts as standing, m or rad.
_STILL = 1e-13


@dataclass(frozen=True)
class Ramp:
    """How fast a change of the correction is carried out.

    Attributes:
        acceleration: Largest, m/s² or rad/s², by axis.
        velocity: Largest, m/s or rad/s, by axis.
    """

    acceleration: dict[str, float]
    velocity: dict[str, float]


@dataclass(frozen=True)
class Arithmetic:
    """How a control uses what it was told.

    Attributes:
        stepwise: Whether an axis' own table jumps half way between two points, instead of a straight line between
            them.
        ramp: Ramp of changes; ``None`` carries them out within a cycle.
        transforms: Whether the control computes the linear axes from the tool tip, with its kinematic data.
        tool: Length of the tool less that of the spindle ball's holder, as the control knows it, m.
    """

    stepwise: bool = False
    ramp: Ramp | None = None
    transforms: bool = True
    tool: float = 0.0


def directions(command: np.ndarray) -> np.ndarray:
    """Direction +1 or −1 of one axis' command (n,) in every cycle. The last one is kept while it stands; before it
    moves it is 0: nobody knows on which side of its play it rests, so that it counts as centred.
    """
    step = np.diff(command, prepend=command[0])
    sign = np.sign(np.where(np.abs(step) > _STILL, step, 0.0))
    last = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign)), 0))
    return sign[last]


def lookup(table: Table, x: np.ndarray, sign: np.ndarray, stepwise: bool = False) -> np.ndarray:
    """Correction (n,) m or rad that a table gives at positions ``x`` (n,) and directions ``sign`` (n,).

    Where the direction is 0, both sides count half.
    Outside its ends the table keeps their values, or repeats every turn.
    """
    if table.modulo:
        x = table.positions[0] + (x - table.positions[0]) % (2.0 * math.pi)
    values = []
    for v in (table.forward, table.reverse):
        if stepwise:
            middle = 0.5 * (table.positions[1:] + table.positions[:-1])
            values.append(v[np.searchsorted(middle, x)])
        else:
            values.append(np.interp(x, table.positions, v))
    return 0.5 * (values[0] + values[1]) + 0.5 * sign * (values[0] - values[1])


def corrected(commands: np.ndarray, corrections: Corrections, how: Arithmetic, step: float) -> np.ndarray:
    """Commands of the axes as the control sends them to the drives.

    Args:
        commands: What the program asks of the axes, (n, axes) m and rad, ``step`` s apart.
        corrections: What the control was told.
        how: How it uses it.
        step: Its cycle, s.

    Returns:
        (n, axes) m and rad.
    """
    chain, out = corrections.chain, commands.copy()
    components = [t for t in corrections.tables if t.out not in chain.letters]
    if (corrections.kinematics or components) and how.transforms:
        q = commands
        if components:  # where the control believes that the axes err: the other way than it corrects
            q = np.hstack([commands, np.zeros((len(commands), len(chain.motions)))])
            for t in components:
                source = commands[:, chain.index(t.source)]
                q[:, chain.columns.index(t.out)] = -lookup(t, source, directions(source))
        tip = (0.0, 0.0, -how.tool)
        work = machine_to_work(chain, commands, spindle_ball(chain, commands, None, tip))
        location = Geometry(location=corrections.kinematics)
        out[:, chain.linear_columns] -= bar_vector(chain, q, work, location, tip)
    signs = {a: directions(out[:, chain.index(a)]) for a in chain.letters}
    for axis in chain.letters:
        i = chain.index(axis)
        total = 0.5 * corrections.backlash.get(axis, 0.0) * signs[axis]
        for t in corrections.tables:
            if t.out == axis:
                total = total + lookup(
                    t, commands[:, chain.index(t.source)], signs[t.source], how.stepwise and t.out == t.source
                )
        if how.ramp is not None and np.ptp(total) > 0.0:
            total = ramped(total, how.ramp.acceleration[axis], how.ramp.velocity[axis], step)
        out[:, i] += total
        if axis in corrections.pulses:
            out[:, i] += corrections.pulses[axis].offset(commands[:, i], step)
    return out


def ramped(wanted: np.ndarray, acceleration: float, velocity: float, step: float) -> np.ndarray:
    """The correction that LinuxCNC carries out, cycle by cycle, for the one that is ``wanted`` (n,).

    It moves towards the wanted value with half the joint's acceleration and half its velocity. A distance s with
    0.25·a·T² < s ≤ 0.5·a·T² is never carried out from rest (a: acceleration, T: cycle): a defect of LinuxCNC 2.9.
    """
    return _ramp(np.ascontiguousarray(wanted), 0.5 * acceleration, 0.5 * velocity, step)


@njit(cache=True, nogil=True, error_model="numpy")
def _ramp(wanted, most_acceleration, most_velocity, step):
    out = np.empty_like(wanted)
    at, v = wanted[0], 0.0
    for i in range(len(wanted)):
        away = wanted[i] - at
        way = 1.0 if away >= 0.0 else -1.0
        away *= way
        gain = most_acceleration * step
        if away > 0.0:
            stop = 0.5 * (v + gain) * (v + gain) / most_acceleration
            if away <= stop + v * step:
                if v > gain:
                    at += way * (v - 0.5 * gain) * step
                    v -= gain
                else:
                    at, v = wanted[i], 0.0
            else:
                gain = min(gain, most_velocity - v)
                more = 0.5 * gain * step
                stop = 0.5 * (v + gain) * (v + gain) / most_acceleration
                if away > stop + v * step + more:
                    at += way * (v * step + more)
                    v += gain
                else:
                    at += way * v * step
        out[i] = at
    return out


def sticks(step_size: float, acceleration: float, cycle: float = 1e-3) -> bool:
    """Whether LinuxCNC never carries out a change of the correction by ``step_size`` (m or rad) from rest."""
    return 0.25 * acceleration * cycle**2 < abs(step_size) <= 0.5 * acceleration * cycle**2
