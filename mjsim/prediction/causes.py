"""What makes the deviation: every effect's part of it, by itself, and what the drives lag behind."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mjsim.inference.data_sheet import calibrated, data_sheet, sheet_of
from mjsim.inference.posterior import Posterior
from mjsim.machine.effect import Effect, axis_of_subject
from mjsim.machine.kinematics import machine_to_work
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.prediction.result import Cause
from mjsim.prediction.tip import Run
from mjsim.simulation.axes import motor_of
from mjsim.simulation.transmission import transmit

# -- contour error -----------------------------------------------------------------------------------------------------

#: Newton steps to the nearest point of the path.
_STEPS = 6


@dataclass(frozen=True)
class Contour:
    """Deviation from a path at every instant.

    Attributes:
        normal: From the nearest point of the path to the tool's tip, (n, 3) m in the workpiece.
        along: Length of path between the programmed place and the nearest point, (n,) m; negative where the tip is
            behind.
        tangent: Direction of the path at the nearest point, (n, 3).
    """

    normal: np.ndarray
    along: np.ndarray
    tangent: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """Length of the normal deviation, (n,) m."""
        return np.linalg.norm(self.normal, axis=1)


def contour(
    path: np.ndarray, actual: np.ndarray, at: np.ndarray | None = None, spans: np.ndarray | None = None
) -> Contour:
    """The deviation of a motion from its path.

    Args:
        path: Programmed places of the tip, (m, 3) m, so close to each other that it is straight between them.
        actual: Where the tip is at some of these instants, (n, 3) m.
        at: Which instants these are, (n,); nothing: all.
        spans: First and last instant of the path that each of them belongs to, (n, 2); nothing: of all.
    """
    at = np.arange(len(path)) if at is None else at
    n = len(at)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    # places of the path by its length: stretches where it rests count once
    keep = np.concatenate([[True], np.diff(length) > 1e-12])
    s, points = length[keep], path[keep]
    if len(s) < 2:
        return Contour(actual - path[at], np.zeros(n), np.tile([1.0, 0.0, 0.0], (n, 1)))
    low, high = length[spans].T if spans is not None else (s[0], s[-1])
    begin = length[at]
    best, found = np.full(n, np.inf), begin.copy()
    # from the programmed place, and from as far behind it as the tip is: at a corner the two lie on different sides
    for start in (begin, begin - np.linalg.norm(actual - path[at], axis=1)):
        place = np.clip(start, low, high)
        for _ in range(_STEPS):
            near, tangent = _place(points, s, place)
            off = actual - near
            size = np.einsum("ni,ni->n", off, off)
            better = size < best
            best, found = np.where(better, size, best), np.where(better, place, found)
            place = np.clip(place + np.einsum("ni,ni->n", off, tangent), low, high)
    near, tangent = _place(points, s, found)
    off = actual - near
    beyond = np.einsum("ni,ni->n", off, tangent)  # of an end of the path; nothing elsewhere
    return Contour(off - beyond[:, None] * tangent, found - begin + beyond, tangent)


def _place(points: np.ndarray, s: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) of a path at lengths ``at`` (n,), and its direction there (n, 3)."""
    k = np.clip(np.searchsorted(s, at, side="right") - 1, 0, len(s) - 2)
    step = points[k + 1] - points[k]
    whole = s[k + 1] - s[k]
    tangent = step / whole[:, None]
    return points[k] + (at - s[k])[:, None] * tangent, tangent


# -- what single errors of the machine do to the tool's tip ------------------------------------------------------------

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


#: What the drives make of curves and corners.
SERVO_LAG = "servo lag"
_ALL = "all axes"


@dataclass(frozen=True)
class Parts:
    """The deviation normal to the path, cause by cause.

    Attributes:
        keys: Of the effects; :data:`SERVO_LAG` is the last one.
        axes: Letter of the axis that each belongs to.
        parts: (causes, n, 3) m; they add up to the deviation.
        along: Each one's share of the deviation's size, signed, (causes, n) m; they add up to the size.
    """

    keys: tuple[str, ...]
    axes: tuple[str, ...]
    parts: np.ndarray
    along: np.ndarray

    @classmethod
    def of(cls, influence: Influence, found: Contour) -> Parts:
        """Of a machine's deviation from a path."""
        chain = influence.run.chain
        effects = [e for e in influence.machine.effects if not e.is_neutral]
        own = [-across(found, influence.change(e, None)) for e in effects]
        parts = np.stack([*own, found.normal - sum(own, np.zeros_like(found.normal))])
        size = found.size
        direction = found.normal / np.where(size > 0.0, size, 1.0)[:, None]
        axes = [axis_of_subject(e.subject, chain) or _ALL for e in effects]
        keys = (*(e.key for e in effects), SERVO_LAG)
        return cls(keys, (*axes, _ALL), parts, np.einsum("cni,ni->cn", parts, direction))

    def causes(self, worst: int) -> tuple[Cause, ...]:
        """Every cause, the largest first; ``worst`` is the instant of the largest deviation."""
        rows = zip(self.keys, self.axes, self.parts, self.along[:, worst], strict=True)
        out = [Cause(key, axis, _rms(part), float(share)) for key, axis, part, share in rows]
        return tuple(sorted(out, key=lambda c: -c.rms))

    def by_axis(self, worst: int) -> tuple[Cause, ...]:
        """The same with all causes of an axis together."""
        out = []
        for axis in dict.fromkeys(self.axes):
            mine = [k for k, a in enumerate(self.axes) if a == axis]
            name = SERVO_LAG if [self.keys[k] for k in mine] == [SERVO_LAG] else axis
            part = self.parts[mine].sum(axis=0)
            out.append(Cause(name, axis, _rms(part), float(self.along[mine, worst].sum())))
        return tuple(sorted(out, key=lambda c: -c.rms))

    def main(self, at: int) -> tuple[str, float]:
        """The cause that adds most to the deviation at one instant, and its share there, m."""
        k = int(np.argmax(self.along[:, at]))
        return self.keys[k], float(self.along[k, at])


def across(found: Contour, change: np.ndarray) -> np.ndarray:
    """The part of changes (n, 3, …) that is normal to the path."""
    along = np.einsum("ni...,ni->n...", change, found.tangent)
    return change - np.einsum("n...,ni->ni...", along, found.tangent)


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.einsum("ni,ni->n", x, x))))
