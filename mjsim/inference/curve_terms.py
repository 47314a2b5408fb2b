"""Generic terms: a free curve of one variable of one axis, displacing that axis, another one, or the table.

They stand for causes that nobody listed. Displacements of other axes are included because machines do that: a slide's
acceleration yaws its neighbour, a float of the table lifts the work. A table that is not round pushes what it carries
along the radius on which it stands, as it passes the same place of the machine: a curve of the axis' position, to which
the angle of the ball about the axis adds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.sparse import block_diag, csr_array, hstack

from mjsim.inference.fit import Fit
from mjsim.inference.problem import Problem
from mjsim.inference.samples import GRID, GRID_STEPS
from mjsim.inference.variables import SINCE, STROKE, VARIABLES, Variable
from mjsim.machine.axis import radius_of
from mjsim.machine.chain import is_rotary
from mjsim.machine.model import build
from mjsim.machine.plant import Motion
from mjsim.simulation.tracker import MotionTracker
from mjsim.units import UM

_PER_TURN = 24  # of a rotary axis' position counted over all turns
_FINE = 720  # of one turn, where single teeth are to be seen
_PER_TOOTH = 4  # where the size of its wave is what changes
_IN_LEAD = 12  # of a linear axis' position within one turn of its screw
#: A rotary axis that covers as much goes round, rad.
ROUND = 1.9 * np.pi
#: Periods of the clock that are tried, s.
_CLOCK_PERIODS = np.geomspace(15.0, 900.0, 60)
#: Directions of the table ball in the work frame.
TABLE = ("table x", "table y", "table z")
#: From the table's axis to the ball.
RADIAL = "table radial"
#: What moves where a structure rings: see :mod:`mjsim.inference.resonance`.
STRUCTURE = "structure"
#: What a coefficient of 1 is: 10 µrad or 1 µm.
ROTARY_UNIT, LINEAR_UNIT = 1e-5, UM
#: A curve is looked at with so many times the knots: one that may have small details, and any other.
_FINER, _SMOOTHER = (2, 4, 8, 16), (2, 4)
#: Knots of the curve, rad.
_KNOTS = np.arange(72) * (2.0 * np.pi / 72)


def unit_of(moves: str) -> float:
    """Size of a coefficient of 1 of a curve that displaces ``moves``, m or rad."""
    return ROTARY_UNIT if is_rotary(moves) else LINEAR_UNIT


@dataclass
class CurveTerm:
    """One generic term.

    Attributes:
        axis: whose motion it depends on (empty for the clock). moves: the axis that it displaces, one of
            :data:`TABLE`, :data:`RADIAL`, or :data:`STRUCTURE`.
        variable: as in the JSON of diagnose. knots: (k,) of the variable, SI. period: of the variable, SI, or ``None``.
        columns: per test (m, k) block means, m per unit of :attr:`unit`; of a wave twice as many as there are knots.
        signed: times the direction of motion.
        turns: where it :attr:`settles`, when the axis turns back in each test, s from the start of its trace.
        gain, coefficients (k,), their inverse covariance ``precision`` (k, k): of the fit, once it is made. shape: what
            the coefficients follow, as in :mod:`mjsim.inference.curve_fit`.
    """

    axis: str
    moves: str
    variable: str
    knots: np.ndarray
    period: float | None
    columns: Columns
    gain: float = 0.0
    coefficients: np.ndarray = field(default_factory=lambda: np.zeros(0))
    precision: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    shape: str = "free"
    turns: tuple[np.ndarray, ...] = ()

    @property
    def signed(self) -> bool:
        return VARIABLES[self.variable].is_signed

    @property
    def settles(self) -> bool:
        """Whether its curve ends at zero: what stays long after a reversal is play."""
        return self.variable == SINCE

    @property
    def mode(self) -> tuple[float, float] | tuple[()]:
        """Frequency, Hz, and damping ratio of a mode of the structure; empty for a curve."""
        return self.columns.mode if isinstance(self.columns, SwingColumns) else ()

    @property
    def found_at(self) -> float:
        """Frequency at which a mode was found first, Hz; 0 for a curve."""
        return self.columns.found_at if isinstance(self.columns, SwingColumns) else 0.0

    @property
    def unit(self) -> float:
        """Size of a coefficient of 1, m or rad."""
        return unit_of(self.moves)

    @property
    def axes(self) -> tuple[str, ...]:
        """The axes concerned: where it comes from, and what it moves if that is another axis."""
        own = (self.axis,) if self.axis else ()
        return own if self.moves in (self.axis, *TABLE, RADIAL, STRUCTURE) else (*own, self.moves)


class CurveTerms:
    """Makes generic terms for one fitted model: the variables of every test, as the motors move the axes. A cause knows
    nothing of the command, which a drive follows late.
    """

    def __init__(self, problem: Problem, fit: Fit) -> None:
        self.problem, self.fit, self.chain = problem, fit, problem.chain
        self.plant = build(fit.machine)
        self.sensitivities = problem.map(self._sensitivity)
        self._turns: dict[str, tuple[np.ndarray, ...]] = {}

    @cached_property
    def on_grid(self) -> list[Motion]:
        """Motion of every test on the GRID."""
        return self.problem.map(self._on_grid)

    def _on_grid(self, k: int) -> Motion:
        m = self.problem.motions[k]
        tracker = MotionTracker(GRID, m.test.started, self.plant, m.test.table_ball)
        motors = [m.motor(a, self.plant.axes[a], GRID_STEPS) for a in self.chain.letters]
        out = tracker.follow(m.time[::GRID_STEPS], np.column_stack(motors))
        # the tracker's rates are those of half a step before, its accelerations those of a whole step
        return replace(
            out,
            velocity=0.5 * (out.velocity + _next(out.velocity)),
            acceleration=_next(out.acceleration),
            torque=0.5 * (out.torque + _next(out.torque)),
        )

    @cached_property
    def motions(self) -> list[Motion]:
        """The same as block means."""
        made = self.on_grid
        return self.problem.map(lambda k: self._motion(k, made[k]))

    def _motion(self, k: int, fine: Motion) -> Motion:
        s, shift = self.problem.samples[k], self._shift(k)
        sampled = {n: x for n, x in vars(fine).items() if n not in ("axes", "ball", "time", "clock")}
        means = {n: np.column_stack([s.sample(column, shift) for column in x.T]) for n, x in sampled.items()}
        time = s.centre - shift
        return replace(fine, time=time, clock=self.problem.tests[k].started + time, **means)

    def _shift(self, k: int) -> float:
        """What the clock of a test is off, s."""
        return self.problem.shift(k, self.fit.nuisance)

    def _sensitivity(self, k: int) -> dict[str, np.ndarray]:
        s, shift = self.problem.samples[k], self._shift(k)
        return {name: s.sample(self._along(k, name), shift) for name in (*self.chain.letters, *TABLE)}

    def _along(self, k: int, moves: str) -> np.ndarray:
        """Derivative of the reading of a test, on the GRID, by what is displaced."""
        sens = self.problem.sensitivity[k]
        return sens.table[:, TABLE.index(moves)] if moves in TABLE else sens.axes[:, self.chain.index(moves)]

    def moving(self) -> list[str]:
        """Axes that move in some test."""
        return [a for i, a in enumerate(self.chain.letters) if any(m.moves[i] for m in self.problem.motions)]

    def own(self) -> Iterator[CurveTerm]:
        """Terms of an axis in its own direction."""
        for axis in self.moving():
            yield from self.of(axis, axis)
            yield from self.strokes(axis)

    def across(self) -> Iterator[CurveTerm]:
        """Terms that displace something else: linear axes, and for the turning table the work on it."""
        for axis in self.moving():
            for other in self.chain.linear:
                if other != axis:
                    yield from self.of(axis, other)
            if is_rotary(axis):
                for direction in TABLE:
                    yield from self.of(axis, direction)

    def clock(self, waves: bool) -> Iterator[CurveTerm]:
        """Terms of the campaign clock: a free curve, and with ``waves`` those of one period, per linear axis."""
        times = [m.clock for m in self.motions]
        lo, hi = min(t.min() for t in times), max(t.max() for t in times)
        knots = np.linspace(lo, hi, VARIABLES["clock_time"].knots)
        for moves in self.chain.linear:
            yield from self._term("", moves, "clock_time", knots, None, times)
            for period in _CLOCK_PERIODS if waves else ():
                yield from self._term("", moves, "clock_time", np.arange(4) * (period / 4), float(period), times)

    def of(self, axis: str, moves: str) -> Iterator[CurveTerm]:
        """All terms of one axis' motion that displace ``moves``."""
        i = self.chain.index(axis)
        for variable, of in VARIABLES.items():
            if of.along is None or (variable == SINCE and moves != axis):
                continue  # in one swing it is nearly the direction of motion
            x, blocks = self._values(axis, of), [of.along(m, i) for m in self.motions]
            lo, hi = min(v.min() for v in blocks), max(v.max() for v in blocks)
            if hi - lo < 1e-9:
                continue
            count = of.knots if moves == axis else min(of.knots, 18)
            in_turns = variable in ("position", "direction")
            if in_turns and is_rotary(axis) and hi - lo > ROUND:
                yield from self._term(axis, moves, variable, np.arange(count) * (2 * np.pi / count), 2 * np.pi, x)
                turns = (hi - lo) / (2 * np.pi)
                if (
                    variable == "position" and moves == axis and turns > 1.1
                ):  # a count that is not taken modulo one turn
                    yield from self._term(axis, moves, variable, np.linspace(lo, hi, int(_PER_TURN * turns)), None, x)
            else:
                yield from self._term(axis, moves, variable, np.linspace(lo, hi, count), None, x)
            if variable == "position" and axis in self.chain.linear:
                lead = 2 * np.pi / self.fit.base.drives[axis].gear
                if hi - lo > 1.5 * lead:
                    yield from self._term(axis, moves, variable, np.arange(_IN_LEAD) * (lead / _IN_LEAD), lead, x)

    def fine(self, axis: str) -> Iterator[CurveTerm]:
        """The position of a rotary axis in steps of half a degree: waves of single teeth, on a part of the wheel if
        need be. At such a wave the axis lags behind its command by much of a period.
        """
        x = self.loads(axis)
        yield from self._term(axis, axis, "position", *_knots_of_turn(x, _FINE), x)

    def waves(self, axis: str, teeth: float) -> Iterator[CurveTerm]:
        """The wave of a worm wheel's teeth, whose size changes over the position of the axis.

        Args:
            axis: A rotary one.
            teeth: Of its wheel.
        """
        if not self._is_seen(axis):
            return
        x = self.loads(axis)
        knots, period = _knots_of_turn(x, int(_PER_TOOTH * teeth))

        def factor_of(wave: Callable[[np.ndarray], np.ndarray]) -> HatColumns:
            reach = [s[axis] * unit_of(axis) for s in self.sensitivities]
            return HatColumns(x, [w * wave(teeth * v) for w, v in zip(reach, x, strict=True)], knots, period)

        yield CurveTerm(axis, axis, "position", knots, period, WaveColumns(factor_of(np.cos), factor_of(np.sin)))

    def by_values(self, term: CurveTerm) -> CurveTerm:
        """A term whose coefficients are values at knots: the same, or the fine one that follows the waves of teeth."""
        return next(self.fine(term.axis)) if isinstance(term.columns, WaveColumns) else term

    def loads(self, axis: str) -> list[np.ndarray]:
        """Where the load side of an axis is, block means (m,) per test."""
        i = self.chain.index(axis)

        def load(k: int) -> np.ndarray:
            q = self.problem.motions[k].load(self.plant, GRID_STEPS)[:, i]
            return self.problem.samples[k].sample(q, self._shift(k))

        return self.problem.map(load)

    def finer(self, term: CurveTerm, most: int) -> Iterator[CurveTerm]:
        """The same term with more knots, up to ``most``."""
        variable = VARIABLES[term.variable]
        if term.moves == RADIAL or variable.is_counted or (term.period and not term.axis):
            return
        values = self._values(term.axis, variable) if term.axis else [m.clock for m in self.motions]
        for factor in _FINER if variable.is_detailed else _SMOOTHER:
            n, first, last = factor * len(term.knots), term.knots[0], term.knots[-1]
            if n <= most:
                knots = first + np.arange(n) * (term.period / n) if term.period else np.linspace(first, last, n)
                yield from self._term(term.axis, term.moves, term.variable, knots, term.period, values)

    def _term(
        self, axis: str, moves: str, variable: str, knots: np.ndarray, period: float | None, values: list[np.ndarray]
    ) -> Iterator[CurveTerm]:
        if not self._is_seen(moves):
            return
        if VARIABLES[variable].is_slow:
            weights, averages = [s[moves] * unit_of(moves) for s in self.sensitivities], None
        else:
            weights = [self._along(k, moves) * unit_of(moves) for k in range(len(self.on_grid))]
            averages = self.averages
        if VARIABLES[variable].is_signed:
            i = self.chain.index(axis)
            weights = [w * np.sign(m.velocity[:, i]) for w, m in zip(weights, self.on_grid, strict=True)]
        columns = HatColumns(values, weights, knots, period, averages)
        turns = self.turns(axis) if variable == SINCE else ()
        yield CurveTerm(axis, moves, variable, knots, period, columns, turns=turns)

    def turns(self, axis: str) -> tuple[np.ndarray, ...]:
        """When an axis turns back in each test, (turns,) s from the start of its trace."""
        if axis not in self._turns:
            column = self.chain.index(axis)
            turned = [m.time - m.since_reversal[:, column] for m in self.on_grid]
            self._turns[axis] = tuple(t[1:][np.diff(t) > 0.5 * GRID] + self._shift(k) for k, t in enumerate(turned))
        return self._turns[axis]

    def strokes(self, axis: str) -> Iterator[CurveTerm]:
        """Where an axis stands from one reversal to the next, each time anew: a seat that a reversal changes, but not
        each reversal alike. Such a thing does not repeat with the path.
        """
        turns = self.turns(axis)
        first = np.cumsum([0, *(len(t) + 1 for t in turns)])
        if not self._is_seen(axis) or first[-1] == len(turns):
            return
        weights = [self._along(k, axis) * unit_of(axis) for k in range(len(turns))]
        times = [m.time + self._shift(k) for k, m in enumerate(self.on_grid)]
        numbers = [n + np.searchsorted(t, time, side="right") for n, t, time in zip(first, turns, times, strict=False)]
        ends = [[time[0], *np.repeat(t, 2), time[-1]] for t, time in zip(turns, times, strict=True)]
        clock = [test.started + np.reshape(e, (-1, 2)) for test, e in zip(self.problem.tests, ends, strict=True)]
        knots = np.arange(first[-1])
        columns = StrokeColumns(numbers, weights, knots, None, self.averages, np.vstack(clock), first[1:-1])
        yield CurveTerm(axis, axis, STROKE, knots, None, columns)

    def _is_seen(self, moves: str) -> bool:
        """Whether a reading changes when ``moves`` is displaced."""
        return any(np.abs(s[moves]).max() > 1e-6 for s in self.sensitivities)

    def _values(self, axis: str, variable: Variable) -> list[np.ndarray]:
        """A variable of an axis along every test, as block means or on the GRID."""
        i = self.chain.index(axis)
        assert variable.along is not None
        return [variable.along(m, i) for m in (self.motions if variable.is_slow else self.on_grid)]

    @cached_property
    def averages(self) -> Averages:
        """What makes block means of values on the GRID."""
        tests = enumerate(zip(self.problem.samples, self.on_grid, strict=True))
        return Averages([s.averages(len(m.time), self._shift(k)) for k, (s, m) in tests])


