"""What single errors of the machine do to the tool's tip: changes of its deviation, one effect or number at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjsim.inference.data_sheet import calibrated, data_sheet, sheet_of
from mjsim.inference.posterior import Posterior
from mjsim.machine.effect import Effect
from mjsim.machine.kinematics import machine_to_work
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.prediction.tip import Run
from mjsim.simulation.axes import motor_of
from mjsim.simulation.transmission import transmit

#: Step of numerical derivatives, in typical sizes; of positions, m and rad.
_NUDGE, _MOVE = 0.05, 1e-6


class Influence:
    """Changes of the tip's deviation from that of one machine.

    Args:
        run: The program.
        machine: The machine that it is compared with.
    """

    def __init__(self, run: Run, machine: Machine) -> None:
        self.run, self.machine, self.plant = run, machine, build(machine)
        self.bare = build(replace(machine, effects=()))
        self.load = run.load(self.plant)
        if self.load.shape[1] < len(self.plant.chain.columns):  # effects that the machine lacks may move these
            more = len(self.plant.chain.columns) - self.load.shape[1]
            self.load = np.hstack([self.load, np.zeros((len(self.load), more))])
        self.path = run.path
        self.at_zero = self._zero(self.plant)
        self.deviation = self._off(self.plant, self.load, self.at_zero)
        self.motors: dict[str, np.ndarray] = {}
        self.per_column, self.per_zero = self._per_column()

    def _zero(self, plant: Plant) -> np.ndarray:
        q = np.zeros((1, self.load.shape[1]))
        q[0, :3] = self.run.zero
        q[0, 2] += self.run.tool
        ops = plant.op_table("", self.run.clock)
        return transmit(ops, q, np.array([self.run.clock])) if len(ops) else q

    def _off(self, plant: Plant, load: np.ndarray, at_zero: np.ndarray) -> np.ndarray:
        """Deviation (n, 3) m in the work frame for positions ``load`` (n, width), the part being set up at positions
        ``at_zero`` (1, width).
        """
        off = self.run.machine_deviation(plant, load, self.run.set_up(plant, at_zero, self.path))
        # the tip is where the axes are, not where they were told to be: the table has turned less than that
        at = load[:, : self.run.chain.count]
        return machine_to_work(self.run.chain, at, off) - machine_to_work(self.run.chain, at, np.zeros(3))

    def _per_column(self) -> tuple[np.ndarray, np.ndarray]:
        """Deviation per column of a motion, (n, 3, width), and per column of the positions at the set-up, alike."""
        width = self.load.shape[1]
        out, zero = np.empty((2, len(self.load), 3, width))
        for c in range(width):
            moved, still = self.load.copy(), self.at_zero.copy()
            moved[:, c] += _MOVE
            still[:, c] += _MOVE
            out[:, :, c] = (self._off(self.plant, moved, self.at_zero) - self.deviation) / _MOVE
            zero[:, :, c] = (self._off(self.plant, self.load, still) - self.deviation) / _MOVE
        return out, zero

    def change(self, before: Effect | None, after: Effect | None) -> np.ndarray:
        """Change of the deviation where ``after`` takes the place of ``before``, (n, 3) m; ``None`` is without it."""
        effect = after if after is not None else before
        assert effect is not None
        old, new = self._alone(before), self._alone(after)
        out = np.zeros_like(self.deviation)
        if old.ops or new.ops:
            out += self._through_ops(old, new)
        if old.geometry != new.geometry:
            out += self._through_geometry(effect, after)
        for axis in self.run.chain.letters:
            if old.axes[axis] != new.axes[axis]:
                out += self._through_drive(axis, effect, after)
        if effect.in_python:
            out += self._through_all(effect, after)
        return out

    def _alone(self, effect: Effect | None) -> Plant:
        return build(replace(self.machine, effects=(effect,) if effect is not None else ()))

    def _through_ops(self, old: Plant, new: Plant) -> np.ndarray:
        run = self.run
        clock = run.clock + run.time[run.kept]
        step, zero = np.zeros_like(self.load), np.zeros((1, self.load.shape[1]))
        for plant, sign in ((new, 1.0), (old, -1.0)):
            ops = plant.op_table("", run.clock)
            if len(ops):
                step += sign * (transmit(ops, self.load, clock) - self.load)
                zero += sign * (transmit(ops, self.at_zero, np.array([run.clock])) - self.at_zero)
        moved = np.einsum("nic,nc->ni", self.per_column, step)
        return moved + self.per_zero @ zero[0]

    def _through_geometry(self, effect: Effect, after: Effect | None) -> np.ndarray:
        plant = build(self._with(effect, after))
        return self._off(plant, self.load, self.at_zero) - self.deviation

    def _through_drive(self, axis: str, effect: Effect, after: Effect | None) -> np.ndarray:
        return self.through_motor(axis, build(self._with(effect, after)))

    def through_motor(self, axis: str, plant: Plant) -> np.ndarray:
        """Change of the deviation where one axis has the drive of ``plant``, (n, 3) m."""
        i, run = self.run.chain.index(axis), self.run
        if np.ptp(run.commands[:, i]) == 0.0:
            return np.zeros_like(self.deviation)
        if axis not in self.motors:
            self.motors[axis] = motor_of(self.plant.axes[axis], run.time, run.commands[:, i])[run.kept]
        other = motor_of(plant.axes[axis], run.time, run.commands[:, i])[run.kept]
        return self.per_column[:, :, i] * (other - self.motors[axis])[:, None]

    def _through_all(self, effect: Effect, after: Effect | None) -> np.ndarray:
        plant = build(self._with(effect, after))
        return self._off(plant, self.run.load(plant), self._zero(plant)) - self.deviation

    def _with(self, effect: Effect, after: Effect | None) -> Machine:
        return self.machine.without(effect.key) if after is None else self.machine.with_effect(after)

    def columns(self, posterior: Posterior) -> np.ndarray:
        """Derivative of the deviation with respect to everything that was fitted, (n, 3, entries) m per entry."""
        out = []
        for f in posterior.effects:
            present = self.machine.effect(f.effect.key)
            for j in range(len(f.vector)):
                effect, change = f.nudged(j, _NUDGE)
                out.append(self.change(present if present is not None else f.effect, effect) / change)
        sheet = sheet_of(self.machine)
        for j, p in enumerate(sheet):
            moved = build(calibrated(self.machine, p.step * np.eye(len(sheet))[j]))
            out.append(self.through_motor(p.axis, moved) / p.step)
        return np.stack(out, axis=2)


def labels(posterior: Posterior, machine: Machine) -> list[str]:
    """The effect or the number of the data sheet behind every entry."""
    fitted = [f.effect.key for f in posterior.effects for _ in range(len(f.vector))]
    return [*fitted, *(f"data sheet {p.label}" for p in data_sheet(machine.chain))]
