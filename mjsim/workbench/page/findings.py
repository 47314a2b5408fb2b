"""The diagnosis on the page: its progress, and its answer as cards."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from mjsim.machine.effect import Effect
from mjsim.units import UM
from mjsim.workbench import catalogue
from mjsim.workbench.live import Live
from mjsim.workbench.recordings_live import RecordingsLive
from mjsim.workflow.diagnosis import Diagnosis
from mjsim.workflow.finding import DiagnosedEffect

VERDICTS = {
    "identified": "Identified: the effects below are missing, and nothing else explains the data as well.",
    "ambiguous": "Ambiguous: some effects below cannot be told from others by these tests.",
    "unknown": "Unknown: something repeatable is left that no effect of the catalogue explains.",
    "nothing_found": "Nothing found: the model explains the measurement down to the noise.",
}


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

    def verdict(self, verdict: str, residual: str) -> None:
        """Draw the card with the verdict and what is left."""
        with ui.element("div").classes("card plain").mark("verdict"):
            with ui.element("div").style("display: flex; gap: 8px"):
                ui.label(VERDICTS[verdict]).style("flex: 1")
                ui.button(icon="close", on_click=self.clear).props('dense flat aria-label="Close the diagnosis"')
            ui.label(residual).classes("soft")

    def doubts(self, found: DiagnosedEffect, worse: str = "worse") -> None:
        """Draw what a finding cannot be told from and what was tried in its place."""
        if found.how_probable:
            ui.label(found.how_probable).classes("soft")
        if found.alternatives:
            ui.label(f"cannot be told from {', '.join(found.alternatives)}").classes("problem")
        near = sorted(found.rejected.items(), key=lambda row: row[1])[:3]
        if near:
            others = ", ".join(f"{name} ({worse} by {less:.3g})" for name, less in near)
            ui.label(f"was tried in its place: {others}").classes("soft")

    def buttons(self, found: DiagnosedEffect) -> None:
        """Draw the buttons of a finding."""
        effect = found.effect
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

    def draw(self) -> None:
        """Draw the answer of the last diagnosis."""
        result = self.live.bench.diagnosis
        self.cards.clear()
        if result is None:
            return
        with self.cards:
            words = f"residual RMS {result.before.rms / UM:.3f} → {result.after.rms / UM:.3f} µm, "
            self.verdict(result.verdict, f"{words}noise {result.noise / UM:.3f} µm")
            for found in result.effects:
                self._card(found, result)
            if result.unexplained is not None:
                with ui.element("div").classes("card").mark("unknown"):
                    ui.label(f"Unknown cause: {', '.join(result.unexplained.axes)} axis").classes("head")
                    ui.label(result.unexplained.summary)
                    ui.label(f"shows in {', '.join(result.unexplained.tests)}").classes("soft")
            self._next_test(result)

    def _card(self, found: DiagnosedEffect, result: Diagnosis) -> None:
        effect = found.effect
        with ui.element("div").classes("card").mark(f"finding {effect.id}"):
            ui.label(f"{effect.key}: {catalogue.words(effect)}").classes("head")
            for name, ci in found.ci95.items():
                if name != "components" and name in effect.values:
                    p = next(p for p in effect.parameters_of(effect.subject) if p.name == name)
                    ui.label(f"{catalogue.spoken(p)} 95 %: {ci[0]:.4g} to {ci[1]:.4g} {p.unit}".rstrip())
            share = result.shares.get(effect.key) or result.shares.get(effect.id)
            explained = f", {100 * share:.0f} % of what is explained" if share else ""
            ui.label(f"RMS {found.rms_before / UM:.3f} → {found.rms_after / UM:.3f} µm{explained}")
            self.doubts(found, "χ² worse")
            if found.tests:
                ui.label(f"shows in {', '.join(found.tests[:4])}{' …' if len(found.tests) > 4 else ''}").classes("soft")
            self.buttons(found)

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
