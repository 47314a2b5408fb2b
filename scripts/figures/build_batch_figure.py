"""The picture of docs/batch.md, from the results of its example: ``build_batch_figure.py DIR`` with what

    mjsim batch examples/sweeps/backlash.toml --out DIR

made. Same results, same picture.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from mjsim.plots import style
from mjsim.plots.save import save

IMAGE = Path(__file__).resolve().parents[2] / "docs" / "images" / "batch-backlash.png"
WIDTH, LIMIT_UM = "backlash.A.width_deg", 5.0


def main() -> None:
    """Draw circular error over backlash: every machine, their middle, and where 95 % of them keep the limit."""
    table = pd.read_parquet(Path(sys.argv[1]) / "results")
    by_width = table.groupby(WIDTH)["circular_error_um"]
    low, middle, high = (by_width.quantile(q) for q in (0.05, 0.5, 0.95))
    width = middle.index.to_numpy()
    figure = style.new_figure(7.2, 4.0)
    axes = figure.add_axes((0.1, 0.14, 0.86, 0.76))
    axes.fill_between(
        width, low, high, color=style.BAND, edgecolor=style.BAND_EDGE, linewidth=0.6, label="5 to 95 % of the machines"
    )
    axes.plot(
        table[WIDTH],
        table["circular_error_um"],
        ".",
        color=style.NOMINAL,
        markersize=2.5,
        label="one machine inside the data sheet",
    )
    axes.plot(width, middle, color=style.SIMULATED, linewidth=1.6, label="median")
    axes.axhline(LIMIT_UM, color=style.INK, linewidth=0.9, linestyle=(0, (5, 3)))
    axes.text(width[-1], LIMIT_UM + 0.04, "limit 5 µm", ha="right", va="bottom", fontsize=style.SMALL, color=style.INK)
    bottom, top = axes.get_ylim()
    for curve, name, y, va in ((high, "95 %", bottom + 0.04, "bottom"), (middle, "half", top, "top")):
        allowed = float(np.interp(LIMIT_UM, curve, width))
        axes.vlines(allowed, min(y, LIMIT_UM), max(y, LIMIT_UM), color=style.SOFT, linewidth=0.8)
        text = f"  {name} of the machines\n  keep it up to {allowed:.5f}°"
        axes.text(allowed, y, text, ha="left", va=va, fontsize=style.SMALL, color=style.INK)
        print(f"{name} of the machines keep {LIMIT_UM:g} µm up to {allowed:.5f}°")
    axes.set_xlim(width[0], width[-1])
    axes.set_ylim(bottom, top)
    axes.set_xlabel("backlash of A, full width [°]", fontsize=style.TEXT, color=style.INK)
    axes.set_ylabel("circular error G [µm]", fontsize=style.TEXT, color=style.INK)
    axes.tick_params(labelsize=style.SMALL, colors=style.SOFT)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=style.SMALL, frameon=False, loc="lower right")
    figure.text(
        0.1,
        0.95,
        "15° cone, 25 machines inside the data sheet's tolerances at 20 widths",
        fontsize=style.TITLE,
        color=style.INK,
    )
    save(figure, IMAGE)


if __name__ == "__main__":
    main()
