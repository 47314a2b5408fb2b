"""Correction tables: what is wanted, sampled at the points that a control allows, as it will hold them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjsim.compensation.quadrant import Pulse
from mjsim.compensation.terms import Term
from mjsim.compensation.worth import Left
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import Chain
from mjsim.units import DEG, MM

#: Points per shortest wave that a table gets where it may have them, and fewest with which a wave is still written.
FINE, COARSE = 16, 4
#: Points of a table without waves.
_SMOOTH = 33
_TURN = 2.0 * math.pi


@dataclass(frozen=True)
class Table:
    """Correction of one axis, or of one component error, as a function of the commanded position of one axis.

    Attributes:
        out: Letter of the corrected axis, or the name of a component error (ISO 230-1) of the source.
        source: Letter of the axis on whose position the correction depends.
        positions: Rising positions of the source, (n,) m or rad.
        forward: What is added to the command of ``out`` while the source moves towards larger positions, (n,) m or
            rad.
        reverse: The same for the other direction.
        modulo: Whether the table repeats every turn of the source.
        keys: Effects that it corrects.
    """

    out: str
    source: str
    positions: np.ndarray
    forward: np.ndarray
    reverse: np.ndarray
    modulo: bool = False
    keys: tuple[str, ...] = ()

    @property
    def two_sided(self) -> bool:
        """Whether both directions of motion have values of their own."""
        return not np.array_equal(self.forward, self.reverse)


@dataclass(frozen=True)
class Corrections:
    """What a control is told, as it will hold it: every number is rounded to the digits of its file.

    Attributes:
        chain: The machine's axes.
        backlash: Full width, m or rad, by axis.
        tables: Position-dependent corrections.
        kinematics: Location errors of the rotary axes, m or rad, by name.
        gains: New position gain, 1/s, by axis.
        pulses: Friction (quadrant) compensation, by axis.
        left: What is not corrected, and why.
        notes: Sentences for who types it.
    """

    chain: Chain
    backlash: dict[str, float] = field(default_factory=dict)
    tables: tuple[Table, ...] = ()
    kinematics: dict[str, float] = field(default_factory=dict)
    gains: dict[str, float] = field(default_factory=dict)
    pulses: dict[str, Pulse] = field(default_factory=dict)
    left: tuple[Left, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def empty(self) -> bool:
        """Whether nothing is corrected."""
        return not (self.backlash or self.tables or self.kinematics or self.gains or self.pulses)

    def table(self, out: str, source: str) -> Table | None:
        """The table of one axis by another, or ``None``."""
        return next((t for t in self.tables if (t.out, t.source) == (out, source)), None)


@dataclass(frozen=True)
class Grid:
    """What a control allows of one table.

    Attributes:
        most: Most points.
        decimals: Of values, in mm or degrees.
        place_decimals: Of positions, in mm or degrees.
        modulo: Whether tables of a rotary axis may repeat every turn.
        held: Multiple of which values are, in mm or degrees; 0 for ``decimals``.
    """

    most: int
    decimals: int = 6
    place_decimals: int = 4
    modulo: bool = True
    held: float = 0.0


def scale(chain: Chain, axis: str) -> float:
    """SI per unit of a control's file, mm or degree, of an axis or a component error."""
    return DEG if chain.is_rotary(axis) or any(m.rotation for m in chain.motions if m.name == axis) else MM


def ranges_of(
    tests: Iterable[BallBarTest], chain: Chain, points: Sequence[np.ndarray] = ()
) -> dict[str, tuple[float, float]]:
    """Lowest and highest commanded position of every axis, m and rad: where errors were measured.

    Args:
        tests: Ball-bar tests.
        chain: The machine's axes.
        points: Positions (n, axes) at which the machine stood, m and rad.
    """
    ends = [(q.min(axis=0), q.max(axis=0)) for q in points]
    for test in tests:
        program = Program(test)
        q = program.commands(np.linspace(0.0, program.duration, 1441))
        ends.append((q.min(axis=0), q.max(axis=0)))
    low, high = np.min([e[0] for e in ends], axis=0), np.max([e[1] for e in ends], axis=0)
    return {a: (float(low[i]), float(high[i])) for i, a in enumerate(chain.letters)}


