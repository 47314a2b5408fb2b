"""The cascaded servo drive with LuGre friction, advanced by an exact discretisation of its linear part.

    ω_ref = Kpp (r − θ) + ratio·dr/dt
    τ     = Kvp [(ω_ref − ω) + (1/Ti) ∫(ω_ref − ω) dt]
    J dω/dt = τ − C ω − τ_friction − τ_gravity − τ_disturbance          (paper, Fig. 2; friction: LuGre)

The linear part over one sub-step is a matrix exponential (no time-step error for a command that is linear in the sub-step);
the bristle state has its own exact exponential at the sub-step's mid velocity. Both together are of second order in the
sub-step where the velocity keeps its sign; ``tests/test_convergence.py`` holds the measured errors.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from scipy.linalg import expm

from mjsim.engine.plant import AxisPlant

#: MuJoCo's time step and the drive's sub-steps in it, from the convergence study (``tests/test_convergence.py``).
STEP = 1.0e-3
SUBSTEPS = 2

# state of one axis
THETA, OMEGA, INTEGRAL, BRISTLE, R_BEFORE, R_NOW = range(6)
STATE_SIZE = 8
# parameters of one axis
_A, _B0, _B1, _BF = 0, 9, 12, 15
_RATE, _SIGMA0, _SIGMA1, _COULOMB, _STATIC, _STRIBECK = 18, 24, 25, 26, 27, 28
_RIPPLE, _GRAVITY, GEAR, _TI_TORQUE = 29, 32, 33, 34
AXIS_SIZE = 40


def discretise(axis: AxisPlant, substep: float) -> np.ndarray:
    """Parameters of one axis, (AXIS_SIZE,), for sub-steps of ``substep`` s."""
    p = axis
    J, Kv, Kp, Ti, ff = p.inertia, p.velocity_gain, p.position_gain, p.integral_time, p.feedforward
    # states θ, ω, I; inputs r, dr/dt, torque against the motor
    F = np.array([[0.0, 1.0, 0.0], [-Kv * Kp / J, -(Kv + p.viscous) / J, Kv / (Ti * J)], [-Kp, -1.0, 0.0]])
    G = np.array([[0.0, 0.0, 0.0], [Kv * Kp / J, Kv * ff / J, -1.0 / J], [Kp, ff, 0.0]])
    big = np.zeros((6, 6))
    big[:3, :3], big[:3, 3:], big[3, 4] = F, G, 1.0
    E = expm(big * substep)
    out = np.zeros(AXIS_SIZE)
    out[_A : _A + 9] = E[:3, :3].ravel()
    out[_B0 : _B0 + 3] = E[:3, 3]
    out[_B1 : _B1 + 3] = E[:3, 4] / substep  # per change of r over the sub-step
    out[_BF : _BF + 3] = E[:3, 5]
    out[_RATE : _RATE + 6] = [*F[1], *G[1]]
    if p.coulomb > 0:
        s0 = p.coulomb / p.presliding
        out[_SIGMA0], out[_SIGMA1], out[_COULOMB] = s0, 0.3 * math.sqrt(s0 * J), p.coulomb
    out[_STATIC], out[_STRIBECK] = p.static_ratio, p.stribeck_velocity
    out[_RIPPLE : _RIPPLE + 3] = p.ripple
    out[_GRAVITY], out[GEAR], out[_TI_TORQUE] = p.gravity, p.gear, Kv / Ti
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def start(p, s, r):
    """At rest on the first command ``r`` (axis units), the integrator holding gravity."""
    s[:] = 0.0
    s[THETA] = r * p[GEAR]
    s[INTEGRAL] = p[_GRAVITY] / p[_TI_TORQUE]
    s[R_BEFORE] = s[THETA]
    s[R_NOW] = s[THETA]


@njit(cache=True, nogil=True, error_model="numpy")
def advance(p, s, r_next, load_torque, substep, substeps):
    """Advance one axis over one step: ``r_next`` is the command (axis units) at its end, ``load_torque`` acts against the motor."""
    rb, r0, r1 = s[R_BEFORE], s[R_NOW], r_next * p[GEAR]
    slope, curve = 0.5 * (r1 - rb), 0.5 * (r1 - 2.0 * r0 + rb)
    th, om, it, z = s[THETA], s[OMEGA], s[INTEGRAL], s[BRISTLE]
    s0, s1, tc = p[_SIGMA0], p[_SIGMA1], p[_COULOMB]
    ripple = p[_RIPPLE]
    constant = p[_GRAVITY] + load_torque
    ra = r0
    n = 1.0 / substeps
    for k in range(substeps):
        u = (k + 1) * n
        rc = r0 + u * (slope + u * curve)
        dr = rc - ra
        f = constant
        if tc > 0.0 or ripple != 0.0:
            # mid velocity from the rate now, friction at the bristle's present state
            g = tc
            if p[_STRIBECK] > 0.0:
                w = om / p[_STRIBECK]
                g = tc * (1.0 + (p[_STATIC] - 1.0) * math.exp(-w * w))
            now = constant
            if tc > 0.0:
                now += s0 * z + s1 * (om - abs(om) * s0 * z / g)
            if ripple != 0.0:
                now += ripple * math.sin(p[_RIPPLE + 1] * th + p[_RIPPLE + 2])
            rate = p[_RATE] * th + p[_RATE + 1] * om + p[_RATE + 2] * it
            rate += p[_RATE + 3] * ra + p[_RATE + 4] * dr / substep + p[_RATE + 5] * now
            mid = om + 0.5 * substep * rate
            if tc > 0.0:
                if p[_STRIBECK] > 0.0:
                    w = mid / p[_STRIBECK]
                    g = tc * (1.0 + (p[_STATIC] - 1.0) * math.exp(-w * w))
                a = abs(mid) * substep * s0 / g
                if a > 1e-9:
                    e = math.exp(-a)
                    end = math.copysign(g / s0, mid)
                    zn = end + (z - end) * e
                    mean = end + (z - end) * (1.0 - e) / a
                else:
                    zn = z + mid * substep
                    mean = 0.5 * (z + zn)
                f += s0 * mean + s1 * (zn - z) / substep
                z = zn
            if ripple != 0.0:
                f += ripple * math.sin(p[_RIPPLE + 1] * (th + 0.5 * substep * om) + p[_RIPPLE + 2])
        t2 = p[0] * th + p[1] * om + p[2] * it + p[9] * ra + p[12] * dr + p[15] * f
        o2 = p[3] * th + p[4] * om + p[5] * it + p[10] * ra + p[13] * dr + p[16] * f
        i2 = p[6] * th + p[7] * om + p[8] * it + p[11] * ra + p[14] * dr + p[17] * f
        th, om, it = t2, o2, i2
        ra = rc
    s[THETA], s[OMEGA], s[INTEGRAL], s[BRISTLE] = th, om, it, z
    s[R_BEFORE], s[R_NOW] = r0, r1


@njit(cache=True, nogil=True, error_model="numpy")
def run(p, commands, substep, substeps, out):
    """Motor position in axis units, ``out`` (n,), for ``commands`` (n,) one step apart; the axis without the multibody model."""
    s = np.zeros(STATE_SIZE)
    start(p, s, commands[0])
    out[0] = commands[0]
    for k in range(1, len(commands)):
        advance(p, s, commands[k], 0.0, substep, substeps)
        out[k] = s[THETA] / p[GEAR]
