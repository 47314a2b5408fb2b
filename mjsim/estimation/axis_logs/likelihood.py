"""How likely two sets of residuals are against each other where the noise is what a model fails to explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: Correlation at which the sum over a series' correlations ends.
_UNCORRELATED = 0.05


@dataclass(frozen=True)
class Gain:
    """What one model explains beyond another: twice the logarithm of their likelihood ratio, by two noise models.

    Attributes:
        slow: What is left is a series of independent values, fewer than samples: the size of the misfit decides.
        fine: What is left has a spectrum, constant in every octave and unknown: a fast part counts beside a slow one.
    """

    slow: float
    fine: float

    @classmethod
    def of(
        cls,
        less: Sequence[np.ndarray],
        more: Sequence[np.ndarray],
        independent: Sequence[float],
        noise: Sequence[float],
    ) -> Gain:
        """Of two sets of residuals.

        Args:
            less: Residuals of one model, (n,) per recording.
            more: Those of another.
            independent: Number of independent residuals per recording.
            noise: RMS of each recording's noise, below which nothing counts in ``fine``.
        """
        before, after = (np.array([max(float(r @ r) / len(r), 1e-30) for r in rest]) for rest in (less, more))
        slow = float(np.array(independent) @ np.log(before / after))
        return cls(slow, likelihood_gain(less, more, noise))

    @property
    def largest(self) -> float:
        """The larger of the two."""
        return max(self.slow, self.fine)

    def less(self, penalty: float) -> Gain:
        """Both less a penalty."""
        return Gain(self.slow - penalty, self.fine - penalty)


def likelihood_gain(less: Sequence[np.ndarray], more: Sequence[np.ndarray], noise: Sequence[float]) -> float:
    """Twice the logarithm of the likelihood ratio of two sets of residuals whose spectra are unknown.

    What a model leaves is correlated. Its spectrum is taken as constant in every octave, and unknown (Whittle's
    likelihood): slow misfit, of which a recording has few independent values, does not hide what is fast, nor count as
    if every sample were independent.

    Args:
        less: Residuals of one model, (n,) per recording.
        more: Those of another.
        noise: RMS of each recording's noise, below which nothing counts.
    """
    total = 0.0
    for a, b, rms in zip(less, more, noise, strict=True):
        window = np.hanning(len(a))
        floor = rms**2 * float(window @ window)
        octave = np.log2(np.arange(1, len(a) // 2 + 1)).astype(int)
        count = np.bincount(octave)
        power = [np.bincount(octave, np.abs(np.fft.rfft(window * r)[1 : len(octave) + 1]) ** 2) for r in (a, b)]
        ratio = np.log(np.maximum(power[0] / count, floor) / np.maximum(power[1] / count, floor))
        # two numbers per complex line, of which the window leaves a share independent
        total += float(2.0 * (window @ window) ** 2 / (len(a) * np.sum(window**4)) * (count @ ratio))
    return total


def independent_count(residual: np.ndarray, memory: float) -> float:
    """Number of independent residuals that a correlated series (n,) is worth: n over its integrated correlation.

    Args:
        residual: (n,)
        memory: Number of samples beyond which a correlation belongs to what the model lacks, not to noise.
    """
    n = len(residual)
    r = residual - residual.mean()
    power = np.abs(np.fft.rfft(r, 2 * n)) ** 2
    correlation = np.fft.irfft(power)[:n]
    if correlation[0] <= 0.0:
        return float(n)
    correlation = correlation / correlation[0]
    below = np.flatnonzero(correlation < _UNCORRELATED)
    end = int(below[0]) if len(below) else n
    return float(n / min(1.0 + 2.0 * correlation[1:end].sum(), max(memory, 1.0)))