def sampled(
    chain: Chain,
    terms: Sequence[Term],
    range_: tuple[float, float],
    grid: Grid,
    extra: tuple[float, float] = (0.0, 0.0),
) -> tuple[Table | None, list[Left]]:
    """One table of the terms of one pair of axes, and the terms for which its points are too few.

    Args:
        chain: The machine's axes.
        terms: All with the same ``out`` and ``source``.
        range_: Positions of the source that the table covers, m or rad.
        grid: What the control allows.
        extra: Added to the forward and to the reverse values, m or rad, as for a backlash that the table takes over.
    """
    out, source = terms[0].out, terms[0].source
    unit, own = scale(chain, source), scale(chain, out)
    rotary = chain.is_rotary(source)
    modulo = rotary and grid.modulo and all(_repeats(t) for t in terms)
    low, high = (0.0, _TURN) if modulo else range_
    if high - low < 1e-9:
        return None, [Left(t.key, f"{source} stands still in all tests: nothing is known along it") for t in terms]
    shape = _Shape(low / unit, high / unit, grid, modulo)
    finest = shape.places(0.0)
    apart = float(finest[1] - finest[0]) * unit
    kept = [t for t in terms if apart * COARSE <= t.shortest * (1 + 1e-9)]
    left = [
        Left(
            t.key,
            f"a wave of {t.shortest / unit:.4g} {'°' if rotary else 'mm'} is too short for the table: "
            f"its points are {apart / unit:.3g} {'°' if rotary else 'mm'} apart at best, and {COARSE} a wave are "
            f"needed",
        )
        for t in terms
        if t not in kept
    ]
    if not kept:
        return None, left
    shortest = min(t.shortest for t in kept)
    wanted = shortest / FINE if math.isfinite(shortest) else (high - low) / (_SMOOTH - 1)
    places = shape.places(wanted / unit)
    x = places * unit
    values = []
    for sign, more in zip((1.0, -1.0), extra, strict=True):
        v = more - _nodes(kept, x, sign)
        values.append(rounded(v / own, grid) * own)
    if not (values[0].any() or values[1].any()):
        keys = dict.fromkeys(t.key for t in kept)
        return None, left + [Left(k, "smaller than the last digit that the control holds") for k in keys]
    keys = tuple(dict.fromkeys(t.key for t in kept))
    return Table(out, source, x, values[0], values[1], modulo, keys), left


@dataclass(frozen=True)
class _Shape:
    """Where the points of a table may lie: ends in mm or degrees, what the control allows, whether it repeats."""

    low: float
    high: float
    grid: Grid
    modulo: bool

    def places(self, step: float) -> np.ndarray:
        """Points at least ``step`` apart, as near to that as the control allows, (n,) mm or degrees. Zero is one of
        them, so that the reference position can be a point.
        """
        digit = 10.0**-self.grid.place_decimals
        most = self.grid.most - 1
        k = max(1, math.ceil(max(step, (self.high - self.low) / most) / digit - 1e-6))
        if self.modulo:
            turn = round(360.0 / digit)
            while turn % k:
                k += 1
            return np.arange(turn // k + 1) * (k * digit)
        if most < 8:  # so few that the ends matter more than round numbers
            return np.round(np.linspace(self.low, self.high, most + 1), self.grid.place_decimals)
        while True:
            first, last = math.floor(self.low / (k * digit) + 1e-9), math.ceil(self.high / (k * digit) - 1e-9)
            if last - first <= most:
                return np.round(np.arange(first, last + 1) * (k * digit), self.grid.place_decimals)
            k += 1


def _nodes(terms: Sequence[Term], x: np.ndarray, sign: float) -> np.ndarray:
    """Values at the points ``x`` (n,) whose straight lines come nearest to the sum of the errors, (n,)."""
    if len(x) > _SMOOTH:
        return sum((t.error(x, sign) for t in terms), np.zeros(len(x)))
    fine = np.linspace(x[0], x[-1], 20 * (len(x) - 1) + 1)
    hats = np.column_stack([np.interp(fine, x, e) for e in np.eye(len(x))])
    return np.linalg.lstsq(hats, sum((t.error(fine, sign) for t in terms), np.zeros(len(fine))), rcond=None)[0]


def rounded(values: np.ndarray, grid: Grid) -> np.ndarray:
    """Values (n,) in mm or degrees as the control holds them."""
    return np.round(values / grid.held) * grid.held if grid.held else np.round(values, grid.decimals)


def _repeats(t: Term) -> bool:
    """Whether a term has a whole number of periods in a turn of its rotary source."""
    order = t.parameters[1] if math.isfinite(t.shortest) and t.code == 0 else 1.0
    return math.isfinite(t.shortest) and abs(order - round(order)) < 1e-9
