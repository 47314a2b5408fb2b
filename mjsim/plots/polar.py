"""Polar plot of circular traces, as in Kato, Tsutsumi and Sato, IJMTM 64 (2013) 1-11, figures 5 to 17.

0° at the right, angles counter-clockwise, the nominal circle half-way out, deviations magnified on concentric
divisions. A trace is plotted at its φ, which begins on the first axis of a circle, or at the axis angle of a rotary
test. The paper calls 180° what its appendix calls φ = 0: its own figures are turned by ``shift_deg``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.iso230 import least_squares_circle
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.plots import series, style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

#: Divisions from the centre to the nominal circle, and from there to the rim, unless the data need more.
INNER, OUTER = 5, 4
#: Largest deviation, in divisions, that the automatic scale allows.
FILL = 3.2

_LINES = {
    "measured": {"color": style.MEASURED, "linewidth": 1.45, "zorder": 3},
    "simulated": {"color": style.SIMULATED, "linewidth": 0.9, "zorder": 4},
    "nominal": {"color": style.SOFT, "linewidth": 0.9, "linestyle": (0, (5, 2)), "zorder": 3.5},
}


def centre_of(test: BallBarTest, phi: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """What a ball off its place adds to a reading: a, b and c of a cos φ + b sin φ + c.

    A plot takes it out: of a whole circle the eccentricity (ISO 230-4), of an arc the mean.

    Args:
        test: That was run.
        phi: (n,) rad, of valid samples.
        deviation: (n,) m.

    Returns:
        (3,) m.
    """
    round_ = kind_of(test).goes_round or (bool(test.component) and np.ptp(phi) > 2.0 * np.pi)
    if round_:  # a sphere off its place does the same to a coordinate
        try:
            return np.append(least_squares_circle(phi, deviation).centre_m, 0.0)
        except InputError:  # a gap of the trace leaves part of the circle open
            pass
    return np.array([0.0, 0.0, deviation.mean() if len(deviation) else 0.0])


def off_centre(centre: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Reading (n,) m that a centre of :func:`centre_of` makes at φ (n,) rad."""
    return centre[0] * np.cos(phi) + centre[1] * np.sin(phi) + centre[2]


@dataclass(frozen=True)
class PolarTrace:
    """One trace of a polar plot.

    Attributes:
        label: its name in the legend.
        phi_deg: (n,) φ of the test, or the axis angle of a rotary test; signed, over any number of revolutions [deg].
        deviation_um: (n,) deviation with eccentricity already removed, outward positive; NaN breaks the line [µm].
        style: "measured" (near-black), "simulated" (vermilion, thinner, on top) or "nominal" (dashed grey).
        shift_deg: plot angle minus ``phi_deg`` [deg]: 180 in the paper's figures.
        colour: another colour than the style's, for several traces of one kind.
        dashed: broken line, so that two colours differ in black and white as well.
    """

    label: str
    phi_deg: ArrayLike
    deviation_um: ArrayLike
    style: Literal["measured", "simulated", "nominal"] = "measured"
    shift_deg: float = 0.0
    colour: str | None = None
    dashed: bool = False

    def look(self) -> dict:
        """How matplotlib draws the line."""
        own = ({"color": self.colour} if self.colour else {}) | ({"linestyle": (0, (4, 1.5))} if self.dashed else {})
        return _LINES[self.style] | own


def polar_figure(
    traces: Sequence[PolarTrace],
    title: str,
    subtitle: str | None = None,
    um_per_div: float | None = None,
    size_in: float = 5.0,
) -> Figure:
    """Polar plot of ``traces`` over each other.

    Args:
        traces: drawn in the order given within each style.
        title: first line of the heading.
        subtitle: second line, smaller; conditions of the test.
        um_per_div: deviation per division [µm]; a nice step that fits the data when missing.
        size_in: width of the figure [inch]; it is a little higher than wide.

    Raises:
        ValueError: an unknown style, arrays of different length, or ``um_per_div`` not above 0.
    """
    top, bottom = (0.62 if subtitle else 0.42) + 0.26, 0.72
    side = size_in - 0.9
    figure = style.new_figure(size_in, side + top + bottom)
    height = side + top + bottom
    axes = style.polar_axes(figure, (0.45 / size_in, bottom / height, side / size_in, side / height))
    step = draw_polar(axes, traces, um_per_div)
    middle: dict[str, Any] = {"ha": "center", "va": "center"}
    size = style.fitted(title, style.TITLE, size_in - 0.4)
    figure.text(0.5, 1.0 - 0.22 / height, title, color=style.INK, fontweight="bold", fontsize=size, **middle)
    if subtitle:
        size = style.fitted(subtitle, style.TEXT, size_in - 0.3)
        figure.text(0.5, 1.0 - 0.44 / height, subtitle, color=style.SOFT, fontsize=size, **middle)
    figure.text(
        1.0 - 0.25 / size_in,
        (bottom - 0.02) / height,
        scale_text(step),
        ha="right",
        va="center",
        fontsize=style.TEXT,
        color=style.INK,
    )
    handles, labels = axes.get_legend_handles_labels()
    size = style.fitted("".join(labels) + 7 * "m" * len(labels), style.TEXT, size_in)
    figure.legend(
        handles, labels, loc="center", bbox_to_anchor=(0.5, 0.2 / height), ncols=len(labels), frameon=False,
        fontsize=size, handlelength=1.8, columnspacing=1.4, borderpad=0.0, borderaxespad=0.0,
    )  # fmt: skip
    return figure


