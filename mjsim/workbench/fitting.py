"""Fits of the workbench: one effect, or all that were put into the model."""

from __future__ import annotations

from dataclasses import dataclass

from mjsim.errors import InputError
from mjsim.estimation.effect_vector import EffectVector
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.threads import one_blas_thread
from mjsim.workbench.gains import Gains
from mjsim.workflow.edit import best_effect, resolve_effect


@dataclass(frozen=True)
class Fitted:
    """Effects at their best values.

    Attributes:
        machine: The model with them.
        intervals: 95 % intervals by the effect's key and the parameter's name, in the units of the names.
    """

    machine: Machine
    intervals: dict[str, dict]


def names_of(effect: Effect) -> tuple[str, ...]:
    """Names of the parameters of an effect that a fit sets free."""
    return effect.search.free_of(effect.parameters_of(effect.subject))


@one_blas_thread
def fit(gains: Gains, machine: Machine, effects: list[Effect]) -> Fitted:
    """Fit some effects together with set-up, instrument and data sheet; of these, only the effects enter the model.

    Args:
        gains: Of the campaign.
        machine: The model; it need not have the effects.
        effects: Where the fit starts.

    Raises:
        InputError: None of them changes a reading of this campaign.
    """
    usual = [e for e in effects if e.kind != "vibration"]
    intervals: dict[str, dict] = {}
    for e in effects:
        if e.kind == "vibration":
            machine, intervals[e.key] = _fit_from_file(gains, machine, e.id)
    if usual:
        with gains.turn:
            fitter = gains.fitter(machine)
            free = [EffectVector(e, names_of(e)) for e in usual]
            near = fitter.fit(free, exact=False)
            result = fitter.fit(near.effects, start=near)
        for f in result.effects:
            machine = machine.with_effect(f.effect)
            intervals[f.effect.key] = f.interval(f.vector, result.covariance_of(f))
    return Fitted(machine, intervals)


@one_blas_thread
def fit_new(gains: Gains, machine: Machine, effect_id: str) -> Fitted:
    """Fit an effect that the model lacks, from all its starting points, as ``mjsim add`` does.

    Args:
        gains: Of the campaign.
        machine: The model.
        effect_id: ``kind.SUBJECT``.

    Raises:
        InputError: There is no such effect, or it changes no reading of this campaign.
    """
    machine, intervals = _fit_from_file(gains, machine, effect_id)
    return Fitted(machine, {effect_id: intervals})


def _fit_from_file(gains: Gains, machine: Machine, effect_id: str) -> tuple[Machine, dict]:
    cls, subjects, _ = resolve_effect(effect_id, machine.chain)
    problem = gains.opened.background
    if problem is None:
        raise InputError(f"effect {effect_id}: nothing to fit; no test of the campaign has a trace")
    with gains.turn:
        effect, intervals = best_effect(problem, machine, cls, subjects)
    return machine.with_effect(effect), intervals
