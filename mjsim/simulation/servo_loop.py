"""The compiled loop of one axis under a digital control; what it computes stands in :mod:`mjsim.simulation.servo`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from mjsim.machine.control import MOST_COEFFICIENTS
from mjsim.machine.plant import AxisPlant
from mjsim.simulation.drive import bristle, factor_of_direction, factor_of_place
from mjsim.simulation.servo_filters import filters, position_part, samples_of_set_point, set_point_share

# parameters of one axis
_J, _C, _CONSTANT, _COULOMB, _SIGMA0, _SIGMA1, _STATIC, _STRIBECK, _ASYMMETRY, _RISE, _RISE_AT = range(11)
_CLIP, _DELAY, _ANTI_WINDUP, _RATE, _GAIN, _HOLD, _LINEAR, _QUADRATIC = range(11, 19)
_WAVE, _TAPS, _EVEN, _EXCESS, _WAY, _REST, _LOSS = range(19, 26)
_PLAY, _FASTEST, _SET_POINT, _STALL, _NO_LOAD, _EVERY = range(26, 32)
_ERROR, _ERROR_ORDER, _ERROR_PHASE, _OF_LOAD = range(32, 36)
_R, _S, _T, _P = (36 + i * MOST_COEFFICIENTS for i in range(4))
_SIZE = 36 + 4 * MOST_COEFFICIENTS
#: Longest delay, samples of the control, and outputs that are kept, a power of two.
MOST_DELAY = 200
_RING = 256
#: Share by which bending bristles may differ from sliding ones.
SLIDING = 0.02
#: Angle of a wave in one sub-step, rad, and most sub-steps of a sample for it.
WAVE, _MOST_STEPS = 0.2, 100
#: Steps by which sines of waves are carried on before they are computed anew, and the way of the motor in a step, in
#: units of the way over which its bristles bend, below which a series stands for the exponential: good to 1e-9.
_EXACT, _SHORT_WAY = 100, 0.05
#: A law whose coefficients R sum up to less than this share of their sizes integrates: they are written with six digits
#: or more, and what is left is rounding.
INTEGRATES = 1e-6
#: Turn of a wave, rad, below which it is as it was.
_SAME_ANGLE = 1e-6
#: Speed, rad/s, and change of the torque in a sample, share of the friction, below which an axis is at rest.
AT_REST = 1e-9


def parameters(axis: AxisPlant, step: float) -> np.ndarray:
    """Numbers of one axis for the compiled loop, (_SIZE,)."""
    p, c = axis, axis.control
    out = np.zeros(_SIZE)
    out[[_J, _C, _CONSTANT, _STATIC, _STRIBECK]] = p.inertia, p.viscous, p.gravity, p.static_ratio, p.stribeck_velocity
    if p.coulomb > 0.0:
        s0 = p.coulomb / p.presliding
        out[[_COULOMB, _SIGMA0, _SIGMA1]] = p.coulomb, s0, 0.3 * math.sqrt(s0 * p.inertia)
        out[_LOSS] = p.torque_loss / p.coulomb
    out[[_ASYMMETRY, _RISE, _RISE_AT, _HOLD]] = p.asymmetry, *p.rising, p.hold
    out[[_LINEAR, _QUADRATIC]] = p.by_position
    out[_WAVE] = p.friction_ripple[0]
    out[[_CLIP, _DELAY, _ANTI_WINDUP]] = c.clip, c.loop_delay / step, c.anti_windup
    out[_RATE] = 0.0 if c.law is not None else step / p.integral_time
    out[_GAIN] = p.velocity_gain
    out[_EVEN] = p.viscous_share * p.viscous
    out[[_EXCESS, _WAY, _REST]] = p.resting[0], 1.0 / p.resting[1], 1.0 / p.resting[2]
    out[_PLAY] = p.play
    out[[_FASTEST, _SET_POINT, _STALL, _NO_LOAD]] = c.fastest, set_point_share(p, step), *c.voltage
    out[_EVERY] = samples_of_set_point(p, step)
    out[[_ERROR, _ERROR_ORDER, _ERROR_PHASE, _OF_LOAD]] = *p.encoder_error, p.encoder == "load"
    laws = (*filters(axis, step), position_part(axis, step))
    out[_TAPS] = max(len(values) for values in laws)
    for at, values in zip((_R, _S, _T, _P), laws, strict=True):
        out[at : at + len(values)] = values
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def loop(p, waves, r, step, substeps, finer, state, position, velocity, torque):
    """Angles, rad, and speeds, rad/s, that the encoder gives, and torques, N·m, at the control's samples; see the
    module. Where the log is that of an encoder at the load, angles and speeds are those of the motor itself.

    Row 0 of ``waves`` is that of the friction level, with its share as amplitude.
    """
    n = len(r)
    rate, of_j = p[_C] / p[_J], 1.0 / p[_J]
    coarse, fine = _linear(rate, step / substeps), _linear(rate, step / substeps / finer)
    wavy, order = False, 0.0
    for i in range(len(waves)):
        if waves[i, 0] != 0.0:
            wavy, order = True, max(order, abs(waves[i, 1]))
    tc, s0, s1 = p[_COULOMB], p[_SIGMA0], p[_SIGMA1]
    of_s0 = 1.0 / s0 if tc > 0.0 else 0.0
    th = _without_error(p, state[0])
    om = state[1] / _read(p, th)[1]
    turned, turns_left, angle = np.zeros((len(waves), 2)), 0, th  # sines and cosines of the waves at an angle
    _turn_to(turned, waves, th)
    wave = _torque(waves, turned)
    before = np.empty(MOST_COEFFICIENTS)  # outputs, actual angles and commands of earlier samples, newest first
    actual = np.empty(MOST_COEFFICIENTS)
    wanted = np.empty(MOST_COEFFICIENTS)
    lost, behind = np.zeros(MOST_COEFFICIENTS), th  # load less motor, and the load behind a play inside the loop
    slope = r[1] - r[0] if abs(om) > 0.0 else 0.0
    sums, size = np.zeros(3), 0.0
    taps = int(p[_TAPS])
    for i in range(taps):
        actual[i] = state[0] - i * state[1] * step
        wanted[i] = r[0] - i * slope
        sums[0] += p[_R + i]
        size += abs(p[_R + i])
        sums[1] += p[_S + i] * actual[i]
        sums[2] += p[_T + i] * wanted[i]
    x = (sums[2] - sums[1]) / sums[0] if abs(sums[0]) > INTEGRATES * size else 0.0
    before[:] = x
    last_x, integral = x, 0.0
    if p[_RATE] > 0.0:
        integral = state[2] / p[_GAIN] - x
    first = p[_GAIN] * (x + integral)
    first = min(max(first, -p[_CLIP]), p[_CLIP])
    z, place = 0.0, _place(p, turned, th)
    speed_part, rising = _at_speed(p, om)
    rested = 1.0 if om == 0.0 else _rested(p, 1.0, om, 1e9)  # share of the friction of a long rest
    aged, loaded = 1.0 + p[_EXCESS] * rested, 1.0 + p[_LOSS] * abs(first)  # factors on the level: of rest, and torque
    if tc > 0.0:
        z = (first - p[_CONSTANT] - wave) * of_s0
        most = tc * aged * loaded * of_s0
        z = min(max(z, -most), most)
        if om != 0.0:  # it slides already
            z = math.copysign(_level(p, om, speed_part * place * aged * loaded) * of_s0, om)
    outputs = np.full(_RING, first)
    whole = min(int(p[_DELAY]), MOST_DELAY - 1)
    part = min(max(p[_DELAY] - whole, 0.0), 1.0)
    every, held = int(p[_EVERY]), 0.0  # samples of a velocity set-point
    k, quiet, tau = 0, 0, first
    while k < n:
        read, per_speed = th, 1.0
        if p[_ERROR] != 0.0:
            read, per_speed = _read(p, th)
        position[k], velocity[k] = (th, om) if p[_OF_LOAD] > 0.0 else (read, om * per_speed)
        if k:
            for i in range(taps - 1, 0, -1):
                actual[i], wanted[i], before[i] = actual[i - 1], wanted[i - 1], before[i - 1]
                lost[i] = lost[i - 1]
        actual[0], wanted[0] = read, r[k]
        if p[_PLAY] > 0.0:
            behind = min(max(behind, th - p[_PLAY]), th + p[_PLAY])
            lost[0] = behind - read
        x, set_point = 0.0, 0.0
        for i in range(taps):
            x += p[_T + i] * wanted[i] - p[_S + i] * actual[i] - p[_P + i] * lost[i]
            set_point += p[_T + i] * wanted[i] - p[_P + i] * (actual[i] + lost[i])
            if i:
                x -= p[_R + i] * before[i]
        if k % every == 0:
            held = math.copysign(min(abs(set_point), p[_SET_POINT] * p[_FASTEST]), set_point)
        x += held - set_point
        before[0] = x
        more = integral + 0.5 * p[_RATE] * (x + last_x) if k else integral
        last_x = x
        out = p[_GAIN] * (x + more)
        # what the voltage leaves beside that of the motor's speed
        most = min(p[_CLIP], p[_STALL] * (1.0 - om * p[_NO_LOAD]))
        least = max(-p[_CLIP], -p[_STALL] * (1.0 + om * p[_NO_LOAD]))
        if out > most or out < least:
            if p[_ANTI_WINDUP] == 0.0 or out * x < 0.0:
                integral = more
            out = min(max(out, least), most)
        else:
            integral = more
        former, tau = tau, out
        if p[_DELAY] > 0.0:
            outputs[k & (_RING - 1)] = out
            here, earlier = outputs[(k - whole) & (_RING - 1)], outputs[(k - whole - 1) & (_RING - 1)]
            tau = (1.0 - part) * here + part * earlier
        torque[k] = tau
        split = False
        loaded = 1.0 + p[_LOSS] * abs(tau)
        if tc > 0.0:
            level = _level(p, om, speed_part * place * aged * loaded)
            end = om + step * of_j * (tau - p[_C] * om - p[_CONSTANT] - s0 * z)
            # where the bristles slide, and the axis does not turn back within a sample, friction is constant
            slides = z * om > 0.0 and abs(abs(z) * s0 - level) < SLIDING * level and end * om > 0.0
            split = not slides
            still = k > 0 and abs(om) < AT_REST and abs(tau - former) < AT_REST * tc and p[_RATE] == 0.0
            quiet = quiet + 1 if still and r[k] == r[k - 1] else 0
            if quiet > whole + taps + every + 1:  # nothing moves until the command does
                begun = k
                while k + 1 < n and r[k + 1] == r[k]:
                    k += 1
                    position[k], velocity[k], torque[k] = position[k - 1], om, tau
                if p[_EXCESS] != 0.0:
                    rested = 1.0 - (1.0 - rested) * math.exp(-(k - begun) * step * p[_REST])
                outputs[:] = out
        steps = substeps * finer if split else substeps
        h, e, f1, f2 = fine if split else coarse
        turns = int(abs(om) * order * step / WAVE) + 1
        if turns > steps:
            steps = min(turns, _MOST_STEPS)
            h, e, f1, f2 = _linear(rate, step / steps)
        of_h = 1.0 / h
        for _ in range(steps):
            f, middle = p[_CONSTANT], th + 0.5 * h * om
            if wavy:
                if abs(middle - angle) * order > _SAME_ANGLE:
                    turns_left -= 1
                    if turns_left < 0 or abs(middle - angle) * order > 2.0 * WAVE:
                        _turn_to(turned, waves, middle)
                        turns_left = _EXACT
                    else:
                        _turn_by(turned, waves, middle - angle)
                    angle, wave = middle, _torque(waves, turned)
                f += wave
            if tc > 0.0 or p[_RISE] != 0.0 or p[_EVEN] != 0.0:
                # the speed in the middle of the step, from friction as it was in the middle of the former one
                now = f + p[_EVEN] * abs(om) + math.copysign(rising, om)
                if tc > 0.0:
                    place = _place(p, turned, middle)
                    g = _level(p, om, speed_part * place * aged * loaded)
                    slip = abs(om) * s0 * z / g
                    now += s0 * z + s1 * (om - (slip * _slip(p, z, om, g) if p[_HOLD] != 0.0 else slip))
                mid = om + 0.5 * h * (of_j * (tau - now) - rate * om)
                speed_part, rising = _at_speed(p, mid)
                f += p[_EVEN] * abs(mid) + math.copysign(rising, mid)
                if p[_EXCESS] != 0.0:
                    earlier_rested = rested
                    rested = _rested(p, rested, mid, h)
                    aged = 1.0 + p[_EXCESS] * 0.5 * (earlier_rested + rested)
                if tc > 0.0:
                    g = _level(p, mid, speed_part * place * aged * loaded)
                    way = g * of_s0
                    if p[_HOLD] != 0.0:
                        way /= _slip(p, z, mid, g)
                    a = abs(mid) * h / way
                    if a > _SHORT_WAY:
                        zn, mean = bristle(z, math.copysign(way, mid), a)
                    else:  # the same by its series
                        share = 1.0 - a * (0.5 - a * (1.0 / 6.0 - a * (1.0 / 24.0 - a / 120.0)))
                        end = math.copysign(way, mid)
                        zn, mean = z + (end - z) * a * share, end + (z - end) * share
                    f += s0 * mean + s1 * (zn - z) * of_h
                    z = zn
            drive = (tau - f) * of_j
            th += f1 * om + f2 * drive
            om = e * om + f1 * drive
        k += 1


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _read(p, th):
    """What the motor's encoder gives for its angle, and its rate over that of the angle."""
    phase = p[_ERROR_ORDER] * th + p[_ERROR_PHASE]
    return th + p[_ERROR] * math.sin(phase), 1.0 + p[_ERROR] * p[_ERROR_ORDER] * math.cos(phase)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _without_error(p, read):
    """The motor's angle for which its encoder gives an angle: what it reads wrong is small against a turn."""
    angle = read
    for _ in range(20):
        angle = read - p[_ERROR] * math.sin(p[_ERROR_ORDER] * angle + p[_ERROR_PHASE])
    return angle


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _linear(rate, h):
    """A step h, the decay of the speed in it, and the factors on speed and acceleration that give the position."""
    e = math.exp(-rate * h)
    f1 = (1.0 - e) / rate if rate * h > 1e-9 else h
    f2 = (h - f1) / rate if rate * h > 1e-4 else 0.5 * h * h
    return h, e, f1, f2


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _turn_to(turned, waves, angle):
    """Sines and cosines of all waves at a motor angle."""
    for i in range(len(waves)):
        phase = waves[i, 1] * angle + waves[i, 2]
        turned[i, 0], turned[i, 1] = math.sin(phase), math.cos(phase)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _turn_by(turned, waves, angle):
    """The same a small motor angle on: by the series of the turn's sine and cosine."""
    for i in range(len(waves)):
        d = waves[i, 1] * angle
        q = d * d
        sine = d * (1.0 - q * (1.0 / 6.0 - q * (1.0 / 120.0 - q * (1.0 / 5040.0))))
        cosine = 1.0 - q * (0.5 - q * (1.0 / 24.0 - q * (1.0 / 720.0)))
        s, c = turned[i, 0], turned[i, 1]
        turned[i, 0], turned[i, 1] = s * cosine + c * sine, c * cosine - s * sine


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _torque(waves, turned):
    """Torque of all waves over the motor's angle, N·m."""
    total = 0.0
    for i in range(1, len(waves)):
        total += waves[i, 0] * turned[i, 0]
    return total


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _at_speed(p, om):
    """The factor of a speed on the friction level, and the torque that rises and saturates, N·m."""
    factor, rising = 1.0, 0.0
    if p[_STRIBECK] > 0.0:
        w = om / p[_STRIBECK]
        factor += (p[_STATIC] - 1.0) * math.exp(-w * w)
    if p[_RISE] != 0.0:
        rising = p[_RISE] * (1.0 - math.exp(-abs(om) / p[_RISE_AT]))
    return factor, rising


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _rested(p, rested, om, h):
    """Share of the friction of a long rest after a time at a speed: it forms with time, and motion ends it."""
    rate = p[_REST] + abs(om) * p[_WAY]
    if h * rate < 0.2:
        return rested + h * (p[_REST] - rate * rested) / (1.0 + 0.5 * h * rate)
    return p[_REST] / rate + (rested - p[_REST] / rate) * math.exp(-h * rate)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _place(p, turned, th):
    """The factor of a motor angle on the friction level."""
    factor = 1.0
    if p[_LINEAR] != 0.0 or p[_QUADRATIC] != 0.0:
        factor = factor_of_place(p[_LINEAR], p[_QUADRATIC], th)
    if p[_WAVE] != 0.0:
        factor *= 1.0 + p[_WAVE] * turned[0, 0]
    return factor


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _level(p, om, factor):
    """The friction level at which the bristles slide one way, N·m, with the factors of speed and angle on it."""
    g = p[_COULOMB] * factor
    return g * factor_of_direction(p[_ASYMMETRY], om) if p[_ASYMMETRY] != 0.0 else g


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
