"""Noise that is louder at some places of a test, and at some frequencies, than the campaign's.

A structure that was hit at a reversal rings for a while. No model follows that wave by wave, and no harmonic of the
path does. Taken for white noise of the whole test it does harm twice: the quiet part of the test counts too little, and
the ringing counts as hundreds of independent values, which any curve may win that follows a part of it.

So the whitened rows of a test are cut into stretches as long as a structure rings, and each stretch is transformed into
cosines, which are taken together octave by octave. In each such tile the noise has a variance of its own, with a scaled
inverse χ² prior around that of the whole test. Whether a test has tiles at all, the evidence says: where it has none,
nothing is transformed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.fft import dct, idct
from scipy.optimize import minimize_scalar
from scipy.sparse import block_diag, csr_array
from scipy.special import gammaln

from mjsim.units import UM

#: Length of a stretch, s: a mode of 10 Hz with a damping ratio of 0.05 has rung down to a tenth (assumed).
_STRETCH = 0.7
#: Octaves below the highest frequency that have a variance of their own; the lower ones share one.
_OCTAVES = 4
#: Degrees of freedom of the prior of a tile's variance: it is known as well as two values would tell (assumed).
_KNOWN = 2.0


@dataclass(frozen=True)
class LouderPlace:
    """Where a test is loudest beside the noise of the campaign, and how much it is louder as a whole.

    Attributes:
        test: Name of the test.
        rms: By which its noise is more than that of the campaign, RMS over the test, m.
        time: Where it is loudest, s from the start of the trace.
        frequency: Octave in which it is, Hz, from and to.
        times: Noise there over that of the campaign, in this octave.
    """

    test: str
    rms: float
    time: float
    frequency: tuple[float, float]
    times: float

    def to_json(self) -> dict:
        """As in the JSON of ``mjsim diagnose``."""
        return {
            "test": self.test,
            "rms_um": round(self.rms / UM, 4),
            "time_s": round(self.time, 2),
            "frequency_Hz": [round(f, 1) for f in self.frequency],
            "times": round(self.times, 2),
        }


@dataclass(frozen=True)
class Tiles:
    """The stretches of a test and their octaves.

    Attributes:
        count: Rows of the test.
        stretch: About so many rows are in a stretch.
    """

    count: int
    stretch: int

    @classmethod
    def of_test(cls, count: int, block: float) -> Tiles:
        """Those of a test with ``count`` rows, ``block`` s apart."""
        return cls(count, max(2, round(_STRETCH / block)))

    @cached_property
    def stretches(self) -> list[slice]:
        """Rows of each stretch."""
        ends = np.linspace(0, self.count, max(1, round(self.count / self.stretch)) + 1).round().astype(int)
        return [slice(a, b) for a, b in pairwise(ends.tolist())]

    @cached_property
    def labels(self) -> np.ndarray:
        """Number of the tile of each transformed row, (count,)."""
        out = np.empty(self.count, int)
        for i, at in enumerate(self.stretches):
            frequency = (np.arange(at.stop - at.start) + 0.5) / (at.stop - at.start)
            octave = np.minimum(-np.log2(frequency), _OCTAVES - 0.5).astype(int)
            out[at] = i * _OCTAVES + octave
        return out

    def transformed(self, rows: np.ndarray, back: bool = False) -> np.ndarray:
        """Rows (count,) or (count, k) with each stretch transformed into cosines, or ``back``; lengths stay."""
        out, transform = np.empty_like(rows), idct if back else dct
        for at in self.stretches:
            out[at] = transform(rows[at], axis=0, norm="ortho")
        return out

    def sums(self, of_rows: np.ndarray) -> np.ndarray:
        """Sum of a number of every transformed row (count,) in each tile, (tiles,)."""
        return np.bincount(self.labels, of_rows, len(self.stretches) * _OCTAVES)


@dataclass(frozen=True)
class LocalNoise:
    """Noise of one test over the campaign's, tile by tile.

    Attributes:
        tiles: Of the test.
        level: Standard deviation of each transformed row, (count,).
        cost: What the freedom of the tiles costs, log evidence: their variances marginalised, over their best values.
    """

    tiles: Tiles
    level: np.ndarray
    cost: float

    @classmethod
    def of_residual(cls, tiles: Tiles, rest: np.ndarray, known: np.ndarray) -> LocalNoise | None:
        """The local noise of what a model leaves; ``None`` where the evidence is for one noise in the whole test.

        Args:
            tiles: Of the test.
            rest: Transformed rows of what is left, whitened by the campaign's noise alone, (count,).
            known: Share of each row's variance that is noise still, (count,): the others have been explained away.
        """
        squares, values = tiles.sums(rest**2), tiles.sums(known)
        total, number = float(squares.sum()), float(values.sum())
        if number <= 1.0 or total <= 0.0:
            return None
        half = 0.5 * (_KNOWN + values)
        shape = gammaln(half) - math.lgamma(0.5 * _KNOWN) - 0.5 * values * math.log(0.5 * _KNOWN)

        def marginal(log_variance: float) -> float:
            """Log evidence with the variances of all tiles marginalised around one variance."""
            ratio = squares / (_KNOWN * math.exp(log_variance))
            return float(np.sum(shape - 0.5 * values * log_variance - half * np.log1p(ratio)))

        middle = math.log(total / number)
        best = minimize_scalar(lambda x: -marginal(x), bounds=(middle - 6.0, middle + 1.0), method="bounded")
        usual, evidence = math.exp(best.x), -float(best.fun)
        if evidence <= -0.5 * number * (middle + 1.0):
            return None
        variance = (_KNOWN * usual + squares) / (_KNOWN + values)
        plain = -0.5 * float(np.sum(values * np.log(variance) + squares / variance))
        return cls(tiles, np.sqrt(variance)[tiles.labels], evidence - plain)

    @property
    def loudest(self) -> tuple[int, tuple[float, float], float]:
        """Where it is loudest: the middle row of that stretch, the octave from and to as shares of the highest
        frequency, and the standard deviation there.
        """
        row = int(np.argmax(self.level))
        at = next(s for s in self.tiles.stretches if s.start <= row < s.stop)
        octave = self.tiles.labels[row] % _OCTAVES
        lowest = 0.0 if octave == _OCTAVES - 1 else 2.0 ** -(octave + 1.0)
        return (at.start + at.stop) // 2, (lowest, 2.0**-octave), float(self.level[row])

    @property
    def log_evidence(self) -> float:
        """What it adds to the log evidence of rows that are whitened by it: the determinant, and its cost."""
        return self.cost - float(np.log(self.level).sum())

    @property
    def variance(self) -> float:
        """Mean variance over that of the campaign's noise."""
        return float(np.mean(self.level**2))

    def whitened(self, rows: np.ndarray) -> np.ndarray:
        """Transformed rows of variance one, of rows that the campaign's noise has whitened, (count,) or (count, k)."""
        return (self.tiles.transformed(rows).T / self.level).T

    def undone(self, rows: np.ndarray) -> np.ndarray:
        """The rows from which :meth:`whitened` makes ``rows``."""
        return self.tiles.transformed((rows.T * self.level).T, back=True)

    def matrix(self) -> csr_array:
        """What :meth:`whitened` does as a sparse matrix, (count, count)."""
        blocks = [
            dct(np.eye(at.stop - at.start), axis=0, norm="ortho") / self.level[at, None] for at in self.tiles.stretches
        ]
        return csr_array(block_diag(blocks, format="csr"))
