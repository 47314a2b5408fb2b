"""Axis logs of one axis under a digital P-PI control, without any code of mjsim: the midpoint rule at 2 µs.

x = Kpp (r − y) + ratio·Δr/h − Δy/h,   u = Kvp [x + (1/Ti) Σ ½(x + x₋₁) h]      every sample h, held
J dω/dt = u − C (ω + share |ω|) − c − a sin(n θ + φ) − F,     F = σ0 z + σ1 dz/dt,  dz/dt = ω − |ω| σ0 z / g
With the position loop closed on the load behind a play w, yl = clip(yl, y − w/2, y + w/2) stands in Kpp (r − yl).
The velocity set-point Kpp (r − y) + ratio·Δr/h may be limited, and u by a motor's voltage: it stays within the line
from ``stall`` at rest to zero at ``no_load`` in the direction of the motion.
The encoder gives y = θ + misread·sin(order θ + phase), to the control and to the log.
g grows by loss·|u|, and times 1 + excess·s after a rest:  ds/dt = (1 − s)/rest − s |ω|/way,  s = 1 at the start
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit


@dataclass(frozen=True)
class Axis:
    """One axis; motor side, SI."""

    lead: float = 0.010
    inertia: float = 4.5e-4
    viscous: float = 0.008
    coulomb: float = 0.0
    presliding: float = 0.004
    static_ratio: float = 1.0
    stribeck: float = 5.0
    constant: float = 0.0
    ripple: float = 0.0
    ripple_phase: float = 0.0
    ripple_order: float = 1.0
    viscous_share: float = 0.0
    excess: float = 0.0
    way: float = 1.0
    rest: float = 1.0
    loss: float = 0.0
    play: float = 0.0
    misread: float = 0.0  # of the motor's encoder, rad of the motor
    misread_order: float = 1.0
    misread_phase: float = 0.0


@dataclass(frozen=True)
class Control:
    """One controller."""

    position_gain: float = 45.0
    velocity_gain: float = 0.06
    integral_time: float = np.inf
    feedforward: float = 0.0
    sample: float = 1e-3
    delay_samples: int = 0
    on_load: bool = False
    clip: float = np.inf
    fastest: float = np.inf
    stall: float = np.inf
    no_load: float = np.inf
    every: int = 1  # samples for which a velocity set-point is held


@njit(cache=True)
def _run(r, h, steps, axis, control, th, u_start, error, resolution, position, torque, load):
    (
        j,
        c,
        tc,
        pre,
        static,
        stribeck,
        constant,
        ripple,
        phase,
        order,
        even,
        excess,
        way,
        rest,
        loss,
        play,
        misread,
        cycles,
        at,
    ) = axis
    kpp, kvp, of_ti, ff, delay, on_load, clip, fastest, stall, no_load, every = control
    s0 = tc / pre if tc > 0.0 else 0.0
    dt = h / steps
    om, z, integral, last_x, wanted = 0.0, 0.0, 0.0, 0.0, 0.0
    if tc > 0.0:
        most = pre * (1.0 + excess)
        z = min(max((u_start - constant - ripple * np.sin(order * th + phase)) / s0, -most), most)
    held = np.full(64, u_start)
    y1, r1, rested, behind = th, r[0], 1.0, th
    for k in range(len(r)):
        wrong = misread * np.sin(cycles * th + at)
        y = np.round((th + wrong + error[k]) / resolution) * resolution  # the encoder, which the control sees as well
        if k == 0:
            y1 = y
        behind = min(max(behind, th - 0.5 * play), th + 0.5 * play)
        load[k] = np.round((behind + error[len(r) - 1 - k]) / resolution) * resolution
        set_point = kpp * (r[k] - (load[k] if on_load > 0.0 else y)) + ff * (r[k] - r1) / h
        if k % int(every) == 0:
            wanted = min(max(set_point, -fastest), fastest)
        x = wanted - (y - y1) / h
        if k == 0:
            last_x = x
            integral = u_start / kvp - x if of_ti > 0.0 else 0.0
        elif of_ti > 0.0:
            integral += 0.5 * (x + last_x) * h * of_ti
        last_x, y1, r1 = x, y, r[k]
        held[k % 64] = min(max(kvp * (x + integral), -clip), clip)  # the integrator runs on
        if stall < np.inf:
            held[k % 64] = min(max(held[k % 64], -stall * (1.0 + om / no_load)), stall * (1.0 - om / no_load))
        u = held[(k - int(delay)) % 64] if k >= delay else u_start
        position[k], torque[k] = y, u
        for _ in range(steps):
            level = tc * (1.0 + excess * rested) + loss * abs(u)
            a, rate = _rates(om, z, th, u, j, c, level, s0, static, stribeck, constant, ripple, phase, order, even)
            b, mid = _rates(
                om + 0.5 * dt * a,
                z + 0.5 * dt * rate,
                th + 0.5 * dt * om,
                u, j, c, level, s0, static, stribeck, constant, ripple, phase, order, even,
            )  # fmt: skip
            middle = abs(om + 0.5 * dt * a)
            rested += dt * ((1.0 - rested) / rest - rested * middle / way)
            th += dt * (om + 0.5 * dt * a)
            om += dt * b
            z += dt * mid


@njit(cache=True)
def _rates(om, z, th, u, j, c, level, s0, static, stribeck, constant, ripple, phase, order, even):
    """Rates of speed and bristle."""
    f = constant + ripple * np.sin(order * th + phase) + even * c * abs(om)
    rate = 0.0
    if level > 0.0:
        g = level * (1.0 + (static - 1.0) * np.exp(-((om / stribeck) ** 2)))
        rate = om - abs(om) * s0 * z / g
        f += s0 * z + 0.3 * np.sqrt(s0 * j) * rate
    return (u - c * om - f) / j, rate


def record(
    axis: Axis, control: Control, command: np.ndarray, noise: float = 0.05e-6, seed: int = 1, step: float = 1e-7
):
    """Recorded positions (n,) m and torques (n,) N·m of ``command`` (n,) m, one sample of the control apart.

    ``noise`` is of the encoder and ``step`` its resolution, m.
    """
    motor, _, torque = record_both(axis, control, command, noise, seed, step)
    return motor, torque


def record_both(
    axis: Axis, control: Control, command: np.ndarray, noise: float = 0.05e-6, seed: int = 1, step: float = 1e-7
):
    """As :func:`record`, of the motor and of the load behind the play: two positions and the torque."""
    gear = 2.0 * np.pi / axis.lead
    position, torque, load = np.empty(len(command)), np.empty(len(command)), np.empty(len(command))
    mechanics = (
        axis.inertia,
        axis.viscous,
        axis.coulomb,
        axis.presliding,
        axis.static_ratio,
        axis.stribeck,
        axis.constant,
        axis.ripple,
        axis.ripple_phase,
        axis.ripple_order,
        axis.viscous_share,
        axis.excess,
        axis.way,
        axis.rest,
        axis.loss,
        axis.play * gear,
        axis.misread,
        axis.misread_order,
        axis.misread_phase,
    )
    of_ti = 0.0 if np.isinf(control.integral_time) else 1.0 / control.integral_time
    law = (control.position_gain, control.velocity_gain, of_ti, control.feedforward)
    law = (*law, float(control.delay_samples), float(control.on_load), control.clip)
    law = (*law, control.fastest, control.stall, control.no_load, control.every)
    steps = max(1, round(control.sample / 2e-6))
    error = noise * gear * np.random.default_rng(seed).normal(size=len(command))
    start = command[0] * gear
    for _ in range(50):  # it stands where its encoder gives the command
        start = command[0] * gear - axis.misread * np.sin(axis.misread_order * start + axis.misread_phase)
    _run(command * gear, control.sample, steps, mechanics, law, start, 0.0, error, step * gear, position, torque, load)
    return position / gear, load / gear, torque


def to_and_fro(sample: float = 1e-3) -> np.ndarray:
    """A command, (n,) m: slow and fast strokes with stops, and a sine of growing speed."""
    t = np.arange(0.0, 0.6, sample)

    def stroke(way: float, duration: float) -> np.ndarray:
        u = np.clip((t[t < duration + 0.1] - 0.05) / duration, 0.0, 1.0)
        return way * (u - np.sin(2 * np.pi * u) / (2 * np.pi))

    out = [np.zeros(int(0.15 / sample))]
    for way, duration in ((0.02, 0.3), (-0.02, 0.3), (0.03, 0.25), (0.002, 0.2), (-0.002, 0.2), (-0.03, 0.35)):
        out.append(out[-1][-1] + stroke(way, duration))
    s = np.arange(0.0, 1.0, sample)
    out.append(out[-1][-1] + 0.01 * np.sin(2 * np.pi * (s + 0.5 * s**2)) * np.clip(s / 0.1, 0, 1))
    out.append(np.full(int(0.2 / sample), out[-1][-1]))
    return np.concatenate(out)


def short_strokes(sample: float = 1e-3, way: float = 0.02) -> np.ndarray:
    """A short command, (n,) m: two strokes of ``way``, one slow, and a sine that begins and ends slowly."""
    parts = [np.zeros(round(0.05 / sample))]
    for gone, duration in ((way, 0.2), (-way, 0.25), (0.05 * way, 0.15)):
        u = np.arange(0.0, duration + 0.05, sample)[1:] / duration
        u = np.minimum(u, 1.0)
        parts.append(parts[-1][-1] + gone * (u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi)))
    s = np.arange(0.0, 0.4, sample)
    window = np.sin(np.pi * s / 0.4) ** 2
    parts.append(parts[-1][-1] + 0.15 * way * np.sin(2.0 * np.pi * 10.0 * s) * window)
    parts.append(np.full(round(0.05 / sample), parts[-1][-1]))
    return np.concatenate(parts)


def filtered(command: np.ndarray, step: float, kind: str, time: float) -> np.ndarray:
    """A command (n,) behind a first-order lag (``lag_ms``) or a mean (``mean_ms``) of ``time`` s, in hundredths of a
    sample.
    """
    fine = np.interp(np.arange(-0.005, len(command) - 1.0, 0.01), np.arange(len(command)), command)
    h = 0.01 * step
    if kind == "lag_ms":
        out, y = np.empty(len(fine)), fine[0]
        for i, r in enumerate(fine):
            y += (r - y) * (1.0 - np.exp(-h / time))
            out[i] = y
    else:
        n = round(time / h)
        out = np.convolve(np.concatenate([np.full(n - 1, fine[0]), fine]), np.ones(n) / n, "valid")
    return out[::100]


def csv(command: np.ndarray, position: np.ndarray, torque: np.ndarray | None = None, sample: float = 1e-3) -> str:
    """The log of one axis X as campaigns have it."""
    columns = [sample * np.arange(len(command)), 1e3 * command, 1e3 * position]
    names = ["time_s", "X_command_mm", "X_actual_mm"]
    if torque is not None:
        columns.append(torque)
        names.append("X_torque_Nm")
    rows = "\n".join(",".join(f"{v:.7f}" for v in row) for row in zip(*columns, strict=True))
    return f"{','.join(names)}\n{rows}\n"


def machine_toml(axis: Axis, control: Control, identify: bool, friction: float = 0.0, **wrong: float) -> str:
    """A machine file with the axis' numbers, some of them wrong; ``friction`` N·m puts friction into it."""
    integral = "inf" if np.isinf(control.integral_time) else f"{wrong.get('integral_time', control.integral_time)}"
    effect = f'\n[[effect]]\nid = "friction.X"\ncoulomb_Nm = {friction}\npresliding_rad = {axis.presliding}\n'
    return (
        'name = "one axis"\nconfiguration = "X"\n'
        + ("\n[identify]\nfactor = 5.0\n" if identify else "")
        + f"\n[drive.X]\nlead_mm = {1e3 * axis.lead}\ninertia_kgm2 = {wrong.get('inertia', axis.inertia)}\n"
        + f"viscous_Nms_per_rad = {wrong.get('viscous', axis.viscous)}\n\n[controller.c.X]\n"
        + f"position_gain_per_s = {control.position_gain}\n"
        + f"velocity_gain_Nms_per_rad = {wrong.get('velocity_gain', control.velocity_gain)}\n"
        + f"integral_time_s = {integral}\nvelocity_feedforward = {control.feedforward}\n"
        + f"sample_time_s = {control.sample}\n"
        + (effect if friction else "")
    )


CAMPAIGN = """\
name = "one axis"

[instrument]
kind = "axis_log"
sample_rate_Hz = 1000.0
resolution_um = 0.1

[[test]]
name = "strokes"
kind = "log"
trace = "strokes.csv"
axes = ["X"]
controller = "c"
"""


def write_campaign(folder: Path, table: str, machine: str, sample: float = 1e-3, letter: str = "X") -> Path:
    """One recording as a campaign, of any axis: texts of the table and of the machine file are those of X."""
    campaign = CAMPAIGN.replace("1000.0", f"{1.0 / sample}")
    for name, text in (("strokes.csv", table), ("campaign.toml", campaign), ("machine.toml", machine)):
        for was in ("X_", ".X", '"X"'):
            text = text.replace(was, was.replace("X", letter))
        (folder / name).write_text(text)
    return folder
