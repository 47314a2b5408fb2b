"""Pitch errors from two encoders: the difference over one wave of the worm, and what each order explains."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mjsim.estimation.pitch.encoders import EncoderPitch
from mjsim.plots import style
from mjsim.units import DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: One unit of the drawings, rad, and a row's height, inch.
_MILLI, _ROW = 1e-3 * DEG, 2.5
#: Waves that are named in a spectrum at most.
_NAMED = 6


def encoders_figure(results: Sequence[tuple[str, EncoderPitch]], title: str) -> Figure:
    """One row for each axis: left its difference folded over one wave of the worm, right the spectrum.

    Args:
        results: What each row is called, and what was found.
        title: Of the whole figure.
    """
    figure = style.new_figure(10.0, _ROW * len(results) + 0.7)
    style.heading(figure, title)
    pairs = figure.subplots(len(results), 2, squeeze=False, width_ratios=(1.0, 1.7))
    for (left, right), (name, r) in zip(pairs, results, strict=True):
        _folded(left, name, r)
        _spectrum(right, r)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.4 / figure.get_figheight()))
    return figure


def _folded(axes, name: str, r: EncoderPitch) -> None:
    """The difference over one wave of the worm, without the waves that are no multiples of it, and its means."""
    order = r.worm[0] if r.worm else 2.0 * np.pi / r.arc
    others = [w for w in r.waves if w.order < 0.5 * order or abs(w.order / order - round(w.order / order)) > 0.05]
    value = r.difference - sum((w.amplitude * np.sin(w.order * r.position + w.phase) for w in others), np.zeros(1))
    phase = np.mod(order * r.position, 2.0 * np.pi) / DEG
    axes.plot(phase, value / _MILLI, ".", color=style.OUTLIER, markersize=1.5, rasterized=True)
    edges = np.linspace(0.0, 360.0, 21)
    means = [value[(phase >= a) & (phase < b)].mean() / _MILLI for a, b in pairwise(edges)]
    axes.stairs(means, edges, baseline=None, color=style.SIMULATED, linewidth=1.5)
    limit = 1.2 * float(np.quantile(np.abs(value), 0.99)) / _MILLI
    axes.set(xlim=(0.0, 360.0), ylim=(-limit, limit), xticks=(0, 90, 180, 270, 360))
    axes.set_xlabel("one wave of the worm [°]")
    axes.set_ylabel("error [10⁻³ °]")
    axes.set_title(name, fontsize=9, loc="left", color=style.INK)
    axes.grid(color=style.GRID, linewidth=0.6)


def _spectrum(axes, r: EncoderPitch) -> None:
    """What a wave of each order would explain beside the drift, over the noise there, and the limit."""
    axes.semilogy(r.orders, np.maximum(r.explained, 0.1), color=style.MEASURED, linewidth=0.9, label="data")
    axes.semilogy(r.orders, r.limit, "--", color=style.NOISE, linewidth=0.9, label="limit (1 in 1000)")
    top = float(r.explained.max())
    for w in sorted(r.waves, key=lambda w: -w.amplitude)[:_NAMED]:
        near = float(np.interp(w.order, r.orders, r.explained))
        axes.annotate(
            f"{w.order:.0f}",
            (w.order, max(near, 1.0)),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            fontsize=8,
        )
    axes.set(ylim=(0.1, 5.0 * top), xlim=(0.0, float(r.orders[-1])))
    axes.set_xlabel("waves per turn of the axis")
    axes.set_ylabel("explained / noise")
    axes.grid(color=style.GRID, linewidth=0.6)
    axes.legend(loc="upper right", fontsize=7, frameon=False)
