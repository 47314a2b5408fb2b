"""What corrections will bring: the error of every test as it is, as forecast, and after a perfect repair."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjsim.compensation.forecast import Forecast
from mjsim.plots import style
from mjsim.units import UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def forecast_figure(forecast: Forecast) -> Figure:
    """Bars of the RMS of every test, one group per test, the last group for all tests.

    Args:
        forecast: With at least one test.
    """
    names = [*(t.test.name for t in forecast.tests), "all tests"]
    rows = np.array([*(t.rms() for t in forecast.tests), forecast.rms()]) / UM
    height = 0.9 + 0.42 * len(names)
    figure = style.new_figure(6.6, height)
    left = min(0.42, 0.03 + 0.0115 * max(map(len, names)))
    axes = figure.add_axes((left, 0.55 / height, 0.9 - left, 1.0 - 0.95 / height))
    places = np.arange(len(names))[::-1]
    looks = (("as it is", style.MEASURED), ("forecast", style.SIMULATED), ("perfect repair", style.BAND_EDGE))
    most = max(float(rows.max()), 1e-3)
    for k, (label, colour) in enumerate(looks):
        axes.barh(places + 0.26 - 0.26 * k, rows[:, k], 0.24, color=colour, label=label)
        for y, value in zip(places + 0.26 - 0.26 * k, rows[:, k], strict=True):
            axes.text(value + 0.01 * most, y, f"{value:.2f}", va="center", fontsize=style.SMALL - 1, color=style.SOFT)
    axes.set_yticks(places, labels=names, fontsize=style.SMALL)
    axes.set_ylim(-0.6, len(names) - 0.4)
    axes.set_xlim(0.0, 1.12 * most)
    axes.set_xlabel("RMS about the set-up, µm", fontsize=style.TEXT, color=style.INK)
    axes.tick_params(labelsize=style.SMALL, length=0)
    axes.grid(axis="x", color=style.GRID, linewidth=0.5)
    axes.set_axisbelow(True)
    for side, spine in axes.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=style.NOMINAL, linewidth=0.6)
    figure.legend(*axes.get_legend_handles_labels(), loc="upper center", ncols=3, fontsize=style.SMALL, frameon=False)
    return figure
