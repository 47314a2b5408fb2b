"""Whitened linear least squares with priors and bounds, through one Cholesky factor of the normal matrix."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from mjsim.inference.design import Design
from mjsim.inference.parameters import Parameters


@dataclass(frozen=True)
class LeastSquares:
    """Linear least squares at one point of the parameters.

    The rows are whitened: their noise has variance 1 and is independent.

    Attributes:
        parameters: Priors, bounds and frozen flags of the entries, p in all.
        normal: ``JᵀJ`` of the whitened design ``J``, (p, p).
        weight: How often informative priors count: the variance of the rows where the model leaves more than noise.
    """

    parameters: Parameters
    normal: np.ndarray
    weight: float = 1.0

    @classmethod
    def of_design(cls, parameters: Parameters, design: np.ndarray | Design, weight: float = 1.0) -> LeastSquares:
        """From a whitened design (rows, p)."""
        return cls(parameters, design.T @ design, weight)

    @cached_property
    def precision(self) -> np.ndarray:
        """Inverse covariance of the estimate, (p, p), where the rows have variance 1. A frozen entry has that of its
        prior.
        """
        free = ~self.parameters.frozen
        return np.where(free[:, None] & free, self.normal, 0.0) + np.diag(self.parameters.precision(self.weight))

    @cached_property
    def factor(self) -> np.ndarray:
        """Lower Cholesky factor of :attr:`precision`, (p, p)."""
        return np.linalg.cholesky(self.precision)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of the estimate, (p, p)."""
        return self.weight * self.solve(np.eye(len(self.normal)))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """``precision⁻¹ right`` of a vector (p,) or columns (p, k)."""
        return cho_solve((self.factor, True), right, check_finite=False)

    def step(self, gradient: np.ndarray, vector: np.ndarray) -> np.ndarray:
        """Gauss-Newton step from a vector, within the bounds.

        Args:
            gradient: ``Jᵀr`` of the whitened residuals ``r``, (p,).
            vector: Present values, (p,).

        Returns:
            The step, (p,): zero for frozen entries.
        """
        p = self.parameters
        right = np.where(p.frozen, 0.0, gradient - p.precision(self.weight) * p.departure(vector))
        step = self.solve(right)
        low, high = p.lower - vector, p.upper - vector
        if ((step >= low) & (step <= high)).all():
            return step
        return self._bounded(right, low, high)

    def _bounded(self, right: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """The step that minimises ``|factorᵀ step - factor⁻¹ right|`` between ``low`` and ``high``."""
        from scipy.optimize import lsq_linear  # slow to load, and few fits reach a bound

        target = solve_triangular(self.factor, right, lower=True, check_finite=False)
        # a value may lie on its bound already, where rounding leaves no room at all
        low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
        room = (high > low) & ~self.parameters.frozen
        step = np.zeros(len(right))
        bounds = (low[room], high[room])
        step[room] = lsq_linear(self.factor.T[:, room], target, bounds, method="bvls").x
        return step

    def gain(self, step: np.ndarray) -> float:
        """Fall of the objective that a step promises, from the minimum of the parabola."""
        return float(step @ self.precision @ step)

    def left_over(self, own: np.ndarray, cross: np.ndarray) -> np.ndarray:
        """Normal matrix (k, k) of further columns once the parameters have taken up what they can.

        Args:
            own: The columns' own normal matrix, (k, k).
            cross: ``Jᵀ`` times the columns, (p, k).
        """
        return own - cross.T @ self.solve(cross)


def ridge_solution(matrix: np.ndarray, right: np.ndarray, ridge: float | np.ndarray) -> np.ndarray:
    """Solution of ``(matrix + diag(ridge)) x = right`` for a positive definite sum.

    Args:
        matrix: Normal matrix, (p, p).
        right: Vector (p,) or columns (p, k).
        ridge: Inverse prior variances, one or (p,).
    """
    factor = np.linalg.cholesky(matrix + np.diag(np.broadcast_to(np.asarray(ridge, float), len(matrix))))
    return cho_solve((factor, True), right, check_finite=False)
