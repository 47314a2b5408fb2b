"""The polar figures and Fig. 9 on paper: panels side by side, the caption below."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.instruments.ball_bar.iso230 import least_squares_circle
from mjsim.instruments.ball_bar.program import Program
from mjsim.paper import caption
from mjsim.paper.contents import OFFSET_LOOK, VELOCITY_OFFSETS, VELOCITY_PANELS, Line, PolarFigure, offset_label
from mjsim.paper.runs import ANGLE, Run, Traces
from mjsim.plots import polar, style
from mjsim.units import UM

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

_SIDE = {1: 4.2, 2: 3.4, 3: 2.9}
_ASSUMED = "Drive values that the paper does not print are assumed (example kato2013)."


def polar_figure(figure: PolarFigure, traces: Traces, campaign: Campaign) -> Figure:
    """One of the figures 5 to 8 and 10 to 17."""
    columns, side = figure.columns, _SIDE[figure.columns]
    rows = -(-len(figure.panels) // columns)
    cell_w, cell_h = side + 0.75, side + 0.88
    width = columns * cell_w + 0.2
    text_below = _caption(figure)
    bottom = 0.34 + caption.LINE * len(caption.lines(text_below, width))
    height = rows * cell_h + bottom + 0.05
    sheet = style.new_figure(width, height)
    names: dict[str, Artist] = {}
    for i, panel in enumerate(figure.panels):
        x = 0.1 + (i % columns) * cell_w + 0.5 * (cell_w - side)
        y = height - (i // columns + 1) * cell_h + 0.5
        axes = style.polar_axes(sheet, (x / width, y / height, side / width, side / height))
        level = any(isinstance(line.source, str) for line in panel.lines)
        polar.draw_polar(axes, [_trace(line, traces, campaign, level) for line in panel.lines], panel.um_per_div)
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            names.setdefault(label, handle)
        text: dict[str, Any] = {"va": "center", "color": style.INK}
        sheet.text(
            x / width, (y - 0.36) / height, panel.caption, ha="left", fontsize=style.TEXT, fontweight="bold", **text
        )
        sheet.text(
            (x + side) / width,
            (y - 0.36) / height,
            polar.scale_text(panel.um_per_div),
            ha="right",
            fontsize=style.TEXT,
            **text,
        )
    _legend(sheet, names, width, height, bottom)
    caption.write(sheet, text_below)
    return sheet


def velocity_figure(traces: Traces) -> Figure:
    """Fig. 9: velocities of X, Y and C over the plot angle, per offset of the centre."""
    width, height = 9.4, 7.3
    sheet = style.new_figure(width, height)
    names: dict[str, Artist] = {}
    for i, (axis, along) in enumerate(VELOCITY_PANELS):
        box = (0.085 + 0.5 * (i % 2), 0.6 - 0.43 * (i // 2), 0.345, 0.355)
        axes = sheet.add_axes(box)
        for v in VELOCITY_OFFSETS:
            angle, speed = traces.velocity(Run.beside("friction", 15, along, v), axis)
            colour, dashed = OFFSET_LOOK[v]
            (line,) = axes.plot(angle, speed, color=colour, lw=1.2, ls=(0, (4, 1.5)) if dashed else "-")
            names.setdefault(offset_label(v), line)
        other = axes.twinx()
        angle, speed = traces.velocity(Run("friction", 15), "C")
        (line,) = other.plot(angle, speed, color="#007a5a", lw=1.6, ls=(0, (1, 1)))
        names.setdefault("C axis (right scale)", line)
        _velocity_axes(axes, other, axis, "angular position φ, °" if i >= 2 else "")
        axes.set_title(
            f"({'abcd'[i]}) {axis} and C axis, centre offset in {along}",
            fontsize=style.TEXT,
            fontweight="bold",
            loc="left",
        )
    sheet.legend(
        list(names.values()),
        list(names),
        loc="center",
        bbox_to_anchor=(0.5, 0.075),
        ncols=6,
        frameon=False,
        fontsize=style.TEXT,
    )
    caption.write(
        sheet,
        "Fig. 9  Effect of the centre offset on the velocities of the X, Y and C axes (θ = 15°, β = 10°, CCW, feed "
        "1000 mm/min, "
        f"L = 100 mm, $Z_T$ = 155 mm), from the simulated positions. {_ASSUMED}",
    )
    return sheet


def _velocity_axes(axes, other, axis: str, below: str) -> None:
    axes.set(xlim=(0, 360), xticks=range(0, 361, 90), ylim=(-9000, 9000), xlabel=below)
    axes.set_ylabel(f"velocity of {axis}, mm/min", fontsize=style.TEXT)
    other.set(ylim=(-2250, 2250), yticks=range(-2000, 2001, 1000))
    other.set_ylabel("velocity of C, °/min", fontsize=style.TEXT)
    axes.xaxis.label.set_size(style.TEXT)
    for a in (axes, other):
        a.tick_params(labelsize=style.SMALL)
        for spine in a.spines.values():
            spine.set(color=style.NOMINAL, linewidth=0.6)
    axes.grid(color=style.GRID, linewidth=0.5)
    axes.axhline(0.0, color=style.NOMINAL, linewidth=0.6)


def _trace(line: Line, traces: Traces, campaign: Campaign, level: bool) -> polar.PolarTrace:
    """``level``: about the mean radius as well, as the length of a bar is a set-up error of the measurement."""
    if isinstance(line.source, Run):
        # a trace starts and ends at the plot angle 180°, which is φ = 0
        phi, value, kind = ANGLE, np.roll(traces.centred(line.source), -len(ANGLE) // 2), "simulated"
    else:
        phi, value, kind = *_measured(campaign, line.source), "measured"
    return polar.PolarTrace(line.label, phi, value - level * value.mean(), kind, 180.0, line.colour, line.dashed)


def _measured(campaign: Campaign, name: str) -> tuple[np.ndarray, np.ndarray]:
    """φ in ° and deviation in µm about its least-squares centre of a measured test."""
    test = next(t for t in campaign.tests if t.name == name)
    trace = campaign.traces[name]
    phi, deviation = Program(test).phi(trace.time[trace.valid]), trace.deviation[trace.valid]
    return np.degrees(phi), (deviation - least_squares_circle(phi, deviation).eccentricity_m(phi)) / UM


def _caption(figure: PolarFigure) -> str:
    note = f" {figure.note}" if figure.note else ""
    return f"Fig. {figure.number}  {figure.title} ({figure.conditions}).{note} {_ASSUMED}"


def _legend(sheet: Figure, names: dict, width: float, height: float, bottom: float) -> None:
    names = {k: v for k, v in names.items() if k != "nominal circle"}
    sheet.legend(
        list(names.values()), list(names), loc="center", bbox_to_anchor=(0.5, (bottom - 0.1) / height),
        ncols=len(names), frameon=False,
        fontsize=style.fitted("".join(names) + 7 * "m" * len(names), style.TEXT, width), handlelength=2.2,
        columnspacing=1.4,
    )  # fmt: skip
