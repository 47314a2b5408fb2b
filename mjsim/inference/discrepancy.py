"""What is in no model: a Gaussian process of the path angle in every test, and what every machine has in all of them.

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

Some things every machine has a little of: slides turn as they travel (:mod:`mjsim.inference.slide_angles`), the tool
drifts against the table (:mod:`mjsim.inference.drift`), friction varies (:mod:`mjsim.inference.varying_friction`), and
a bar has a gain (:mod:`mjsim.inference.bar_gain`). They leave the same in all tests. Taken for something that each test
has of its own, they would count as often as there are tests. So each has a size of its own, with an amplitude for each
of its shapes that all tests share.

A curve of an unknown cause is not known to the instant. An axis turns back where it hardly moves, so a fraction of a
micrometre shifts the instant by hundredths of a second. All that follows the reversal comes so much earlier or later.
And where a curve jumps (at a reversal, at a step of an encoder) the model has the jump in one block, and the machine a
little before or after it: each block near a jump has an error of its own, of half the jump. Without these errors a
search explains by names what the readings miss there.

The rest of the package sees all this as whitening (:mod:`mjsim.inference.whitening`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d

from mjsim.inference.fit import Fit
from mjsim.inference.problem import Problem
from mjsim.inference.samples import Samples, revolution_time
from mjsim.inference.whitening import Whitening, shrinkage
from mjsim.instruments.ball_bar.measurement import BallBarTest

#: Harmonics of the path angle.
HARMONICS = 48
#: Corner harmonic and exponent of the two spectra: of what changes slowly, and fast, along the path (assumed).
_SLOW, _FAST = (3.0, 2.0), (20.0, 1.5)
#: Shares of the slow part's variance: drift over the test, growth of the eccentricity (two), bow (assumed).
_DRIFT = np.array([0.15, 0.03, 0.03, 0.05])
#: How far an instant may be off, s; of a reversal, this is three standard deviations (assumed: on a circle of 100 mm at
#: 1 m/min, 0.5 µm shift a reversal by 0.02 s).
_INSTANT = 0.06
#: Share of its range that a curve changes from one block to the next where it jumps (assumed), and most blocks with
#: errors of jumps in a test.
_JUMP, _MOST_JUMPS = 0.05, 150
#: Size over the noise below which a direction of a jump's errors is left out.
_UNSEEN = 0.03
#: Smallest size that is tried, m. Below it nothing is seen, and a common error that usually leaves less is left out.
SMALLEST = 3e-9
#: Half-width of the half-Cauchy prior of both sizes, m: what an ordinary machine leaves (assumed).
USUAL = 0.3e-6


@dataclass(frozen=True)
class CommonError:
    """What every machine has a little of and no model has.

    Attributes:
        name: Of its size in what a diagnosis tells.
        usual: Size on an ordinary machine, in its own unit. The prior is a half-normal of it: what is much larger is a
            fault, and has a name.
        readings: Per test what its shapes leave, on the GRID, (n, shapes) m per unit of its size.
    """

    name: str
    usual: float
    readings: Sequence[np.ndarray]


@dataclass(frozen=True)
class Common:
    """What shapes of a :class:`CommonError` leave in the rows of all tests.

    Attributes:
        name: Of the error.
        usual: What it leaves on an ordinary machine, RMS of the readings, m.
        columns: Whitened by the campaign's noise alone, (count, shapes); together they have an RMS of 1 m.
        reach: RMS of the readings of a size of one, m per unit.
    """

    name: str
    usual: float
    columns: np.ndarray
    reach: float


@dataclass(frozen=True)
class Sizes:
    """Sizes of the discrepancy and of the noise.

    Attributes:
        slow: σ_s, m.
        fast: σ_r, m.
        factor: Noise of each test over the campaign's, (tests,).
        common: RMS of what each common error leaves in the readings, m, by its name.
    """

    slow: float
    fast: float
    factor: np.ndarray
    common: Mapping[str, float] = field(default_factory=dict)

    @property
    def rms(self) -> float:
        """RMS of the discrepancy in a test, m."""
        return math.hypot(self.slow, self.fast, *self.common.values())

    def without_common(self) -> Sizes:
        """The same on a machine without any common error."""
        return replace(self, common={})

    def times(self, share: float) -> Sizes:
        """Sizes where ``share`` is left of the discrepancy, and of what makes tests louder than the campaign."""
        louder = np.maximum(self.factor**2 - 1.0, 0.0)
        factor = np.sqrt(self.factor**2 - louder + share**2 * louder)
        common = {name: share * size for name, size in self.common.items()}
        return replace(self, slow=share * self.slow, fast=share * self.fast, common=common, factor=factor)

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
        common: What is the same in all tests.
    """

    def __init__(
        self,
        basis: Sequence[np.ndarray],
        slow: Sequence[np.ndarray],
        fast: Sequence[np.ndarray],
        jumps: Sequence[np.ndarray] = (),
        common: Sequence[Common] = (),
    ) -> None:
        self.basis, self._slow, self._fast, self._jumps = tuple(basis), tuple(slow), tuple(fast), tuple(jumps)
        self.rows = [slice(a, b) for a, b in pairwise(np.cumsum([0, *map(len, self.basis)]).tolist())]
        self.common = tuple(common)

    @property
    def usual(self) -> Sizes:
        """Sizes that an ordinary machine leaves."""
        return Sizes(USUAL, USUAL, np.ones(len(self.basis)), {c.name: c.usual for c in self.common})

    def log_prior(self, sizes: Sizes) -> float:
        """Logarithm of the prior density of sizes: half-Cauchy, of common errors half-normal, but for a constant."""
        own = -math.log1p((sizes.slow / USUAL) ** 2) - math.log1p((sizes.fast / USUAL) ** 2)
        return own - 0.5 * sum((sizes.common.get(c.name, 0.0) / c.usual) ** 2 for c in self.common)

    def prior_slopes(self, sizes: Sizes) -> np.ndarray:
        """Slopes of :meth:`log_prior` by the logarithms of the sizes of common errors, (errors,)."""
        return np.array([-((sizes.common[c.name] / c.usual) ** 2) for c in self.common])

    @classmethod
    def of_tests(
        cls, problem: Problem, errors: Sequence[CommonError] = (), shifts: Sequence[float] = ()
    ) -> Discrepancy:
        """That of ball-bar tests: harmonics of the path angle, and common errors.

        Args:
            problem: The measured tests, whitened by the campaign's noise alone.
            errors: What is the same in all tests.
            shifts: Trigger shift of each test, s; none is shifted without them.
        """
        bases, slow, fast = [], [], []
        for k, s in enumerate(problem.samples):
            basis, triangle = np.linalg.qr(problem.whiten_test(k, _harmonics(s.centre, revolution_time(s.test))))
            bases.append(basis)
            slow.append((triangle * _OF_SLOW) @ triangle.T)
            fast.append((triangle * _OF_FAST) @ triangle.T)
        found = (_common(problem, error, shifts or [0.0] * len(problem.tests)) for error in errors)
        return cls(bases, slow, fast, (), [c for c in found if c.usual > SMALLEST])

    def beside_curves(
        self, problem: Problem, readings: Sequence[Sequence[np.ndarray]], turns: Sequence[Sequence[np.ndarray]]
    ) -> Discrepancy:
        """The same where the model has curves of unknown causes.

        Args:
            problem: The measured tests, whitened by the campaign's noise alone.
            readings: What each curve adds to each test, (m,) m.
            turns: Of each curve of the time since a reversal, when its axis turns back in each test, s;
                empty for the others.
        """
        bases, slow, fast, jumps = [], [], [], []
        turning = [(c, t) for c, t in zip(readings, turns, strict=True) if t]
        ranges = [max(map(np.max, c)) - min(map(np.min, c)) for c in readings]
        for k, basis in enumerate(self.basis):
            s = problem.samples[k]
            early_or_late = [_early_or_late(c[k], s.centre, t[k]) for c, t in turning]
            errors = np.hstack([_near_jumps([c[k] for c in readings], ranges, s), *early_or_late])
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
        return Discrepancy(bases, slow, fast, jumps, self.common)

    def is_nothing(self, sizes: Sizes) -> bool:
        """Whether no test has one of its own where it has these sizes."""
        return sizes.slow == sizes.fast == 0.0 and not self._jumps

    def told(self, sizes: Sizes, least: float) -> dict[str, float]:
        """Sizes of common errors in their own units, by name: of those that leave more than ``least`` m (RMS)."""
        rows = ((c, sizes.common.get(c.name, 0.0)) for c in self.common)
        return {c.name: size / c.reach for c, size in rows if size > least}

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
        log_det, parts = float(2.0 * (counts * np.log(sizes.factor)).sum()), []
        for k, basis in enumerate(self.basis if not self.is_nothing(sizes) else ()):
            shrink, vectors, more = shrinkage(self.covariance(k, sizes.slow, sizes.fast, sizes.factor[k]))
            parts.append((basis @ vectors, shrink))
            log_det += more
        own = Whitening(sizes.factor, tuple(parts), (), log_det)
        there = [size * c.columns for c in self.common if (size := sizes.common.get(c.name, 0.0))]
        return own.beside(own.of_rows(self.rows, np.hstack(there))) if there else own

    def plain(self, fit: Fit) -> tuple[np.ndarray, np.ndarray]:
        """Design and residual of a fit as rows that are whitened by the campaign's noise alone.

        Returns:
            Columns of all parameters (count, p), and the residual (count,).
        """
        whitening, design = fit.whitening, fit.design.of_each_test
        if whitening is None:
            return design.dense(), fit.residual
        out = design.dense(whitening.all_undone(fit.residual))
        for k, rows in enumerate(self.rows):
            out[rows] = whitening.undone(k, out[rows])
        return out[:, :-1], out[:, -1]


