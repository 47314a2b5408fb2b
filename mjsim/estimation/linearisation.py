"""Derivatives of the readings by the numbers of quasi-static effects, without a new simulation: what a model of sixty
needs.

The axes' positions of the present model are kept. An effect of positions changes them by its own operations alone, a
location error changes the frame in which the same positions are read. Both are tiny beside the motion, so that what the
other effects do to them is of second order.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.problem import Problem
from mjsim.estimation.samples import GRID_STEPS
from mjsim.machine.effect import Effect
from mjsim.machine.kinematics import Geometry
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import PLAY, Plant
from mjsim.simulation.bar import reading
from mjsim.simulation.transmission import reading_change

#: Size of the numerical step, of a typical size.
_STEP = 0.02


class Linearisation:
    """The axes' positions of one model, and what single effects change there."""

    def __init__(self, problem: Problem, machine: Machine, nuisance: np.ndarray) -> None:
        self.problem, self.machine, self.nuisance = problem, machine, nuisance
        self.plant = build(machine)
        motions = problem.motions
        self.loads = problem.map(lambda k: np.ascontiguousarray(motions[k].load(self.plant, GRID_STEPS)))

    def columns(self, free: EffectVector) -> list[np.ndarray] | None:
        """Derivative of the block means by the entries of an effect, (m, k) per test in m per typical size.

        ``None`` where the effect needs a new simulation: it acts on a drive, has play, moves the table or is in Python.
        """
        if free.effect.in_python or not free.effect.search.quasi_static:
            return None
        n = len(free.vector)
        pairs = [free.nudged(j, _STEP) for j in range(n)]
        alone = [self._alone(e) for e in (free.effect, *(effect for effect, _ in pairs))]
        ops = [op for plant in alone for op in plant.ops]
        if any(op.out >= self.machine.chain.count or op.code == PLAY for op in ops):
            return None
        here, *moved = alone

        def one(k: int) -> np.ndarray:
            s, shift = self.problem.samples[k], self.problem.shift(k, self.nuisance)
            base = self._change(k, here)
            parts = [
                s.sample((self._change(k, p) - base) / change, shift)
                for p, (_, change) in zip(moved, pairs, strict=True)
            ]
            return np.column_stack(parts)

        return self.problem.map(one)

    def _alone(self, effect: Effect) -> Plant:
        """The plant of a machine that has this effect only."""
        m = self.machine
        return build(replace(m, effects=(effect,)))

    def _change(self, k: int, alone: Plant) -> np.ndarray:
        """What the operations and the geometry of one effect add to the reading of test ``k``, on the grid, m."""
        p, load = self.problem, self.loads[k]
        test = p.motions[k].test
        out = np.zeros(len(load))
        if alone.ops:
            clock = test.started + p.motions[k].time[::GRID_STEPS]
            out += reading_change(alone.op_table(test.name, test.started), load, clock, p.sensitivity[k].axes)
        if alone.geometry.location or alone.geometry.squareness:
            axes = np.ascontiguousarray(load[:, : self.machine.chain.count])
            where = self.machine.chain, axes, np.asarray(test.table_ball), test.length
            out += reading(*where, alone.geometry) - reading(*where, Geometry())
        return out
