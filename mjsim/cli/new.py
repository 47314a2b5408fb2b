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
@click.option("--logs", metavar="AXES", help="For axis logs of a machine with these axes, such as XY or C.")
@common.options
def campaign(folder, name, logs) -> None:
    """Start a campaign in FOLDER: commented campaign.toml and machine.toml that run as they are, and a folder for the
    traces. With --logs, it is a campaign of axis logs; the axes that were recorded are enough.

    FOLDER is new or empty.

    \b
    Example: mjsim new campaign my-machine
             mjsim new campaign my-table --logs XY
    """
    from mjsim.campaign.new import new_campaign, new_log_campaign

    files = new_campaign(folder, name) if logs is None else new_log_campaign(folder, logs, name)
    if common.answered({"folder": str(folder), "files": [str(f) for f in files]}):
        return
    click.echo(f"{folder} has campaign.toml, machine.toml and traces/. Next:\n")
    steps = (
        f"(edit {folder}/machine.toml: your drives)",
        f"mjsim import FILE --campaign {folder} --log --preview",
        f"mjsim check {folder}",
        f"mjsim diagnose {folder}",
    )
    for line in (
        steps
        if logs is not None
        else (
            f"mjsim simulate {folder} --out {folder}/simulated",
            f"(edit {folder}/machine.toml and campaign.toml: your machine, your tests)",
            f"mjsim import FILE --campaign {folder} --test NAME --preview",
            f"mjsim compare {folder}",
            f"mjsim diagnose {folder}",
        )
    ):
        click.echo(f"  {line}")
