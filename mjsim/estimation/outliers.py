"""Outliers: short disturbances of a trace that do not repeat, such as a knocked bar."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation, median_filter

from mjsim.estimation.samples import Samples, revolution_time
from mjsim.estimation.settings import OUTLIERS, OutlierSettings
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.program import Program


def mark_outliers(s: Samples, residual: np.ndarray, noise: float, settings: OutlierSettings = OUTLIERS) -> int:
    """Mark outlying samples of one test as invalid.

    Args:
        s: The samples; ``valid`` is changed in place.
        residual: Per sample, of the model as given, (n,) m.
        noise: RMS, m.
        settings: What decides.

    Returns:
        Number of disturbances found.
    """
    dt = float(np.median(np.diff(s.time)))
    repeats = kind_of(s.test).repeats(s.test)
    rest = np.where(s.valid, residual - _followed(residual, settings.window, dt), 0.0)
    scale = max(noise, 1.4826 * float(np.median(np.abs(rest[s.valid]))))
    high = np.abs(rest) > (settings.height if repeats else settings.height_alone) * scale
    if not repeats:  # something short, where the axes are smooth
        quick = np.where(s.valid, residual - _followed(residual, settings.window_alone, dt), 0.0)
        high |= (np.abs(quick) > settings.height * scale) & ~_near_reversals(s, settings.abrupt)
    if repeats:
        lag = round(revolution_time(s.test) / dt)
        wide = binary_dilation(np.abs(rest) > 0.4 * settings.height * scale, iterations=max(1, int(0.15 / dt)))
        again = np.zeros(len(high), bool)
        again[lag:] |= wide[:-lag]
        again[:-lag] |= wide[lag:]
        high &= ~again  # what comes back in the other revolution is the machine's
    edge = int(0.25 * settings.window / dt)
    high[:edge] = high[-edge:] = False  # there the running median hangs in the air
    if not high.any():
        return 0
    before, after = (max(1, round(m / dt)) for m in (settings.margin, settings.ringing))
    wide = (
        np.convolve(high, np.ones(before + after + 1))[before : before + len(high)] > 0.5
    )  # from ``before`` ahead to ``after`` behind
    groups, count = stretches(wide)
    long = any(
        (groups == g).sum() * dt > 0.5 * settings.window + settings.margin + settings.ringing
        for g in range(1, count + 1)
    )
    if count > settings.most_events or long:
        return 0
    s.valid &= groups == 0
    s.refresh()
    return count


def readmit_outliers(
    s: Samples, given: np.ndarray, residual: np.ndarray, noise: float, settings: OutlierSettings = OUTLIERS
) -> int:
    """Count stretches again that were left out as disturbances and that a model follows: where nothing repeats, a quick
    local fault of the machine looks like a knock until the model has it.

    Args:
        s: The samples; ``valid`` is changed in place.
        given: ``valid`` before anything was left out, (n,) bool.
        residual: Per sample, of the fitted model, (n,) m.
        noise: RMS, m.
        settings: What decides.

    Returns:
        Number of stretches taken back.
    """
    groups, count = stretches(given & ~s.valid)
    back = [g for g in range(1, count + 1) if np.abs(residual[groups == g]).max() < 0.5 * settings.height * noise]
    s.valid |= np.isin(groups, back)
    s.refresh()
    return len(back)


def stretches(mask: np.ndarray) -> tuple[np.ndarray, int]:
    """Number of the unbroken stretch of ``mask`` that each place is in, from 1 on, (n,), 0 outside; and how many
    stretches there are.
    """
    first = np.diff(mask, prepend=False) & mask
    return np.where(mask, np.cumsum(first), 0), int(first.sum())


def _followed(x: np.ndarray, window: float, dt: float) -> np.ndarray:
    """Running median over ``window`` s, (n,)."""
    width = int(window / dt) | 1
    every = max(1, width // 101)  # the median need not be finer than this
    coarse = median_filter(x[::every], size=max(3, (width // every) | 1))
    return np.interp(np.arange(len(x)), np.arange(0, len(x), every), coarse)


def _near_reversals(s: Samples, abrupt: float) -> np.ndarray:
    """Samples within ``abrupt`` s of a turning point of some axis, where the machine itself is abrupt, (n,) bool."""
    program = Program(s.test)
    commands = program.commands(s.time)
    step = np.sign(np.round(np.diff(commands, axis=0, prepend=commands[:1]), 12))
    turns = np.flatnonzero((step[1:] * step[:-1] < 0.0).any(axis=1))
    near = np.zeros(len(s.time), bool)
    for at in turns:
        near |= np.abs(s.time - s.time[at]) < abrupt
    return near
