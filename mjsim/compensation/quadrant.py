"""Friction (quadrant) compensation: a pulse of the speed set-point at every reversal of an axis, tuned on the model.

A control that has it adds ``speed · exp(−t/time)`` to the set-point of the velocity loop when an axis reverses. What
this does is what the same pulse through the position gain would do, so it is simulated as a change of the command.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import AxisPlant
from mjsim.simulation.axes import motor_of, time_grid
from mjsim.simulation.drive import STEP

#: Times of the pulse that are tried, s.
_TIMES = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
#: Passes of the amplitude: friction makes the answer a little nonlinear.
_PASSES = 3
#: A pulse is worth typing if it takes this share of what friction does to the axis (mean square).
WORTH = 0.2
_STILL = 1e-13


@dataclass(frozen=True)
class Pulse:
    """One axis' friction compensation.

    Attributes:
        speed: Amplitude, m/s or rad/s.
        time: Of its decay, s.
        gain: Position gain of the axis, 1/s.
        feedforward: Ratio of its velocity feedforward.
        removes: Share of the mean square of what friction does to the axis in the tests that it takes away.
    """

    speed: float
    time: float
    gain: float
    feedforward: float = 0.0
    removes: float = 0.0

    def offset(self, command: np.ndarray, step: float) -> np.ndarray:
        """What added to the command (n,) has the same effect, (n,) m or rad; ``step`` s between the samples."""
        from scipy.signal import lfilter  # slow to load

        follow = 1.0 - np.exp(-self.gain * step)
        wanted = command + self.feedforward / self.gain * np.gradient(command, step)
        lagged = lfilter([follow], [1.0, follow - 1.0], wanted, zi=[(1.0 - follow) * wanted[0]])[0]
        kick = _reversals(lagged) * self.speed
        slow = np.asarray(lfilter([1.0], [1.0, -np.exp(-step / self.time)], kick))
        if self.feedforward < 1e-6:
            return slow / self.gain
        fast = np.asarray(lfilter([1.0], [1.0, -np.exp(-step * self.gain / self.feedforward)], kick))
        return (slow - fast) / (self.gain - self.feedforward / self.time)


def _reversals(position: np.ndarray) -> np.ndarray:
    """±1 at the instants at which a position (n,) turns, the sign of the new direction; 0 elsewhere, (n,)."""
    step = np.diff(position, prepend=position[0])
    sign = np.sign(np.where(np.abs(step) > _STILL, step, 0.0))
    moving = np.flatnonzero(sign)
    out = np.zeros(len(position))
    turned = moving[1:][sign[moving[1:]] != sign[moving[:-1]]]
    out[turned] = sign[turned]
    return out


def tuned(machine: Machine, axis: str, tests: Sequence[BallBarTest], speed_digit: float = 0.0) -> Pulse | None:
    """The pulse that takes most of what an axis' friction does in the tests; ``None`` where none is worth typing.

    Args:
        machine: As diagnosed.
        axis: Letter of an axis with friction.
        tests: What was measured.
        speed_digit: Multiple of which the amplitude is, m/s or rad/s.
    """
    with_friction = build(machine).axes[axis]
    free = build(machine.without(f"friction.{axis}")).axes[axis]
    runs = [run for t in tests if (run := _run(t, axis, with_friction, free)) is not None]
    if not runs:
        return None
    best: Pulse | None = None
    for time in _TIMES:
        pulse = _amplitude(with_friction, runs, time, speed_digit)
        if pulse is not None and (best is None or pulse.removes > best.removes):
            best = pulse
    return best if best is not None and best.removes >= WORTH else None


@dataclass(frozen=True)
class _Run:
    """One test of one axis: time, command, motor with friction and without, measured part."""

    time: np.ndarray
    command: np.ndarray
    now: np.ndarray
    wanted: np.ndarray
    span: slice


def _run(test: BallBarTest, axis: str, with_friction: AxisPlant, free: AxisPlant) -> _Run | None:
    program = Program(test)
    time = time_grid(program)
    command = program.commands(time)[:, test.chain.index(axis)]
    low, high = program.measured_span
    span = slice(int(np.ceil(low / STEP)), int(high / STEP) + 1)
    if not _reversals(command[span]).any():
        return None
    now, wanted = (motor_of(d, time, command) for d in (with_friction, free))
    return _Run(time, command, now, wanted, span)


def _amplitude(drive: AxisPlant, runs: list[_Run], time: float, digit: float) -> Pulse | None:
    """The best amplitude for one decay time; ``None`` where a pulse does harm."""
    missing = np.concatenate([(r.wanted - r.now)[r.span] for r in runs])
    speed = drive.position_gain * float(np.abs(missing).max())
    pulse = Pulse(speed, time, drive.position_gain, drive.feedforward)
    left = missing
    for _ in range(_PASSES):
        made = np.concatenate(
            [(motor_of(drive, r.time, r.command + pulse.offset(r.command, STEP)) - r.now)[r.span] for r in runs]
        )
        left = missing - made
        speed *= float(missing @ made) / max(float(made @ made), 1e-30)
        if digit:
            speed = round(speed / digit) * digit
        if speed <= 0.0:
            return None
        if abs(speed / pulse.speed - 1.0) < 0.02:
            break
        pulse = Pulse(speed, time, drive.position_gain, drive.feedforward)
    removed = 1.0 - float(left @ left) / max(float(missing @ missing), 1e-30)
    return Pulse(pulse.speed, time, pulse.gain, pulse.feedforward, removed)
