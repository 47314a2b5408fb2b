"""The error by cause: a waterfall from the machine as given down to the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjsim.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Height of one bar, and the space for labels left, right and below, inch.
_ROW, _LEFT, _RIGHT, _BOTTOM, _WIDTH = 0.27, 2.1, 0.95, 0.45, 8.4


@dataclass(frozen=True)
class Fall:
    """One cause: its name, its share of the explained squared error in per cent, the RMS residual with it in the
    model [µm], and whether it is a finding.
    """

    cause: str
    percent: float
    after_um: float
    finding: bool = False


def waterfall_figure(start_um: float, falls: Sequence[Fall], end_um: float, noise_um: float | None = None) -> Figure:
    """Bars from the RMS residual as given to that of the final model; every cause spans what it takes off.

    Args:
        start_um: RMS residual of the machine as given [µm].
        falls: causes, in the order in which they are drawn, at least one.
        end_um: RMS residual of the final model [µm].
        noise_um: RMS of the noise, drawn as a line [µm].

    Raises:
        ValueError: no cause.
    """
    if not falls:
        raise ValueError("a waterfall needs at least one cause")
    rows = len(falls) + 2
    height = (rows + 0.5) * _ROW + _BOTTOM + 0.05
    figure = style.new_figure(_WIDTH, height)
    axes = figure.add_axes(
        (_LEFT / _WIDTH, _BOTTOM / height, 1.0 - (_LEFT + _RIGHT) / _WIDTH, (rows + 0.5) * _ROW / height)
    )
    axes.barh(0, start_um, 0.62, color=style.NOMINAL)
    axes.barh(rows - 1, end_um, 0.62, color=style.NOMINAL)
    levels = [start_um, *(f.after_um for f in falls)]
    for i, (f, top) in enumerate(zip(falls, levels, strict=False), start=1):
        colour = style.SIMULATED if f.finding else style.BAND_EDGE
        axes.barh(i, top - f.after_um, 0.62, left=f.after_um, color=colour)
        axes.plot([f.after_um, f.after_um], [i - 0.31, i + 1.31], color=style.NOMINAL, linewidth=0.6)
        axes.annotate(
            f"{_share(f.percent)} %", (top, i), xytext=(5, 0), textcoords="offset points", va="center",
            fontsize=style.SMALL, color=style.INK,
        )  # fmt: skip
    for row, value in ((0, start_um), (rows - 1, end_um)):
        axes.annotate(
            style.micrometres(value), (value, row), xytext=(5, 0), textcoords="offset points", va="center",
            fontsize=style.TEXT, fontweight="bold", color=style.INK,
        )  # fmt: skip
    if noise_um is not None:
        axes.axvline(noise_um, color=style.NOISE, linewidth=1.0, linestyle=(0, (4, 2)))
        axes.annotate(
            f"noise {style.micrometres(noise_um)}", (noise_um, -0.95), xytext=(4, 0), textcoords="offset points",
            va="top", fontsize=style.SMALL, color=style.NOISE, annotation_clip=False,
        )  # fmt: skip
    labels = ["machine as given", *(f.cause for f in falls), "final model"]
    axes.set_yticks(range(rows), labels=labels, fontsize=style.SMALL + 0.5)
    axes.set_ylim(rows - 0.5, -1.0)
    axes.set_xlim(0.0, 1.02 * max(start_um, noise_um or 0.0))
    axes.set_xlabel("RMS residual, µm", fontsize=style.TEXT, color=style.INK)
    axes.tick_params(axis="y", length=0, labelcolor=style.INK)
    axes.tick_params(axis="x", labelsize=style.SMALL, color=style.NOMINAL, labelcolor=style.INK)
    axes.grid(axis="x", color=style.GRID, linewidth=0.5)
    axes.set_axisbelow(True)
    for side, spine in axes.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=style.NOMINAL, linewidth=0.6)
    return figure


def _share(percent: float) -> str:
    return "< 0.1" if percent < 0.1 else f"{percent:.{1 if percent < 10.0 else 0}f}"
