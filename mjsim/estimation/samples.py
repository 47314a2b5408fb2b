"""Measured traces brought onto a common footing: averaged in blocks, with gaps and outliers marked, and whitened.

The noise is coloured, so neighbouring samples are no independent evidence. All fits and tests work on whitened blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from mjsim.ballbar.kinds import kind_of
from mjsim.ballbar.measurement import BallBarTest, Trace
from mjsim.simulation.drive import STEP

#: Simulated readings are kept at this spacing, s (every fifth step; linear band far above the bar's).
GRID_STEPS = 5
GRID = GRID_STEPS * STEP
#: Length of an averaging block, s: at feeds up to SLOW, and above it.
BLOCKS = (0.020, 0.010)
SLOW = 1.5 / 60.0
#: A test whose revolutions have fewer samples or blocks in common says nothing about the noise.
_FEWEST = 50


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
def _filter_rows(x, taps, kept, out):
    for i in range(len(kept)):
        row = kept[i]
        for c in range(x.shape[1]):
            out[i, c] = taps[0] * x[row, c]
        for j in range(1, len(taps)):
            for c in range(x.shape[1]):
                out[i, c] += taps[j] * x[row - j, c]


@njit(cache=True, nogil=True)
def _interpolate_blocks(y, u, edges, out):
    """Block means of the four-point interpolation of ``y`` at indices ``u``."""
    n = len(y)
    for b in range(len(edges) - 1):
        total = 0.0
        for k in range(edges[b], edges[b + 1]):
            i = min(max(int(np.floor(u[k])), 1), n - 3)
            f = u[k] - i
            p, q, r, s = y[i - 1], y[i], y[i + 1], y[i + 2]
            total += q + 0.5 * f * (r - p + f * (2 * p - 5 * q + 4 * r - s + f * (3 * (q - r) + s - p)))
        out[b] = total / (edges[b + 1] - edges[b])


def make_samples(tests: tuple[BallBarTest, ...], traces: dict[str, Trace], block: float | None = None) -> list[Samples]:
    """Samples of all measured tests, in blocks of one length: short ones where a test runs fast, unless ``block`` s
    says which.
    """
    block = block or (BLOCKS[0] if max(t.feed for t in tests) <= SLOW else BLOCKS[1])
    return [
        Samples(t, traces[t.name].time, traces[t.name].deviation, traces[t.name].valid.copy(), block) for t in tests
    ]


@dataclass(frozen=True)
class Noise:
    """Noise of the campaign from the repeated revolutions, never from the residual that is being explained.

    Attributes:
        rms: of one sample, m. block_rms: of one block mean, m.
        ar: (p,) coefficients of an autoregressive model of the block means, so that
            ``x[k] = Σ ar[j] x[k-1-j] + innovation`` with standard deviation ``innovation``.
        source: where the estimate comes from, for the user.
    """

    rms: float
    block_rms: float
    ar: np.ndarray
    innovation: float
    source: str

    @property
    def taps(self) -> np.ndarray:
        """(p + 1,) filter from block means to innovations in units of their standard deviation."""
        return np.concatenate([[1.0], -self.ar]) / self.innovation

    def whiten(self, s: Samples, columns: np.ndarray, kept: np.ndarray | None = None) -> np.ndarray:
        """Innovations of block columns (m,) or (m, k) in units of their standard deviation; rows that touch a bad block
        are dropped.

        ``kept``: the indices of :meth:`rows`, for who has them already.
        """
        kept = np.flatnonzero(self.rows(s)) if kept is None else kept
        out = np.empty((len(kept), 1 if columns.ndim == 1 else columns.shape[1]))
        _filter_rows(np.ascontiguousarray(columns.reshape(len(columns), -1)), self.taps, kept, out)
        return out[:, 0] if columns.ndim == 1 else out

    def rows(self, s: Samples) -> np.ndarray:
        """Which blocks have a whole filter's length of good blocks behind them, (m,) bool."""
        p = len(self.ar)
        broken = ~s.good
        broken = broken | np.concatenate([[False], np.diff(s.segment) > 0])
        since = np.arange(len(broken)) - np.maximum.accumulate(np.where(broken, np.arange(len(broken)), -1))
        keep = since > p
        keep[:p] = False
        return keep


def revolution_time(test: BallBarTest) -> float:
    """Duration of one revolution at the constant feed, s."""
    return 2 * np.pi * kind_of(test).radius(test) / test.feed


