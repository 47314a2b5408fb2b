"""Lasting jumps of a trace: a ball that a knock has put into another seat."""

from __future__ import annotations

import numpy as np

from mjsim.estimation.outliers import stretches
from mjsim.estimation.samples import Samples, revolution_time
from mjsim.estimation.settings import OUTLIERS, OutlierSettings
from mjsim.instruments.ball_bar.kinds import kind_of

#: Height of a jump between two revolutions, over how far they lie apart: less is a drift, more the machine's own step
#: (assumed).
_AS_FAR = (0.5, 2.0)


def largest_jump(s: Samples, residual: np.ndarray, noise: float, settings: OutlierSettings = OUTLIERS) -> int | None:
    """First sample after the largest lasting jump of one test, such as a ball that a knock has put into another seat;
    or ``None``.

    A jump shows in the difference of two revolutions, where what belongs to the machine's cycle is gone. The ball stays
    in its new seat: after a jump in the first revolution both agree, and before one in the second. A test that does not
    repeat must show it far above everything else that it does.

    Args:
        s: The samples, without outliers.
        residual: Per sample, of the model as given, (n,) m.
        noise: RMS, m.
        settings: What decides.
    """
    if kind_of(s.test).repeats(s.test):
        return _jump_of_revolutions(s, residual, noise, settings)
    side, short, unusual = _short_jumps(s, residual, settings)
    at = int(np.argmax(np.abs(short)))
    if abs(short[at]) > max(unusual, 2.0 * settings.least_jump):
        return at
    return _jump_over_gap(residual, s.valid, side, settings)


