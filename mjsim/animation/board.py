"""The picture of the ladder: residuals of several tests about their circles, the RMS of the models beside them.

All that stands still is drawn once; a frame restores it and draws the lines and numbers that change.
"""

from __future__ import annotations

import math

import numpy as np

from mjsim.animation.encode import ERROR
from mjsim.animation.layout import BASE, DPI
from mjsim.commands.ball_bar.compare import BarComparison, ComparedBarTest
from mjsim.plots import style
from mjsim.plots.polar import PolarTrace, division_um, draw_polar, scale_text
from mjsim.units import DEG, UM

#: Points of one residual at most, and rows of the list of models.
POINTS, ROWS = 1500, 9
_FAINT = "#eec3cb"
_LEFT = 860


class Board:
    """Frames of a ladder of ``labels`` (n) with their comparisons ``rungs`` (n)."""

    def __init__(
        self, campaign: str, labels: list[str], rungs: list[BarComparison], tests: list[str], size: tuple[int, int]
    ):
        """``tests``: names of those to show, up to nine. ``size``: width and height of the frames, pixels."""
        self._labels, self._rungs, self._size = labels, rungs, size
        self._rms = np.array([c.rms for c in rungs]) / UM
        self._tests = [[next(t for t in c.tests if t.test.name == name) for c in rungs] for name in tests]
        self._curves = [_curves(ladder) for ladder in self._tests]
        scale = min(size[0] / BASE[0], size[1] / BASE[1])
        self._figure = style.new_figure(BASE[0] / DPI, BASE[1] / DPI)
        self._figure.set_dpi(DPI * scale)
        self._moving: list = []
        self._text(
            20, 26, f"{campaign}: what the model leaves, measured − simulated", 10.5, ha="left", fontweight="bold"
        )
        self._polars()
        self._chart()
        for artist in self._moving:
            artist.set_animated(True)  # left out of what stands still
        self._canvas = style.canvas(self._figure)
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(self._figure.bbox)

    def frame(self, place: float) -> np.ndarray:
        """The picture (height, width, 3) uint8 at ``place`` on the ladder: whole numbers are models, 0 the first."""
        self._canvas.restore_region(self._still)
        low = min(int(place), len(self._rungs) - 1)
        high, weight = min(low + 1, len(self._rungs) - 1), place - low
        for (phi, value), line, number, ladder in zip(
            self._curves, self._lines, self._values, self._tests, strict=True
        ):
            line.set_data(_mixed(phi, low, high, weight), _mixed(value, low, high, weight))
            number.set_text(style.micrometres(_mixed([t.rms / UM for t in ladder], low, high, weight)))
        now = float(_mixed(self._rms, low, high, weight))
        self._dot.set_data([place], [now])
        self._now.set_text(style.micrometres(now))
        nearest = round(place)
        between = abs(place - nearest) > 1e-6
        for k, row in zip(self._listed, self._rows, strict=True):
            row.set(fontweight="bold" if k == nearest else "normal", color=style.INK if k == nearest else style.SOFT)
        self._name.set_text(f"{self._labels[low]} → {self._labels[high]}" if between else self._labels[low])
        for artist in self._moving:
            (artist.axes or self._figure).draw_artist(artist)
        return self._padded(np.asarray(self._canvas.buffer_rgba())[..., :3])

    def _padded(self, image: np.ndarray) -> np.ndarray:
        """The drawing in the middle of a frame of the size asked for, which may have another shape."""
        width, height = self._size
        image = image[:height, :width]
        out = np.full((height, width, 3), 255, np.uint8)
        top, left = (height - image.shape[0]) // 2, (width - image.shape[1]) // 2
        out[top : top + image.shape[0], left : left + image.shape[1]] = image
        return out

    def _text(self, x: float, y: float, words: str, size: float, **more):
        """A text at a place of the layout (pixels from the top left corner)."""
        return self._figure.text(
            x / BASE[0],
            1 - y / BASE[1],
            words,
            **{"va": "center", "ha": "center", "fontsize": size, "color": style.INK} | more,
        )

    def _polars(self) -> None:
        n = len(self._tests)
        columns = 1 if n == 1 else 2 if n <= 4 else 3
        rows = math.ceil(n / columns)
        self._lines, self._values = [], []
        start = [
            PolarTrace(t[0].test.name, p[0] / DEG, v[0], "simulated", 0.0, _FAINT)
            for t, (p, v) in zip(self._tests, self._curves, strict=True)
        ]
        step = division_um(start)
        width, height = _LEFT / columns, 660 / rows
        side = min(width - 24, height - 48) if n > 1 else height - 90
        for k, trace in enumerate(start):
            x, y = (k % columns + 0.5) * width, 50 + (k // columns) * height
            place = (
                (x - side / 2) / BASE[0],
                1 - (y + (34 if n > 1 else 58) + side) / BASE[1],
                side / BASE[0],
                side / BASE[1],
            )
            axes = style.polar_axes(self._figure, place)
            draw_polar(axes, [trace], step, small=n > 1)
            if n > 1:
                axes.tick_params(labelbottom=False)
            (line,) = axes.plot([], [], color=ERROR, linewidth=0.8, zorder=4)
            size = style.fitted(trace.label, 8.0, width / DPI - 0.15)
            self._text(x, y + 6, trace.label, size, fontweight="bold")
            self._values.append(self._text(x, y + 22, "", 7.5, color=ERROR, fontweight="bold"))
            self._lines.append(line)
        self._moving += [*self._lines, *self._values]
        self._text(1250, 702, f"{scale_text(step)}; pale: {self._labels[0]}", 7.5, ha="right", color=style.SOFT)

    def _chart(self) -> None:
        left, top, width, height = 930, 120, 310, 250
        axes = self._figure.add_axes((left / BASE[0], 1 - (top + height) / BASE[1], width / BASE[0], height / BASE[1]))
        noise = self._rungs[-1].noise / UM
        low, high = min([noise, *self._rms]), max([noise, *self._rms])
        if low > 0.0 and high / low > 12.0:
            axes.set_yscale("log")
            axes.set_ylim(low / 1.6, high * 1.8)
            axes.yaxis.set_major_formatter(lambda v, _: style.number(v))
            axes.yaxis.set_minor_formatter("")
        else:
            axes.set_ylim(0.0, high * 1.15)
        axes.set_xlim(-0.4, len(self._rms) - 0.6)
        axes.set_xticks([])
        axes.axhline(noise, color=style.NOISE, linewidth=1.0, linestyle=(0, (4, 2)))
        axes.plot(range(len(self._rms)), self._rms, "-", color=style.GRID, linewidth=1.2)
        axes.plot(range(len(self._rms)), self._rms, "o", color=style.NOMINAL, markersize=4)
        axes.tick_params(labelsize=7.5, labelcolor=style.INK, color=style.NOMINAL)
        for side, spine in axes.spines.items():
            spine.set(visible=side in ("left", "bottom"), color=style.NOMINAL, linewidth=0.6)
        (self._dot,) = axes.plot([], [], "o", color=ERROR, markersize=8, markeredgecolor="white", zorder=5)
        self._text(left + width, top - 62, "RMS of all tests", 8.0, ha="right", color=style.SOFT)
        self._text(
            left + width,
            top + height + 16,
            f"dashed: noise, {style.micrometres(noise)}",
            7.5,
            ha="right",
            color=style.NOISE,
        )
        self._text(left - 50, top - 18, "µm", 7.5, ha="left", color=style.SOFT)
        self._now = self._text(left + width, top - 34, "", 15.0, ha="right", fontweight="bold", color=ERROR)
        self._name = self._text(left - 50, 430, "", 9.5, ha="left", fontweight="bold", color=ERROR)
        self._listed = list(range(len(self._labels)))[-ROWS:]
        self._rows = []
        for row, k in enumerate(self._listed):
            words = f"{self._labels[k]}:  {style.micrometres(self._rms[k])}"
            self._rows.append(
                self._text(left - 50, 462 + 25 * row, words, style.fitted(words, 8.5, 360 / DPI), ha="left")
            )
        self._moving += [self._dot, self._now, self._name, *self._rows]


def _curves(ladder: list[ComparedBarTest]) -> tuple[np.ndarray, np.ndarray]:
    """Plot angles (rad) and residuals (µm) of one test under every model, (models, points); the same samples in
    each.
    """
    stride = max(1, math.ceil(len(ladder[0].phi) / POINTS))
    phi = np.array([t.phi[::stride] for t in ladder])
    value = np.array([np.where(t.valid, t.residual / UM, np.nan)[::stride] for t in ladder])
    return phi, value


def _mixed(rows, low: int, high: int, weight: float):
    """A row between two rows."""
    return rows[low] if weight == 0.0 else (1.0 - weight) * rows[low] + weight * rows[high]
