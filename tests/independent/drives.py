"""Five independent P-PI drives with LuGre friction, integrated by a fixed-step Runge-Kutta of fourth order.

    ω_ref = Kpp (r − θ) + feedforward · dr/dt
    τ = Kvp [ (ω_ref − ω) + 1/Ti ∫(ω_ref − ω) dt ]
    J dω/dt = τ − C ω − τ_friction − τ_gravity − τ_disturbance
    dz/dt = ω − |ω| σ0 z / g(ω),  τ_friction = σ0 z + σ1 dz/dt,  σ0 = Tc / presliding,  σ1 = 0.3 √(σ0 J)

With an elastic transmission the load is a second inertia on a spring; friction and gravity stay on the motor. All is in
motor units (rad). On a wild machine Tc is not the same everywhere: Tc (1 + p cos(k θ + ψ)) (1 ± w), + where ω > 0.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

from .kinematics import AXES, DEG

#: Spacing of commands and results, s.
GRID = 1e-3
#: Integration steps per grid interval: 100 µs. Quarter steps change positions by less than 2e-11 m and rad.
SUBSTEPS = 10
#: What each axis moves, kg and kg m² (the bodies in the table of models/README.md); the rest of an axis' inertia is the
#: motor's rotor, coupling and screw or worm, and that is 5 % at least.
_BODIES = {"X": 875.23, "Y": 716.99, "Z": 586.62, "A": 5.13, "C": 5.09}
_MOST_BODIES = 0.95


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"}, inline="always")
def _rates(r, rate, th, om, acc, z, load, speed, p):
    kpp, kvp, ti, j, visc, grav, tc, s0, s1, ratio, stribeck, amp, order, phase, ff, jl, k, d, place, wave, at, way = p
    lag = kpp * (r - th) + ff * rate - om
    torque = kvp * (lag + acc / ti)
    net = torque - visc * om - grav
    zdot = 0.0
    if tc > 0.0:
        g = tc
        if ratio != 1.0:
            g = tc * (1.0 + (ratio - 1.0) * np.exp(-((om / stribeck) ** 2)))
        if place != 0.0 or way != 0.0:
            g *= (1.0 + place * np.cos(wave * th + at)) * (1.0 + (way if om > 0.0 else -way))
        zdot = om - abs(om) * s0 * z / g
        net -= s0 * z + s1 * zdot
    if amp != 0.0:
        net -= amp * np.sin(order * th + phase)
    push = 0.0
    if jl > 0.0:
        spring = k * (th - load) + d * (om - speed)
        push = spring / jl
        net -= spring
    return om, net / (j - jl), lag, zdot, speed, push, torque


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
def _integrate(r, steps, p, motor, load, torque):
    """Fills motor and load angle and torque at the grid instants of the command r (all rad, rad, N m)."""
    n = len(r)
    h = GRID / steps
    kvp, ti, grav = p[1], p[2], p[5]
    th, om, acc, z, q, v = r[0], 0.0, grav * ti / kvp, 0.0, r[0], 0.0
    for i in range(n):
        motor[i], load[i] = th, q
        # a cubic through the neighbours, C1 across intervals, carries the command between grid points
        r0, r1 = r[i], r[min(i + 1, n - 1)]
        m0 = 0.5 * (r1 - r[max(i - 1, 0)])
        m1 = 0.5 * (r[min(i + 2, n - 1)] - r0)
        c2, c3 = 3.0 * (r1 - r0) - 2.0 * m0 - m1, 2.0 * (r0 - r1) + m0 + m1
        for s in range(steps):
            u = s / steps
            a = _rates(
                r0 + u * (m0 + u * (c2 + u * c3)), (m0 + u * (2 * c2 + 3 * u * c3)) / GRID, th, om, acc, z, q, v, p
            )
            if s == 0:
                torque[i] = a[6]
            u = (s + 0.5) / steps
            cmd, rate, e = r0 + u * (m0 + u * (c2 + u * c3)), (m0 + u * (2 * c2 + 3 * u * c3)) / GRID, 0.5 * h
            b = _rates(
                cmd, rate, th + e * a[0], om + e * a[1], acc + e * a[2], z + e * a[3], q + e * a[4], v + e * a[5], p
            )
            c = _rates(
                cmd, rate, th + e * b[0], om + e * b[1], acc + e * b[2], z + e * b[3], q + e * b[4], v + e * b[5], p
            )
            u = (s + 1.0) / steps
            cmd, rate = r0 + u * (m0 + u * (c2 + u * c3)), (m0 + u * (2 * c2 + 3 * u * c3)) / GRID
            f = _rates(
                cmd, rate, th + h * c[0], om + h * c[1], acc + h * c[2], z + h * c[3], q + h * c[4], v + h * c[5], p
            )
            e = h / 6.0
            th += e * (a[0] + 2.0 * (b[0] + c[0]) + f[0])
            om += e * (a[1] + 2.0 * (b[1] + c[1]) + f[1])
            acc += e * (a[2] + 2.0 * (b[2] + c[2]) + f[2])
            z += e * (a[3] + 2.0 * (b[3] + c[3]) + f[3])
            q += e * (a[4] + 2.0 * (b[4] + c[4]) + f[4])
            v += e * (a[5] + 2.0 * (b[5] + c[5]) + f[5])


def gear(drive: dict) -> float:
    """Motor angle per axis travel, rad/m for a screw, rad/rad for a worm."""
    return 2.0 * np.pi / (drive["lead_mm"] * 1e-3) if "lead_mm" in drive else float(drive["worm_teeth"])


def load_inertia(axis: str, drive: dict) -> float:
    """Inertia of what an axis moves, on the motor's side, kg m²."""
    return float(min(_BODIES[axis] / gear(drive) ** 2, _MOST_BODIES * drive["inertia_kgm2"]))


