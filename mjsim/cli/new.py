"""``mjsim new``."""

from __future__ import annotations

import click

from mjsim.cli import common


@click.group("new")
def command() -> None:
    """Start something new.

    \b
    Example: mjsim new campaign my-machine
    """


@command.command("campaign", short_help="Start a campaign: a folder with commented files.")
@click.argument("folder", type=common.path_type(file_okay=False))
@click.option("--name", help="Name of the campaign (default: the folder's).")
@click.option("--logs", metavar="AXES", help="For axis logs of a machine with these axes, such as XY or C.")
@click.option(
    "--instrument",
    type=click.Choice(["ball_bar", "sphere", "positions"]),
    help="That it begins with (default: ball_bar).",
)
@common.options
def campaign(folder, name, logs, instrument) -> None:
    """Start a campaign in FOLDER: commented campaign.toml and machine.toml that run as they are, and a folder for the
    traces. --instrument sphere begins with a touch probe and a sphere, positions with a laser or a level. With --logs,
    it is a campaign of axis logs; the axes that were recorded are enough.

    FOLDER is new or empty.

    \b
    Example: mjsim new campaign my-machine
             mjsim new campaign my-machine --instrument sphere
             mjsim new campaign my-table --logs XY
    """
    from mjsim.campaign.new import new_campaign, new_log_campaign

    if logs is not None and instrument is not None:
        raise click.UsageError("--logs and --instrument exclude each other")
    if logs is not None:
        files = new_log_campaign(folder, logs, name)
    else:
        files = new_campaign(folder, name, instrument or "ball_bar")
    if common.answered({"folder": str(folder), "files": [str(f) for f in files]}):
        return
    click.echo(f"{folder} has campaign.toml, machine.toml and traces/. Next:\n")
    edit = f"(edit {folder}/machine.toml and campaign.toml: your machine, your tests)"
    steps = {
        "ball_bar": (
            f"mjsim simulate {folder} --out {folder}/simulated",
            edit,
            f"mjsim import FILE --campaign {folder} --test NAME --preview",
            f"mjsim compare {folder}",
        ),
        "sphere": (
            edit,
            f"mjsim plan {folder} --points 30 --range A -90 30 --write",
            f"mjsim nc {folder} --test ball -o ball.csv",
            f"mjsim import FILE --campaign {folder} --points --test ball --preview",
            f"mjsim check {folder}",
        ),
        "positions": (
            edit,
            f"mjsim plan {folder} --targets X --range X 0 400 --write",
            f"mjsim nc {folder} --test targets-x -o targets-x.csv",
            f"mjsim import FILE --campaign {folder} --points --test targets-x --preview",
            f"mjsim check {folder}",
        ),
        "axis_log": (
            f"(edit {folder}/machine.toml: your drives)",
            f"mjsim import FILE --campaign {folder} --log --preview",
            f"mjsim check {folder}",
        ),
    }
    for line in (*steps["axis_log" if logs is not None else instrument or "ball_bar"], f"mjsim diagnose {folder}"):
        click.echo(f"  {line}")
