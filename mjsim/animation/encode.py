"""Frames into a file: MP4 (H.264, which every browser plays) or GIF."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL import Image, ImageColor

from mjsim.errors import InputError
from mjsim.io.extras import need
from mjsim.plots import style

SUFFIXES = (".mp4", ".gif")
#: The only colour matrix that players assume for video of this size; it is written into the file as well.
_BT709 = 1
#: Colours of lines that a palette of the commonest colours would merge, bright and shaded.
ERROR = "#d91a40"
MEANT = (
    "#ffffff",
    style.MEASURED,
    style.SIMULATED,
    "#e98a62",
    ERROR,
    "#e8748a",
    "#7a9cc6",
    "#ff6b0d",
    "#c04f08",
    "#1a529e",
    "#f2bf14",
)


def kind_of(path: Path) -> str:
    """``.mp4`` or ``.gif``.

    Raises:
        InputError: another suffix, or MP4 without its encoder.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: an animation is written as .mp4 or .gif, not as '{suffix or Path(path).name}'")
    if suffix == ".mp4":
        need("an .mp4 file", "video", "av")
    return suffix


def writer(kind: str, path: Path, size: tuple[int, int], fps: float) -> Mp4 | Gif:
    """A writer for frames of ``size`` (width, height) at ``fps`` frames per second; ``kind`` as :func:`kind_of`."""
    return Mp4(path, size, fps) if kind == ".mp4" else Gif(path, size, fps)


def add_all(out: Mp4 | Gif, frames: Iterable[np.ndarray], done: Callable[[int], None]) -> None:
    """Add frames, each while the next is made; ``done`` is called with the number of frames made before each."""
    with ThreadPoolExecutor(1) as pool:
        before = None
        for k, image in enumerate(frames):
            done(k)
            if before:
                before.result()
            before = pool.submit(out.add, image)
        if before:
            before.result()


class Mp4(AbstractContextManager):
    """H.264 in yuv420p, its index at the front so that it plays while it loads."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float):
        import av

        self._av = av
        self._file = av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"})
        stream = self._file.add_stream(
            "libx264", rate=Fraction(fps).limit_denominator(1001), options={"preset": "veryfast", "crf": "20"}
        )
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.colorspace = context.color_primaries = context.color_trc = _BT709
        self._stream = stream

    def add(self, image: np.ndarray) -> None:
        """Append a frame (height, width, 3) uint8."""
        frame = self._av.VideoFrame.from_ndarray(image, format="rgb24")
        frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709")
        self._file.mux(self._stream.encode(frame))

    def __exit__(self, kind, error, trace) -> None:
        if kind is None:
            self._file.mux(self._stream.encode())
        self._file.close()


class Gif(AbstractContextManager):
    """A looping GIF of one palette; delays are in whole 1/100 s, so they are dealt out to keep the duration."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float):
        self._path, self._size, self._fps = path, size, fps
        self._frames: list[np.ndarray] = []

    def add(self, image: np.ndarray) -> None:
        """Append a frame (height, width, 3) uint8; it is kept, not copied."""
        self._frames.append(image)

    def __exit__(self, kind, error, trace) -> None:
        if kind is not None or not self._frames:
            return
        ends = [round(100.0 * (k + 1) / self._fps) for k in range(len(self._frames))]
        delays = [10 * (b - a) for a, b in zip([0, *ends[:-1]], ends, strict=True)]
        palette = self._palette()
        frames = [Image.fromarray(f).quantize(palette=palette, dither=Image.Dither.NONE) for f in self._frames]
        frames[0].save(
            self._path,
            format="GIF",
            save_all=True,
            append_images=frames[1:],
            duration=delays,
            loop=0,
            optimize=False,
            disposal=1,
        )

    def _palette(self) -> Image.Image:
        """One palette for all frames, so that what stands still costs nothing: colours of four frames, and those
        that mean something.
        """
        n = len(self._frames)
        chosen = [self._frames[k] for k in sorted({0, n // 3, 2 * n // 3, n - 1})]
        common = Image.fromarray(np.vstack(chosen)).quantize(
            255 - len(MEANT), method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
        )
        palette = Image.new("P", (1, 1))
        palette.putpalette(
            [
                *(common.getpalette() or [])[: 3 * (255 - len(MEANT))],
                *(v for colour in MEANT for v in ImageColor.getrgb(colour)),
            ]
        )
        return palette