def _common(problem: Problem, error: CommonError, shifts: Sequence[float]) -> Common:
    """What an error leaves in the rows of tests with such trigger shifts, s."""
    samples = zip(problem.samples, error.readings, shifts, strict=True)
    means = [np.stack([s.sample(c, shift) for c in grid.T], axis=1) for s, grid, shift in samples if grid.size]
    if not means:
        return Common(error.name, 0.0, np.zeros((0, 0)), 0.0)
    reach = float(np.sqrt(np.mean(np.concatenate([np.square(m).sum(axis=1) for m in means]))))
    columns = problem.whiten([m / reach for m in means]) if reach > 0.0 else np.zeros((0, 0))
    return Common(error.name, error.usual * reach, columns, reach)


def left_in(test: BallBarTest, time: np.ndarray, sizes: Sizes) -> np.ndarray:
    """What no model has of a test, beside what all tests share: columns (n, k) m by independent unit normals.

    Args:
        test: Measured or not.
        time: Of its readings, (n,) s.
        sizes: Of the discrepancy.
    """
    variance = sizes.slow**2 * _OF_SLOW + sizes.fast**2 * _OF_FAST
    return _harmonics(time, revolution_time(test)) * np.sqrt(variance)


def _near_jumps(curves: Sequence[np.ndarray], ranges: Sequence[float], samples: Samples) -> np.ndarray:
    """Errors of the blocks of a test near jumps of curves, (m, k) m: independent, each of half the jump.

    Args:
        curves: What each adds to the test, (m,) m.
        ranges: From the least to the most that each adds to any test, m.
        samples: Of the test.
    """
    change = [0.5 * np.abs(c[2:] - c[:-2]) for c in curves]
    jump = np.hypot.reduce([np.where(d > _JUMP * r, d, 0.0) for d, r in zip(change, ranges, strict=True)])
    jump = maximum_filter1d(np.pad(jump, 1), 2 * round(_INSTANT / samples.block) + 1)
    at = np.argsort(-jump)[: min(np.count_nonzero(jump), _MOST_JUMPS)]
    errors = np.zeros((len(jump), len(at)))
    errors[at, np.arange(len(at))] = jump[at]
    return errors


