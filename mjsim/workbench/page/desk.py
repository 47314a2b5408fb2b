"""The page of one browser tab: where everything is, what the keys do, and when it is drawn again."""

from __future__ import annotations

import math
import tempfile
import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from mjsim.io.extras import need
from mjsim.progress import Progress
from mjsim.workbench.bodies import MachineBodies
from mjsim.workbench.live import Live
from mjsim.workbench.page.base import BaseDesk, LadderPanel
from mjsim.workbench.page.effects import EffectsPanel
from mjsim.workbench.page.findings import FindingsPanel
from mjsim.workbench.page.machine import MachinePanel
from mjsim.workbench.page.part import PartDialog
from mjsim.workbench.page.traces import Traces
from mjsim.workbench.state import Workbench

#: The polar plot moves at once and the residual so much later, s, when the page has it.
_LATER = 0.06
#: The machine and the small plots wait so long for the rest of the tests, s: drawing them holds up the next change.
_REST = 0.5
_KEYS = (
    "Ctrl+Z, Ctrl+Y | undo, redo",
    "P, N | test before, next test",
    "F | fit the chosen effect",
    "A | fit all effects that were put in",
    "D | diagnose",
    "S | save to the machine file",
    "W | predict the error of a workpiece",
    "space | play and pause",
    ", . | cursor back and forward by half a second",
    "L | light or dark",
    "Tab, Enter, arrows | from control to control; move a slider",
)


class Desk(BaseDesk):
    """The page of a ball-bar campaign; builds it and keeps it up to date.

    Args:
        live: The workbench of this tab.
        meshes: Address of the folder with the machine's meshes.
        bodies: The machine; ``None`` where there is no model of it.
        dark: Light on dark to begin with.
    """

    live: Live
    keys = _KEYS

    def __init__(self, live: Live, meshes: str, bodies: MachineBodies | None, dark: bool) -> None:
        super().__init__(live, dark)
        self._bars = -1
        self._chart_at = self._rest_at = math.inf
        with self.place:
            self.effects = EffectsPanel(live, self.changed, self.fit)
            self.traces = Traces(live, self.cursor)
            with ui.element("div").classes("stack").style("grid-row: 2"):
                self.machine = MachinePanel(live, meshes, bodies, lambda: self.traces.name, self.traces.point)
                self.findings = FindingsPanel(live, self.changed, self.preview)
                with ui.element("div").classes("panel stack").style("flex: 1 1 0; min-height: 110px"):
                    self.ladder = LadderPanel(live, self.changed)
        self.part = PartDialog(live, self.work)
        self.begin()

    def more_buttons(self) -> None:
        """Part and video."""
        self._button("category", "part", self._part, "Predict the error of a part (W)")
        self._button("movie", "video", self._video, "Video of the shown test")

    def actions(self) -> dict[str, Callable[[], Any]]:
        """Keys of the tests, the machine and the part."""
        return {
            "p": lambda: self.traces.beside(-1),
            "n": lambda: self.traces.beside(1),
            "w": self._part,
            " ": self.machine.toggle,
            ",": lambda: self.machine.step(-0.5),
            ".": lambda: self.machine.step(0.5),
        }

    # -- what changes --------------------------------------------------------------------------------------------------

    def preview(self, effect) -> None:
        """Show what an effect changes in the traces: the test that it changes most, with it."""
        self.traces.choose(self.live.preview(effect))

    def cursor(self, time: float) -> None:
        """Put everything to a time (s) of the shown test."""
        if not self.machine.playing:
            self.traces.point(time)
            self.machine.go(time)

    def tick(self) -> None:
        """Draw what has changed: the shown test first."""
        live = self.live
        if live.version != self._version:
            self._version = live.version
            self.draw_error()
            self.traces.draw_polar()
            now = clock.monotonic()
            self._chart_at, self._rest_at = now + _LATER, now + (2 * _LATER if live.settled else _REST)
        elif clock.monotonic() > self._chart_at:
            self._chart_at = math.inf
            self.traces.draw_chart()
        elif clock.monotonic() > self._rest_at:
            self._rest_at = math.inf
            self.machine.changed(self.traces.name)
            self.ladder.draw()
            self.traces.draw_all()
        if live.bars != self._bars and live.settled:
            self._bars = live.bars
            self.effects.draw()
        self.findings.tick()

    def _part(self) -> None:
        self.part.open(bool(self.dark.value))

    async def _video(self) -> None:
        name = self.traces.name
        film = await self.work("video", lambda progress: video_of(self.live.bench, name, progress))
        if film:
            ui.download.content(film, f"{name}.mp4")

    def redraw(self) -> None:
        """The traces, whose chart has colours of its own."""
        self.traces.draw_shown()

    def darken(self, dark: bool) -> None:
        """What does not take its colours from the page."""
        self.traces.dark = dark
        self.machine.darken(dark)


def video_of(bench: Workbench, name: str, progress: Progress) -> bytes:
    """A video of one test with the present model, MP4.

    Raises:
        InputError: The extra "video" is not installed, or there is no OpenGL.
    """
    need("video", "video", "av", "PIL")
    from mjsim.animation.movie import animate  # not above: its import needs the extra

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "film.mp4"
        animate(bench.campaign, name, file, bench.machine, threads=bench.threads, progress=progress)
        return file.read_bytes()
