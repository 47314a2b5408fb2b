"""The compiled loop of one axis under a digital control; what it computes stands in :mod:`mjsim.simulation.servo`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mjsim.machine.control import MOST_COEFFICIENTS
from mjsim.machine.plant import AxisPlant
from mjsim.simulation.drive import bristle

# parameters of one axis
_J, _C, _CONSTANT, _COULOMB, _SIGMA0, _SIGMA1, _STATIC, _STRIBECK, _ASYMMETRY, _RISE, _RISE_AT = range(11)
_CLIP, _DELAY, _ANTI_WINDUP, _RATE, _GAIN, _HOLD, _LINEAR, _QUADRATIC = range(11, 19)
_WAVE, _WAVE_ORDER, _WAVE_PHASE, _TAPS, _EVEN = range(19, 24)
_R, _S, _T = 24, 24 + MOST_COEFFICIENTS, 24 + 2 * MOST_COEFFICIENTS
_SIZE = 24 + 3 * MOST_COEFFICIENTS
#: Longest delay, samples of the control, and outputs that are kept, a power of two.
MOST_DELAY = 200
_RING = 256
#: Share by which bending bristles may differ from sliding ones.
SLIDING = 0.02
#: Angle of a wave in one sub-step, rad, and most sub-steps of a sample for it.
WAVE, _MOST_STEPS = 0.2, 100


def filters(axis: AxisPlant, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients R, S, T (R[0] = 1) that give x from command and actual angle."""
    law = axis.control.law
    if law is not None:
        R, S, T = (np.array(c, float) for c in (law.R, law.S, law.T))
        return R / R[0], S / R[0], T / R[0]
    Kp, ff, lag, over = axis.position_gain, axis.feedforward, axis.control.torque_lag, axis.control.velocity_samples
    if lag < 0.5 * step and axis.control.sample_time == 0.0:
        # a continuous control: what it gives in the middle of the step, from the last three samples
        ahead, rate = np.array([1.5, -0.5, 0.0]), np.array([2.0, -3.0, 1.0]) / step
        return np.ones(1), Kp * ahead + rate, Kp * ahead + ff * rate
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
    out[[_CLIP, _DELAY, _ANTI_WINDUP]] = c.clip, c.loop_delay / step, c.anti_windup
    out[_RATE] = 0.0 if c.law is not None else step / p.integral_time
    out[_GAIN] = p.velocity_gain
    out[_EVEN] = p.viscous_share * p.viscous
    laws = filters(axis, step)
    out[_TAPS] = max(len(values) for values in laws)
    for at, values in zip((_R, _S, _T), laws, strict=True):
        out[at : at + len(values)] = values
    return out


def torque_waves(axis: AxisPlant) -> np.ndarray:
    """Torques that vary with the motor's angle: amplitude N·m, order, phase rad, (waves, 3)."""
    there = [w for w in (axis.ripple, *axis.waves) if w[0] != 0.0]
    return np.array(there, float).reshape(-1, 3)


@njit(cache=True, nogil=True, error_model="numpy")
def means(angle, rate, step, shift, block):
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


