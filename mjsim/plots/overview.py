"""All tests of a campaign at a glance: a grid of small polar plots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mjsim.plots import polar, style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure


def overview_figure(
    tests: Sequence[tuple[str, Sequence[polar.PolarTrace]]],
    columns: int = 4,
    title: str | None = None,
) -> Figure:
    """One small polar plot per test, each with its scale below it.

    Args:
        tests: (name of the test, its traces); the legend is drawn once, from all labels that occur.
        columns: plots per row at most.
        title: heading of the whole figure.

    Raises:
        ValueError: no test given, or as :func:`mjsim.plots.polar.polar_figure`.
    """
    if not tests:
        raise ValueError("an overview needs at least one test")
    columns = min(columns, len(tests))
    rows = math.ceil(len(tests) / columns)
    cell_w, cell_h, plot = 2.05, 2.5, 1.68
    top, bottom = (0.42 if title else 0.08), 0.38
    width, height = max(columns * cell_w + 0.1, 3.4), rows * cell_h + top + bottom
    left = 0.5 * (width - columns * cell_w)
    figure = style.new_figure(width, height)
    legend: dict[str, Artist] = {}
    for index, (name, traces) in enumerate(tests):
        x = left + (index % columns) * cell_w + 0.5 * (cell_w - plot)
        y = height - top - (index // columns + 1) * cell_h + 0.36
        axes = style.polar_axes(figure, (x / width, y / height, plot / width, plot / height))
        step = polar.draw_polar(axes, traces, small=True)
        centre = (x + 0.5 * plot) / width
        figure.text(
            centre, (y + plot + 0.3) / height, name, ha="center", va="center", fontweight="bold", color=style.INK,
            fontsize=style.fitted(name, style.SMALL, cell_w - 0.1))  # fmt: skip
        figure.text(
            centre,
            (y - 0.14) / height,
            polar.scale_text(step),
            ha="center",
            va="center",
            fontsize=style.SMALL,
            color=style.SOFT,
        )
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            legend.setdefault(label, handle)
    if title:
        style.heading(figure, title)
    figure.legend(
        list(legend.values()), list(legend), loc="center", bbox_to_anchor=(0.5, 0.18 / height), ncols=max(len(legend),
            1), frameon=False,
        fontsize=style.TEXT, handlelength=1.8,
    )  # fmt: skip
    return figure
