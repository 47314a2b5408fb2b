"""The traces on the page: the polar plot and the residual of one test, and all tests small."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from nicegui import ui

from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.units import DEG, MM, UM
from mjsim.workbench import svg
from mjsim.workbench.lines import COLOURS, chart, pairs, thinned
from mjsim.workbench.live import Live
from mjsim.workbench.overlay import OpenCampaign, Overlay, Trace, reversals_of

# -- what a residual is drawn over -------------------------------------------------------------------------------------

ANGLE, TIME = "angle", "time"


@dataclass(frozen=True)
class Abscissa:
    """Values of the horizontal axis of a plot.

    Attributes:
        label: With the unit.
        value: (n,) in that unit.
        forward: (n,) bool, whether the axis moves towards greater values; ``None`` where that has no meaning.
    """

    label: str
    value: np.ndarray
    forward: np.ndarray | None = None


def choices(opened: OpenCampaign, name: str) -> dict[str, str]:
    """What a test can be drawn over, by key, with the words for it."""
    motion, chain = opened.motions[name], opened.test(name).chain
    out = {ANGLE: "angle φ" if kind_of(opened.test(name)).goes_round else "angle", TIME: "time"}
    for i, letter in enumerate(chain.letters):
        if motion.moves[i]:
            out[f"{letter} position"] = f"{letter} position, by direction"
            out[f"{letter} speed"] = f"{letter} speed"
    return out


def abscissa(opened: OpenCampaign, trace: Trace, key: str) -> Abscissa:
    """The horizontal axis of a trace.

    Args:
        opened: The campaign.
        trace: Of one test.
        key: Of :func:`choices`.
    """
    if key == TIME:
        return Abscissa("time, s", trace.time)
    letter, _, what = key.partition(" ")
    chain = trace.test.chain
    if letter not in chain.letters:
        return Abscissa("angle φ, °", np.degrees(trace.phi))
    program, i = opened.motions[trace.test.name].program, chain.index(letter)
    unit, size, per_s = ("°", DEG, "°/s") if chain.is_rotary(letter) else ("mm", MM, "mm/s")
    step = 0.01
    now, later = program.commands(trace.time)[:, i], program.commands(trace.time + step)[:, i]
    speed = (later - now) / step
    if what == "speed":
        return Abscissa(f"{letter} speed, {per_s}", speed / size)
    return Abscissa(f"{letter} position, {unit}", now / size, speed >= 0.0)


#: Parts of a line in the chart; two points each.
_PARTS = 700
#: Reversals so near each other have one mark, rad.
_TOGETHER = 0.05


class Traces:
    """Draws the traces of a workbench.

    Args:
        live: The workbench.
        on_cursor: Called with the time (s) under the pointer.
    """

    def __init__(self, live: Live, on_cursor) -> None:
        self.live, self.on_cursor = live, on_cursor
        self.name, self.key = live.shown[0], ANGLE
        self.dark = False
        self._reversals = {t.name: reversals_of(live.bench.opened, t.name) for t in live.bench.opened.tests}
        self._points = np.zeros(0)
        self._drawn: dict[str, object] = {}
        with ui.element("div").classes("panel stack").style("grid-row: 2"):
            self._head()
            with ui.element("div").classes("main-plots"):
                with ui.element("div").classes("polar-place"):
                    self.polar = ui.html("", sanitize=False).mark("polar")
                    self.ray = ui.html(svg.RAY, sanitize=False).classes("ray").mark("ray")
                    self.ray.visible = False
                self.chart = ui.echart(self._options(None)).classes("chart").mark("residual")
                self.chart.on("chart:highlight", self._pointed, args=["batch"], throttle=0.05)
            self._all()

    def _head(self) -> None:
        tests = [t.name for t in self.live.bench.opened.tests]
        with ui.element("div").classes("traces-head"):
            self.select = ui.select(tests, value=self.name, on_change=lambda e: self.choose(e.value))
            self.select.props("dense borderless options-dense aria-label=Test").style("min-width: 170px").mark("test")
            self.over = ui.select(self._choices(), value=self.key, on_change=lambda e: self._draw_over(e.value))
            self.over.props('dense borderless options-dense prefix="over" aria-label="Residual over"').mark("over")
            self.about = ui.label().classes("soft").mark("about")
            ui.element("div").style("flex: 1")
            with ui.element("div").classes("legend wide-only"):
                for name, words in (("of-measured", "measured"), ("of-simulated", "simulated, residual")):
                    ui.html(words, tag="span").classes(name)
                self.other = ui.html("residual before", tag="span").classes("of-before")
                ui.html("noise ± 2 RMS", tag="span").classes("of-noise")

    def _choices(self) -> dict[str, str]:
        return choices(self.live.bench.opened, self.name)

    def _all(self) -> None:
        self.small: dict[str, tuple[ui.element, ui.html, ui.label, ui.element]] = {}
        with ui.element("div").classes("small-ones").mark("all-tests"):
            for t in self.live.bench.opened.tests:
                button = ui.element("button").classes("small-one").props(f'aria-label="{t.name}" title="{t.name}"')
                button.on("click", lambda _, name=t.name: self.choose(name)).mark(f"small {t.name}")
                with button:
                    picture = ui.html("", sanitize=False)
                    words = ui.label().classes("what")
                    name = ui.label(t.name).classes("what soft")
                    with ui.element("div").classes("track"):
                        fill = ui.element("div").classes("fill")
                self.small[t.name] = button, picture, words, fill
                name.tooltip(t.name)

    def choose(self, name: str) -> None:
        """Show a test large."""
        if name == self.name:
            return
        self.name = name
        self.live.show(name)
        self.select.value = name
        if self.key not in self._choices():
            self.key = ANGLE
        self.over.set_options(self._choices(), value=self.key)
        self.ray.visible = False
        self.draw_shown()
        self._mark_chosen()

    def beside(self, step: int) -> None:
        """Show the next test (1) or the one before (-1)."""
        names = list(self.small)
        self.choose(names[(names.index(self.name) + step) % len(names)])

    def _draw_over(self, key: str) -> None:
        self.key = key
        self.draw_shown()

    def _mark_chosen(self) -> None:
        for name, (button, *_) in self.small.items():
            button.classes(**({"add": "chosen"} if name == self.name else {"remove": "chosen"}))

    @property
    def trace(self) -> Trace | None:
        """The trace that is shown large."""
        return self.live.overlay.traces[self.name] if self.live.overlay else None

    def draw_shown(self) -> None:
        """Draw the large plots again."""
        self.draw_polar()
        self.draw_chart()

    def draw_polar(self) -> None:
        """Draw the polar plot again."""
        trace = self.trace
        if trace is None:
            return
        self.polar.content = svg.polar(trace, self._reversals[self.name])
        self.about.text = f"{trace.engine}, RMS {trace.rms / UM:.3f} µm" if trace.measured is not None else trace.engine

    def draw_chart(self) -> None:
        """Draw the residual again."""
        trace = self.trace
        if trace is None:
            return
        self.other.content = f"residual {self.live.other_name}"
        self.chart.options.update(self._options(trace))
        self.chart.update()

    def draw_all(self) -> None:
        """Draw the small plots again, as far as they have changed."""
        overlay = self.live.overlay
        if overlay is None:
            return
        for name, (_, picture, words, fill) in self.small.items():
            trace = overlay.traces[name]
            if self._drawn.get(name) is trace.simulated:
                continue
            self._drawn[name] = trace.simulated
            picture.content = svg.polar(trace, small=True)
            measured = trace.measured is not None
            words.text = f"{trace.rms / UM:.2f} µm, {100 * trace.share:.0f} %" if measured else "simulated"
            fill.style(f"width: {100 * trace.share:.0f}%")
        self._mark_chosen()

    def point(self, time: float) -> None:
        """Put the cursor to a time (s)."""
        trace = self.trace
        if trace is None:
            return
        angle = svg.ray_angle(trace, int(np.clip(np.searchsorted(trace.time, time), 0, len(trace.time) - 1)))
        self.ray.style(f"transform: rotate({-angle:.1f}deg)").visible = True

    def _pointed(self, event) -> None:
        batch = event.args.get("batch") if isinstance(event.args, dict) else None
        hit = next((b for b in batch or [] if b.get("dataIndex") is not None), None)
        if hit and hit["dataIndex"] < len(self._points):
            self.on_cursor(float(self._points[hit["dataIndex"]]))

    # -- the chart -----------------------------------------------------------------------------------------------------

    def _options(self, trace: Trace | None) -> dict:
        now, back, before = COLOURS[self.dark][2:5]
        look = {"type": "line", "showSymbol": False, "symbol": "circle", "animation": False}
        series = [{**look, "lineStyle": {"width": w, "color": c}, "itemStyle": {"color": c}, "data": []}
                  for c, w in ((before, 1.0), (now, 1.2), (back, 1.2))]  # fmt: skip
        out = chart(self.dark, (54, 14, 38, 40), {"nameGap": 24}, {"nameGap": 36})
        out |= {"dataZoom": [{"type": "inside", "filterMode": "none"}], "series": series}
        if trace is not None:
            self._fill(out, trace)
        return out

    def _fill(self, out: dict, trace: Trace) -> None:
        across = abscissa(self.live.bench.opened, trace, self.key)
        measured = trace.residual is not None
        values = trace.residual if trace.residual is not None else trace.simulated
        words = "residual" if measured else "simulated"
        b = self._before(trace)
        step = _limit([values] if b is None else [values, b])
        out["xAxis"] |= {"name": across.label, "scale": True}
        if self.key == ANGLE:
            low, high = float(np.round(across.value.min())), float(np.round(across.value.max()))
            out["xAxis"] |= {"min": low, "max": high} | ({"interval": 90} if high - low >= 360 else {})
        out["yAxis"] |= {
            "name": f"{'measured − simulated' if measured else 'reading'}, µm",
            "min": -step,
            "max": step,
        }
        place, thin = thinned(np.arange(len(values), dtype=float), values / UM, _PARTS)
        at = place.astype(int)
        self._points = trace.time[at]
        halves = [(np.ones(len(at), bool), words)]
        if across.forward is not None:
            halves = [(across.forward[at], f"{words}, forwards"), (~across.forward[at], f"{words}, backwards")]
        for series, (mask, name) in zip(out["series"][1:], halves, strict=False):
            series |= {"name": f"{name}, µm", "data": pairs(across.value[at], np.where(mask, thin, np.nan))}
        if b is not None and across.forward is None:
            out["series"][0] |= {"name": f"{self.live.other_name}, µm", "data": pairs(across.value[at], b[at] / UM)}
        self._mark(out["series"][1], trace, across, measured)

    def _mark(self, series: dict, trace: Trace, across: Abscissa, measured: bool) -> None:
        turn, _, band = COLOURS[self.dark][3:6]
        noise = self.live.bench.noise
        if noise is not None and measured:
            ends = [{"yAxis": -2 * noise / UM}, {"yAxis": 2 * noise / UM}]
            series["markArea"] = {"silent": True, "itemStyle": {"color": band}, "data": [ends]}
        marks: dict[int, str] = {}
        for axis, angles in self._reversals[self.name].items():
            if across.forward is not None and not self.key.startswith(axis):
                continue
            for phi in angles:
                nearest = int(np.argmin(np.abs(trace.phi - phi)))
                there = next((k for k in marks if abs(trace.phi[k] - trace.phi[nearest]) < _TOGETHER), nearest)
                marks[there] = marks.get(there, "") + axis
        lines = [
            {"xAxis": _round(across.value[k]), "label": {"formatter": marks[k], "distance": 7 + 11 * (i % 2)}}
            for i, k in enumerate(sorted(marks, key=lambda k: across.value[k]))
        ]
        series["markLine"] = {
            "silent": True,
            "symbol": "none",
            "lineStyle": {"color": turn, "type": "dotted", "width": 1},
            "label": {"color": turn, "fontSize": 11, "distance": 2},
            "data": lines[:60],
        }

    def _before(self, trace: Trace) -> np.ndarray | None:
        """Residual of the model that was there before, on the samples of the present one."""
        before: Overlay | None = self.live.other
        other = before.traces.get(self.name) if before is not None else None
        if other is None or other.residual is None or trace.residual is None:
            return None
        return other.residual if len(other.residual) == len(trace.residual) else None


def _limit(values: list[np.ndarray]) -> float:
    """A round limit (µm) that holds the values (m) of all lines."""
    largest = max((float(np.nanmax(np.abs(v))) / UM for v in values), default=0.0) or 0.1
    decade = 10.0 ** np.floor(np.log10(largest))
    return float(next(f for f in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0) if f * decade >= largest) * decade)


def _round(x: float) -> float:
    return round(float(x), 3)
