"""The machine in 3D on the page: posed by the cursor or played, with the bar and its path magnified."""

from __future__ import annotations

import time as clock
from collections.abc import Callable

import numpy as np
from nicegui import ui

from mjsim.inference.samples import GRID, GRID_STEPS
from mjsim.machine.effect import axis_of_subject
from mjsim.plots import style
from mjsim.units import DEG
from mjsim.workbench import catalogue
from mjsim.workbench.bodies import FIELD, STANDING, Body, MachineBodies, Posed, turn_to
from mjsim.workbench.live import Live

#: Poses a second while the machine plays.
RATE = 30.0
#: The largest error is drawn as long as this share of the bar.
_FILL = 0.2
#: Frames a second: where nothing moves, a software renderer shall leave the processor to the simulation.
_FRAMES = {"at rest": 5, "pointed at": 20, "moving": 30}
_BACKGROUND = {False: "#e9ecf0", True: "#23282f"}
_SPEEDS = {1.0: "1 ×", 2.0: "2 ×", 5.0: "5 ×", 10.0: "10 ×"}
_WORDS = {"column": "column", "bed": "bed", "spindle": "spindle with the ball", "table_fixture": "ball on the table"}


class MachinePanel:
    """Draws the machine.

    Args:
        live: The workbench.
        meshes: Address of the folder with the meshes.
        bodies: The machine; ``None`` where there is no model of it.
        shown: Name of the test that is shown.
        on_time: Called with the time (s) while the machine moves by itself.
    """

    def __init__(
        self,
        live: Live,
        meshes: str,
        bodies: MachineBodies | None,
        shown: Callable[[], str],
        on_time: Callable[[float], None],
    ) -> None:
        self.live, self.shown, self.on_time = live, shown, on_time
        self.playing, self.time, self.factor = False, 0.0, 1.0
        self._position = np.zeros((1, live.bench.machine.chain.count))
        self._groups: dict[str, ui.scene.group] = {}
        self._name, self._machine, self._started = "", None, (0.0, 0.0)
        self.poses, self._dark = 0, False
        #: There from the first picture of the traces on: a scene keeps the browser busy for a second.
        self.model: Posed | None = None
        self._coming: Posed | None = None
        with ui.element("div").classes("panel machine").mark("machine"):
            with ui.element("div").classes("title").style("z-index: 1"):
                chain = live.bench.machine.chain
                turns = f"; sense of the rotary axes (ISO 841): {chain.senses}" if chain.rotary else ""
                ui.label("Machine").tooltip(f"{live.bench.machine.name}, {chain.configuration}{turns}")
                self.about = ui.label().classes("soft").mark("magnified")
            if bodies is None:
                ui.label(f"There is no model in 3D of {live.bench.machine.configuration}.").classes("soft q-pa-md")
                return
            self._meshes, self._bodies = meshes, bodies.bodies
            self._coming = bodies.posed(live.bench.opened.test(shown()))
            self._place = ui.element("div").classes("view")
            self.picked = ui.label().classes("about soft").mark("picked")
            self._make_controls(self._coming)
        self._timer = ui.timer(1.0 / RATE, self._play, active=False)

    def _make_scene(self, model: Posed) -> None:
        self.model, self._coming = model, None
        camera = ui.scene.perspective_camera(fov=FIELD, near=0.05, far=40)
        # a number of pixels is asked for, but the size is that of the place
        self.scene = ui.scene(
            width=340, height=260, grid=False, camera=camera, on_click=self._picked, click_events=["click"],
            background_color=_BACKGROUND[self._dark], fps=_FRAMES["at rest"],
        )  # fmt: skip
        self.scene.style("width: 100%; height: 100%").mark("scene")
        self.scene.on("mouseenter", lambda: self._draw_at("pointed at"))
        self.scene.on("mouseleave", lambda: self._draw_at("moving" if self.playing else "at rest"))
        with self.scene:
            for body in self._bodies:
                self._make_body(body)
            self.bar = ui.scene.group()
            with self.bar:
                length = model.test.length
                self.rod = ui.scene.cylinder(0.0028, 0.0028, 1.0, 12).material("#ff6b0d")
                self.rod.rotate(np.pi / 2, 0, 0).scale(1, length or 1.0, 1).visible(length > 0.0)
            self.error = ui.scene.cylinder(0.0045, 0.0045, 1.0, 12).material("#d91a40")
        self._paths: dict[str, ui.scene.point_cloud] = {}
        self.view("close-up", 0.0)

    def _make_body(self, body: Body) -> None:
        with self._groups.get(body.parent, self.scene):
            group = ui.scene.group().with_name(body.name)
            self._groups[body.name] = group
            place, turn = body.placed(0.0)
            group.move(*place.tolist()).rotate_R(turn.tolist())
            with group:
                for i, (colour, _) in enumerate(body.solids):
                    ui.scene.stl(f"{self._meshes}/{body.name}-{i}.stl").material(colour).with_name(body.name)

    def _make_controls(self, model: Posed) -> None:
        with ui.element("div").classes("controls"):
            self.button = ui.button(icon="play_arrow", on_click=self.toggle)
            self.button.props('flat dense aria-label="Play"').tooltip("Play (space)").mark("play")
            self.scrub = ui.slider(min=0.0, max=1.0, step=0.01, value=0.0)
            self.scrub.props('aria-label="Time in the test"').mark("scrub").style("flex: 1; min-width: 40px")
            self.scrub.on_value_change(lambda e: self._scrubbed(e.value))
            self.speed = ui.select(_SPEEDS, value=2.0).props('dense borderless options-dense aria-label="Speed"')
            self.speed.on_value_change(lambda _: self._restart())
        with ui.element("div").classes("controls"):
            views = list(model.views(self._position[0]))
            views_select = ui.select(views, value=views[0], on_change=lambda e: self.view(e.value))
            views_select.props('dense borderless options-dense prefix="view" aria-label="View"').mark("view")
            ui.element("div").style("flex: 1")
            self.magnify = ui.number(value=1.0, min=1.0, format="%.0f", on_change=lambda e: self._magnified(e.value))
            self.magnify.props('dense borderless prefix="error ×" debounce=400 aria-label="Magnification"')
            self.magnify.style("width: 110px").mark("factor")

    # -- what is shown -------------------------------------------------------------------------------------------------

    def changed(self, name: str) -> None:
        """Another test is shown, or the model is another one."""
        overlay = self.live.overlay
        if overlay is None:
            return
        if self._coming is not None:
            with self._place:
                self._make_scene(self._coming)
        if self.model is None:
            return
        if name == self._name and overlay.machine is self._machine:
            return
        opened, fresh = self.live.bench.opened, name != self._name
        self._name, self._machine = name, overlay.machine
        if fresh:
            test = opened.test(name)
            self.model = self.model.machine.posed(test)
            x, y, z = test.table_ball
            self._groups["table_fixture"].move(x, y, z)
            self.scrub.props(f"max={opened.motions[name].program.duration:.2f}")
        self._position = opened.motions[name].load(self.live.bench.shared.readings.plant(overlay.machine), GRID_STEPS)
        self._position = self._position[:, : overlay.machine.chain.count]
        trace = overlay.traces[name]
        if fresh:
            largest = max(float(np.nanmax(np.abs(v))) for v in trace.centred if v is not None)
            room = _FILL * self.model.test.shown_over / max(largest, 1e-9)
            self.factor = style.nice_step(room) if style.nice_step(room) <= room else style.nice_step(room / 2.5)
            self.magnify.value = self.factor
            self.time = float(trace.time[0])
        self._draw_path()
        self.pose()

    def _draw_path(self) -> None:
        overlay = self.live.overlay
        if self.model is None or overlay is None or not self._name:
            return
        trace = overlay.traces[self._name]
        lines = self.model.path(trace, np.arange(len(self._position)) * GRID, self._position, self.factor)
        colours = {"nominal": (0.5, 0.55, 0.6), "measured": (0.05, 0.05, 0.05), "simulated": (0.85, 0.28, 0.06)}
        for path in self._paths.values():
            path.delete()
        self._paths.clear()
        with self.scene, self._groups[self.model.carrier]:
            for name, points in lines.items():
                cloud = ui.scene.point_cloud(points.tolist(), [list(colours[name])] * len(points), 0.0022)
                self._paths[name] = cloud
        self.about.text = "path simulated" if trace.measured is None else "path: black measured, orange simulated"

    def pose(self) -> None:
        """Put the machine to the present time."""
        if self.model is None:
            return
        k = int(np.clip(self.time / GRID, 0, len(self._position) - 1))
        position, chain = self._position[k], self.model.test.chain
        for body in self._bodies:
            if body.joint:
                place, turn = body.placed(float(position[chain.index(body.joint)]))
                group = self._groups[body.name]
                if body.rotary:
                    group.rotate_R(turn.tolist())
                else:
                    group.move(*place.tolist())
        table, spindle = self.model.balls(position)
        along = self.model.test.pointing(table, spindle)
        turn = turn_to(along).tolist()
        length, stretch = self.model.test.length, self._stretch()
        self.bar.move(*(table + 0.5 * length * along).tolist())
        self.bar.rotate_R(turn)
        self.error.move(*(table + (length + 0.5 * stretch) * along).tolist())
        self.error.rotate_R((np.array(turn) @ STANDING).tolist())
        self.error.scale(1.0, max(abs(stretch), 1e-6), 1.0)
        self.poses += 1

    def _stretch(self) -> float:
        """The present error, magnified, m: measured less simulated, or the reading where nothing was measured."""
        overlay = self.live.overlay
        if overlay is None:
            return 0.0
        trace = overlay.traces[self._name]
        k = int(np.clip(np.searchsorted(trace.time, self.time), 0, len(trace.time) - 1))
        value = trace.centred[1] if trace.residual is None else trace.residual
        return float(np.nan_to_num(value[k])) * self.factor

    # -- time ----------------------------------------------------------------------------------------------------------

    def go(self, time: float) -> None:
        """Show a time (s)."""
        self.time = time
        if self.model is not None:
            self.scrub.value = round(time, 2)
            self.pose()

    def step(self, seconds: float) -> None:
        """Go on by some seconds, or back."""
        end = len(self._position) * GRID
        self.go(float(np.clip(self.time + seconds, 0.0, end)))
        self.on_time(self.time)

    def _scrubbed(self, value: float | None) -> None:
        if value is not None and abs(value - self.time) > 0.006:
            self.time = value
            self._restart()
            self.on_time(value)
            self.pose()

    def toggle(self) -> None:
        """Play or pause."""
        if self.model is None:
            return
        self.playing = not self.playing
        self._timer.active = self.playing
        self._draw_at("moving" if self.playing else "at rest")
        self.button.props(f"icon={'pause' if self.playing else 'play_arrow'}")
        self._restart()

    def _restart(self) -> None:
        self._started = clock.monotonic(), self.time

    def _play(self) -> None:
        then, begin = self._started
        end = len(self._position) * GRID
        self.time = begin + (clock.monotonic() - then) * float(self.speed.value or 1.0)
        if self.time > end:
            self.time = 0.0
            self._restart()
        self.pose()
        if self.poses % 6 == 0:  # the slider and the ray need no more than five a second
            self.scrub.value = round(self.time, 2)
            self.on_time(self.time)

    # -- looks ---------------------------------------------------------------------------------------------------------

    def view(self, name: str, seconds: float = 0.4) -> None:
        """Look at the machine from one of the usual places."""
        if self.model is None:
            return
        (x, y, z), (to_x, to_y, to_z) = self.model.views(self._position[0])[name]
        self.scene.move_camera(x, y, z, to_x, to_y, to_z, 0.0, 0.0, 1.0, duration=seconds)

    def _draw_at(self, state: str) -> None:
        self.scene.props["fps"] = _FRAMES[state]

    def darken(self, dark: bool) -> None:
        """Dark or light background."""
        self._dark = dark
        if self.model is not None:
            self.scene.props(f'background-color="{_BACKGROUND[dark]}"')

    def _magnified(self, value: float | None) -> None:
        if value and value >= 1.0 and value != self.factor:
            self.factor = float(value)
            self._draw_path()
            self.pose()

    def _picked(self, event) -> None:
        name = next((h.object_name for h in event.hits if h.object_name in self._groups), "")
        if not name or self.model is None:
            return
        body = next(b for b in self._bodies if b.name == name)
        chain = self.model.test.chain
        if not body.joint:
            self.picked.text = _WORDS.get(name, name.replace("_", " "))
            return
        i = chain.index(body.joint)
        value = self._position[int(np.clip(self.time / GRID, 0, len(self._position) - 1)), i]
        where = f"{value / DEG:.3f} °" if body.rotary else f"{value * 1e3:.3f} mm"
        mine = [e for e in self.live.bench.machine.effects
                if axis_of_subject(e.subject, chain) == body.joint]  # fmt: skip
        acting = "; ".join(f"{e.key} ({catalogue.words(e)})" for e in mine) or "no effect acts on it"
        self.picked.text = f"{name.replace('_', ' ')}, axis {body.joint} at {where}: {acting}"
