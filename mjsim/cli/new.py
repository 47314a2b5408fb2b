"""``mjsim new``."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common


@click.group("new")
def command() -> None:
    """Start something new.

    \b
    Example: mjsim new campaign my-machine
    """


@command.command("campaign", short_help="Start a campaign: a folder with commented files.")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option("--name", help="Name of the campaign (default: the folder's).")
@common.options
def campaign(folder, name, as_json, quiet) -> None:
    """Start a campaign in FOLDER: commented campaign.toml and machine.toml that run as they are, and a folder for the
    traces.

    FOLDER is new or empty.

    \b
    Example: mjsim new campaign my-machine
    """
    from mjsim.campaign.new import new_campaign

    files = new_campaign(folder, name)
    if as_json:
        common.print_json({"folder": str(folder), "files": [str(f) for f in files]})
        return
    if quiet:
        return
    click.echo(f"{folder} has campaign.toml, machine.toml and traces/. Next:\n")
    for line in (
        f"mjsim simulate {folder} --out {folder}/simulated",
        f"(edit {folder}/machine.toml and campaign.toml: your machine, your tests)",
        f"mjsim import FILE --campaign {folder} --test NAME --preview",
        f"mjsim compare {folder}",
        f"mjsim diagnose {folder}",
    ):
        click.echo(f"  {line}")
