"""One look for all figures: colours, sizes, and a figure that needs neither pyplot nor a display."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mjsim.machine.axis import AXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

INK = "#1a1a1a"
SOFT = "#5c5c5c"
GRID = "#dedede"
NOMINAL = "#8a8a8a"
BAND = "#e4ebf2"
BAND_EDGE = "#8fb0d0"
OUTLIER = "#b9b9b9"

#: Near-black and vermilion differ in hue for every kind of colour vision and in lightness on a black-and-white print
#: (Okabe and Ito 2008).
MEASURED = "#222222"
SIMULATED = "#d9480f"

#: Axis letter (ISO 841) -> colour; always drawn with its letter, so that nothing hangs on the colour alone.
AXIS_COLOURS = dict(zip(AXES, ("#0072b2", "#007a5a", "#8a6d00", "#b3007d", "#a03c00", "#5b3fb5"), strict=True))
#: Colour of the noise level.
NOISE = "#0072b2"

#: Font sizes in points.
TITLE, TEXT, SMALL = 10.5, 8.5, 7.5


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty white figure of that size [inch] with an Agg canvas attached."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def heading(figure: Figure, text: str) -> None:
    """The title of a whole figure, in the middle of its first 0.4 inch."""
    down = 1.0 - 0.2 / figure.get_figheight()
    figure.text(0.5, down, text, ha="center", va="center", fontsize=TITLE, fontweight="bold", color=INK)


def polar_axes(figure: Figure, place: tuple[float, float, float, float]) -> PolarAxes:
    """New polar axes at (left, bottom, width, height) of the figure, as shares of its size."""
    from matplotlib.projections.polar import PolarAxes

    axes = figure.add_axes(place, projection="polar")
    assert isinstance(axes, PolarAxes)
    return axes


def canvas(figure: Figure) -> FigureCanvasAgg:
    """The canvas of a figure of :func:`new_figure`, which has its pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    assert isinstance(figure.canvas, FigureCanvasAgg)
    return figure.canvas


def fitted(text: str, size: float, width_in: float) -> float:
    """Font size [points] at which ``text`` keeps within ``width_in`` [inch]: ``size``, or less for a long text, by
    average letter width.
    """
    return min(size, width_in * 72.0 / (0.62 * max(len(text), 1)))


def nice_step(smallest: float) -> float:
    """The smallest of 1, 2, 5 x 10^k that is not less than ``smallest`` (> 0).

    >>> nice_step(0.34), nice_step(2.0)
    (0.5, 2.0)
    """
    import math

    decade = 10.0 ** math.floor(math.log10(smallest))
    for factor in (1.0, 2.0, 5.0, 10.0):
        if factor * decade >= smallest * (1.0 - 1e-9):
            return factor * decade
    raise ValueError(f"no step for {smallest}")


def step_below(largest: float) -> float:
    """The largest of 1, 2, 5 x 10^k that is not more than ``largest`` (> 0).

    >>> step_below(0.0345), step_below(2.0)
    (0.02, 2.0)
    """
    import math

    decade = 10.0 ** math.floor(math.log10(largest) + 1e-9)
    return max(f for f in (1.0, 2.0, 5.0) if f * decade <= largest * (1.0 + 1e-9)) * decade


def number(value: float) -> str:
    """A number as it is printed: up to four significant digits, a true minus sign, no trailing zeros."""
    return f"{value:.4g}".replace("-", "−")


def micrometres(value: float) -> str:
    """An error in µm for a label: two decimals below 10, one below 100, none above."""
    decimals = 2 if abs(value) < 9.995 else 1 if abs(value) < 99.95 else 0
    return f"{value:.{decimals}f} µm".replace("-", "−")


#: Most points of one curve.
_POINTS = 4000


def thinned(*columns: np.ndarray) -> list[np.ndarray]:
    """Columns (n,) with every so many-th value, so that a curve has no more points than can be seen."""
    every = max(1, len(columns[0]) // _POINTS)
    return [c[::every] for c in columns]


def label(axes: Axes, x: str, y: str) -> None:
    """Name the axes of a plain diagram, and give it a grid."""
    axes.set_xlabel(x, fontsize=TEXT)
    axes.set_ylabel(y, fontsize=TEXT)
    axes.tick_params(labelsize=SMALL)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def legend_above(axes: Axes, columns: int = 2, **more: Any) -> None:
    """The legend above the diagram, where it hides no data."""
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}
    axes.legend(fontsize=SMALL, frameon=False, ncols=columns, **place, **more)
