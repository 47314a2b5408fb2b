"""The noise where no test repeats its revolution: from the floor of the residual's own spectrum."""

from __future__ import annotations

import numpy as np

from mjsim.inference.noise import Noise, autoregression
from mjsim.inference.pitch.model import PitchModel, State

#: Length of a segment, blocks, and autoregressive order of the model.
_SEGMENT, _ORDER = 256, 5
#: Median of a mean-one exponential variable.
_MEDIAN = np.log(2.0)


def residual_noise(model: PitchModel, state: State) -> Noise:
    """Noise model from what is left of the tests in use: the median over segments of their periodograms.

    A line, a glitch or a knock is in a few segments or bins only; medians do not see them.

    Raises:
        ValueError: the tests are shorter than four segments.
    """
    segments, fine = [], []
    for k in model.use:
        s = model.problem.samples[k]
        rest = model.residual(k, state)
        for i in range(0, len(rest) - _SEGMENT + 1, _SEGMENT // 2):
            if s.good[i : i + _SEGMENT].all():
                segments.append(rest[i : i + _SEGMENT])
        single = s.value - s.sample_all(model.total(k, state), model.problem.shift(k, state.nuisance))
        fine.append((single - np.repeat(s.average(single), np.diff(s.edges)))[s.valid])
    if len(segments) < 4:
        raise ValueError(f"only {len(segments)} whole segments of {_SEGMENT} blocks")
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