@njit(cache=True, nogil=True, error_model="numpy")
def loop(p, waves, r, step, substeps, finer, state, position, velocity, torque):
    """Angles, rad, speeds, rad/s, and torques, N·m, at the control's samples; see the module."""
    n = len(r)
    h = step / substeps
    rate = p[_C] / p[_J]
    coarse, fine = _linear(rate, h), _linear(rate, h / finer)
    order = p[_WAVE_ORDER] if p[_WAVE] != 0.0 else 0.0
    for i in range(len(waves)):
        order = max(order, abs(waves[i, 1]))
    of_j = 1.0 / p[_J]
    tc, s0, s1 = p[_COULOMB], p[_SIGMA0], p[_SIGMA1]
    of_s0 = 1.0 / s0 if tc > 0.0 else 0.0
    th, om = state[0], state[1]
    before = np.empty(MOST_COEFFICIENTS)  # outputs, actual angles and commands of earlier samples, newest first
    actual = np.empty(MOST_COEFFICIENTS)
    wanted = np.empty(MOST_COEFFICIENTS)
    slope = r[1] - r[0] if abs(om) > 0.0 else 0.0
    sums = np.zeros(3)
    taps = int(p[_TAPS])
    for i in range(taps):
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
        z = (first - p[_CONSTANT] - _torque(waves, th)) * of_s0
        z = min(max(z, -tc * of_s0), tc * of_s0)
        if om != 0.0:  # it slides already
            z = math.copysign(_level(p, om, th) * of_s0, om)
    outputs = np.full(_RING, first)
    whole = min(int(p[_DELAY]), MOST_DELAY - 1)
    part = min(max(p[_DELAY] - whole, 0.0), 1.0)
    for k in range(n):
        position[k], velocity[k] = th, om
        if k:
            for i in range(taps - 1, 0, -1):
                actual[i], wanted[i], before[i] = actual[i - 1], wanted[i - 1], before[i - 1]
        actual[0], wanted[0] = th, r[k]
        x = 0.0
        for i in range(taps):
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
        tau = out
        if p[_DELAY] > 0.0:
            outputs[k & (_RING - 1)] = out
            here, earlier = outputs[(k - whole) & (_RING - 1)], outputs[(k - whole - 1) & (_RING - 1)]
            tau = (1.0 - part) * here + part * earlier
        torque[k] = tau
        split = p[_COULOMB] > 0.0 and not _keeps_sliding(p, z, om, th, tau, step)
        steps = substeps * finer if split else substeps
        h, e, f1, f2 = fine if split else coarse
        turns = int(abs(om) * order * step / WAVE) + 1
        if turns > steps:
            steps = min(turns, _MOST_STEPS)
            h, e, f1, f2 = _linear(rate, step / steps)
        of_h = 1.0 / h
        for _ in range(steps):
            f = p[_CONSTANT]
            if len(waves):
                f += _torque(waves, th + 0.5 * h * om)
            if tc > 0.0 or p[_RISE] != 0.0 or p[_EVEN] != 0.0:
                now = f + p[_EVEN] * abs(om)
                if tc > 0.0:
                    now += s0 * z + s1 * _bristle_rate(p, z, om, th)
                if p[_RISE] != 0.0:
                    now += math.copysign(p[_RISE] * (1.0 - math.exp(-abs(om) / p[_RISE_AT])), om)
                mid = om + 0.5 * h * (of_j * (tau - now) - rate * om)
                f += p[_EVEN] * abs(mid)
                if p[_RISE] != 0.0:
                    f += math.copysign(p[_RISE] * (1.0 - math.exp(-abs(mid) / p[_RISE_AT])), mid)
                if tc > 0.0:
                    g = _level(p, mid, th)
                    slides = g * of_s0
                    if p[_HOLD] != 0.0:
                        slides /= _slip(p, z, mid, g)
                    a = abs(mid) * h / slides
                    if a > 1e-9:
                        zn, mean = bristle(z, math.copysign(slides, mid), a)
                    else:
                        zn = z + mid * h
                        mean = 0.5 * (z + zn)
                    f += s0 * mean + s1 * (zn - z) * of_h
                    z = zn
            drive = (tau - f) * of_j
            th += f1 * om + f2 * drive
            om = e * om + f1 * drive


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _linear(rate, h):
    """A step h, the decay of the speed in it, and the factors on speed and acceleration that give the position."""
    e = math.exp(-rate * h)
    f1 = (1.0 - e) / rate if rate * h > 1e-9 else h
    f2 = (h - f1) / rate if rate * h > 1e-4 else 0.5 * h * h
    return h, e, f1, f2


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _keeps_sliding(p, z, om, th, tau, step):
    """Whether the bristles slide, and the axis does not turn back within a sample: friction is then constant."""
    slides = _level(p, om, th) / p[_SIGMA0]
    end = om + step / p[_J] * (tau - p[_C] * om - p[_CONSTANT] - p[_SIGMA0] * z)
    return z * om > 0.0 and abs(abs(z) - slides) < SLIDING * slides and end * om > 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _torque(waves, th):
    """Torque of all waves over the motor's angle, N·m."""
    total = 0.0
    for i in range(len(waves)):
        total += waves[i, 0] * math.sin(waves[i, 1] * th + waves[i, 2])
    return total


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
    """Share of the velocity that makes the bristles slip: in LuGre it is 1; with ``hold`` they are elastic up to that
    share of the level (Dupont et al. 2002), so that they do not creep at rest.
    """
    deflection = p[_SIGMA0] * abs(z) / g
    if z * om <= 0.0 or deflection <= p[_HOLD]:
        return 1e-12
    if deflection >= 1.0:
        return 1.0
    return 0.5 - 0.5 * math.cos(math.pi * (deflection - p[_HOLD]) / (1.0 - p[_HOLD]))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _bristle_rate(p, z, om, th):
    g = _level(p, om, th)
    rate = abs(om) * p[_SIGMA0] * z / g
    return om - (rate * _slip(p, z, om, g) if p[_HOLD] != 0.0 else rate)
