"""Error vectors of a probed sphere where it was found, and what the model leaves of them point by point."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mjsim.instruments.sphere.instrument import sphere_columns
from mjsim.machine.chain import COORDINATES
from mjsim.plots import style
from mjsim.units import MM, UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Length of the longest arrow as a share of the picture.
_LONGEST = 0.16
#: Steps of a round length.
_ROUND = np.array([1.0, 2.0, 5.0])


def points_figure(t: Any) -> Figure:
    """Two views of the sphere's places in the machine frame with the deviations as arrows, and the rest by point.

    The place of the sphere on the table is fitted and taken out; everything else is as measured.

    Args:
        t: A compared test of a probed sphere.
    """
    test, points = t.test, t.recording
    places = points.position[:, test.chain.linear_columns] / MM
    columns = sphere_columns(test, points).reshape(-1, 3)

    def about(deviation: np.ndarray) -> np.ndarray:
        place = np.linalg.lstsq(columns, deviation.ravel(), rcond=None)[0]
        return (deviation - (columns @ place).reshape(-1, 3)) / UM

    found = about(np.column_stack([c.measured for c in t.channels]))
    rest = np.column_stack([c.residual for c in t.channels]) / UM
    figure = style.new_figure(8.4, 7.6)
    grid = figure.add_gridspec(
        2, 2, height_ratios=(1.5, 1.0), hspace=0.32, wspace=0.28, top=0.9, bottom=0.07, left=0.09, right=0.97
    )
    figure.suptitle(test.name, fontsize=style.TITLE, x=0.09, ha="left")
    longest = max(float(np.linalg.norm(found, axis=1).max()), 1e-3)
    extent = max(float(np.ptp(places, axis=0).max()), 10.0)
    size = _LONGEST * extent / longest  # mm in the picture per µm
    shown = longest * 0.5
    shown = float(np.max(_ROUND[_ROUND <= shown / 10 ** np.floor(np.log10(shown))])) * 10 ** np.floor(np.log10(shown))
    for column, (i, j) in enumerate(((0, 1), (1, 2))):
        axes = figure.add_subplot(grid[0, column])
        for vectors, colour, width, label in (
            (found, style.MEASURED, 1.1, "measured"),
            (rest, style.SIMULATED, 1.4, "left by the model"),
        ):
            ends = places + size * vectors
            for k in range(len(places)):
                axes.annotate(
                    "",
                    ends[k, [i, j]],
                    places[k, [i, j]],
                    arrowprops={
                        "arrowstyle": "-|>",
                        "color": colour,
                        "lw": width,
                        "mutation_scale": 7,
                        "shrinkA": 0,
                        "shrinkB": 0,
                    },
                )
            axes.plot([], [], color=colour, lw=width, label=label)
        axes.plot(places[:, i], places[:, j], ".", color=style.INK, ms=3)
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.15)
        style.label(axes, f"{COORDINATES[i]} (mm)", f"{COORDINATES[j]} (mm)")
        if column == 0:
            axes.legend(fontsize=style.SMALL, frameon=False, loc="upper left")
    figure.text(
        0.97,
        0.925,
        f"arrows {size * 1e3:.3g} times as long as what they show: {shown:g} µm is {shown * size:.3g} mm",
        ha="right",
        fontsize=style.SMALL,
        color=style.SOFT,
    )
    axes = figure.add_subplot(grid[1, :])
    noise = t.channels[0].noise / UM
    axes.axhspan(-2 * noise, 2 * noise, color=style.BAND, lw=0)
    number = np.arange(1, len(rest) + 1)
    for values, c, marker in zip(rest.T, t.channels, "os^", strict=True):
        axes.plot(number, values, marker, ms=3.5, label=c.channel.name)
    axes.legend(fontsize=style.SMALL, frameon=False, ncols=3, loc="upper right")
    style.label(axes, "point", "measured less simulated (µm)")
    return figure
