"""The plot beside the machine: a polar plot whose traces grow, and the numbers of the moment.

The plot's frame is drawn by matplotlib once. A new frame adds only the new stretch of each line to that canvas and
writes the numbers over a copy of it; nothing is drawn twice.
"""

from __future__ import annotations

import math

import numpy as np
from PIL import Image, ImageDraw

from mjsim.animation.encode import ERROR
from mjsim.animation.layout import DPI, PANEL, Layout, fitted, font
from mjsim.animation.story import Story
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.machine.chain import is_linear
from mjsim.plots import style
from mjsim.plots.output import conditions
from mjsim.plots.polar import PolarTrace, draw_polar, scale_text
from mjsim.units import DEG, MM, UM

_HEIGHT = 720
#: Places in the panel's layout, pixels: the polar axes (left, top, edge), the legend's line, and the first row of
#: numbers.
_PLOT, _LEGEND, _ROWS = (68, 104, 384), 536, 572
_ROW = 25
_COLOURS = {"measured": style.MEASURED, "simulated": style.SIMULATED, "error": ERROR}


class Panel:
    """Polar plot and numbers of a story; frames must be asked for in the order of time."""

    def __init__(self, story: Story, layout: Layout, speed: float):
        """``speed``: seconds of test per second of video, which is written beside the time."""
        self.story, self.layout, self.speed = story, layout, speed
        self._figure = style.new_figure(PANEL / DPI, _HEIGHT / DPI)
        self._figure.set_dpi(DPI * layout.scale)
        x, y, side = _PLOT
        place = (x / PANEL, 1 - (y + side) / _HEIGHT, side / PANEL, side / _HEIGHT)
        self._axes = style.polar_axes(self._figure, place)
        whole = [
            PolarTrace(s.name, s.phi / DEG, s.value / UM, "measured" if s.name == "measured" else "simulated")
            for s in story.traces
        ]
        self._step = draw_polar(self._axes, whole)
        self._lines = self._axes.lines[1:]
        for line in self._lines:
            line.set(visible=False, linewidth=1.0)
        (self._hand,) = self._axes.plot([], [], color="#7a9cc6", linewidth=1.2, zorder=5)
        self._dots = [
            self._axes.plot([], [], "o", color=_COLOURS[t.name], markersize=5.5, markeredgecolor="white", zorder=6)[0]
            for t in story.traces
        ]
        self._texts()
        self._canvas = style.canvas(self._figure)
        self._canvas.draw()
        self._drawn = [0 for _ in story.traces]
        self._pixels = np.asarray(self._canvas.buffer_rgba())

    def frame(self, time: float) -> Image.Image:
        """The panel at ``time`` s, an RGB image."""
        for k, (signal, line) in enumerate(zip(self.story.traces, self._lines, strict=True)):
            last = signal.last(time)
            if last > self._drawn[k]:
                new = slice(self._drawn[k], last + 1)
                line.set_data(signal.phi[new], signal.value[new] / UM)
                line.set_visible(True)
                self._axes.draw_artist(line)
                self._drawn[k] = last
        without_pointer = self._canvas.copy_from_bbox(self._axes.bbox)
        self._point(time)
        image = Image.fromarray(np.ascontiguousarray(self._pixels[..., :3]))
        self._canvas.restore_region(without_pointer)
        self._numbers(ImageDraw.Draw(image), time)
        return image

    def drawn(self, name: str) -> tuple[float, float]:
        """Angle φ (rad) and value (m) at which the line of a trace ends now."""
        k = [s.name for s in self.story.traces].index(name)
        signal, i = self.story.traces[k], self._drawn[k]
        return float(signal.phi[i]), float(signal.value[i])

    def spot(self, phi: float, value: float) -> tuple[float, float]:
        """Column and row of a reading ``value`` (m) at ``phi`` (rad) in the panel, pixels."""
        x, y = self._axes.transData.transform((phi, value / UM))
        return float(x), float(self._pixels.shape[0] - y)

    def _texts(self) -> None:
        s = self.story
        text = lambda y, words, size, **more: self._figure.text(  # noqa: E731
            0.5,
            1 - y / _HEIGHT,
            words,
            ha="center",
            va="center",
            fontsize=style.fitted(words, size, PANEL / DPI - 0.2),
            **more,
        )
        text(22, f"{s.campaign}: {s.test.name}", 10.5, fontweight="bold", color=style.INK)
        where, _, rest = conditions(s.test).partition("; ")
        text(44, where, 7.5, color=style.SOFT)
        text(62, rest, 7.5, color=style.SOFT)
        names = [(t.name, _COLOURS[t.name]) for t in s.traces]
        for k, (name, colour) in enumerate(names):
            self._figure.text(
                (30 + 130 * k) / PANEL,
                1 - _LEGEND / _HEIGHT,
                f"● {name}",
                va="center",
                fontsize=8.5,
                color=colour,
                fontweight="bold",
            )
        self._figure.text(
            490 / PANEL,
            1 - _LEGEND / _HEIGHT,
            scale_text(self._step),
            ha="right",
            va="center",
            fontsize=8.5,
            color=style.INK,
        )
        names = ", ".join(e.key for e in s.machine.effects) or "no effects"
        if len(names) > 74:
            names = f"{len(s.machine.effects)} effects"
        text(706, f"machine {s.machine.name}: {names}", 6.5, color=style.SOFT)

    def _point(self, time: float) -> None:
        """The pointer at the present angle and a dot on each trace."""
        phi = float(self.story.program.phi(np.array([time]))[0])
        self._hand.set_data([phi] * 2, self._axes.get_ylim())
        self._axes.draw_artist(self._hand)
        for signal, dot in zip(self.story.traces, self._dots, strict=True):
            value = signal.at(time)
            if math.isfinite(value):
                dot.set_data([signal.phi[signal.last(time)]], [value / UM])
                self._axes.draw_artist(dot)

    def _numbers(self, draw: ImageDraw.ImageDraw, time: float) -> None:
        story, px = self.story, self.layout.px
        phi = float(story.program.phi(np.array([time]))[0]) / DEG
        angle = phi % 360.0 if kind_of(story.test).goes_round else phi
        name = kind_of(story.test).turns(story.test) or "angle"
        rows = [
            (f"time (× {style.number(round(self.speed, 1))})", f"{time:.2f} s", style.INK),
            (name, f"{angle:.1f}°", style.INK),
        ]
        rows += [(s.name, _micro(s.at(time)), _COLOURS[s.name]) for s in story.traces]
        if story.measured:
            rows.append(("difference", _micro(story.error.at(time)), _COLOURS["error"]))
        self._column(draw, 30, 262, rows)
        axes = [
            (
                a,
                f"{q / (MM if is_linear(a) else DEG):.3f} {'mm' if is_linear(a) else '° '}".replace("-", "−"),
                style.INK,
            )
            for a, q in zip(story.test.chain.letters, story.position(time), strict=True)
        ]
        self._column(draw, 312, 490, axes)
        draw.line([(px(287), px(_ROWS - 12)), (px(287), px(_ROWS + 4.6 * _ROW))], fill=style.GRID, width=1)

    def _column(self, draw: ImageDraw.ImageDraw, left: float, right: float, rows: list[tuple[str, str, str]]) -> None:
        px = self.layout.px
        size = max(8, px(16))
        for k, (name, value, colour) in enumerate(rows):
            y = px(_ROWS + k * _ROW)
            draw.text((px(left), y), name, style.SOFT, font(fitted(name, size, px(120), False)), "lm")
            draw.text((px(right), y), value, colour, font(size, True), "rm")


def _micro(value: float) -> str:
    return f"{value / UM:+.2f} µm".replace("-", "−") if math.isfinite(value) else "–"
