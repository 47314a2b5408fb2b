"""The error of the tool over the volume: arrows at the places of a grid, before and after the corrections."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjsim.plots import style
from mjsim.prediction.volumetric import VolumetricError
from mjsim.units import MM, UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Most arrows along one axis, and the length of the longest one as a share of their distance.
_ARROWS, _LONGEST = 5, 0.9


def volumetric_figure(error: VolumetricError, title: str) -> Figure:
    """Arrows of the tool's error, coloured by its length; a second box with the corrections where there are some.

    Args:
        error: Over a grid.
        title: Of the figure.
    """
    import mpl_toolkits.mplot3d  # noqa: F401  (registers the projection)
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    parts = [("as it is", error.shift, error.sizes())]
    if error.corrected_shift is not None and (after := error.corrected_sizes()) is not None:
        parts.append(("with the corrections", error.corrected_shift, after))
    figure = style.new_figure(0.9 + 4.2 * len(parts), 4.6)
    style.heading(figure, title)
    at, distance = _chosen(error)
    places = error.grid.points[at, :3] / MM
    most = max(float(np.linalg.norm(values[at], axis=1).max()) for _, values, _ in parts) or UM
    look = ScalarMappable(Normalize(0.0, most / UM), "viridis")
    width = 0.86 / len(parts)
    for k, (label, values, (rms, largest)) in enumerate(parts):
        axes = figure.add_axes((0.01 + width * k, 0.06, width - 0.02, 0.78), projection="3d")
        arrows = values[at] * (_LONGEST * distance / most)
        colours = look.to_rgba(np.linalg.norm(values[at], axis=1) / UM)
        for place, arrow, colour in zip(places, arrows, colours, strict=True):
            axes.plot(*np.column_stack([place, place + arrow]), color=colour, linewidth=1.2)
        axes.scatter(*(places + arrows).T, c=colours, s=7, depthshade=False)
        for letter, name in zip(error.grid.chain.linear, "xyz", strict=True):
            getattr(axes, f"set_{name}label")(f"{letter}, mm", fontsize=style.SMALL, color=style.INK)
            getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4))
        axes.tick_params(labelsize=style.SMALL - 1)
        axes.set(box_aspect=np.ptp(places, axis=0) / np.ptp(places, axis=0).max())
        text = f"{label}: RMS {rms / UM:.2g} µm, at most {largest / UM:.2g} µm"
        figure.text(0.01 + width * (k + 0.5), 0.87, text, ha="center", fontsize=style.TEXT, color=style.INK)
    bar = figure.colorbar(look, cax=figure.add_axes((0.93, 0.2, 0.012, 0.55)))
    bar.set_label("length of the error, µm", fontsize=style.SMALL, color=style.INK)
    bar.ax.tick_params(labelsize=style.SMALL)
    return figure


def _chosen(error: VolumetricError) -> tuple[np.ndarray, float]:
    """Places that get an arrow, and the smallest distance of two, mm."""
    shape = error.grid.shape
    kept = [np.unique(np.linspace(0, n - 1, min(n, _ARROWS)).round().astype(int)) for n in shape]
    number = np.arange(int(np.prod(shape))).reshape(shape[::-1])
    at = number[np.ix_(kept[2], kept[1], kept[0])].ravel()
    distance = min(float(np.diff(x[k]).min()) for x, k in zip(error.grid.ends, kept, strict=True)) / MM
    return at, distance
