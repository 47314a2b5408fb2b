"""``mjsim remove``."""

from __future__ import annotations

import click

from mjsim.cli import common


@click.command("remove")
@common.campaign_argument
@click.argument("effect", shell_complete=common.effect_ids)
@common.machine_option
@common.threads_option
@common.options
def command(campaign, effect, machine, threads) -> None:
    """Take EFFECT out of the machine file of CAMPAIGN again.

    \b
    Example: mjsim remove examples/hidden-backlash backlash.A
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.cli.add import change_json, show_change
    from mjsim.commands.edit import remove

    c = read_campaign(campaign)
    with common.progress_bar() as progress:
        change = remove(c, effect, machine, common.cores(threads), progress)
    data = change_json(change)
    if common.answered(data):
        return
    show_change("removed", data)
    common.say(f"{change.machine.path} no longer has {change.id}; the previous version is in {c.state_folder}")
