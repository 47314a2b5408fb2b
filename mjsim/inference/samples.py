"""Measured traces brought onto a common footing: averaged in blocks, with gaps and outliers marked."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from scipy.sparse import csr_array

from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest, Trace
from mjsim.simulation.drive import STEP

#: Simulated readings are kept at this spacing, s (every fifth step). Waves up to 40 Hz keep their size to 0.2 %.
GRID_STEPS = 5
GRID = GRID_STEPS * STEP
#: Length of an averaging block, s: at feeds up to SLOW, and above it.
BLOCKS = (0.020, 0.010)
SLOW = 1.5 / 60.0


@dataclass
class Samples:
    """One test's trace in blocks.

    Attributes:
        test: the test. block: length of a block, s. time: (n,) s, all samples. value: (n,) m. valid: (n,) bool.
        edges: (m + 1,) first sample of each block. centre: (m,) s. mean: (m,) m. good: (m,) bool. left_out: (n,) m,
            what ``mean`` leaves out of ``value``. given: (n,) bool, ``valid`` as recorded. turns: (k,) s, when an axis
            turns back that then stands elsewhere, each time by another amount.
    """

    test: BallBarTest
    time: np.ndarray
    value: np.ndarray
    valid: np.ndarray
    block: float = BLOCKS[1]
    edges: np.ndarray = field(init=False)
    left_out: np.ndarray = field(init=False)
    turns: np.ndarray = field(init=False)
    given: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self._fill_gaps()
        # shift and length of the grid that was sampled last, and its weights
        self._known: tuple[tuple[float, int], tuple[np.ndarray, np.ndarray]] | None = None
        self.left_out = np.zeros(len(self.time))
        self.turns = np.zeros(0)
        self.given = self.valid.copy()
        dt = float(np.median(np.diff(self.time)))
        if dt < self.block:
            number = np.floor((self.time - self.time[0]) / self.block + 0.5 * dt / self.block).astype(int)
            self.edges = np.append(np.flatnonzero(np.diff(number, prepend=-1)), len(self.time))
        else:
            self.edges = np.arange(len(self.time) + 1)
        self.centre, self.mean = self.average(self.time), self.average(self.value)
        self.refresh()

    def _fill_gaps(self) -> None:
        """Put missing samples in as invalid ones, so that the clock runs evenly."""
        dt = float(np.median(np.diff(self.time)))
        place = np.round((self.time - self.time[0]) / dt).astype(int)
        if place[-1] + 1 == len(place) or len(np.unique(place)) < len(place):
            return
        time = self.time[0] + dt * np.arange(place[-1] + 1)
        valid = np.zeros(len(time), bool)
        valid[place] = self.valid
        value = np.interp(time, self.time, self.value)
        time[place] = self.time
        self.time, self.value, self.valid = time, value, valid

    def copy(self) -> Samples:
        """Samples that can be marked without changing these."""
        out = copy(self)
        out.valid, out.good, out.value, out.mean = (
            self.valid.copy(),
            self.good.copy(),
            self.value.copy(),
            self.mean.copy(),
        )
        return out

    def without(self, part: np.ndarray) -> Samples:
        """The samples with a part of the reading that is understood, (n,) m, left out of the block means; zeros:
        with nothing left out.
        """
        out = self.copy()
        out.left_out = part
        out.mean = self.average(self.value - part)
        return out

    def refresh(self) -> None:
        """Recompute which blocks are good after ``valid`` has changed."""
        self.good = np.logical_and.reduceat(self.valid, self.edges[:-1])
        jump = np.diff(self.centre) > 1.6 * max(self.block, float(np.median(np.diff(self.centre))))
        self.segment = np.concatenate([[0], np.cumsum(jump)])

    def average(self, x: np.ndarray) -> np.ndarray:
        """Block means of a per-sample array (n,) or (n, k)."""
        total = np.add.reduceat(x, self.edges[:-1], axis=0)
        count = np.diff(self.edges)
        return total / (count if x.ndim == 1 else count[:, None])

    def sample(self, grid: np.ndarray, shift: float) -> np.ndarray:
        """A simulated reading (on the GRID from time 0) as block means; ``shift`` s is added to the program's clock."""
        known, key = self._known, (shift, len(grid))
        if known is None or known[0] != key:  # many signatures are sampled at one shift
            self._known = known = key, _block_weights((self.time - shift) / GRID, self.edges, len(grid))
        out = np.empty(len(self.centre))
        _weighted(np.ascontiguousarray(grid), *known[1], out)
        return out

    def averages(self, n: int, shift: float) -> csr_array:
        """What :meth:`sample` makes of ``n`` points on the GRID, as a matrix (m, n)."""
        first, weights = _block_weights((self.time - shift) / GRID, self.edges, n)
        places = first[:, None] + np.arange(weights.shape[1])
        starts = np.arange(0, weights.size + 1, weights.shape[1])
        return csr_array((weights.ravel(), places.ravel(), starts), (len(first), n))

    def sample_all(self, grid: np.ndarray, shift: float, spacing: float = GRID) -> np.ndarray:
        """As :meth:`sample`, for every sample instead of block means; ``spacing`` is the grid's, s."""
        out = np.empty(len(self.time))
        _interpolate(np.ascontiguousarray(grid), (self.time - shift) / spacing, out)
        return out


