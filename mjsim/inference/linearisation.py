"""Derivatives of the readings by the numbers of effects without simulating the whole machine anew: what a model of
sixty needs.

The axes' motions of the present model are kept. An effect of positions changes them by its own operations alone, a
location error changes the frame in which the same positions are read, and one that changes a drive has that drive
simulated alone. All of them are tiny beside the motion, so that what the other effects do to them is of second order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Protocol

import numpy as np

from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.problem import KeptChanges
from mjsim.inference.samples import GRID, GRID_STEPS
from mjsim.machine.effect import Effect
from mjsim.machine.kinematics import BarSensitivity, Geometry
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import PLAY, Plant
from mjsim.simulation.axes import AxesMotion
from mjsim.simulation.bar import reading_in
from mjsim.simulation.transmission import reading_change, transmit

#: Size of the numerical step, of a typical size; of an effect that the reading is linear in.
_STEP, _PART = 0.02, 0.05
#: Size of the numerical step of an error motion, m or rad.
_MOTION = 1e-6
#: What computes block means of a test, (m,) or (m, k), from its number.
OfTest = Callable[[int], np.ndarray]


class Sampled(Protocol):
    """How the reading of a test is sampled."""

    def sample(self, grid: np.ndarray, shift: float) -> np.ndarray:
        """Samples of a reading on the grid, (n,) m, that began ``shift`` seconds later."""
        ...


class Tests(Protocol):
    """Tests whose readings are differentiated: those of a :class:`Problem`, or one that was not measured yet."""

    @property
    def motions(self) -> Sequence[AxesMotion]:
        """The axes' motions, one per test."""
        ...

    @property
    def sensitivity(self) -> Sequence[BarSensitivity]:
        """The reading's derivatives along each test."""
        ...

    @property
    def samples(self) -> Sequence[Sampled]:
        """How each reading is sampled."""
        ...

    @property
    def changes(self) -> KeptChanges:
        """What was computed already."""
        ...

    def map(self, work: Callable[[int], object]) -> list:
        """``work(k)`` for every test, in order."""
        ...

    def shift(self, k: int, nuisance: np.ndarray) -> float:
        """Trigger shift of test ``k``, s."""
        ...


