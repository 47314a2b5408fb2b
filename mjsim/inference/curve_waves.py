"""A table that is not round pushes what it carries along the radius on which it stands, as it passes the same place of
the machine: a curve of the axis' position, to which the angle of the ball about the axis adds.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mjsim.inference.curve_terms import RADIAL, ROUND, TABLE, CurveTerm, CurveTerms, HatColumns, unit_of
from mjsim.machine.axis import radius_of

#: Knots of the curve, rad.
_KNOTS = np.arange(72) * (2.0 * np.pi / 72)


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
