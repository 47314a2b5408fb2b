"""The noise where no test repeats its revolution: from the floor of the spectrum of what a model leaves."""

from __future__ import annotations

import numpy as np

from mjsim.inference.fit import Fit
from mjsim.inference.noise import Noise, autoregression
from mjsim.inference.problem import Problem

#: Length of a segment, blocks, and autoregressive order of the model.
_SEGMENT, _ORDER = 256, 5
#: Median of a mean-one exponential variable.
_MEDIAN = np.log(2.0)


def residual_noise(problem: Problem, fit: Fit) -> Noise | None:
    """Noise model from what a model leaves: the median over segments of their periodograms. A line, a glitch or a knock
    is in a few segments or bins only; medians do not see them. ``None`` where the tests are shorter than four segments.
    """
    segments, fine = [], []
    singles = problem.sample_residuals(fit.readings, fit.nuisance)
    for s, rest, single in zip(problem.samples, problem.residual(fit.readings, fit.nuisance), singles, strict=True):
        for i in range(0, len(rest) - _SEGMENT + 1, _SEGMENT // 2):
            if s.good[i : i + _SEGMENT].all():
                segments.append(rest[i : i + _SEGMENT])
        fine.append((single - np.repeat(s.average(single), np.diff(s.edges)))[s.valid])
    if len(segments) < 4:
        return None
    window = np.hanning(_SEGMENT)
    t = np.linspace(-1.0, 1.0, _SEGMENT)
    level = np.array([x - np.polyval(np.polyfit(t, x, 1), t) for x in segments])
    power = np.abs(np.fft.rfft(level * window, axis=1)) ** 2 / (window @ window)
    density = np.median(power, axis=0) / _MEDIAN
    density = np.array([np.median(density[max(0, i - 3) : i + 4]) for i in range(len(density))])
    r = np.fft.irfft(density)[: _ORDER + 1]
    ar, innovation = autoregression(r)
    within = float(np.mean(np.concatenate(fine) ** 2))
    source = "floor of the rotary tests' own spectrum: no test repeats"
    return Noise(float(np.sqrt(r[0] + within)), float(np.sqrt(r[0])), ar, innovation, source)