def _short_jumps(s: Samples, residual: np.ndarray, settings: OutlierSettings) -> tuple[int, np.ndarray, float]:
    """Samples of a mean where the place of a jump counts, how far the residual jumps between such means, (n,) m, and
    how far it would have to, to be unusual, m.
    """
    side = max(3, _side(s, settings) // 4)
    short = _jumps(residual, s.valid, side)
    return side, short, settings.jump_alone * float(np.quantile(np.abs(short), 0.9))


def _side(s: Samples, settings: OutlierSettings) -> int:
    """Samples of the mean on either side of a jump."""
    return max(3, round(settings.side / float(np.median(np.diff(s.time)))))


def _jump_of_revolutions(s: Samples, residual: np.ndarray, noise: float, settings: OutlierSettings) -> int | None:
    """The jump in how far two revolutions lie apart, or the one that parts them as a whole; or ``None``."""
    n, lag = _side(s, settings), round(revolution_time(s.test) / float(np.median(np.diff(s.time))))
    # what is left out counts as no time: the ball may have moved while the signal was lost
    at = np.flatnonzero(s.valid[lag:] & s.valid[:-lag])
    apart, there = residual[at + lag] - residual[at], np.ones(len(at), bool)
    if len(at) <= 2 * n:
        return None
    before, after = _means(apart, there, n)
    most = int(np.argmax(np.abs(after - before)))
    # of the difference of two means, of two revolutions
    deviation = noise * np.sqrt(2.0 * 2.0 * settings.correlation / settings.side)
    least = max(settings.jump * deviation, settings.least_jump)
    if abs(after[most] - before[most]) < least:
        height = float(np.median(apart))
        if abs(height) < least:
            return None
        return _jump_between(s, residual, height, (at[-1] - n, at[0] + lag + n), settings)
    near = slice(max(0, most - n), most + n)
    here = int(at[near.start + int(np.argmax(np.abs(_jumps(apart[near], there[near], max(3, n // 10)))))])
    return here if abs(before[most]) > abs(after[most]) else here + lag


def _jump_over_gap(x: np.ndarray, valid: np.ndarray, n: int, settings: OutlierSettings) -> int | None:
    """First sample behind a gap over which a reading jumps far above what it does elsewhere in the same time, or
    ``None``: what has moved the ball often takes the signal as well.

    Args:
        x: The residual, (n,) m.
        valid: Which samples count.
        n: Samples of a mean on either side.
        settings: What decides.
    """
    number, total = (np.concatenate([[0.0], np.cumsum(v)]) for v in (valid, np.where(valid, x, 0.0)))
    count = number[n:] - number[:-n]
    means = np.where(count > 0.6 * n, (total[n:] - total[:-n]) / np.maximum(count, 1.0), np.nan)
    gaps, last = stretches(~valid)
    for g in range(1, last + 1):
        first, length = int(np.argmax(gaps == g)), int((gaps == g).sum())
        change = np.abs(means[n + length :] - means[: -n - length])
        place, here = np.arange(len(change)), first - n
        usual = change[(place > first + length) | (place + 2 * n + length < first)]
        usual = usual[np.isfinite(usual)]
        if not 0 <= here < len(change) or len(usual) < n:
            continue  # too little on one side, or to compare with
        if change[here] > max(settings.jump_alone * float(np.quantile(usual, 0.9)), 2.0 * settings.least_jump):
            return first + length
    return None


def _jump_between(
    s: Samples, residual: np.ndarray, height: float, between: tuple[int, int], settings: OutlierSettings
) -> int | None:
    """Where the ball has moved in front of or behind the stretches in which both revolutions have a mean: at the seam
    of the revolutions, or at an angle at which one of them has lost the signal. Only how far the revolutions lie apart
    tells of a jump there. ``None`` where the reading does not jump by as much.

    Args:
        s: The samples.
        residual: Per sample, (n,) m.
        height: How far the revolutions lie apart, m.
        between: The samples around.
        settings: What decides.
    """
    _, short, unusual = _short_jumps(s, residual, settings)
    rise, place = short * np.sign(height), np.arange(len(short))
    here = int(np.argmax(np.where(s.valid & (place > between[0]) & (place < between[1]), rise, -np.inf)))
    as_far = _AS_FAR[0] * abs(height) < rise[here] < _AS_FAR[1] * abs(height)
    return here if rise[here] > unusual and as_far else None


def leave_out_shorter_side(s: Samples, here: int, residual: np.ndarray, settings: OutlierSettings = OUTLIERS) -> bool:
    """Leave out the shorter side of a jump before sample ``here``.

    Returns:
        Whether the later side is kept: there the ball sits anew, and the jump's height is taken off the reading and the
        residual.
    """
    dt = float(np.median(np.diff(s.time)))
    later = np.arange(len(s.time)) >= here
    before, after = int((s.valid & ~later).sum()), int((s.valid & later).sum())
    kept_later = after >= before
    if kept_later:
        height = float(_jumps(residual, s.valid, max(3, round(0.5 * settings.side / dt)))[min(here, len(residual) - 1)])
        s.value = np.where(later, s.value - height, s.value)
        residual[later] -= height
        s.mean = s.average(s.value - s.left_out)
    s.valid &= (later if kept_later else ~later) & (np.abs(np.arange(len(s.time)) - here) > settings.margin / dt)
    s.refresh()
    return kept_later


def _jumps(x: np.ndarray, valid: np.ndarray, n: int) -> np.ndarray:
    """Mean of the ``n`` values from each place on less that of the ``n`` before it, (len(x),); 0 where too few are
    valid.
    """
    before, after = _means(x, valid, n)
    return after - before


def _means(x: np.ndarray, valid: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean of the ``n`` values before each place, and of those from there on, (len(x),) each; 0 where too few are
    valid.
    """
    total = np.concatenate([[0.0], np.cumsum(np.where(valid, x, 0.0))])
    number = np.concatenate([[0], np.cumsum(valid)])
    before, after = np.zeros(len(x)), np.zeros(len(x))
    k = np.arange(n, len(x) - n)
    counts = number[k] - number[k - n], number[k + n] - number[k]
    enough = np.minimum(*counts) > 0.6 * n
    k = k[enough]
    before[k] = (total[k] - total[k - n]) / counts[0][enough]
    after[k] = (total[k + n] - total[k]) / counts[1][enough]
    return before, after
