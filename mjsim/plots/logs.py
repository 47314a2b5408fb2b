"""Plots of axis logs: error over time and over position, torque over velocity, radial deviation of a circle."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mjsim.commands.axis_log.compare import ComparedAxis, ComparedLog
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.plots import style
from mjsim.plots.polar import PolarTrace, polar_figure
from mjsim.units import DEG, MM, UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def log_files(test: LogTest) -> list[str]:
    """Names of the files that a log's figures go to."""
    return [f"{test.name}-{a}.png" for a in test.axes] + ([f"{test.name}-circle.png"] if test.circle else [])


def log_figures(t: ComparedLog) -> Iterator[tuple[str, Figure]]:
    """A figure for every axis of a log, and one for its circle, with their titles."""
    yield from ((f"{t.test.name}, axis {axis.axis}", axis_figure(t, axis)) for axis in t.channels)
    if t.circle is not None:
        yield f"{t.test.name}, radial deviation on the circle", circle_figure(t)


def axis_figure(log: ComparedLog, axis: ComparedAxis) -> Figure:
    """Four panels of one axis: following error and rest over time, rest over position, torque over velocity."""
    unit, symbol, travel, place = axis.channel.size, axis.channel.unit, axis.travel.size, axis.travel.unit
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
    time, measured, simulated = style.thinned(
        axis.time, (axis.command - axis.measured) / unit, (axis.command - axis.simulated) / unit
    )
    follow.plot(time, measured, color=style.MEASURED, lw=0.9, label="measured")
    follow.plot(time, simulated, color=style.SIMULATED, lw=0.8, label="simulated")
    style.label(follow, "time (s)", f"command less position ({symbol})")
    follow.legend(fontsize=style.SMALL, frameon=False, ncols=2, loc="upper right")
    time, residual, position = style.thinned(axis.time, axis.residual / unit, axis.measured / travel)
    rest.axhspan(-2 * axis.noise / unit, 2 * axis.noise / unit, color=style.BAND, lw=0)
    rest.plot(time, residual, color=style.INK, lw=0.7)
    style.label(rest, "time (s)", f"measured less simulated ({symbol})")
    forth = style.thinned(axis.velocity >= 0.0)[0]
    for way, colour, name in ((forth, style.SIMULATED, "forth"), (~forth, style.NOISE, "back")):
        over.plot(position[way], residual[way], ".", ms=1.2, color=colour, label=name)
    over.legend(fontsize=style.SMALL, frameon=False, markerscale=5, ncols=2)
    style.label(over, f"position ({place})", f"measured less simulated ({symbol})")
    speed, torque = style.thinned(axis.velocity / travel, axis.torque)
    if axis.recorded_torque is not None:
        recorded = style.thinned(axis.recorded_torque)[0]
        friction.plot(speed, recorded, ".", ms=1.2, color=style.MEASURED, label="recorded")
    friction.plot(speed, torque, ".", ms=1.0, color=style.SIMULATED, label="simulated")
    friction.legend(fontsize=style.SMALL, frameon=False, markerscale=5, ncols=2)
    style.label(friction, f"velocity ({place}/s)", "motor torque (N·m)")
    return figure


def circle_figure(log: ComparedLog) -> Figure:
    """The radial deviation of a log's circle as a polar plot, measured and simulated."""
    circle = log.circle
    assert circle is not None and log.test.circle is not None
    phi, measured, simulated = style.thinned(circle.phi / DEG, circle.measured / UM, circle.simulated / UM)
    traces = [
        PolarTrace("measured", phi, measured, "measured"),
        PolarTrace("simulated", phi, simulated, "simulated"),
    ]
    stated = log.test.circle
    conditions = (
        f"circle {''.join(stated.axes)}, radius {stated.radius / MM:g} mm, {stated.direction}; from the encoders"
    )
    return polar_figure(traces, log.test.name, conditions)
