"""A linear model of all readings, and its evidence for any sizes of what repeats and of the noise.

Columns of parameters and curves are multiplied once, test by test, along the basis of the discrepancy and across it.
For any sizes the products with the inverse covariance between follow from these, and with them the log evidence with
all parameters marginalised. Common errors are columns like those of parameters, which every product is free of.
The largest evidence says the sizes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize
from scipy.sparse import csr_array, hstack

from mjsim.inference.discrepancy import SMALLEST, Discrepancy, Sizes

#: Degrees of freedom of the prior of a test's noise factor: it is known as well as 30 values would tell (assumed).
_KNOWN_NOISE = 30
#: Largest size that is tried, m.
_LARGEST = 1e-3
#: Size from which one is looked for at least, m; how far its logarithm may go in one search, and by how much it is
#: changed for a slope.
_SEEN, _FAR, _NUDGE = 0.03e-6, math.log(30.0), 1e-3
#: Most searches, most steps of each, and the gain below which they end, nats.
_SEARCHES, _STEPS, _NEAR = 4, 25, 0.02


@dataclass(frozen=True)
class ProductsOfTest:
    """Products of the columns of one test, and of the residual behind all of them.

    Attributes:
        at: Places of those that reach the test, (n,).
        gram: Their products with each other, (n, n).
        cross: With the columns of the knots, (n, knots).
        knots: Of the columns of the knots with each other, (knots, knots).
        along: With the basis of the test, (m, n).
        knots_along: Of the knots with it, (m, knots).
    """

    at: np.ndarray
    gram: np.ndarray
    cross: np.ndarray
    knots: np.ndarray
    along: np.ndarray
    knots_along: np.ndarray

    def across(self) -> ProductsOfTest:
        """The same without what lies along the basis."""
        a, b = self.along, self.knots_along
        return replace(self, gram=self.gram - a.T @ a, cross=self.cross - a.T @ b, knots=self.knots - b.T @ b)

    def add_to(self, total: np.ndarray, weight: float) -> None:
        """Add the products to those of all tests, (p, p), the knots behind all else; below the diagonal they are left
        out.
        """
        behind = slice(len(total) - len(self.knots), None)
        total[np.ix_(self.at, self.at)] += weight * self.gram
        total[self.at, behind] += weight * self.cross
        total[behind, behind] += weight * self.knots


class Knots:
    """Columns of the knots of curves, and their products with each other in every test: they are the same as long as
    the curves are, wherever the machine is.

    Args:
        rows: Rows by the values at the knots, whitened by the campaign's noise alone, (count, knots) for each curve,
            the same ones where curves share them.
        tests: Rows of each test.
    """

    def __init__(self, rows: Sequence[csr_array], tests: Sequence[slice]) -> None:
        self._rows = {id(r): r for r in rows}
        numbers = [r.shape[1] for r in self._rows.values()]  # pyright: ignore[reportOptionalSubscript]
        ends = np.cumsum([0, *numbers]).tolist()
        places = {key: slice(a, b) for key, (a, b) in zip(self._rows, pairwise(ends), strict=True)}
        #: Places of the knots of each curve.
        self.places = [places[id(r)] for r in rows]
        self.number = ends[-1]
        self.columns = csr_array(hstack([*self._rows.values()] or [csr_array((tests[-1].stop, 0))]))
        self.of_tests = [self.columns[at] for at in tests]

    @cached_property
    def products(self) -> list[np.ndarray]:
        """Products of the columns with each other in every test, (knots, knots) each."""
        return [(own.T @ own).toarray() for own in self.of_tests]

    def are_of(self, rows: Sequence[csr_array]) -> bool:
        """Whether the curves have the same knots."""
        return [*self._rows] == [*{id(r): r for r in rows}]


class Products:
    """Products of columns with each other, test by test, and along the basis of the discrepancy: all that a linear
    model needs of them for any sizes.

    Args:
        discrepancy: Of the tests.
        columns: Whitened by the campaign's noise alone, (count, p). Their products are kept.
    """

    def __init__(self, discrepancy: Discrepancy, columns: np.ndarray) -> None:
        self.discrepancy, self.blocks = discrepancy, [columns]
        self._knots = Knots([], discrepancy.rows)
        self._curves: list[tuple[slice, np.ndarray]] = []
        self._gram = [columns[at].T @ columns[at] for at in discrepancy.rows]
        self._along = [basis.T @ columns[at] for basis, at in discrepancy.tests]

    @property
    def dense(self) -> int:
        """Number of columns that are no curve's."""
        return sum(b.shape[1] for b in self.blocks)

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.dense + sum(root.shape[1] for _, root in self._curves)

    @property
    def knots(self) -> int:
        """Number of knots of all curves."""
        return self._knots.number

    def with_discrepancy(self, discrepancy: Discrepancy) -> Products:
        """The same for a discrepancy with the same basis, and other common errors."""
        out = copy(self)
        out.discrepancy = discrepancy
        return out

    def along_more(self, discrepancy: Discrepancy) -> Products:
        """The same for a discrepancy whose basis has further directions behind those of this one."""
        out = copy(self)
        out.discrepancy, out._along = discrepancy, []
        for known, (basis, at) in zip(self._along, discrepancy.tests, strict=True):
            out._along.append(np.vstack([known, basis[:, len(known) :].T @ self.blocks[0][at]]))
        return out

    def extended(self, *blocks: np.ndarray) -> Products:
        """The same with further columns behind, in blocks (count, k) each."""
        out = copy(self)
        out.blocks = [*self.blocks, *blocks]
        return out

    def with_curves(self, knots: Knots, roots: Sequence[np.ndarray]) -> Products:
        """The same with the columns of curves behind the others. They would fill hundreds of MB, and are never made.

        Args:
            knots: Of the curves.
            roots: What makes the values at the knots of the coefficients of each curve, (knots, k).
        """
        out = copy(self)
        out._knots, out._curves = knots, [*zip(knots.places, roots, strict=True)]
        return out

    def times(self, x: np.ndarray) -> np.ndarray:
        """All columns times coefficients (p,)."""
        out, first = np.zeros(len(self.blocks[0])), 0
        for columns in self.blocks:
            out += columns @ x[first : first + columns.shape[1]]
            first += columns.shape[1]
        values = np.zeros(self.knots)
        for at, root in self._curves:
            values[at] += root @ x[first : first + root.shape[1]]
            first += root.shape[1]
        return out + self._knots.columns @ values

    def of_test(self, k: int, residual: np.ndarray) -> ProductsOfTest:
        """Products of the columns that reach a test, of the residual and of the knots.

        Args:
            k: The test.
            residual: Whitened by the campaign's noise alone, (count,).
        """
        basis, at = self.discrepancy.basis[k], self.discrepancy.rows[k]
        # set-up and trigger of one test are in no other: only the columns that reach a test are multiplied
        live = np.flatnonzero(np.diag(self._gram[k]))
        first, knots = self.blocks[0][at, live], self._knots.of_tests[k]
        own = np.hstack([*(b[at] for b in self.blocks[1:]), residual[at, None]])
        seen = np.flatnonzero(own.any(axis=0))
        own, across = own[:, seen], first.T @ own[:, seen]
        gram = np.block([[self._gram[k][np.ix_(live, live)], across], [across.T, own.T @ own]])
        return ProductsOfTest(
            np.append(live, self.blocks[0].shape[1] + seen),
            gram,
            np.vstack([(knots.T @ first).T, (knots.T @ own).T]),
            self._knots.products[k],
            np.hstack([self._along[k][:, live], basis.T @ own]),
            (knots.T @ basis).T,
        )

    def of_curves(self, products: np.ndarray) -> np.ndarray:
        """Products (m, width + 1) with all columns and the residual, which is the last, of those (m, dense + 1 + knots)
        where the knots stand behind the residual.
        """
        if not self._curves:
            return products
        own, behind = products[:, : self.dense], products[:, self.dense + 1 :]
        parts = [behind[:, at] @ root for at, root in self._curves]
        return np.hstack([own, *parts, products[:, self.dense, None]])


