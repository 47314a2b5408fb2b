"""``mjsim open``."""

from __future__ import annotations

import click

from mjsim.cli import common


@click.command("open")
@click.argument("campaign", type=common.path_type(), required=False)
@common.machine_option
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to listen at; anything else is open to the network."
)
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port to listen at (default: a free one).")
@click.option("--no-browser", is_flag=True, help="Print the address, open no browser.")
@common.as_is_option
@common.threads_option
@common.options
def command(campaign, machine, host, port, no_browser, as_is, threads) -> None:
    """Open CAMPAIGN in the workbench: change the model and watch the error, in the browser.

    The page shows traces, machine and effects of the campaign; of axis logs errors and torques. Nothing is written
    before you save. Ctrl-C ends it.

    Without CAMPAIGN, a start page: the campaigns opened last, an example, and a new campaign from a machine template
    and dropped files, without a text editor.

    \b
    Example: mjsim open
             mjsim open examples/hidden-backlash
    """
    from mjsim.io.extras import need

    need("open", "workbench", "nicegui")
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import machine_of
    from mjsim.errors import InputError
    from mjsim.workbench.page.server import LOOPBACK, serve
    from mjsim.workbench.start.recent import remember

    if not host.strip():
        raise InputError("--host is empty; allowed: an address of this computer, such as 127.0.0.1")
    if campaign is None and (machine is not None or as_is):
        raise click.UsageError("--machine and --as-is need a CAMPAIGN")
    c = None if campaign is None else read_campaign(campaign, as_is=as_is)
    m = None if c is None else machine_of(c, machine)

    could = "write campaigns on this computer" if campaign is None else "change the machine file"

    as_json, is_quiet = common.wants_json(), common.is_quiet()

    def say(address: str) -> None:
        if host not in (LOOPBACK, "localhost", "::1"):
            click.echo(
                f"mjsim: warning: {host} is open to the network; whoever has the address can {could}",
                err=True,
            )
        if as_json:
            common.print_json({"address": address})
        else:
            click.echo(address if is_quiet else f"{address}\nCtrl-C ends it")

    if c is None or m is None:
        from mjsim.workbench.start.server import serve_start

        serve_start(host, port, not no_browser, common.cores(threads), say)
        return
    remember(c.folder)
    serve(c, m, host, port, not no_browser, common.cores(threads), say)
