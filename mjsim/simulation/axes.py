"""The axes' motion without the multibody model: the same compiled drives, axis by axis.

The mass matrix of the balanced machine is diagonal, so this gives what the MuJoCo simulation gives
(``tests/test_simulate.py`` holds the difference); the diagnosis searches with it. Errors that are reported come from
the MuJoCo simulation.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from threading import RLock
from typing import Any, TypeVar

import numpy as np

from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine import own
from mjsim.machine.kinematics import BarSensitivity, rotation, sensitivity
from mjsim.machine.plant import AxisPlant, Plant
from mjsim.simulation.bar import reading_in
from mjsim.simulation.drive import STEP, SUBSTEPS, discretise, run, substeps_of
from mjsim.simulation.tracker import MotionTracker
from mjsim.simulation.transmission import transmit

#: Time after the program's end that is still simulated, s (trigger shifts look there).
TAIL = 0.1
#: Delays of a drive of which the commands are kept: that of a model, and one beside it for a derivative.
_DELAYS = 2
T = TypeVar("T")


def time_grid(program: Program) -> np.ndarray:
    """Instants one step apart from 0 to a little past the program's end, s."""
    return np.arange(int(np.ceil((program.duration + TAIL) / STEP)) + 1) * STEP


def delayed_commands(program: Program, time: np.ndarray, plant: Plant) -> np.ndarray:
    """Axis commands (n, axes) as the drives receive them, each with its own delay."""
    return behind(program, time, program.commands(time), plant)


def behind(program: Program, time: np.ndarray, commands: np.ndarray, plant: Plant) -> np.ndarray:
    """As :func:`delayed_commands`, from the ``commands`` (n, axes) of ``time`` (n,) s; these themselves where no
    drive has a delay.
    """
    delays = [plant.axes[a].delay for a in plant.chain.letters]
    if not any(delays):
        return commands
    out = commands.copy()
    for delay in {d for d in delays if d}:
        moved = program.commands(time - delay)
        for i in range(len(delays)):
            if delays[i] == delay:
                out[:, i] = moved[:, i]
    return out


def _remembered(kept: OrderedDict[Any, T], most: int, key: Any, compute: Callable[[], T]) -> T:
    """What is kept under a key, computed where it is not; of several, the ``most`` that were asked for last stay."""
    if key not in kept:
        kept[key] = compute()
        while len(kept) > most:
            kept.popitem(last=False)
    kept.move_to_end(key)
    return kept[key]


def _driven(drive: AxisPlant, commands: np.ndarray, step: float, substeps: int = SUBSTEPS) -> np.ndarray:
    """Position of one axis (n,) behind its drive, in axis units, for ``commands`` (n,) ``step`` s apart, with at least
    so many ``substeps`` in each.
    """
    out = np.empty(len(commands))
    n = substeps_of(drive, step, substeps)
    run(discretise(drive, step / n), np.ascontiguousarray(commands), step / n, n, out)
    return out


def own_effects(plant: Plant, test: BallBarTest, time: np.ndarray) -> np.ndarray:
    """What the user's plain-Python effects add to the axes, (n, axes) m and rad, at ``time`` (n,) s, evenly spaced.

    They follow from the motion alone (the loop is closed on the motor, before them), so one call per test is enough.

    Raises:
        SimulationError: an effect raises, or returns anything but finite numbers of that shape.
    """
    step = float(time[1] - time[0])
    commands = delayed_commands(Program(test), time, plant)
    q = np.empty((len(time), plant.width))
    q[:, plant.chain.count :] = 0.0
    for i, a in enumerate(plant.chain.letters):
        q[:, i] = _driven(plant.axes[a], commands[:, i], step)
    ops = plant.op_table(test.recording, test.started)
    if len(ops):
        q = transmit(ops, q, test.started + time)
    return added(plant, test.started, time, q[:, : plant.chain.count], step, test.table_ball)


def added(
    plant: Plant,
    started: float,
    time: np.ndarray,
    q: np.ndarray,
    step: float,
    ball: tuple[float, float, float],
) -> np.ndarray:
    """What effects in plain Python add to the axis positions ``q`` (n, axes), m and rad."""
    motion = MotionTracker(step, started, plant, ball).follow(time, q.copy())
    total = np.zeros_like(q)
    for effect in plant.python_effects:
        total += own.position_error(effect, motion)
    return total


