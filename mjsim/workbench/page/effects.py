"""The effects on the page: the catalogue as a tree by axis with bars, and the sliders of the chosen one."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from mjsim import digits
from mjsim.errors import InputError
from mjsim.machine.effect import Effect, Parameter
from mjsim.workbench import catalogue
from mjsim.workbench.live import Live, RecordingsLive

#: A row of the tree; Quasar fills in the node.
_ROW = """
<div class="row-of-effect" :class="{chosen: props.node.chosen, stale: props.node.stale}" :data-effect="props.node.id">
  <span class="label" :class="{group: props.node.children}">{{ props.node.label }}</span>
  <span v-if="props.node.share !== null" class="track" :title="props.node.words">
    <div class="fill" :style="{width: props.node.share + '%'}"></div></span>
  <span v-if="props.node.share !== null" class="percent">{{ props.node.share }} %</span>
</div>
"""


class EffectsPanel:
    """Draws the catalogue and the chosen effect.

    Args:
        live: The workbench.
        on_change: Called after the model was changed.
        on_fit: Called with the id of the effect that shall be fitted.
    """

    def __init__(
        self, live: Live | RecordingsLive, on_change: Callable[[], None], on_fit: Callable[[str], object]
    ) -> None:
        self.live, self.on_change, self.on_fit = live, on_change, on_fit
        self.chosen = ""
        self._groups = live.bench.catalogue
        self._entries = {e.id: e for rows in self._groups.values() for e in rows}
        self._shown: tuple = ()
        self._controls: dict[tuple[str, str], list] = {}
        self._expanded_best = False
        with ui.element("div").classes("panel stack effects").style("grid-row: 2"):
            with ui.element("div").classes("title"):
                ui.label("Effects")
                self.state = ui.label().classes("soft").mark("bars")
            search = ui.input(placeholder="filter", on_change=lambda e: self._filter(e.value))
            search.props('dense clearable borderless aria-label="Filter the effects"').classes("q-px-sm")
            with ui.element("div").classes("grow"):
                self.tree = ui.tree([], on_select=self._selected, on_expand=lambda _: None, on_tick=self._ticked)
                self.tree.props("dense no-transition no-selection-unset").mark("effects")
                self.tree.add_slot("default-header", _ROW)
            self.detail = ui.element("div").classes("detail").mark("detail")
        self.draw()
        if len(self._groups) == 1:
            self.tree.expand()

    # -- the tree ------------------------------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw bars, ticks and sliders again."""
        bench = self.live.bench
        self.tree.props["nodes"] = [self._group(axis, rows) for axis, rows in self._groups.items()]
        self.tree.props["ticked"] = list(dict.fromkeys(e.id for e in bench.machine.effects))
        self.tree.update()
        if bench.gains and not self._expanded_best:
            self._expanded_best = True
            best = max(bench.gains, key=lambda k: bench.gains[k].share)
            self.tree.expand([f"axis {self._entries[best].axis}"])
        if not bench.can_fit:
            self.state.text = "nothing was measured"
        elif self.live.signatures < 1.0:
            self.state.text = f"computing the bars, {100 * self.live.signatures:.0f} %"
        else:
            self.state.text = "bar: could explain"
        self._draw_detail()

    def _group(self, axis: str, rows: list[catalogue.Entry]) -> dict:
        leaves = sorted((self._leaf(e) for e in rows), key=lambda n: (-(n["share"] or 0), n["label"]))
        share = max((n["share"] for n in leaves if n["share"] is not None), default=None)
        label = f"{axis} axis" if axis else "other"
        words = "largest share that one effect of this axis could explain"
        fixed = {"chosen": False, "noTick": True, "selectable": False, "stale": self.live.bench.gains_are_old}
        return {"id": f"axis {axis}", "label": label, "children": leaves, "share": share, "words": words, **fixed}

    def _leaf(self, entry: catalogue.Entry) -> dict:
        gain = self.live.bench.gains.get(entry.id)
        bench = self.live.bench
        share = round(100 * gain.share) if gain and gain.significant else 0 if bench.gains_complete else None
        words = f"could explain {share} % of the squared residual above the noise, alone"
        return {"id": entry.id, "label": entry.name, "share": share, "chosen": entry.id == self.chosen, "words": words,
                "stale": bench.gains_are_old}  # fmt: skip

    def _filter(self, text: str | None) -> None:
        self.tree.filter = text or None
        if text:
            self.tree.expand()

    def _selected(self, event) -> None:
        if event.value in self._entries:
            self.choose(event.value)

    def choose(self, effect_id: str) -> None:
        """Show the sliders of an effect."""
        self.chosen = effect_id
        self.tree.expand([f"axis {self._entries[effect_id].axis}"])
        self.draw()

    def _ticked(self, event) -> None:
        wanted = {k for k in event.value if k in self._entries}
        have = {e.id for e in self.live.bench.machine.effects}
        for effect_id in sorted(wanted ^ have):
            self.switch(effect_id, effect_id in wanted)

    def switch(self, effect_id: str, on: bool) -> None:
        """Put an effect in or take it out."""
        try:
            self.live.bench.switch(effect_id, on)
        except InputError as error:
            ui.notify(str(error), type="negative")
        self.chosen = effect_id
        self.on_change()

    # -- the chosen effect ---------------------------------------------------------------------------------------------

    def _draw_detail(self) -> None:
        present = [e for e in self.live.bench.machine.effects if e.id == self.chosen]
        shown = (self.chosen, tuple((e.key, _shape(e)) for e in present))
        if shown != self._shown:
            self._shown = shown
            self.detail.clear()
            self._controls.clear()
            with self.detail:
                self._make_detail(present)
        for e in present:
            for p in e.parameters_of(e.subject):
                self._show_value(e, p)

    def _make_detail(self, present: list[Effect]) -> None:
        entry = self._entries.get(self.chosen)
        if entry is None:
            ui.label("Choose an effect. Its tick switches it on and off.").classes("soft")
            return
        with ui.element("div").style("display: flex; align-items: center; gap: 6px"):
            ui.label(entry.id).style("font-weight: 600; flex: 1").tooltip(entry.title)
            on = ui.switch(value=bool(present), on_change=lambda e: self.switch(entry.id, bool(e.value)))
            on.props('dense aria-label="In the model"').mark("in-model")
            fit = ui.button("fit this", on_click=lambda: self.on_fit(entry.id)).props("dense flat no-caps").mark("fit")
            fit.tooltip("Fit this effect together with set-up, instrument and data sheet (F)")
            fit.set_enabled(self.live.bench.can_fit)
        ui.label(entry.signature).classes("definition")
        for e in present:
            for p in e.parameters_of(e.subject):
                self._make_control(e, p)
        ui.label(entry.definition).classes("definition").style("margin-top: 4px")

    def _make_control(self, effect: Effect, p: Parameter) -> None:
        key = effect.key, p.name
        with ui.element("div").classes("parameter"):
            with ui.element("div").classes("words"):
                ui.label(f"{catalogue.spoken(p)}{f' in {p.unit}' if p.unit else ''}").tooltip(p.meaning)
                interval = ui.label().classes("soft")
            if p.kind in ("choice", "sensor"):
                sensors = {s: s for s in self.live.bench.machine.sensors}
                options = sensors if p.kind == "sensor" else {"": "both directions", **{c: c for c in p.choices}}
                choice = ui.select(options, on_change=lambda e: self._chose(effect.key, p, e.value))
                choice.props("dense").style("grid-column: 1 / -1")
                self._controls[key] = [choice]
            elif p.kind == "components":
                self._make_components(effect, p)
            else:
                value = effect.values[p.name]
                s = catalogue.slider(p, value)
                slider = ui.slider(min=s.low, max=s.high, step=s.step, value=value)
                slider.on_value_change(lambda e: self._moved(effect.key, p, e.value)).mark(f"slider {p.name}")
                slider.props(f'aria-label="{p.name}" data-parameter="{p.name}"').tooltip(catalogue.limits(p))
                number = ui.number(value=value, step=s.step, on_change=lambda e: self._moved(effect.key, p, e.value))
                number.props(f'dense aria-label="{p.name}" debounce=300').mark(f"number {p.name}")
                self._controls[key] = [slider, number, interval]

    def _make_components(self, effect: Effect, p: Parameter) -> None:
        """A row of three numbers per component: order, amplitude, phase."""
        columns = "grid-column: 1 / -1; display: grid; grid-template-columns: 1fr 1fr 1fr auto; gap: 6px"
        with ui.element("div").style(columns):
            for i, row in enumerate(effect.values[p.name]):
                for j, words in enumerate(("order", f"amplitude {p.unit or ''}".strip(), "phase °")):
                    box = ui.number(words, value=round(row[j], 6))
                    box.on_value_change(lambda e, i=i, j=j: self._component(effect.key, p, i, j, e.value))
                    box.props("dense debounce=300")
                drop = ui.button(icon="close", on_click=lambda _, i=i: self._drop(effect.key, p, i))
                drop.props("dense flat aria-label='Remove this component'")
        ui.button("add a component", on_click=lambda: self._drop(effect.key, p, None)).props("dense flat no-caps")

    def _show_value(self, effect: Effect, p: Parameter) -> None:
        controls = self._controls.get((effect.key, p.name))
        if not controls:
            return
        value = effect.values.get(p.name, "")
        if p.kind in ("choice", "sensor"):
            controls[0].value = value
            return
        slider, number, interval = controls
        s = catalogue.slider(p, value)
        slider.props["min"], slider.props["max"] = min(s.low, slider.props["min"]), max(s.high, slider.props["max"])
        slider.value = value
        number.value = float(f"{value:.6g}")
        ci = self.live.bench.intervals.get(effect.key, {}).get(p.name)
        interval.text = f"95 %: {digits.interval(ci)}" if ci else ""

    # -- changes -------------------------------------------------------------------------------------------------------

    def _moved(self, key: str, p: Parameter, value: float | None) -> None:
        effect = self.live.bench.effect(key)
        if value is None or effect is None or abs(value - effect.values[p.name]) <= 1e-5 * abs(value):
            return
        self._set(key, **{p.name: value})

    def _chose(self, key: str, p: Parameter, value: str) -> None:
        effect = self.live.bench.effect(key)
        if effect is None or value == effect.values.get(p.name, ""):
            return
        values = {k: v for k, v in effect.values.items() if k != p.name} | ({p.name: value} if value else {})
        changed = type(effect)(effect.subject, **values)
        self.live.bench.put(f"{changed.key}", self.live.bench.machine.without(effect.key).with_effect(changed))
        self.on_change()

    def _component(self, key: str, p: Parameter, i: int, j: int, value: float | None) -> None:
        effect = self.live.bench.effect(key)
        if value is None or effect is None:
            return
        rows = [list(row) for row in effect.values[p.name]]
        if round(rows[i][j], 6) != value:
            rows[i][j] = value
            self._set(key, **{p.name: rows})

    def _drop(self, key: str, p: Parameter, i: int | None) -> None:
        effect = self.live.bench.effect(key)
        if effect is not None:
            rows = [list(row) for k, row in enumerate(effect.values[p.name]) if k != i]
            self._set(key, **{p.name: rows if i is not None else [*rows, [1.0, p.scale, 0.0]]})

    def _set(self, key: str, **values) -> None:
        try:
            self.live.bench.set(key, **values)
        except InputError as error:
            ui.notify(str(error), type="negative")
            self._draw_detail()
            return
        self.on_change()


def _shape(effect: Effect) -> tuple:
    """What decides which controls an effect needs."""
    return tuple(len(v) if isinstance(v, list) else isinstance(v, str) for v in effect.values.values())
