"""A video of a recording: what was measured with its error magnified, and the error over time growing below it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjsim.animation.movie import Film, Format
from mjsim.campaign.model import Campaign
from mjsim.commands.axis_log.compare import ComparedAxis
from mjsim.commands.compare import compare
from mjsim.commands.comparison import ComparedChannel, ComparedTest
from mjsim.io import files
from mjsim.machine.model import Machine
from mjsim.plots import style
from mjsim.progress import Progress, silent
from mjsim.units import MM

#: Share of the travel that the magnified error fills, and pixels per inch of the picture.
_FILLS, _DPI = 0.12, 100
#: Most points of a line.
_POINTS = 3000


@dataclass(frozen=True)
class RecordingFilm(Film):
    """A video of a recording: name of the test, and how many times its size the error is drawn."""

    test: str
    magnification: float


def animate_recording(
    campaign: Campaign,
    test: str,
    file: str | Path,
    machine: Machine,
    size: str | None = None,
    fps: float | None = None,
    seconds: float | None = None,
    magnify: float | None = None,
    force: bool = False,
    threads: int = 2,
    progress: Progress = silent,
) -> RecordingFilm:
    """Write a video of one test that is no ball-bar test: measured and simulated, and what the model leaves.

    Two linear axes of a log are drawn as a path, everything else over time. The error is magnified there.

    Args:
        campaign: With the test.
        test: Its name.
        file: ``.mp4`` or ``.gif``.
        machine: With which it is compared.
        size: ``WIDTHxHEIGHT``, pixels.
        fps: Frames per second.
        seconds: Length; the recording's own, up to what is usual for the file.
        magnify: Times its size the error is drawn; so that it shows by default.
        force: Replace the file.
        threads: Simulations side by side.
        progress: Called as work gets on.

    Raises:
        InputError: No such test has a recording, or a value is wrong.
    """
    file = Path(file)
    form = Format.of(file, size, fps)
    only = campaign.only([test])
    files.check_writable(file, force)
    (compared,) = compare(only, machine, threads, progress).tests
    length = min(float(compared.channels[0].time[-1]), form.longest) if seconds is None else seconds
    count = form.frames(length)
    picture = _Picture(compared, form.size, magnify)
    form.write(file, map(picture.frame, np.linspace(1.0 / count, 1.0, count)), count, force, progress)
    return RecordingFilm(file, count, form.size, form.fps, test, picture.factor)


class _Picture:
    """Draws the frames.

    Args:
        compared: The test.
        size: Width and height, pixels.
        magnify: Times its size the error is drawn.
    """

    def __init__(self, compared: ComparedTest, size: tuple[int, int], magnify: float | None) -> None:
        self.figure = style.new_figure(size[0] / _DPI, size[1] / _DPI)
        self.figure.set_dpi(_DPI)
        axes = list(compared.channels)
        linear = [a for a in axes if isinstance(a, ComparedAxis) and not a.rotary]
        path = linear[:2] if len(linear) > 1 else None
        shown = path or axes[:1]
        largest = max(float(np.abs(a.residual).max()) for a in shown)
        travel = max(float(np.ptp(a.measured)) for a in shown)
        self.factor = float(magnify or max(1.0, style.step_below(_FILLS * travel / max(largest, 1e-12))))
        above, below = self.figure.subplots(2, 1, height_ratios=(3.0, 1.3))
        self._lines = []
        every = max(1, len(axes[0].time) // _POINTS)
        self.time = axes[0].time[::every]
        if path:
            self._path(above, path, every)
        else:
            self._over_time(above, shown[0], every)
        for a in axes:
            name = a.channel.name
            (line,) = below.plot([], [], color=style.AXIS_COLOURS.get(name, style.INK), lw=1.0, label=name)
            self._lines.append((line, self.time, a.residual[::every] / a.channel.size))
        below.set_xlim(0.0, float(self.time[-1]))
        tall = max(float(np.abs(y).max()) for _, _, y in self._lines[-len(axes) :]) or 1.0
        below.set_ylim(-1.1 * tall, 1.1 * tall)
        units = dict.fromkeys(a.channel.unit for a in axes)
        below.set(xlabel="time, s", ylabel=f"measured − simulated, {' or '.join(units)}")
        below.legend(loc="upper right", fontsize=style.SMALL, ncols=len(axes), frameon=False)
        said = ", ".join(f"{a.channel.name} {a.rms / a.channel.size:.3g} {a.channel.unit}" for a in axes)
        above.set_title(
            f"{compared.test.name}: RMS {said}; error magnified {self.factor:g} times", fontsize=style.TITLE
        )
        for plot in (above, below):
            plot.grid(color=style.GRID, lw=0.6)
            plot.tick_params(labelsize=style.SMALL)
        self.figure.tight_layout()

    def _path(self, plot, axes: list[ComparedAxis], every: int) -> None:
        x, y = (a.simulated[::every] / MM for a in axes)
        u, v = ((a.simulated + self.factor * a.residual)[::every] / MM for a in axes)
        plot.plot(x, y, color=style.GRID, lw=2.5)
        for columns, colour, name in (((x, y), style.SIMULATED, "simulated"), ((u, v), style.MEASURED, "measured")):
            (line,) = plot.plot([], [], color=colour, lw=1.1, label=name)
            self._lines.append((line, *columns))
        edge = 0.05 * max(np.ptp(u), np.ptp(v))
        plot.set_xlim(min(u.min(), x.min()) - edge, max(u.max(), x.max()) + edge)
        plot.set_ylim(min(v.min(), y.min()) - edge, max(v.max(), y.max()) + edge)
        plot.set_aspect("equal", adjustable="box")
        plot.set(xlabel=f"{axes[0].axis}, mm", ylabel=f"{axes[1].axis}, mm")
        plot.legend(loc="upper right", fontsize=style.SMALL, frameon=False)

    def _over_time(self, plot, a: ComparedChannel, every: int) -> None:
        shown = a.travel if isinstance(a, ComparedAxis) else a.channel
        simulated, error = a.simulated[::every] / shown.size, a.residual[::every] / shown.size
        rows = (
            (simulated, style.SIMULATED, "simulated"),
            (simulated + self.factor * error, style.MEASURED, "measured"),
        )
        for values, colour, name in rows:
            (line,) = plot.plot([], [], color=colour, lw=1.1, label=name)
            self._lines.append((line, self.time, values))
        low, high = min(v.min() for v, _, _ in rows), max(v.max() for v, _, _ in rows)
        plot.set_xlim(0.0, float(self.time[-1]))
        plot.set_ylim(low - 0.05 * (high - low), high + 0.05 * (high - low))
        plot.set(xlabel="time, s", ylabel=f"{a.channel.name}, {shown.unit}")
        plot.legend(loc="upper right", fontsize=style.SMALL, frameon=False)

    def frame(self, share: float) -> np.ndarray:
        """The picture when a share of the log has run, (height, width, 3) bytes."""
        n = max(2, round(share * len(self.time)))
        for line, x, y in self._lines:
            line.set_data(x[:n], y[:n])
        self.figure.canvas.draw()
        return np.array(self.figure.canvas.buffer_rgba())[..., :3]  # pyright: ignore[reportAttributeAccessIssue]
