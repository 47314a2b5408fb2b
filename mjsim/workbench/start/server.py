"""The server of the start page; every campaign that is opened from it gets a page of its own beside it."""

from __future__ import annotations

import secrets
import tempfile
from collections.abc import Callable
from pathlib import Path
from shutil import copytree

from fastapi import Response
from nicegui import app, ui

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_of
from mjsim.campaign.machine_templates import LAYOUTS
from mjsim.errors import InputError
from mjsim.io.resources import examples
from mjsim.workbench.page.server import LOOPBACK, Server, run_server
from mjsim.workbench.start.page import StartPage
from mjsim.workbench.start.recent import remember

_PREFERS_DARK = "return window.matchMedia('(prefers-color-scheme: dark)').matches"
_PICTURES = Path(__file__).with_name("pictures")


class StartServer:
    """Serves the start page.

    Args:
        threads: Simulations side by side.
    """

    def __init__(self, threads: int) -> None:
        self.token = secrets.token_urlsafe(16)
        self.threads = threads
        self._servers: list[Server] = []
        self._pages: dict[str, StartPage] = {}
        self._copies = tempfile.TemporaryDirectory(prefix="mjsim-example-")
        app.get(f"/{self.token}/pictures/{{name}}")(self._picture)
        ui.page(f"/{self.token}", title="mjsim", response_timeout=30)(self._page)

    def _picture(self, name: str) -> Response:
        if name not in [x.name for x in LAYOUTS]:
            return Response(status_code=404)
        return Response((_PICTURES / f"{name}.jpg").read_bytes(), media_type="image/jpeg")

    async def _page(self) -> None:
        client = ui.context.client
        for file in (Path(__file__).parent.parent / "page" / "style.css", Path(__file__).with_name("start.css")):
            ui.add_css(file.read_text(encoding="utf-8"))
        await client.connected()
        dark = bool(await ui.run_javascript(_PREFERS_DARK, timeout=10.0))
        tab = client.tab_id or client.id
        with client.content:
            known = self._pages.get(tab)
            self._pages[tab] = StartPage(self, dark, known.draft if known is not None else None)

    def workbench(self, folder: Path, kept: bool = True) -> str:
        """Open a campaign.

        Args:
            folder: Of the campaign.
            kept: It stands where the user wants it, so that the start page lists it from now on.

        Returns:
            The address of its page, without the host.

        Raises:
            InputError: It cannot be read.
        """
        campaign = read_campaign(folder)
        server = Server(campaign, machine_of(campaign), self.threads)
        server.open()
        self._servers.append(server)
        if kept:
            remember(folder)
        return f"/{server.token}"

    def example(self, name: str) -> Path:
        """A copy of an example that may be changed.

        Raises:
            InputError: There is no such example.
        """
        source = examples() / name
        if not (source / "campaign.toml").is_file():
            raise InputError(f"{name}: no such example")
        target = Path(self._copies.name) / f"{len(self._servers)}-{name}"
        copytree(source, target)
        return target

    def close(self) -> None:
        """End what goes on in the background, and take drafts away."""
        for server in self._servers:
            server.close()
        for page in self._pages.values():
            page.draft.close()
        self._copies.cleanup()


def serve_start(
    host: str = LOOPBACK,
    port: int = 0,
    browser: bool = True,
    threads: int = 2,
    say: Callable[[str], None] = print,
) -> None:
    """Serve the start page until Ctrl-C; arguments as of :func:`mjsim.workbench.page.server.serve`.

    Raises:
        InputError: The port is taken.
    """
    server = StartServer(threads)
    run_server(server.token, server.close, host, port, browser, say)