@dataclass(frozen=True)
class Averages:
    """What makes block means of values on the GRID.

    Attributes:
        of_tests: Per test, (m, n).
    """

    of_tests: Sequence[csr_array]

    @cached_property
    def together(self) -> csr_array:
        """Of the values of all tests, one test behind the other."""
        return csr_array(block_diag(self.of_tests, format="csr"))


def _knots_of_turn(x: Sequence[np.ndarray], per_turn: int) -> tuple[np.ndarray, float | None]:
    """Knots of a rotary axis' position, rad, and its period where it goes round.

    Args:
        x: Where the axis is, per test, rad.
        per_turn: Knots of a whole turn.
    """
    if max(np.ptp(v) for v in x) > ROUND:
        return np.arange(per_turn) * (2 * np.pi / per_turn), 2 * np.pi
    lo, hi = min(v.min() for v in x), max(v.max() for v in x)
    return np.linspace(lo, hi, int(per_turn * (hi - lo) / (2 * np.pi)) + 2), None


def _next(x: np.ndarray) -> np.ndarray:
    """Each row's next one; the last row stays."""
    return np.vstack([x[1:], x[-1:]])


class Columns(Sequence[np.ndarray], ABC):
    """Columns of a term, those of each test made when they are asked for, (m, k): all would fill hundreds of MB."""

    def __getitem__(self, k: int) -> np.ndarray:  # pyright: ignore[reportIncompatibleMethodOverride]  # no slices
        rows = self.of_test(k)
        return rows if isinstance(rows, np.ndarray) else rows.toarray()

    @abstractmethod
    def of_test(self, k: int) -> csr_array | np.ndarray:
        """The columns of test ``k``, sparse where most of them are zero."""

    @abstractmethod
    def together(self) -> csr_array | np.ndarray:
        """The columns of all tests, one test below the other."""

    @abstractmethod
    def over_the_mean(self, root: np.ndarray, x: np.ndarray) -> np.ndarray:
        """What makes of coefficients how far the term displaces at each knot over the mean of that, (knots, n).

        Args:
            root: What makes the values at the knots of them, (knots, n).
            x: Coefficients near which it is asked for, (n,).
        """