def parameters(axis: str, drive: dict, effects: dict) -> tuple[float, ...]:
    """The numbers of one axis' drive with its effects, in the order that the integrator takes them (SI, motor side)."""

    def get(kind: str, key: str, neutral: float) -> float:
        return float(effects.get(f"{kind}.{axis}", {}).get(key, neutral))

    inertia = drive["inertia_kgm2"]
    coulomb = get("friction", "coulomb_Nm", 0.0)
    bristle = coulomb / get("friction", "presliding_rad", 1.0)
    elastic = effects.get(f"drive_compliance.{axis}", {})
    stiffness = elastic.get("stiffness_N_per_um", elastic.get("stiffness_Nm_per_urad", np.inf)) * 1e6 / gear(drive) ** 2
    load, spring, damping = 0.0, 0.0, 0.0
    if np.isfinite(stiffness):
        load, spring = load_inertia(axis, drive), stiffness
        damping = 2.0 * elastic["damping_ratio"] * np.sqrt(stiffness * load)
    return (
        drive["position_gain_per_s"] * get("servo_gain", "ratio", 1.0),
        drive["velocity_gain_Nms_per_rad"] * get("velocity_gain", "ratio", 1.0),
        drive["integral_time_s"],
        inertia,
        drive["viscous_Nms_per_rad"] * get("viscous_friction", "ratio", 1.0),
        drive["gravity_Nm"],
        coulomb,
        bristle,
        0.3 * np.sqrt(bristle * inertia),
        get("friction", "static_ratio", 1.0),
        get("friction", "stribeck_velocity_rad_per_s", 1.0),
        get("torque_ripple", "amplitude_Nm", 0.0),
        get("torque_ripple", "order", 1.0),
        get("torque_ripple", "phase_deg", 0.0) * DEG,
        get("velocity_feedforward", "ratio", 0.0),
        load,
        spring,
        damping,
        get("varying_friction", "place_share", 0.0),
        get("varying_friction", "order", 1.0),
        get("varying_friction", "phase_deg", 0.0) * DEG,
        get("varying_friction", "way_share", 0.0),
    )


def delay(axis: str, effects: dict) -> float:
    """How much later this axis' command arrives, s."""
    return effects.get(f"servo_delay.{axis}", {}).get("delay_ms", 0.0) * 1e-3


def run_axis(
    axis: str, drive: dict, effects: dict, command: np.ndarray, substeps: int = SUBSTEPS
) -> tuple[np.ndarray, np.ndarray]:
    """Position behind motor and elastic transmission in axis units, and motor torque in N m, on the command's grid.

    An axis that is never told to move rests where it is, its integrator holding gravity.
    """
    if np.ptp(command) == 0.0:
        return command.copy(), np.full(len(command), float(drive["gravity_Nm"]))
    ratio, p = gear(drive), parameters(axis, drive, effects)
    if p[6] > 0.0:
        # the bristle's rate |ω| σ0 / Tc grows with speed: the explicit steps have to stay well inside their limit of
        # 2.8 per rate
        fastest = np.abs(np.diff(command)).max() / GRID * ratio
        least = p[6] * (1.0 - abs(p[18])) * (1.0 - abs(p[21]))
        substeps = max(substeps, int(np.ceil(GRID * fastest * p[7] / least / 1.2)))
    motor, load, torque = _moved(np.ascontiguousarray(command * ratio).tobytes(), substeps, p)
    return (load if p[15] > 0.0 else motor) / ratio, torque.copy()


@lru_cache(maxsize=80)  # an effect changes one axis; the others move as before
def _moved(command: bytes, substeps: int, p: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Motor and load angle and torque for the bytes of a command in motor units."""
    r = np.frombuffer(command).copy()
    motor, load, torque = (np.empty(len(r)) for _ in range(3))
    _integrate(r, substeps, p, motor, load, torque)
    return motor, load, torque


def run(drives: dict, effects: dict, program, time: np.ndarray, axes: str = AXES) -> tuple[np.ndarray, np.ndarray]:
    """All axes on the grid ``time``: positions (n, axes) in m and rad, motor torques (n, axes) in N m."""
    commands = program.commands(time)
    position, torque = np.empty_like(commands), np.empty_like(commands)
    for i, axis in enumerate(axes):
        late = delay(axis, effects)
        command = program.commands(time - late)[:, i] if late and np.ptp(commands[:, i]) else commands[:, i]
        position[:, i], torque[:, i] = run_axis(axis, drives[axis], effects, command)
    return position, torque
