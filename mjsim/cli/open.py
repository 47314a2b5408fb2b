"""``mjsim open``."""

from __future__ import annotations

import click

from mjsim.cli import common


@click.command("open")
@common.campaign_argument
@common.machine_option
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to listen at; anything else is open to the network."
)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port to listen at (default: a free one).")
@click.option("--no-browser", is_flag=True, help="Print the address, open no browser.")
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, machine, host, port, no_browser, as_is, threads, as_json, quiet) -> None:
    """Open CAMPAIGN in the workbench: change the model and watch the error, in the browser.

    The page shows traces, machine and effects of the campaign; of axis logs errors and torques. Nothing is written
    before you save. Ctrl-C ends it.

    \b
    Example: mjsim open examples/hidden-backlash
    """
    from mjsim.io.extras import need

    need("open", "workbench", "nicegui")
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import machine_of
    from mjsim.errors import InputError
    from mjsim.workbench.page.server import LOOPBACK, serve

    if not host.strip():
        raise InputError("--host is empty; allowed: an address of this computer, such as 127.0.0.1")
    c = read_campaign(campaign, as_is=as_is)
    m = machine_of(c, machine)

    def say(address: str) -> None:
        if host not in (LOOPBACK, "localhost", "::1"):
            click.echo(
                f"mjsim: warning: {host} is open to the network; whoever has the address can change the machine file",
                err=True,
            )
        if as_json:
            common.print_json({"address": address})
        else:
            click.echo(f"{address}\nCtrl-C ends it" if not quiet else address)

    serve(c, m, host, port, not no_browser, common.cores(threads), say)
