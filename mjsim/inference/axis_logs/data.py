"""What an axis log gives a fit: means of blocks of samples, where the axis stood at the start, and the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.instruments.axis_log.measurement import AxisRecord, LogTest
from mjsim.instruments.axis_log.signals import step_of
from mjsim.machine.model import Machine

#: Shortest block, s: no drive moves visibly faster (assumed).
_BLOCK = 1e-3
#: Most blocks of one recording: longer ones get longer blocks.
_MOST = 6000
#: An axis rests where its command and its actual position keep within so many encoder steps for so long, s (assumed).
_REST_STEPS, _REST = 4.0, 0.05
#: Deviations of a speed, from the noise, beyond which an axis moves: noise reaches that in one of 16,000 starts.
_MOVES = 4.0
#: Time constants of the position loop after which it has forgotten a disturbance; position gain of a loop whose law
#: does not state one, 1/s (assumed).
_FORGOTTEN, _USUAL_GAIN = 3.0, 50.0
#: Shares of a command's period over which it must repeat within an encoder step.
_REPEATED = 0.98
#: Shifts by which a command hardly changes that are tried as its period.
_MINIMA = 10
#: Residuals beyond this belong to a model that has run away: m or rad, and in the largest of a recorded torque.
_LOST, _LOST_TORQUE = 0.1, 1e3
#: Step of a recorded torque or current at least, in its largest value (assumed: ten bits).
_TEN_BITS = 1e-3


@dataclass(frozen=True)
class LogNoise:
    """Noise of one sample.

    Attributes:
        rms: m or rad.
        source: Where it comes from.
    """

    rms: float
    source: str


@dataclass(frozen=True)
class AxisData:
    """One channel of one axis in one recording: a row of its fit.

    Attributes:
        test: The log.
        axis: Letter of the axis.
        time: (n,) s.
        record: What was recorded.
        block: Samples that are averaged.
        start: Position, axis units, and velocity, axis units per s, at the first sample.
        noise: Of one sample.
        resolution: Encoder step, axis units.
        memory: Time after which the control loop has forgotten a disturbance, s: what is left for longer is no noise.
        channel: Which one; beside the actual position one that is the motor's torque times a number, in its own unit.
    """

    test: LogTest
    axis: str
    time: np.ndarray
    record: AxisRecord
    block: int
    start: tuple[float, float]
    noise: LogNoise
    resolution: float
    memory: float
    channel: str = "actual"

    @property
    def recorded(self) -> np.ndarray:
        """Samples of the channel, (n,)."""
        return self.record.channels[self.channel]

    @property
    def is_position(self) -> bool:
        """Whether it is the actual position."""
        return self.channel == "actual"

    @property
    def lost(self) -> float:
        """A residual beyond this belongs to a model that has run away."""
        return _LOST if self.is_position else _LOST_TORQUE * float(np.abs(self.recorded).max())

    @property
    def name(self) -> str:
        """Of the test."""
        return self.test.name

    @property
    def step(self) -> float:
        """Usual time between two samples, s."""
        return float(np.median(np.diff(self.time[:1000])))

    @property
    def blocks(self) -> int:
        """Number of whole blocks."""
        return len(self.time) // self.block

    def means(self, values: np.ndarray) -> np.ndarray:
        """Means of the blocks, (blocks,), of one value a sample (n,)."""
        return values[: self.blocks * self.block].reshape(self.blocks, self.block).mean(axis=1)


def axis_data(logs: Campaign, axis: str, machine: Machine, block: float = _BLOCK) -> tuple[AxisData, ...]:
    """All recordings of one axis in the axis logs of a campaign, each with the controller that ran: the only one of the
    axis where a log names none.
    """
    names = [name for name, axes in machine.controllers.items() if axis in axes]
    only = names[0] if len(names) == 1 else None
    out = []
    for test in logs.measured:
        if axis not in test.axes:
            continue
        recording, test = logs.traces[test.name], replace(test, controller=test.controller or only)
        record = _with_torque(recording.axes[axis], machine.drives[axis].torque_constant)
        n, step = len(recording.time), recording.step
        size = max(1, round(block / step), -(-n // _MOST))
        resolution = logs.instrument.step_of(test.chain, axis)
        noise = noise_of(recording.time, record, resolution)
        drive = machine.under(test.controller).drives[axis]
        memory = _FORGOTTEN / (drive.position_gain if drive.control.law is None else _USUAL_GAIN)
        start = _start(recording.time, record, resolution, noise.rms)
        out.append(AxisData(test, axis, recording.time, record, size, start, noise, resolution, memory))
    return tuple(out) if not _counts_against(machine, out) else tuple(_turned(d) for d in out)


def _counts_against(machine: Machine, data: Sequence[AxisData]) -> bool:
    """Whether the recorded torque or force of an axis has the sign against the direction of its position."""
    rows = [r for d in data if (r := output_row(d)) is not None and r.channel in ("torque", "force")]
    return bool(rows) and per_needed_torque(machine, rows) < 0.0


def _turned(d: AxisData) -> AxisData:
    """A recording with its torque and force turned."""
    force, torque = (None if x is None else -x for x in (d.record.force, d.record.torque))
    return replace(d, record=replace(d.record, force=force, torque=torque))


def per_needed_torque(machine: Machine, rows: Sequence[AxisData]) -> float:
    """What was recorded of the motor's torque, per torque that the recorded motion needs by the data sheet.

    Means of 10 ms are compared, without the mean of each recording: a load that acts all the time has any sign.
    """
    above, below = 0.0, 0.0
    for r in rows:
        drive, n = machine.drives[r.axis], max(1, int(0.01 / r.step))
        angle, recorded = (np.convolve(x, np.ones(n) / n, "valid")[::n] for x in (r.record.actual, r.recorded))
        if len(angle) < 3:
            continue
        speed = np.gradient(angle * drive.gear, n * r.step)
        needed = drive.inertia * np.gradient(speed, n * r.step) + drive.viscous * speed
        needed += coulomb_friction(machine, r.axis) * np.sign(speed)
        needed -= needed.mean()
        above, below = above + float(needed @ (recorded - recorded.mean())), below + float(needed @ needed)
    return above / max(below, 1e-30)


def coulomb_friction(machine: Machine, axis: str) -> float:
    """Coulomb friction of an axis as its machine file says, N·m."""
    friction = machine.effect(f"friction.{axis}")
    return friction.values["coulomb_Nm"] if friction is not None else 0.0


def output_row(d: AxisData) -> AxisData | None:
    """The row of what a recording has of the motor's torque; nothing where it has none, or one that never changes.

    Its noise is what changes faster than any drive, from its third differences. That of the encoder is in it, through
    the control.
    """
    if d.record.output is None or not np.ptp(d.record.output[1]):
        return None
    name, values = d.record.output
    step = max(step_of(values), _TEN_BITS * float(np.abs(values).max()))
    noise = LogNoise(max(_roughness([values]), step / float(np.sqrt(12.0))), "from its third differences")
    return replace(d, channel=name, noise=noise, resolution=step)


def _roughness(parts: Sequence[np.ndarray]) -> float:
    """Standard deviation of the white noise in some series, from their third differences."""
    third = np.abs(np.concatenate([np.diff(values, 3) for values in parts]))
    rough = float(np.median(third[third > 0.0])) if third.any() else 0.0
    # of white noise: the median of the size of a normal value, and the norm of the weights 1, 3, 3, 1
    return rough / (0.6745 * float(np.sqrt(20.0)))


def _with_torque(record: AxisRecord, constant: float) -> AxisRecord:
    """A record with the torque of its current, where the torque ``constant`` is known, N·m/A; else as it is."""
    if record.torque is not None or record.current is None or not constant:
        return record
    return replace(record, torque=constant * record.current)


def _start(time: np.ndarray, record: AxisRecord, resolution: float, noise: float) -> tuple[float, float]:
    """Position and velocity at the first sample, from a parabola through the first samples.

    A velocity that may be noise is none: an axis that moves begins with bristles that slide, one at rest with bristles
    that hold, and the two differ by micrometres for long.
    """
    n = int(np.clip(np.searchsorted(time, time[0] + 0.005), 5, 50))
    parabola = np.linalg.pinv(np.vander(time[:n] - time[0], 3, increasing=True))
    c = parabola @ record.actual[:n]
    moves = abs(c[1]) > _MOVES * noise * np.linalg.norm(parabola[1])
    commanded = np.ptp(record.command[: 4 * n]) > 0.0
    settling = moves and abs(c[1]) * (time[n] - time[0]) > _REST_STEPS * resolution
    if not (commanded or settling):
        return float(record.actual[:n].mean()), 0.0
    return float(c[0]), float(c[1]) if moves else 0.0


def noise_of(time: np.ndarray, record: AxisRecord, resolution: float) -> LogNoise:
    """Noise of one axis: from repeats or rest, else from what changes fast while the command stands, else declared."""
    found = noise_at_rest(time, record, resolution)
    if found is not None:
        return found
    declared, standing = declared_noise(resolution), _standing(time, record)
    if standing:  # it settles, or its noise is many steps of the encoder
        spread = _roughness([record.actual[a:b] for a, b in standing])
        return LogNoise(max(spread, declared.rms), "from what changes fast while the command stands")
    return declared


def declared_noise(resolution: float) -> LogNoise:
    """Noise of one axis by the step of its encoder alone."""
    return LogNoise(resolution / float(np.sqrt(12.0)), "as declared: a share of the encoder step")


def noise_at_rest(time: np.ndarray, record: AxisRecord, resolution: float) -> LogNoise | None:
    """Noise of one axis from repeats where the motion repeats, else from rest; nothing where neither is there."""
    floor = declared_noise(resolution).rms
    period = period_of(record.command, resolution)
    if period:
        n = len(time) // period
        folded = record.actual[: n * period].reshape(n, period)
        spread = float(np.sqrt(np.mean(folded.var(axis=0, ddof=1))))
        return LogNoise(max(spread, floor), f"from {n} repeats of the motion")
    still = (record.actual[a:b] for a, b in _standing(time, record))
    rest = [values - values.mean() for values in still if np.ptp(values) <= _REST_STEPS * resolution]
    if not rest:
        return None
    spread = float(np.sqrt(np.mean(np.concatenate(rest) ** 2)))
    return LogNoise(max(spread, floor), f"from {len(rest)} stretch{'es' if len(rest) > 1 else ''} at rest")


def period_of(command: np.ndarray, resolution: float) -> int:
    """Samples after which a command repeats, at least twice in all; 0 where it does not."""
    n = len(command)
    centred = command - command.mean()
    if not np.any(np.abs(centred) > resolution):
        return 0
    products = np.fft.irfft(np.abs(np.fft.rfft(centred, 2 * n)) ** 2)[:n]
    squares = np.concatenate([[0.0], np.cumsum(centred**2)])
    lags = np.arange(n)
    # mean square of what a command differs from itself some samples later: zero at its period
    change = (squares[n - lags] + squares[n] - squares[lags] - 2.0 * products) / (n - lags)
    low = np.flatnonzero((change[1:-1] < change[:-2]) & (change[1:-1] <= change[2:])) + 1
    low = low[low <= n // 2]
    for period in np.sort(low[np.argsort(change[low], kind="stable")][:_MINIMA]):
        same = np.abs(command[period:] - command[:-period]) <= resolution
        if same.mean() >= _REPEATED:
            return int(period)
    return 0


def _standing(time: np.ndarray, record: AxisRecord) -> list[tuple[int, int]]:
    """Stretches (first, behind the last sample) in which the command stands still."""
    least = max(3, int(_REST / np.median(np.diff(time))))
    still = np.concatenate([[0], (np.diff(record.command) == 0.0).astype(int), [0]])
    edges = np.flatnonzero(np.diff(still))
    halves = ((a + (b - a) // 2, b) for a, b in zip(edges[::2], edges[1::2], strict=True))  # the first half settles
    return [(int(a), int(b)) for a, b in halves if b - a >= least]


def check_controllers(logs: Campaign, machine: Machine) -> None:
    """Refuse logs whose controller the machine file does not have.

    Raises:
        InputError: Names the test, and what there is.
    """
    for test in logs.measured:
        for axis in test.axes:
            allowed = [name for name, axes in machine.controllers.items() if axis in axes]
            place = f'machine {machine.name!r}: test "{test.name}"'
            if test.controller is None and len(allowed) > 1:
                raise InputError(f"{place} names no controller; allowed: controller = one of {', '.join(allowed)}")
            if test.controller is not None and test.controller not in allowed:
                none = ", ".join(allowed) or "none; write a table [controller.NAME.AXIS]"
                raise InputError(f"{place} ran under {test.controller!r} on {axis}; the machine file has: {none}")
