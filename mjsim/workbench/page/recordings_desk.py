"""The page of a campaign of axis logs, or of another instrument but a ball bar."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

from nicegui import ui

from mjsim.machine.effect import Effect
from mjsim.units import UM
from mjsim.workbench.page.base import BaseDesk
from mjsim.workbench.page.effects import EffectsPanel
from mjsim.workbench.page.findings import LogFindingsPanel
from mjsim.workbench.page.ladder import LadderPanel
from mjsim.workbench.page.recordings import RecordingTraces
from mjsim.workbench.recordings_live import RecordingsLive


class RecordingsDesk(BaseDesk):
    """Builds the page and keeps it up to date; arguments as of :class:`BaseDesk`."""

    live: RecordingsLive
    good = 1.5
    keys: ClassVar[tuple[str, ...]] = (
        "Ctrl+Z, Ctrl+Y | undo, redo",
        "P, N | recording before, next recording",
        "F | fit the chosen effect",
        "A | fit all effects that were put in",
        "D | diagnose",
        "S | save to the machine file",
        "L | light or dark",
        "Tab, Enter, arrows | from control to control; move a slider",
    )

    def __init__(self, live: RecordingsLive, dark: bool) -> None:
        super().__init__(live, dark)
        self._bars = -1
        with self.place:
            self.effects = EffectsPanel(live, self.changed, self.fit)
            self.traces = RecordingTraces(live)
            with ui.element("div").classes("stack").style("grid-row: 2"):
                self.findings = LogFindingsPanel(live, self.changed, self.preview)
                with ui.element("div").classes("panel stack").style("flex: 1 1 0; min-height: 110px"):
                    self.ladder = LadderPanel(live, self.changed)
        self.begin()

    def actions(self) -> dict[str, Callable[[], Any]]:
        """Keys of the recordings."""
        return {"p": lambda: self.traces.beside(-1), "n": lambda: self.traces.beside(1)}

    def noise_words(self) -> str:
        """The noise, once the recordings were compared."""
        noise = self.live.bench.noise
        return f"noise {noise / UM:.3f} µm" if noise else ""

    def preview(self, effect: Effect) -> None:
        """Show what an effect changes in the recordings of its axis."""
        self.traces.show(effect.subject)
        self.live.preview(effect)

    def tick(self) -> None:
        """Draw what has changed."""
        if self.live.bars != self._bars:
            self._bars = self.live.bars
            self.effects.draw()
        if self.live.version != self._version:
            self._version = self.live.version
            self.draw_error()
            self.traces.draw_shown()
            self.ladder.draw()
            self.effects.draw()
        self.findings.tick()

    def redraw(self) -> None:
        """The charts, which have colours of their own."""
        self.traces.draw_shown()

    def darken(self, dark: bool) -> None:
        """The charts."""
        self.traces.dark = dark
