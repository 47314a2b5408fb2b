"""A video of one test: the machine moving, the bar's error magnified, the trace growing beside it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from mjsim.animation import encode, gl
from mjsim.animation.layout import INSET, MARGIN, Layout, label, parse_size
from mjsim.animation.panel import Panel
from mjsim.animation.story import Story, tell
from mjsim.campaign.machine_file import machine_of
from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.io import files
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent

#: What is chosen per kind of file when the user does not: size, frames per second, and the longest video (s).
DEFAULTS = {".mp4": ("1280x720", 25.0, 20.0), ".gif": ("800x450", 10.0, 8.0)}
MOST_FRAMES = 30_000
#: The inset is rendered larger and scaled down: its lines are smooth then. Twice would take as long as the large view.
FINER = 1.5
#: How far the main view looks to the right of its subject, over half its width: room for the inset.
ASIDE = 0.2


@dataclass(frozen=True)
class Film:
    """A file that was written.

    Attributes:
        file: The video.
        frames: Number of its frames.
        size: Width and height, pixels.
        fps: Frames per second.
    """

    file: Path
    frames: int
    size: tuple[int, int]
    fps: float

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return self.frames / self.fps


@dataclass(frozen=True)
class TestFilm(Film):
    """A video of a ball-bar test: seconds of test per second, what is magnified, and from where it is seen."""

    __test__ = False
    test: str
    speed: float
    magnification: float
    magnified: str
    camera: str


@dataclass(frozen=True)
class Format:
    """Kind, size and timing of a file to be written, checked."""

    kind: str
    size: tuple[int, int]
    fps: float
    longest: float

    @classmethod
    def of(cls, file: Path, size: str | None, fps: float | None) -> Format:
        """Defaults of the file's kind where nothing is said.

        Raises:
            InputError: the suffix, size or rate is not allowed.
        """
        kind = encode.kind_of(file)
        usual_size, usual_fps, longest = DEFAULTS[kind]
        fps = usual_fps if fps is None else float(fps)
        most = 60.0 if kind == ".mp4" else 50.0
        if not 1.0 <= fps <= most:
            raise InputError(f"{fps:g} frames per second; allowed: 1 to {most:g} in {kind}")
        return cls(kind, parse_size(size or usual_size), fps, longest)

    def frames(self, seconds: float) -> int:
        """Frames of a video of that length.

        Raises:
            InputError: none, or more than 30 000.
        """
        n = round(seconds * self.fps) if 0.0 < seconds < 1e6 else 0
        if not 2 <= n <= MOST_FRAMES:
            raise InputError(
                f"a video of {seconds:g} s at {self.fps:g} frames per second has {n} frames; allowed: 2 to "
                f"{MOST_FRAMES}; "
                "choose another length or rate"
            )
        return n

    def write(self, file: Path, frames: Iterable[np.ndarray], count: int, force: bool, progress: Progress) -> None:
        """Write frames (height, width, 3) uint8 into a file that is there whole or not at all."""
        with files.whole(file, force) as neighbour, encode.writer(self.kind, neighbour, self.size, self.fps) as out:
            encode.add_all(out, frames, lambda k: progress("rendering", k, count))
            progress("writing", 0, 1)


def animate(
    campaign: Campaign,
    test: str,
    file: str | Path,
    machine: Machine | None = None,
    camera: str = "overview",
    size: str | None = None,
    fps: float | None = None,
    speed: float | None = None,
    seconds: float | None = None,
    magnify: float | None = None,
    shadows: bool = False,
    force: bool = False,
    threads: int = 2,
    progress: Progress = silent,
) -> TestFilm:
    """Write a video of one test.

    Args:
        campaign: with traces; a test without one is shown simulated only. test: its name.
        file: ``.mp4`` or ``.gif``. machine: instead of the campaign's. camera: overview, closeup, side or bar.
        size: ``1280x720`` (GIF ``800x450``). fps: frames per second, 25 (GIF 10).
        speed: seconds of test per second of video; seconds: duration of the video. One of them; else real time, at most
            20 s (GIF 8 s).
        magnify: factor of the error; chosen when missing. shadows: draw them, at half the speed. force: replace a file.

    Raises:
        InputError: an unknown test, camera or suffix, a value out of bounds, a file in the way, or no OpenGL.
    """
    file = Path(file)
    form, campaign = Format.of(file, size, fps), campaign.in_motion
    chosen = next((t for t in campaign.tests if t.name == test), None)
    if chosen is None:
        names = ", ".join(t.name for t in campaign.tests)
        raise InputError(f"{campaign.folder / 'campaign.toml'}: no test {test!r}; it has: {names}")
    gl.chosen()
    from mjsim.animation.scene import Stage, cameras
    from mjsim.instruments.ball_bar.program import Program

    if camera not in cameras():
        raise InputError(f"no camera {camera!r}; allowed: {', '.join(cameras())}")
    duration = Program(chosen).duration
    length = _length(duration, form.longest, speed, seconds)
    count = form.frames(length)
    files.check_writable(file, force)
    machine = machine or machine_of(campaign)
    layout, speed = Layout(*form.size), duration / length
    with Stage(
        chosen, max(layout.view_width, 2 * layout.px(INSET)), max(layout.height, 2 * layout.px(INSET)), shadows
    ) as stage:
        story = tell(campaign, machine, chosen, magnify, threads, progress)
        frames = pictures(story, stage, layout, camera, np.linspace(0.0, duration, count), speed)
        form.write(file, frames, count, force, progress)
    return TestFilm(file, count, form.size, form.fps, test, speed, story.magnification, story.magnified, camera)


def _length(duration: float, longest: float, speed: float | None, seconds: float | None) -> float:
    """Length of the video, s."""
    if speed is not None and seconds is not None:
        raise InputError("speed and seconds exclude each other; give one of them")
    if speed is not None:
        if not 0.01 <= speed <= 1000.0:
            raise InputError(f"speed {speed:g}; allowed: 0.01 to 1000 (1 is real time)")
        return duration / speed
    return min(duration, longest) if seconds is None else seconds


def pictures(story: Story, stage, layout: Layout, camera: str, times: np.ndarray, speed: float) -> Iterator[np.ndarray]:
    """Frames (height, width, 3) uint8 at ``times`` (n,) s, in order; ``speed`` as :class:`TestFilm` has it."""
    from mjsim.animation.scene import BAR, FAR
    from mjsim.animation.trail import Trail

    panel, trail = Panel(story, layout, speed), Trail(story, stage)
    inset, share, note = (
        (BAR, 1.0, "close-up: red with the error, blue without") if camera in FAR else ("overview", 0.75, "")
    )
    edge, margin = layout.px(share * INSET), layout.px(MARGIN)
    picture = Image.new("RGB", (layout.width, layout.height), "white")
    draw = ImageDraw.Draw(picture)
    corner = (layout.view_width - edge - margin, margin)
    top = (layout.height - panel_height(layout)) // 2
    for time in times:
        balls = stage.pose(story.position(time), story.stretch(time))
        view = stage.render(camera, layout.view_width, layout.height, balls, trail.lines(time, layout.scale), ASIDE)
        picture.paste(Image.fromarray(view), (0, 0))
        fine = round(FINER * edge)
        close = Image.fromarray(stage.render(inset, fine, fine, balls, trail.lines(time, FINER * layout.scale)))
        picture.paste(close.resize((edge, edge), Image.Resampling.BOX), corner)
        draw.rectangle(
            (corner[0] - 1, corner[1] - 1, corner[0] + edge, corner[1] + edge), outline="white", width=layout.px(2)
        )
        label(
            draw,
            (2 * margin, layout.height - 2 * margin),
            story.magnified,
            layout.px(19),
            layout.view_width - 5 * margin,
        )
        if note:
            label(
                draw, (corner[0] + edge // 2, corner[1] + edge + 2 * margin), note, layout.px(13), edge - margin, "ms"
            )
        picture.paste(panel.frame(time), (layout.view_width, top))
        yield np.array(picture)


def panel_height(layout: Layout) -> int:
    """Height of the panel in the picture, pixels."""
    return round(720 * layout.scale)
