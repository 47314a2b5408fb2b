"""One axis under a digital control, driven by a recorded command.

The control is sampled: with the motor's angle y, the command r and its sampling time h,

    x = [(Kpp + ratio·s) r − (Kpp + s) y] / (1 + lag·s)      by Tustin's rule, s = (2/h)(z − 1)/(z + 1)
    u = Kvp [x + (1/Ti) ∫ x dt]                              trapezoidal; clipped, delayed, held for one sample

The velocity set-point in x, Kpp (r − y) + ratio·s r, stays within a speed limit. With a lag it is the mean of two
samples. Where the position loop is slower than the velocity loop, the set-point of every so manieth sample is held. A
limited voltage leaves the motor a torque between

    −τs (1 + ω/ω0)  and  τs (1 − ω/ω0),   τs its torque at rest, ω0 its speed without load

Without a lag (or one below h/2) s is a difference over ``velocity_samples`` samples, backwards. A control that states
no sampling time is continuous: r, y and their rates are then those of the middle of a step. A discrete law
``R u = T r − S y`` stands in place of both lines. Between samples the mechanics are those of
:mod:`mjsim.simulation.drive`: the linear part exact, the LuGre bristle by its own exponential at the mid velocity, with

    g(ω, θ) = Tc [1 + (static_ratio − 1) exp(−(ω/ω_s)²)] (1 + asymmetry·sign ω) (1 + linear·θ + quadratic·θ²)
              · (1 + a sin(order·θ + phase)) (1 + excess·s) (1 + loss·|u|/Tc),   ds/dt = (1 − s)/rest − s |ω|/way

and beside the bristle a friction torque that rises and saturates, Tr (1 − exp(−|ω|/ω_r)) sign ω, a share of the
viscous torque that does not turn with the direction, and torques that vary with θ.

The encoder of the motor may read y = θ + a sin(order·θ + phase) for its angle θ: this is what the control has, and the
log. The command may come through a filter (:func:`smoothed`). Where the position loop is closed on an encoder at the
load, Kpp acts on the load's position behind the play inside that loop, and s on the motor's; a law R, S, T has the
load's alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from mjsim.machine.plant import AxisPlant
from mjsim.simulation.drive import MOST_SUBSTEPS, PHASE, bristle_rate
from mjsim.simulation.servo_loop import loop, parameters

#: Longest step of a control that states no sampling time, and is taken as continuous, s.
_FINE = 1e-4
#: Angle of the motor's swing on its bristles in one part of a sub-step, rad, while they bend; and most such parts.
_BENDING, _MOST_PARTS = 0.04, 16


@dataclass(frozen=True)
class ServoStart:
    """Where an axis stands when its recording begins.

    Attributes:
        position: Axis units (m or rad).
        velocity: Axis units per s.
        torque: What the integrator gives at the start, N·m; nothing where there is none.
    """

    position: float
    velocity: float = 0.0
    torque: float = 0.0


@dataclass(frozen=True)
class ServoMotion:
    """Motion of one axis at the samples of its control.

    Attributes:
        time: (n,) s.
        position: (n,) axis units.
        velocity: (n,) axis units per s.
        torque: Of the motor, (n,) N·m.
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray

    def at(self, time: np.ndarray) -> np.ndarray:
        """Positions at other instants (n,) s, by cubic Hermite interpolation."""
        step = self.time[1] - self.time[0]
        u = (time - self.time[0]) / step
        k = np.clip(u.astype(int), 0, len(self.time) - 2)
        u = np.clip(u - k, 0.0, 1.0)
        p, v = self.position, self.velocity * step
        d = p[k + 1] - p[k]
        a, b = v[k] - d, d - v[k + 1]
        return p[k] + u * d + u * (1.0 - u) * ((1.0 - u) * a + u * b)


def sampling(axis: AxisPlant, record_step: float) -> float:
    """Sampling time of the control: as stated, or a fine part of the recording's."""
    stated = axis.control.sample_time
    return stated if stated > 0.0 else record_step / math.ceil(record_step / _FINE)


@dataclass(frozen=True)
class Sampled:
    """A command at the samples of a control.

    Attributes:
        step: Sampling time, s.
        time: (n,) s.
        command: Motor angles, (n,) rad.
        as_recorded: Whether the recording has the same samples.
    """

    step: float
    time: np.ndarray
    command: np.ndarray
    as_recorded: bool


def sampled(axis: AxisPlant, time: np.ndarray, command: np.ndarray) -> Sampled:
    """A recorded command as the control of an axis samples it.

    Args:
        axis: The drive.
        time: Instants of the recording, (n,) s, growing.
        command: Axis units, (n,), as recorded.
    """
    step = sampling(axis, float(np.median(np.diff(time[:1000]))))
    count = math.floor((time[-1] - time[0]) / step + 1e-6) + 1
    grid = time[0] + step * np.arange(count)
    even = count == len(time) and bool(np.abs(grid - time).max() < 1e-3 * step)
    r = command if even else _between(time, command, grid)
    return Sampled(step, grid, np.ascontiguousarray(r * axis.gear), even)


