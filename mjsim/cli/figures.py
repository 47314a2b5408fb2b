"""``mjsim figures``."""

from __future__ import annotations

from dataclasses import asdict

import click

from mjsim.cli import common

#: What the groups of the paper's numbers are about, and the longest list that fits a column.
_GROUPS = {
    "axis_travel": "Travel of the axes (section 3)",
    "reversals_15_10_centre": "Reversals at half apex 15°, centre, plot angles in ° (Fig. 7)",
    "feed_15_10": "Largest velocities near 180° at half apex 15° (Fig. 9)",
    "worm": "Worm gears (Fig. 3 to 6)",
    "bar": "Ball bar and test (section 2.1)",
}
_SHORT = 16


def _said(agrees: bool) -> str:
    return "yes" if agrees else "NO"


@click.command("figures")
@common.folder_option("--out", required=True, help="Folder for the figures.")
@click.option("--only", type=int, multiple=True, help="Only this figure, 3 to 17 (may be given more than once).")
@click.option("--force", is_flag=True, help="Replace files that exist.")
@common.threads_option
@common.options
def command(out, only, force, threads) -> None:
    """Regenerate figures 3 to 17 of the paper (Kato, Tsutsumi, Sato 2013) and print its numbers beside the simulated
    ones.

    Writes fig03.png, fig03.svg … fig17.svg and numbers.csv. Where a figure needs a measurement, an independent
    simulation stands in for it and says so; drive values that the paper does not print are assumed.

    \b
    Example: mjsim figures --out paper
    """
    from mjsim.paper.figures import NUMBERS, figures, plain

    with common.progress_bar() as progress:
        made = figures(out, only or NUMBERS, force, common.cores(threads), progress)
    rows = [{**asdict(n), "agrees": n.agrees} for n in made.numbers]
    if common.answered({"files": [str(f) for f in made.files], "numbers": rows}):
        return
    for group in dict.fromkeys(n.group for n in made.numbers):
        click.echo(f"\n{_GROUPS.get(group, group)}")
        rows = [n for n in made.numbers if n.group == group]
        short = [n for n in rows if len(plain(n.simulated)) <= _SHORT]
        common.table(
            ["number", "printed", "simulated", "±", "agrees"],
            [
                [
                    n.name,
                    plain(n.printed),
                    plain(n.simulated),
                    f"{n.tolerance:g}" if n.tolerance else "",
                    _said(n.agrees),
                ]
                for n in short
            ],
        )
        for n in rows:
            if n not in short:
                common.paragraph(
                    f"{n.name}: printed {plain(n.printed)}; simulated {plain(n.simulated)}; agrees: {_said(n.agrees)}"
                )
    notes = [n for n in made.numbers if n.note]
    click.echo()
    for n in notes:
        common.paragraph(f"{n.name}: {n.note}")
    common.say(f"\n{len(made.files)} files written to {out}")