class LinearModel:
    """A linear model, from which its evidence follows for any sizes of the discrepancy.

    Args:
        products: Of the columns of its parameters, p in all.
        residual: Whitened by the campaign's noise alone, (count,).
        precision: Prior precisions of the parameters, (p,).
        departure: How far they are from their prior means, (p,).
        only: The sizes that it is asked about, where no others are: products of single tests fill hundreds of MB where
            there are many columns, and are not kept then.
    """

    def __init__(
        self,
        products: Products,
        residual: np.ndarray,
        precision: np.ndarray,
        departure: np.ndarray,
        only: Sequence[Sizes] = (),
    ) -> None:
        self.products, self.discrepancy, self.residual = products, products.discrepancy, residual
        self.precision, self.departure = precision, departure
        shared = [c.columns for c in self.discrepancy.common]
        self._all = products.extended(*shared)
        ends = products.dense + np.cumsum([0, *(columns.shape[1] for columns in shared)])
        #: Places of the columns of each common error.
        self._shared = {
            c.name: np.arange(a, b) for c, (a, b) in zip(self.discrepancy.common, pairwise(ends.tolist()), strict=True)
        }
        self._along, self._live, self._across = [], [], []
        factors = {sizes.factor.tobytes(): sizes.factor for sizes in only}
        totals = {key: self._nothing() for key in factors}
        for k in range(len(self.discrepancy.rows)):
            mine = self._all.of_test(k, residual)
            along = np.zeros((len(mine.along), self._all.dense + 1 + products.knots))
            along[:, mine.at], along[:, self._all.dense + 1 :] = mine.along, mine.knots_along
            along = self._all.of_curves(along)
            self._live.append(np.flatnonzero(along.any(axis=0)))
            self._along.append(along[:, self._live[k]])
            across = mine.across()
            for key, factor in factors.items():
                across.add_to(totals[key], factor[k] ** -2.0)
            if not only:
                self._across.append(across)
        self._summed = {key: self._of_all(total) for key, total in totals.items()}

    def _nothing(self) -> np.ndarray:
        """No products yet of columns, residual and knots with each other."""
        return np.zeros((self._all.dense + 1 + self._all.knots,) * 2)

    def _of_all(self, total: np.ndarray) -> np.ndarray:
        """Products of all columns and the residual with each other, of those with the knots in the place of curves."""
        behind = self._all.dense + 1
        total[behind:, :behind] = total[:behind, behind:].T
        return self._all.of_curves(self._all.of_curves(total).T)

    def _noise_alone(self, factor: np.ndarray) -> np.ndarray:
        """Products of columns, common errors and residual across the basis of the discrepancy, where there is only
        noise; kept for the next sizes with the same factors.
        """
        key = factor.tobytes()
        if key not in self._summed:
            total = self._nothing()
            for across, f in zip(self._across, factor, strict=True):
                across.add_to(total, f**-2.0)
            self._summed = {key: self._of_all(total)}
        return self._summed[key]

    def _weighted(self, sizes: Sizes) -> tuple[np.ndarray, float]:
        """Products of columns, common errors and residual with the inverse covariance of noise and discrepancy between,
        and the logarithm of its determinant over that of the campaign's noise.
        """
        nothing, log_det = self.discrepancy.is_nothing(sizes), 0.0
        rows = np.zeros((sum(map(len, self._along)), self._all.width + 1))
        first = 0
        for k, factor in enumerate(sizes.factor):
            log_det += 2.0 * len(self.discrepancy.basis[k]) * math.log(factor)
            along = self._along[k]
            if not nothing:
                covariance = self.discrepancy.covariance(k, sizes.slow, sizes.fast, factor)
                lower = np.linalg.cholesky(covariance + np.eye(len(covariance)))
                log_det += 2.0 * float(np.log(np.diag(lower)).sum())
                # of what lies along the basis, (I + C)^-1 is left
                along = solve_triangular(lower, along, lower=True, check_finite=False)
            rows[first : first + len(along), self._live[k]] = along / factor
            first += len(along)
        return self._noise_alone(sizes.factor) + rows.T @ rows, log_det

    def normal(self, sizes: Sizes) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Products with the inverse covariance between the rows.

        Returns:
            Of the columns with each other, (p, p); with the residual, (p,); of the residual with itself; and the
            logarithm of the covariance's determinant over that of the campaign's noise.
        """
        return self._without_common(sizes)[0]

    def _without_common(
        self, sizes: Sizes
    ) -> tuple[tuple[np.ndarray, np.ndarray, float, float], np.ndarray, np.ndarray]:
        """What :meth:`normal` says; what common errors follow from columns and residual, (shapes, p + 1) m; and the
        variances of their amplitudes beside that, (shapes,) m².
        """
        total, log_det = self._weighted(sizes)
        first, count = self.products.dense, sum(map(len, self._shared.values()))
        others = np.delete(total, slice(first, first + count), axis=0)
        rest = np.delete(others, slice(first, first + count), axis=1)
        follow, variance = np.zeros((count, len(rest))), np.zeros(count)
        sized = ((at, sizes.common.get(name, 0.0)) for name, at in self._shared.items())
        there = [(at, np.full(len(at), size)) for at, size in sized if size]
        if there:
            mine, deviation = map(np.concatenate, zip(*there, strict=True))
            cross = others[:, mine]
            factor = cho_factor(total[np.ix_(mine, mine)] + np.diag(deviation**-2.0), lower=True)
            inverse = cho_solve(factor, np.eye(len(mine)))
            follow[mine - first], variance[mine - first] = inverse @ cross.T, np.diag(inverse)
            log_det += 2.0 * float(np.log(deviation * np.diag(factor[0])).sum())
            rest = rest - cross @ follow[mine - first]
        return (rest[:-1, :-1], rest[:-1, -1], float(rest[-1, -1]), log_det), follow, variance

    def log_evidence(self, sizes: Sizes) -> float:
        """Log evidence of the data with the prior of the sizes."""
        return marginalised(*self.normal(sizes), self.precision, self.departure)[0] + self.discrepancy.log_prior(sizes)

    def _with_slopes(self, sizes: Sizes) -> tuple[float, np.ndarray]:
        """The log evidence, and its slopes by the logarithms of the sizes of common errors, which follow from what the
        data say of their amplitudes (Fisher's identity).
        """
        normal, follow, variance = self._without_common(sizes)
        evidence, step, factor = marginalised(*normal, self.precision, self.departure)
        by_parameters = follow[:, :-1]
        square = (follow @ np.append(-step, 1.0)) ** 2 + variance
        square += np.einsum("ij,ji->i", by_parameters, cho_solve(factor, by_parameters.T))
        first = self.products.dense
        slopes = [
            float(square[at - first].sum()) / sizes.common[name] ** 2 - len(at) for name, at in self._shared.items()
        ]
        return evidence + self.discrepancy.log_prior(sizes), np.array(slopes) + self.discrepancy.prior_slopes(sizes)

    def tuned(self, start: Sizes) -> tuple[Sizes, float]:
        """The sizes of largest evidence, with all parameters marginalised, and that log evidence."""
        # the noise before the sizes: what is outside the basis would drive them up without end
        sizes = self._best_sizes(replace(start, factor=self._noise_factors(start)))
        for _ in range(2):
            before, sizes = sizes, replace(sizes, factor=self._noise_factors(sizes))
            if np.abs(np.log(sizes.factor / before.factor)).max() < 0.02:
                break
            sizes = self._best_sizes(sizes)  # with other noise factors they move little
        return sizes, self.log_evidence(sizes)

    def _best_sizes(self, start: Sizes) -> Sizes:
        """The sizes of the discrepancy of largest evidence at the noise factors of ``start``."""
        names = [*self._shared]

        def of(values: Sequence[float]) -> Sizes:
            return replace(start, slow=values[0], fast=values[1], common=dict(zip(names, values[2:], strict=True)))

        def downhill(x: np.ndarray) -> tuple[float, np.ndarray]:
            here, slopes = self._with_slopes(of(np.exp(x).tolist()))
            own = [self.log_evidence(of(np.exp(x + _NUDGE * (np.arange(len(x)) == i)).tolist())) for i in range(2)]
            return -here, -np.concatenate([(np.array(own) - here) / _NUDGE, slopes])

        known = [start.slow, start.fast, *(start.common.get(n, 0.0) for n in names)]
        least = [_SEEN, _SEEN, *(min(_SEEN, c.usual) for c in self.discrepancy.common)]
        x, low, high = np.log(np.maximum(known, least)), math.log(SMALLEST), math.log(_LARGEST)
        options = {"maxiter": _STEPS, "ftol": _NEAR / max(abs(self.log_evidence(start)), 1.0)}
        for _ in range(_SEARCHES):  # the first slopes lead much too far
            near = np.clip(np.add.outer([-_FAR, _FAR], x), low, high)
            before, x = x, minimize(downhill, x, jac=True, method="L-BFGS-B", bounds=near.T, options=options).x
            if np.abs(x - before).max() < 0.99 * _FAR:
                break
        values = np.exp(x)
        evidence = self.log_evidence(of(values.tolist()))
        for i in range(len(values)):  # what the data do not show is not there
            without = values * (np.arange(len(values)) != i)
            if (other := self.log_evidence(of(without.tolist()))) >= evidence:
                values, evidence = without, other
        return of(values.tolist())

    def rest(self, sizes: Sizes) -> np.ndarray:
        """What the model leaves at its best values, with what repeats in each test but without common errors,
        (count,).
        """
        normal, follow, _ = self._without_common(sizes)
        _, step, _ = marginalised(*normal, self.precision, self.departure)
        left, first = self.residual - self.products.times(step), self.products.dense
        amplitudes = follow @ np.append(-step, 1.0)
        for c in self.discrepancy.common:
            left -= c.columns @ amplitudes[self._shared[c.name] - first]
        return left

    def _noise_factors(self, sizes: Sizes) -> np.ndarray:
        """Each test's noise over the campaign's, from what is left across the basis of its discrepancy, (tests,)."""
        rest = self.rest(sizes)
        out = np.ones(len(self._live))
        for k, (basis, at) in enumerate(self.discrepancy.tests):
            across = rest[at] @ rest[at] - np.square(basis.T @ rest[at]).sum()
            out[k] = math.sqrt((_KNOWN_NOISE + across) / (_KNOWN_NOISE + len(rest[at]) - basis.shape[1]))
        return out


def marginalised(
    gram: np.ndarray,
    score: np.ndarray,
    square: float,
    log_det: float,
    precision: np.ndarray,
    departure: np.ndarray,
) -> tuple[float, np.ndarray, tuple[np.ndarray, bool]]:
    """Log evidence of a linear model with its parameters marginalised, their step, (p,), and the Cholesky factor of
    their posterior precision.

    Args:
        gram: Products of the columns with the inverse covariance between them, (p, p).
        score: Those of the columns with the residual, (p,).
        square: That of the residual with itself.
        log_det: Logarithm of the covariance's determinant.
        precision: Prior precisions of the parameters, (p,).
        departure: How far they are from their prior means, (p,).
    """
    factor = cho_factor(gram + np.diag(precision), lower=True)
    pull = score - precision * departure
    step = cho_solve(factor, pull)
    square = square + precision @ departure**2 - pull @ step
    flexibility = 2.0 * np.log(np.diag(factor[0])).sum() - np.log(precision).sum()
    return -0.5 * float(square + log_det + flexibility), step, factor
