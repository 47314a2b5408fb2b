"""Plots of a comparison, whatever the instrument."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.any_instrument import PlainTest
from mjsim.commands.axis_log.compare import ComparedAxis, ComparedLog
from mjsim.commands.comparison import ComparedTest, Comparison
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.base import INSTRUMENTS, Over
from mjsim.instruments.sphere.measurement import SphereTest, sphere_columns
from mjsim.machine.chain import COORDINATES
from mjsim.plots import style
from mjsim.plots.output import bar_plot_files, bar_plots
from mjsim.plots.polar import PolarTrace, polar_figure
from mjsim.plots.save import save
from mjsim.progress import Progress, silent
from mjsim.units import DEG, MM, UM

# -- plots of axis logs ------------------------------------------------------------------------------------------------

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def log_files(test: LogTest) -> list[str]:
    """Names of the files that a log's figures go to."""
    return [f"{test.name}-{a}.png" for a in test.axes] + ([f"{test.name}-circle.png"] if test.circle else [])


def log_figures(t: ComparedLog) -> Iterator[tuple[str, Figure]]:
    """A figure for every axis of a log, and one for its circle, with their titles."""
    yield from ((f"{t.test.name}, axis {axis.axis}", axis_figure(t, axis)) for axis in t.channels)
    if t.circle is not None:
        yield f"{t.test.name}, radial error on the circle", circle_figure(t)


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
    style.label(follow, "time, s", f"command less position, {symbol}")
    style.legend_above(follow)
    time, residual, position = style.thinned(axis.time, axis.residual / unit, axis.measured / travel)
    rest.axhspan(-2 * axis.noise / unit, 2 * axis.noise / unit, color=style.BAND, lw=0)
    rest.plot(time, residual, color=style.INK, lw=0.7)
    style.label(rest, "time, s", f"measured less simulated, {symbol}")
    forth = style.thinned(axis.velocity >= 0.0)[0]
    for way, colour, name in ((forth, style.SIMULATED, "forth"), (~forth, style.NOISE, "back")):
        over.plot(position[way], residual[way], ".", ms=1.2, color=colour, label=name)
    style.legend_above(over, markerscale=5)
    style.label(over, f"position, {place}", f"measured less simulated, {symbol}")
    speed, torque = style.thinned(axis.velocity / travel, axis.torque)
    if axis.recorded_torque is not None:
        recorded = style.thinned(axis.recorded_torque)[0]
        friction.plot(speed, recorded, ".", ms=1.2, color=style.MEASURED, label="recorded")
    friction.plot(speed, torque, ".", ms=1.0, color=style.SIMULATED, label="simulated")
    style.legend_above(friction, markerscale=5)
    style.label(friction, f"velocity, {place}/s", "motor torque, N·m")
    return figure


def circle_figure(log: ComparedLog) -> Figure:
    """The radial error of a log's circle as a polar plot, measured and simulated."""
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


# -- error vectors of a probed sphere where it was found, and what the model leaves of them point by point -------------

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
    columns = sphere_columns(test, points.position).reshape(-1, 3)

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
        style.label(axes, f"{COORDINATES[i]}, mm", f"{COORDINATES[j]}, mm")
        if column == 0:
            style.legend_above(axes)
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
    style.legend_above(axes, 3)
    style.label(axes, "point", "measured less simulated, µm")
    return figure


def plot_files(campaign: Campaign, folder: Path) -> list[Path]:
    """Files that :func:`comparison_plots` writes for the measured tests of a campaign."""
    out: list[Path] = []
    for name, part in campaign.measured_parts.items():
        if INSTRUMENTS[name].in_motion:
            out += bar_plot_files(part.measured, folder)
        else:
            out += [folder / f for t in part.measured for f in _files(t)]
    return out


def comparison_plots(result: Comparison, folder: Path, progress: Progress = silent) -> list[Path]:
    """Draw all tests into a folder.

    Args:
        result: What is drawn.
        folder: Where the files are written.
        progress: Called as work gets on.

    Returns:
        The files.
    """
    out: list[Path] = []
    for part in result.parts:
        if INSTRUMENTS[part.instrument].in_motion:
            out += bar_plots(part, folder, progress)
            continue
        for i, t in enumerate(part.tests):
            progress("plotting", i, len(part.tests))
            for name, (_, figure) in zip(_files(t.test), titled_figures(t), strict=True):
                save(figure, folder / name)
                out.append(folder / name)
    return out


def _files(test: Any) -> list[str]:
    return log_files(test) if test.instrument == LogTest.instrument else [f"{test.name}.png"]


def titled_figures(t: Any) -> Iterator[tuple[str, Figure]]:
    """The figures of one test that is no ball-bar test, with their titles, in the order of its files."""
    if t.test.instrument == LogTest.instrument:
        return log_figures(t)
    draw = points_figure if t.test.instrument == SphereTest.instrument else channels_figure
    return iter([(t.test.name, draw(t))])


def channels_figure(t: ComparedTest) -> Figure:
    """Measured and simulated over time, and what is left between them, for every channel of a test; over what the
    instrument says, where it says something else.
    """
    over = INSTRUMENTS[t.test.instrument].over(t.test, t.recording) if isinstance(t, PlainTest) else None
    figure = style.new_figure(8.4, 1.0 + 4.2 * len(t.channels))
    axes = figure.subplots(2 * len(t.channels), 1, sharex=True, squeeze=False)[:, 0]
    figure.suptitle(t.test.name, fontsize=style.TITLE, x=0.08, ha="left")
    for c, above, below in zip(t.channels, axes[::2], axes[1::2], strict=True):
        size, unit = c.channel.size, c.channel.unit
        rows = tuple(v[c.valid] / size for v in (c.measured, c.simulated, c.residual))
        if over is None:
            time, measured, simulated, residual = style.thinned(c.time[c.valid], *rows)
            above.plot(time, measured, color=style.MEASURED, lw=0.9, label="measured")
            above.plot(time, simulated, color=style.SIMULATED, lw=0.8, label="simulated")
            below.plot(time, residual, color=style.INK, lw=0.7)
        else:
            _series(above, below, over, c.valid, rows)
        style.legend_above(above, 2 if over is None else 4)
        style.label(above, "", f"{c.channel.name}, {unit}")
        below.axhspan(-2 * c.noise / size, 2 * c.noise / size, color=style.BAND, lw=0)
        style.label(below, "", f"measured less simulated, {unit}")
    axes[-1].set_xlabel(f"{over.name}, {over.unit}" if over else "time, s", fontsize=style.TEXT)
    figure.tight_layout()
    return figure


def _series(above: Any, below: Any, over: Over, valid: np.ndarray, rows: tuple[np.ndarray, ...]) -> None:
    """Measured values as markers, simulated ones as lines, and residuals as markers, series by series."""
    measured, simulated, residual = rows
    series = np.array(over.series)[valid]
    x = over.value[valid]
    for word, marker, dash in zip(dict.fromkeys(over.series), "^vos", ("-", "--", ":", "-."), strict=False):
        mine = np.flatnonzero(series == word)
        order = mine[np.argsort(x[mine], kind="stable")]
        above.plot(x[mine], measured[mine], marker, color=style.MEASURED, ms=4, mfc="none", label=f"measured {word}")
        above.plot(x[order], simulated[order], dash, color=style.SIMULATED, lw=0.9, label=f"simulated {word}")
        below.plot(x[mine], residual[mine], marker, color=style.INK, ms=3, mfc="none")
