"""A table that is not round pushes what it carries along the radius on which it stands, as it passes the same place of
the machine: a curve of the axis' position, to which the angle of the ball about the axis adds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mjsim.estimation.curve_terms import RADIAL, ROUND, TABLE, CurveTerm, CurveTerms, HatColumns
from mjsim.machine.radius import radius_of

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
        term = CurveTerm(self.axis, self.moves, "position", _KNOTS, 2.0 * np.pi, [])
        weights = [w * term.unit for w in self.weights]
        term.columns = HatColumns(self.angles, weights, _KNOTS, 2.0 * np.pi)
        return term


def radial_curves(terms: CurveTerms) -> Iterator[CurveTerm]:
    """Free curves of the work along the ball's radius, for the axes that go round."""
    for displaced in _displaced(terms):
        if displaced.moves == RADIAL:
            yield displaced.free()


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
