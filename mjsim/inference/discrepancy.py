"""What repeats in every revolution and is in no model: a Gaussian process of the path angle in every test.

No model of a machine is complete. Its slides tilt, its modes ring, single teeth stand out. What such things leave in a
test repeats with the path and looks like no noise. A fit that takes it for noise believes its numbers far too much, and
a search explains it by causes that are not there. So every test has a discrepancy ``d``, a sum of harmonics of the path
angle φ with normal amplitudes, and a slow drift over the share ``u`` of the test:

    d(φ) = a₀ + Σ (aₙ cos nφ + bₙ sin nφ) + drift(u, u cos φ, u sin φ, u²),   n = 1 … 48
    Var aₙ = σ_s² S(n; 3, 2) + σ_r² S(n; 20, 1.5),   S(n; n₀, p) ∝ (1 + (n/n₀)²)^−p

σ_s is the size of what changes slowly along the path, σ_r of what changes fast; both are common to all tests, and zero
where a model explains everything. The noise of each test is the campaign's times a factor near one. Both are found by
maximising the evidence with all parameters of the model marginalised (Kennedy and O'Hagan, "Bayesian calibration of
computer models", J. R. Statist. Soc. B 63 (2001) 425-464, have the idea of such a term).

A curve of an unknown cause is not known to the instant. Where it jumps (at a reversal, at a step of an encoder) the
model has the jump in one block, and the machine a little before or after it. So where a model has such a curve, each
block near a jump has an error of its own, of half the jump. Without it a search explains by names what these blocks
miss.

The rest of the package sees all this as whitening (:mod:`mjsim.inference.whitening`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.ndimage import maximum_filter1d
from scipy.optimize import minimize
from scipy.sparse import csr_array, hstack

from mjsim.inference.fit import Fit
from mjsim.inference.problem import Problem
from mjsim.inference.samples import revolution_time
from mjsim.inference.whitening import Whitening, shrinkage

#: Harmonics of the path angle.
HARMONICS = 48
#: Corner harmonic and exponent of the two spectra: of what changes slowly, and fast, along the path (assumed).
_SLOW, _FAST = (3.0, 2.0), (20.0, 1.5)
#: Shares of the slow part's variance: drift over the test, growth of the eccentricity (two), bow (assumed).
_DRIFT = np.array([0.15, 0.03, 0.03, 0.05])
#: How far the instant of a jump may be off, s (assumed: the time in which a contact turns over at a slow reversal).
_INSTANT = 0.06
#: Share of its range that a curve changes from one block to the next where it jumps (assumed), and most blocks with
#: errors of jumps in a test.
_JUMP, _MOST_JUMPS = 0.05, 150
#: Size over the noise below which a direction of a jump's errors is left out.
_UNSEEN = 0.03
#: Half-width of the half-Cauchy prior of both sizes, m: what an ordinary machine leaves (assumed).
USUAL = 0.3e-6
#: Degrees of freedom of the prior of a test's noise factor: it is known as well as 30 values would tell (assumed).
_KNOWN_NOISE = 30
#: Largest and smallest size that is tried, m. Below the smallest nothing is seen of it.
_LARGEST, _SMALLEST = 1e-3, 3e-9


@dataclass(frozen=True)
class Sizes:
    """Sizes of the discrepancy and of the noise.

    Attributes:
        slow: σ_s, m.
        fast: σ_r, m.
        factor: Noise of each test over the campaign's, (tests,).
    """

    slow: float
    fast: float
    factor: np.ndarray

    @property
    def rms(self) -> float:
        """RMS of the discrepancy in a test, m."""
        return math.hypot(self.slow, self.fast)

    @property
    def log_prior(self) -> float:
        """Logarithm of the prior density of the two sizes: half-Cauchy, but for a constant."""
        return -math.log1p((self.slow / USUAL) ** 2) - math.log1p((self.fast / USUAL) ** 2)

    def times(self, share: float) -> Sizes:
        """Sizes where ``share`` is left of the discrepancy, and of what makes tests louder than the campaign."""
        louder = np.maximum(self.factor**2 - 1.0, 0.0)
        factor = np.sqrt(self.factor**2 - louder + share**2 * louder)
        return Sizes(share * self.slow, share * self.fast, factor)

    def left(self, noise: float) -> float:
        """RMS of what a model leaves besides the noise, m.

        Args:
            noise: RMS of the campaign's noise, m.
        """
        louder = max(float(np.mean(self.factor**2)) - 1.0, 0.0)
        return math.hypot(self.rms, noise * math.sqrt(louder))


class Discrepancy:
    """The discrepancy of every test.

    Args:
        basis: Per test an orthonormal basis (n, m) of what it may look like in rows that are whitened by the campaign's
            noise alone.
        slow: Per test the covariance along that basis of what changes slowly, over the square of its size, (m, m).
        fast: The same of what changes fast.
        jumps: The same of the errors where curves jump, whose size is known; empty where there are none.
    """

    def __init__(
        self,
        basis: Sequence[np.ndarray],
        slow: Sequence[np.ndarray],
        fast: Sequence[np.ndarray],
        jumps: Sequence[np.ndarray] = (),
    ) -> None:
        self.basis, self._slow, self._fast, self._jumps = tuple(basis), tuple(slow), tuple(fast), tuple(jumps)
        self.rows = [slice(a, b) for a, b in pairwise(np.cumsum([0, *map(len, self.basis)]).tolist())]

    @classmethod
    def of_tests(cls, problem: Problem) -> Discrepancy:
        """That of ball-bar tests: harmonics of the path angle.

        Args:
            problem: The measured tests, whitened by the campaign's noise alone.
        """
        bases, slow, fast = [], [], []
        for k, s in enumerate(problem.samples):
            basis, triangle = np.linalg.qr(problem.whiten_test(k, _harmonics(s.centre, revolution_time(s.test))))
            bases.append(basis)
            slow.append((triangle * np.concatenate([_spectrum(*_SLOW), _DRIFT])) @ triangle.T)
            fast.append((triangle * np.concatenate([_spectrum(*_FAST), 0.0 * _DRIFT])) @ triangle.T)
        return cls(bases, slow, fast)

    def beside_curves(self, problem: Problem, readings: Sequence[Sequence[np.ndarray]]) -> Discrepancy:
        """The same where the model has curves of unknown causes.

        Args:
            problem: The measured tests, whitened by the campaign's noise alone.
            readings: What each curve adds to each test, (m,) m.
        """
        bases, slow, fast, jumps = [], [], [], []
        ranges = [max(map(np.max, c)) - min(map(np.min, c)) for c in readings]
        for k, basis in enumerate(self.basis):
            change = [0.5 * np.abs(c[k][2:] - c[k][:-2]) for c in readings]
            jump = np.hypot.reduce([np.where(d > _JUMP * r, d, 0.0) for d, r in zip(change, ranges, strict=True)])
            around = 2 * round(_INSTANT / problem.samples[k].block) + 1
            jump = maximum_filter1d(np.pad(jump, 1), around)
            at = np.argsort(-jump)[: min(np.count_nonzero(jump), _MOST_JUMPS)]
            errors = np.zeros((len(jump), len(at)))
            errors[at, np.arange(len(at))] = jump[at]
            errors = problem.whiten_test(k, errors)
            inside = basis.T @ errors
            across, sizes, turn = np.linalg.svd(errors - basis @ inside, full_matrices=False)
            kept = sizes > _UNSEEN
            own = np.vstack([inside, sizes[kept, None] * turn[kept]])
            more = ((0, int(kept.sum())),) * 2
            bases.append(np.hstack([basis, across[:, kept]]))
            slow.append(np.pad(self._slow[k], more))
            fast.append(np.pad(self._fast[k], more))
            jumps.append(own @ own.T)
        return Discrepancy(bases, slow, fast, jumps)

    def is_nothing(self, sizes: Sizes) -> bool:
        """Whether there is none where it has these sizes."""
        return sizes.rms == 0.0 and not self._jumps

    @property
    def tests(self) -> Iterator[tuple[np.ndarray, slice]]:
        """Basis and rows of every test."""
        return zip(self.basis, self.rows, strict=True)

    def covariance(self, k: int, slow: float, fast: float, factor: float) -> np.ndarray:
        """Covariance of the discrepancy along the basis of test ``k`` over that of its noise, (m, m)."""
        out = (slow / factor) ** 2 * self._slow[k] + (fast / factor) ** 2 * self._fast[k]
        return out + self._jumps[k] / factor**2 if self._jumps else out

    def whitening(self, sizes: Sizes) -> Whitening:
        """The whitening with a discrepancy of these sizes."""
        counts = np.array([len(b) for b in self.basis])
        log_det = float(2.0 * (counts * np.log(sizes.factor)).sum())
        if self.is_nothing(sizes):
            return Whitening(sizes.factor, (), (), log_det)
        parts = []
        for k, basis in enumerate(self.basis):
            shrink, vectors, more = shrinkage(self.covariance(k, sizes.slow, sizes.fast, sizes.factor[k]))
            parts.append((basis @ vectors, shrink))
            log_det += more
        return Whitening(sizes.factor, tuple(parts), (), log_det)

    def plain(self, fit: Fit) -> tuple[np.ndarray, np.ndarray]:
        """Design and residual of a fit as rows that are whitened by the campaign's noise alone.

        Returns:
            Columns of all parameters (count, p), and the residual (count,).
        """
        design, whitening = fit.design, fit.whitening
        out = np.zeros((len(fit.residual), design.shape[1] + 1))
        out[:, design.nuisances : -1] = design.rest
        for rows, (places, own) in zip(self.rows, design.blocks, strict=True):
            out[rows, places] += own
        out[:, -1] = fit.residual
        if whitening is not None:
            out = whitening.all_undone(out)
            for k, rows in enumerate(self.rows):
                out[rows] = whitening.undone(k, out[rows])
        return out[:, :-1], out[:, -1]


@dataclass(frozen=True)
class OfTest:
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

    def across(self) -> OfTest:
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


class Products:
    """Products of columns with each other, test by test, and along the basis of the discrepancy: all that a linear
    model needs of them for any sizes.

    Args:
        discrepancy: Of the tests.
        columns: Whitened by the campaign's noise alone, (count, p). Their products are kept.
    """

    def __init__(self, discrepancy: Discrepancy, columns: np.ndarray) -> None:
        self.discrepancy, self.blocks = discrepancy, [columns]
        self._knots = csr_array((len(columns), 0))
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
        return max((at.stop for at, _ in self._curves), default=0)

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

    def with_curves(self, curves: Sequence[tuple[csr_array, np.ndarray]]) -> Products:
        """The same with the columns of curves behind the others. They would fill hundreds of MB, and are never made.

        Args:
            curves: Rows by the values at the knots, whitened by the campaign's noise alone, (count, knots), the same
                ones where curves share them; and what makes these values of the coefficients, (knots, k).
        """
        out = copy(self)
        rows, counts = {id(r): r for r, _ in curves}, {id(r): len(root) for r, root in curves}
        ends = dict(zip(counts, np.cumsum([*counts.values()]).tolist(), strict=True))
        out._knots = csr_array(hstack([*rows.values()])) if rows else self._knots
        out._curves = [(slice(ends[id(r)] - len(root), ends[id(r)]), root) for r, root in curves]
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
        return out + self._knots @ values

    def of_test(self, k: int, residual: np.ndarray) -> OfTest:
        """Products of the columns that reach a test, of the residual and of the knots.

        Args:
            k: The test.
            residual: Whitened by the campaign's noise alone, (count,).
        """
        basis, at = self.discrepancy.basis[k], self.discrepancy.rows[k]
        # set-up and trigger of one test are in no other: only the columns that reach a test are multiplied
        live = np.flatnonzero(np.diag(self._gram[k]))
        first, knots = self.blocks[0][at, live], self._knots[at]
        own = np.hstack([*(b[at] for b in self.blocks[1:]), residual[at, None]])
        seen = np.flatnonzero(own.any(axis=0))
        own, across = own[:, seen], first.T @ own[:, seen]
        gram = np.block([[self._gram[k][np.ix_(live, live)], across], [across.T, own.T @ own]])
        return OfTest(
            np.append(live, self.blocks[0].shape[1] + seen),
            gram,
            np.vstack([(knots.T @ first).T, (knots.T @ own).T]),
            (knots.T @ knots).toarray(),
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
        self._along, self._live, self._across = [], [], []
        factors = {sizes.factor.tobytes(): sizes.factor for sizes in only}
        totals = {key: self._nothing() for key in factors}
        for k in range(len(self.discrepancy.rows)):
            mine = products.of_test(k, residual)
            along = np.zeros((len(mine.along), products.dense + 1 + products.knots))
            along[:, mine.at], along[:, products.dense + 1 :] = mine.along, mine.knots_along
            along = products.of_curves(along)
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
        return np.zeros((self.products.dense + 1 + self.products.knots,) * 2)

    def _of_all(self, total: np.ndarray) -> np.ndarray:
        """Products of all columns and the residual with each other, of those with the knots in the place of curves."""
        behind = self.products.dense + 1
        total[behind:, :behind] = total[:behind, behind:].T
        return self.products.of_curves(self.products.of_curves(total).T)

    def _noise_alone(self, factor: np.ndarray) -> np.ndarray:
        """Products of columns and residual across the basis of the discrepancy, where there is only noise, (p + 1,
        p + 1); kept for the next sizes with the same factors.
        """
        key = factor.tobytes()
        if key not in self._summed:
            total = self._nothing()
            for across, f in zip(self._across, factor, strict=True):
                across.add_to(total, f**-2.0)
            self._summed = {key: self._of_all(total)}
        return self._summed[key]

    def normal(self, sizes: Sizes) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Products with the inverse covariance between the rows.

        Returns:
            Of the columns with each other, (p, p); with the residual, (p,); of the residual with itself; and the
            logarithm of the covariance's determinant over that of the campaign's noise.
        """
        nothing, log_det = self.discrepancy.is_nothing(sizes), 0.0
        rows = np.zeros((sum(map(len, self._along)), self.products.width + 1))
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
        total = self._noise_alone(sizes.factor) + rows.T @ rows
        return total[:-1, :-1], total[:-1, -1], float(total[-1, -1]), log_det

    def _solved(self, sizes: Sizes) -> tuple[float, np.ndarray]:
        """Log evidence without the prior of the sizes, and the step of the parameters, (p,)."""
        return marginalised(*self.normal(sizes), self.precision, self.departure)

    def log_evidence(self, sizes: Sizes) -> float:
        """Log evidence of the data with the prior of the sizes."""
        return self._solved(sizes)[0] + sizes.log_prior

    def tuned(self, start: Sizes) -> tuple[Sizes, float]:
        """The sizes of largest evidence, with all parameters marginalised, and that log evidence."""
        sizes = start
        for side in (0.7, 0.2, 0.2):  # with other noise factors the sizes move little
            factor = self._noise_factors(sizes)
            settled = np.abs(np.log(factor / sizes.factor)).max() < 0.02
            # the noise before the sizes: what is outside the basis would drive them up without end
            sizes = self._best_sizes(replace(sizes, factor=factor), side)
            if settled:
                break
        return sizes, self.log_evidence(sizes)

    def _best_sizes(self, start: Sizes, side: float) -> Sizes:
        """The sizes of the discrepancy of largest evidence at the noise factors of ``start``, looked for at first in
        steps of ``side`` of their logarithms.
        """

        def at(x: np.ndarray) -> Sizes:
            slow, fast = np.clip(np.exp(x), _SMALLEST, _LARGEST)
            return replace(start, slow=float(slow), fast=float(fast))

        begin = np.log(np.maximum([start.slow, start.fast], 0.03e-6))
        simplex = begin - side * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        options = {"xatol": 0.15, "fatol": 0.2, "maxfev": 60, "initial_simplex": simplex}
        best = at(minimize(lambda x: -self.log_evidence(at(x)), begin, method="Nelder-Mead", options=options).x)
        choices = [best, replace(best, slow=0.0), replace(best, fast=0.0), replace(best, slow=0.0, fast=0.0)]
        return max(choices, key=self.log_evidence)

    def _noise_factors(self, sizes: Sizes) -> np.ndarray:
        """Each test's noise over the campaign's, from what is left across the basis of its discrepancy, (tests,)."""
        _, step = self._solved(sizes)
        rest = self.residual - self.products.times(step)
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
) -> tuple[float, np.ndarray]:
    """Log evidence of a linear model with its parameters marginalised, and their step, (p,).

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
    return -0.5 * float(square + log_det + flexibility), step


def _spectrum(corner: float, exponent: float) -> np.ndarray:
    """Variances of level, cosines and sines, in the order of :func:`_harmonics`, whose sum is 1."""
    n = np.concatenate([[0.0], np.arange(1, HARMONICS + 1), np.arange(1, HARMONICS + 1)])
    shape = (1.0 + (n / corner) ** 2) ** -exponent
    return shape / shape.sum()


def _harmonics(time: np.ndarray, revolution: float) -> np.ndarray:
    """Level, cosines, sines and drift at times (n,) s, (n, 2 HARMONICS + 5)."""
    phi = 2.0 * np.pi * time / revolution
    angles = phi[:, None] * np.arange(1, HARMONICS + 1)
    u = (phi - phi.mean()) / max(float(np.ptp(phi)), 1e-9)
    drift = np.column_stack([u, u * np.cos(phi), u * np.sin(phi), u * u - 1.0 / 12.0])
    return np.hstack([np.ones((len(phi), 1)), np.cos(angles), np.sin(angles), drift])
