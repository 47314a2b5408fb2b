"""The simplest shape that the data allow a generic curve: few steps, few bends, few waves, or free at every knot.

A free curve has hundreds of numbers. Fitted beside the many small errors of a machine it takes up some of what they do,
and other tests are then predicted wrong. A cause with a simple shape needs few numbers. The evidence says which shape
is enough: each step, bend or wave that a curve has must be needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.inference.linear_evidence import Columns, LinearEvidence
from mjsim.inference.unknown_curves import WIDTHS

#: Share of the largest change or wave of a curve below which another is not told (assumed).
_NOTABLE = 0.05


@dataclass(frozen=True)
class CurveShape:
    """What a curve is a sum of.

    Attributes:
        name: "free", "steps", "bends" or "waves".
        columns: The steps, bends or waves that it has, (k, j): its value at each knot.
        precision: Prior precisions of their sizes, around zero, (j,).
        log_evidence: Over that of no curve.
    """

    name: str
    columns: np.ndarray
    precision: np.ndarray
    log_evidence: float


def free_shape(information: np.ndarray, score: np.ndarray) -> CurveShape:
    """All coefficients equally likely to be large.

    Args:
        information: That the data hold about the coefficients beside the model, (k, k).
        score: Product of the columns with the residual beside the model, (k,).
    """
    k = len(score)
    (odds,), (width,) = LinearEvidence(information, score, [Columns("free", np.arange(k), 0.0, WIDTHS)]).odds({})
    return CurveShape("free", np.eye(k), np.full(k, width**-2.0), float(odds))


def simplest_shape(information: np.ndarray, score: np.ndarray, closed: bool) -> CurveShape:
    """The shape of largest evidence.

    Args:
        information: As of :func:`free_shape`.
        score: Likewise.
        closed: Whether the curve repeats, so that it can be a sum of waves.
    """
    few = [_few(*form, information, score) for form in _forms(len(score), closed)]
    free = free_shape(information, score)
    return max((free, *(s for s in few if len(s.precision))), key=lambda s: s.log_evidence)


def _forms(k: int, closed: bool) -> list[tuple[str, np.ndarray, list[np.ndarray], int]]:
    """What a curve of ``k`` knots may be a sum of: name, columns (k, k), which of them belong together, and how many of
    the first of these are everywhere: a level, or a straight line. Others are at one place of many, or one of many
    orders.
    """
    i = np.arange(k)
    one_each = [np.array([j]) for j in i]
    steps = np.tril(np.ones((k, k)))
    bends = np.column_stack([np.ones(k), *np.maximum(i - i[:-1, None], 0)])  # a level, and a slope from each knot on
    forms = [("steps", steps, one_each, 1), ("bends", bends, one_each, 2)]
    if closed:
        angle = 2.0 * np.pi * i / k
        orders = [(np.cos(n * angle), np.sin(n * angle)) for n in range(1, (k + 1) // 2)]
        last = [np.cos(np.pi * i)] if k % 2 == 0 else []
        waves = np.column_stack([np.ones(k), *(w for pair in orders for w in pair), *last])
        groups = [np.array([0]), *(np.array([2 * n + 1, 2 * n + 2]) for n in range(len(orders)))]
        forms.append(("waves", waves, [*groups, *([np.array([k - 1])] if last else [])], 1))
    return forms


def _few(
    name: str,
    columns: np.ndarray,
    together: list[np.ndarray],
    everywhere: int,
    information: np.ndarray,
    score: np.ndarray,
) -> CurveShape:
    """The shape of the few ``columns`` that the data need."""
    columns = columns / np.abs(columns).max(axis=0)
    odds = -np.log(max(len(together) - everywhere, 1))  # any of the others may be the one
    linear = LinearEvidence(
        columns.T @ information @ columns,
        columns.T @ score,
        [Columns(f"{name} {j}", at, 0.0 if j < everywhere else odds, WIDTHS) for j, at in enumerate(together)],
    )
    needed = linear.improved({})
    places = np.concatenate([np.zeros(0, int), *(together[j] for j in needed)])
    widths = [np.full(len(together[j]), width) for j, width in needed.items()]
    precision = np.concatenate([np.zeros(0), *widths]) ** -2.0
    return CurveShape(name, columns[:, places], precision, linear.total(needed))


def changes(curve: np.ndarray, closed: bool = False) -> list[tuple[float, float]]:
    """Where a curve of the shape "steps" changes, in knots, and by how much; steps in neighbouring knots are one."""
    difference = np.diff(curve, append=curve[:1] if closed else [])
    places = np.flatnonzero(np.abs(difference) > _NOTABLE * np.abs(difference).max(initial=0.0))
    runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if len(places) else []
    return [(float(np.average(r, weights=np.abs(difference[r]))) + 0.5, float(difference[r].sum())) for r in runs]


def bends(curve: np.ndarray) -> list[float]:
    """Where the slope of a curve of the shape "bends" changes, in knots, by what is notable beside its largest."""
    slope = np.diff(curve)
    least = _NOTABLE * np.abs(slope).max(initial=0.0)
    return [place + 0.5 for place, change in changes(slope) if abs(change) > least]


def orders(curve: np.ndarray) -> list[int]:
    """Periods of the waves of which a closed curve is the sum, largest wave first."""
    size = np.abs(np.fft.rfft(curve))[1:]
    found = np.flatnonzero(size > _NOTABLE * size.max(initial=0.0))
    return [int(n) + 1 for n in found[np.argsort(-size[found])]]