@dataclass(frozen=True)
class HatColumns(Columns):
    """Columns of a free curve.

    Attributes:
        values: of the variable, (m,) per test.
        weights: change of the reading by a coefficient of 1, (m,) per test, m.
        knots, period: as of the term.
        averages: what makes block means of the rows; ``None`` where they are block means.
    """

    values: Sequence[np.ndarray]
    weights: Sequence[np.ndarray]
    knots: np.ndarray
    period: float | None
    averages: Averages | None = None

    def __len__(self) -> int:
        return len(self.values)

    def over_the_mean(self, root: np.ndarray, x: np.ndarray) -> np.ndarray:
        return root - root.mean(axis=0)

    def of_test(self, k: int) -> csr_array:  # a block lies between two knots
        rows = hats(self.values[k], self.knots, self.period, self.weights[k])
        return rows if self.averages is None else csr_array(self.averages.of_tests[k] @ rows)

    def together(self) -> csr_array:
        rows = hats(np.concatenate(self.values), self.knots, self.period, np.concatenate(self.weights))
        return rows if self.averages is None else csr_array(self.averages.together @ rows)


@dataclass(frozen=True)
class StrokeColumns(HatColumns):
    """Columns of what stays from one reversal of an axis to the next. The values are the numbers of the strokes over
    all tests, so that each stroke has the hat of one knot.

    Attributes:
        clock: when each stroke begins and ends on the campaign's clock, (strokes, 2) s.
        first: the first stroke of every test but the first one.
    """

    clock: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    first: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    def over_the_mean(self, root: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Over the mean of each test: where the balls stand is another thing in each."""
        return np.vstack([own - own.mean(axis=0) for own in np.split(root, self.first)])


@dataclass(frozen=True)
class WaveColumns(Columns):
    """Columns of a wave whose size changes from place to place: by the factors of its cosine and of its sine. Values at
    knots would need dozens of these in each period.

    Attributes:
        cosine, sine: of both factors.
    """

    cosine: HatColumns
    sine: HatColumns

    def __len__(self) -> int:
        return len(self.cosine)

    def over_the_mean(self, root: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Of the wave's amplitude: ``root`` makes both factors, (2 knots, n), and ``x`` says the phase."""
        cosine, sine = (factor - factor.mean(axis=0) for factor in np.split(root, 2))
        phase = np.arctan2(sine @ x, cosine @ x)[:, None]
        return np.cos(phase) * cosine + np.sin(phase) * sine

    def of_test(self, k: int) -> csr_array:
        return csr_array(hstack([self.cosine.of_test(k), self.sine.of_test(k)]))

    def together(self) -> csr_array:
        return csr_array(hstack([self.cosine.together(), self.sine.together()]))


@dataclass(frozen=True)
class SwingColumns(Columns):
    """Columns of a mode of the structure: by the acceleration of whatever moves, in every direction.

    Attributes:
        of_tests: Per test, (m, k).
        mode: Frequency, Hz, and damping ratio.
        found_at: Frequency at which it was found first, Hz, before it was moved to a better one.
    """

    of_tests: Sequence[np.ndarray]
    mode: tuple[float, float]
    found_at: float

    def __len__(self) -> int:
        return len(self.of_tests)

    def over_the_mean(self, root: np.ndarray, x: np.ndarray) -> np.ndarray:
        return root  # nothing takes up a mean of that

    def of_test(self, k: int) -> np.ndarray:
        return self.of_tests[k]

    def together(self) -> np.ndarray:
        return np.vstack(self.of_tests)


def hats(x: np.ndarray, knots: np.ndarray, period: float | None, weights: np.ndarray | float = 1.0) -> csr_array:
    """Piecewise-linear basis (n, len(knots)) on equally spaced ``knots``, wrapped when there is a period; rows times
    ``weights`` (n,).
    """
    step = knots[1] - knots[0]
    u = (x - knots[0]) / step
    n = len(knots)
    u = np.mod(u, n) if period else np.clip(u, 0, n - 1)
    i = np.floor(u).astype(int)
    f = (u - i) * weights
    after = (i + 1) % n if period else np.minimum(i + 1, n - 1)
    places = np.column_stack([i % n, after]).ravel()
    return csr_array((np.column_stack([weights - f, f]).ravel(), places, np.arange(0, 2 * len(x) + 1, 2)), (len(x), n))


def radial_curves(terms: CurveTerms) -> Iterator[CurveTerm]:
    """A free curve of the work along the ball's radius, where the table on which the ball stands goes round."""
    for table in terms.chain.turning[:1]:  # the ball stands on the first one
        turn = terms.loads(table.letter)
        if max(np.ptp(x) for x in turn) < ROUND:
            continue
        places = [radius_of(table, np.asarray(t.table_ball)) for t in terms.problem.tests]
        weights = [
            np.column_stack([s[name] for name in TABLE]) @ outwards * unit_of(RADIAL)
            for s, (_, outwards) in zip(terms.sensitivities, places, strict=True)
        ]
        angles = [x + angle for x, (angle, _) in zip(turn, places, strict=True)]
        columns = HatColumns(angles, weights, _KNOTS, 2.0 * np.pi)
        yield CurveTerm(table.letter, RADIAL, "position", _KNOTS, 2.0 * np.pi, columns)
