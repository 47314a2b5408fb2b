"""An empirical curve with its uncertainty: what an unexplained error looks like over the variable that it depends
on.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from mjsim.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def curve_figure(
    x: ArrayLike,
    y: ArrayLike,
    spread: ArrayLike,
    labels: tuple[str, str],
    title: str | None = None,
    period: float | None = None,
) -> Figure:
    """The curve through its knots, with a band of 1.96 standard deviations.

    Args:
        x: (n,) knots of the variable. y: (n,) value there. spread: (n,) its standard deviation; same unit as ``y``.
        labels: of the two axes, with units. title: up to four lines. period: of the variable; marked where it fits in
            more than once.

    Raises:
        ValueError: the three differ in length, or there are fewer than two knots.
    """
    x, y, spread = (np.asarray(v, dtype=float) for v in (x, y, spread))
    if not (x.shape == y.shape == spread.shape) or x.ndim != 1 or x.size < 2:
        raise ValueError(
            f"knots, values and spreads must be vectors of one length above 1, not of {x.shape}, {y.shape}, "
            f"{spread.shape}"
        )
    figure = style.new_figure(7.2, 3.6)
    lines = textwrap.wrap(title or "", 100)
    axes = figure.add_axes((0.12, 0.15, 0.85, 0.74 - 0.04 * len(lines)))
    # knots that the tests hardly visit have no value; those of a simple shape differ in spread, but are all known
    height = float(np.nanmax(y) - np.nanmin(y)) if np.isfinite(y).any() else 0.0
    known = spread < max(10.0 * float(np.median(spread)), 0.1 * height, 1e-12)
    low, high = np.where(known, y - 1.96 * spread, np.nan), np.where(known, y + 1.96 * spread, np.nan)
    axes.fill_between(x, low, high, color=style.BAND, edgecolor=style.BAND_EDGE, linewidth=0.6, label="95 % band")
    axes.plot(
        x,
        np.where(known, y, np.nan),
        color=style.SIMULATED,
        linewidth=1.4,
        marker="o",
        markersize=2.5,
        label="empirical term",
    )
    axes.axhline(0.0, color=style.SOFT, linewidth=0.6)
    if period and 1.5 * period < np.ptp(x):
        for place in np.arange(np.ceil(x[0] / period) * period, x[-1], period):
            axes.axvline(place, color=style.GRID, linewidth=0.8, zorder=0)
    axes.set_xlabel(labels[0], fontsize=style.TEXT, color=style.INK)
    axes.set_ylabel(textwrap.fill(labels[1], 36), fontsize=style.TEXT, color=style.INK)
    axes.tick_params(labelsize=style.SMALL, colors=style.SOFT)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.01)
    style.legend_above(axes)
    if lines:
        figure.text(0.02, 0.97, "\n".join(lines), fontsize=style.TEXT, color=style.INK, va="top")
    return figure
