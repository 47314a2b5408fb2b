"""A running workbench and the page of it in headless Chromium, for scripts that measure it or take its pictures."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from mjsim.io.resources import examples

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
#: Patience for one thing to appear, ms: a diagnosis takes long where the machine is busy.
PATIENCE = 900_000


class Opened:
    """``mjsim open`` on a copy of a campaign, and its page; a context manager.

    Args:
        example: Name of an example, or a campaign's folder; ``None`` for the start page.
        size: Of the page, pixels.
        dark: The browser asks for a dark page.
        video: Folder of a recording of the page; none is made where it is missing.
    """

    page: Page

    def __init__(
        self,
        example: str | Path | None = "hidden-backlash",
        size: tuple[int, int] = (1280, 800),
        dark: bool = False,
        video: Path | None = None,
    ) -> None:
        self.example, self.size, self.dark, self.video = example, size, dark, video

    def __enter__(self) -> Opened:
        self._folder = tempfile.TemporaryDirectory()
        self.campaign = Path(self._folder.name) / "campaign"
        if self.example is not None:
            shutil.copytree(examples() / self.example, self.campaign)
        self._playwright = sync_playwright().start()
        browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))))
        self._browser = self._playwright.chromium.launch(executable_path=browser, args=FLAGS)
        start = "from mjsim.cli.main import main; main()"
        campaign = [] if self.example is None else [str(self.campaign)]
        command = [sys.executable, "-c", start, "open", *campaign, "--no-browser", "--json"]
        #: When the command was started, s: the browser runs by then, as a user's does.
        self.started = time.monotonic()
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        text = ""
        while "}" not in text:
            line = self.process.stdout.readline()
            if not line:
                raise RuntimeError("the server did not start")
            text += line
        width, height = self.size
        view = {"width": width, "height": height}
        recorded = {"record_video_dir": str(self.video), "record_video_size": view} if self.video else {}
        self.context = self._browser.new_context(
            viewport=view, color_scheme="dark" if self.dark else "light", **recorded
        )
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE)
        #: Poses of the machine that the page was sent.
        self.poses = 0
        self.page.on("websocket", lambda socket: socket.on("framereceived", self._received))
        self.page.goto(json.loads(text)["address"])
        return self

    def _received(self, frame: str | bytes) -> None:
        """Count the frames that turn the table: one a pose."""
        text = frame if isinstance(frame, str) else frame.decode(errors="replace")
        self.poses += "rotate" in text

    def until(self, condition: str) -> None:
        """Wait for a condition in the page (JavaScript)."""
        self.page.wait_for_function(condition, timeout=PATIENCE)

    def settled(self) -> None:
        """Wait until all tests are simulated in the multibody model."""
        self.page.wait_for_timeout(400)
        self.until("document.querySelector('.chip')?.textContent == 'multibody'")

    def __exit__(self, *_) -> None:
        self.context.close()
        self._browser.close()
        self._playwright.stop()
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self._folder.cleanup()


def slider_of(opened: Opened, axis: str, effect: str) -> None:
    """Switch an effect on and show its sliders."""
    row = opened.page.locator(f"[data-effect='{effect}']")
    if not row.is_visible():
        opened.page.locator(f"[data-effect='axis {axis}']").click()
    row.click()
    switch = opened.page.get_by_label("In the model")
    if switch.get_attribute("aria-checked") != "true":
        switch.click()
    opened.page.locator(".detail .q-slider").first.wait_for()
    opened.settled()
