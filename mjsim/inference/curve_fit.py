"""The effects of a model fitted beside a generic curve, so that they take up nothing of what the curve stands for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from mjsim.inference.curve_shape import CurveShape, free_shape, simplest_shape
from mjsim.inference.curve_terms import CurveTerm
from mjsim.inference.fit import Fit, Fitter

#: Most Gauss-Newton steps beside a curve: many where the set-up can do much of what the curve does.
_MOST_STEPS = 8
#: RMS of a step's readings, in units of the noise, below which the model has arrived.
_ARRIVED = 0.05
#: Variance of what a shape does not have, over the sum of all.
_KNOWN = 1e-9
#: Least precision of a curve's prior, of the largest information: what the model takes up whole has none.
_LEAST = 1e-12


def fit_beside_simple(fitter: Fitter, fit: Fit, term: CurveTerm) -> tuple[Fit, CurveTerm, Together]:
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


def _moved(fitter: Fitter, fit: Fit, step: np.ndarray) -> Fit:
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