@dataclass
class AxesMotion:
    """Motor-side motions of one test, computed per axis on demand and kept for the drives used last.

    Attributes:
        test: the test. keep: motions kept per axis. light: whether to :meth:`give_back` after every :meth:`load`.
            substeps: least in a step.
    """

    __test__ = False

    test: BallBarTest
    keep: int = 3
    light: bool = False
    substeps: int = SUBSTEPS

    def __post_init__(self) -> None:
        self.program = Program(self.test)
        self._kept: dict[str, OrderedDict] = {a: OrderedDict() for a in self.test.chain.letters}
        self._late: dict[str, OrderedDict] = {a: OrderedDict() for a in self.test.chain.letters}
        self._turn = RLock()

    def read_as(self, test: BallBarTest) -> AxesMotion:
        """The same motion for another reading of it; both keep what the drives do in one place."""
        out = copy(self)
        out.test = test
        return out

    @cached_property
    def time(self) -> np.ndarray:
        """Instants one step apart, (n,) s."""
        return time_grid(self.program)

    @cached_property
    def commands(self) -> np.ndarray:
        """Commands at ``time`` without delays, (n, axes) m and rad."""
        return self.program.commands(self.time)

    @cached_property
    def moves(self) -> np.ndarray:
        """Which axes move in this test, (axes,) bool."""
        return np.ptp(self.commands, axis=0) > 0.0

    def motor(self, axis: str, drive: AxisPlant, every: int = 1, substeps: int | None = None) -> np.ndarray:
        """Motor position of one axis in axis units at every ``every``-th instant; no more than that is kept."""
        substeps = substeps or self.substeps
        kept, key = self._kept[axis], (every, substeps, drive.key())
        with self._turn:
            return _remembered(kept, self.keep, key, lambda: self._motor(axis, drive, every, substeps))

    def motor_change(self, axis: str, before: AxisPlant, after: AxisPlant, every: int = 1) -> np.ndarray:
        """How far another drive moves the motor of one axis, in axis units at every ``every``-th instant.

        Only the motion before is kept. A single sub-step a step is enough: what it misses is the same in both.
        """
        n = max(substeps_of(d, STEP, 1) for d in (before, after))
        return self._motor(axis, after, every, n) - self.motor(axis, before, every, n)

    def _motor(self, axis: str, drive: AxisPlant, every: int, substeps: int) -> np.ndarray:
        r = self._command(axis, drive.delay)
        # an axis that never moves stays: the integrator holds gravity
        moved = _driven(drive, r, STEP, substeps) if self.moves[self.test.chain.index(axis)] else r
        return np.ascontiguousarray(moved[::every])

    def _command(self, axis: str, delay: float) -> np.ndarray:
        """The command of an axis as its drive receives it, (n,): most drives that are tried have the same delay."""
        i = self.test.chain.index(axis)
        if not delay:
            return self.commands[:, i]
        with self._turn:
            return _remembered(
                self._late[axis], _DELAYS, delay, lambda: self.program.late(i, self.commands, STEP, delay)
            )

    def load(self, plant: Plant, every: int = 1) -> np.ndarray:
        """Load-side axis positions, m and rad, at every ``every``-th instant.

        (n, axes), or with the table's error motion behind where the plant has one. A user's own effects see every
        instant; play and direction see the given ones, which miss a turning point by less than 0.01 µm.
        """
        ops = plant.op_table(self.test.recording, self.test.started)
        fine = 1 if plant.python_effects else every
        time = self.time[::fine]
        q = np.zeros((len(time), plant.width))
        for i, a in enumerate(plant.chain.letters):
            q[:, i] = self.motor(a, plant.axes[a], fine)
        clock = self.test.started + time
        if len(ops):
            q = transmit(ops, q, clock)
        if plant.python_effects:
            axes = q[:, : plant.chain.count]
            axes += added(plant, self.test.started, time, axes, STEP, self.test.table_ball)
        if self.light:
            self.give_back()
        return np.ascontiguousarray(q[:: every // fine])

    def give_back(self) -> None:
        """Give back the fine time grid and its commands, which are many times as much as what is kept of the drives."""
        for name in ("time", "commands"):
            vars(self).pop(name, None)
        for kept in self._late.values():
            kept.clear()

    def sensitivity(self, plant: Plant, every: int = 1) -> BarSensitivity:
        """The reading's derivatives at every ``every``-th instant, at the positions that the axes reach. The spindle
        ball's offset is the one at the spindle's angle 0.
        """
        q = self.load(plant, every)[:, : plant.chain.count]
        out = sensitivity(plant.chain, q, np.asarray(self.test.table_ball), self.test.component)
        if self.test.spindle:
            out = replace(out, spindle=out.spindle @ rotation(2, self.test.spindle))
        return out

    def reading(self, plant: Plant, every: int = 1) -> np.ndarray:
        """Ball-bar reading in m at every ``every``-th instant."""
        return reading_in(self.test, self.load(plant, every), plant.geometry)


def motions_of(
    tests: Sequence[BallBarTest], keep: int = 3, light: bool = False, substeps: int = SUBSTEPS
) -> tuple[AxesMotion, ...]:
    """The motion of each test; readings of one recording share it.

    Args:
        tests: Of one campaign.
        keep: Motions kept per axis.
        light: As of :class:`AxesMotion`.
        substeps: Likewise.
    """
    known: dict[str, AxesMotion] = {}
    for t in tests:
        known.setdefault(t.recording, AxesMotion(t, keep, light, substeps))
    return tuple(known[t.recording].read_as(t) for t in tests)


def load_of(
    plant: Plant,
    time: np.ndarray,
    commands: np.ndarray,
    started: float = 0.0,
    name: str = "",
    ball: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """Load-side axis positions for commands that belong to no test, or that a control has corrected.

    Args:
        plant: the machine's numbers.
        time: instants from the program's start, evenly spaced, (n,) s.
        commands: before the drives' delays, (n, axes) m and rad.
        started: start of the program on the campaign clock, s.
        name: of the test whose vibrations these are, if any.
        ball: centre of the table ball in the work frame, m; a part has none.

    Returns:
        (n, axes), or with error motions behind where the plant has some, m and rad.
    """
    q = np.zeros((len(time), plant.width))
    for i, a in enumerate(plant.chain.letters):
        q[:, i] = motor_of(plant.axes[a], time, commands[:, i])
    ops = plant.op_table(name, started)
    if len(ops):
        q = transmit(ops, q, started + time)
    if plant.python_effects:
        axes = q[:, : plant.chain.count]
        axes += added(plant, started, time, axes, float(time[1] - time[0]), ball)
    return q


def motor_of(drive: AxisPlant, time: np.ndarray, command: np.ndarray) -> np.ndarray:
    """Position of one axis (n,) behind its drive for any ``command`` (n,) at ``time`` (n,) s, in axis units."""
    if drive.delay:
        command = np.interp(time - drive.delay, time, command)
    # an axis that never moves stays: the integrator holds gravity
    return _driven(drive, command, float(time[1] - time[0])) if np.ptp(command) > 0.0 else command
