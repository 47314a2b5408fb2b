"""Generic terms of one cause that goes round with a rotary axis: a single wave per turn of what the axis displaces.

A free curve has a coefficient at every knot, and evidence charges each of them. A cause that is one wave would lose
against several named effects that imitate it with fewer numbers. As a wave it has two.

A table that is not round pushes what it carries along the radius on which it stands, as it passes the same place of the
machine. So the angle of the ball about the axis adds to the position of the axis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from mjsim.estimation.curve_terms import RADIAL, ROUND, TABLE, CurveTerm, CurveTerms, hats
from mjsim.machine.radius import radius_of
from mjsim.machine.redundant import MOST_ORDERS

#: Knots of the free curve that shows a wave, rad.
_KNOTS = np.arange(72) * (2.0 * np.pi / 72)


@dataclass(frozen=True)
class _Displaced:
    """What a rotary axis may displace as it goes round.

    Attributes:
        axis, moves: as of a generic term.
        angles: of the axis, per test (m,) rad.
        weights: derivatives of the reading, per test (m,).
    """

    axis: str
    moves: str
    angles: list[np.ndarray]
    weights: list[np.ndarray]

    def free(self) -> CurveTerm:
        """The term with a free curve."""
        return self.term(lambda x: hats(x, _KNOTS, 2.0 * np.pi))

    def term(self, basis: Callable[[np.ndarray], np.ndarray], order: int = 0) -> CurveTerm:
        """The term whose displacement is a sum of functions of the angle: ``basis`` gives (m, k) of them."""
        term = CurveTerm(self.axis, self.moves, "position", _KNOTS, 2.0 * np.pi, [], order=order)
        term.columns = [basis(x) * (w * term.unit)[:, None] for x, w in zip(self.angles, self.weights, strict=True)]
        return term


def waves(terms: CurveTerms) -> Iterator[CurveTerm]:
    """All waves of the axes that go round in some test."""
    for displaced in _displaced(terms):
        for k in range(1, MOST_ORDERS + 1):
            yield displaced.term(lambda x, k=k: np.column_stack([np.cos(k * x), np.sin(k * x)]), k)


def radial_curves(terms: CurveTerms) -> Iterator[CurveTerm]:
    """Free curves of the work along the ball's radius, for the axes that go round."""
    for displaced in _displaced(terms):
        if displaced.moves == RADIAL:
            yield displaced.free()


def free_curve(terms: CurveTerms, wave: CurveTerm) -> CurveTerm:
    """The free curve of what a wave displaces."""
    displaced = next(d for d in _displaced(terms) if (d.axis, d.moves) == (wave.axis, wave.moves))
    return displaced.free()


def _displaced(terms: CurveTerms) -> Iterator[_Displaced]:
    """What the axes that go round may displace: linear axes, and the work along the ball's radius."""
    chain = terms.chain
    for axis in chain.rotary:
        turn = terms.loads(axis)
        if max(np.ptp(x) for x in turn) < ROUND:
            continue
        for moves in chain.linear:
            yield _Displaced(axis, moves, turn, [s[moves] for s in terms.sensitivities])
        for table in chain.turning[:1]:  # the ball stands on the first one
            if table.letter == axis:
                places = [radius_of(table, np.asarray(t.table_ball)) for t in terms.problem.tests]
                angles = [x + angle for x, (angle, _) in zip(turn, places, strict=True)]
                weights = [
                    np.column_stack([s[name] for name in TABLE]) @ outwards
                    for s, (_, outwards) in zip(terms.sensitivities, places, strict=True)
                ]
                yield _Displaced(axis, RADIAL, angles, weights)
