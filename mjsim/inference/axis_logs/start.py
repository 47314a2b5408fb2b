"""The model from which a search on axis logs starts: the data sheet within its priors, and the nuisances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjsim.inference.axis_logs.data import AxisData, output_row, per_needed_torque
from mjsim.inference.axis_logs.entries import (
    CONTROLLER,
    DRIVE,
    OUTPUT_LATE,
    OUTPUT_ZERO,
    PER_TORQUE,
    PHASE,
    SHIFT,
    START_TORQUE,
    ZERO,
    AxisModel,
    Entry,
    KnownNumbers,
)
from mjsim.inference.axis_logs.gains import GainsRead
from mjsim.machine.model import TOLERANCE, Machine

#: Standard deviation of the encoder's zero against the command's, encoder steps: both count in the same control.
_ZERO = 1.0
#: Standard deviations within which a number of the data sheet stays: what lies beyond is a cause of its own.
_FARTHEST = 5.0
#: Standard deviation of a phase that may be anything, rad.
_ANYWHERE = 10.0
#: Largest time shift, samples; its standard deviation is one sample.
MOST_SHIFT = 5.0
#: Share of the recorded output that must follow from the recorded positions for them to be of the same samples, and the
#: standard deviation of their time shift then, samples (assumed).
_SAME_SAMPLE, _KNOWN_SHIFT = 0.999, 0.001
#: How well a recorded torque is known: its number, relative, and its zero, in its largest value (assumed). Deviation of
#: a number that may be anything, in the one from which it starts.
_CONSTANT, _ZERO_OUTPUT, _UNKNOWN = 0.02, 0.01, 30.0


def start_model(
    machine: Machine, data: Sequence[AxisData], gains: Sequence[GainsRead] = (), known: KnownNumbers | None = None
) -> AxisModel:
    """One axis with its data sheet and the nuisances of its recordings free.

    Args:
        machine: As given.
        data: All recordings of the axis.
        gains: Read back from recorded outputs.
        known: What another instrument knows.
    """
    axis = data[0].axis
    machine = sampled_as_read(machine, axis, gains)
    sheet = {e.label: e for e in sheet_entries(machine, data)}
    known = known or KnownNumbers()
    for e in known.entries:
        own = sheet.get(e.label)
        if own is not None:  # another instrument moves no number farther than a cause of its own
            sheet[e.label] = replace(e, lower=max(e.lower, own.lower), upper=min(e.upper, own.upper))
        elif e.owner != DRIVE:
            sheet[e.label] = e
    read_back = [_read_back(e, gains) for e in sheet.values()]
    together = {g.controller for g in gains if g.values and g.explained > _SAME_SAMPLE}
    nuisances = [_in_step(e, data, together) for e in nuisance_entries(machine, data)]
    return AxisModel(machine, axis, (*read_back, *nuisances), known)


def _in_step(entry: Entry, data: Sequence[AxisData], together: set[str | None]) -> Entry:
    """A time shift that is known: where the recorded output follows from the recorded positions sample by sample."""
    known = entry.owner == SHIFT and any(d.name == entry.where and d.test.controller in together for d in data)
    return replace(entry, deviation=_KNOWN_SHIFT) if known else entry


def sampled_as_read(machine: Machine, axis: str, gains: Sequence[GainsRead]) -> Machine:
    """The machine with the velocities taken over as many samples as the recorded outputs show."""
    controllers = {n: dict(c) for n, c in machine.controllers.items()}
    for g in gains:
        if g.controller is not None:
            controllers[g.controller][axis] = controllers[g.controller][axis].with_control(
                velocity_samples=g.velocity_samples
            )
    return replace(machine, controllers=controllers)


def _read_back(entry: Entry, gains: Sequence[GainsRead]) -> Entry:
    """An entry of the data sheet with what the recorded output says about it.

    A reading that contradicts the data sheet is left out: its cause is looked for, with what was read. A velocity gain
    starts from what was read. How well it is known, the row of the recorded torque says, with that torque's number.
    """
    for g in gains:
        if entry.name in g.values and entry.owner in (DRIVE, CONTROLLER) and entry.where == (g.controller or ""):
            value, deviation = g.values[entry.name], g.deviations[entry.name]
            if entry.lower < value < entry.upper:
                if entry.name == "velocity_gain":
                    return replace(entry, value=value, centre=entry.decode(entry.mean))
                both = deviation**-2 + entry.deviation**-2
                mean = entry.decode((entry.encode(value) / deviation**2 + entry.mean / entry.deviation**2) / both)
                return replace(entry, value=mean, deviation=both**-0.5, centre=mean)
    return entry


def nuisance_model(machine: Machine, data: Sequence[AxisData]) -> AxisModel:
    """The same with the nuisances alone free: the machine is taken as it is.

    Waves over the motor's angle start anywhere: an encoder counts from where it was switched on.
    """
    axis = data[0].axis
    setups = dict.fromkeys(d.test.setup for d in data)
    phases = [
        Entry(PHASE, wave, 0.0, setup, deviation=_ANYWHERE) for wave in waves_of(machine, axis) for setup in setups
    ]
    return AxisModel(machine, axis, (*nuisance_entries(machine, data), *phases))


def waves_of(machine: Machine, axis: str) -> dict[str, float]:
    """Orders of the waves over an axis' motor angle that a machine's effects have, by the names of their phases."""
    out = {}
    for kind in ("torque_ripple", "friction_ripple", "encoder_error"):
        effect = machine.effect(f"{kind}.{axis}")
        if effect is not None:
            out[kind] = float(effect.values["order"])
    cogging = machine.effect(f"cogging.{axis}")
    if cogging is not None:
        out |= {f"cogging {row[0]:g}": float(row[0]) for row in cogging.values["components"]}
    return out


def deviation_of(machine: Machine, name: str) -> float:
    """Prior standard deviation of a number of the data sheet, relative."""
    if machine.factor is not None and name in ("position_gain", "velocity_gain", "inertia", "viscous", "coulomb"):
        return 0.5 * math.log(machine.factor)
    return TOLERANCE[name]


def sheet_entries(machine: Machine, data: Sequence[AxisData]) -> tuple[Entry, ...]:
    """The data sheet of one axis: inertia, viscous friction, gains of the controllers that ran, friction."""
    axis = data[0].axis
    drive = machine.drives[axis]
    out = []
    for name in ("inertia", "viscous"):
        value = getattr(drive, name)
        if value > 0.0:
            out.append(_positive(DRIVE, name, value, deviation_of(machine, name)))
    for controller in dict.fromkeys(d.test.controller for d in data):
        if controller is None:
            for name in ("position_gain", "velocity_gain", "integral_time"):
                out.append(_positive(DRIVE, name, getattr(drive, name), deviation_of(machine, name)))
            continue
        ran = machine.controllers[controller][axis]
        names = ["velocity_gain"] if ran.control.law else ["position_gain", "velocity_gain"]
        if np.isfinite(ran.integral_time) and not ran.control.law:
            names.append("integral_time")
        for name in names:
            out.append(_positive(CONTROLLER, name, getattr(ran, name), deviation_of(machine, name), controller))
    friction = machine.effect(f"friction.{axis}")
    if friction is not None and friction.values["coulomb_Nm"] > 0.0:
        for name, sheet in (("coulomb_Nm", "coulomb"), ("presliding_rad", "presliding")):
            value, wide = friction.values[name], deviation_of(machine, sheet)
            out.append(_positive(friction.id, name, value, max(wide, 1.0) if machine.factor else wide))
    return tuple(out)


def _positive(owner: str, name: str, value: float, deviation: float, where: str = "") -> Entry:
    far = math.exp(_FARTHEST * deviation)
    return Entry(owner, name, value, where, deviation, log=True, lower=value / far, upper=value * far)


def nuisance_entries(machine: Machine, data: Sequence[AxisData]) -> tuple[Entry, ...]:
    """Time shift, encoder zero and, where there is an integrator, the torque at the start, of every recording."""
    out = _output_entries(machine, data)
    late = machine.effect(f"servo_delay.{data[0].axis}")
    for d in data:
        # a recording has the command before its delay, or behind it: nobody knows
        wide = math.hypot(1.0, late.si("delay_ms") / d.step if late is not None else 0.0)
        limit = MOST_SHIFT * wide * d.step
        out.append(Entry(SHIFT, SHIFT, 0.0, d.name, wide, scale=d.step, lower=-limit, upper=limit))
        out.append(Entry(ZERO, ZERO, 0.0, d.name, 1.0, scale=_ZERO * d.resolution))
        drive = machine.under(d.test.controller).drives[d.axis]
        if np.isfinite(drive.integral_time) and drive.control.law is None:
            torque = typical_torque(machine, data)
            out.append(Entry(START_TORQUE, START_TORQUE, 0.0, d.name, 1.0, scale=torque))
    return tuple(out)


def _output_entries(machine: Machine, data: Sequence[AxisData]) -> list[Entry]:
    """Of what was recorded of the motor's torque: its number, one of an axis and channel, and zero and time of each.

    A current, or a share of a rated value, starts from the number that the data sheet's torque has in it.
    """
    rows = [row for d in data if (row := output_row(d)) is not None]
    out, gear = [], machine.drives[data[0].axis].gear
    for channel in dict.fromkeys(r.channel for r in rows):
        mine = [r for r in rows if r.channel == channel]
        number = {"torque": 1.0, "force": gear}.get(channel)
        if number is not None:
            out.append(Entry(PER_TORQUE, PER_TORQUE, number, channel, _CONSTANT, scale=number))
            continue
        number = per_needed_torque(machine, mine) or 1.0
        out.append(Entry(PER_TORQUE, PER_TORQUE, number, channel, _UNKNOWN, scale=abs(number)))
    for r in rows:
        most, size = MOST_SHIFT * r.step, _ZERO_OUTPUT * float(np.abs(r.recorded).max())
        out.append(Entry(OUTPUT_ZERO, OUTPUT_ZERO, 0.0, r.name, 1.0, scale=size))
        out.append(Entry(OUTPUT_LATE, OUTPUT_LATE, 0.0, r.name, 1.0, scale=r.step, lower=-most, upper=most))
    return out


def typical_torque(machine: Machine, data: Sequence[AxisData]) -> float:
    """RMS torque that the drive's data sheet needs for the commanded motion, N·m."""
    drive, squares = machine.drives[data[0].axis], []
    for d in data:
        n = max(1, int(0.01 / d.step))
        smooth = np.convolve(d.record.actual, np.ones(n) / n, "valid")[::n] * drive.gear
        speed = np.gradient(smooth, n * d.step)
        torque = drive.inertia * np.gradient(speed, n * d.step) + drive.viscous * speed
        squares.append(np.mean(torque**2))
    return max(float(np.sqrt(np.mean(squares))), 1e-9)
