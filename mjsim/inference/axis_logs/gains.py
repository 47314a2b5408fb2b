"""Gains of a controller read back from what it recorded of itself, without any mechanics: whatever the machine does.

From its output: command, actual position and torque of the same samples. The control law is computed on what was
recorded. How many samples the control takes for a velocity follows as well.

A current, or a share of a rated value, is a torque times a number that is not known, of either sign. This number takes
the place of the velocity gain, and what is left of the law is read in the same way.

From its velocity set-point, which is the position gain times the following error, and the feedforward:

    v = Kpp (r − y) + ratio · dr/dt + zero
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.inference.axis_logs.data import AxisData
from mjsim.instruments.axis_log.signals import limit_of
from mjsim.machine.model import TOLERANCE, Drive, Machine, build
from mjsim.machine.plant import AxisPlant
from mjsim.simulation.servo import sampling
from mjsim.simulation.servo_filters import filters, position_part, samples_of_set_point

#: Samples over which a control may take the velocity.
_VELOCITY_SAMPLES = (1, 2, 3, 4)
#: Samples by which a recorded output may be later than the positions that it follows from.
_DELAYS = (0, 1, 2, 3, 4)
#: Share of the output that the law must explain for its gains to be believed, the share above which no delay is looked
#: for, and the least deviation of a gain (assumed).
_EXPLAINED, _EXACT, _LEAST = 0.97, 0.9999, 0.0005
#: Standard deviations beyond which a reading contradicts the data sheet.
CONTRADICTED = 5.0
#: Share of a limit below which an output follows from the law.
_BELOW = 0.98
#: Factor on what is not explained within which two sets of gains do as well (assumed).
_AS_WELL = 2.0


@dataclass(frozen=True)
class GainsRead:
    """What the recorded output of one controller says.

    Attributes:
        controller: Its name; ``None``: the drive's own.
        values: Gains by the name of the attribute, SI.
        deviations: Their relative standard deviations.
        velocity_samples: Over which the control takes the velocity.
        explained: Share of the output's variance that the law with these gains explains.
        channel: Name of what was recorded.
        feedforward: Share of the commanded speed in a velocity set-point, and its standard deviation; ``None`` where
            none was recorded.
    """

    controller: str | None
    values: dict[str, float]
    deviations: dict[str, float]
    velocity_samples: int
    explained: float
    channel: str = "torque"
    feedforward: tuple[float, float] | None = None


def output_of(axis: AxisPlant, d: AxisData) -> np.ndarray:
    """Torque that a controller would give for what was recorded, (n,) N·m, without limit, delay and start value."""
    return _output(axis, d.step, d.record.command, d.record.actual)


def torque_against(axis: AxisPlant, d: AxisData, change: np.ndarray) -> np.ndarray:
    """Torque, (n,) N·m, with which a controller works against a change (n,) of the actual position, axis units."""
    return -_output(axis, d.step, np.zeros(len(change)), change - change[0])


def _output(axis: AxisPlant, record_step: float, command: np.ndarray, actual: np.ndarray) -> np.ndarray:
    from scipy.signal import lfilter  # slow to load

    step = sampling(axis, record_step)
    R, S, T = filters(axis, step)
    r, y = (np.asarray(q) * axis.gear for q in (command, actual))
    r0, y0 = r[0], y[0]
    wanted = np.asarray(lfilter(T, R, r - r0))
    x = wanted - np.asarray(lfilter(S, R, y - y0))
    every = samples_of_set_point(axis, step)
    if every > 1:
        set_point = wanted - np.asarray(lfilter(position_part(axis, step), R, y - y0))
        x = x + set_point[np.arange(len(x)) // every * every] - set_point
    x = x + (T.sum() * r0 - S.sum() * y0) / R.sum() if abs(R.sum()) > 1e-12 else x
    if axis.control.law is None and np.isfinite(axis.integral_time):
        middle = 0.5 * (x + np.concatenate([x[:1], x[:-1]]))
        x = x + np.cumsum(middle) * step / axis.integral_time
    return axis.velocity_gain * x


def read_gains(machine: Machine, data: Sequence[AxisData]) -> list[GainsRead]:
    """Gains of every controller whose velocity set-point or output was recorded; none where the law does not explain
    them. What a velocity set-point says of a position gain comes first.
    """
    out = []
    for controller in dict.fromkeys(d.test.controller for d in data):
        mine = [d for d in data if d.test.controller == controller]
        if (of_velocity := _of_velocity(machine, controller, mine)) is not None:
            out.append(of_velocity)
        drive = machine.under(controller).drives[data[0].axis]
        mine = [d for d in mine if d.record.output is not None and _same_rate(machine, d)]
        known = [d for d in mine if d.record.motor_torque(drive.gear) is not None]
        mine = known or mine  # a torque says more than a current
        mine = mine if drive.encoder == "motor" else []  # two encoders go into its output
        best = None
        for delay in _DELAYS if mine else ():
            read = [g for n in _samples(drive) if (g := _read(machine, controller, mine, n, delay)) is not None]
            best = min(read if best is None else [best, *read], key=lambda g: _unexplained(g, drive), default=None)
            if best is not None and best.explained > _EXACT:
                break
        if best is not None and best.explained > _EXPLAINED and (known or _agrees(machine, drive, best)):
            out.append(best)
    return out


def _unexplained(g: GainsRead, drive: Drive) -> float:
    """Share of the output that gains leave. A stated number of samples is believed where another one does no better."""
    left = 1.0 - g.explained
    return left / _AS_WELL if g.velocity_samples == drive.control.velocity_samples else left


def _agrees(machine: Machine, drive: Drive, g: GainsRead) -> bool:
    """Whether gains that were read agree with the data sheet as well as both are known.

    An output of unknown unit follows from many laws; of one that the sheet contradicts, nothing is believed.
    """
    for name, value in g.values.items():
        wide = TOLERANCE[name] if machine.factor is None else 0.5 * np.log(machine.factor)
        if abs(np.log(value / getattr(drive, name))) > CONTRADICTED * np.hypot(wide, g.deviations[name]):
            return False
    return True


def _of_velocity(machine: Machine, controller: str | None, data: Sequence[AxisData]) -> GainsRead | None:
    """The position gain and the feedforward by which a velocity set-point follows from the following error and the
    commanded speed; nothing where it does not. A set-point from before the position controller has no gain in it.
    """
    data = [d for d in data if d.record.velocity_command is not None]
    drive = machine.under(controller).drives[data[0].axis] if data else None
    control, at = (drive.control, drive.encoder) if drive is not None else (None, "")
    if control is None or control.law is not None:
        return None
    best = None
    for delay in _DELAYS:
        columns, wanted = [], []
        for d in data:
            v = d.record.velocity_command
            assert v is not None
            held = d.record.load if at == "both" and d.record.load is not None else d.record.actual
            error, rate = d.record.command - held, np.gradient(d.record.command, d.time)
            limit = limit_of(v, error, d.resolution)
            free = np.abs(v[delay:]) < (_BELOW * limit if limit else np.inf)
            columns.append(np.column_stack([error, rate, np.ones(len(v))])[: len(v) - delay][free])
            wanted.append(v[delay:][free])
        design, v = np.vstack(columns), np.concatenate(wanted)
        if not design[:, 0].any():
            return None
        size = np.maximum(np.sqrt(np.mean(design**2, axis=0)), 1e-30)
        fit = np.linalg.lstsq(design / size, v, rcond=1e-6)[0] / size
        left = float(np.mean((v - design @ fit) ** 2))
        explained = 1.0 - left / max(float(v.var()), 1e-30)
        if best is None or explained > best[0]:
            information = np.linalg.pinv(design.T @ design)
            spread = np.sqrt(np.diag(information) * left * 10.0)  # as few values are independent
            best = explained, fit, spread
    assert best is not None
    explained, (gain, share, _), spread = best
    if explained < _EXPLAINED:
        return None
    values, deviations = {}, {}
    if gain > spread[0]:
        values, deviations = {"position_gain": float(gain)}, {"position_gain": max(float(spread[0] / gain), _LEAST)}
    feedforward = float(share), max(float(spread[1]), _LEAST)
    samples = control.velocity_samples
    return GainsRead(controller, values, deviations, samples, explained, "velocity_command", feedforward)


def unused(machine: Machine, data: Sequence[AxisData], gains: Sequence[GainsRead]) -> dict[tuple[str, str], str]:
    """Why a recorded output or velocity set-point says nothing about the gains, by log and channel."""
    out = {}
    of_output = {g.controller for g in gains if g.channel != "velocity_command"}
    of_velocity = {g.controller for g in gains if g.channel == "velocity_command"}
    for d in data:
        drive = machine.under(d.test.controller).drives[d.axis]
        if d.record.output is not None and d.test.controller not in of_output:
            why = "the control law of the machine file does not give it"
            if not _same_rate(machine, d):
                why = "it was not recorded once at every sample of the control (sample_time_s)"
            if drive.encoder != "motor":
                why = "the encoder at the load and that of the motor both go into it"
            if drive.control.law is not None and d.record.motor_torque(drive.gear) is None:
                why = "a law without a torque in N m has no gain that would follow from it"
            out[d.name, d.record.output[0]] = why
        for name in list(d.record.outputs)[1:]:
            out[d.name, name] = f"the {next(iter(d.record.outputs)).replace('_share', ' in %')} says the same"
        if d.record.velocity_command is not None and d.test.controller not in of_velocity:
            out[d.name, "velocity_command"] = "it is not the following error times a gain, and a feedforward"
    return out


def _samples(drive: Drive) -> tuple[int, ...]:
    """Over how many samples the velocity may be taken; as stated where the law or a lag says it."""
    plain = drive.control.law is None and drive.control.torque_lag == 0.0
    return _VELOCITY_SAMPLES if plain else (drive.control.velocity_samples,)


def _same_rate(machine: Machine, d: AxisData) -> bool:
    """Whether every output of the control was recorded, once."""
    axis = build(machine.under(d.test.controller)).axes[d.axis]
    return abs(sampling(axis, d.step) - d.step) < 1e-3 * d.step


def _read(
    machine: Machine, controller: str | None, data: Sequence[AxisData], samples: int, delay: int = 0
) -> GainsRead | None:
    """Gains that give the recorded outputs, where velocities are taken over ``samples`` and outputs ``delay`` late."""
    from scipy.optimize import least_squares  # slow to load

    axis = build(machine.under(controller)).axes[data[0].axis]
    axis.control = replace(axis.control, velocity_samples=samples)
    torques = [d.record.motor_torque(axis.gear) for d in data]
    is_torque = all(u is not None for u in torques)
    if axis.control.law and not is_torque:
        return None
    names = ["velocity_gain"] if axis.control.law else ["velocity_gain", "position_gain"]
    if np.isfinite(axis.integral_time) and axis.control.law is None:
        names.append("integral_time")
    recorded = [u for u in torques if u is not None] if is_torque else _as_torques(axis, data)
    if not recorded:
        return None
    limit = _BELOW * min(axis.control.clip, max(np.abs(u).max() for u in recorded) * 2.0, *_limits(data, recorded))

    def residual(x: np.ndarray) -> np.ndarray:
        moved = replace(axis, **{n: getattr(axis, n) * np.exp(v) for n, v in zip(names, x, strict=True)})
        parts = []
        for d, u in zip(data, recorded, strict=True):
            out = output_of(moved, d)
            rest = u - np.concatenate([np.full(delay, out[0]), out[: len(out) - delay]])
            free = np.abs(u) < limit
            if "integral_time" in names:  # where the integrator stood at the start is not known
                rest = rest - rest[free].mean()
            parts.append(np.where(free, rest, 0.0))
        return np.concatenate(parts)

    found = least_squares(residual, np.zeros(len(names)), bounds=(-3.0, 3.0))
    if "integral_time" in names:
        found = _nearer(axis, names, found, residual)
    size = np.concatenate([u for u in recorded])
    explained = 1.0 - float(np.mean(found.fun**2) / max(size.var(), 1e-30))
    try:
        covariance = np.linalg.inv(found.jac.T @ found.jac) * np.mean(found.fun**2) * 10.0
    except np.linalg.LinAlgError:
        return None
    # what the law leaves may follow from noise in the positions, which makes gains too small: by as much at most
    deviation = np.maximum(np.sqrt(np.diag(covariance)) + np.sqrt(max(1.0 - explained, 0.0)), _LEAST)
    values = {n: float(getattr(axis, n) * np.exp(v)) for n, v in zip(names, found.x, strict=True)}
    deviations = dict(zip(names, map(float, deviation), strict=True))
    if not is_torque:
        del values["velocity_gain"], deviations["velocity_gain"]
    output = data[0].record.output
    assert output is not None
    return GainsRead(controller, values, deviations, samples, explained, output[0])


def _limits(data: Sequence[AxisData], outputs: Sequence[np.ndarray]) -> list[float]:
    """Sizes at which recorded outputs stand while the following error goes on changing."""
    found = [limit_of(u, d.record.command - d.record.actual, d.resolution) for d, u in zip(data, outputs, strict=True)]
    return [f for f in found if f]


def torque_limit(machine: Machine, data: Sequence[AxisData]) -> float:
    """Torque, N·m, at which the motor of an axis stands in some recording; 0 where none shows one."""
    gear = machine.drives[data[0].axis].gear
    with_torque = [(d, u) for d in data if (u := d.record.motor_torque(gear)) is not None]
    return min(_limits([d for d, _ in with_torque], [u for _, u in with_torque]), default=0.0)


def speed_limit(machine: Machine, data: Sequence[AxisData]) -> float:
    """Speed of the motor, rad/s, at which a recorded velocity set-point stands in some recording; 0 where none does."""
    there = [(d, v) for d in data if (v := d.record.velocity_command) is not None]
    found = _limits([d for d, _ in there], [v for _, v in there])
    return min(found, default=0.0) * machine.drives[data[0].axis].gear


def _as_torques(axis: AxisPlant, data: Sequence[AxisData]) -> list[np.ndarray]:
    """Recorded outputs of unknown unit and sign as torques, N·m: as large as the law of the data sheet gives them."""
    outputs = [d.record.output for d in data]
    if len({o[0] for o in outputs if o is not None}) != 1:
        return []  # two channels, two numbers
    values = [o[1] for o in outputs if o is not None]
    wanted = np.concatenate([x - x.mean() for x in (output_of(axis, d) for d in data)])
    given = np.concatenate([x - x.mean() for x in values])
    factor = float(wanted @ given) / max(float(given @ given), 1e-30)
    return [factor * x for x in values] if factor else []


def _nearer(axis: AxisPlant, names: list[str], found, residual: Callable[[np.ndarray], np.ndarray]):
    """Of two solutions that do as well, the one that is nearer to the data sheet.

    With full velocity feedforward, the position gain and one over the integral time are two zeros of one law: they may
    change places.
    """
    from scipy.optimize import least_squares  # slow to load

    i, j = names.index("position_gain"), names.index("integral_time")
    product = axis.position_gain * axis.integral_time
    start = found.x.copy()
    start[i], start[j] = -found.x[j] - np.log(product), -found.x[i] - np.log(product)
    other = least_squares(residual, np.clip(start, -2.9, 2.9), bounds=(-3.0, 3.0))
    if other.cost > _AS_WELL * found.cost and found.cost > 0.0:
        return found
    wide = np.array([TOLERANCE[n] for n in names])
    return min((found, other), key=lambda f: float(np.sum((f.x / wide) ** 2)))
