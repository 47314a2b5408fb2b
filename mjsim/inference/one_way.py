"""Effects that act in one direction of motion only, such as a worm wheel that is worn on one flank.

They are no seeds of their own: where one direction has a dent, the same dent in both explains about half of it, so that the best seeds
of the whole effect say where to look.
"""

from __future__ import annotations

import numpy as np

from mjsim.inference.criteria import THRESHOLD
from mjsim.inference.fit import Fit
from mjsim.inference.signatures import Candidate, Projector, SignatureBank

Row = tuple[float, np.ndarray, Candidate]

#: Seeds of one effect that are tried in each direction, the best first, and what acting in both they must explain.
_SEEDS, _LEAST = 3, 0.5 * THRESHOLD


def one_way_rows(fit: Fit, bank: SignatureBank, rows: list[Row]) -> list[Row]:
    """Gain, coefficients and candidate in each direction of motion, for the best of ``rows`` (best first) of every effect that knows
    directions. A direction in which the model has the effect already is left out."""
    have = {e.key for e in fit.machine.effects}
    projector, tried, out = Projector(fit), {}, []
    for gain, _, c in rows:
        if gain < _LEAST:
            break
        ways = [e for e in c.effect.one_way() if e.key not in have]
        if not ways or tried.setdefault(c.id, 0) >= _SEEDS:
            continue
        tried[c.id] += 1
        for effect in ways:
            candidate = Candidate(effect, c.names)
            out.append((*projector.gain(bank.problem.whiten(bank.columns(candidate))), candidate))
    return out
