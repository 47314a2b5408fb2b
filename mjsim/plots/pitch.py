"""Pitch errors as the paper draws them: spectrum over peaks per revolution (its Fig. 3) and curves on the circle
(its Fig. 4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from mjsim.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

#: One unit of the drawings, deg.
MILLI = 1e-3
_LIMIT = "#0072b2"
#: Largest deviation, in divisions, that the automatic scale allows, and divisions by which the raw data stand further
#: out.
_FILL, _APART = 1.7, 2
#: Width of a label in peaks per revolution, at the usual size.
_LABEL = 70.0


@dataclass(frozen=True)
class PitchSpectrum:
    """One direction's spectrum: ``orders`` (m,) per revolution; ``amplitude``, ``floor``, ``limit`` (m,) in degrees.

    ``floor`` is the amplitude that noise alone gives, ``limit`` what a component must exceed. ``named``: (order,
    amplitude in degrees) of the components. ``teeth``: of the worm wheel; its multiples are marked.
    """

    title: str
    orders: ArrayLike
    amplitude: ArrayLike
    floor: ArrayLike
    limit: ArrayLike
    named: Sequence[tuple[float, float]]
    teeth: int


@dataclass(frozen=True)
class PitchCurves:
    """One direction's curves over the axis position, (n,) each, in degrees: raw, modified, identified."""

    title: str
    position: ArrayLike
    raw: ArrayLike
    modified: ArrayLike
    identified: ArrayLike


def draw_spectrum(axes, spectrum: PitchSpectrum, top: float | None = None) -> None:
    """Draw one direction into ``axes``: amplitude in 10⁻³ degrees over the number of peaks per revolution.

    Args:
        top: end of the amplitude axis, degrees; what the data need when missing.
    """
    orders, amplitude = np.asarray(spectrum.orders, float), np.asarray(spectrum.amplitude, float) / MILLI
    sizes = [a for _, a in spectrum.named]
    top = (top or 1.15 * max([*sizes, float(amplitude.max()) * MILLI, 1e-6])) / MILLI
    teeth = np.arange(spectrum.teeth, orders[-1] + 1, spectrum.teeth)
    axes.vlines(
        teeth, 0.0, top, color=style.GRID, linewidth=0.7, zorder=0, label=f"multiples of {spectrum.teeth} teeth"
    )
    axes.plot(orders, amplitude, color=style.MEASURED, linewidth=0.8, zorder=3, label="modified data")
    axes.plot(
        orders,
        np.asarray(spectrum.limit) / MILLI,
        color=_LIMIT,
        linewidth=0.9,
        linestyle=(0, (4, 2)),
        zorder=4,
        label="least size of a component",
    )
    axes.fill_between(
        orders, 0.0, np.asarray(spectrum.floor) / MILLI, color=style.BAND_EDGE, linewidth=0.0, zorder=2, label="noise"
    )
    if spectrum.named:
        n, size = np.array(spectrum.named, float).T
        axes.plot(
            n,
            size / MILLI,
            "o",
            color=style.SIMULATED,
            markersize=3.2,
            markeredgewidth=0.0,
            zorder=5,
            label="identified",
        )
    axes.set_xlim(0.0, orders[-1])
    axes.set_ylim(0.0, top)
    _name(axes, spectrum.named, top)
    axes.text(
        0.995,
        0.93,
        spectrum.title,
        transform=axes.transAxes,
        ha="right",
        va="top",
        fontsize=style.TEXT,
        fontweight="bold",
    )
    axes.tick_params(labelsize=style.SMALL, color=style.NOMINAL, labelcolor=style.INK)
    for side, spine in axes.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=style.NOMINAL, linewidth=0.6)


def _name(axes, named: Sequence[tuple[float, float]], top: float) -> None:
    """``N=72`` and so on at the components, each label at a height of its own where they would touch."""
    taken: list[tuple[float, float]] = []
    low, high = axes.get_xlim()
    before = low - 1000.0
    for n, size in sorted(named):
        x = min(max(n, low + 0.5 * _LABEL), high - 0.5 * _LABEL)
        if n - before < 0.6 * _LABEL:
            x = min(before + 0.7 * _LABEL, high - 0.5 * _LABEL)  # clear of the line that leads up to its neighbour
        before = n
        y = size / MILLI + 0.03 * top
        while any(abs(x - x0) < _LABEL and abs(y - y0) < 0.085 * top for x0, y0 in taken):
            y += 0.02 * top
        y = min(y, 0.93 * top)
        taken.append((x, y))
        axes.annotate(
            f"N={n:.4g}", (n, size / MILLI), (x, y), ha="center", va="bottom", fontsize=style.SMALL,
            color=style.SIMULATED,
            arrowprops={"arrowstyle": "-", "color": style.SIMULATED, "linewidth": 0.4, "shrinkA": 0.0, "shrinkB": 2.0},
            zorder=6,
        )  # fmt: skip


def division_deg(curves: Sequence[PitchCurves]) -> float:
    """Degrees per division that suit all curves: 1, 2 or 4 times a power of ten (the paper's is 4×10⁻³)."""
    largest = max(max(float(np.abs(v).max()) for v in _values(c)) for c in curves)
    smallest = max(largest, 1e-7) / _FILL
    decade = 10.0 ** math.floor(math.log10(smallest))
    return next(f * decade for f in (1.0, 2.0, 4.0, 10.0) if f * decade >= smallest * (1.0 - 1e-9))


