"""The noise of a campaign, from what its repeated revolutions differ by.

It is coloured, so neighbouring samples are no independent evidence. All fits and tests work on whitened blocks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from scipy.linalg import solve_toeplitz
from scipy.sparse import csr_array

from mjsim.inference.samples import BLOCKS, Samples, revolution_time
from mjsim.inference.settings import OUTLIERS
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import USUAL_NOISE

#: A test whose revolutions have fewer samples or blocks in common says nothing about the noise.
_FEWEST = 50
#: A test that is so many times as loud as the median of all holds more than noise (assumed).
_LOUD = 1.3
#: Curves that count as drift between two revolutions, those of ``basis``: eccentricity and its growth.
_DRIFT = 6
#: Curves of a step where an axis turns back: of what is displaced in any direction.
_STEP = 3
#: Most of the variance that may have been taken out with them (assumed), and rounds in which that is found.
_MOST_LOST, _ROUNDS = 0.2, 4


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

    def filter(self, kept: np.ndarray, count: int) -> csr_array:
        """What :meth:`whiten` does to ``count`` blocks as a sparse matrix, (len(kept), count).

        Args:
            kept: Indices of :meth:`rows`.
            count: Number of blocks.
        """
        places = kept[:, None] - np.arange(len(self.taps))
        ends = np.arange(0, places.size + 1, len(self.taps))
        return csr_array((np.tile(self.taps, len(kept)), places.ravel(), ends), (len(kept), count))

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
    growth) is taken out, and what changes when an axis turns back that stands elsewhere in each stroke.
    """
    turn, steps = revolution_time(s.test), _steps(s)
    out = []
    for time, value, valid in ((s.time, s.value - s.left_out, s.valid), (s.centre, s.mean, s.good)):
        later = _delayed(np.where(valid, value, np.median(value[valid])), turn / float(np.median(np.diff(time))))
        bad = np.convolve(~valid, np.ones(33), mode="same") > 0
        n = min(len(later), int(np.searchsorted(time, time[-1] - turn)) - 16)
        h = 0.5 * (later[:n] - value[:n])
        lag = int(turn / float(np.median(np.diff(time))))
        ok = valid[:n] & ~bad[lag : lag + n]
        phi = 2 * np.pi * (time[:n] - time[0]) / turn
        once = np.column_stack([np.ones(n), np.cos(phi), np.sin(phi)])
        basis = np.hstack([once, phi[:, None] * once, *((time[:n, None] > at) * once for at in steps)])
        ok &= (np.abs(np.subtract.outer(time[:n], steps)) > OUTLIERS.abrupt).all(axis=1)
        if ok.sum() > _FEWEST:
            h = h - basis @ np.linalg.lstsq(basis[ok], h[ok], rcond=None)[0]
        out.append(np.ma.array(h, mask=~ok))
    return out[0], out[1]


def _steps(s: Samples) -> np.ndarray:
    """When the difference of two revolutions steps because an axis turns back in one of them, s."""
    turn = revolution_time(s.test)
    at = np.sort(np.concatenate([s.turns, s.turns - turn]))
    at = at[(at > s.time[0]) & (at < s.time[-1] - turn)]
    return at[np.diff(at, prepend=-np.inf) > OUTLIERS.abrupt]


def usual_noise(
    block: float = BLOCKS[0], resolution: float = 0.1e-6, rms: float = USUAL_NOISE, stated: bool = False
) -> Noise:
    """The noise of an ordinary instrument, where none can be measured (assumed: correlated over 0.05 s).

    Args:
        block: Length of an averaging block, s.
        resolution: Of a reading, m.
        rms: Of one sample, m.
        stated: Whether the user says so.
    """
    ar, rms = np.array([np.exp(-block / 0.05)]), max(rms, resolution)
    source = "as stated: no test repeats its revolution" if stated else "assumed: no test repeats its revolution"
    return Noise(rms, 0.93 * rms, ar, 0.93 * rms * float(np.sqrt(1 - ar[0] ** 2)), source)


