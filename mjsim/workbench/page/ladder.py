"""The ladder on the page: every model that was tried, its error, and the way back."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from mjsim.units import UM
from mjsim.workbench.live import Live
from mjsim.workbench.recordings_live import RecordingsLive


class LadderPanel:
    """Draws the ladder.

    Args:
        live: The workbench.
        on_change: Called after another model was chosen.
    """

    def __init__(self, live: Live | RecordingsLive, on_change: Callable[[], None]) -> None:
        self.live, self.on_change = live, on_change
        self._seen: tuple = ()
        with ui.element("div").classes("title"):
            ui.label("Ladder")
            ui.label("residual RMS in µm").classes("soft")
        self.rows = ui.element("div").classes("ladder").mark("ladder")

    def draw(self) -> None:
        """Draw the rungs again, if they have changed."""
        ladder = self.live.bench.ladder
        seen = (ladder.place, tuple((r.label, r.rms) for r in ladder.rungs))
        if seen == self._seen:
            return
        self._seen = seen
        self.rows.clear()
        with self.rows:
            for place, rung in reversed(list(enumerate(ladder.rungs))):
                row = ui.element("button").classes("rung").mark(f"rung {place}")
                row.classes("chosen" if place == ladder.place else "undone" if place > ladder.place else "")
                row.on("click", lambda _, place=place: self._go(place))
                with row:
                    ui.label(rung.label).classes("label").tooltip(rung.label)
                    ui.label(f"{rung.rms / UM:.3f}" if rung.rms is not None else "…").classes("value")

    def _go(self, place: int) -> None:
        self.live.bench.ladder.go(place)
        self.on_change()
