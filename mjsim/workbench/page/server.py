"""The server of the workbench: one process, one campaign, a page for every browser tab."""

from __future__ import annotations

import asyncio
import secrets
import socket
import webbrowser
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path

from fastapi import Response
from nicegui import app, ui

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError, SimulationError
from mjsim.machine.bodies import has_model
from mjsim.machine.model import Machine
from mjsim.workbench.bodies import MachineBodies
from mjsim.workbench.live import Live
from mjsim.workbench.log_live import LogLive
from mjsim.workbench.log_state import LogBench, SharedLogs
from mjsim.workbench.opened import OpenCampaign
from mjsim.workbench.page.desk import Desk
from mjsim.workbench.page.log_desk import LogDesk
from mjsim.workbench.state import Workbench
from mjsim.workbench.tried import Shared

#: A tab that lost its connection finds its page again within this time, s.
RECONNECT = 120.0
#: Tabs whose state is kept, the ones closed last included.
_TABS = 12
_PREFERS_DARK = "return window.matchMedia('(prefers-color-scheme: dark)').matches"
LOOPBACK = "127.0.0.1"


class Server:
    """Serves one campaign.

    Args:
        opening: Opens the campaign; called once, in a thread.
        name: Of the campaign.
    """

    def __init__(self, opening: Callable[[], Shared | SharedLogs], name: str) -> None:
        self.token = secrets.token_urlsafe(16)
        self.name = name
        self._opening = opening
        self._shared: asyncio.Task[Shared | SharedLogs] | None = None
        self._tabs: OrderedDict[str, Live | LogLive] = OrderedDict()
        self._bodies: MachineBodies | None = None
        self._solids: dict[str, bytes] = {}
        app.get(f"/{self.token}/meshes/{{name}}")(self._mesh)
        ui.page(f"/{self.token}", title=f"{name} – mjsim", response_timeout=30)(self._page)
        app.on_startup(self._open)

    def _open(self) -> None:
        self._shared = asyncio.create_task(asyncio.to_thread(self._prepare))

    def _prepare(self) -> Shared | SharedLogs:
        shared = self._opening()
        if isinstance(shared, Shared) and has_model(shared.opened.machine.chain):
            self._bodies = MachineBodies(shared.opened.machine.chain)
            self._solids = self._bodies.solids()
        return shared

    def _mesh(self, name: str) -> Response:
        known = self._solids.get(name)
        return Response(known, media_type="model/stl") if known else Response(status_code=404)

    async def _page(self) -> None:
        client = ui.context.client
        ui.add_css(Path(__file__).with_name("style.css").read_text(encoding="utf-8"))
        place = ui.element("div").classes("waiting")
        with place, ui.element("div").classes("sentence panel"):
            ui.label(f"Opening {self.name} …")
            ui.linear_progress(show_value=False).props("indeterminate")
        await client.connected()
        assert self._shared is not None
        try:
            shared = await asyncio.shield(self._shared)
        except (InputError, SimulationError) as error:
            place.clear()
            with place, ui.element("div").classes("sentence panel").mark("sentence"):
                ui.label("The campaign cannot be opened as it is.").style("font-weight: 600")
                ui.label(str(error))
            return
        live = self._live(client.tab_id or client.id, shared)
        dark = await ui.run_javascript(_PREFERS_DARK, timeout=10.0)
        place.delete()
        with client.content:
            if isinstance(live, LogLive):
                LogDesk(live, bool(dark))
            else:
                Desk(live, f"/{self.token}/meshes", self._bodies, bool(dark))

    def _live(self, tab: str, shared: Shared | SharedLogs) -> Live | LogLive:
        """The state of a tab, which a reload of the page keeps."""
        if tab not in self._tabs:
            logs = isinstance(shared, SharedLogs)
            self._tabs[tab] = LogLive(LogBench(shared)) if logs else Live(Workbench(shared))
        self._tabs.move_to_end(tab)
        while len(self._tabs) > _TABS:
            self._tabs.popitem(last=False)[1].close()
        return self._tabs[tab]

    def close(self) -> None:
        """End what goes on in the background."""
        for live in self._tabs.values():
            live.close()


def serve(
    campaign: Campaign,
    machine: Machine,
    host: str = LOOPBACK,
    port: int = 0,
    browser: bool = True,
    threads: int = 2,
    say: Callable[[str], None] = print,
) -> None:
    """Serve a campaign until Ctrl-C.

    Args:
        campaign: As it was read.
        machine: The model to begin with.
        host: Address to listen at.
        port: To listen at; a free one with 0.
        browser: Open the page in the user's browser.
        threads: Tests that are worked on side by side.
        say: Called with the address of the page.

    Raises:
        InputError: The port is taken.
    """

    def opening() -> Shared | SharedLogs:
        if campaign.logs.tests and not campaign.tests:
            return SharedLogs(campaign, machine, threads)
        return Shared(OpenCampaign.of(campaign, machine, threads))

    server = Server(opening, campaign.name)
    port = _free_port(host, port)
    shown = host if host not in ("0.0.0.0", "::") else socket.gethostname()
    address = f"http://{shown}:{port}/{server.token}"

    def started() -> None:
        say(address)
        if browser:
            webbrowser.open(address)

    app.on_startup(started)
    app.on_shutdown(server.close)
    ui.run(
        host=host,
        port=port,
        title="mjsim",
        favicon="⚙",
        dark=None,
        reload=False,
        show=False,
        show_welcome_message=False,
        reconnect_timeout=RECONNECT,
        message_history_length=200,
        tailwind=False,
        binding_refresh_interval=None,
        timeout_graceful_shutdown=1,
    )


def _free_port(host: str, port: int) -> int:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise InputError(f"cannot listen at {host}, port {port}: {error.strerror or error}") from None
        return int(probe.getsockname()[1])
