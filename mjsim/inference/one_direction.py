"""Effects that act in one direction of motion only, such as a worm wheel that is worn on one flank.

They are no seeds of their own: where one direction has a dent, the same dent in both explains about half of it, so that
the best seeds of the whole effect say where to look. Where the effect is in the model already, what it leaves may be
the difference of the two directions, at its own place.
"""

from __future__ import annotations

from mjsim.inference.fit import Fit
from mjsim.inference.hypotheses import CAUSE
from mjsim.inference.signatures import Candidate, Offer, Row, SignatureBank
from mjsim.machine.effect import Effect

#: Seeds of one effect that are tried in each direction, the best first.
_SEEDS = 3


def in_each_direction(effect: Effect) -> list[Effect]:
    """The same effect acting in one direction of motion only, once per direction; empty where it has one already or
    knows none.
    """
    directions = next((p.choices for p in effect.parameters_of(effect.subject) if p.name == "direction"), ())
    return [] if "direction" in effect.values else [effect.replaced(direction=d) for d in directions]


def one_direction_candidates(fit: Fit, bank: SignatureBank, rows: list[Row]) -> list[Offer]:
    """Candidates in each direction of motion, with their whitened columns: of the fitted effects and the best of
    ``rows`` (best first) of every effect that knows directions. A direction in which the model has the effect is left
    out.
    """
    have = {e.key for e in fit.machine.effects}
    whole = [Candidate(f.effect, f.names) for f in fit.effects if not f.effect.search.scanned]
    tried: dict[str, int] = {}
    for gain, c in rows:
        if gain < -2.0 * CAUSE:  # acting in both directions, it would be there less likely than not
            break
        if in_each_direction(c.effect) and tried.setdefault(c.id, 0) < _SEEDS:
            tried[c.id] += 1
            whole.append(c)
    directed = [
        Candidate(effect, c.names) for c in whole for effect in in_each_direction(c.effect) if effect.key not in have
    ]
    return [(c, bank.problem.whiten(bank.columns(c))) for c in directed]