def _delayed(x: np.ndarray, delay: float, taps: int = 32) -> np.ndarray:
    """``x`` a (fractional) number of samples later, by a windowed sinc.

    It keeps the white part of the noise, as linear interpolation would not.
    """
    whole = int(np.floor(delay))
    before = taps // 2 - 1
    k = np.arange(taps) - before
    kernel = np.sinc(k - (delay - whole)) * np.kaiser(taps + 1, 6.0)[1:]
    return np.correlate(x, kernel / kernel.sum(), mode="valid")[whole - before :]


def half_differences(s: Samples) -> tuple[np.ma.MaskedArray, np.ma.MaskedArray]:
    """Half the difference of successive revolutions: per sample and per block, m; masked where one of them was left
    out.

    It has the noise's RMS over √2 and no repeatable signal. Slow drift between revolutions (eccentricity and its
    growth) is taken out.
    """
    turn = revolution_time(s.test)
    out = []
    for time, value, valid in ((s.time, s.value - s.left_out, s.valid), (s.centre, s.mean, s.good)):
        later = _delayed(np.where(valid, value, np.median(value[valid])), turn / float(np.median(np.diff(time))))
        bad = np.convolve(~valid, np.ones(33), mode="same") > 0
        n = min(len(later), int(np.searchsorted(time, time[-1] - turn)) - 16)
        h = 0.5 * (later[:n] - value[:n])
        lag = int(turn / float(np.median(np.diff(time))))
        ok = valid[:n] & ~bad[lag : lag + n]
        phi = 2 * np.pi * (time[:n] - time[0]) / turn
        basis = np.column_stack([np.ones(n), np.cos(phi), np.sin(phi), phi, phi * np.cos(phi), phi * np.sin(phi)])
        if ok.sum() > _FEWEST:
            h = h - basis @ np.linalg.lstsq(basis[ok], h[ok], rcond=None)[0]
        out.append(np.ma.array(h, mask=~ok))
    return out[0], out[1]


def usual_noise(block: float = BLOCKS[0], resolution: float = 0.1e-6) -> Noise:
    """The noise of an ordinary ball bar, where none can be measured (assumed: 0.12 µm, correlated over 0.05 s)."""
    ar = np.array([np.exp(-block / 0.05)])
    rms = max(0.12e-6, resolution)
    return Noise(
        rms, 0.93 * rms, ar, 0.93 * rms * float(np.sqrt(1 - ar[0] ** 2)), "assumed: no test repeats its revolution"
    )


def estimate_noise(samples: Sequence[Samples], resolution: float, order: int = 5) -> Noise:
    """Noise model of a campaign.

    Tests with two revolutions or more give half-differences; their median spectrum over the tests counts, so that one
    test with something that does not repeat does not raise the floor. Without any, 0.1 µm with the usual colour is
    assumed.
    """
    repeated = [half_differences(s) for s in samples if kind_of(s.test).repeats(s.test)]
    repeated = [(fine, coarse) for fine, coarse in repeated if coarse.count() > _FEWEST]
    if not repeated:
        return usual_noise(samples[0].block, resolution)
    lags = np.arange(order + 1)
    covariances, levels = [], []
    for fine, coarse in repeated:
        n, values = len(coarse), coarse.filled(0.0)
        covariances.append([2.0 * np.dot(values[: n - k], values[k:]) / coarse.count() for k in lags])
        levels.append(np.sqrt(2.0 * np.mean(fine.compressed() ** 2)))
    covariances = np.array(covariances)
    quietest = covariances[:, 0] <= np.median(covariances[:, 0]) * (1 + 1e-12)
    r = covariances[quietest].mean(axis=0)
    r[0] += (0.05 * resolution) ** 2
    R = r[np.abs(lags[:-1, None] - lags[None, :-1])]
    ar = np.linalg.solve(R, r[1:])
    innovation = float(np.sqrt(max(r[0] - ar @ r[1:], 1e-3 * r[0])))
    rms = float(np.percentile(levels, 50, method="lower"))  # of two tests the quieter: the other may have a knock
    return Noise(
        rms,
        float(np.sqrt(r[0])),
        ar,
        innovation,
        f"from the difference between the two revolutions, in {len(repeated)} test{'s' if len(repeated) > 1 else ''}",
    )