def _early_or_late(curve: np.ndarray, time: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Errors of a curve that follows the reversals of an axis, (m, k) m. Each reversal is so much earlier or later, by
    itself; a column is one such shift, times the square root of its probability.

    Args:
        curve: What it adds to the test, (m,) m.
        time: Of the blocks, (m,) s.
        turns: When the axis turns back, s.
    """
    block, index = time[1] - time[0], np.arange(len(time))
    most = max(round(_INSTANT / block), 1)
    shifts = np.arange(-most, most + 1)
    probability = np.exp(-4.5 * (shifts * block / _INSTANT) ** 2)
    moved = curve[np.clip(index[:, None] - shifts, 0, len(time) - 1)] - curve[:, None]
    moved *= np.sqrt(probability / probability.sum())
    # what follows a reversal reaches to where the next may begin
    stretch = np.searchsorted(turns - _INSTANT, time)
    columns = [np.where((stretch == i)[:, None], moved, 0.0) for i in range(1, len(turns) + 1)]
    return np.hstack([np.zeros((len(time), 0)), *columns])


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


#: Variances of the columns of :func:`_harmonics` of what changes slowly and fast, over the squares of their sizes.
_OF_SLOW = np.concatenate([_spectrum(*_SLOW), _DRIFT])
_OF_FAST = np.concatenate([_spectrum(*_FAST), 0.0 * _DRIFT])
