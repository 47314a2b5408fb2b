"""Pictures of docs/worn-worm.md, from the real code: docs/images/worn-worm-*.png, and the numbers of the page.

Run it with the project's Python. Same code, same pictures.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine, write_machine
from mjsim.campaign.model import Campaign
from mjsim.commands.ball_bar.compare import BarComparison, ComparedBarTest, compare_bars
from mjsim.commands.edit import add
from mjsim.effects.registry import make
from mjsim.inference.pitch.identify import identify_pitch_errors
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.resources import examples
from mjsim.plots import polar, style
from mjsim.plots.output import polar_traces
from mjsim.plots.save import save
from mjsim.units import DEG, UM

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"
CAMPAIGN, EFFECT, TEST = "kato2013", "worm_wear.A", "cone15-centre-ccw"
#: Scale of the polar plots, µm per division.
STEP = 5.0
#: Where the paper saw the deflection, φ in degrees: 135 to 180 in its plots, which call φ = 0 180.
SEEN = (315.0, 360.0)
#: A comes down, A goes up: colour and words.
WAYS = {-1.0: (style.AXIS_COLOURS["A"], "A comes down (CW)"), 1.0: (style.SOFT, "A goes up (CCW)")}


def main() -> None:
    """Write all pictures and print the numbers."""
    with tempfile.TemporaryDirectory() as scratch:
        campaign = read_campaign(shutil.copytree(examples() / CAMPAIGN, Path(scratch) / CAMPAIGN))
        machine = read_machine(campaign.machine_file)
        for found in identify_pitch_errors(campaign, machine).values():
            for effect in found.effects:
                machine = machine.with_effect(effect)
        write_machine(machine, campaign.machine_file, campaign.machine_file, force=True)
        before = compare_bars(campaign, machine)
        worn = add(campaign, EFFECT, record=False).effect
        after = compare_bars(campaign, machine.with_effect(worn))
        shape = {k: v for k, v in worn.values.items() if k != "direction"}
        mirrored = compare_bars(campaign, machine.with_effect(make(EFFECT, **shape)))
        IMAGES.mkdir(parents=True, exist_ok=True)
        picture(campaign, before, "before", IMAGES / "worn-worm-before.png")
        picture(campaign, after, f"with {EFFECT}", IMAGES / "worn-worm-after.png")
        flanks(before, after, mirrored)
        print(worn)
        for name, c in (("before", before), ("after", after), ("both flanks", mirrored)):
            print(f"{name}: RMS {c.rms / UM:.3f} µm, noise {c.noise / UM:.3f} µm")
            for t in c.tests:
                print(f"  {t.test.name}: RMS {t.rms / UM:.3f}, {described(t)}, left out {int((~t.valid).sum())}")


def one(comparison: BarComparison, name: str) -> ComparedBarTest:
    """One test of a comparison."""
    return next(t for t in comparison.tests if t.test.name == name)


def described(t: ComparedBarTest) -> str:
    """Extremes of the residual, as means over 5° of the angle, µm and degrees of the plot."""
    angle = t.phi / DEG % 360.0
    bins = np.floor(angle / 5.0).astype(int)
    means = {b: float(np.mean(t.residual[(bins == b) & t.valid])) / UM for b in np.unique(bins[t.valid])}
    low, high = min(means, key=means.get), max(means, key=means.get)
    return (
        f"lowest {means[low]:.2f} at {5 * low}-{5 * low + 5}°, highest {means[high]:.2f} at {5 * high}-{5 * high + 5}°"
    )


def picture(campaign: Campaign, comparison: BarComparison, when: str, path: Path) -> None:
    """Left: measured and simulated trace of one test. Right: what is left of the three cones over the angle of A."""
    width, height, side, bottom, left = 10.8, 4.75, 3.45, 0.62, 0.55
    figure = style.new_figure(width, height)
    t = one(comparison, TEST)
    plot = figure.add_axes((left / width, bottom / height, side / width, side / height), projection="polar")
    polar.draw_polar(plot, polar_traces(t), STEP)
    mark(plot)
    heading(figure, f"{TEST}, {when}: RMS {style.micrometres(t.rms / UM)}", left + 0.5 * side, width, height)
    legend(figure, plot, left + 0.5 * side - 0.35, width, height)
    figure.text(
        4.45 / width,
        0.2 / height,
        polar.scale_text(STEP),
        ha="right",
        va="center",
        fontsize=style.TEXT,
        color=style.INK,
    )
    axes = figure.add_axes((5.45 / width, bottom / height, 5.15 / width, side / height))
    over_a(axes, campaign, comparison)
    heading(figure, "What is left, over the angle of A: the three 15° cones", 5.45 + 0.5 * 5.15, width, height)
    save(figure, path)


def mark(plot) -> None:
    """Shade the sector in which the paper saw the deflection."""
    low, high = plot.get_ylim()
    angle = np.radians(np.linspace(*SEEN, 60))
    plot.fill_between(angle, low, high, color=style.BAND, zorder=0.5, linewidth=0)
    plot.set_ylim(low, high)


def heading(figure, text: str, centre: float, width: float, height: float) -> None:
    at = {"ha": "center", "va": "center", "fontweight": "bold", "color": style.INK}
    figure.text(centre / width, 1 - 0.2 / height, text, fontsize=style.TITLE, **at)


def legend(figure, plot, centre: float, width: float, height: float) -> None:
    handles, labels = plot.get_legend_handles_labels()
    at = (centre / width, 0.2 / height)
    figure.legend(
        handles, labels, loc="center", bbox_to_anchor=at, ncols=3, frameon=False, fontsize=style.TEXT, columnspacing=1.0
    )


def over_a(axes, campaign: Campaign, comparison: BarComparison) -> None:
    """Residuals of the 15° cones over the commanded angle of A, apart by the direction in which it moves."""
    gathered = {way: [] for way in WAYS}
    for t in comparison.tests:
        if not t.test.name.startswith("cone15"):
            continue
        time = campaign.traces[t.test.name].time - t.trigger
        angle = Program(t.test).commands(time)[:, 3] / DEG
        way = np.sign(np.gradient(angle))
        for w in WAYS:
            here = (way == w) & t.valid
            gathered[w].append((angle[here], t.residual[here] / UM))
    noise = comparison.noise / UM
    axes.axhspan(-2 * noise, 2 * noise, color=style.BAND, linewidth=0, zorder=0, label="noise, ± 2 standard deviations")
    for w, (colour, words) in WAYS.items():
        angle, rest = (np.concatenate(x) for x in zip(*gathered[w], strict=True))
        axes.plot(angle, rest, ".", markersize=1.0, alpha=0.25, color=colour, zorder=1, rasterized=True)
        edges = np.arange(5.25, 24.76, 0.25)  # without the reversals
        place = np.digitize(angle, edges)
        middle = [rest[place == k].mean() for k in range(1, len(edges))]
        axes.plot(0.5 * (edges[1:] + edges[:-1]), middle, color=colour, linewidth=1.8, label=words, zorder=3)
    axes.set_xlim(5, 25)
    axes.set_ylim(-7.5, 2.5)
    axes.set_xlabel("commanded angle of A, °", fontsize=style.TEXT)
    axes.set_ylabel("measured less simulated, µm", fontsize=style.TEXT)
    axes.tick_params(labelsize=style.TEXT)
    axes.grid(color=style.GRID, linewidth=0.5)
    axes.set_axisbelow(True)
    for spine in ("top", "right"):
        axes.spines[spine].set_visible(False)
    axes.legend(loc="lower right", frameon=False, fontsize=style.TEXT)


def flanks(before: BarComparison, after: BarComparison, mirrored: BarComparison) -> None:
    """One test against three machines: no wear, one worn flank, both worn."""
    width, height, side, bottom = 10.8, 4.3, 2.9, 0.62
    figure = style.new_figure(width, height)
    columns = (("no wear", before), ("one flank worn", after), ("both flanks worn alike", mirrored))
    for i, (words, comparison) in enumerate(columns):
        left = 0.5 + i * (side + 0.65)
        plot = figure.add_axes((left / width, bottom / height, side / width, side / height), projection="polar")
        polar.draw_polar(plot, polar_traces(one(comparison, TEST)), STEP)
        heading(
            figure,
            f"{words}: RMS {style.micrometres(one(comparison, TEST).rms / UM)}",
            left + 0.5 * side,
            width,
            height,
        )
    legend(figure, plot, 0.5 * width, width, height)
    figure.text(
        1 - 0.2 / width,
        0.2 / height,
        polar.scale_text(STEP),
        ha="right",
        va="center",
        fontsize=style.TEXT,
        color=style.INK,
    )
    save(figure, IMAGES / "worn-worm-flanks.png")


if __name__ == "__main__":
    main()
