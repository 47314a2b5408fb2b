"""``mjsim report``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli.part_options import PART, part_runs


@click.command("report")
@click.argument("campaigns", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="CAMPAIGN...")
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("report.html"),
    show_default=True,
    help="The page to write.",
)
@common.machine_option
@common.max_effects_option
@click.option("--no-diagnose", is_flag=True, help="Compare only; look for no missing effects.")
@click.option(
    "--part", "parts", multiple=True, metavar="PROGRAM", help="Also predict the error of this part, as mjsim predict."
)
@PART
@click.option("--force", is_flag=True, help="Replace the page.")
@common.as_is_option
@common.threads_option
@common.options
def command(
    campaigns, out, machine, max_effects, no_diagnose, parts, tolerance, tool, zero, feed, force, threads,
    as_is, as_json, quiet, **how,
) -> None:  # fmt: skip
    """Write what CAMPAIGN shows as one HTML page that works offline and prints well.

    The campaign is compared and diagnosed. Several campaigns of one machine become a trend: which figure, which
    effect has changed beyond its uncertainty. Axis logs get a page of their own. With
    ball-bar tests in the same campaign, they stand below these.

    \b
    Example: mjsim report examples/hidden-backlash -o report.html
             mjsim report examples/hidden-backlash --part s-shape --zero 40 0 120
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import machine_of
    from mjsim.errors import InputError
    from mjsim.instruments.ball_bar.measurement import BallBarTest
    from mjsim.io.files import check_writable, write_whole
    from mjsim.report.write import report

    runs = part_runs(parts, tolerance, tool, zero, feed, **how)
    read = [read_campaign(c, as_is=as_is) for c in campaigns]
    machines = [machine_of(c, machine) for c in read]
    if runs and (len(read) > 1 or BallBarTest.instrument not in read[0].measured_parts):
        raise InputError("--part: allowed for one ball-bar campaign")
    check_writable(out, force)
    with common.progress_bar(quiet) as progress:
        result = report(read, machines, max_effects, not no_diagnose, common.cores(threads), progress, runs)
    write_whole(out, result.html, force=force)
    if as_json:
        common.print_json(result.data)
        return
    common.say(f"{result.data['title']}: {out} ({len(result.html.encode()) / 1e6:.1f} MB)", quiet)