def draw_polar(
    axes: PolarAxes, traces: Sequence[PolarTrace], um_per_div: float | None = None, small: bool = False
) -> float:
    """Draw the plot into polar ``axes``; radial data are deviations [µm], angles are plot angles [rad].

    Args:
        small: leave out angle labels except 0° and 90° and thin the lines, for a grid of plots.

    Returns:
        The deviation per division [µm].

    Raises:
        ValueError: as :func:`polar_figure`.
    """
    step = division_um(traces) if um_per_div is None else float(um_per_div)
    if not step > 0.0:
        raise ValueError(f"um_per_div must be above 0, not {um_per_div}")
    low, high = _range_um(traces)
    inner = max(INNER, math.ceil(-low / step) + 1)
    outer = max(OUTER, math.ceil(high / step))
    _frame(axes, inner, outer, step, small)
    for trace in traces:
        if trace.style not in _LINES:
            raise ValueError(f"style of trace '{trace.label}' must be one of {', '.join(_LINES)}, not '{trace.style}'")
        angle, value = series.thinned(*series.broken(trace.phi_deg, trace.deviation_um))
        look = trace.look()
        look["linewidth"] *= (0.65 if small else 1.0) * (0.8 if _turns(angle) > 1.5 else 1.0)
        axes.plot(np.radians(angle + trace.shift_deg), value, label=trace.label, solid_joinstyle="round", **look)
    return step


def division_um(traces: Sequence[PolarTrace]) -> float:
    """Deviation per division that suits the data: a 1-2-5 step [µm], never below 0.1 µm (the resolution of a ball
    bar).
    """
    low, high = _range_um(traces)
    return max(0.1, style.nice_step(max(-low, high, 1e-6) / FILL))


def scale_text(step_um: float) -> str:
    """The scale as the paper prints it: ``1 div.: 5 µm``."""
    return f"1 div.: {style.number(step_um)} µm"


def _frame(axes: PolarAxes, inner: int, outer: int, step: float, small: bool) -> None:
    axes.set_theta_zero_location("E")
    axes.set_theta_direction(1)
    axes.set_rorigin(-inner * step)
    axes.set_ylim(-inner * step, outer * step)
    axes.set_yticks([k * step for k in range(-inner + 1, outer)], labels=[])
    named = (0, 90) if small else (0, 90, 180, 270)
    axes.set_xticks(
        np.radians(np.arange(0, 360, 30)), labels=[f"{a}°" if a in named else "" for a in range(0, 360, 30)]
    )
    axes.tick_params(
        axis="x", pad=-2 if small else 1, labelsize=style.SMALL - 1.0 if small else style.TEXT, labelcolor=style.INK
    )
    axes.grid(color=style.GRID, linewidth=0.4 if small else 0.55)
    axes.set_axisbelow(True)
    for side in ("polar", "inner"):
        if side in axes.spines:
            axes.spines[side].set(color=style.GRID, linewidth=0.6)
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    label = None if small else "nominal circle"
    axes.plot(turn, np.zeros_like(turn), color=style.NOMINAL, linewidth=0.6 if small else 0.9, zorder=2, label=label)


def _range_um(traces: Sequence[PolarTrace]) -> tuple[float, float]:
    values = [np.asarray(trace.deviation_um, dtype=float).ravel() for trace in traces]
    every = np.concatenate(values) if values else np.zeros(0)
    every = every[np.isfinite(every)]
    return (min(float(every.min()), 0.0), max(float(every.max()), 0.0)) if every.size else (0.0, 0.0)


def _turns(angle_deg: np.ndarray) -> float:
    finite = angle_deg[np.isfinite(angle_deg)]
    return float(np.ptp(finite)) / 360.0 if finite.size else 0.0


# -- all tests of a campaign at a glance -------------------------------------------------------------------------------


def overview_figure(
    tests: Sequence[tuple[str, Sequence[PolarTrace]]],
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
        step = draw_polar(axes, traces, small=True)
        centre = (x + 0.5 * plot) / width
        figure.text(
            centre, (y + plot + 0.3) / height, name, ha="center", va="center", fontweight="bold", color=style.INK,
            fontsize=style.fitted(name, style.SMALL, cell_w - 0.1))  # fmt: skip
        figure.text(
            centre,
            (y - 0.14) / height,
            scale_text(step),
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
