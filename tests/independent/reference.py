"""One axis from its command to its load side by a high-order adaptive integration: the drive's equations written out,
nothing shared.

    ω_ref = Kpp (r − θ) + ratio dr/dt                τ = Kvp [ (ω_ref − ω) + 1/Ti ∫(ω_ref − ω) dt ]
    J dω/dt = τ − C ω − τ_friction − τ_gravity − a sin(n θ + φ)
    dz/dt = ω − |ω| σ0 z / g(ω),   τ_friction = σ0 z + σ1 dz/dt,   g(ω) = Tc [1 + (s − 1) exp(−(ω/ω_s)²)]

A machine is a dict as read from machine.toml. Commands are moves with continuous acceleration, with rests between. SI
units.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from .drives import gear
from .kinematics import DEG, MICRO


class Moves:
    """Commanded position of one axis: (begin s, duration s, way) one after the other; x(t) = way (u − sin 2πu / 2π)
    in each.
    """

    def __init__(self, first: float, *moves: tuple[float, float, float]) -> None:
        self.first, self.moves = first, moves
        self.edges = sorted({round(t, 9) for begin, last, _ in moves for t in (begin, begin + last)})

    def position(self, t):
        u = [np.clip((np.asarray(t, float) - begin) / last, 0.0, 1.0) for begin, last, _ in self.moves]
        ways = (way * (x - np.sin(2 * np.pi * x) / (2 * np.pi)) for x, (_, _, way) in zip(u, self.moves, strict=True))
        return self.first + sum(ways)

    def rate(self, t: float) -> float:
        for begin, last, way in self.moves:
            if begin < t < begin + last:
                return way / last * (1.0 - np.cos(2 * np.pi * (t - begin) / last))
        return 0.0


def motor(
    drive: dict, effects: dict, moves: Moves, times: np.ndarray, rtol: float = 1e-10
) -> tuple[np.ndarray, np.ndarray]:
    """Motor side in axis units (n,) at ``times``, and the instants (m,) and positions at which it turns round, (m,
    2).
    """
    get = lambda kind, key, neutral: float(effects.get(kind, {}).get(key, neutral))  # noqa: E731
    n, late = gear(drive), get("servo_delay", "delay_ms", 0.0) * 1e-3
    kpp = drive["position_gain_per_s"] * get("servo_gain", "ratio", 1.0)
    kvp = drive["velocity_gain_Nms_per_rad"] * get("velocity_gain", "ratio", 1.0)
    ti, inertia, gravity = drive["integral_time_s"], drive["inertia_kgm2"], drive["gravity_Nm"]
    viscous = drive["viscous_Nms_per_rad"] * get("viscous_friction", "ratio", 1.0)
    ratio = get("velocity_feedforward", "ratio", 0.0)
    tc, presliding = get("friction", "coulomb_Nm", 0.0), get("friction", "presliding_rad", 1.0)
    static, slow = get("friction", "static_ratio", 1.0), get("friction", "stribeck_velocity_rad_per_s", 1.0)
    s0 = tc / presliding
    s1 = 0.3 * np.sqrt(s0 * inertia)
    a, order, phase = (
        get("torque_ripple", "amplitude_Nm", 0.0),
        get("torque_ripple", "order", 1.0),
        get("torque_ripple", "phase_deg", 0.0),
    )

    def rates(t, y):
        th, om, it, z = y
        lag = kpp * n * (moves.position(t - late) - th / n) + ratio * n * moves.rate(t - late) - om
        g = tc * (1.0 + (static - 1.0) * np.exp(-((om / slow) ** 2)))
        dz = om - abs(om) * s0 * z / g if tc else 0.0
        net = kvp * (lag + it / ti) - viscous * om - gravity - a * np.sin(order * th + phase * DEG) - s0 * z - s1 * dz
        return om, net / inertia, lag, dz

    def turning(t, y):
        return y[1]

    y = np.array([n * moves.first, 0.0, gravity * ti / kvp, 0.0])
    out, turns, begin = [], [], times[0]
    edges = [t + late for t in moves.edges if times[0] < t + late < times[-1]]
    for end in [*edges, times[-1]]:  # a step never reaches over a place where the command is less smooth
        mine = times[(times >= begin) & (times < end)] if end < times[-1] else times[times >= begin]
        got = solve_ivp(rates, (begin, end), y, "LSODA", t_eval=np.append(mine, end) if end < times[-1] else mine,
                        events=turning, rtol=rtol, atol=1e-13, max_step=5e-3)  # fmt: skip
        assert got.success
        y, begin = got.y[:, -1], end
        out.append(got.y[0, : len(mine)])
        turns += [(t, state[0]) for t, state in zip(got.t_events[0], got.y_events[0], strict=True)]
    return np.concatenate(out) / n, np.array(turns).reshape(-1, 2) / [1.0, n]


def load(
    axis: str, effects: dict, drive: dict, times: np.ndarray, position: np.ndarray, turns: np.ndarray
) -> np.ndarray:
    """Load side (n,) of a motor side (n,): pitch error, backlash, scale error, gravity wind-up, in the catalogue's
    order.

    The play sees the turning points between the instants as well.
    """
    when = np.concatenate([times, turns[:, 0]])
    order = np.argsort(when, kind="stable")
    x = np.concatenate([position, turns[:, 1]])[order]
    if e := effects.get("pitch_error"):
        wave, size = (1.0, DEG) if axis in "AC" else (gear(drive), MICRO)
        x = x + size * sum(w * np.sin(k * wave * x + phase * DEG) for k, w, phase in e["components"])
    if e := effects.get("backlash"):
        half = (e["width_deg"] * DEG if axis in "AC" else e["width_um"] * MICRO) / 2.0
        y, last = np.empty_like(x), x[0]
        for i, v in enumerate(x):
            last = y[i] = min(max(last, v - half), v + half)
        x = y
    x = x * (1.0 + effects.get("scale_error", {}).get("ppm", 0.0) * 1e-6)
    if e := effects.get("gravity_windup"):
        x = x + e["amplitude_deg"] * DEG * np.sin(x + e["phase_deg"] * DEG)
    out = np.empty_like(x)
    out[order] = x
    return out[: len(times)]
