"""The effects of a model fitted beside a generic curve, so that they take up nothing of what the curve stands for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjsim.estimation.curve_terms import CurveTerm
from mjsim.estimation.evidence import best_precision
from mjsim.estimation.fit import Fit, Fitter

#: Gauss-Newton steps beside the curve: its columns hardly change with the model.
_STEPS = 2
#: Prior precision of a curve that the data do not want, over the trace of its information: next to nothing is left.
_WIDEST = 1e6
#: A step is not taken where it leaves so many times the mean square that it promised.
_WORSE = 2.0


def fit_beside(fitter: Fitter, fit: Fit, term: CurveTerm, steps: int = _STEPS) -> tuple[Fit, CurveTerm, Together]:
    """The model and the curve where both lie when they are fitted together.

    The curve is no part of the model, so the model's residuals show it in full. The covariance allows for it.

    Args:
        fitter: Of the machine.
        fit: The model fitted without the curve.
        term: The curve, with its columns.
        steps: Gauss-Newton steps.

    Returns:
        The model, the curve, and the linear problem of both.
    """
    columns, misfit = fitter.problem.whiten(term.columns), fit.sum_squares / fitter.problem.count
    together = Together(fit, columns, max(1.0, misfit))
    for _ in range(steps):
        moved = fit.moved(together.step)
        moved = fitter.fit(moved.effects, start=moved, iterations=0, exact=True, fresh=False)
        beside = Together(moved, columns, max(1.0, together.misfit))
        if beside.misfit > _WORSE * together.misfit:
            break  # the step went where the model is not linear any more
        fit, together = moved, beside
    curve = replace(term, coefficients=together.coefficients, precision=together.information)
    return replace(fit, step=together.step, equations=together.equations), curve, together


class Together:
    """The linear problem of a model and the columns (n, k) of a curve.

    Attributes:
        step: Gauss-Newton step of the model's parameters, (p,).
        equations: Of the parameters once the curve is marginalised.
        coefficients: Of the curve, (k,).
        information: That the data hold about them beside the model, (k, k).
        misfit: Mean square of what is left, in units of the noise.
        objective: -2 log evidence of the curve beside the model, but for what all models share.
    """

    def __init__(self, fit: Fit, columns: np.ndarray, weight: float = 1.0) -> None:
        """``weight`` is how often priors count: what is not explained counts as noise."""
        linear = replace(fit.linear, weight=weight)
        own, cross = columns.T @ columns, fit.design.T @ columns
        score, gradient = columns.T @ fit.residual, fit.design.T @ fit.residual
        beside = linear.left_over(own, cross)
        alone = linear.step(gradient, fit.vector)
        wanted = best_precision(beside / weight, (score - cross.T @ alone) / weight)[0] * weight
        precision = min(wanted, _WIDEST * np.trace(own))
        self.information = beside + precision * np.eye(len(own))
        taken = np.linalg.solve(own + precision * np.eye(len(own)), np.column_stack([cross.T, score]))
        self.equations = replace(linear, normal=linear.normal - cross @ taken[:, :-1])
        self.step = self.equations.step(gradient - cross @ taken[:, -1], fit.vector)
        self.coefficients = taken[:, -1] - taken[:, :-1] @ self.step
        left = fit.residual - fit.design @ self.step - columns @ self.coefficients
        self.misfit = float(np.mean(left**2))
        flexibility = np.linalg.slogdet(self.information)[1] - len(own) * np.log(precision)
        prior = linear.parameters.penalty(fit.vector + self.step) + precision * float(np.sum(self.coefficients**2))
        self.objective = float(left @ left) + prior + flexibility
