"""The form of one dropped trace: which test it is, how it was run, and what its file does not say."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from mjsim.importing.into_campaign import test_name
from mjsim.importing.reading import Options
from mjsim.instruments.ball_bar.kinds import KINDS
from mjsim.workbench.start.draft import Draft, Dropped

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
