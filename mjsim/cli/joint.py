"""Campaigns with ball-bar tests and axis logs: what ``compare``, ``check`` and ``diagnose`` add for them."""

from __future__ import annotations

from pathlib import Path

import click

from mjsim.cli import common
from mjsim.cli.logs import show_axes, show_check, show_comparison, show_sheet


def has_both(campaign) -> bool:
    """Whether a campaign has measured ball-bar tests and recorded axis logs."""
    return bool(campaign.measured) and bool(campaign.logs.recorded)


def compare_logs(campaign, machine, folder: Path, plots: bool, threads: int, progress) -> tuple[dict, list]:
    """The logs of a campaign compared: their JSON, and the plots in a folder."""
    from mjsim.plots.logs import log_plots
    from mjsim.workflow.log_compare import compare_logs

    result = compare_logs(campaign, machine, threads, progress)
    return result.to_json(), log_plots(result, folder) if plots else []


def show_compared(data: dict) -> None:
    """The logs of a comparison's JSON, below its ball-bar tests."""
    if data.get("axis_logs"):
        click.echo("\naxis logs:")
        show_comparison(data["axis_logs"])


def show_checked(data: dict) -> None:
    """The logs of a check's JSON, below its ball-bar tests."""
    if data.get("axis_logs"):
        click.echo("\naxis logs:")
        show_check(data["axis_logs"])


def diagnose(campaign, machine, write: Path | None, max_effects, force: bool, threads: int, as_json, quiet, show):
    """``mjsim diagnose`` with both instruments; ``show`` prints the JSON of a diagnosis of ball-bar tests."""
    from mjsim.campaign.machine_file import write_machine
    from mjsim.io.files import check_writable
    from mjsim.workflow.joint_diagnose import diagnose_jointly

    if write is not None:
        check_writable(write, force)
    with common.progress_bar(quiet) as progress:
        result = diagnose_jointly(campaign, machine, max_effects, threads, progress)
    if write is not None:
        write_machine(result.machine, machine.file, write, force=force)
    data = result.to_json()
    if as_json:
        common.print_json(data)
    elif not quiet:
        show(data, str(campaign.folder))
        show_logs(data["axis_logs"])
        if write is not None:
            common.say(f"fitted machine written to {write}", quiet)


def show_logs(data: dict) -> None:
    """What the logs of a joint diagnosis add."""
    click.echo()
    show_axes(data["tests"], "axis log")
    click.echo()
    show_sheet(data)
    if data["unexplained"]:
        common.paragraph(data["unexplained"]["summary"])
