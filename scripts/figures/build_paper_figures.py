#!/usr/bin/env python3
"""Pictures and table of docs/paper.md, from `mjsim figures`: docs/images/paper/*.png, smaller than the command's own.

.venv/bin/python scripts/figures/build_paper_figures.py
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from PIL import Image

from mjsim.paper.figures import PaperFigures, figures, plain

DOCS = Path(__file__).resolve().parents[2] / "docs"
SCALE, COLOURS = 0.66, 48
TABLE = re.compile(r"(<!-- numbers -->\n).*?(<!-- end of numbers -->)", re.DOTALL)


def main() -> None:
    images = DOCS / "images" / "paper"
    images.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        made = figures(scratch)
        for file in sorted(Path(scratch).glob("*.png")):
            with Image.open(file) as image:
                small = image.convert("RGB").resize([round(n * SCALE) for n in image.size], Image.Resampling.LANCZOS)
            small.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
                images / file.name, optimize=True
            )
            print(f"{file.name}: {(images / file.name).stat().st_size / 1e3:.0f} kB")
    page = DOCS / "paper.md"
    page.write_text(TABLE.sub(lambda m: m[1] + table(made) + m[2], page.read_text()))


def table(made: PaperFigures) -> str:
    """The numbers as a Markdown table."""
    rows = ["| number of the paper | printed | simulated | ± | agrees | note |", "|---|---|---|---|---|---|"]
    for n in made.numbers:
        cells = (f"{n.group}.{n.name}", plain(n.printed), plain(n.simulated), f"{n.tolerance:g}" if n.tolerance else "")
        rows.append(f"| {' | '.join(cells)} | {'yes' if n.agrees else '**no**'} | {n.note} |")
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    main()
