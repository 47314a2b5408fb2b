"""The signature of one effect over the traces, test by test, with what everything else in the model leaves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from mjsim.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of the figure, height of a panel and of the room above it, left and below, inch.
_WIDTH, _PANEL, _GAP, _LEFT, _BOTTOM, _TOP = 9.6, 1.15, 0.5, 0.62, 0.5, 0.95

#: Reversals closer than this share a mark, deg.
_SAME_DEG = 1.0


@dataclass(frozen=True)
class SignatureTrace:
    """One test.

    Attributes:
        test: Name.
        phi_deg: φ of the test over all revolutions, (n,) deg.
        signature_um: What the effect changes in the reading, (n,) µm.
        residual_um: Measured less everything else in the model, (n,) µm; not a number where it is not judged.
        reversals: Axis letter -> φ of its reversals, deg.
    """

    test: str
    phi_deg: ArrayLike
    signature_um: ArrayLike
    residual_um: ArrayLike
    reversals: Mapping[str, Sequence[float]] = field(default_factory=dict)


def signature_figure(tests: Sequence[SignatureTrace], title: str, note: str = "") -> Figure:
    """One panel for each test, two in a row, all with the same scale.

    Args:
        tests: In the order of the panels, at least one.
        title: Heading.
        note: A line below the heading.

    Raises:
        ValueError: No test.
    """
    if not tests:
        raise ValueError("a figure of signatures needs at least one test")
    columns = min(2, len(tests))
    rows = math.ceil(len(tests) / columns)
    height = _TOP + rows * (_PANEL + _GAP) - _GAP + _BOTTOM
    figure = style.new_figure(_WIDTH, height)
    wide = (_WIDTH - 0.2) / columns
    limit = _limit(tests)
    for i, trace in enumerate(tests):
        row, column = divmod(i, columns)
        low = height - _TOP - row * (_PANEL + _GAP) - _PANEL
        place = (_LEFT + column * wide) / _WIDTH, low / height, (wide - _LEFT - 0.15) / _WIDTH, _PANEL / height
        axes = figure.add_axes(place)
        _panel(axes, trace, limit)
        if i + columns >= len(tests):
            axes.set_xlabel("φ, deg", fontsize=style.SMALL, color=style.INK)
        if not column:
            axes.set_ylabel("µm", fontsize=style.SMALL, color=style.INK)
    figure.text(_LEFT / _WIDTH, 1.0 - 0.22 / height, title, fontsize=style.TITLE, fontweight="bold", color=style.INK)
    figure.text(_LEFT / _WIDTH, 1.0 - 0.45 / height, note, fontsize=style.TEXT, color=style.SOFT)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="upper right", bbox_to_anchor=(1.0 - 0.2 / _WIDTH, 1.0 - 0.05 / height), ncols=2,
        fontsize=style.SMALL, frameon=False,
    )  # fmt: skip
    return figure


def _panel(axes: Axes, trace: SignatureTrace, limit: float) -> None:
    phi, signature, rest = (np.asarray(x, float) for x in (trace.phi_deg, trace.signature_um, trace.residual_um))
    low, high = float(phi.min()), float(phi.max())
    for place, letters in _marks(trace, low, high):
        colour = style.AXIS_COLOURS.get(letters[0], style.NOMINAL)
        axes.axvline(place, color=colour, linewidth=0.6, linestyle=(0, (3, 3)), alpha=0.6)
        axes.text(place, limit, letters, fontsize=5.5, color=colour, ha="center", va="bottom")
    axes.plot(phi, rest, color=style.NOMINAL, linewidth=0.5, alpha=0.75, label="measured less everything else")
    axes.plot(phi, signature, color=style.SIMULATED, linewidth=1.2, label="signature")
    axes.axhline(0.0, color=style.GRID, linewidth=0.6, zorder=0)
    axes.set_ylim(-limit, limit)
    axes.set_xlim(low, high)
    axes.set_title(
        f"{trace.test}   {style.micrometres(float(np.sqrt(np.mean(signature**2))))} RMS",
        fontsize=style.SMALL, color=style.INK, loc="left", pad=11,
    )  # fmt: skip
    axes.tick_params(labelsize=style.SMALL - 1.0, color=style.NOMINAL, labelcolor=style.INK, length=2)
    axes.locator_params(axis="y", nbins=5)
    axes.xaxis.set_major_locator(_ticks(high - low))
    for side, spine in axes.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=style.NOMINAL, linewidth=0.5)


def _marks(trace: SignatureTrace, low: float, high: float) -> list[tuple[float, str]]:
    """Places of reversals, each with the letters of all axes that reverse there."""
    out: list[tuple[float, str]] = []
    for place, axis in sorted((p, axis) for axis, places in trace.reversals.items() for p in places):
        if out and place - out[-1][0] < _SAME_DEG:
            out[-1] = (out[-1][0], out[-1][1] + axis)
        elif low <= place <= high:
            out.append((place, axis))
    return out


def _ticks(span: float):
    from matplotlib.ticker import MultipleLocator

    return MultipleLocator(next((s for s in (5, 15, 30, 45, 90, 180, 360) if span / s <= 8.5), 720))


def _limit(tests: Sequence[SignatureTrace]) -> float:
    """Half the height of all panels: what is seen of signatures and of nearly all of the residuals, µm."""
    signature = max(float(np.abs(np.asarray(t.signature_um, float)).max()) for t in tests)
    rest = [np.abs(np.asarray(t.residual_um, float)) for t in tests]
    usual = max(float(np.nanpercentile(r, 99.5)) if np.isfinite(r).any() else 0.0 for r in rest)
    return 1.1 * max(signature, usual, 1e-3)
