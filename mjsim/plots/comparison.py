"""Plots of a comparison, whatever the instrument."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.any_instrument import PlainTest
from mjsim.commands.comparison import ComparedTest, Comparison
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.base import INSTRUMENTS, Over
from mjsim.instruments.sphere.measurement import SphereTest
from mjsim.plots import style
from mjsim.plots.logs import log_figures, log_files
from mjsim.plots.output import bar_plot_files, bar_plots
from mjsim.plots.points import points_figure
from mjsim.plots.save import save
from mjsim.progress import Progress, silent

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        place = {"loc": "upper right"} if over is None else {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}
        above.legend(fontsize=style.SMALL, frameon=False, ncols=2 if over is None else 4, **place)
        style.label(above, "", f"{c.channel.name} ({unit})")
        below.axhspan(-2 * c.noise / size, 2 * c.noise / size, color=style.BAND, lw=0)
        style.label(below, "", f"measured less simulated ({unit})")
    axes[-1].set_xlabel(f"{over.name} ({over.unit})" if over else "time (s)", fontsize=style.TEXT)
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
