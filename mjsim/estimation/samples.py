"""Measured traces brought onto a common footing: averaged in blocks, with gaps and outliers marked."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from mjsim.ballbar.kinds import kind_of
from mjsim.ballbar.measurement import BallBarTest, Trace
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
            what
        ``mean`` leaves out of ``value``. given: (n,) bool, ``valid`` as recorded.
    """

    test: BallBarTest
    time: np.ndarray
    value: np.ndarray
    valid: np.ndarray
    block: float = BLOCKS[1]
    edges: np.ndarray = field(init=False)
    left_out: np.ndarray = field(init=False)
    given: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self._fill_gaps()
        self.left_out = np.zeros(len(self.time))
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
        """A simulated reading (on the GRID from time 0) at the recorded times; ``shift`` s is added to the
        program's clock.
        """
        out = np.empty(len(self.centre))
        _interpolate_blocks(np.ascontiguousarray(grid), (self.time - shift) / GRID, self.edges, out)
        return out

    def sample_all(self, grid: np.ndarray, shift: float, spacing: float = GRID) -> np.ndarray:
        """As :meth:`sample`, for every sample instead of block means; ``spacing`` is the grid's, s."""
        out = np.empty(len(self.time))
        _interpolate_blocks(
            np.ascontiguousarray(grid), (self.time - shift) / spacing, np.arange(len(self.time) + 1), out
        )
        return out


@njit(cache=True, nogil=True)
def _interpolate_blocks(y, u, edges, out):
    """Block means of the eight-point Lagrange interpolation of ``y`` at indices ``u``; of four points at the ends.

    Four points everywhere would lose 2 % of a wave of 36 Hz, which a worm gear makes at the speeds of a cone. Eight
    lose 0.13 %.
    """
    n = len(y)
    weight = np.zeros(8)
    known = -1.0
    for b in range(len(edges) - 1):
        total = 0.0
        for k in range(edges[b], edges[b + 1]):
            i = min(max(int(np.floor(u[k])), 1), n - 3)
            f = u[k] - i
            if 3 <= i <= n - 5:
                if abs(f - known) > 1e-9:  # samples at an even pace have one fraction
                    _lagrange(f, weight)
                    known = f
                for j in range(8):
                    total += weight[j] * y[i - 3 + j]
            else:
                p, q, r, s = y[i - 1], y[i], y[i + 1], y[i + 2]
                total += q + 0.5 * f * (r - p + f * (2 * p - 5 * q + 4 * r - s + f * (3 * (q - r) + s - p)))
        out[b] = total / (edges[b + 1] - edges[b])


#: Products of the distances of each of eight points to the other seven, in steps.
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
