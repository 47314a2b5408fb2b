"""A generic curve beside the effects of a model, which then take up nothing of what the curve stands for.

A free curve has hundreds of numbers. Fitted beside the many small errors of a machine it takes up some of what they do,
and other tests are then predicted wrong. A cause with a simple shape needs few numbers: few steps, few bends or few
waves. The evidence says which shape is enough: each step, bend or wave that a curve has must be needed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mjsim.inference.curve_terms import CurveTerm
from mjsim.inference.fit import Fit
from mjsim.inference.linear_evidence import Columns, LinearEvidence
from mjsim.inference.problem import Problem
from mjsim.inference.search import DataFitter
from mjsim.inference.unknown_curves import WIDTHS

#: Share of the largest change or wave of a curve below which another is not told (assumed).
_NOTABLE = 0.05
#: Most Gauss-Newton steps beside a curve: many where the set-up can do much of what the curve does.
_MOST_STEPS = 8
#: RMS of a step's readings, in units of the noise, below which the model has arrived.
_ARRIVED = 0.05
#: Variance of what a shape does not have, over the sum of all.
_KNOWN = 1e-9
#: Least precision of a curve's prior, of the largest information: what the model takes up whole has none.
_LEAST = 1e-12


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


def fit_beside_simple(fitter: DataFitter[Problem], fit: Fit, term: CurveTerm) -> tuple[Fit, CurveTerm, Together]:
    """The model and a curve where both lie when they are fitted together, the curve in the simplest shape that the data
    allow. The curve is no part of the model, so the model's residuals show it in full. The covariance allows for it.

    What the set-up and the curve can both do may move between them without end. So the curve is the one beside the
    model as it stands, and of all models the one is taken that leaves least with it.
    """
    columns, misfit = fitter.problem.whiten(term.columns), fit.sum_squares / fitter.problem.count
    shape = partial(simplest_shape, closed=term.period is not None)
    together = Together(fit, columns, max(1.0, misfit), shape)
    best = fit, together
    for _ in range(_MOST_STEPS):
        if np.sqrt(np.mean(np.square(fit.design @ together.step))) < _ARRIVED:
            break
        fit = _moved(fitter, fit, together.step)
        together = Together(fit, columns, max(1.0, together.misfit), shape)
        best = min(best, (fit, together), key=lambda b: b[1].left)
    fit, together = best
    curve = replace(term, coefficients=together.standing, precision=together.precision, shape=together.shape.name)
    return replace(fit, step=together.step, equations=together.equations), curve, together


def _moved(fitter: DataFitter[Problem], fit: Fit, step: np.ndarray) -> Fit:
    """The model moved by a step, evaluated and linearised."""
    moved = fit.moved(step)
    return fitter.fit(moved.effects, start=moved, iterations=0, exact=True, fresh=False)


class Together:
    """The linear problem of a model and the columns (n, k) of a curve.

    Attributes:
        shape: Of the curve.
        step: Gauss-Newton step of the model's parameters, (p,).
        equations: Of the parameters once the curve is marginalised.
        coefficients: Of the curve once the step is taken, (k,).
        standing: Of the curve beside the model as it stands, (k,).
        information: About the sizes of what the curve is a sum of, beside the model, (j, j).
        misfit: Mean square of what is left once the step is taken, in units of the noise.
        left: The same beside the model as it stands.
        objective: -2 log evidence of the curve beside the model, but for what all models share.
    """

    def __init__(
        self,
        fit: Fit,
        columns: np.ndarray,
        weight: float = 1.0,
        shape: Callable[[np.ndarray, np.ndarray], CurveShape] = free_shape,
    ) -> None:
        """``weight`` is how often priors count: what is not explained counts as noise. ``shape`` is that of the curve,
        from the information and the score that the data hold about its coefficients.
        """
        linear = replace(fit.linear, weight=weight)
        own, cross = columns.T @ columns, fit.design.T @ columns
        score, gradient = columns.T @ fit.residual, fit.design.T @ fit.residual
        beside = linear.left_over(own, cross)
        alone = linear.step(gradient, fit.vector)
        self.shape = shape(beside / weight, (score - cross.T @ alone) / weight)
        part = self.shape.columns
        precision = np.maximum(self.shape.precision * weight, _LEAST * own.max())
        if self.shape.name != "free":  # a free curve is the sum of its knots, of which there are hundreds
            own, cross, score, beside = part.T @ own @ part, cross @ part, part.T @ score, part.T @ beside @ part
        self.information = beside + np.diag(precision)
        taken = np.linalg.solve(own + np.diag(precision), np.column_stack([cross.T, score]))
        self.equations = replace(linear, normal=linear.normal - cross @ taken[:, :-1])
        self.step = self.equations.step(gradient - cross @ taken[:, -1], fit.vector)
        sizes = taken[:, -1] - taken[:, :-1] @ self.step
        self.coefficients, self.standing = part @ sizes, part @ taken[:, -1]
        self.misfit = float(np.mean((fit.residual - fit.design @ self.step - columns @ self.coefficients) ** 2))
        self.left = float(np.mean((fit.residual - columns @ self.standing) ** 2))
        flexibility = np.linalg.slogdet(self.information)[1] - np.log(precision).sum()
        prior = linear.parameters.penalty(fit.vector + self.step) + float(precision @ sizes**2)
        self.objective = self.misfit * len(fit.residual) + prior + flexibility

    @property
    def precision(self) -> np.ndarray:
        """Inverse covariance of the curve's coefficients, (k, k). What a shape does not have is known to be nothing."""
        if self.shape.name == "free":
            return self.information
        part = self.shape.columns
        covariance = part @ np.linalg.solve(self.information, part.T)
        return np.linalg.inv(covariance + _KNOWN * np.trace(covariance) * np.eye(len(part)))