def _between(time: np.ndarray, command: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """A recorded command at other instants, (n,): smooth, and monotone between the samples: steps stay steps."""
    from scipy.interpolate import PchipInterpolator  # slow to load

    return PchipInterpolator(time, command)(np.clip(grid, time[0], time[-1]))


def follow(axis: AxisPlant, time: np.ndarray, command: np.ndarray, start: ServoStart) -> ServoMotion:
    """The motion that a command makes.

    Args:
        axis: The drive with its effects.
        time: Instants of the recording, (n,) s, growing.
        command: Axis units, (n,), as recorded.
        start: Where the axis stands then.
    """
    return follow_sampled(axis, sampled(axis, time, command), start)


def follow_sampled(axis: AxisPlant, command: Sampled, start: ServoStart) -> ServoMotion:
    """The same for a command that :func:`sampled` gives."""
    angle, rate, torque = _run(axis, command, start)
    if axis.encoder == "load" and axis.play > 0.0:
        angle, rate = _behind(angle, rate, axis.play)
    return ServoMotion(command.time, angle / axis.gear, rate / axis.gear, torque)


def block_means(
    axis: AxisPlant, command: Sampled, start: ServoStart, shift: float, block: int
) -> tuple[np.ndarray, np.ndarray]:
    """Means of blocks of ``block`` samples of the motion that a command makes, (n // block,) axis units, and the
    torques of the motor at the samples, (n,) N·m.

    Args:
        axis: The drive with its effects.
        command: Recorded as the control samples it.
        start: Where the axis stands then.
        shift: Time by which the samples are read earlier, s.
        block: Samples of a block.
    """
    angle, rate, torque = _run(axis, command, start)
    if axis.encoder == "load" and axis.play > 0.0:
        angle, rate = _behind(angle, rate, axis.play)
    return _means(angle, rate, command.step, shift, block) / axis.gear, torque


@njit(cache=True, nogil=True, error_model="numpy")
def _behind(angle, rate, half):
    """Angles and speeds (n,) of a load behind a play of which ``half`` is half the width, rad of the motor."""
    out, speed, y = np.empty(len(angle)), np.empty(len(angle)), angle[0]
    for i in range(len(angle)):
        former, y = y, min(max(y, angle[i] - half), angle[i] + half)
        out[i], speed[i] = y, rate[i] if y != former else 0.0
    return out, speed


@njit(cache=True, nogil=True, error_model="numpy")
def _means(angle, rate, step, shift, block):
    """Means of blocks of the angles read ``shift`` s earlier, by cubic Hermite interpolation."""
    last = len(angle) - 2
    out = np.empty(len(angle) // block)
    for b in range(len(out)):
        total = 0.0
        for i in range(b * block, (b + 1) * block):
            if shift == 0.0:
                total += angle[i]
                continue
            at = i - shift / step
            k = min(max(math.floor(at), 0), last)
            u = min(max(at - k, 0.0), 1.0)
            d = angle[k + 1] - angle[k]
            p, q = rate[k] * step - d, d - rate[k + 1] * step
            total += angle[k] + u * d + u * (1.0 - u) * ((1.0 - u) * p + u * q)
        out[b] = total / block
    return out


def _run(axis: AxisPlant, command: Sampled, start: ServoStart) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles, rad, speeds, rad/s, and torques, N·m, of the motor at the control's samples."""
    step, count = command.step, len(command.command)
    friction = min(max(1, math.ceil(step * bristle_rate(axis) / PHASE)), MOST_SUBSTEPS)
    damping = math.ceil(step * axis.rising[0] / axis.rising[1] / axis.inertia / PHASE)
    substeps = max(friction, min(damping, MOST_SUBSTEPS), math.ceil(step / 1e-3))
    finer = min(max(1, math.ceil(step / substeps * bristle_rate(axis) / _BENDING)), _MOST_PARTS)
    state = np.array([start.position * axis.gear, start.velocity * axis.gear, start.torque])
    angle, rate, torque = np.empty(count), np.empty(count), np.empty(count)
    wanted = smoothed(command.command, step, *axis.smoothing)
    loop(parameters(axis, step), _waves(axis), wanted, step, substeps, finer, state, angle, rate, torque)
    return angle, rate, torque


def smoothed(command: np.ndarray, step: float, lag: float, mean: float) -> np.ndarray:
    """A command (n,) behind a filter, at rest before it begins; straight lines between its samples.

    Args:
        command: Any unit.
        step: Time between two samples, s.
        lag: Time constant of exponential smoothing, s; 0: none.
        mean: Time over which the mean is taken then, s; 0: none.
    """
    out = command
    if lag > 0.0:
        from scipy.signal import lfilter  # slow to load

        kept = math.exp(-step / lag)
        share = (1.0 - kept) * lag / step
        out = out[0] + np.asarray(lfilter([1.0 - share, share - kept], [1.0, -kept], out - out[0]))
    if mean > 0.0:
        change = out - out[0]
        area = np.concatenate([[0.0], np.cumsum(0.5 * step * (change[1:] + change[:-1]))])
        time = step * np.arange(len(out))
        back = np.maximum(time - mean, 0.0)
        k = np.minimum((back / step).astype(int), len(out) - 2)
        u = back - k * step
        slope = (change[k + 1] - change[k]) / step
        out = out[0] + (area - area[k] - u * (change[k] + 0.5 * u * slope)) / mean
    return np.ascontiguousarray(out)


def _waves(axis: AxisPlant) -> np.ndarray:
    """Waves over the motor's angle: amplitude, order, phase rad, (1 + waves, 3).

    Row 0 is that of the friction level, with its share as amplitude. The others are torques, N·m.
    """
    there = [w for w in (axis.ripple, *axis.waves) if w[0] != 0.0]
    return np.array([axis.friction_ripple, *there], float)
