"""``mjsim geometry``."""

from __future__ import annotations

import click

from mjsim.cli import common
from mjsim.cli.compare import show_combinations
from mjsim.digits import estimate, expanded
from mjsim.units import unit_of


@click.command("geometry")
@common.campaign_argument
@common.machine_option
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, machine, threads, as_is) -> None:
    """Where the axes of the machine of CAMPAIGN are: the location errors of its rotary axes and the squareness of its
    linear axes, each with its 95 % interval, and what the tests cannot tell apart.

    \b
    Example: mjsim geometry examples/healthy
    """
    from mjsim.commands.geometry import geometry

    c, m = common.campaign_and_machine(campaign, machine, as_is=as_is)
    c = c.of("ball_bar")
    with common.progress_bar() as progress:
        result = geometry(c, m, common.cores(threads), progress)
    data = result.to_json()
    if common.answered(data):
        return
    show(data)


def show(data: dict) -> None:
    """The table of the geometry, then what it leaves open."""
    common.paragraph(
        f"Geometry of {data['configuration']} from {data['tests']} test{'s' if data['tests'] > 1 else ''}; the "
        f"residual is {data['residual_over_noise']:.2f} times the noise of {data['noise_um']:.3f} µm"
    )
    if not data["explained"]:
        common.paragraph(
            "The tests show more than geometry and what a machine of this class has. The numbers below can be wrong: "
            "run `mjsim diagnose` first, and `mjsim add` what it finds."
        )
    click.echo()
    rows = []
    for r in data["geometry"]:
        unit, ends = unit_of(r["parameter"])[1], r["ci95"]
        name, known = r["id"].partition(".")[2], "" if r["determined"] else "open"
        rows.append([name, r["meaning"], estimate(r["value"], ends, "+"), expanded(ends), unit, known])
    common.table(["error", "what", "value", "95 %", "unit", ""], rows, text=(0, 1, 4, 5))
    still_open = [r for r in data["geometry"] if not r["determined"]]
    if still_open:
        click.echo()
    for r in still_open:
        others = ", ".join(_names(r["instead"]))
        why = f"the tests cannot tell it from {others}" if others else "no test shows it well"
        common.paragraph(f"{r['id']} is open: {why}.")
    show_combinations(data)
    if data["left_out"]:
        common.paragraph(
            f"Not listed, because no test can tell them from the others: {', '.join(data['left_out'])}. The table has "
            "what they make together."
        )


def _names(rows: list[dict]) -> list[str]:
    """What may stand in the place of a number; the same of several set-ups once."""
    out: dict[str, list[str]] = {}
    for row in rows:
        what, _, setup = row["name"].partition(" of set-up ")
        out.setdefault(what, []).extend([setup] if setup else [])
    return [f"{what} of set-up {' and '.join(setups)}" if setups else what for what, setups in out.items()]
