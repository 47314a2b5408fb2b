"""Long lines made ready for a page: few points that look the same, as the charts take them."""

from __future__ import annotations

import numpy as np

#: Digits of the largest value of a line that a chart shows: across and up.
_DIGITS = (6, 4)


def thinned(x: np.ndarray, y: np.ndarray, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """A line with few points that looks the same: the lowest and the highest value of every part of it.

    Args:
        x: (n,) abscissa.
        y: (n,) values; NaN where there is none.
        parts: At most how many parts; all have one length but for the last.
    """
    if len(x) <= 2 * parts:
        return x, y
    length = -(-len(x) // parts)
    rows = np.full((-(-len(x) // length), length), np.nan)
    rows.ravel()[: len(y)] = y
    begin = np.arange(len(rows)) * length
    low = begin + np.argmin(np.where(np.isfinite(rows), rows, np.inf), axis=1)
    high = begin + np.argmax(np.where(np.isfinite(rows), rows, -np.inf), axis=1)
    keep = np.unique(np.append(low, high))
    return x[keep], y[keep]


def pairs(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Points of a line for a chart, (n, 2), rounded to what a tooltip can show; the page gets null for NaN."""
    return np.column_stack([_rounded(v, digits) for v, digits in zip((x, y), _DIGITS, strict=True)])


def _rounded(values: np.ndarray, digits: int) -> np.ndarray:
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    return np.round(values, digits - 1 - int(np.floor(np.log10(largest)))) if largest > 0.0 else values
