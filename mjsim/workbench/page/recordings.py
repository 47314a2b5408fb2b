"""Recordings on the page: error over time; of axis logs also over position, and torque over velocity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from nicegui import ui

from mjsim.commands.axis_log.compare import ComparedAxis
from mjsim.commands.comparison import ComparedChannel, Comparison
from mjsim.machine.effect import Effect
from mjsim.units import UM
from mjsim.workbench.lines import COLOURS, chart, pairs, thinned
from mjsim.workbench.live import RecordingsLive
from mjsim.workbench.page.base import BaseDesk, LadderPanel
from mjsim.workbench.page.effects import EffectsPanel
from mjsim.workbench.page.findings import LogFindingsPanel

#: Parts of a line, and points of a cloud.
_PARTS, _POINTS = 900, 1500
_REST, _FOLLOWING, _BOTH = "measured − simulated", "command − position", "measured and simulated"


class RecordingTraces:
    """Draws the recordings of a workbench.

    Args:
        live: The workbench.
    """

    def __init__(self, live: RecordingsLive) -> None:
        self.live, self.dark = live, False
        shown = [(t.test.name, c) for t in live.bench.shared.first.tests for c in t.channels]
        self._names = {f"{name}, {c.channel.name}": (name, c.channel.name) for name, c in shown}
        other = _FOLLOWING if isinstance(shown[0][1], ComparedAxis) else _BOTH
        self.name = next(iter(self._names))
        with ui.element("div").classes("panel stack").style("grid-row: 2"):
            with ui.element("div").classes("traces-head"):
                self.select = ui.select(list(self._names), value=self.name, on_change=lambda e: self.choose(e.value))
                self.select.props('dense borderless options-dense aria-label="Recording"').mark("recording")
                self.what = ui.select([_REST, other], value=_REST, on_change=lambda _: self.draw_shown())
                self.what.props('dense borderless options-dense aria-label="Error"').mark("what")
                self.about = ui.label().classes("soft").mark("about")
            self.over_time = ui.echart(self._empty()).classes("chart").style("flex: 1.2 1 0; min-height: 0")
            self.over_time.mark("over time")
            with ui.element("div").classes("log-below"):
                self.over_position = ui.echart(self._empty()).classes("chart").mark("over position")
                self.torque = ui.echart(self._empty()).classes("chart").mark("torque")
            self._buttons: dict[str, tuple[ui.element, ui.label]] = {}
            with ui.element("div").classes("small-ones").mark("all-logs"):
                for name in self._names:
                    button = ui.element("button").classes("small-one").props(f'aria-label="{name}" title="{name}"')
                    button.on("click", lambda _, name=name: self.choose(name))
                    with button:
                        words = ui.label("…").classes("what")
                        ui.label(name).classes("what soft")
                    self._buttons[name] = button, words

    def choose(self, name: str) -> None:
        """Show another recording of an axis."""
        if name != self.name:
            self.name = name
            self.select.value = name
            self.draw_shown()

    def beside(self, step: int) -> None:
        """Show the next recording (1) or the one before (-1)."""
        names = list(self._names)
        self.choose(names[(names.index(self.name) + step) % len(names)])

    def show(self, axis: str) -> None:
        """Show a recording of an axis."""
        mine = [n for n, (_, a) in self._names.items() if a == axis]
        if mine and self._names[self.name][1] != axis:
            self.choose(mine[0])

    def _channel(self, overlay: Comparison | None, name: str) -> ComparedChannel | None:
        test, channel = self._names[name]
        mine = (c for t in (overlay.tests if overlay else ()) if t.test.name == test for c in t.channels)
        return next((c for c in mine if c.channel.name == channel), None)

    def draw_shown(self) -> None:
        """Draw the charts again."""
        now = self.live.overlay
        shown, before = self._channel(now, self.name), self._channel(self.live.other, self.name)
        if shown is None:
            return
        unit, symbol = shown.channel.size, shown.channel.unit
        self.about.text = f"drives alone, RMS {shown.rms / unit:.4g} {symbol}, noise {shown.noise / unit:.3g} {symbol}"
        charts = [(self.over_time, self._of_time(shown, before))]
        if isinstance(shown, ComparedAxis):
            charts += [(self.over_position, self._of_position(shown)), (self.torque, self._of_torque(shown))]
        for drawn, options in charts:
            drawn.options.clear()
            drawn.options.update(options)
            drawn.update()
        for name, (button, words) in self._buttons.items():
            mine = self._channel(now, name)
            assert mine is not None
            words.text = f"{mine.rms / mine.channel.size:.3g} {mine.channel.unit}"
            button.classes(**({"add": "chosen"} if name == self.name else {"remove": "chosen"}))

    # -- charts --------------------------------------------------------------------------------------------------------

    def _empty(self, x: str = "", y: str = "") -> dict:
        ink = COLOURS[self.dark][0]
        open_ended = {"scale": True, "axisLine": {"lineStyle": {"color": ink}, "onZero": False}}
        ends = (open_ended | {"name": x, "nameGap": 24}, open_ended | {"name": y, "nameGap": 44})
        return chart(self.dark, (62, 14, 28, 40), *ends) | {
            "legend": {"top": 0, "textStyle": {"color": ink, "fontSize": 11}, "itemHeight": 8},
            "dataZoom": [{"type": "inside", "filterMode": "none"}],
        }

    def _of_time(self, axis: ComparedChannel, before: ComparedChannel | None) -> dict:
        _, _, now, _, grey, band, measured = COLOURS[self.dark]
        unit, symbol = axis.channel.size, axis.channel.unit
        out = self._empty("time, s", f"{self.what.value}, {symbol}")
        if self.what.value == _BOTH:
            rows = [("measured", axis.measured, measured), ("simulated", axis.simulated, now)]
        elif isinstance(axis, ComparedAxis) and self.what.value == _FOLLOWING:
            rows = [
                ("measured", axis.command - axis.measured, measured),
                ("simulated", axis.command - axis.simulated, now),
            ]
        else:
            rows = [("measured − simulated", axis.residual, now)]
            if before is not None and len(before.time) == len(axis.time):
                rows.insert(0, (self.live.other_name, before.residual, grey))
        for name, value, colour in rows:
            out["series"].append(_line(f"{name}, {symbol}", colour, *thinned(axis.time, value / unit, _PARTS)))
        if self.what.value == _REST:
            ends = [{"yAxis": -2 * axis.noise / unit}, {"yAxis": 2 * axis.noise / unit}]
            out["series"][-1]["markArea"] = {"silent": True, "itemStyle": {"color": band}, "data": [ends]}
        return out

    def _of_position(self, axis: ComparedAxis) -> dict:
        _, _, now, back, *_ = COLOURS[self.dark]
        unit, symbol, travel, place = axis.channel.size, axis.channel.unit, axis.travel.size, axis.travel.unit
        out = self._empty(f"position, {place}", f"rest, {symbol}")
        keep = _spread(len(axis.time))
        forth = axis.velocity[keep] >= 0.0
        for name, mask, colour in (("forth", forth, now), ("back", ~forth, back)):
            at = keep[mask]
            out["series"].append(_cloud(name, colour, axis.measured[at] / travel, axis.residual[at] / unit))
        return out

    def _of_torque(self, axis: ComparedAxis) -> dict:
        _, _, now, _, _, _, measured = COLOURS[self.dark]
        travel, place = axis.travel.size, axis.travel.unit
        out = self._empty(f"velocity, {place}/s", "motor torque, N·m")
        keep = _spread(len(axis.time))
        speed = axis.velocity[keep] / travel
        if axis.recorded_torque is not None:
            out["series"].append(_cloud("recorded", measured, speed, axis.recorded_torque[keep]))
        out["series"].append(_cloud("simulated", now, speed, axis.torque[keep]))
        return out


def _spread(n: int) -> np.ndarray:
    """Places of some of ``n`` samples, evenly."""
    return np.unique(np.linspace(0, n - 1, min(n, _POINTS)).astype(int))


def _line(name: str, colour: str, x: np.ndarray, y: np.ndarray) -> dict:
    look = {"type": "line", "showSymbol": False, "animation": False, "lineStyle": {"width": 1.1, "color": colour}}
    return {**look, "name": name, "itemStyle": {"color": colour}, "data": pairs(x, y)}


def _cloud(name: str, colour: str, x: np.ndarray, y: np.ndarray) -> dict:
    look = {"type": "scatter", "symbolSize": 2.5, "animation": False, "itemStyle": {"color": colour}}
    return {**look, "name": name, "data": pairs(x, y)}


# -- the page of a campaign of axis logs, or of another instrument but a ball bar --------------------------------------


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
