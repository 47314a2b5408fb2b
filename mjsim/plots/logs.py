"""Plots of axis logs: error over time and over position, torque over velocity, radial deviation of a circle."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.plots import style
from mjsim.plots.polar import PolarTrace, polar_figure
from mjsim.plots.save import save
from mjsim.units import DEG, MM, UM
from mjsim.workflow.log_compare import ComparedAxis, ComparedLog, LogComparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Most points of one curve.
_POINTS = 4000


def log_plot_files(campaign: Campaign, folder: Path) -> list[Path]:
    """Files that :func:`log_plots` writes."""
    out = []
    for t in campaign.logs.recorded:
        out += [folder / f"{t.name}-{a}.png" for a in t.axes]
        if t.circle is not None:
            out.append(folder / f"{t.name}-circle.png")
    return out


def log_plots(result: LogComparison, folder: Path) -> list[Path]:
    """Write a figure for every axis of every log, and one for every circle; the files."""
    out = []
    for t in result.tests:
        for axis in t.axes.values():
            file = folder / f"{t.test.name}-{axis.axis}.png"
            save(axis_figure(t, axis), file)
            out.append(file)
        if t.circle is not None:
            file = folder / f"{t.test.name}-circle.png"
            save(circle_figure(t), file)
            out.append(file)
    return out


def _thin(*columns: np.ndarray) -> list[np.ndarray]:
    every = max(1, len(columns[0]) // _POINTS)
    return [c[::every] for c in columns]


def axis_figure(log: ComparedLog, axis: ComparedAxis) -> Figure:
    """Four panels of one axis: following error and rest over time, rest over position, torque over velocity."""
    unit, symbol, travel, place = (DEG, "°", DEG, "°") if axis.rotary else (UM, "µm", MM, "mm")
    figure = style.new_figure(8.4, 7.6)
    figure.suptitle(
        f"{log.test.name}, axis {axis.axis}: RMS of the rest {axis.rms / unit:.3g} {symbol}",
        fontsize=style.TITLE,
        x=0.08,
        ha="left",
    )
    grid = figure.add_gridspec(3, 2, left=0.09, right=0.98, top=0.92, bottom=0.07, hspace=0.42, wspace=0.26)
    follow, rest = figure.add_subplot(grid[0, :]), figure.add_subplot(grid[1, :])
    over, friction = figure.add_subplot(grid[2, 0]), figure.add_subplot(grid[2, 1])
    time, measured, simulated = _thin(
        axis.time, (axis.command - axis.measured) / unit, (axis.command - axis.simulated) / unit
    )
    follow.plot(time, measured, color=style.MEASURED, lw=0.9, label="measured")
    follow.plot(time, simulated, color=style.SIMULATED, lw=0.8, label="simulated")
    _label(follow, "time (s)", f"command less position ({symbol})")
    follow.legend(fontsize=style.SMALL, frameon=False, ncols=2, loc="upper right")
    time, residual, position = _thin(axis.time, axis.residual / unit, axis.measured / travel)
    rest.axhspan(-2 * axis.noise.rms / unit, 2 * axis.noise.rms / unit, color=style.BAND, lw=0)
    rest.plot(time, residual, color=style.INK, lw=0.7)
    _label(rest, "time (s)", f"measured less simulated ({symbol})")
    forth = _thin(axis.velocity >= 0.0)[0]
    for way, colour, name in ((forth, style.SIMULATED, "forth"), (~forth, style.NOISE, "back")):
        over.plot(position[way], residual[way], ".", ms=1.2, color=colour, label=name)
    over.legend(fontsize=style.SMALL, frameon=False, markerscale=5, ncols=2)
    _label(over, f"position ({place})", f"measured less simulated ({symbol})")
    speed, torque = _thin(axis.velocity / travel, axis.torque)
    if axis.recorded_torque is not None:
        recorded = _thin(axis.recorded_torque)[0]
        friction.plot(speed, recorded, ".", ms=1.2, color=style.MEASURED, label="recorded")
    friction.plot(speed, torque, ".", ms=1.0, color=style.SIMULATED, label="simulated")
    friction.legend(fontsize=style.SMALL, frameon=False, markerscale=5, ncols=2)
    _label(friction, f"velocity ({place}/s)", "motor torque (N·m)")
    return figure


def _label(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x, fontsize=style.TEXT)
    axes.set_ylabel(y, fontsize=style.TEXT)
    axes.tick_params(labelsize=style.SMALL)
    axes.grid(color=style.GRID, lw=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def circle_figure(log: ComparedLog) -> Figure:
    """The radial deviation of a log's circle as a polar plot, measured and simulated."""
    circle = log.circle
    assert circle is not None and log.test.circle is not None
    phi, measured, simulated = _thin(circle.phi / DEG, circle.measured / UM, circle.simulated / UM)
    traces = [
        PolarTrace("measured", phi, measured, "measured"),
        PolarTrace("simulated", phi, simulated, "simulated"),
    ]
    stated = log.test.circle
    conditions = (
        f"circle {''.join(stated.axes)}, radius {stated.radius / MM:g} mm, {stated.direction}; from the encoders"
    )
    return polar_figure(traces, log.test.name, conditions)
