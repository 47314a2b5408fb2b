"""The findings of a ball-bar diagnosis judged by axis logs of the same machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from mjsim.campaign.model import Campaign
from mjsim.commands.axis_log.diagnose import log_diagnosis
from mjsim.commands.axis_log.diagnosis import LogDiagnosis
from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.finding import DiagnosedEffect
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.entries import KnownNumbers
from mjsim.inference.axis_logs.fit import AxisFit, LogFitter
from mjsim.inference.axis_logs.found import AxisSelection
from mjsim.inference.axis_logs.gains import read_gains
from mjsim.inference.axis_logs.shared import MOTOR_SIDE, Decision, decide, fitted_to_logs, known_numbers
from mjsim.inference.posterior import CompetingModel
from mjsim.instruments.axis_log.measurement import LogTest, recorded_axes
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine


@dataclass(frozen=True)
class Judged:
    """What the logs say of the findings of a ball-bar diagnosis.

    Attributes:
        machine: With the explanations that both instruments support best.
        model: The fit of the ball bar that these are from; nothing where it has found nothing.
        decisions: By the id of the finding in the ball bar's diagnosis.
        support: By how much more log evidence a finding has in the logs than its absence, by id.
        axes: Letters of the recorded axes.
    """

    machine: Machine
    model: CompetingModel | None
    decisions: Mapping[str, Decision]
    support: Mapping[str, float]
    axes: tuple[str, ...] = ()

    def known(self, axes: Sequence[str]) -> dict[str, KnownNumbers]:
        """What the ball bar knows of logged axes."""
        believed = self.machine.factor is None
        return {a: known_numbers(self.model, a, believed) for a in axes} if self.model is not None else {}


class Judge:
    """Judges the ball bar's findings by the logs.

    Args:
        campaign: With recorded axis logs.
        machine: As given.
        threads: Simulations side by side.
    """

    def __init__(self, campaign: Campaign, machine: Machine, threads: int) -> None:
        self.machine, campaign = machine, campaign.of(LogTest.instrument)
        self.axes = recorded_axes(campaign.measured)
        self.fitters = {a: LogFitter(machine, axis_data(campaign, a, machine), threads) for a in self.axes}
        self.gains = {a: read_gains(machine, f.data) for a, f in self.fitters.items()}

    def of(self, bar: Diagnosis, extra: Mapping[str, AxisFit]) -> Judged:
        """What the logs say of every finding.

        Args:
            bar: Diagnosis of the ball-bar tests.
            extra: By axis the fit of what the logs have found beside it.
        """
        chosen, machine, decisions, support = None, bar.machine, {}, {}
        for e in bar.effects:
            if not e.models:
                continue
            chosen = chosen or e.models[0]
            decision = self._decided(e, extra)
            best = e.models[0]
            if decision is not None:
                decisions[e.effect.id] = decision
                best = next(m for m in e.models if m.effect_id == decision.effect_id)
            if best is not e.models[0]:
                if chosen is e.models[0]:
                    chosen, machine = best, _added(best.machine, machine)
                else:
                    other = best.machine.effect(best.effect_id)
                    machine = _without(machine, e.effect, self.machine)
                    machine = machine.with_effect(other) if other is not None else machine
            effect = best.machine.effect(best.effect_id)
            if effect is not None and effect.kind in MOTOR_SIDE and effect.subject in self.axes:
                support[effect.id] = self._support(best, effect, extra)
        if chosen is not None:
            chosen = replace(chosen, machine=machine)
        return Judged(machine, chosen, decisions, support, self.axes)

    def fit(self, axis: str, model: CompetingModel, extra: Mapping[str, AxisFit]) -> AxisFit:
        """One explanation fitted to the logs of an axis, beside what the logs have found there."""
        more = extra[axis].model if axis in extra else None
        return fitted_to_logs(self.fitters[axis], model, self.gains[axis], more, self.machine.factor is None)

    def _decided(self, e: DiagnosedEffect, extra: Mapping[str, AxisFit]) -> Decision | None:
        """Between a finding and its alternatives; nothing where no log has their axes."""
        subjects = {m.effect_id.split("[")[0].partition(".")[2] for m in e.models}
        axes = [a for a in self.axes if a in subjects]
        if len(e.models) < 2 or not axes:
            return None
        return decide(e.models, [[self.fit(a, m, extra) for a in axes] for m in e.models])

    def _support(self, model: CompetingModel, effect: Effect, extra: Mapping[str, AxisFit]) -> float:
        """By how much the logs are better explained with an effect than without it."""
        without = _without(model.machine, effect, self.machine)
        less = model.posterior.within(model.machine.without(effect.key))
        rest = replace(model, machine=without, posterior=less)
        here, there = (self.fit(effect.subject, m, extra) for m in (model, rest))
        return here.evidence - there.evidence

    def again(self, logs: LogDiagnosis, judged: Judged) -> LogDiagnosis:
        """The diagnosis of the logs with the explanations that were chosen last."""
        if judged.model is None:
            return logs
        selections: dict[str, AxisSelection] = {}
        for axis, s in logs.selections.items():
            fitter = self.fitters[axis]
            fit = fitter.polished(self.fit(axis, judged.model, {axis: s.fit}))
            kept = {e.owner for e in fit.model.entries}
            selections[axis] = replace(s, fit=fit, found=tuple(c for c in s.found if c.effect_id in kept))
        return log_diagnosis(logs.campaign, judged.machine, self.fitters, selections, logs.between)


def _without(machine: Machine, effect: Effect, given: Machine) -> Machine:
    """A machine without an effect, or with what the machine as given has of it."""
    former = given.effect(effect.key)
    machine = machine.without(effect.key)
    return machine.with_effect(former) if former is not None else machine


def _added(machine: Machine, other: Machine) -> Machine:
    """A machine with the effects of another that no fit of the readings has, such as vibrations."""
    have = {e.key for e in machine.effects}
    for e in other.effects:
        if e.key not in have and e.kind == "vibration":
            machine = machine.with_effect(e)
    return machine
