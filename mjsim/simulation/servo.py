"""One axis under a digital control, driven by a recorded command.

The control is sampled: with the motor's angle y, the command r and its sampling time h,

    x = [(Kpp + ratio·s) r − (Kpp + s) y] / (1 + lag·s)      by Tustin's rule, s = (2/h)(z − 1)/(z + 1)
    u = Kvp [x + (1/Ti) ∫ x dt]                              trapezoidal; clipped, delayed, held for one sample

Without a lag (or one below h/2) s is a difference over ``velocity_samples`` samples, backwards. A discrete law
``R u = T r − S y`` stands in place of both lines. Between samples the mechanics are those of
:mod:`mjsim.simulation.drive`: the linear part exact, the LuGre bristle by its own exponential at the mid velocity, with

    g(ω, θ) = Tc [1 + (static_ratio − 1) exp(−(ω/ω_s)²)] (1 + asymmetry·sign ω) (1 + linear·θ + quadratic·θ²)
              · (1 + a sin(order·θ + phase))

and beside the bristle a friction torque that rises and saturates, Tr (1 − exp(−|ω|/ω_r)) sign ω.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from mjsim.machine.control import MOST_COEFFICIENTS
from mjsim.machine.plant import AxisPlant
from mjsim.simulation.drive import MOST_SUBSTEPS, PHASE, bristle, bristle_rate

#: Longest sampling time of a control that states none, s.
_FINE = 1e-4
#: Longest delay, samples of the control.
MOST_DELAY = 200

_J, _C, _CONSTANT, _COULOMB, _SIGMA0, _SIGMA1, _STATIC, _STRIBECK, _ASYMMETRY, _RISE, _RISE_AT = range(11)
_RIPPLE, _ORDER, _PHASE, _CLIP, _DELAY, _ANTI_WINDUP, _RATE, _GAIN, _HOLD, _LINEAR, _QUADRATIC = range(11, 22)
_WAVE, _WAVE_ORDER, _WAVE_PHASE = range(22, 25)
_R, _S, _T = 25, 25 + MOST_COEFFICIENTS, 25 + 2 * MOST_COEFFICIENTS
_SIZE = 25 + 3 * MOST_COEFFICIENTS


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


def filters(axis: AxisPlant, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients R, S, T (R[0] = 1) that give x from command and actual angle."""
    law = axis.control.law
    if law is not None:
        R, S, T = (np.array(c, float) for c in (law.R, law.S, law.T))
        return R / R[0], S / R[0], T / R[0]
    Kp, ff, lag, over = axis.position_gain, axis.feedforward, axis.control.torque_lag, axis.control.velocity_samples
    if lag < 0.5 * step:
        difference = np.zeros(over + 1)
        difference[0], difference[-1] = 1.0 / (over * step), -1.0 / (over * step)
        gain = Kp * np.eye(over + 1)[0]
        return np.ones(1), gain + difference, gain + ff * difference
    w = 2.0 / step
    d = np.array([1.0 + lag * w, 1.0 - lag * w])
    return d / d[0], np.array([Kp + w, Kp - w]) / d[0], np.array([Kp + ff * w, Kp - ff * w]) / d[0]


def parameters(axis: AxisPlant, step: float) -> np.ndarray:
    """Numbers of one axis for the compiled loop, (_SIZE,)."""
    p, c = axis, axis.control
    out = np.zeros(_SIZE)
    out[[_J, _C, _CONSTANT, _STATIC, _STRIBECK]] = p.inertia, p.viscous, p.gravity, p.static_ratio, p.stribeck_velocity
    if p.coulomb > 0.0:
        s0 = p.coulomb / p.presliding
        out[[_COULOMB, _SIGMA0, _SIGMA1]] = p.coulomb, s0, 0.3 * math.sqrt(s0 * p.inertia)
    out[[_ASYMMETRY, _RISE, _RISE_AT, _HOLD]] = p.asymmetry, *p.rising, p.hold
    out[[_LINEAR, _QUADRATIC]] = p.by_position
    out[[_WAVE, _WAVE_ORDER, _WAVE_PHASE]] = p.friction_ripple
    out[[_RIPPLE, _ORDER, _PHASE]] = p.ripple
    out[[_CLIP, _DELAY, _ANTI_WINDUP]] = c.clip, c.loop_delay / step, c.anti_windup
    out[_RATE] = 0.0 if c.law is not None else step / p.integral_time
    out[_GAIN] = p.velocity_gain
    for at, values in zip((_R, _S, _T), filters(axis, step), strict=True):
        out[at : at + len(values)] = values
    return out


