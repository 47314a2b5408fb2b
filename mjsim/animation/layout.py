"""Sizes of the picture's parts, and text in them. Everything is laid out for 1280 x 720 and scaled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from PIL import ImageDraw, ImageFont

from mjsim.errors import InputError

#: Width and height of the layout, the panel's share of the width, and the inset's edge and its distance from the
#: corner, pixels.
BASE, PANEL, INSET, MARGIN = (1280, 720), 520, 280, 12
SMALLEST, LARGEST = (320, 180), (3840, 2160)
#: Dots per inch of the static plots at the layout's own size, where 8.5 points become 15 pixels.
DPI = 130


@dataclass(frozen=True)
class Layout:
    """The parts of a picture of ``width`` x ``height`` pixels: machine on the left, panel on the right, inset in
    the machine's corner.
    """

    width: int
    height: int

    @property
    def scale(self) -> float:
        """Pixels per pixel of the layout."""
        return min(self.width / BASE[0], self.height / BASE[1])

    def px(self, base: float) -> int:
        """A length of the layout in this picture, pixels."""
        return max(1, round(base * self.scale))

    @property
    def panel_width(self) -> int:
        """Width of the plot's side."""
        return self.px(PANEL)

    @property
    def view_width(self) -> int:
        """Width of the machine's side."""
        return self.width - self.panel_width


def parse_size(text: str) -> tuple[int, int]:
    """``1280x720`` as numbers.

    Raises:
        InputError: it is none, is odd (video needs even numbers), or lies outside 320x180 to 3840x2160.
    """
    parts = text.lower().replace("×", "x").split("x")
    bounds = f"{SMALLEST[0]}x{SMALLEST[1]} to {LARGEST[0]}x{LARGEST[1]}, both even"
    if len(parts) != 2 or not all(p.isascii() and p.isdigit() and len(p) < 6 for p in parts):
        raise InputError(f"size {text!r}: not WIDTHxHEIGHT in pixels; allowed: {bounds}")
    size = int(parts[0]), int(parts[1])
    if any(n % 2 or not low <= n <= high for n, low, high in zip(size, SMALLEST, LARGEST, strict=True)):
        raise InputError(f"size {text!r}: allowed: {bounds}")
    return size


@cache
def font(pixels: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib; its digits are equally wide, so that numbers do not jump."""
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(f"{matplotlib.get_data_path()}/fonts/ttf/{name}", pixels)


def label(
    draw: ImageDraw.ImageDraw, corner: tuple[float, float], text: str, pixels: int, room: int, anchor: str = "ls"
) -> None:
    """White text on a dark plate, ``corner`` being the text's ``anchor`` point; made smaller where ``room`` pixels
    do not hold it.
    """
    face = font(fitted(text, pixels, room), True)
    left, top, right, bottom = draw.textbbox(corner, text, face, anchor)
    pad = pixels // 3
    draw.rounded_rectangle((left - pad, top - pad, right + pad, bottom + pad), pad, fill=(26, 30, 36))
    draw.text(corner, text, (255, 255, 255), face, anchor)


def fitted(text: str, pixels: int, room: int, bold: bool = True) -> int:
    """Font size at which ``text`` keeps within ``room`` pixels: ``pixels``, or less."""
    while pixels > 7 and font(pixels, bold).getlength(text) > room:
        pixels -= 1
    return pixels