class Linearisation:
    """The axes' positions of one model, and what single effects change there."""

    def __init__(self, problem: Tests, machine: Machine, nuisance: np.ndarray) -> None:
        self.problem, self.machine, self.nuisance = problem, machine, nuisance
        self.plant = build(machine)
        self._plays: dict[str, Plant] = {}
        self._by_motion: dict[int, list[np.ndarray]] = {}
        motions = problem.motions
        self.loads = problem.map(lambda k: np.ascontiguousarray(motions[k].load(self.plant, GRID_STEPS)))
        problem.changes.move_to(self.loads)

    def columns(self, free: EffectVector) -> list[np.ndarray] | None:
        """Derivative of the block means by the entries of an effect, (m, k) per test in m per typical size.

        ``None`` where the effect needs a new simulation: it is in Python, or changes a drive by more than its numbers.
        """
        one = self.columns_of(free)
        return None if one is None else self.problem.map(one)

    def columns_of(self, free: EffectVector) -> OfTest | None:
        """What computes the :meth:`columns` of one test."""
        if free.effect.in_python:
            return None
        if free.is_linear and free.effect.search.quasi_static and not self._plays_back(self._alone(free.effect)):
            parts = [self.added_of(free.only(j, _PART), keep=True) for j in range(len(free.vector))]
            return lambda k: np.column_stack([part(k) for part in parts]) / _PART
        pairs = [free.nudged(j, _STEP) for j in range(len(free.vector))]
        effects = [free.effect, *(effect for effect, _ in pairs)]
        plants = [self._alone(e) if e.search.quasi_static else self._with(e, free.names) for e in effects]
        part_of = self._part_of(free.effect, plants)
        axis = free.effect.subject

        def derivatives(k: int) -> np.ndarray:
            here, *moved = (part_of(k, plant, axis) for plant in plants)
            return np.array([(m - here) / change for m, (_, change) in zip(moved, pairs, strict=True)])

        def one(k: int) -> np.ndarray:
            s, shift = self.problem.samples[k], self.problem.shift(k, self.nuisance)
            return np.column_stack([s.sample(d, shift) for d in self._near(k, free, derivatives)])

        return one

    def _near(self, k: int, free: EffectVector, derivatives: OfTest) -> np.ndarray:
        """Derivatives of the reading of test ``k`` by the numbers of an effect, (m, n) on the grid: those of nearly the
        same drive where the effect acts on one, and they are kept.
        """
        if free.effect.search.quasi_static:
            return derivatives(k)
        axis, changes = free.effect.subject, self.problem.changes
        play = [x for op in self._play_of(axis).ops for x in op.parameters]
        drive = np.array([*self.plant.axes[axis].numbers, *play])
        known = changes.of_drive(k, free, drive)
        if known is None:
            known = derivatives(k)
            changes.keep_drive(k, free, drive, known)
        return known

    def change_of(self, effect: Effect) -> OfTest:
        """What computes the change that an effect of positions makes in the block means of one test, (m,) m: added to
        the model, or in the place of the one that the model has.
        """
        before = self.machine.effect(effect.key)
        if before is None:
            return self.added_of(effect)
        plants = [self._alone(e) for e in (effect, before)]
        part_of = self._part_of(effect, plants)

        def one(k: int) -> np.ndarray:
            now, then = (part_of(k, plant, effect.subject) for plant in plants)
            return self.problem.samples[k].sample(now - then, self.problem.shift(k, self.nuisance))

        return one

    def added_of(self, effect: Effect, keep: bool = False) -> OfTest:
        """What computes the part that an effect of positions by itself adds to the block means of one test, (m,) m.

        It is kept if ``keep`` says so.
        """
        changes = self.problem.changes
        known = [changes.of(k, effect) for k in range(len(self.problem.motions))]
        compute = self._change_by(effect) if any(grid is None for grid in known) else None

        def one(k: int) -> np.ndarray:
            grid = known[k]
            if grid is None:
                assert compute is not None
                grid = compute(k)
                if keep:
                    changes.keep(k, effect, grid)
            return self.problem.samples[k].sample(grid, self.problem.shift(k, self.nuisance))

        return one

    def _change_by(self, effect: Effect) -> Callable[[int], np.ndarray]:
        """What computes the change of a test's reading by this effect alone, on the grid, m."""
        plant = self._alone(effect)
        part_of = self._part_of(effect, [plant])
        if part_of != self._of_geometry:
            return lambda k: part_of(k, plant, effect.subject)
        ideal = self._ideal
        return lambda k: part_of(k, plant, effect.subject) - ideal[k]

    @staticmethod
    def _plays_back(plant: Plant) -> bool:
        """Whether an operation of the plant remembers where the motion turned."""
        return any(op.code == PLAY for op in plant.ops)

    @cached_property
    def _ideal(self) -> list[np.ndarray]:
        """Readings of all tests at the same axis positions without any error motion or location error, m."""
        ideal = build(replace(self.machine, effects=()))
        return self.problem.map(lambda k: self._of_geometry(k, ideal, ""))

    def _alone(self, effect: Effect) -> Plant:
        """The plant of a machine that has this effect only."""
        m = self.machine
        return build(replace(m, effects=(effect,)))

    def _with(self, effect: Effect, names: tuple[str, ...]) -> Plant:
        """The plant of the model with these numbers of an effect; the data sheet gives the others."""
        mine = self.machine.effect(effect.key)
        assert mine is not None
        return build(self.machine.with_effect(mine.replaced(**{n: effect.values[n] for n in names})))

    def _part_of(self, effect: Effect, plants: list[Plant]) -> Callable[[int, Plant, str], np.ndarray]:
        """What computes the part of the reading that such an effect changes, but for a constant part."""
        if not effect.search.quasi_static:
            return self.of_drive
        if any(p.geometry.location or p.geometry.squareness for p in plants):
            return self._of_geometry
        if any(op.out >= p.chain.count for p in plants for op in p.ops):
            for column in {op.out for p in plants for op in p.ops if op.out >= p.chain.count}:
                self.by_motion(column)  # before threads ask for it
            return self._of_table
        return self._of_operations

    def of_drive(self, k: int, plant: Plant, axis: str) -> np.ndarray:
        """What one drive adds to the reading of test ``k``, on the grid, m, to be compared with another: what a single
        sub-step of it misses is the same in both.
        """
        p, i = self.problem, plant.chain.index(axis)
        motion = p.motions[k]
        if not motion.moves[i]:
            return np.zeros(len(self.loads[k]))
        position = motion.motor(axis, plant.axes[axis], GRID_STEPS, substeps=1)
        play = self._play_of(axis)
        if play.ops:  # while the play is crossed, what the drive does is not seen
            q = np.zeros((len(position), plant.chain.count))
            q[:, i] = position
            position = transmit(play.op_table(motion.test.recording, motion.test.started), q, self._clock(k))[:, i]
        return p.sensitivity[k].axes[:, i] * position

    def _play_of(self, axis: str) -> Plant:
        """The plant of a machine that has nothing but the model's play of one axis."""
        if axis not in self._plays:
            mine = [e for e in self.machine.effects if e.subject == axis and not e.in_python]
            playing = [e for e in mine if self._plays_back(self._alone(e))]
            self._plays[axis] = build(replace(self.machine, effects=tuple(playing)))
        return self._plays[axis]

    def _of_geometry(self, k: int, alone: Plant, axis: str) -> np.ndarray:
        """The reading of test ``k`` with the geometry of one effect, on the grid, m."""
        test = self.problem.motions[k].test
        return reading_in(test, self._axes(k), alone.geometry)

    def _of_table(self, k: int, alone: Plant, axis: str) -> np.ndarray:
        """What error motions of the table add to the reading of test ``k``, on the grid, m."""
        axes = self._axes(k)
        if not alone.ops:
            return np.zeros(len(axes))
        test, count = self.problem.motions[k].test, axes.shape[1]
        q, weight = np.zeros((len(axes), alone.width)), np.zeros((len(axes), alone.width))
        q[:, :count], weight[:, :count] = axes, self.problem.sensitivity[k].axes
        for column in {op.out for op in alone.ops if op.out >= count}:
            weight[:, column] = self._by_motion[column][k]
        return reading_change(alone.op_table(test.recording, test.started), q, self._clock(k), weight)

    def by_motion(self, column: int) -> list[np.ndarray]:
        """Derivatives of the readings by a constant error motion in a column of the motions, per test (n,) on the grid,
        m per m or rad.
        """
        if column not in self._by_motion:
            ideal = self._ideal
            self._by_motion[column] = self.problem.map(lambda k: (self._moved(k, column) - ideal[k]) / _MOTION)
        return self._by_motion[column]

    def _moved(self, k: int, column: int) -> np.ndarray:
        """Reading of test ``k`` with a small constant error motion in ``column`` of the motions, on the grid, m."""
        axes, test = self._axes(k), self.problem.motions[k].test
        q = np.zeros((len(axes), column + 1))
        q[:, : axes.shape[1]], q[:, column] = axes, _MOTION
        return reading_in(test, q, Geometry())

    def _of_operations(self, k: int, alone: Plant, axis: str) -> np.ndarray:
        """What the operations of one effect add to the reading of test ``k``, on the grid, m."""
        test, axes = self.problem.motions[k].test, self._axes(k)
        if not alone.ops:
            return np.zeros(len(axes))
        if self._plays_back(alone):
            # play has memory: what it does follows from the motion in front of it
            i = alone.chain.index(axis)
            axes = axes.copy()
            axes[:, i] = self.problem.motions[k].motor(axis, self.plant.axes[axis], GRID_STEPS)
        ops = alone.op_table(test.recording, test.started)
        return reading_change(ops, axes, self._clock(k), self.problem.sensitivity[k].axes)

    def _axes(self, k: int) -> np.ndarray:
        """Axis positions of test ``k``, (n, axes)."""
        return np.ascontiguousarray(self.loads[k][:, : self.plant.chain.count])

    def _clock(self, k: int) -> np.ndarray:
        """Campaign clock of test ``k`` on the grid, (n,) s."""
        return self.problem.motions[k].test.started + GRID * np.arange(len(self.loads[k]))
