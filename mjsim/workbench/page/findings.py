"""The diagnosis on the page: its progress, and its answer as cards."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from nicegui import ui

from mjsim.commands.axis_log.diagnosis import LogDiagnosis, little_known
from mjsim.commands.diagnosis import VERDICTS, Diagnosis
from mjsim.commands.finding import DiagnosedEffect
from mjsim.digits import estimate, interval
from mjsim.inference.budget import Budget
from mjsim.machine.effect import Effect
from mjsim.machine.model import sheet_name
from mjsim.units import DEG, UM
from mjsim.workbench import catalogue
from mjsim.workbench.live import Live, RecordingsLive


class JobPanel:
    """Draws the progress of work; a subclass draws the findings of a diagnosis.

    Args:
        live: The workbench.
        on_change: Called after the model was changed.
        on_preview: Called with an effect that shall be shown in the traces.
    """

    def __init__(
        self, live: Live | RecordingsLive, on_change: Callable[[], None], on_preview: Callable[[Effect], None]
    ) -> None:
        self.live, self.on_change, self.on_preview = live, on_change, on_preview
        self.panel = ui.element("div").classes("panel findings").mark("findings")
        with self.panel:
            with ui.element("div").classes("card plain") as self.job:
                with ui.element("div").style("display: flex; align-items: center; gap: 8px"):
                    self.stage = ui.label().style("flex: 1").mark("stage")
                    ui.button("stop", on_click=live.stop).props("dense flat no-caps").mark("stop")
                self.bar = ui.linear_progress(0.0, show_value=False).props('size="6px" aria-label="Progress"')
            self.cards = ui.element("div").mark("cards")
        self.job.visible = self.panel.visible = False

    def clear(self) -> None:
        """Take the former answer away."""
        self.cards.clear()

    def tick(self) -> None:
        """Show how far the work is."""
        job = self.live.job
        if job is not None:
            self.stage.text = f"{job.name}: {job.stage}" + (f", {job.done} of {job.total}" if job.total > 1 else "")
            self.bar.value = job.done / job.total if job.total else 0.0
        if self.job.visible != (job is not None):
            self.job.visible = job is not None
        visible = self.job.visible or bool(self.cards.default_slot.children)
        if self.panel.visible != visible:
            self.panel.visible = visible

    def draw(self) -> None:
        """Draw the answer of the last diagnosis."""
        self.cards.clear()
        if self.live.bench.diagnosis is not None:
            with self.cards:
                self.answer(self.live.bench.diagnosis)

    def answer(self, result: Any) -> None:
        """Draw an answer."""

    def verdict(self, verdict: str, residual: str) -> None:
        """Draw the card with the verdict and what is left."""
        with ui.element("div").classes("card plain").mark("verdict"):
            with ui.element("div").style("display: flex; gap: 8px"):
                ui.label(VERDICTS[verdict]).style("flex: 1")
                ui.button(icon="close", on_click=self.clear).props('dense flat aria-label="Close the diagnosis"')
            ui.label(residual).classes("soft")

    def doubts(self, found: DiagnosedEffect) -> None:
        """Draw what a finding cannot be told from and what was tried in its place."""
        if found.how_probable:
            ui.label(found.how_probable).classes("soft")
        if found.alternatives:
            ui.label(f"cannot be told from {', '.join(found.alternatives)}").classes("problem")
        if found.reached:
            others = ", ".join(f"{name} reaches {100.0 * r:.0f} %" for name, r in list(found.reached.items())[:3])
            ui.label(f"in its place, of what it explains: {others}").classes("soft")

    def card(
        self,
        found: DiagnosedEffect,
        error: str,
        tests: bool = True,
        budget: Sequence[Budget] = (),
    ) -> None:
        """Draw a finding.

        Args:
            found: The finding.
            error: What it does to the error, in words.
            tests: Say in which tests it shows.
            budget: Where the uncertainty of all numbers comes from.
        """
        effect = found.effect
        with ui.element("div").classes("card").mark(f"finding {effect.id}"):
            ui.label(f"{effect.key}: {catalogue.words(effect, found.ci95)}").classes("head")
            words = {p.name: catalogue.spoken(p) for p in effect.parameters_of(effect.subject)}
            for p in effect.parameters_of(effect.subject):
                ci = found.ci95.get(p.name)
                if ci and p.kind != "components":
                    ui.label(f"{catalogue.spoken(p)} 95 %: {interval(ci)} {p.unit}".rstrip())
            for b in (b for b in budget if b.effect_id == effect.id):
                ui.label(f"uncertainty of {words.get(b.number, b.number)}: {b.sentence}").classes("soft")
            if found.together is not None:
                ui.label(found.together.sentence).classes("soft")
            ui.label(f"RMS {error}")
            self.doubts(found)
            if tests and found.tests:
                ui.label(f"shows in {', '.join(found.tests[:4])}{' …' if len(found.tests) > 4 else ''}").classes("soft")
            with ui.element("div").style("display: flex; gap: 6px"):
                shown = ui.button("show it in the traces", on_click=lambda: self.on_preview(effect))
                shown.props("dense flat no-caps").mark(f"show {effect.id}")
                add = ui.button("add", on_click=lambda: self._add(found))
                add.props("dense no-caps unelevated").mark(f"add {effect.id}")

    def _add(self, found: DiagnosedEffect) -> None:
        self.live.bench.add(found.effect)
        self.live.bench.intervals[found.effect.key] = found.ci95
        self.on_change()


class FindingsPanel(JobPanel):
    """Draws progress and findings of a ball-bar campaign; arguments as of :class:`JobPanel`."""

    live: Live

    def answer(self, result: Diagnosis) -> None:
        """Draw an answer."""
        words = f"residual RMS {result.before.rms / UM:.3f} → {result.after.rms / UM:.3f} µm, "
        self.verdict(result.verdict, f"{words}noise {result.noise / UM:.3f} µm")
        for found in result.effects:
            share = result.shares.get(found.effect.key) or result.shares.get(found.effect.id)
            explained = f", {100 * share:.0f} % of what is explained" if share else ""
            error = f"{found.rms_before / UM:.3f} → {found.rms_after / UM:.3f} µm{explained}"
            self.card(found, error, budget=result.budget)
        if result.unexplained is not None:
            with ui.element("div").classes("card").mark("unknown"):
                ui.label(f"Unknown cause: {', '.join(result.unexplained.axes)} axis").classes("head")
                ui.label(result.unexplained.summary)
                ui.label(f"shows in {', '.join(result.unexplained.tests)}").classes("soft")
        if result.further:
            with ui.element("div").classes("card plain").mark("further curves"):
                ui.label("Also in the model").classes("head")
                for curve in result.further:
                    ui.label(curve.summary)
        for sentence in result.told_beside:
            with ui.element("div").classes("card plain").mark("beside the model"):
                ui.label(sentence)
        self._next_test(result)

    def _next_test(self, result: Diagnosis) -> None:
        following = result.next_test
        if not following:
            return
        one, other = following["between"]
        enough = "" if following["decides"] else " This is not enough to decide."
        with ui.element("div").classes("card plain").mark("next test"):
            ui.label(f"Next test: {following['test']['name']}").classes("head")
            differ = f"they differ by {following['difference_um']:.2f} µm RMS in it"
            ui.label(f"It separates {one} from {other}: {differ}.{enough}")
            ui.label(following["reason"]).classes("soft")


class LogFindingsPanel(JobPanel):
    """Draws progress and findings of axis logs; arguments as of :class:`JobPanel`."""

    live: RecordingsLive

    def answer(self, result: LogDiagnosis) -> None:
        """Draw an answer."""
        self.verdict(result.verdict, f"residual RMS {result.before.rms / UM:.3f} → {result.after.rms / UM:.3f} µm")
        for found in result.effects:
            rotary = result.machine.chain.is_rotary(found.effect.subject)
            unit, symbol = (DEG, "°") if rotary else (UM, "µm")
            error = f"{found.rms_before / unit:.4g} → {found.rms_after / unit:.4g} {symbol}"
            self.card(found, error, tests=False)
        rest = result.to_json()["unexplained"]
        if rest:
            with ui.element("div").classes("card").mark("unknown"):
                ui.label("Unknown cause").classes("head")
                ui.label(rest["summary"])
        self._sheet(result)

    def _sheet(self, result: LogDiagnosis) -> None:
        """The numbers of the drives that the recordings know."""
        rows = [n for n in result.sheet if n.known]
        with ui.element("div").classes("card plain").mark("sheet"):
            ui.label("The fitted machine").classes("head")
            for n in rows[:8]:
                where = f" ({n.controller})" if n.controller else ""
                name, unit = sheet_name(n.name)
                ui.label(f"{n.axis} {name}{where}: {estimate(n.found, n.ci95)}, stated {n.stated:.4g} {unit}".rstrip())
            for i in result.inseparable[:3]:
                ui.label(little_known(i.axis, [x.rpartition(".")[2] for x in i.labels])).classes("soft")
            take = ui.button("take it: all causes, and these numbers", on_click=self._take)
            take.props("dense flat no-caps").mark("take")

    def _take(self) -> None:
        self.live.bench.take_fitted()
        self.on_change()
