"""What the pages of all campaigns have: the top bar, undo and redo, save, work in the background, keys."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any, ClassVar

from nicegui import background_tasks, run, ui
from nicegui.events import KeyEventArguments

from mjsim.errors import InputError, SimulationError
from mjsim.progress import Progress
from mjsim.units import UM
from mjsim.workbench.jobs import Stopped
from mjsim.workbench.live import Live, RecordingsLive
from mjsim.workbench.overlay import MULTIBODY
from mjsim.workbench.page.effects import EffectsPanel
from mjsim.workbench.page.findings import JobPanel
from mjsim.workbench.tried import ChangedModel

# -- the ladder on the page --------------------------------------------------------------------------------------------


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


#: The page looks for news so often, s.
_TICK = 0.03
_SPACE = " "


class BaseDesk:
    """The page of one browser tab. A subclass puts its panels into :attr:`place`, then calls :meth:`begin`.

    Args:
        live: The workbench of this tab.
        dark: Light on dark to begin with.
    """

    #: Keys and what they do, for the user, a bar between them.
    keys: ClassVar[tuple[str, ...]] = ()
    #: The error is that of the noise within this factor.
    good: ClassVar[float] = 1.25
    effects: EffectsPanel
    ladder: LadderPanel
    findings: JobPanel

    def __init__(self, live: Live | RecordingsLive, dark: bool) -> None:
        self.live = live
        self._version = -1
        self.dark = ui.dark_mode(value=dark)
        self.place = ui.element("div").classes("desk")
        with self.place:
            self._top()

    def begin(self) -> None:
        """Listen to keys, and look for news from now on."""
        self.darken(bool(self.dark.value))
        # a focused button takes the space bar, no other key: who works without a mouse stands on buttons all the time
        ui.keyboard(
            on_key=lambda e: self._key(e) if e.key.name != _SPACE else None, ignore=["input", "select", "textarea"]
        )
        ui.keyboard(on_key=lambda e: self._key(e) if e.key.name == _SPACE else None)
        ui.timer(_TICK, self.tick)

    # -- what a subclass says ------------------------------------------------------------------------------------------

    def more_buttons(self) -> None:
        """Buttons behind "report"."""

    def actions(self) -> dict[str, Callable[[], Any]]:
        """What further keys do."""
        return {}

    def tick(self) -> None:
        """Draw what has changed."""

    def darken(self, dark: bool) -> None:
        """What does not take its colours from the page."""

    def redraw(self) -> None:
        """Draw again after light and dark have changed."""

    def noise_words(self) -> str:
        """The noise, or that there is none."""
        noise = self.live.bench.noise
        return f"noise {noise / UM:.3f} µm" if noise is not None else "nothing was measured"

    # -- the top bar ---------------------------------------------------------------------------------------------------

    def _top(self) -> None:
        bench = self.live.bench
        with ui.element("div").classes("panel top"):
            ui.label(bench.campaign.name).classes("name").tooltip(f"{bench.campaign.folder}, {bench.machine.name}")
            with ui.element("div").classes("error-now"):
                ui.label("RMS").classes("soft")
                self.rms = ui.label("…").classes("value").mark("rms")
                self.engine = ui.label("").classes("chip").mark("engine")
                self.noise = ui.label(self.noise_words()).classes("soft").mark("noise")
            self.problem = ui.label().classes("problem").style("overflow: hidden; text-overflow: ellipsis")
            ui.element("div").classes("spring")
            with ui.element("div").classes("buttons"):
                self.undo = self._button("undo", "undo", self._undo, "Undo (Ctrl+Z)")
                self.redo = self._button("redo", "redo", self._redo, "Redo (Ctrl+Y)")
                self._button("auto_graph", "fit all", self.fit_all, "Fit all effects that were put in (A)", True)
                self._button("troubleshoot", "diagnose", self.diagnose, "Search for what the model lacks (D)", True)
                self.save_button = self._button("save", "save", self.save, "Write to the machine file (S)", True)
                self._button("description", "report", self._report, "Report of the present model")
                self.more_buttons()
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

    def draw_error(self) -> None:
        """Draw the error of the newest model, and what went wrong."""
        now, noise = self.live.overlay, self.live.bench.noise
        self.problem.text = self.live.error
        if now is None:
            return
        self.noise.text = self.noise_words()
        self.rms.text = "–" if now.rms is None else f"{now.rms / UM:.3f} µm"
        good = now.rms is not None and noise is not None and now.rms < self.good * noise
        self.rms.classes(**({"add": "good"} if good else {"remove": "good"}))
        self.engine.text = self.live.engine
        whole = self.live.engine == MULTIBODY and self.live.settled
        self.engine.classes(**({"add": "multibody"} if whole else {"remove": "multibody"}))
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

    async def _report(self) -> None:
        bench = self.live.bench
        page = await self.work("report", lambda progress: report_of(bench, progress))
        if page:
            ui.download.content(page, f"{bench.campaign.name}-report.html")

    def _toggle_dark(self) -> None:
        self.dark.value = not self.dark.value
        self.darken(bool(self.dark.value))
        self.redraw()

    def _show_keys(self) -> None:
        with ui.dialog() as dialog, ui.card():
            ui.markdown("\n".join(["| key | does |", "|---|---|", *(f"| {k} |" for k in self.keys)]))
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
            do = self._plain_keys().get(key)
        if do is not None:
            result = do()
            if result is not None:
                background_tasks.create(self._here(result), name=f"key {key}")

    async def _here(self, work: Awaitable[Any]) -> None:
        """Do work that a key asked for: its dialogs and messages belong to this page."""
        with self.place:
            await work

    def _plain_keys(self) -> dict[str, Callable[[], Any]]:
        return {
            "f": lambda: self.fit(self.effects.chosen),
            "a": self.fit_all,
            "d": self.diagnose,
            "s": self.save,
            "l": self._toggle_dark,
            **self.actions(),
        }


def report_of(bench: ChangedModel, progress: Progress) -> bytes:
    """The report of the present model, without a new diagnosis.

    Raises:
        InputError: The extra "report" is not installed, or nothing was measured.
    """
    from mjsim.report.write import report  # slow to load

    result = report(bench.campaign, bench.machine, diagnosed=False, threads=bench.threads, progress=progress)
    return result.html.encode()
