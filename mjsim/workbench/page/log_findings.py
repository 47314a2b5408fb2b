"""The diagnosis of axis logs on the page: causes as cards, and the fitted machine."""

from __future__ import annotations

from nicegui import ui

from mjsim.machine.sheet_names import sheet_name
from mjsim.units import DEG, UM
from mjsim.workbench import catalogue
from mjsim.workbench.page.findings import JobPanel
from mjsim.workbench.recordings_live import RecordingsLive
from mjsim.workflow.axis_log.diagnosis import LogDiagnosis
from mjsim.workflow.finding import DiagnosedEffect


class LogFindingsPanel(JobPanel):
    """Draws progress and findings of axis logs; arguments as of :class:`JobPanel`."""

    live: RecordingsLive

    def draw(self) -> None:
        """Draw the answer of the last diagnosis."""
        result = self.live.bench.diagnosis
        self.cards.clear()
        if result is None:
            return
        with self.cards:
            self.verdict(result.verdict, f"residual RMS {result.before.rms / UM:.3f} → {result.after.rms / UM:.3f} µm")
            for found in result.effects:
                self._log_card(found, result)
            rest = result.to_json()["unexplained"]
            if rest:
                with ui.element("div").classes("card").mark("unknown"):
                    ui.label("Unknown cause").classes("head")
                    ui.label(rest["summary"])
            self._sheet(result)

    def _log_card(self, found: DiagnosedEffect, result: LogDiagnosis) -> None:
        effect = found.effect
        rotary = result.machine.chain.is_rotary(effect.subject)
        unit, symbol = (DEG, "°") if rotary else (UM, "µm")
        with ui.element("div").classes("card").mark(f"finding {effect.id}"):
            ui.label(f"{effect.key}: {catalogue.words(effect)}").classes("head")
            for p in effect.parameters_of(effect.subject):
                ci = found.ci95.get(p.name)
                if ci and p.kind != "components":
                    ui.label(f"{catalogue.spoken(p)} 95 %: {ci[0]:.4g} to {ci[1]:.4g} {p.unit}".rstrip())
            if found.together is not None:
                ui.label(found.together.sentence).classes("soft")
            ui.label(f"RMS {found.rms_before / unit:.4g} → {found.rms_after / unit:.4g} {symbol}")
            self.doubts(found)
            self.buttons(found)

    def _sheet(self, result: LogDiagnosis) -> None:
        """The numbers of the drives that the recordings know."""
        rows = [n for n in result.sheet if n.known]
        with ui.element("div").classes("card plain").mark("sheet"):
            ui.label("The fitted machine").classes("head")
            for n in rows[:8]:
                where = f" ({n.controller})" if n.controller else ""
                name, unit = sheet_name(n.name)
                ui.label(f"{n.axis} {name}{where}: {n.found:.4g}, stated {n.stated:.4g} {unit}".rstrip())
            for i in result.inseparable[:3]:
                ui.label(
                    f"{i.axis}: only a combination of {', '.join(x.rpartition('.')[2] for x in i.labels)} is known"
                ).classes("soft")
            take = ui.button("take it: all causes, and these numbers", on_click=self._take)
            take.props("dense flat no-caps").mark("take")

    def _take(self) -> None:
        self.live.bench.take_fitted()
        self.on_change()
