"""The page of one browser tab: where everything is, what the keys do, and when it is drawn again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import background_tasks, run, ui
from nicegui.events import KeyEventArguments

from mjsim.errors import InputError, SimulationError
from mjsim.units import UM
from mjsim.workbench.bodies import MachineBodies
from mjsim.workbench.gains import Stopped
from mjsim.workbench.live import Live
from mjsim.workbench.page.effects import EffectsPanel
from mjsim.workbench.page.files import report_of, video_of
from mjsim.workbench.page.findings import FindingsPanel
from mjsim.workbench.page.ladder import LadderPanel
from mjsim.workbench.page.machine import MachinePanel
from mjsim.workbench.page.part import PartDialog
from mjsim.workbench.page.traces import Traces

#: The page looks for news so often, s.
_TICK = 0.03
_KEYS = """
| key | does |
|---|---|
| Ctrl+Z, Ctrl+Y | undo, redo |
| P, N | test before, next test |
| F | fit the chosen effect |
| A | fit all effects that were put in |
| D | diagnose |
| S | save to the machine file |
| W | predict the error of a workpiece |
| space | play and pause |
| , . | cursor back and forward by half a second |
| L | light or dark |
| Tab, Enter, arrows | from control to control; move a slider |
"""


class Desk:
    """Builds the page and keeps it up to date.

    Args:
        live: The workbench of this tab.
        meshes: Address of the folder with the machine's meshes.
        bodies: The machine; ``None`` where there is no model of it.
        dark: Light on dark to begin with.
    """

    def __init__(self, live: Live, meshes: str, bodies: MachineBodies | None, dark: bool) -> None:
        self.live = live
        self._version = self._bars = -1
        self._late = False
        self.dark = ui.dark_mode(value=dark)
        with ui.element("div").classes("desk"):
            self._top()
            self.effects = EffectsPanel(live, self.changed, self.fit)
            self.traces = Traces(live, self.cursor)
            with ui.element("div").classes("stack").style("grid-row: 2"):
                self.machine = MachinePanel(live, meshes, bodies, lambda: self.traces.name, self.traces.point)
                self.findings = FindingsPanel(live, self.changed, self.preview)
                with ui.element("div").classes("panel stack").style("flex: 1 1 0; min-height: 110px"):
                    self.ladder = LadderPanel(live, self.changed)
        self.part = PartDialog(live, self.work)
        self._darken(dark)
        ui.keyboard(on_key=self._key)
        ui.timer(_TICK, self._tick)

    def _top(self) -> None:
        bench = self.live.bench
        with ui.element("div").classes("panel top"):
            ui.label(bench.campaign.name).classes("name").tooltip(f"{bench.campaign.folder}, {bench.machine.name}")
            with ui.element("div").classes("error-now"):
                ui.label("RMS").classes("soft")
                self.rms = ui.label("…").classes("value").mark("rms")
                self.engine = ui.label("").classes("chip").mark("engine")
                noise = bench.noise
                words = f"noise {noise / UM:.3f} µm" if noise is not None else "nothing was measured"
                ui.label(words).classes("soft").mark("noise")
            self.problem = ui.label().classes("problem").style("overflow: hidden; text-overflow: ellipsis")
            ui.element("div").classes("spring")
            with ui.element("div").classes("buttons"):
                self.undo = self._button("undo", "undo", self._undo, "Undo (Ctrl+Z)")
                self.redo = self._button("redo", "redo", self._redo, "Redo (Ctrl+Y)")
                self._button("auto_graph", "fit all", self.fit_all, "Fit all effects that were put in (A)", True)
                self._button("troubleshoot", "diagnose", self.diagnose, "Search for what the model lacks (D)", True)
                self.save_button = self._button("save", "save", self.save, "Write to the machine file (S)", True)
                self._button("category", "part", self._part, "Predict the error of a part (W)")
                self._button("description", "report", self._report, "Report of the present model")
                self._button("movie", "video", self._video, "Video of the shown test")
                self._button("dark_mode", "light or dark", self._toggle_dark, "Light or dark (L)")
                self._button("keyboard", "keys", self._show_keys, "Keys")

    def _button(self, icon: str, name: str, do: Callable[[], Any], hint: str, words: bool = False) -> ui.button:
        button = ui.button(name if words else "", icon=icon, on_click=do)
        button.props(f'flat dense no-caps aria-label="{name}"').tooltip(hint).mark(name)
        return button

    # -- what changes --------------------------------------------------------------------------------------------------

    def changed(self) -> None:
        """The model is another one."""
        self.live.changed()
        self.effects.draw()
        self.ladder.draw()
        self._draw_buttons()

    def preview(self, effect) -> None:
        """Show what an effect changes in the traces: the test that it changes most, with it."""
        self.traces.choose(self.live.preview(effect))

    def cursor(self, time: float) -> None:
        """Put everything to a time (s) of the shown test."""
        if not self.machine.playing:
            self.traces.point(time)
            self.machine.go(time)

    def _tick(self) -> None:
        live = self.live
        if live.version != self._version:
            self._version = live.version
            self._draw_error()
            self.traces.draw_shown()
            self.machine.changed(self.traces.name)
            self.ladder.draw()
            self._late = True
        elif self._late:  # what is small comes a moment later, so that the large plot moves at once
            self._late = False
            self.traces.draw_all()
        if live.bars != self._bars and live.settled:
            self._bars = live.bars
            self.effects.draw()
        self.findings.tick()

    def _draw_error(self) -> None:
        now = self.live.overlay
        self.problem.text = self.live.error
        if now is None:
            return
        if now.rms is not None:
            self.rms.text = f"{now.rms / UM:.3f} µm"
            good = self.live.bench.noise is not None and now.rms < 1.25 * self.live.bench.noise
            self.rms.classes(**({"add": "good"} if good else {"remove": "good"}))
        else:
            self.rms.text = "–"
        self.engine.text = now.engine
        self.engine.classes(**({"add": "multibody"} if self.live.settled else {"remove": "multibody"}))
        self._draw_buttons()

    def _draw_buttons(self) -> None:
        ladder = self.live.bench.ladder
        self.undo.set_enabled(ladder.can_undo)
        self.redo.set_enabled(ladder.can_redo)
        self.save_button.set_enabled(bool(self.live.bench.unsaved) and self.live.bench.noise is not None)

    # -- what the user does --------------------------------------------------------------------------------------------

    def _undo(self) -> None:
        if self.live.bench.undo():
            self.changed()

    def _redo(self) -> None:
        if self.live.bench.redo():
            self.changed()

    async def work(self, name: str, do: Callable[..., Any], alone: bool = True) -> Any:
        """Do something that takes a while, beside the page; its errors become a message.

        Args:
            name: What is done.
            do: Called with ``progress``.
            alone: The bars of the effects wait for it.

        Returns:
            What ``do`` returns; ``None`` where it was stopped or failed.
        """
        try:
            return await run.io_bound(self.live.run, name, do, alone)
        except Stopped:
            ui.notify(f"{name} was stopped")
        except (InputError, SimulationError) as error:
            ui.notify(str(error), type="negative", timeout=12000, close_button="close", multi_line=True)
        return None

    async def fit(self, effect_id: str) -> None:
        """Fit one effect."""
        if effect_id and await self.work(f"fit {effect_id}", lambda _: self.live.bench.fit(effect_id), False):
            self.changed()

    async def fit_all(self) -> None:
        """Fit all effects that were put in."""
        if await self.work("fit all", lambda _: self.live.bench.fit_all(), False):
            self.changed()

    async def diagnose(self) -> None:
        """Search for what the model lacks."""
        if self.live.bench.noise is None:
            ui.notify("No test has a trace; a diagnosis needs measured tests.", type="warning")
            return
        self.findings.clear()
        if await self.work("diagnose", self.live.bench.diagnose):
            self.findings.draw()

    async def save(self) -> None:
        """Write the model to the machine file, after a question."""
        bench = self.live.bench
        steps = bench.unsaved
        if not steps:
            return
        worse = bench.save_makes_worse()
        with ui.dialog() as dialog, ui.card():
            ui.label(f"Write to {bench.machine.file.name}:").style("font-weight: 600")
            ui.label(", ".join(s.words for s in steps))
            ui.label("The former text is kept in .mjsim. Comments and order of the file stay.").classes("soft")
            if worse:
                ui.label("This model fits worse than the file's.").classes("problem")
            with ui.row():
                ui.button("save", on_click=lambda: dialog.submit(True)).props("no-caps autofocus").mark("really save")
                ui.button("cancel", on_click=lambda: dialog.submit(False)).props("flat no-caps")
        if await dialog:
            done = await self.work("save", lambda progress: bench.save(force=worse, progress=progress))
            if done:
                ui.notify(f"{bench.machine.file.name} has {', '.join(s.words for s in done)}", type="positive")
                self.changed()
        dialog.delete()

    def _part(self) -> None:
        self.part.open(bool(self.dark.value))

    async def _report(self) -> None:
        page = await self.work("report", lambda progress: report_of(self.live.bench, progress))
        if page:
            ui.download.content(page, f"{self.live.bench.campaign.name}-report.html")

    async def _video(self) -> None:
        name = self.traces.name
        film = await self.work("video", lambda progress: video_of(self.live.bench, name, progress))
        if film:
            ui.download.content(film, f"{name}.mp4")

    def _toggle_dark(self) -> None:
        self.dark.value = not self.dark.value
        self._darken(bool(self.dark.value))
        self.traces.draw_shown()

    def _darken(self, dark: bool) -> None:
        """What does not take its colours from the page."""
        self.traces.dark = dark
        self.machine.darken(dark)

    def _show_keys(self) -> None:
        with ui.dialog() as dialog, ui.card():
            ui.markdown(_KEYS)
        dialog.on("hide", dialog.delete)
        dialog.open()

    def _key(self, event: KeyEventArguments) -> None:
        if not event.action.keydown:
            return
        key, control = event.key.name.lower(), event.modifiers.ctrl or event.modifiers.meta
        do: Callable[[], Any] | None = None
        if control:
            again = key == "y" or (key == "z" and event.modifiers.shift)
            do = self._redo if again else self._undo if key == "z" else None
        else:
            do = {
                "p": lambda: self.traces.beside(-1),
                "n": lambda: self.traces.beside(1),
                "f": lambda: self.fit(self.effects.chosen),
                "a": self.fit_all,
                "d": self.diagnose,
                "s": self.save,
                "w": self._part,
                " ": self.machine.toggle,
                ",": lambda: self.machine.step(-0.5),
                ".": lambda: self.machine.step(0.5),
                "l": self._toggle_dark,
            }.get(key)
        if do is not None:
            result = do()
            if result is not None:
                background_tasks.create(result, name=f"key {key}")
