"""The start page of one browser tab: recent campaigns, an example, and the steps of a new campaign."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from html import escape
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from nicegui import run, ui
from nicegui.events import UploadEventArguments

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_templates import FACTOR, LAYOUTS, SIZES
from mjsim.campaign.new import BALL_BAR, turns_of
from mjsim.commands.plan import r_test_motions
from mjsim.errors import InputError, SimulationError
from mjsim.importing.into_campaign import test_name
from mjsim.importing.reading import Options
from mjsim.inference.planning.whole_campaign import CampaignPlan, CampaignPlanner, told_sentences
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.acceptance import CIRCULAR
from mjsim.instruments.ball_bar.kinds import KINDS, kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest, Trace
from mjsim.instruments.ball_bar.program import Program
from mjsim.instruments.r_test.measurement import SphereReading
from mjsim.machine.chain import SENSES
from mjsim.units import DEG, MM, UM
from mjsim.workbench.lines import thinned
from mjsim.workbench.start.draft import INSTRUMENTS, Draft, Dropped
from mjsim.workbench.start.recent import recent, remember

# -- A small picture of what a dropped file holds ----------------------------------------------------------------------

_WIDE, _HIGH = 240.0, 88.0
#: Where the middle of a line is; the words stand below.
_ZERO = 36.0
_PARTS = 220
#: Radius of the nominal circle of a polar picture, and of its rim.
_NOMINAL, _RIM = 26.0, 38.0


def preview_of_trace(test: BallBarTest, trace: Trace) -> str:
    """A trace of a ball bar as SVG: over the time, and for a whole circle also polar.

    Args:
        test: The test.
        trace: What was recorded.
    """
    value = np.where(trace.valid, trace.deviation, np.nan) / UM
    value = value - np.nanmean(value)
    largest = max(float(np.nanmax(np.abs(value))), 1e-6)
    parts = [_line(trace.time, value, largest), _label(f"± {largest:.3g} µm in {np.ptp(trace.time):.0f} s")]
    if kind_of(test).goes_round:
        parts.append(_polar(Program(test).phi(trace.time), value / largest))
    return _framed(f"{test.name}: deviation over the time", parts, _WIDE + (88 if len(parts) > 2 else 0))


def preview_of_series(name: str, time: np.ndarray, value: np.ndarray, unit: str) -> str:
    """A recorded quantity over the time as SVG.

    Args:
        name: Of what it shows.
        time: (n,) s.
        value: (n,) in ``unit``.
        unit: As the label has it.
    """
    value = value - np.nanmean(value)
    largest = max(float(np.nanmax(np.abs(value))), 1e-9)
    words = _label(f"{name}: ± {largest:.3g} {unit} in {np.ptp(time):.3g} s")
    return _framed(f"{name} over the time", [_line(time, value, largest), words], _WIDE)


def _line(time: np.ndarray, value: np.ndarray, largest: float) -> str:
    place, thin = thinned(time, value, _PARTS)
    x = (place - time[0]) / max(float(np.ptp(time)), 1e-9) * _WIDE
    y = _ZERO - thin / largest * 0.38 * _HIGH
    middle = f'<line class="grid" x1="0" y1="{_ZERO}" x2="{_WIDE}" y2="{_ZERO}"/>'
    return middle + f'<path class="measured" d="{_joined(x, y)}"/>'


def _polar(phi: np.ndarray, share: np.ndarray) -> str:
    angle, thin = thinned(phi, share, _PARTS)
    radius = _NOMINAL + thin * (_RIM - _NOMINAL)
    x, y = _WIDE + 44 + radius * np.cos(angle), 0.5 * _HIGH - radius * np.sin(angle)
    circle = f'<circle class="grid" cx="{_WIDE + 44}" cy="{0.5 * _HIGH}" r="{_NOMINAL}"/>'
    return circle + f'<path class="measured" d="{_joined(x, y)}"/>'


def _joined(x: np.ndarray, y: np.ndarray) -> str:
    there = np.isfinite(x) & np.isfinite(y)
    return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x[there], y[there], strict=True)) if there.any() else ""


def _label(words: str) -> str:
    return f'<text x="2" y="{_HIGH - 3}">{escape(words)}</text>'


def _framed(title: str, parts: list[str], wide: float) -> str:
    box = f'viewBox="0 0 {wide:g} {_HIGH:g}" style="width: {wide:g}px; height: {_HIGH:g}px"'
    return f'<svg class="preview" {box} role="img" aria-label="{escape(title)}">{"".join(parts)}</svg>'


# -- the form of one dropped trace -------------------------------------------------------------------------------------

_NEW = "a new test"
_UNITS = ("as the file says", "um", "mm", "inch")


class TraceForm:
    """Builds the form in the present element.

    Args:
        draft: The campaign in the making.
        file: Name of the dropped file.
        dropped: What is known of it.
        bring: Called with what brings the trace in, once the form is filled in.
    """

    def __init__(
        self, draft: Draft, file: str, dropped: Dropped, bring: Callable[[Callable[[], Any]], Awaitable[None]]
    ) -> None:
        self.draft, self.file, self.dropped, self.bring = draft, file, dropped, bring
        machine = draft.machine
        assert machine is not None  # a trace is taken only then
        self.chain = machine.chain
        kinds = [k.name for k in KINDS.values() if not k.cannot(self.chain)]
        last = draft.tests[-1] if draft.tests else {}
        ball = dropped.keys.get("table_ball_mm") or last.get("table_ball_mm") or [0.0, 0.0, 155.0]
        kind = dropped.keys.get("kind")
        waiting = [t["name"] for t in draft.tests if "trace" not in t]
        with ui.element("div").classes("row"):
            self.test = ui.select([_NEW, *waiting], value=_NEW, label="Which test is it?", on_change=self._draw)
            self.test.classes("short").style("width: 230px")
            self.kind = ui.select(kinds, value=kind if kind in kinds else kinds[0], label="Kind", on_change=self._draw)
            self.kind.classes("short")
            self.own = ui.element("div").classes("row")
        self.common = ui.element("div").classes("row")
        with self.common:
            self.ball = [
                ui.number(f"Table ball {letter}, mm", value=float(v)).classes("short").style("width: 130px")
                for letter, v in zip(self.chain.linear, ball, strict=False)
            ]
            self.length = self._number("Bar, mm", "bar_length_mm", last, 100.0)
            self.feed = self._number("Feed, mm/min", "feed_mm_min", last, 1000.0)
            self.setup = ui.input("Set-up (a word)", value=str(last.get("setup", "first"))).classes("short")
        with ui.element("div").classes("row"):
            self.unit = ui.select(list(_UNITS), value=_UNITS[0], label="Unit of the deviation").style("width: 190px")
            self.sign = ui.select(["outward", "inward"], value="outward", label="Positive is").classes("short")
            button = ui.button("use it", on_click=lambda: self.bring(self._bring)).props("no-caps dense")
            button.props(f'aria-label="use {file}"')
        self.values: dict[str, Any] = {}
        self._draw()

    def _number(self, words: str, key: str, last: dict, usual: float) -> ui.number:
        value = self.dropped.keys.get(key, last.get(key, usual))
        return ui.number(words, value=float(value)).classes("short").style("width: 130px")

    def _draw(self) -> None:
        """The fields of the kind that is chosen; none for a test that is there already."""
        new = self.test.value == _NEW
        self.kind.visible = self.own.visible = self.common.visible = new
        self.own.clear()
        self.values = {}
        with self.own:
            for key in (k for k in KINDS[self.kind.value].keys if k.needed):
                words, given = key.words_of(self.chain), self.dropped.keys.get(key.name)
                label = key.name.removesuffix("_deg").replace("_", " ") + (", °" if key.name.endswith("_deg") else "")
                if words:
                    field: Any = ui.select(list(words), value=given if given in words else words[0], label=label)
                else:
                    field = ui.number(label, value=given)
                self.values[key.name] = field.classes("short").tooltip(key.help)

    def _bring(self) -> Any:
        """Bring the trace in as the form says."""
        unit = None if self.unit.value == _UNITS[0] else self.unit.value
        options = Options(deviation_unit=unit, inward=self.sign.value == "inward")
        if self.test.value != _NEW:
            return self.draft.bring_in(self.file, self.test.value, None, options)
        keys: dict[str, Any] = {"kind": self.kind.value}
        keys |= {name: field.value for name, field in self.values.items() if field.value not in (None, "")}
        keys |= {k: v for k, v in self.dropped.keys.items() if k == "revolutions"}
        keys["table_ball_mm"] = [float(f.value or 0.0) for f in self.ball]
        keys |= {"bar_length_mm": self.length.value, "feed_mm_min": self.feed.value}
        if self.setup.value:
            keys["setup"] = self.setup.value
        keys = {k: v for k, v in keys.items() if v is not None}
        return self.draft.bring_in(self.file, test_name(self.dropped.path), keys, options)


#: Units of a position gain, and each in 1/s.
GAINS = {"1/s": 1.0, "m/min/mm": 1000.0 / 60.0, "0.01/s (Fanuc)": 0.01, "1000/min (Siemens)": 1000.0 / 60.0}
#: Plans that are offered: machine time, min.
PLANS: dict[str, float | None] = {"10 minutes": 10.0, "30 minutes": 30.0, "full": None}
_EXAMPLES = {
    "hidden-backlash": "a ball-bar campaign with a hidden cause",
    "two-candidates": "two causes that look alike",
    "used-machine": "a used machine, on which everything is a little wrong",
}
_DIALECTS = ("fanuc", "siemens", "linuxcnc")


class Opener(Protocol):
    """The server, as far as the page needs it.

    Attributes:
        token: Path of the start page and its pictures.
        threads: Simulations side by side.
    """

    token: str
    threads: int

    def workbench(self, folder: Path, kept: bool = True) -> str:
        """Open a campaign; the address of its page."""
        ...

    def example(self, name: str) -> Path:
        """A copy of an example that may be changed."""
        ...


class StartPage:
    """Builds the page in the present element.

    Args:
        server: That opens campaigns.
        dark: Light on dark to begin with.
        draft: Of the tab before it was loaded again; ``None`` for a new one.
    """

    def __init__(self, server: Opener, dark: bool, draft: Draft | None = None) -> None:
        self.server, self.draft = server, draft or Draft()
        self.layout, self.size = LAYOUTS[0].name, SIZES[1].name
        self._plan: CampaignPlan | None = None
        self._planner: tuple[str, CampaignPlanner] | None = None
        self._one = asyncio.Lock()  # dropped files come side by side
        self._waiting = 0
        self.dark = ui.dark_mode(value=dark)
        with ui.element("div").classes("start"):
            with ui.element("div").classes("start-top"):
                ui.label("mjsim").classes("name")
                ui.label("finds out what is wrong with a machine tool").classes("soft")
                ui.element("div").classes("spring")
                button = ui.button(icon="dark_mode", on_click=self._toggle_dark)
                button.props('flat dense aria-label="light or dark"')
            self.body = ui.element("div").classes("start-body")
        with self.body:
            if self.draft.machine is None:
                self._home()
            else:
                self._steps()

    def _toggle_dark(self) -> None:
        self.dark.value = not self.dark.value

    # -- home ----------------------------------------------------------------------------------------------------------

    def _home(self) -> None:
        with ui.element("div").classes("panel step"):
            ui.html("<h2>New campaign</h2>", sanitize=False)
            ui.label("For your machine: choose it, drop what you have measured, or get the tests to measure.")
            ui.button("new campaign", icon="add", on_click=self._begin).props("no-caps").mark("new")
        with ui.element("div").classes("two"):
            with ui.element("div").classes("panel step"):
                ui.html("<h2>Recent campaigns</h2>", sanitize=False)
                self._recent()
            with ui.element("div").classes("panel step"):
                ui.html("<h2>Examples</h2>", sanitize=False)
                ui.label("Opened as copies, which are gone when mjsim ends.").classes("soft")
                said = ui.label().classes("problem")
                for name, words in _EXAMPLES.items():
                    with ui.element("button").classes("link").on(
                        "click", lambda _, name=name: self._open(lambda: self.server.example(name), said, kept=False)
                    ):  # fmt: skip
                        ui.label(f"{name}: {words}")

    def _recent(self) -> None:
        folders = recent()
        if not folders:
            ui.label("None yet. Campaigns that you open are listed here.").classes("soft")
        said = ui.label().classes("problem")
        for folder in folders:
            with ui.element("div").classes("row"):
                with ui.element("button").classes("link").on(
                    "click", lambda _, folder=folder: self._open(lambda: folder, said)
                ):  # fmt: skip
                    ui.label(f"{folder.name}  ({folder.parent})")
                try:
                    planned = len(read_campaign(folder, traces=False).tests) - len(_traces_of(folder))
                except InputError:
                    continue
                if planned:
                    ui.button(
                        f"drop {planned} missing traces", on_click=lambda _, f=folder: self._add_traces(f, said)
                    ).props("flat dense no-caps")

    def _begin(self) -> None:
        self.body.clear()
        with self.body:
            self._steps()

    def _add_traces(self, folder: Path, said: ui.label) -> None:
        try:
            draft = Draft(folder)
        except InputError as error:
            said.text = str(error)
            return
        self.draft.close()
        self.draft = draft
        self._begin()

    async def _open(self, where: Callable[[], Path], said: ui.label, kept: bool = True) -> None:
        """Go on to the workbench of a campaign."""
        address = await self._try(said, lambda: self.server.workbench(where(), kept))
        if address:
            ui.navigate.to(address)

    async def _try(self, said: ui.label, do: Callable[[], Any]) -> Any:
        """Do something on this thread; what is wrong becomes a sentence on the page.

        Args:
            said: Where.
            do: What.

        Returns:
            What ``do`` returns; ``None`` where it failed.
        """
        said.text = ""
        try:
            return do()
        except (InputError, SimulationError) as error:
            said.text = self.draft.plain(error)
        return None

    async def _work(self, said: ui.label, do: Callable[[], Any]) -> Any:
        """Do something that takes a while beside the page; its errors become a sentence on it."""
        said.text = ""
        try:
            return await run.io_bound(do)
        except (InputError, SimulationError) as error:
            said.text = self.draft.plain(error)
        return None

    # -- the steps -----------------------------------------------------------------------------------------------------

    def _steps(self) -> None:
        if self.draft.existing:
            ui.label(f"Traces of {self.draft.folder}: each goes into the campaign when it is dropped.")
        else:
            self._machine_step()
            self._instrument_step()
        with ui.element("div").classes("panel step"):
            self._tests = ui.element("div")
        if not self.draft.existing:
            self._limits_step()
        self._end_step()
        self._draw_tests()

    def _machine_step(self) -> None:
        with ui.element("div").classes("panel step"):
            ui.html("<h2>1. The machine</h2>", sanitize=False)
            ui.label(
                "Choose what looks like it. Its numbers are typical ones, and the diagnosis fits them within a factor "
                f"of {FACTOR:g}. If you have a machine file (machine.toml), drop it below instead."
            )
            self._cards: dict[str, ui.element] = {}
            with ui.element("div").classes("layouts"):
                for layout in LAYOUTS:
                    card = ui.element("button").classes("layout").props(f'aria-label="{layout.name}"')
                    card.on("click", lambda _, name=layout.name: self._choose(layout=name))
                    with card:
                        ui.html(f'<img src="/{self.server.token}/pictures/{layout.name}" alt="" loading="lazy">',
                                sanitize=False)  # fmt: skip
                        ui.label(layout.words).classes("what")
                        ui.label(layout.configuration).classes("axes")
                    self._cards[layout.name] = card
            with ui.element("div").classes("row"):
                sizes = {s.name: f"{s.name}: {s.words}" for s in SIZES}
                self._size = ui.select(
                    sizes, value=self.size, label="Size", on_change=lambda e: self._choose(size=e.value)
                )
                self._size.classes("wide").mark("size")
                self._gain = ui.number("Position gain, as set in the control", value=None, placeholder="as usual")
                self._gain.classes("wide").style("width: 260px").mark("gain").on("change", lambda _: self._choose())
                self._gain_unit = ui.select(list(GAINS), value="1/s", label="Unit", on_change=lambda _: self._choose())
                self._gain_unit.classes("short")
            self._machine_said = ui.label().classes("problem").mark("machine problem")
            self._machine_words = ui.label().classes("said").mark("machine")
            self._drives = ui.element("div")
        self._show_machine()

    async def _choose(self, layout: str | None = None, size: str | None = None) -> None:
        """Take a template with the layout, the size and the gain that are chosen now."""
        self.layout, self.size = layout or self.layout, size or self.size
        if layout is None and self.draft.template is None:
            return  # size and gain alone choose no machine
        value = self._gain.value
        gain = None if value in (None, "") else float(value) * GAINS[self._gain_unit.value]
        done = await self._try(
            self._machine_said, lambda: self.draft.choose_template(f"{self.layout}-{self.size}", gain)
        )
        if done is not None:
            self._planner = self._plan = None
            self._show_machine()
            self._draw_tests()

    def _show_machine(self) -> None:
        """The chosen machine: its card, and the numbers that stand on drawings and in the control."""
        machine, template = self.draft.machine, self.draft.template
        chosen = template.layout.name if template is not None else ""
        for name, card in self._cards.items():
            card.classes(**({"add": "chosen"} if name == chosen else {"remove": "chosen"}))
        self._drives.clear()
        if machine is None:
            self._machine_words.text = "No machine is chosen yet."
            return
        believed = f"believed within a factor of {machine.factor:g}" if machine.factor else "believed as a data sheet"
        self._machine_words.text = f"{machine.name}, {machine.configuration}; numbers of the drives {believed}."
        fields: dict[tuple[str, str], ui.number] = {}
        with self._drives:
            ui.label("If you know them (drawing, parameters of the control):").style("margin-top: 6px")
            with ui.element("div").classes("numbers"):
                for axis, drive in machine.drives.items():
                    rotary = machine.chain.is_rotary(axis)
                    key = "worm_teeth" if rotary else "lead_mm"
                    value = drive.gear if rotary else 2 * np.pi / drive.gear / MM
                    words = f"{axis}: turns of the motor per turn" if rotary else f"{axis}: lead, mm"
                    fields[axis, key] = ui.number(words, value=float(f"{value:.6g}")).props("dense")
            with ui.expansion("all numbers of the drives").props("dense"), ui.element("div").classes("numbers"):
                for axis, drive in machine.drives.items():
                    for key, value, words in (
                        ("position_gain_per_s", drive.position_gain, "position gain, 1/s"),
                        ("velocity_gain_Nms_per_rad", drive.velocity_gain, "Kvp, N·m·s/rad"),
                        ("integral_time_s", drive.integral_time, "Ti, s"),
                        ("inertia_kgm2", drive.inertia, "inertia, kg·m²"),
                        ("viscous_Nms_per_rad", drive.viscous, "viscous, N·m·s/rad"),
                        ("gravity_Nm", drive.gravity, "gravity, N·m"),
                    ):
                        fields[axis, key] = ui.number(f"{axis}: {words}", value=float(f"{value:.6g}")).props("dense")
            for number in fields.values():
                number.on("change", lambda _: self._set_drives(fields))
            if machine.chain.rotary:
                ui.label("Turn each axis by +10° by hand and look, or see the control's parameters:")
                with ui.element("div").classes("row"):
                    for axis in machine.chain.rotary:
                        words = dict(zip(SENSES, turns_of(machine.chain, axis), strict=True))
                        ui.select(
                            words,
                            value=machine.chain.sense(axis),
                            label=f"Sense of {axis}",
                            on_change=lambda e, axis=axis: self._set_sense(axis, e.value),
                        ).classes("wide")

    async def _set_sense(self, axis: str, sense: str) -> None:
        await self._try(self._machine_said, lambda: self.draft.set_sense(axis, sense))
        self._planner = self._plan = None
        self._draw_tests()

    async def _set_drives(self, fields: dict[tuple[str, str], ui.number]) -> None:
        numbers = {at: float(f.value) for at, f in fields.items() if f.value not in (None, "")}
        await self._try(self._machine_said, lambda: self.draft.set_drives(numbers))
        self._planner = None

    def _instrument_step(self) -> None:
        with ui.element("div").classes("panel step"):
            ui.html("<h2>2. What measures</h2>", sanitize=False)
            with ui.element("div").classes("row"):
                choice = ui.radio(INSTRUMENTS, value=self.draft.instrument).props("inline").mark("instrument")
                self._bar = ui.element("div").classes("row")
                with self._bar:
                    words = {
                        "resolution_um": "Resolution, µm",
                        "range_mm": "Range, ± mm",
                        "sample_rate_Hz": "Samples per s",
                    }
                    fields = {
                        k: ui.number(w, value=BALL_BAR[k]).classes("short").props("dense") for k, w in words.items()
                    }
            said = ui.label().classes("problem")

            async def changed() -> None:
                bar = choice.value == BallBarTest.instrument
                numbers = {k: float(f.value) for k, f in fields.items() if f.value} if bar else None
                await self._try(said, lambda: self.draft.choose_instrument(choice.value, numbers))
                if said.text:
                    choice.value = self.draft.instrument
                self._bar.visible = choice.value == BallBarTest.instrument
                self._limits.visible = choice.value != LogTest.instrument
                self._planner = self._plan = None
                self._draw_tests()

            choice.on_value_change(changed)
            for field in fields.values():
                field.on("change", changed)
            self._bar.visible = self.draft.instrument == BallBarTest.instrument

    # -- tests and files -----------------------------------------------------------------------------------------------

    def _draw_tests(self) -> None:
        """The third step again."""
        self._tests.clear()
        moving = self.draft.in_motion
        with self._tests:
            what = "tests and traces" if moving else "recordings"
            ui.html(f"<h2>{'' if self.draft.existing else '3. '}The {what}</h2>", sanitize=False)
            with ui.element("div").classes("two" if moving and not self.draft.existing else ""):
                if moving and not self.draft.existing:
                    with ui.element("div"):
                        self._plan_part()
                with ui.element("div"):
                    self._drop_part()
            self._files = ui.element("div")
        self._draw_files()

    def _plan_part(self) -> None:
        ui.label("Nothing measured yet? Get tests for the time that you have:")
        said = ui.label().classes("problem")
        with ui.element("div").classes("row"):
            for words, minutes in PLANS.items():
                button = ui.button(words, on_click=lambda _, m=minutes: self._make_plan(m, said)).props(
                    "outline no-caps dense"
                )
                button.set_enabled(self.draft.machine is not None)
                button.mark(f"plan {words}")
        self._planning = ui.label().classes("said")
        self._planned = ui.element("div")
        if self._plan is not None:
            self._show_plan()

    async def _make_plan(self, minutes: float | None, said: ui.label) -> None:
        """Plan the campaign; possible tests are looked at once for each machine."""
        machine = self.draft.machine
        if machine is None:
            said.text = "No machine is chosen yet; choose one first."
            return
        progress = {"words": "looking at possible tests …"}

        def tell(stage: str, done: int, total: int) -> None:
            progress["words"] = f"{stage}: {done} of {total}"

        def make() -> CampaignPlan:
            if self._planner is None or self._planner[0] != repr(machine):
                spheres = self.draft.instrument == SphereReading.instrument
                tests = r_test_motions(machine) if spheres else None
                self._planner = repr(machine), CampaignPlanner(machine, self.server.threads, tell, tests=tests)
            progress["words"] = "choosing tests …"
            return self._planner[1].plan(minutes)

        timer = ui.timer(0.3, lambda: self._planning.set_text(progress["words"]))
        plan = await self._work(said, make)
        timer.cancel()
        self._planning.text = ""
        if plan is not None:
            self._plan = plan
            self._show_plan()

    def _show_plan(self) -> None:
        assert self._plan is not None
        data = self._plan.to_json()
        rows = "".join(
            f"<tr><td>{escape(t['name'])}</td><td>{escape(t['setup'])}</td><td>{t['started_s'] / 60:.0f} min</td></tr>"
            for t in data["tests"]
        )
        self._planned.clear()
        with self._planned:
            ui.label(f"{len(data['tests'])} tests, {data['minutes']:.0f} minutes with handling:").mark("plan")
            ui.html(f'<table class="plan-table"><tr><th>test</th><th>set-up</th><th>begins</th></tr>{rows}</table>',
                    sanitize=False)  # fmt: skip
            for sentence in told_sentences(data):
                ui.label(sentence).classes("said")
            ui.button("take over these tests", on_click=self._take_plan).props("no-caps dense").mark("take plan")

    async def _take_plan(self) -> None:
        assert self._plan is not None
        tests = self._plan.to_json()["tests"]
        await self._try(self._dropped_said, lambda: self.draft.add_tests(tests))
        self._draw_files()

    def _drop_part(self) -> None:
        words = "traces (CSV, TXT, .b5r), NC programs named as their tests, a campaign.toml or machine.toml"
        if self.draft.instrument == SphereReading.instrument:
            words = "recordings named as their tests (CSV, TXT), a campaign.toml or machine.toml"
        if self.draft.instrument == LogTest.instrument:
            words = "recordings (CSV, TXT, spreadsheets, exports of scopes and controls) or a machine.toml"
        ui.label(f"Drop {words} here:")
        upload = ui.upload(multiple=True, auto_upload=True, on_upload=self._dropped, label="drop files, or press +")
        upload.mark("drop")
        self._dropped_said = ui.label().classes("problem").mark("drop problem")
        self._dropped_words = ui.label().classes("said").mark("dropped")
        with ui.element("div").classes("row"):
            dialect = ui.select(list(_DIALECTS), value=_DIALECTS[0], label="Control").classes("short").props("dense")
            button = ui.button("NC programs", icon="download", on_click=lambda: self._download(dialect.value))
            button.props("flat no-caps dense").mark("programs")
        dialect.visible = button.visible = self.draft.in_motion
        self._checked = ui.element("div").mark("check")

    async def _download(self, dialect: str) -> None:
        data = await self._try(self._dropped_said, lambda: self.draft.programs(dialect))
        if data:
            ui.download(data, "programs.zip")

    async def _dropped(self, event: UploadEventArguments) -> None:
        """Files come one after the other, in the order of their names or not."""
        data = await event.file.read()
        self._waiting += 1
        async with self._one:
            said = await self._work(self._dropped_said, lambda: self.draft.drop(event.file.name, data))
            self._waiting -= 1
            if said:
                self._dropped_words.text = said
            if Path(event.file.name).suffix.lower() == ".toml" and not self.draft.existing:
                self._planner = self._plan = None
                self._show_machine()
            if not self._waiting:
                self._draw_files()
        if not self._waiting:
            await self._check()

    async def _check(self) -> None:
        """What ``mjsim check`` thinks of what is there, once all files are there."""
        self._checked.clear()
        if not any(f.test for f in self.draft.files.values()):
            return
        with self._checked:
            said = ui.label("checking units, signs and directions …").classes("said")
        found = await self._work(self._dropped_said, lambda: self.draft.mistakes(self.server.threads))
        said.text = "" if found is None else "check: no mistake found" if not found else "check:"
        with self._checked:
            for sentence in found or ():
                ui.label(sentence).classes("problem")

    def _draw_files(self) -> None:
        """All files that were dropped, and the tests that have none yet."""
        self._files.clear()
        measured = {f.test for f in self.draft.files.values()}
        tests = [t for t in self.draft.tests if t["name"] not in measured and "trace" not in t]
        with self._files:
            for name, dropped in self.draft.files.items():
                self._file(name, dropped)
            if tests:
                ui.label("Tests without a trace:").style("margin-top: 8px")
                with ui.element("div").classes("row").mark("planned"):
                    for t in tests:
                        button = ui.button(t["name"], icon="close", on_click=lambda _, n=t["name"]: self._take_out(n))
                        button.props('flat dense no-caps').tooltip("Take this test out")  # fmt: skip

    async def _take_out(self, name: str) -> None:
        await self._try(self._dropped_said, lambda: self.draft.remove_test(name))
        self._draw_files()

    def _file(self, name: str, dropped: Dropped) -> None:
        """One file: what is in it, what it shows, and what is still to be said about it."""
        with ui.element("div").classes("file").props(f'data-file="{escape(name, quote=True)}"'):
            with ui.element("div"):
                ui.label(f"{name}: {dropped.test}" if dropped.test else name).classes("head")
                ui.label(dropped.columns).classes("note")
                for note in dropped.notes:
                    ui.label(note).classes("note")
                for question in dropped.questions:
                    ui.label(question).classes("ask")
                if dropped.problem:
                    ui.label(dropped.problem).classes("problem")
            if dropped.test:
                ui.html(self._preview(dropped), sanitize=False)
            elif self.draft.instrument == BallBarTest.instrument:
                with ui.element("div").classes("form"):
                    TraceForm(self.draft, name, dropped, self._brought_in)
            else:
                with ui.element("div").classes("form"):
                    self._log_form(name)

    async def _brought_in(self, bring: Callable[[], Any]) -> None:
        """A form was filled in."""
        await self._work(self._dropped_said, bring)
        self._dropped_words.text = ""
        self._draw_files()
        await self._check()

    def _log_form(self, name: str) -> None:
        """Which column is what, where the header does not say."""
        letters = self.draft.machine.chain.letters if self.draft.machine is not None else ()
        with ui.element("div").classes("row"):
            axis = ui.select(list(letters), value=letters[0] if letters else None, label="Axis").classes("short")
            command = ui.input("Column of the command").classes("short")
            actual = ui.input("Column of the position").classes("short")
            unit = ui.select(["mm", "um", "deg"], value="mm", label="Unit").classes("short")
            clock = ui.input("Column of the time").classes("short")
            rate = ui.number("or samples per s").classes("short")

            def bring() -> Any:
                pairs = (("command", command.value), ("actual", actual.value))
                signals = tuple(f"{axis.value}_{s}={c}:{unit.value}" for s, c in pairs if c)
                options = Options(time=clock.value or None, rate=float(rate.value) if rate.value else None)
                return self.draft.bring_in_log(name, signals, options)

            ui.button("use it", on_click=lambda: self._brought_in(bring)).props("no-caps dense")

    def _preview(self, dropped: Dropped) -> str:
        """A picture of a recording."""
        campaign = read_campaign(self.draft.folder, spans=False)
        mine = [t for t in campaign.measured if dropped.test in (t.name, getattr(t, "recording", t.name))]
        if not mine:
            return ""
        # of an R-test the coordinate that shows most
        test = max(mine, key=lambda t: float(np.ptp(campaign.traces[t.name].deviation)) if len(mine) > 1 else 0.0)
        trace = campaign.traces[test.name]
        if isinstance(test, BallBarTest):
            return preview_of_trace(test, trace)
        axis, record = next(iter(trace.axes.items()))
        rotary = test.chain.is_rotary(axis)
        error = record.actual - record.command
        size, unit = (DEG, "°") if rotary else (MM, "mm") if np.ptp(error) > MM else (UM, "µm")
        return preview_of_series(f"{axis}: position less command", trace.time, error / size, unit)

    # -- limits, and the end -------------------------------------------------------------------------------------------

    def _limits_step(self) -> None:
        self._limits = ui.element("div").classes("panel step")
        self._limits.visible = self.draft.instrument != LogTest.instrument
        with (
            self._limits,
            ui.expansion("4. Limits, if the machine is to be accepted").props("dense").style("font-size: 14px"),
        ):
            ui.label("ISO 230-4 figures of circular tests are held against them, with the uncertainty of the bar.")
            with ui.element("div").classes("row"):
                bar = ui.number("Uncertainty of the bar (k = 2), µm", value=0.7).classes("short").style("width: 230px")
                test = ui.input("Test").classes("short")
                figure = ui.select(list(CIRCULAR), value=CIRCULAR[0], label="Figure").classes("short")
                limit = ui.number("Limit, µm", value=None).classes("short")
                source = ui.input("Standard, number, table").classes("short").style("width: 230px")
                add = ui.button("add limit").props("no-caps dense outline")
            said = ui.label().classes("problem")
            words = ui.label().classes("said")
            limits: list[tuple[str, str, float, str]] = []

            async def put() -> None:
                row = (test.value or "", figure.value, float(limit.value or 0.0), source.value or "")
                await self._try(said, lambda: self.draft.set_limits(float(bar.value or 0.0), [*limits, row]))
                if not said.text:
                    limits.append(row)
                words.text = "; ".join(f"{t} {f} ≤ {um:g} µm ({s})" for t, f, um, s in limits)

            add.on_click(put)

    def _end_step(self) -> None:
        with ui.element("div").classes("panel step"):
            if not self.draft.existing:
                ui.html("<h2>5. Where it goes</h2>", sanitize=False)
            said = ui.label().classes("problem").mark("write problem")
            with ui.element("div").classes("row"):
                if self.draft.existing:
                    button = ui.button(
                        "open the workbench", on_click=lambda: self._open(lambda: self.draft.folder, said)
                    )
                    button.props("no-caps")
                    return
                folder = ui.input("New folder", value=str(Path.cwd() / "my-campaign")).classes("wide").mark("folder")
                button = ui.button("write and open", on_click=lambda: self._write(folder.value or "", said, True))
                button.props("no-caps").mark("write and open")
                later = ui.button("write, measure later", on_click=lambda: self._write(folder.value or "", said, False))
                later.props("flat no-caps").mark("write")
            ui.label(
                "campaign.toml, machine.toml and traces, as mjsim new writes them. Nothing is written before."
            ).classes("said")

    async def _write(self, target: str, said: ui.label, then_open: bool) -> None:
        folder = await self._try(said, lambda: self.draft.write(target))
        if folder is None:
            return
        self.draft.close()
        if then_open:
            self.draft = Draft()  # who comes back begins another one
            await self._open(lambda: folder, said)
            return
        remember(folder)
        self.draft = Draft(folder)
        self._begin()


def _traces_of(folder: Path) -> list[str]:
    """Tests of a campaign that have a trace."""
    return [t.name for t in read_campaign(folder, traces=False).tests if t.trace is not None]
