"""The feed that a control really gives, and what its straight blocks do to the reading, over the angle."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from mjsim.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def feed_figure(
    phi_deg: ArrayLike, feed_mm_min: ArrayLike, reading_um: ArrayLike, nominal_mm_min: float, title: str = ""
) -> Figure:
    """Two panels over φ: peripheral feed with the nominal one, and the reading of an ideal machine.

    Args:
        phi_deg: (n + 1,) angle [deg]. feed_mm_min: (n,) feed between the angles [mm/min]. reading_um: (n + 1,) at the
            angles [µm].
        nominal_mm_min: the test's feed [mm/min]. title: heading.

    Raises:
        ValueError: the lengths do not fit each other.
    """
    phi, feed, reading = (np.asarray(v, dtype=float) for v in (phi_deg, feed_mm_min, reading_um))
    if not (phi.shape == reading.shape == (feed.size + 1,)):
        raise ValueError(
            f"angles and readings must be one more than the feeds, not {phi.shape}, {reading.shape}, {feed.shape}"
        )
    figure = style.new_figure(7.2, 4.4)
    upper, lower = figure.add_axes((0.11, 0.53, 0.86, 0.33)), figure.add_axes((0.11, 0.11, 0.86, 0.33))
    upper.axhline(nominal_mm_min, color=style.NOMINAL, linewidth=1.0, linestyle="--", label="nominal")
    upper.plot(0.5 * (phi[1:] + phi[:-1]), feed, color=style.SIMULATED, linewidth=0.6, label="by the blocks")
    lowest, highest = min(feed.min(), nominal_mm_min), max(feed.max(), nominal_mm_min)
    room = max(0.08 * (highest - lowest), 2e-4 * nominal_mm_min)  # a perfect feed is not magnified into noise
    upper.set_ylim(lowest - room, highest + room)
    upper.ticklabel_format(axis="y", useOffset=False)
    style.legend_above(upper)
    lower.axhline(0.0, color=style.NOMINAL, linewidth=1.0, linestyle="--")
    lower.plot(phi, reading, color=style.MEASURED, linewidth=0.5)
    lower.set_xlabel("φ, deg", fontsize=style.TEXT, color=style.INK)
    for axes, label in ((upper, "peripheral feed, mm/min"), (lower, "ideal machine's reading, µm")):
        axes.set_ylabel(label, fontsize=style.TEXT, color=style.INK)
        axes.tick_params(labelsize=style.SMALL, colors=style.SOFT)
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(x=0.01)
    turns = float(np.ptp(phi)) / 360.0
    every = 10.0 if turns < 0.2 else 30.0 if turns < 0.6 else 90.0 * max(1.0, np.ceil(turns / 3.0))
    for axes in (upper, lower):
        axes.set_xticks(np.arange(np.ceil(phi.min() / every - 1e-6), np.floor(phi.max() / every + 1e-6) + 1) * every)
    if title:
        figure.text(0.02, 0.985, textwrap.fill(title, 105), fontsize=style.TEXT, color=style.INK, va="top")
    return figure
