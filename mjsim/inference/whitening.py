"""Errors that are correlated beyond the instrument's noise: by what a model cannot say, by what is marginalised.

A fit wants rows whose errors are independent and have the variance one. The noise model makes such rows of block means.
Where something else adds to the errors along a few directions, as a discrepancy or a curve whose coefficients are
marginalised, each of these directions shrinks by a factor of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

#: Variance beside that of the noise below which a direction is not worth shrinking.
_UNSEEN = 1e-4


@dataclass(frozen=True)
class Whitening:
    """What turns rows with the campaign's noise whitened into rows with independent errors of variance one.

    Attributes:
        factor: Noise of each test over the campaign's, (tests,).
        parts: Per test an orthonormal basis (n, k) and by how much each of its directions shrinks (k,): the errors have
            the variance 1/(1 − shrink)² there. Empty without a discrepancy.
        shared: The same over the rows of all tests, for what is marginalised in all of them; empty without.
        log_det: Logarithm of the determinant of the errors' covariance, over that of the campaign's noise.
    """

    factor: np.ndarray
    parts: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    shared: tuple[np.ndarray, np.ndarray] | tuple[()] = ()
    log_det: float = 0.0

    def of_test(self, k: int, rows: np.ndarray) -> np.ndarray:
        """Whitened rows of test ``k``, (n,) or (n, m); what is shared with other tests is not in it."""
        rows = rows / self.factor[k]
        return rows - _along(*self.parts[k], rows) if self.parts else rows

    def shrunk(self, k: int, n: int) -> np.ndarray:
        """Directions of the ``n`` rows of test ``k`` along which the errors are larger, (n, j), of such lengths that
        the inverse of their covariance is I / factor² less the products of these rows.
        """
        return _lengthened(*self.parts[k]) / self.factor[k] if self.parts else np.zeros((n, 0))

    def shrunk_together(self, count: int) -> np.ndarray:
        """The same of what all tests share, among ``count`` rows that :meth:`of_test` has whitened, (count, j)."""
        return _lengthened(*self.shared) if self.shared else np.zeros((count, 0))

    def undone(self, k: int, rows: np.ndarray) -> np.ndarray:
        """The rows of test ``k`` from which :meth:`of_test` makes ``rows``."""
        if self.parts:
            basis, shrink = self.parts[k]
            rows = rows + _along(basis, shrink / (1.0 - shrink), rows)
        return rows * self.factor[k]

    def of_all(self, rows: np.ndarray) -> np.ndarray:
        """Rows of all tests with what is shared between them whitened as well, (count,) or (count, m)."""
        return rows - _along(*self.shared, rows) if self.shared else rows

    def of_rows(self, slices: Sequence[slice], rows: np.ndarray) -> np.ndarray:
        """Whitened rows of all tests.

        Args:
            slices: Which rows are those of each test.
            rows: Whitened by the campaign's noise alone, (count,) or (count, m).
        """
        out = np.empty_like(rows)
        for k, at in enumerate(slices):
            out[at] = self.of_test(k, rows[at])
        return self.of_all(out)

    def all_undone(self, rows: np.ndarray) -> np.ndarray:
        """The rows from which :meth:`of_all` makes ``rows``."""
        if not self.shared:
            return rows
        basis, shrink = self.shared
        return rows + _along(basis, shrink / (1.0 - shrink), rows)

    def beside(self, columns: np.ndarray) -> Whitening:
        """The whitening with further normal coefficients marginalised.

        Args:
            columns: Whitened by this one, each times its prior standard deviation, (count, m).
        """
        log_det = self.log_det
        if self.shared:  # what is marginalised already, and the new ones, together
            basis, shrink = self.shared
            sizes = np.sqrt((1.0 - shrink) ** -2.0 - 1.0)
            columns = np.hstack([basis * sizes, self.all_undone(columns)])
            log_det += 2.0 * float(np.log1p(-shrink).sum())
        values, vectors = np.linalg.eigh(columns.T @ columns)
        seen = values > _UNSEEN
        values = values[seen]
        basis = columns @ (vectors[:, seen] / np.sqrt(values))
        shrink = 1.0 - 1.0 / np.sqrt(1.0 + values)
        return replace(self, shared=(basis, shrink), log_det=log_det + float(np.log1p(values).sum()))


def _along(basis: np.ndarray, factors: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """``basis diag(factors) basisᵀ rows``."""
    return basis @ (factors * (basis.T @ rows).T).T


def _lengthened(basis: np.ndarray, shrink: np.ndarray) -> np.ndarray:
    """Directions by whose products the inverse of the errors' covariance is less than that of the noise."""
    return basis * np.sqrt(shrink * (2.0 - shrink))


def shrinkage(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Of errors with the covariance I + ``covariance`` (k, k): by how much a direction shrinks, the directions as
    columns, and the logarithm of the determinant. Directions along which it adds next to nothing are left out.
    """
    values, vectors = np.linalg.eigh(covariance)
    values = np.maximum(values, 0.0)
    seen = values > _UNSEEN
    return 1.0 - 1.0 / np.sqrt(1.0 + values[seen]), vectors[:, seen], float(np.log1p(values).sum())