@njit(cache=True, nogil=True)
def _point_weights(u, n, known, weight):
    """Lagrange's weights of the points around the index ``u``; of four points where the ends are near.

    Returns the first point, and the fraction that the weights are for: samples at an even pace have one fraction.
    """
    i = min(max(int(np.floor(u)), 1), n - 3)
    f = u - i
    if 3 <= i <= n - 5:
        if abs(f - known) > 1e-9:
            _lagrange(f, weight)
            known = f
        return i - 3, known
    first = min(max(i - 3, 0), n - _POINTS)
    weight[:] = 0.0
    at = i - 1 - first
    weight[at] = 0.5 * f * (f * (2.0 - f) - 1.0)
    weight[at + 1] = 1.0 + 0.5 * f * f * (3.0 * f - 5.0)
    weight[at + 2] = 0.5 * f * (1.0 + f * (4.0 - 3.0 * f))
    weight[at + 3] = 0.5 * f * f * (f - 1.0)
    return first, -1.0


@njit(cache=True, nogil=True)
def _interpolate(y, u, out):
    """Values of ``y`` between its points, at the indices ``u``."""
    weight, known = np.zeros(_POINTS), -1.0
    for k in range(len(u)):
        first, known = _point_weights(u[k], len(y), known, weight)
        total = 0.0
        for j in range(_POINTS):
            total += weight[j] * y[first + j]
        out[k] = total


def _block_weights(u: np.ndarray, edges: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """What makes block means of a curve with ``n`` points: the first point of each block, (m,), and the weights of the
    points from there on, (m, width). ``u`` (count,) are the indices of the samples, ``edges`` (m + 1,) the blocks'.
    """
    ends = np.floor(u[edges[1:] - 1]) - np.floor(u[edges[:-1]])
    first = np.empty(len(edges) - 1, int)
    weights = np.zeros((len(first), min(int(ends.max()) + _POINTS, n)))
    _add_weights(u, edges, n, first, weights)
    return first, weights


@njit(cache=True, nogil=True)
def _add_weights(u, edges, n, first, weights):
    """The loop of :func:`_block_weights`."""
    weight, known, width = np.zeros(_POINTS), -1.0, weights.shape[1]
    for b in range(len(first)):
        share = 1.0 / (edges[b + 1] - edges[b])
        for k in range(edges[b], edges[b + 1]):
            at, known = _point_weights(u[k], n, known, weight)
            if k == edges[b]:
                first[b] = min(at, n - width)
            for j in range(_POINTS):
                weights[b, at - first[b] + j] += share * weight[j]


@njit(cache=True, nogil=True)
def _weighted(y, first, weights, out):
    """Block means by the weights of :func:`_block_weights`."""
    for b in range(len(first)):
        total = 0.0
        for j in range(weights.shape[1]):
            total += weights[b, j] * y[first[b] + j]
        out[b] = total


#: Points of the interpolation. Four would lose 2 % of a wave of 36 Hz, which a worm gear makes at the speeds of a cone.
#: Eight lose 0.13 %.
_POINTS = 8
#: Products of the distances of each of the points to the others, in steps.
_DISTANCES = np.array([np.prod([float(j - m) for m in range(8) if m != j]) for j in range(8)])


@njit(cache=True, nogil=True)
def _lagrange(f, weight):
    """Weights of the points -3 to 4 in the polynomial through them at ``f``."""
    before = 1.0
    for j in range(8):
        weight[j] = before / _DISTANCES[j]
        before *= f + 3 - j
    after = 1.0
    for j in range(7, -1, -1):
        weight[j] *= after
        after *= f + 3 - j


def make_samples(tests: tuple[BallBarTest, ...], traces: dict[str, Trace], block: float | None = None) -> list[Samples]:
    """Samples of all measured tests, in blocks of one length: short ones where a test runs fast, unless ``block`` s
    says which.
    """
    block = block or (BLOCKS[0] if max(t.feed for t in tests) <= SLOW else BLOCKS[1])
    return [
        Samples(t, traces[t.name].time, traces[t.name].deviation, traces[t.name].valid.copy(), block) for t in tests
    ]


def revolution_time(test: BallBarTest) -> float:
    """Duration of one revolution at the constant feed, s."""
    return 2 * np.pi * kind_of(test).radius(test) / test.feed