def follow(axis: AxisPlant, time: np.ndarray, command: np.ndarray, start: ServoStart) -> ServoMotion:
    """The motion that a command makes.

    Args:
        axis: The drive with its effects.
        time: Instants of the recording, (n,) s, growing.
        command: Axis units, (n,), as recorded.
        start: Where the axis stands then.
    """
    step = sampling(axis, float(np.median(np.diff(time[:1000]))))
    count = math.floor((time[-1] - time[0]) / step + 1e-6) + 1
    grid = time[0] + step * np.arange(count)
    even = count == len(time) and np.abs(grid - time).max() < 1e-3 * step
    r = (command if even else np.interp(grid, time, command)) * axis.gear
    friction = min(max(1, math.ceil(step * bristle_rate(axis) / PHASE)), MOST_SUBSTEPS)
    damping = math.ceil(step * axis.rising[0] / axis.rising[1] / axis.inertia / PHASE)
    position, velocity, torque = np.empty(count), np.empty(count), np.empty(count)
    state = np.array([start.position * axis.gear, start.velocity * axis.gear, start.torque])
    substeps = max(friction, min(damping, MOST_SUBSTEPS), math.ceil(step / 1e-3))
    _loop(parameters(axis, step), np.ascontiguousarray(r), step, substeps, state, position, velocity, torque)
    return ServoMotion(grid, position / axis.gear, velocity / axis.gear, torque)


