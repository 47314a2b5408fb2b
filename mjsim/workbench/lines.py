"""Lines made ready for a page: few points that look the same, and the look of the charts that have them."""

from __future__ import annotations

import numpy as np

#: Digits of the largest value of a line that a chart shows: across and up.
_DIGITS = (6, 4)
#: Ink, grid, simulated, backwards, before, band, measured; light and dark.
COLOURS = {
    False: ("#1a1a1a", "#dedede", "#d9480f", "#0072b2", "#a8adb5", "rgba(0,114,178,0.13)", "#222222"),
    True: ("#e8eaed", "#3a4049", "#ff8a4c", "#5db2ea", "#6d7580", "rgba(93,178,234,0.18)", "#f2f2f2"),
}


def chart(dark: bool, margins: tuple[int, int, int, int], x: dict, y: dict) -> dict:
    """Options of a chart without lines.

    Args:
        dark: Light on dark.
        margins: Left, right, top and bottom, pixels.
        x: What is said of the abscissa alone.
        y: Of the ordinate.
    """
    ink, grid = COLOURS[dark][:2]
    axis = {"axisLine": {"lineStyle": {"color": ink}}, "splitLine": {"lineStyle": {"color": grid}}, "type": "value"}
    axis |= {"axisLabel": {"color": ink, "fontSize": 11}, "nameTextStyle": {"color": ink, "fontSize": 12}}
    axis |= {"nameLocation": "middle", "name": ""}
    return {
        "animation": False,
        "grid": dict(zip(("left", "right", "top", "bottom"), margins, strict=True)),
        "xAxis": axis | x,
        "yAxis": axis | y,
        "tooltip": {"trigger": "axis", "confine": True, "textStyle": {"fontSize": 11}},
        "series": [],
    }


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
