"""Quantities over several campaigns: one small panel each, with 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjsim.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class TrendSeries:
    """One panel: title, unit, value per campaign with the ends of its interval (None where there is none), and
    whether it changed.
    """

    title: str
    unit: str
    values: Sequence[float | None]
    lows: Sequence[float | None]
    highs: Sequence[float | None]
    changed: bool = False


def trend_figure(series: Sequence[TrendSeries], labels: Sequence[str]) -> Figure:
    """Small multiples over the campaigns ``labels``; panels of changed quantities are drawn in vermilion.

    Raises:
        ValueError: no series, or one whose length is not that of ``labels``.
    """
    if not series:
        raise ValueError("a trend needs at least one series")
    if any(len(s.values) != len(labels) for s in series):
        raise ValueError(f"every series needs {len(labels)} values, one per campaign")
    columns = min(3, len(series))
    rows = math.ceil(len(series) / columns)
    width, height = 7.6, 1.75 * rows + 0.1
    figure = style.new_figure(width, height)
    cell_w, cell_h = width / columns, 1.75
    for index, s in enumerate(series):
        x, y = (index % columns) * cell_w + 0.52, height - (index // columns + 1) * cell_h + 0.42
        axes = figure.add_axes((x / width, y / height, (cell_w - 0.62) / width, (cell_h - 0.75) / height))
        colour = style.SIMULATED if s.changed else style.MEASURED
        there = [(i, v) for i, v in enumerate(s.values) if v is not None]
        axes.plot(
            [i for i, _ in there], [v for _, v in there], "-o", color=colour, linewidth=0.9, markersize=3.5, zorder=3
        )
        for i, (low, high) in enumerate(zip(s.lows, s.highs, strict=True)):
            if low is not None and high is not None:
                axes.plot([i, i], [low, high], color=colour, linewidth=1.2, zorder=2)
        axes.set_xlim(-0.4, len(labels) - 0.6)
        axes.set_xticks(range(len(labels)), labels=labels)
        axes.tick_params(labelsize=style.SMALL - 1.0, color=style.NOMINAL, labelcolor=style.INK, length=2)
        axes.margins(y=0.2)
        axes.grid(axis="y", color=style.GRID, linewidth=0.5)
        axes.yaxis.set_major_formatter(lambda v, _: style.number(round(v, 9) + 0.0))
        for side, spine in axes.spines.items():
            spine.set(visible=side in ("left", "bottom"), color=style.NOMINAL, linewidth=0.6)
        title = f"{s.title}, {s.unit}" if s.unit else s.title
        axes.set_title(title, fontsize=style.fitted(title, style.SMALL, cell_w - 0.2), color=colour, loc="left", pad=4)
    return figure
