"""Picture and table of docs/real-worms.md from guide logs: docs/images/real-worms.png; prints the table.

Run it with the project's Python: ``build_real_worms.py LOG=NAME=TEETH …``. The logs are no
part of the project; the page says which they are.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mjsim.campaign.files import read_campaign
from mjsim.campaign.new import new_log_campaign
from mjsim.importing.logs import import_log
from mjsim.inference.pitch.encoders import EncoderPitch, identify_from_encoders
from mjsim.plots import style
from mjsim.plots.save import save
from mjsim.units import DEG

IMAGE = Path(__file__).resolve().parents[2] / "docs" / "images" / "real-worms.png"
#: One unit of the drawings, rad, and a row's height, inch.
_MILLI, _ROW = 1e-3 * DEG, 2.5
#: Waves that are named in a spectrum at most.
_NAMED = 6


def identified(log: Path) -> EncoderPitch:
    """What one guide log shows."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "mount"
        new_log_campaign(folder, "C")
        import_log(folder, log)
        return identify_from_encoders(read_campaign(folder), "C")


def main(arguments: list[str]) -> None:
    """Write the picture and print the table."""
    results = []
    print(
        "| mount | arc | turns | lowest order (95 %) | period | teeth | off | amplitude | other orders (amplitude ″) |"
    )
    print("|---|--:|--:|--:|--:|--:|--:|--:|---|")
    for argument in arguments:
        path, name, teeth = argument.split("=")
        r = identified(Path(path))
        assert r.worm is not None
        order, sd = r.worm
        size = max((w.amplitude for w in r.waves if abs(w.order - order) < 0.05 * order), default=0.0)
        others = [w for w in r.waves if abs(w.order - order) >= 0.05 * order]
        listed = ", ".join(f"{w.order:.0f} ({3600 * w.amplitude / DEG:.1f})" for w in others)
        print(
            f"| {name} | {r.arc / DEG:.1f}° | {order * r.arc / (2 * np.pi):.1f} | {order:.2f} ± {1.96 * sd:.2f} | "
            f"{2 * np.pi / order / r.rate:.1f} s | {teeth} | {100 * (order / float(teeth) - 1):+.2f} % | "
            f"{3600 * size / DEG:.1f}″ | {listed} |"
        )
        results.append((f"{name}: order {order:.1f}", r))
    save(encoders_figure(results, "Worm gears of four telescope mounts, from their guide logs"), IMAGE)


def encoders_figure(results: Sequence[tuple[str, EncoderPitch]], title: str) -> Figure:
    """One row for each axis: left its difference folded over one wave of the worm, right the spectrum.

    Args:
        results: What each row is called, and what was found.
        title: Of the whole figure.
    """
    figure = style.new_figure(10.0, _ROW * len(results) + 0.7)
    style.heading(figure, title)
    pairs = figure.subplots(len(results), 2, squeeze=False, width_ratios=(1.0, 1.7))
    for (left, right), (name, r) in zip(pairs, results, strict=True):
        _folded(left, name, r)
        _spectrum(right, r)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.4 / figure.get_figheight()))
    return figure


def _folded(axes, name: str, r: EncoderPitch) -> None:
    """The difference over one wave of the worm, without the waves that are no multiples of it, and its means."""
    order = r.worm[0] if r.worm else 2.0 * np.pi / r.arc
    others = [w for w in r.waves if w.order < 0.5 * order or abs(w.order / order - round(w.order / order)) > 0.05]
    value = r.difference - sum((w.amplitude * np.sin(w.order * r.position + w.phase) for w in others), np.zeros(1))
    phase = np.mod(order * r.position, 2.0 * np.pi) / DEG
    axes.plot(phase, value / _MILLI, ".", color=style.OUTLIER, markersize=1.5, rasterized=True)
    edges = np.linspace(0.0, 360.0, 21)
    means = [value[(phase >= a) & (phase < b)].mean() / _MILLI for a, b in pairwise(edges)]
    axes.stairs(means, edges, baseline=None, color=style.SIMULATED, linewidth=1.5)
    limit = 1.2 * float(np.quantile(np.abs(value), 0.99)) / _MILLI
    axes.set(xlim=(0.0, 360.0), ylim=(-limit, limit), xticks=(0, 90, 180, 270, 360))
    axes.set_xlabel("one wave of the worm [°]")
    axes.set_ylabel("error [10⁻³ °]")
    axes.set_title(name, fontsize=9, loc="left", color=style.INK)
    axes.grid(color=style.GRID, linewidth=0.6)


def _spectrum(axes, r: EncoderPitch) -> None:
    """What a wave of each order would explain beside the drift, over the noise there, and the limit."""
    axes.semilogy(r.orders, np.maximum(r.explained, 0.1), color=style.MEASURED, linewidth=0.9, label="data")
    axes.semilogy(r.orders, r.limit, "--", color=style.NOISE, linewidth=0.9, label="limit (1 in 1000)")
    top = float(r.explained.max())
    for w in sorted(r.waves, key=lambda w: -w.amplitude)[:_NAMED]:
        near = float(np.interp(w.order, r.orders, r.explained))
        axes.annotate(
            f"{w.order:.0f}",
            (w.order, max(near, 1.0)),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            fontsize=8,
        )
    axes.set(ylim=(0.1, 5.0 * top), xlim=(0.0, float(r.orders[-1])))
    axes.set_xlabel("waves per turn of the axis")
    axes.set_ylabel("explained / noise")
    axes.grid(color=style.GRID, linewidth=0.6)
    axes.legend(loc="upper right", fontsize=7, frameon=False)


if __name__ == "__main__":
    main(sys.argv[1:])
