"""Signatures: what each candidate effect would add to the readings, whitened, at the present model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from mjsim.effects import registry
from mjsim.inference.data_sheet import calibrated
from mjsim.inference.design import Design
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.fit import Fit
from mjsim.inference.linearisation import Linearisation, OfTest
from mjsim.inference.problem import Problem
from mjsim.inference.samples import GRID_STEPS
from mjsim.io.cache import remembered
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine, build

_SMALL = 0.05  # of a typical size
#: How far beyond its bounds, in typical sizes, a linear estimate may lie.
_SLACK = 0.02
#: Candidates that one thread computes in a row: the more, the less the threads wait for one another.
_TOGETHER = 8


@dataclass
class Candidate:
    """One effect that could be missing, at one starting point.

    Attributes:
        effect: at its seed. names: what is free.
    """

    effect: Effect
    names: tuple[str, ...]

    @property
    def id(self) -> str:
        return self.effect.id

    def at_another_order(self, present: Effect) -> bool:
        """Whether it is an error motion of other cycles per turn than ``present``, an effect of the same key."""
        return "order" not in self.names and self.effect.values.get("order") != present.values.get("order")


#: A candidate with its whitened columns (count, k), and one with the gain of these.
Offer = tuple[Candidate, np.ndarray]
Row = tuple[float, Candidate]


def seeds(machine: Machine) -> list[Candidate]:
    """Starting points of the whole catalogue (and the user's effects in the machine), scanned families left out."""
    given = {e.id for e in machine.effects}
    return [
        c
        for kind, cls in registry.kinds_of(machine.effects).items()
        if not cls.for_logs
        for subject in cls.subjects_of(machine.chain)
        if f"{kind}.{subject}" in given or kind in machine.tolerance or not cls.search.within_tolerance
        for c in seeds_of(cls, subject, machine)
    ]


def seeds_of(cls: type[Effect], subject: str, machine: Machine) -> list[Candidate]:
    """Starting points of one effect; none of a scanned family."""
    hints, effect_id, parameters = cls.search, f"{cls.kind}.{subject}", cls.parameters_of(subject)
    if hints.scanned:
        return []
    names = hints.free_of(parameters)
    out, mine = [], [e for e in machine.effects if e.id == effect_id]
    for present in mine:
        out += [Candidate(present, names), *(Candidate(e, n) for e, n in hints.variants(present))]
    # one that acts in one direction leaves room for the other, one that follows a sensor for those of others
    missing = (cls(subject, **v) for v in hints.seeds_of(parameters, subject, machine.chain, machine.sensors))
    return out + [Candidate(e, names) for e in missing if all(e.key != have.key for have in mine)]


def feasible_share(machine: Machine, x: np.ndarray, c: Candidate) -> float:
    """Up to which share of itself, 0 to 1, the linear estimate lies within the parameters' bounds; 0 where it is below
    its least sensible size.
    """
    if c.effect.search.scanned:
        return 1.0
    free = EffectVector(c.effect, c.names)
    if free.polar and free.amplitude is not None:
        p = free.specs[free.amplitude]
        return min(1.0, p.upper / max(float(np.hypot(x[0], x[1])) * p.scale, 1e-30))
    present, share = any(e.key == c.effect.key for e in machine.effects), 1.0
    for value, name in zip(x, (n for n in free.names if present or free.specs[n].neutral is not None), strict=False):
        p = free.specs[name]
        start = p.encode(c.effect.values[name] if present else p.neutral or 0.0)
        low, high = sorted((p.encode(p.lower), p.encode(p.upper)))
        if not low - _SLACK <= start + value <= high + _SLACK:
            share = min(share, ((high if value > 0.0 else low) - start) / value)
        elif c.effect.search.least and abs(p.decode(start + value) - (p.neutral or 0.0)) < c.effect.search.least:
            return 0.0
    return max(0.0, share)


class Bank:
    """Candidates with their columns.

    Attributes:
        candidates: Of the catalogue.
        matrix: Whitened by the campaign's noise alone, (count, n).
        slices: Which columns are those of each candidate.
    """

    def __init__(self, candidates: list[Candidate], matrix: np.ndarray, slices: list[slice]) -> None:
        self.candidates, self.matrix, self.slices = candidates, matrix, slices

    @property
    def own(self) -> list[np.ndarray]:
        """Normal matrices of the candidates' columns, (k, k) each."""
        return [self.matrix[:, s].T @ self.matrix[:, s] for s in self.slices]

    def forget(self) -> None:
        """Give back the memory of the signatures, some 100 MB for 13 tests: nobody asks for them any more."""
        self.candidates, self.slices, self.matrix = [], [], self.matrix[:, :0].copy()


class SignatureBank(Bank):
    """Computes whitened signatures at one fitted model and keeps them.

    Signatures of quasi-static effects hardly depend on what else is in the model, so one bank serves a whole diagnosis.
    """

    def __init__(self, problem: Problem, fit: Fit) -> None:
        self.problem, self.fit = problem, fit
        self._machine = fit.machine
        self.linearisation = Linearisation(problem, self._machine, fit.nuisance)
        self.plant, self.loads = self.linearisation.plant, self.linearisation.loads
        self._by_drive: dict[tuple, dict[int, np.ndarray]] = {}
        super().__init__([], np.zeros((problem.count, 0)), [])

    def on(self, problem: Problem) -> SignatureBank:
        """The same on the same samples with another noise."""
        out = SignatureBank(problem, self.fit)
        out.candidates, out.slices = self.candidates, self.slices
        out.matrix = problem.in_this_noise(self.matrix, self.problem)
        return out

    def compute(self, candidates: list[Candidate], done: Callable[[], None] | None = None) -> None:
        """Compute and keep the whitened columns of all candidates."""
        widths = [self.width(c) for c in candidates]
        ends = np.cumsum([0, *widths])
        self.slices = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self.matrix = remembered(
            "signatures", lambda: self._depends_on(candidates), lambda: self._matrix(candidates, done)
        )
        self._by_drive.clear()  # few of these drives are asked for again
        self.candidates = list(candidates)

    def _matrix(self, candidates: list[Candidate], done: Callable[[], None] | None) -> np.ndarray:
        matrix = np.empty((self.problem.count, self.slices[-1].stop if self.slices else 0), order="F")
        for first in range(0, len(candidates), _TOGETHER):
            some, places = candidates[first : first + _TOGETHER], self.slices[first : first + _TOGETHER]
            works = [self.columns_of(c) for c in some]
            self._fill(matrix[:, places[0].start : places[-1].stop], works)
            if done:
                for _ in some:
                    done()
        return matrix

    def whitened(self, candidates: list[Candidate], works: list[OfTest]) -> list[Offer]:
        """Candidates with their whitened columns, which ``works`` compute test by test, before they are whitened."""
        ends = np.cumsum([0, *(self.width(c) for c in candidates)])
        columns = np.empty((self.problem.count, ends[-1]))
        if works:
            self._fill(columns, works)
        return [(c, columns[:, a:b]) for c, (a, b) in zip(candidates, pairwise(ends), strict=True)]

    def _fill(self, out: np.ndarray, works: list[OfTest]) -> None:
        """Whiten what ``works`` compute into ``out``, side by side."""
        self.problem.whiten_each(lambda k: np.hstack([work(k) for work in works]), out)

    def width(self, c: Candidate) -> int:
        """Number of a candidate's columns."""
        return 2 if c.effect.search.scanned else len(self._moves(c)[1])

    def _depends_on(self, candidates: list[Candidate]) -> tuple:
        """Everything that the matrix follows from, for the cache."""
        p, fit = self.problem, self.fit
        model = fit.base, [f.effect for f in fit.effects], fit.sheet_deviation, fit.nuisance
        return (*model, p.tests, p.samples, p.noises, p.local, p.sensitivity, [(c.effect, c.names) for c in candidates])

    def columns(self, c: Candidate) -> list[np.ndarray]:
        """Block-mean signatures per test, (m, k), m per typical size."""
        return self.problem.map(self.columns_of(c))

    def columns_of(self, c: Candidate) -> OfTest:
        """What computes the :meth:`columns` of one test."""
        given, moves = self._moves(c)
        mine = self._machine.effect(c.effect.key)
        # an effect that the fit has put into the model is moved from where it is; one of the machine from its seed
        present = mine is not None and not given and not c.at_another_order(mine)
        free = EffectVector(mine if mine is not None and present else c.effect, c.names)
        if mine is not None and free.is_linear and c.effect.search.quasi_static:
            known = self.linearisation.columns_of(free)
            if known is not None:
                return known
        v = free.vector
        change_of = self.position_change_of if c.effect.search.quasi_static else self._motor_change_of
        works = [
            change_of(free.at(v + move if mine is not None else self._from_neutral(free, v, move))) for move in moves
        ]
        sizes = np.abs(moves).max(axis=1)
        return lambda k: np.column_stack([work(k) for work in works]) / sizes

    def _moves(self, c: Candidate) -> tuple[bool, np.ndarray]:
        """Whether the machine as given has the effect, and the small moves of its vector, one a row, that give its
        columns.

        Where the machine lacks it, only entries count that the reading is linear in: the leading size (and its
        quadrature); shapes come with the refit.
        """
        free = EffectVector(c.effect, c.names)
        given = self.fit.base.effect(c.effect.key) is not None
        every = np.eye(len(free.vector)) * _SMALL
        return given, every if given else every[free.linear]

    @staticmethod
    def _from_neutral(free: EffectVector, v: np.ndarray, move: np.ndarray) -> np.ndarray:
        """Seed vector with its linear entries replaced by the small ``move``: neutral plus one small step."""
        out = v.copy()
        out[free.linear] = free.neutral + move[free.linear]
        return out

    def _motor_change_of(self, effect: Effect) -> OfTest:
        """Change of a drive in one test: only the effect's own axis is simulated again."""
        p, axis = self.problem, effect.subject
        i = p.chain.index(axis)
        drive = build(self._with(effect)).axes[axis]
        kept = self._by_drive.setdefault((axis, *drive.key()), {})

        def change(k: int) -> np.ndarray:
            s, motion = p.samples[k], p.motions[k]
            if not motion.moves[i]:
                return np.zeros(len(s.centre))
            moved = motion.motor_change(axis, self.plant.axes[axis], drive, GRID_STEPS)
            return s.sample(p.sensitivity[k].axes[:, i] * moved, p.shift(k, self.fit.nuisance))

        def one(k: int) -> np.ndarray:
            if k not in kept:
                kept[k] = change(k)
            return kept[k]

        return one

    def _with(self, effect: Effect) -> Machine:
        return calibrated(
            self.fit.base.with_effects([*(f.effect for f in self.fit.effects), effect]), self.fit.sheet_deviation
        )

    def position_change_of(self, effect: Effect) -> OfTest:
        """What computes the change that an effect of positions makes in the block means of one test, (m,) m."""
        if not effect.in_python:
            return self.linearisation.change_of(effect)
        readings = self.problem.readings(build(self._with(effect)))
        return self.problem.difference(self.base_readings, readings, self.fit.nuisance).__getitem__

    @cached_property
    def base_readings(self) -> list[np.ndarray]:
        """Readings of the model itself, on the grid, m."""
        return self.problem.readings(self.plant)


class Projector:
    """Gains of signatures on a fitted model, with everything that is already fitted projected out (priors kept)."""

    def __init__(self, fit: Fit) -> None:
        self.design, self.equations, self.residual = fit.design, fit.linear, fit.residual
        self.step = fit.step  # what a further fit of the present model would still move

    def normal(self, columns: np.ndarray | Design) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix (k, k) of the columns (count, k) after projection, and their score (k,) on the residual."""
        cross = self.design.T @ columns
        return self.equations.left_over(columns.T @ columns, cross), columns.T @ self.residual - cross.T @ self.step

    def gain(self, columns: np.ndarray) -> tuple[float, np.ndarray]:
        """Fall of the objective if the columns were fitted as well, and the coefficients (k,)."""
        matrix, score = self.normal(columns)
        ridge = 1e-9 * np.trace(matrix) / len(matrix) + 1e-6
        x = np.linalg.solve(matrix + ridge * np.eye(len(matrix)), score)
        return float(score @ x), x