def noises_of(samples: Sequence[Samples], instruments: Mapping[str, Any]) -> dict[str, Noise]:
    """Noise model of each instrument, by its name.

    Args:
        samples: Of all tests.
        instruments: Numbers of the instruments, by name.
    """
    out = {}
    for name in dict.fromkeys(s.test.instrument for s in samples):
        mine, data = [s for s in samples if s.test.instrument == name], instruments[name]
        usual = usual_noise(mine[0].block, data.resolution, data.usual_noise, data.noise_stated)
        out[name] = estimate_noise(mine, data.resolution, usual)
    return out


def estimate_noise(
    samples: Sequence[Samples], resolution: float, usual_one: Noise | None = None, order: int = 5
) -> Noise:
    """Noise model of one instrument.

    Tests with two revolutions or more give half-differences. Those that are much louder than the median of all are left
    out: something in them does not repeat, and must not raise the floor.

    Args:
        samples: Of all its tests.
        resolution: Of the instrument, m.
        usual_one: What it is without any; by default that of an ordinary ball bar.
        order: Of the autoregressive model.
    """
    around = [s for s in samples if kind_of(s.test).repeats(s.test)]
    repeated = [(*half_differences(s), _DRIFT + _STEP * len(_steps(s))) for s in around]
    repeated = [(fine, coarse, curves) for fine, coarse, curves in repeated if coarse.count() > _FEWEST]
    if not repeated:
        return usual_one or usual_noise(samples[0].block, resolution)
    levels = np.array([coarse.var() for _, coarse, _ in repeated])
    usual = _LOUD * np.percentile(levels, 50, method="lower")  # of two tests the quieter: the other may have a knock
    repeated = [test for test, level in zip(repeated, levels, strict=True) if level <= usual]
    covariance = 2.0 * _autocovariance([coarse for _, coarse, _ in repeated], order)
    covariance[0] += (0.05 * resolution) ** 2
    # what was taken out as drift was noise as well: so much of the power at the lowest frequencies
    share = sum(curves for _, _, curves in repeated) / sum(coarse.count() for _, coarse, _ in repeated)
    lost = 0.0
    for _ in range(_ROUNDS):
        ar, innovation = autoregression(covariance + lost)
        lost = min(share * (innovation / (1.0 - ar.sum())) ** 2, _MOST_LOST * covariance[0])
    ar, innovation = autoregression(covariance + lost)
    squares = sum((fine.compressed() ** 2).sum() for fine, _, _ in repeated)
    squares /= sum(fine.count() for fine, _, _ in repeated)
    count = len(repeated)
    return Noise(
        float(np.sqrt(2.0 * squares + lost)),
        float(np.sqrt(covariance[0] + lost)),
        ar,
        innovation,
        f"from the difference between the two revolutions, in {count} test{'s' if count > 1 else ''}",
    )


def _autocovariance(series: Sequence[np.ma.MaskedArray], order: int) -> np.ndarray:
    """Autocovariance at the lags 0 to ``order`` of several series together, over what is not masked."""
    products, counts = np.zeros(order + 1), np.zeros(order + 1)
    for x in series:
        values, valid = x.filled(0.0), (~np.ma.getmaskarray(x)).astype(float)
        n = len(values)
        products += [values[: n - k] @ values[k:] for k in range(order + 1)]
        counts += [valid[: n - k] @ valid[k:] for k in range(order + 1)]
    return products / np.maximum(counts, 1.0)


def autoregression(covariance: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients of the autoregressive model with this autocovariance (Yule-Walker), and the standard deviation of
    its innovations.
    """
    ar = solve_toeplitz(covariance[:-1], covariance[1:])
    return ar, float(np.sqrt(max(covariance[0] - ar @ covariance[1:], 1e-3 * covariance[0])))


@njit(cache=True, nogil=True)
def _filter_rows(x, taps, kept, out):
    for i in range(len(kept)):
        row = kept[i]
        for c in range(x.shape[1]):
            out[i, c] = taps[0] * x[row, c]
        for j in range(1, len(taps)):
            for c in range(x.shape[1]):
                out[i, c] += taps[j] * x[row - j, c]