def _values(curves: PitchCurves) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    raw = np.asarray(curves.raw, float)
    return raw - raw.mean(), np.asarray(curves.modified, float), np.asarray(curves.identified, float)


def draw_curves(axes: PolarAxes, curves: PitchCurves, degrees_per_div: float | None = None) -> float:
    """Draw one direction into polar ``axes``: modified and identified about one zero circle, raw about another, two
    divisions further out.

    Returns:
        Degrees per division.

    Raises:
        ValueError: ``degrees_per_div`` not above 0.
    """
    x = np.asarray(curves.position, float)
    raw, modified, identified = _values(curves)
    step = float(degrees_per_div) if degrees_per_div is not None else division_deg([curves])
    if not step > 0.0:
        raise ValueError(f"degrees_per_div must be above 0, not {degrees_per_div}")
    outer = _APART + max(1, math.ceil(float(raw.max()) / step))
    inner = 1 + max(3, math.ceil(-min(float(modified.min()), float(identified.min())) / step))
    axes.set_theta_zero_location("E")
    axes.set_rorigin(-inner * step)
    axes.set_ylim(-inner * step, outer * step)
    axes.set_yticks([k * step for k in range(-inner + 1, outer)], labels=[])
    axes.set_xticks(
        np.radians(np.arange(0, 360, 30)), labels=[f"{a}°" if a % 90 == 0 else "" for a in range(0, 360, 30)]
    )
    axes.tick_params(axis="x", pad=0, labelsize=style.SMALL, labelcolor=style.INK)
    axes.grid(color=style.GRID, linewidth=0.5)
    axes.set_axisbelow(True)
    angle = np.radians(x)
    turn = np.linspace(0.0, 2 * np.pi, 361) if np.ptp(x) > 300.0 else np.linspace(angle.min(), angle.max(), 181)
    for circle in (0.0, _APART * step):
        axes.plot(turn, np.full_like(turn, circle), color=style.NOMINAL, linewidth=0.6, zorder=2)
    axes.plot(angle, raw + _APART * step, color=style.NOISE, linewidth=0.7, zorder=3, label="raw data, further out")
    axes.plot(angle, modified, color=style.MEASURED, linewidth=1.5, zorder=4, label="modified data")
    axes.plot(angle, identified, color=style.SIMULATED, linewidth=0.6, zorder=5, label="identified data")
    if np.ptp(x) < 100.0:
        axes.set_thetamin(float(np.floor(x.min() / 30.0) * 30.0))
        axes.set_thetamax(float(np.ceil(x.max() / 30.0) * 30.0))
    for spine in axes.spines.values():
        spine.set(color=style.GRID, linewidth=0.6)
    return step


def scale_text(degrees_per_div: float) -> str:
    """The scale as the paper prints it: ``1 div.: 4×10⁻³ deg``."""
    return f"1 div.: {style.number(degrees_per_div / MILLI)}×10⁻³ deg"


def spectrum_figure(spectra: Sequence[PitchSpectrum], title: str) -> Figure:
    """Spectra over each other on one scale, as in the paper's Fig. 3.

    Raises:
        ValueError: no spectrum.
    """
    if not spectra:
        raise ValueError("a figure needs at least one spectrum")
    width, each, head, foot = 7.2, 2.1, 0.25, 0.8
    height = each * len(spectra) + head + foot
    figure = style.new_figure(width, height)
    top = 1.2 * max(max([float(np.max(s.amplitude)), *(a for _, a in s.named)]) for s in spectra)
    for i, s in enumerate(spectra):
        axes = figure.add_axes(
            (
                0.6 / width,
                (foot + (len(spectra) - 1 - i) * each) / height,
                (width - 0.8) / width,
                (each - 0.25) / height,
            )
        )
        draw_spectrum(axes, s, top)
        axes.set_ylabel("amplitude, 10⁻³ deg", fontsize=style.SMALL, color=style.INK)
        if i == len(spectra) - 1:
            axes.set_xlabel("number of peaks per revolution", fontsize=style.TEXT, color=style.INK)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="center",
        bbox_to_anchor=(0.5, 0.17 / height),
        ncols=5,
        frameon=False,
        fontsize=style.SMALL,
        handlelength=1.8,
    )
    style.heading(figure, title)
    return figure


def curves_figure(curves: Sequence[PitchCurves], title: str) -> Figure:
    """Curves side by side, as in the paper's Fig. 4.

    Raises:
        ValueError: no curves, or as :func:`draw_curves`.
    """
    if not curves:
        raise ValueError("a figure needs at least one direction")
    side, head, foot = 3.6, 0.4, 0.75
    width, height = side * len(curves) + 0.2, side + head + foot + 0.2
    figure = style.new_figure(width, height)
    shared = division_deg(curves)
    for i, c in enumerate(curves):
        place = ((0.1 + side * i + 0.3) / width, foot / height, (side - 0.6) / width, (side - 0.1) / height)
        axes = style.polar_axes(figure, place)
        step = draw_curves(axes, c, shared)
        centre = (0.1 + side * (i + 0.5)) / width
        figure.text(
            centre,
            (foot - 0.12) / height,
            f"{c.title}, {scale_text(step)}",
            ha="center",
            va="center",
            fontsize=style.TEXT,
        )
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="center", bbox_to_anchor=(0.5, 0.2 / height), ncols=3, frameon=False, fontsize=style.TEXT
    )
    style.heading(figure, title)
    return figure
