"""The predicted error of a part on the page: a dialog with the path in 3D, its error as colour, and the blocks."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
from nicegui import ui

from mjsim.digits import estimate, interval
from mjsim.machine.chain import COORDINATES
from mjsim.nc.dialects import READABLE
from mjsim.plots import style
from mjsim.prediction.part_run import PartRun, Reading
from mjsim.prediction.parts import PARTS
from mjsim.prediction.result import FAILS, PASSES, Prediction
from mjsim.units import MM, UM
from mjsim.workbench.lines import COLOURS, chart, pairs, thinned
from mjsim.workbench.live import Live

_FILE = "NC file"
#: Points of the path, and of a line in the chart.
_POINTS, _PARTS = 1500, 700
#: The path is drawn so large, whatever its size.
_SIZE = 2.0
_ROWS = 6
_LINE, _BEFORE, _BAND = "#d9480f", "#8a8a8a", "rgba(0,114,178,0.25)"


class PartDialog:
    """Asks for a program and shows what the present model makes of it.

    Args:
        live: The workbench of this tab.
        work: Does something that takes a while, by name; the result, or ``None``.
    """

    def __init__(self, live: Live, work: Callable[[str, Callable[..., Any]], Awaitable[Any]]) -> None:
        self.live, self.work = live, work
        self._before: dict[str, Prediction] = {}
        self._dark = False

    def open(self, dark: bool) -> None:
        """Show the dialog."""
        self._dark = dark
        with ui.dialog() as dialog, ui.card().classes("part-dialog"):
            self._ask()
            self.says = ui.label("The tool's tip against the programmed path, normal to it. Cutting forces are not "
                                 "included.").classes("soft").mark("part says")  # fmt: skip
            with ui.element("div").classes("part-shown"):
                self.left = ui.element("div").classes("part-view")
                self.right = ui.element("div").classes("part-numbers")
        dialog.on("hide", dialog.delete)
        dialog.open()

    def _ask(self) -> None:
        names = {n: f"{n}: {words}" for n, (_, words) in PARTS.items()} | {_FILE: "NC file …"}
        with ui.element("div").classes("part-ask"):
            self.program = ui.select(names, value="s-shape", label="Part").props("dense").style("min-width: 230px")
            self.program.mark("part program")
            self.file = ui.input("Path of the NC file").props("dense").style("min-width: 240px")
            controls = {"": "as the file says"} | {name: name for name in READABLE}
            self.dialect = ui.select(controls, value="", label="Control").props("dense")
            for asked in (self.file, self.dialect):
                asked.bind_visibility_from(self.program, "value", value=_FILE)
            x, y, z = (round(v / MM, 3) for v in self.live.bench.opened.tests[0].table_ball)
            self.zero = [ui.number(f"Zero {n}, mm", value=v, format="%.6g").props("dense").style("width: 84px")
                         for n, v in zip(COORDINATES, (x, y, z), strict=True)]  # fmt: skip
            self.allowed = ui.number("Allowed, µm", value=20, min=0).props("dense").style("width: 90px")
            ui.button("predict", icon="play_arrow", on_click=self._predict).props("flat no-caps autofocus").mark(
                "predict"
            )
            ui.element("div").style("flex: 1")
            ui.button(icon="close").props('flat dense aria-label="close" v-close-popup')

    async def _predict(self) -> None:
        name = (self.file.value or "").strip() if self.program.value == _FILE else self.program.value
        if not name:
            ui.notify("Which NC file?", type="warning")
            return
        zero = tuple(float(n.value or 0.0) * MM for n in self.zero)
        allowed = float(self.allowed.value or 0.0)
        tolerance = allowed * UM if allowed > 0.0 else None
        run = PartRun(
            name, (zero[0], zero[1], zero[2]), reading=Reading(self.dialect.value or None), tolerance=tolerance
        )
        self.says.text = "predicting …"
        result = await self.work("predict", lambda _: self.live.bench.predict(run))
        if result is None:
            self.says.text = "There is no prediction."
            return
        self._draw(result, self._before.get(name))
        self._before[name] = result

    def _draw(self, result: Prediction, before: Prediction | None) -> None:
        ends = [v / UM for v in result.largest[1:]]
        reason = f"{result.reason[:1].upper()}{result.reason[1:]}. " if result.reason else ""
        verdict = f"{result.verdict[:1].upper()}{result.verdict[1:]}. {reason}" if result.verdict else ""
        was = ""
        if before is not None:
            largest, *known = (v / UM for v in before.largest)
            was = f" (before: {estimate(largest, known)} µm)"
        self.says.text = (
            f"{verdict}Largest deviation {estimate(result.largest[0] / UM, ends)} µm{was}, 95 %: {interval(ends)} µm, "
            f"from {result.basis}. Cutting forces are not included."
        )
        if len(result.cuts) > 1:
            failed = sum(c.verdict == FAILS for c in result.cuts)
            self.says.text += f" {len(result.cuts)} cutting paths{f', {failed} of them fail' if failed else ''}."
        self.says.text += "".join(f" {note[:1].upper()}{note[1:]}." for note in result.notes)
        tone = {PASSES: "good", FAILS: "problem"}.get(result.verdict, "soft")
        self.says.classes(replace=tone)
        self.left.clear()
        with self.left:
            self._scene(result)
        self.right.clear()
        with self.right:
            ui.echart(self._chart(result, before)).style("height: 200px; width: 100%").mark("part chart")
            with ui.element("div").classes("part-tables"):
                self._table("axis", result.by_axis)
                self._table("cause", result.causes[:_ROWS])

    def _scene(self, result: Prediction) -> None:
        from matplotlib import colormaps

        error = np.linalg.norm(result.normal, axis=1)
        most = max(float(error.max()), 1e-12)
        middle = 0.5 * (result.path.max(axis=0) + result.path.min(axis=0))
        places = (result.path - middle) * (_SIZE / max(float(np.ptp(result.path, axis=0).max()), 1e-9))
        keep = np.unique(np.linspace(0, len(places) - 1, _POINTS).astype(int))
        colours = colormaps["viridis"](error[keep] / most)[:, :3] ** 2.2  # three.js counts them as linear
        with ui.scene(width=420, height=330, grid=False, background_color=_background(self._dark), fps=10) as scene:
            scene.point_cloud(places[keep].tolist(), colours.tolist(), 0.045)
            worst = places[int(np.argmax(error))]
            scene.sphere(0.06, 8, 6, wireframe=True).material(_LINE).move(*worst.tolist())
            for axis, colour in enumerate(("#d91a40", "#1a7f37", "#0b5cad")):
                corner = [-1.1, -0.9, -0.2]
                tip = list(corner)
                tip[axis] += 0.4
                scene.line(corner, tip).material(colour)
                scene.text(COORDINATES[axis].lower(), "font-size: 12px").move(*tip)
        scene.move_camera(0.6, -1.3, 1.1, 0, 0, 0, 0, 0, 1, duration=0)
        scene.style("width: 100%; height: 330px").mark("part scene")
        with ui.element("div").classes("part-scale"):
            ui.label("0")
            ui.element("div").classes("bar").style(f"background: linear-gradient(to right, {_gradient()})")
            ui.label(f"{style.micrometres(most / UM)} normal to the path")

    def _chart(self, result: Prediction, before: Prediction | None) -> dict:
        edge = COLOURS[self._dark][3]
        look = {"type": "line", "showSymbol": False, "animation": False}
        at = thinned(np.arange(len(result.blocks)), result.sizes, _PARTS)[0]
        place, value = at + 1, result.sizes[at] / UM
        ends = [np.array([getattr(result.blocks[i], n) for i in at]) / UM for n in ("low", "high")]
        clear = {"lineStyle": {"width": 0}, "stack": "interval", "tooltip": {"show": False}}
        series: list[dict] = [
            {**look, **clear, "data": pairs(place, ends[0])},
            {**look, **clear, "areaStyle": {"color": _BAND}, "data": pairs(place, ends[1] - ends[0])},
        ]
        if before is not None and len(before.blocks) == len(result.blocks):
            grey = {"lineStyle": {"color": _BEFORE, "width": 1}, "itemStyle": {"color": _BEFORE}}
            series.append({**look, **grey, "name": "model before, µm",
                           "data": pairs(place, before.sizes[at] / UM)})  # fmt: skip
        main = {"name": "deviation, µm", "lineStyle": {"color": _LINE, "width": 1.2}, "itemStyle": {"color": _LINE}}
        if result.tolerance is not None:
            main["markLine"] = {
                "silent": True, "symbol": "none", "data": [{"yAxis": result.tolerance / UM}],
                "lineStyle": {"color": edge, "type": "dashed"},
                "label": {"formatter": "allowed", "position": "insideEndTop", "color": edge},
            }  # fmt: skip
        series.append({**look, **main, "data": pairs(place, value)})
        most = max(float(ends[1].max()), (result.tolerance or 0.0) / UM)
        x = {"name": "block", "nameGap": 22, "min": 1, "max": len(result.blocks)}
        y = {"name": "normal to the path, µm", "nameGap": 32, "min": 0, "max": _rounded_up(1.05 * most)}
        return chart(self._dark, (48, 10, 12, 36), x, y) | {"series": series}

    @staticmethod
    def _table(head: str, rows: Any) -> None:
        with ui.element("table").classes("part-table"):
            with ui.element("tr"):
                for words in (head, "RMS, µm", "at the worst, µm"):
                    with ui.element("th"):
                        ui.label(words)
            for c in rows:
                with ui.element("tr"):
                    for words in (c.key, f"{c.rms / UM:.2f}", f"{c.at_worst / UM:+z.2f}"):
                        with ui.element("td"):
                            ui.label(words)


def _rounded_up(x: float) -> float:
    """The next greater multiple of a fifth of a round step."""
    step = style.nice_step(max(x, 1e-3)) / 5.0
    return round(float(np.ceil(x / step) * step), 6)


def _background(dark: bool) -> str:
    return "#23282f" if dark else "#f4f5f7"


def _gradient() -> str:
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return ", ".join(to_hex(colormaps["viridis"](x)) for x in np.linspace(0.0, 1.0, 9))
