"""The effects of a model fitted beside a generic curve, so that they take up nothing of what the curve stands for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from mjsim.estimation.curve_shape import CurveShape, free_shape, simplest_shape
from mjsim.estimation.curve_terms import CurveTerm
from mjsim.estimation.fit import Fit, Fitter

#: Most Gauss-Newton steps beside the curve. Where the set-up can do much of what the curve does, it needs some.
_STEPS = 8
#: RMS of a step's readings, in units of the noise, below which the model has arrived.
_ARRIVED = 0.05
#: A step is not taken where it leaves so many times the mean square that it promised.
_WORSE = 2.0


def fit_beside(
    fitter: Fitter, fit: Fit, term: CurveTerm, steps: int = _STEPS, simple: bool = False
) -> tuple[Fit, CurveTerm, Together]:
    """The model and the curve where both lie when they are fitted together.

    The curve is no part of the model, so the model's residuals show it in full. The covariance allows for it.

    Args:
        fitter: Of the machine.
        fit: The model fitted without the curve.
        term: The curve, with its columns.
        steps: Gauss-Newton steps at most.
        simple: Whether the curve has the simplest shape that the data allow. Otherwise it is free at every knot.

    Returns:
        The model, the curve, and the linear problem of both.
    """
    columns, misfit = fitter.problem.whiten(term.columns), fit.sum_squares / fitter.problem.count
    shape = partial(simplest_shape, closed=term.period is not None) if simple else free_shape
    together = Together(fit, columns, max(1.0, misfit), shape)
    for _ in range(steps):
        if np.sqrt(np.mean(np.square(fit.design @ together.step))) < _ARRIVED:
            break
        moved = fit.moved(together.step)
        moved = fitter.fit(moved.effects, start=moved, iterations=0, exact=True, fresh=False)
        beside = Together(moved, columns, max(1.0, together.misfit), shape)
        if beside.misfit > _WORSE * together.misfit:
            break  # the step went where the model is not linear any more
        fit, together = moved, beside
    curve = replace(term, coefficients=together.coefficients, precision=together.information, shape=together.shape.name)
    return replace(fit, step=together.step, equations=together.equations), curve, together


class Together:
    """The linear problem of a model and the columns (n, k) of a curve.

    Attributes:
        shape: Of the curve.
        step: Gauss-Newton step of the model's parameters, (p,).
        equations: Of the parameters once the curve is marginalised.
        coefficients: Of the curve, (k,).
        information: That the data hold about them beside the model, (k, k).
        misfit: Mean square of what is left, in units of the noise.
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
        precision = self.shape.precision * weight
        self.information = beside + precision
        taken = np.linalg.solve(own + precision, np.column_stack([cross.T, score]))
        self.equations = replace(linear, normal=linear.normal - cross @ taken[:, :-1])
        self.step = self.equations.step(gradient - cross @ taken[:, -1], fit.vector)
        self.coefficients = taken[:, -1] - taken[:, :-1] @ self.step
        left = fit.residual - fit.design @ self.step - columns @ self.coefficients
        self.misfit = float(np.mean(left**2))
        flexibility = np.linalg.slogdet(self.information)[1] - np.linalg.slogdet(precision)[1]
        prior = linear.parameters.penalty(fit.vector + self.step) + float(
            self.coefficients @ precision @ self.coefficients
        )
        self.objective = float(left @ left) + prior + flexibility
