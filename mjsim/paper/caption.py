"""The caption under a figure."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from mjsim.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Height of a line, inch, and letters that fit one inch.
LINE, _LETTERS = 0.155, 16.5


def lines(text: str, width: float) -> list[str]:
    """The caption's lines on a sheet ``width`` inch wide."""
    return textwrap.wrap(text, int(width * _LETTERS), break_long_words=False)


def write(sheet: Figure, text: str) -> None:
    """Write the caption at the foot of the sheet."""
    width, height = sheet.get_size_inches()
    foot = lines(text, width)
    for k, line in enumerate(foot):
        y = 0.1 + LINE * (len(foot) - 1 - k)
        sheet.text(0.15 / width, y / height, line, ha="left", va="center", fontsize=style.SMALL, color=style.INK)