@njit(cache=True, nogil=True, error_model="numpy")
def _loop(p, r, step, substeps, state, position, velocity, torque):
    """Angles, rad, speeds, rad/s, and torques, N·m, at the control's samples; see the module."""
    n = len(r)
    h = step / substeps
    rate = p[_C] / p[_J]
    e = math.exp(-rate * h)
    f1 = (1.0 - e) / rate if rate * h > 1e-9 else h
    f2 = (h - f1) / rate if rate * h > 1e-4 else 0.5 * h * h
    of_j, of_h = 1.0 / p[_J], 1.0 / h
    tc, s0, s1 = p[_COULOMB], p[_SIGMA0], p[_SIGMA1]
    of_s0 = 1.0 / s0 if tc > 0.0 else 0.0
    th, om = state[0], state[1]
    before = np.empty(MOST_COEFFICIENTS)  # outputs, actual angles and commands of earlier samples, newest first
    actual = np.empty(MOST_COEFFICIENTS)
    wanted = np.empty(MOST_COEFFICIENTS)
    slope = r[1] - r[0] if abs(om) > 0.0 else 0.0
    sums = np.zeros(3)
    for i in range(MOST_COEFFICIENTS):
        actual[i] = th - i * om * step
        wanted[i] = r[0] - i * slope
        sums[0] += p[_R + i]
        sums[1] += p[_S + i] * actual[i]
        sums[2] += p[_T + i] * wanted[i]
    x = (sums[2] - sums[1]) / sums[0] if abs(sums[0]) > 1e-12 else 0.0
    before[:] = x
    last_x, integral = x, 0.0
    if p[_RATE] > 0.0:
        integral = state[2] / p[_GAIN] - x
    first = p[_GAIN] * (x + integral)
    first = min(max(first, -p[_CLIP]), p[_CLIP])
    z = 0.0
    if tc > 0.0:
        z = (first - p[_CONSTANT] - p[_RIPPLE] * math.sin(p[_ORDER] * th + p[_PHASE])) * of_s0
        z = min(max(z, -tc * of_s0), tc * of_s0)
    outputs = np.full(MOST_DELAY + 2, first)
    whole = min(int(p[_DELAY]), MOST_DELAY - 1)
    part = min(max(p[_DELAY] - whole, 0.0), 1.0)
    size = len(outputs)
    for k in range(n):
        position[k], velocity[k] = th, om
        if k:
            for i in range(MOST_COEFFICIENTS - 1, 0, -1):
                actual[i], wanted[i], before[i] = actual[i - 1], wanted[i - 1], before[i - 1]
        actual[0], wanted[0] = th, r[k]
        x = 0.0
        for i in range(MOST_COEFFICIENTS):
            x += p[_T + i] * wanted[i] - p[_S + i] * actual[i]
            if i:
                x -= p[_R + i] * before[i]
        before[0] = x
        more = integral + 0.5 * p[_RATE] * (x + last_x) if k else integral
        last_x = x
        out = p[_GAIN] * (x + more)
        if abs(out) > p[_CLIP]:
            if p[_ANTI_WINDUP] == 0.0 or out * x < 0.0:
                integral = more
            out = math.copysign(p[_CLIP], out)
        else:
            integral = more
        outputs[k % size] = out
        tau = (1.0 - part) * outputs[(k - whole) % size] + part * outputs[(k - whole - 1) % size]
        torque[k] = tau
        for _ in range(substeps):
            f = p[_CONSTANT]
            if tc > 0.0 or p[_RIPPLE] != 0.0 or p[_RISE] != 0.0:
                now = f
                if tc > 0.0:
                    now += s0 * z + s1 * _bristle_rate(p, z, om, th)
                if p[_RIPPLE] != 0.0:
                    now += p[_RIPPLE] * math.sin(p[_ORDER] * th + p[_PHASE])
                    f += p[_RIPPLE] * math.sin(p[_ORDER] * (th + 0.5 * h * om) + p[_PHASE])
                if p[_RISE] != 0.0:
                    now += math.copysign(p[_RISE] * (1.0 - math.exp(-abs(om) / p[_RISE_AT])), om)
                mid = om + 0.5 * h * (of_j * (tau - now) - rate * om)
                if p[_RISE] != 0.0:
                    f += math.copysign(p[_RISE] * (1.0 - math.exp(-abs(mid) / p[_RISE_AT])), mid)
                if tc > 0.0:
                    g = _level(p, mid, th)
                    slip = _slip(p, z, mid, g)
                    a = abs(mid) * h * s0 / g * slip
                    if a > 1e-9:
                        zn, mean = bristle(z, math.copysign(g * of_s0 / slip, mid), a)
                    else:
                        zn = z + mid * h
                        mean = 0.5 * (z + zn)
                    f += s0 * mean + s1 * (zn - z) * of_h
                    z = zn
            drive = (tau - f) * of_j
            th += f1 * om + f2 * drive
            om = e * om + f1 * drive


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _level(p, om, th):
    """The friction level at which the bristles slide, N·m."""
    g = p[_COULOMB]
    if p[_STRIBECK] > 0.0:
        w = om / p[_STRIBECK]
        g *= 1.0 + (p[_STATIC] - 1.0) * math.exp(-w * w)
    if p[_LINEAR] != 0.0 or p[_QUADRATIC] != 0.0:
        g *= max(1.0 + th * (p[_LINEAR] + th * p[_QUADRATIC]), 0.1)
    if p[_WAVE] != 0.0:
        g *= 1.0 + p[_WAVE] * math.sin(p[_WAVE_ORDER] * th + p[_WAVE_PHASE])
    return g * (1.0 + math.copysign(p[_ASYMMETRY], om * p[_ASYMMETRY])) if p[_ASYMMETRY] != 0.0 else g


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _slip(p, z, om, g):
    """Share of the velocity that makes the bristles slip: 1 is LuGre; with ``hold`` they are elastic up to that share
    of the level (Dupont et al. 2002), so that they do not creep at rest.
    """
    if p[_HOLD] == 0.0:
        return 1.0
    deflection = p[_SIGMA0] * abs(z) / g
    if z * om <= 0.0 or deflection <= p[_HOLD]:
        return 1e-12
    if deflection >= 1.0:
        return 1.0
    return 0.5 - 0.5 * math.cos(math.pi * (deflection - p[_HOLD]) / (1.0 - p[_HOLD]))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _bristle_rate(p, z, om, th):
    g = _level(p, om, th)
    return om - abs(om) * p[_SIGMA0] * z / g * _slip(p, z, om, g)
