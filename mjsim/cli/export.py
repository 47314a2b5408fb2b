"""``mjsim export``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common


@click.command("export")
@common.campaign_argument
@common.machine_option
@common.names_option
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder for the CSV files."
)
@click.option("--decimal-comma", is_flag=True, help="Semicolons and decimal commas, for spreadsheets that expect them.")
@click.option("--force", is_flag=True, help="Replace files that exist.")
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, machine, names, out, decimal_comma, force, threads, as_is, as_json, quiet) -> None:
    """Write the compared traces and their figures as CSV.

    <test>.csv has time_s, phi_deg, measured_um, simulated_um, residual_um and valid (0: missing or left out);
    figures.csv the ISO 230-4 figures of both traces per test, figures-both-directions.csv G(b) and D.
    Of axis logs, <test>-<axis>.csv has command, measured and simulated position, speed and torque.

    \b
    Example: mjsim export examples/hidden-backlash --out tables
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import machine_of
    from mjsim.workflow.export import export

    c = read_campaign(campaign, as_is=as_is)
    m = machine_of(c, machine)
    with common.progress_bar(quiet) as progress:
        files = export(c, m, out, names, decimal_comma, force, common.cores(threads), progress)
    if as_json:
        common.print_json({"campaign": c.name, "machine": m.name, "files": [str(f) for f in files]})
        return
    common.say(f"{len(files)} files written to {out}", quiet)
