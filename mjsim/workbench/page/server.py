"""The server of the workbench: one process, one campaign, a page for every browser tab."""

from __future__ import annotations

import asyncio
import os
import secrets
import socket
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from fastapi import Response
from nicegui import app, ui

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError, SimulationError
from mjsim.machine.model import Machine

if TYPE_CHECKING:
    from mjsim.workbench.page.tabs import Tabs

#: A tab that lost its connection finds its page again within this time, s.
RECONNECT = 120.0
_PREFERS_DARK = "return window.matchMedia('(prefers-color-scheme: dark)').matches"
LOOPBACK = "127.0.0.1"
#: Addresses that stand for all of this computer, and its own among them.
_EVERYWHERE = {"0.0.0.0": LOOPBACK, "::": "::1"}


class Server:
    """Serves one campaign.

    Args:
        campaign: As it was read.
        machine: The model to begin with.
        threads: Tests that are worked on side by side.
    """

    def __init__(self, campaign: Campaign, machine: Machine, threads: int) -> None:
        self.token = secrets.token_urlsafe(16)
        self.campaign, self.machine, self.threads = campaign, machine, threads
        self._tabs: asyncio.Task[Tabs] | None = None
        app.get(f"/{self.token}/meshes/{{name}}")(self._mesh)
        ui.page(f"/{self.token}", title=f"{campaign.name} – mjsim", response_timeout=30)(self._page)

    def open(self) -> None:
        """Begin to open the campaign, beside the page; the server runs already."""
        self._tabs = asyncio.create_task(asyncio.to_thread(self._opened))

    def _opened(self) -> Tabs:
        from mjsim.workbench.page.tabs import Tabs  # takes seconds: the browser gets its page meanwhile

        return Tabs(self.campaign, self.machine, self.threads)

    def _mesh(self, name: str) -> Response:
        tabs = self._ready
        known = tabs.mesh(name) if tabs is not None else None
        return Response(known, media_type="model/stl") if known else Response(status_code=404)

    async def _page(self) -> None:
        client = ui.context.client
        ui.add_css(Path(__file__).with_name("style.css").read_text(encoding="utf-8"))
        place = ui.element("div").classes("waiting")
        with place, ui.element("div").classes("sentence panel"):
            ui.label(f"Opening {self.campaign.name} …")  # nothing that moves: drawing it takes a core in software
            ui.echart({}).style("display: none")  # so the browser has it when the page comes
        await client.connected()
        dark = await ui.run_javascript(_PREFERS_DARK, timeout=10.0)
        assert self._tabs is not None
        try:
            tabs = await asyncio.shield(self._tabs)
        except (InputError, SimulationError) as error:
            place.clear()
            with place, ui.element("div").classes("sentence panel").mark("sentence"):
                ui.label("The campaign cannot be opened as it is.").style("font-weight: 600")
                ui.label(str(error))
            return
        place.delete()
        with client.content:
            tabs.build(client.tab_id or client.id, f"/{self.token}/meshes", bool(dark))

    def close(self) -> None:
        """End what goes on in the background."""
        tabs = self._ready
        if tabs is not None:
            tabs.close()

    @property
    def _ready(self) -> Tabs | None:
        """The open campaign; ``None`` while it is not open, or where it cannot be opened."""
        task = self._tabs
        there = task is not None and task.done() and not task.cancelled() and task.exception() is None
        return task.result() if task is not None and there else None


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
    server = Server(campaign, machine, threads)
    app.on_startup(server.open)
    run_server(server.token, server.close, host, port, browser, say)


def run_server(
    token: str, close: Callable[[], None], host: str, port: int, browser: bool, say: Callable[[str], None]
) -> None:
    """Serve the pages that are there until Ctrl-C.

    Args:
        token: Path of the page that the user begins with.
        close: Ends what goes on in the background.
        host, port, browser, say: As :func:`serve`.

    Raises:
        InputError: The port is taken.
    """
    port = _free_port(host, port)
    shown = f"[{host}]" if ":" in host else host
    if host in _EVERYWHERE:
        shown = socket.gethostname()
    address = f"http://{shown}:{port}/{token}"

    async def started() -> None:
        while not await _listens(_EVERYWHERE.get(host, host), port):
            await asyncio.sleep(0.02)
        say(address)
        if browser:
            webbrowser.open(address)

    app.on_startup(started)
    app.on_shutdown(close)
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


async def _listens(host: str, port: int) -> bool:
    try:
        _, writer = await asyncio.open_connection(host, port)
    except OSError:
        return False
    writer.close()
    return True


def _free_port(host: str, port: int) -> int:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        if os.name == "posix":  # elsewhere it would take a port that another program listens at
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise InputError(f"cannot listen at {host}, port {port}: {error.strerror or error}") from None
        return int(probe.getsockname()[1])
