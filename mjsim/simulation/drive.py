"""The cascaded servo drive with LuGre friction, advanced by an exact discretisation of its linear part.

    ω_ref = Kpp (r − θ) + ratio·dr/dt
    τ     = Kvp [(ω_ref − ω) + (1/Ti) ∫(ω_ref − ω) dt]
    J dω/dt = τ − C ω − τ_friction − τ_gravity − τ_disturbance          (paper, Fig. 2; friction: LuGre)

The linear part over one sub-step is a matrix exponential (no time-step error for a command that is linear in the
sub-step); the bristle state has its own exact exponential at the sub-step's mid velocity. Both together are of second
order in the sub-step where the velocity keeps its sign; ``tests/test_convergence.py`` holds the measured errors.

Where the position loop is closed on the load (an encoder at the load), the position that is held against r is that of
the load behind the play, y = clip(y, θ − b/2, θ + b/2); the velocity loop stays on the motor.

The friction level is that of the speed (Stribeck), times a factor of the direction and of the motor's angle:

    g(ω, θ) = Tc [1 + (static_ratio − 1) exp(−(ω/ω_s)²)] (1 + asymmetry·sign ω) (1 + linear·θ + quadratic·θ²)
              · (1 + a sin(order·θ + phase))

With an elastic transmission the load is a second mass on a spring, and two more states:

    Jm dω/dt = τ − C ω − … − T,   Jl dω_l/dt = T,   T = k (θ − θ_l) + 2 ζ √(k Jl) (ω − ω_l)    (all on the motor's side)
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit
from scipy.linalg import expm

from mjsim.machine.plant import AxisPlant

#: MuJoCo's time step and the drive's sub-steps in it, from the convergence study (``tests/test_convergence.py``).
STEP = 1.0e-3
SUBSTEPS = 2
#: Largest phase of the motor's swing on its bristles in a sub-step, rad: coupled explicitly, they are unstable at 2 and
#: good to 0.02 µm below this (``tests/test_oracle_drives.py``). Friction that asks for more sub-steps than the last
#: number is refused.
PHASE, MOST_SUBSTEPS = 0.5, 400
#: Least factor of the place on the friction level.
_LEAST = 0.1
#: Share by which the bristles may differ from those that slide on: the last bits of a number.
_ROUNDING = 1e-15

# state of one axis
THETA, OMEGA, INTEGRAL, BRISTLE, R_BEFORE, R_NOW, LOAD, LOAD_RATE, BEHIND = range(9)
STATE_SIZE = 9
# parameters of one axis
_A, _B0, _B1, _BF = 0, 9, 12, 15
_RATE, _SIGMA0, _SIGMA1, _COULOMB, _STATIC, _STRIBECK = 18, 24, 25, 26, 27, 28
_RIPPLE, _GRAVITY, GEAR, _TI_TORQUE, _ELASTIC = 29, 32, 33, 34, 35
_RATE_LOAD, _PLAY, _TWO_MASS = 36, 38, 42
# one over some of them: divisions are what a sub-step waits for
_OF_COULOMB, _OF_SIGMA0, _OF_SUBSTEP = 39, 40, 41
# whether the friction level varies, its share that turns with the direction, by rad and rad² of the motor, and a wave
_VARIES, _DIRECTION, _LINEAR, _QUADRATIC, _WAVE = range(_TWO_MASS + 5 * 8, _TWO_MASS + 5 * 8 + 5)
AXIS_SIZE = _WAVE + 3


def discretise(axis: AxisPlant, substep: float) -> np.ndarray:
    """Parameters of one axis, (AXIS_SIZE,), for sub-steps of ``substep`` s."""
    return _discretised(axis.key(), substep).copy()


@lru_cache(maxsize=512)  # one drive runs in every test of a campaign
def _discretised(key: tuple, substep: float) -> np.ndarray:
    axis = AxisPlant(*key)
    p = axis
    F, G = equations(axis)
    E = _exponential(F, G, substep)
    out = np.zeros(AXIS_SIZE)
    if p.load_inertia:
        out[_ELASTIC] = 1.0
        out[_TWO_MASS:_VARIES] = E.ravel()
        out[_RATE_LOAD : _RATE_LOAD + 2] = F[1, 3:]
    else:
        out[_A : _A + 9] = E[:, :3].ravel()
        out[_B0 : _B0 + 9] = E[:, 3:].T.ravel()
    out[_RATE : _RATE + 6] = [*F[1, :3], *G[1]]
    if p.coulomb > 0:
        s0 = p.coulomb / p.presliding
        out[_SIGMA0], out[_SIGMA1], out[_COULOMB] = s0, 0.3 * math.sqrt(s0 * p.inertia), p.coulomb
        out[_OF_COULOMB], out[_OF_SIGMA0] = 1.0 / p.coulomb, 1.0 / s0
    out[_OF_SUBSTEP] = 1.0 / substep
    out[_STATIC], out[_STRIBECK] = p.static_ratio, p.stribeck_velocity
    out[_RIPPLE : _RIPPLE + 3] = p.ripple
    out[_DIRECTION : _WAVE + 3] = p.asymmetry, *p.by_position, *p.friction_ripple
    out[_VARIES] = np.any(out[_DIRECTION : _WAVE + 1])
    out[_PLAY] = p.play
    out[_GRAVITY], out[GEAR], out[_TI_TORQUE] = p.gravity, p.gear, p.velocity_gain / p.integral_time
    return out


def bristle_rate(axis: AxisPlant) -> float:
    """Angular frequency of the motor on its bristles, √(σ0/J) in rad/s; 0 without friction."""
    return math.sqrt(axis.coulomb / axis.presliding / (axis.inertia - axis.load_inertia)) if axis.coulomb > 0 else 0.0


def substeps_of(axis: AxisPlant, step: float, least: int = SUBSTEPS) -> int:
    """Sub-steps of a step of ``step`` s that this drive needs: ``least``, more where its bristles are stiff."""
    return min(max(least, math.ceil(step * bristle_rate(axis) / PHASE)), max(least, MOST_SUBSTEPS))


def equations(axis: AxisPlant) -> tuple[np.ndarray, np.ndarray]:
    """The linear part x' = F x + G u, F (n, n) and G (n, 3).

    States are θ, ω, ∫(ω_ref − ω) dt, and with an elastic transmission θ, ω of the load; inputs r, dr/dt and a torque
    against the motor.
    """
    p = axis
    J, Kv, Kp, Ti, ff = p.inertia - p.load_inertia, p.velocity_gain, p.position_gain, p.integral_time, p.feedforward
    n = 5 if p.load_inertia else 3
    F, G = np.zeros((n, n)), np.zeros((n, 3))
    F[:3, :3] = [[0.0, 1.0, 0.0], [-Kv * Kp / J, -(Kv + p.viscous) / J, Kv / (Ti * J)], [-Kp, -1.0, 0.0]]
    G[:3] = [[0.0, 0.0, 0.0], [Kv * Kp / J, Kv * ff / J, -1.0 / J], [Kp, ff, 0.0]]
    if p.load_inertia:
        spring = np.array([p.stiffness, p.damping, 0.0, -p.stiffness, -p.damping])
        F[1] -= spring / J
        F[3, 4] = 1.0
        F[4] += spring / p.load_inertia
    if p.load_inertia and p.on_load:
        F[1:3, 3] += F[1:3, 0] - [-p.stiffness / J, 0.0]
        F[1:3, 0] = -p.stiffness / J, 0.0
    return F, G


def _exponential(F: np.ndarray, G: np.ndarray, substep: float) -> np.ndarray:
    """Exact sub-step of x' = F x + G u, (n, n + 3): of the state, of r, of r's change over the sub-step, of the
    torque.
    """
    n = len(F)
    big = np.zeros((n + 3, n + 3))
    big[:n, :n], big[:n, n:], big[n, n + 1] = F, G, 1.0
    E = expm(big * substep)[:n]
    E[:, n + 1] /= substep
    return E


@njit(cache=True, nogil=True, error_model="numpy")
def start(p, s, r):
    """At rest on the first command ``r`` (axis units), the integrator holding gravity."""
    s[:] = 0.0
    s[THETA] = r * p[GEAR]
    s[INTEGRAL] = p[_GRAVITY] / p[_TI_TORQUE]
    s[R_BEFORE] = s[THETA]
    s[R_NOW] = s[THETA]
    s[LOAD] = s[THETA]
    s[BEHIND] = s[THETA]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _row(e, i, th, om, it, lth, lom, outer):
    k = 8 * i
    return outer + e[k + 3] * lth + e[k + 4] * lom + (e[k] * th + e[k + 2] * it) + e[k + 1] * om


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _stepped(p, th, om, it, lth, lom, seen, dr, f):
    """State of the linear part after a sub-step with the inputs ``seen`` and ``dr`` and the torque ``f``.

    What the state does not change is added up first: the next sub-step waits for the rest.
    """
    if p[_ELASTIC] > 0.0:
        e = p[_TWO_MASS:]
        t2 = _row(e, 0, th, om, it, lth, lom, e[5] * seen + e[6] * dr + e[7] * f)
        o2 = _row(e, 1, th, om, it, lth, lom, e[13] * seen + e[14] * dr + e[15] * f)
        i2 = _row(e, 2, th, om, it, lth, lom, e[21] * seen + e[22] * dr + e[23] * f)
        l2 = _row(e, 3, th, om, it, lth, lom, e[29] * seen + e[30] * dr + e[31] * f)
        return t2, o2, i2, l2, _row(e, 4, th, om, it, lth, lom, e[37] * seen + e[38] * dr + e[39] * f)
    t2 = (p[9] * seen + p[12] * dr + p[15] * f) + (p[0] * th + p[2] * it) + p[1] * om
    o2 = (p[10] * seen + p[13] * dr + p[16] * f) + (p[3] * th + p[5] * it) + p[4] * om
    i2 = (p[11] * seen + p[14] * dr + p[17] * f) + (p[6] * th + p[8] * it) + p[7] * om
    return t2, o2, i2, lth, lom


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _level(p, om, th):
    """The friction at which the bristles slide on at a speed and an angle of the motor, N·m."""
    g = p[_COULOMB]
    if p[_STRIBECK] > 0.0:
        w = om / p[_STRIBECK]
        g = g * (1.0 + (p[_STATIC] - 1.0) * math.exp(-w * w))
    if p[_VARIES] > 0.0:
        g *= factor_of_place(p[_LINEAR], p[_QUADRATIC], th) * factor_of_direction(p[_DIRECTION], om)
        g *= 1.0 + p[_WAVE] * math.sin(p[_WAVE + 1] * th + p[_WAVE + 2])
    return g


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def factor_of_place(linear, quadratic, th):
    """The factor of a motor angle on the friction level."""
    return max(1.0 + th * (linear + th * quadratic), _LEAST)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def factor_of_direction(share, om):
    """The factor of a direction of motion on the friction level."""
    return 1.0 + math.copysign(share, om * share)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def bristle(z, end, way):
    """LuGre's bristle while the motor slides one way: its deflection afterwards, and the mean on the way.

    ``end`` is the deflection at which it slides on, ``way`` how far the motor turns, in units of the way over which it
    gets there.
    """
    e = math.exp(-way)
    return end + (z - end) * e, end + (z - end) * (1.0 - e) / way


@njit(cache=True, nogil=True, error_model="numpy")
def advance(p, s, r_next, load_torque, substep, substeps):
    """Advance one axis over one step: ``r_next`` is the command (axis units) at its end, ``load_torque`` acts
    against the motor.
    """
    rb, r0, r1 = s[R_BEFORE], s[R_NOW], r_next * p[GEAR]
    slope, curve = 0.5 * (r1 - rb), 0.5 * (r1 - 2.0 * r0 + rb)
    th, om, it, z = s[THETA], s[OMEGA], s[INTEGRAL], s[BRISTLE]
    elastic, lth, lom = p[_ELASTIC] > 0.0, s[LOAD], s[LOAD_RATE]
    s0, s1, tc = p[_SIGMA0], p[_SIGMA1], p[_COULOMB]
    ripple = p[_RIPPLE]
    constant = p[_GRAVITY] + load_torque
    ra = r0
    half, behind = p[_PLAY], s[BEHIND]  # of a play inside the position loop
    lost = behind - (lth if elastic else th) if half > 0.0 else 0.0
    n, rate_of = 1.0 / substeps, p[_OF_SUBSTEP]
    g, of_g, of_s0 = tc, p[_OF_COULOMB], p[_OF_SIGMA0]
    of_speed, varies = p[_STRIBECK] > 0.0, p[_VARIES] > 0.0
    is_level = p[_STRIBECK] == 0.0 and ripple == 0.0 and not varies
    for k in range(substeps):
        u = (k + 1) * n
        rc = r0 + u * (slope + u * curve)
        dr = rc - ra
        f, seen = constant + s0 * z, ra - lost
        end = math.copysign(g * of_s0, om)
        # It slides on, as for most of a test, and has the friction that it had. That is tried in any case: a branch
        # around it costs every sub-step more than a step that is in vain.
        slides = is_level and abs(z - end) <= _ROUNDING * abs(end)
        t2, o2, i2, l2, lo2 = _stepped(p, th, om, it, lth, lom, seen, dr, f)
        if not slides or o2 * om < 0.0:
            # mid velocity from the rate now, friction at the bristle's present state
            f, now = constant, f
            if tc > 0.0:
                if of_speed or varies:
                    of_g = 1.0 / _level(p, om, th)
                now += s1 * (om - abs(om) * s0 * z * of_g)
            if ripple != 0.0:
                now += ripple * math.sin(p[_RIPPLE + 1] * th + p[_RIPPLE + 2])
            rate = p[_RATE] * th + p[_RATE + 1] * om + p[_RATE + 2] * it
            rate += p[_RATE + 3] * seen + p[_RATE + 4] * dr * rate_of + p[_RATE + 5] * now
            if elastic:
                rate += p[_RATE_LOAD] * lth + p[_RATE_LOAD + 1] * lom
            mid = om + 0.5 * substep * rate
            if tc > 0.0:
                if of_speed or varies:
                    g = _level(p, mid, th + 0.5 * substep * om)
                    of_g = 1.0 / g
                end = math.copysign(g * of_s0, mid)
                a = abs(mid) * substep * s0 * of_g
                if abs(z - end) <= _ROUNDING * abs(end):
                    zn = mean = z
                elif a > 1e-9:
                    zn, mean = bristle(z, end, a)
                else:
                    zn = z + mid * substep
                    mean = 0.5 * (z + zn)
                f += s0 * mean + s1 * (zn - z) * rate_of
                z = zn
            if ripple != 0.0:
                f += ripple * math.sin(p[_RIPPLE + 1] * (th + 0.5 * substep * om) + p[_RIPPLE + 2])
            t2, o2, i2, l2, lo2 = _stepped(p, th, om, it, lth, lom, seen, dr, f)
        th, om, it, lth, lom = t2, o2, i2, l2, lo2
        if half > 0.0:
            before = lth if elastic else th
            behind = min(max(behind, before - half), before + half)
            lost = behind - before
        ra = rc
    s[THETA], s[OMEGA], s[INTEGRAL], s[BRISTLE] = th, om, it, z
    s[R_BEFORE], s[R_NOW] = r0, r1
    s[LOAD], s[LOAD_RATE] = (lth, lom) if elastic else (th, om)
    s[BEHIND] = behind if half > 0.0 else s[LOAD]


@njit(cache=True, nogil=True, error_model="numpy")
def run(p, commands, substep, substeps, out):
    """Load position in axis units, ``out`` (n,), for ``commands`` (n,) one step apart; the axis without the
    multibody model.
    """
    s = np.zeros(STATE_SIZE)
    start(p, s, commands[0])
    out[0] = commands[0]
    for k in range(1, len(commands)):
        advance(p, s, commands[k], 0.0, substep, substeps)
        out[k] = s[BEHIND] / p[GEAR]
