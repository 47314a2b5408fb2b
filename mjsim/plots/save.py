"""Figures as bytes and as files: PNG or SVG, the same bytes for the same figure."""

from __future__ import annotations

import io
import re
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from mjsim.errors import InputError
from mjsim.io.files import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 150
_SVG = threading.Lock()


def encode(figure: Figure, kind: str) -> bytes:
    """The figure as an image file.

    Args:
        kind: "png" (150 dpi) or "svg" (text as outlines, so that it looks the same everywhere). No dates, no random
            identifiers.

    Raises:
        ValueError: another kind.
    """
    buffer = io.BytesIO()
    if kind == "png":
        figure.savefig(buffer, format="png", dpi=DPI)
    elif kind == "svg":
        import matplotlib

        # Identifiers inside an SVG are random unless this one setting names a salt; it is put back at once, under a
        # lock.
        with _SVG:
            before = matplotlib.rcParams["svg.hashsalt"]
            matplotlib.rcParams["svg.hashsalt"] = "mjsim"
            try:
                figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": "mjsim"})
            finally:
                matplotlib.rcParams["svg.hashsalt"] = before
    else:
        raise ValueError(f"a figure is encoded as 'png' or 'svg', not '{kind}'")
    return _rounded(buffer.getvalue()) if kind == "svg" else buffer.getvalue()


def _rounded(svg: bytes) -> bytes:
    """Path coordinates cut to 1/100 point, which nobody sees and which halves the file."""

    def path(match: re.Match[bytes]) -> bytes:
        return re.sub(rb"-?\d+\.\d{3,}", lambda number: b"%.2f" % float(number[0]), match[0])

    return re.sub(rb' d="[^"]*"', path, svg)


def encoded(figure: Figure, path: Path | str) -> bytes:
    """The figure as PNG or SVG, by the suffix of ``path``.

    Raises:
        InputError: another suffix.
    """
    path = Path(path)
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        raise InputError(f"{path}: a figure is written as .png or .svg, not as '{path.suffix or path.name}'")
    return encode(figure, kind)


def save(figure: Figure, path: Path | str, force: bool = True) -> None:
    """Write the figure as PNG or SVG, by the suffix of ``path``, whole or not at all.

    Args:
        figure: what is written.
        path: ends in .png or .svg.
        force: replace a file that is there.

    Raises:
        InputError: another suffix, a file in the way with ``force`` false, or a folder that cannot be written.
    """
    write_whole(Path(path), encoded(figure, path), force=force)
