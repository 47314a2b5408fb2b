"""Samples whose times or angles have few digits, put back where an even clock took them.

Recorders sample evenly. Rounded angles make the samples a little early, a little late, or fall on one place; taken at
their word, that jitter would pass for noise and for gaps in the trace.
"""

from __future__ import annotations

import numpy as np

#: Off the even clock by less than this part of a step, times are left as they are.
_EXACT = 1e-3


def quantum(x: np.ndarray) -> float:
    """The last decimal place that ``x`` (n,) uses, as a number (0.001 for three decimals); 0 where it uses more
    than six.
    """
    for decimals in range(7):
        scaled = x * 10.0**decimals
        if np.abs(scaled - np.round(scaled)).max(initial=0.0) < 1e-4:
            return 10.0**-decimals
    return 0.0


def evenly(time: np.ndarray, deviation: np.ndarray, step: float, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Times that grow, with their deviations; on an even clock where rounding explains all that they are off it.

    Args:
        time: (n,) s. deviation: (n,) m. step: what the file's rounding is as a time, s. notes: gets what was done.
    """
    forward = np.append(True, time[1:] > np.maximum.accumulate(time)[:-1]) if len(time) else np.zeros(0, bool)
    kept, count = time[forward], int(forward.sum())
    if count > 2:
        steps = np.diff(kept)
        usual = float(np.median(steps))
        listed = np.abs(steps - usual).max() < 1e-3 * usual or np.mean(np.abs(steps - usual) < 1e-3 * usual) > 0.9
        if step < 0.7 * usual or (listed and count > 0.95 * len(time)):
            # steps can be counted one by one, over gaps as well
            single = steps[steps < 1.5 * usual].mean()
            even, values = _line(kept, np.append(0, np.cumsum(np.round(steps / single))), step), deviation[forward]
        else:
            even, values = _line(time, np.arange(len(time)), step), deviation
        if even is not None:
            clock, off, rate = even
            if off > _EXACT / rate:
                notes.append(
                    f"angles or times are rounded: the {len(clock)} samples are taken as evenly spaced, {rate:.6g} Hz"
                )
                return clock, values
    if count < len(time):
        notes.append(f"{len(time) - count} samples are left out: their angle was there already")
    return kept, deviation[forward]


def _line(time: np.ndarray, number: np.ndarray, step: float) -> tuple[np.ndarray, float, float] | None:
    """Times on the even clock that fits best, how far off it the given ones are, its rate; ``None`` where rounding
    does not explain it.
    """
    slope, first = np.polyfit(number, time, 1)
    off = float(np.abs(time - first - slope * number).max())
    if slope <= 0 or off > 0.75 * step + 1e-9 or len(np.unique(number)) < len(number):
        return None
    return first + slope * number, off, 1.0 / slope
