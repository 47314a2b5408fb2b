"""The predicted error of a part as colour on its path, and along the path with its interval."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjsim.digits import estimate, interval
from mjsim.plots import style
from mjsim.prediction.result import Prediction
from mjsim.units import MM, UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Direction from which the part is seen, degrees.
_ELEVATION, _AZIMUTH = 32.0, -58.0


def part_figure(result: Prediction) -> Figure:
    """The path in 3D with the normal deviation as colour; below it the deviation of every block with its interval."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from mpl_toolkits.mplot3d.art3d import Line3DCollection
    from mpl_toolkits.mplot3d.axes3d import Axes3D

    error = np.linalg.norm(result.normal, axis=1) / UM
    xyz = result.path / MM
    figure = style.new_figure(7.0, 7.2)
    axes = figure.add_axes((0.02, 0.37, 0.82, 0.58), projection="3d")
    assert isinstance(axes, Axes3D)
    scale = Normalize(0.0, max(float(error.max()), 1e-6))
    joined = np.diff(result.cut_of) == 0  # nothing is drawn from path to path
    segments = np.stack([xyz[:-1], xyz[1:]], axis=1)[joined]
    shade = 0.5 * (error[1:] + error[:-1])[joined]
    axes.add_collection3d(Line3DCollection(list(segments), array=shade, cmap="viridis", norm=scale, linewidths=2.2))
    worst = int(np.argmax(error))
    axes.scatter(*xyz[worst : worst + 1].T, s=40, facecolors="none", edgecolors=style.SIMULATED, linewidths=1.5)
    _frame(axes, xyz)
    bar = figure.colorbar(ScalarMappable(norm=scale, cmap="viridis"), cax=figure.add_axes((0.86, 0.44, 0.022, 0.42)))
    bar.set_label("deviation normal to the path, µm", fontsize=style.TEXT)
    bar.ax.tick_params(labelsize=style.SMALL)
    title = _title(result)
    size = style.fitted(title, style.TITLE, 6.6)
    figure.text(0.5, 0.965, title, ha="center", fontsize=size, fontweight="bold", color=style.INK)
    _along(figure.add_axes((0.10, 0.08, 0.86, 0.24)), result)
    return figure


def _title(result: Prediction) -> str:
    ends = result.largest[1] / UM, result.largest[2] / UM
    text = f"{result.program}: largest {estimate(result.largest[0] / UM, ends)} µm (95 %: {interval(ends)} µm)"
    return f"{text}: {result.verdict.split(' with ')[0]}" if result.verdict else text


def _frame(axes, xyz: np.ndarray) -> None:
    """Equal scales, the workpiece's axes, and a plain look."""
    middle, half = 0.5 * (xyz.max(axis=0) + xyz.min(axis=0)), 0.5 * float(np.ptp(xyz, axis=0).max())
    flat = max(0.15 * half, 0.55 * float(np.ptp(xyz[:, 2])))
    for set_limits, m, h in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, (half, half, flat), strict=True):
        set_limits(m - h, m + h)
    axes.set_box_aspect((half, half, flat))
    axes.view_init(_ELEVATION, _AZIMUTH)
    for set_label, name in zip((axes.set_xlabel, axes.set_ylabel, axes.set_zlabel), "xyz", strict=True):
        set_label(f"{name}, mm", fontsize=style.SMALL)
    axes.tick_params(labelsize=style.SMALL - 1)
    if flat < 0.4 * half:
        axes.set_zticks([round(float(middle[2]), 1)])


def _along(axes, result: Prediction) -> None:
    """Blocks from first to last: deviation, interval, tolerance."""
    place = np.arange(1, len(result.blocks) + 1)
    value, low, high = (np.array([getattr(b, n) for b in result.blocks]) / UM for n in ("normal", "low", "high"))
    axes.fill_between(place, low, high, color=style.BAND, label="95 %", linewidth=0)
    axes.plot(place, value, color=style.SIMULATED, linewidth=0.9, label="deviation normal to the path")
    if result.tolerance is not None:
        axes.axhline(result.tolerance / UM, color=style.NOISE, linewidth=0.9, linestyle=(0, (4, 2)), label="allowed")
    axes.set_xlim(1, len(place))
    axes.set_ylim(0.0, 1.15 * max(float(high.max()), (result.tolerance or 0.0) / UM, 1e-6))
    axes.set_xlabel("block", fontsize=style.TEXT)
    axes.set_ylabel("µm", fontsize=style.TEXT)
    axes.tick_params(labelsize=style.SMALL)
    axes.grid(color=style.GRID, linewidth=0.5)
    style.legend_above(axes, 3)
    for side, spine in axes.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=style.NOMINAL, linewidth=0.6)
