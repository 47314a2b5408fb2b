"""What a model leaves unexplained, over the angle: residual, noise band and the places where axes reverse."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjsim.plots import series, style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Marks of one axis closer than this are one reversal, seen in several revolutions [deg].
SAME_PLACE_DEG = 0.5
#: Letters above the marks stand at least this far apart [points].
LETTER_PT = 7.5


@dataclass(frozen=True)
class ResidualTrace:
    """Residual of one test.

    Attributes:
        test: name of the test.
        phi_deg: (n,) φ of the test, or the axis angle of a rotary test; signed, over any number of revolutions [deg].
        residual_um: (n,) measured minus simulated after the nuisance fit [µm].
        reversals: axis letter -> angles at which the axis reverses, as ``phi_deg`` counts [deg].
        noise_um: standard deviation of the measurement noise of one sample [µm]; None when unknown.
        outlier: (n,) True where a sample is not to be judged; drawn grey, without effect on scale and RMS. None: no
            outliers.
        goes_round: whether the path is a closed circle, so that angles are shown modulo 360°.
    """

    test: str
    phi_deg: ArrayLike
    residual_um: ArrayLike
    reversals: Mapping[str, Sequence[float]] = field(default_factory=dict)
    noise_um: float | None = None
    outlier: ArrayLike | None = None
    goes_round: bool = True

    def good(self) -> NDArray[np.bool_]:
        """(n,) True where the residual is finite and no outlier."""
        finite = np.isfinite(np.asarray(self.residual_um, dtype=float))
        return finite if self.outlier is None else finite & ~np.asarray(self.outlier, dtype=bool)

    def rms_um(self) -> float:
        """Root mean square of the residual without outliers [µm]; NaN when nothing is left."""
        kept = np.asarray(self.residual_um, dtype=float)[self.good()]
        return float(np.sqrt(np.mean(kept**2))) if kept.size else float("nan")

    def full_circle(self) -> bool:
        """Whether the trace goes round at least once, so that its angles are shown modulo 360°."""
        return self.goes_round and float(np.ptp(np.asarray(self.phi_deg, dtype=float))) > 359.0


def residual_figure(tests: Sequence[ResidualTrace], title: str | None = None) -> Figure:
    """One panel per test, stacked, all with the same µm scale.

    Revolutions lie over each other: what repeats is the model's, what does not is noise or drift.

    Args:
        tests: in the order of the panels, at least one.
        title: heading.

    Raises:
        ValueError: no test given, or arrays of different length.
    """
    if not tests:
        raise ValueError("a residual figure needs at least one test")
    width_in, panel_in = 7.6, 1.35
    gap, top, bottom, left, right = 0.74, (0.3 if title else 0.0) + 0.5, 0.62, 0.72, 0.15
    height = top + bottom + len(tests) * panel_in + (len(tests) - 1) * gap
    figure = style.new_figure(width_in, height)
    limit = _limit_um(tests)
    for index, trace in enumerate(tests):
        y = height - top - (index + 1) * panel_in - index * gap
        axes = figure.add_axes((left / width_in, y / height, (width_in - left - right) / width_in, panel_in / height))
        _panel(axes, trace, limit)
        _marks(axes, trace, (width_in - left - right) * 72.0)
        across: dict[str, Any] = dict(transform=axes.transAxes, va="bottom", fontsize=style.SMALL + 0.5)
        lift = 1.0 + 0.2 / panel_in
        axes.text(0.0, lift, trace.test, ha="left", fontweight="bold", color=style.INK, **across)
        axes.text(1.0, lift, _summary(trace), ha="right", color=style.SOFT, **across)
    figure.axes[-1].set_xlabel("angle, deg", fontsize=style.TEXT, color=style.INK)
    if title:
        style.heading(figure, title)
    _legend(figure, tests, height)
    return figure


def reversal_angles(trace: ResidualTrace) -> list[tuple[str, float]]:
    """(axis, angle in deg) of every distinct reversal mark, sorted by angle; repeats in further revolutions
    are merged.
    """
    marks: list[tuple[str, float]] = []
    for axis, angles in trace.reversals.items():
        plotted = sorted(_shown(trace, np.asarray(list(angles), dtype=float)).tolist())
        kept: list[float] = []
        for angle in plotted:
            if not kept or angle - kept[-1] > SAME_PLACE_DEG:
                kept.append(angle)
        if trace.full_circle() and len(kept) > 1 and kept[0] + 360.0 - kept[-1] <= SAME_PLACE_DEG:
            kept.pop()
        marks.extend((axis, angle) for angle in kept)
    return sorted(marks, key=lambda mark: (mark[1], mark[0]))


def _shown(trace: ResidualTrace, phi_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.mod(phi_deg, 360.0) if trace.full_circle() else phi_deg


def _panel(axes: Axes, trace: ResidualTrace, limit: float) -> None:
    good = trace.good()
    phi, residual = np.asarray(trace.phi_deg, dtype=float), np.asarray(trace.residual_um, dtype=float)
    if trace.noise_um is not None:
        axes.axhspan(
            -2.0 * trace.noise_um,
            2.0 * trace.noise_um,
            color=style.BAND,
            linewidth=0,
            zorder=0,
            label="noise band, ±2σ",
        )
        for edge in (-2.0 * trace.noise_um, 2.0 * trace.noise_um):
            axes.axhline(edge, color=style.BAND_EDGE, linewidth=0.6, zorder=3.5)
    axes.axhline(0.0, color=style.NOMINAL, linewidth=0.6, zorder=1)
    if (~good).any():
        axes.plot(
            _shown(trace, phi[~good]),
            residual[~good],
            ".",
            color=style.OUTLIER,
            markersize=1.6,
            zorder=1.5,
            label="left out (outliers)",
        )
    angle, value = series.thinned(*series.broken(phi, np.where(good, residual, np.nan)))
    shown = _shown(trace, angle)
    wrap = np.flatnonzero(np.abs(np.diff(shown)) > 180.0) + 1
    axes.plot(
        np.insert(shown, wrap, np.nan),
        np.insert(value, wrap, np.nan),
        color=style.MEASURED,
        linewidth=0.65,
        zorder=3,
        label="residual",
    )
    axes.set_ylim(-limit, limit)
    if trace.full_circle():
        axes.set_xlim(0.0, 360.0)
        axes.set_xticks(range(0, 361, 30))
    else:
        shown = shown[np.isfinite(shown)]
        low, high = (float(shown.min()), float(shown.max())) if shown.size else (0.0, 360.0)
        margin = 0.01 * (high - low)
        step = next((s for s in (1, 2, 5, 10, 15, 30, 45, 60, 90) if (high - low) / s <= 13.0), 180)
        axes.set_xticks(np.arange(np.ceil((low - margin) / step), np.floor((high + margin) / step) + 1.0) * step)
        axes.set_xlim(low - margin, high + margin)
    axes.set_ylabel("residual, µm", fontsize=style.TEXT, color=style.INK)
    axes.tick_params(labelsize=style.SMALL, color=style.NOMINAL, labelcolor=style.INK, length=3)
    axes.yaxis.set_major_formatter(lambda v, _: style.number(round(v, 6) + 0.0))
    axes.xaxis.set_major_formatter(lambda v, _: style.number(round(v, 6) + 0.0))
    axes.grid(axis="y", color=style.GRID, linewidth=0.5)
    axes.set_axisbelow(True)
    for side, spine in axes.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=style.NOMINAL, linewidth=0.6)


def _marks(axes: Axes, trace: ResidualTrace, width_pt: float) -> None:
    low, high = axes.get_xlim()
    marks = [(axis, angle) for axis, angle in reversal_angles(trace) if low <= angle <= high]
    lines_pt = np.array([(angle - low) / (high - low) * width_pt for _, angle in marks])
    for (axis, angle), line_pt, letter_pt in zip(marks, lines_pt, spread(lines_pt, LETTER_PT), strict=True):
        colour = style.AXIS_COLOURS.get(axis, style.SOFT)
        line = axes.axvline(angle, color=colour, linewidth=0.8, linestyle=(0, (4, 2)), alpha=0.8, zorder=2)
        line.set_gid(f"reversal-{axis}")
        text = axes.annotate(
            axis, (angle, 1.0), xycoords=("data", "axes fraction"), xytext=(letter_pt - line_pt, 1.5),
            textcoords="offset points",
            ha="center", va="bottom", fontsize=style.SMALL, fontweight="bold", color=colour,
        )  # fmt: skip
        text.set_gid(f"reversal-letter-{axis}")


def spread(places: NDArray[np.float64], apart: float) -> NDArray[np.float64]:
    """Sorted places moved as little as needed to be ``apart``: each cluster is laid out round its own middle, the
    order stays.
    """
    clusters: list[list[float]] = []  # [middle, members]
    for place in places:
        clusters.append([float(place), 1.0])
        while len(clusters) > 1 and clusters[-1][0] - clusters[-2][0] < 0.5 * apart * (
            clusters[-1][1] + clusters[-2][1]
        ):
            (last, m), (before, n) = clusters.pop(), clusters.pop()
            clusters.append([(last * m + before * n) / (m + n), m + n])
    return np.array([middle + (k - 0.5 * (n - 1.0)) * apart for middle, n in clusters for k in range(int(n))])


def _summary(trace: ResidualTrace) -> str:
    text = f"RMS {style.micrometres(trace.rms_um())}"
    return text if trace.noise_um is None else f"{text}, noise σ {style.micrometres(trace.noise_um)}"


def _limit_um(tests: Sequence[ResidualTrace]) -> float:
    largest = 1e-3
    for trace in tests:
        kept = np.abs(np.asarray(trace.residual_um, dtype=float)[trace.good()])
        largest = max(largest, float(kept.max()) if kept.size else 0.0, 2.5 * (trace.noise_um or 0.0))
    return 1.06 * largest


def _legend(figure: Figure, tests: Sequence[ResidualTrace], height_in: float) -> None:
    from matplotlib.lines import Line2D

    found: dict[str, Artist] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    if any(reversal_angles(trace) for trace in tests):
        found["an axis reverses"] = Line2D([], [], color=style.SOFT, linewidth=0.8, linestyle=(0, (4, 2)))
    figure.legend(
        list(found.values()), list(found), loc="center", bbox_to_anchor=(0.5, 0.12 / height_in), ncols=len(found),
        frameon=False,
        fontsize=style.SMALL, handlelength=1.8, borderpad=0.0,
    )  # fmt: skip
