"""What ball-bar tests say about one axis, as prior of a fit of its logs.

The posterior of the ball bar enters the fit of the logs as prior, with all of its covariance. So the result is that of
one fit to the rows of both, as far as those of the ball bar are linear near its fit. The log evidences of both add:
that of the logs is given what the ball bar knows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.inference.axis_logs.data import AxisData
from mjsim.inference.axis_logs.entries import DRIVE, NUISANCES, AxisModel, Entry, KnownNumbers
from mjsim.inference.axis_logs.fit import AxisFit, LogFitter
from mjsim.inference.axis_logs.gains import GainsRead
from mjsim.inference.axis_logs.start import start_model
from mjsim.inference.data_sheet import sheet_of
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.posterior import CompetingModel
from mjsim.inference.search import names_to_tell
from mjsim.machine.model import FRICTION_PARAMETERS

#: Kinds of effects that change the motion of a motor under its control: what an encoder on it sees.
MOTOR_SIDE = (
    "friction",
    "inertia",
    "integral_time",
    "servo_gain",
    "torque_ripple",
    "velocity_feedforward",
    "velocity_gain",
    "viscous_friction",
)
#: Numbers that the vector has as logarithms: they are positive and may be wrong by a factor.
_RATIOS = ("ratio", "coulomb_Nm", "presliding_rad")


@dataclass(frozen=True)
class Decision:
    """What two instruments say about models that one of them cannot tell apart.

    Attributes:
        effect_id: Of the best model.
        bar: By how much less log evidence each other model has for the ball bar, by effect id.
        logs: The same for the axis logs.
        share: Of the probability that the best model has.
        told: Those of the others that both together leave, by effect id.
    """

    effect_id: str
    bar: dict[str, float]
    logs: dict[str, float]
    share: float
    told: dict[str, float]

    @property
    def excluded(self) -> tuple[str, ...]:
        """Ids of the models that both instruments together exclude."""
        return tuple(i for i in self.bar if i not in self.told)


def known_numbers(model: CompetingModel, axis: str, sheet: bool = True) -> KnownNumbers:
    """Numbers of one axis that a ball-bar fit has found, and how well it knows them together.

    Args:
        model: The fit.
        axis: Letter.
        sheet: Also the data sheet of the drive.
    """
    posterior = model.posterior
    out: list[tuple[Entry, int]] = []  # with the place of each in the posterior
    for f, at in posterior.blocks:
        if f.effect.subject == axis and f.effect.kind in MOTOR_SIDE and not f.polar:
            out += zip(_of_effect(model, f, posterior.part(at)), at, strict=True)
    if sheet:
        sd = np.sqrt(np.maximum(np.diag(posterior.part(posterior.sheet)), 0.0))
        drive = model.machine.drives[axis]
        labels = {e.label for e, _ in out}
        for p, deviation, place in zip(sheet_of(model.machine), sd, posterior.sheet, strict=True):
            if p.axis != axis:
                continue
            if p.name in FRICTION_PARAMETERS:
                friction, name = model.machine.effect(f"friction.{axis}"), FRICTION_PARAMETERS[p.name]
                owner = f"friction.{axis}"
                value = friction.values[name] if friction is not None else 0.0
            else:
                owner, name, value = DRIVE, p.name, getattr(drive, p.name)
            entry = _positive(owner, name, value, max(p.sd * deviation, 1e-6)) if value > 0.0 else None
            if entry is not None and np.isfinite(value) and entry.label not in labels:
                out.append((entry, place))
    entries, covariance = tuple(e for e, _ in out), posterior.part([place for _, place in out])
    spread = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    correlation = covariance / np.outer(spread, spread)  # every number of both vectors rises with its value
    np.fill_diagonal(correlation, 1.0)  # also of one that the fit held
    deviation = np.array([e.deviation for e in entries])
    return KnownNumbers(entries, correlation * np.outer(deviation, deviation))


def _of_effect(model: CompetingModel, f: EffectVector, covariance: np.ndarray) -> list[Entry]:
    """The free numbers of one effect."""
    effect = model.machine.effect(f.effect.key)
    assert effect is not None
    ends, out = f.interval(f.vector, covariance, z=1.0), []
    for name in f.names:
        p, value = f.specs[name], effect.values[name]
        spread = max(0.5 * (ends[name][1] - ends[name][0]), 1e-6 * p.scale)
        if name in _RATIOS and value > 0.0:
            out.append(replace(_positive(effect.id, name, value, spread / value), lower=p.lower, upper=p.upper))
        else:
            scale = p.scale
            out.append(Entry(effect.id, name, value, "", spread / scale, scale=scale, lower=p.lower, upper=p.upper))
    return [replace(e, lower=max(e.lower, 1e-9)) if e.log else e for e in out]


def _positive(owner: str, name: str, value: float, deviation: float) -> Entry:
    return Entry(owner, name, value, "", deviation, log=True, lower=value * 1e-3, upper=value * 1e3, centre=value)


def fitted_to_logs(
    fitter: LogFitter,
    model: CompetingModel,
    gains: Sequence[GainsRead],
    extra: AxisModel | None = None,
    believed: bool = True,
) -> AxisFit:
    """One explanation of the ball-bar tests fitted to the logs of an axis.

    Args:
        fitter: Of the logs.
        model: The explanation.
        gains: Read back from recorded outputs.
        extra: A model of the axis with further causes that the logs need, whose entries and effects are taken over.
        believed: Whether the data sheet is believed as the ball bar has it.
    """
    axis = fitter.data[0].axis
    start = start_model(model.machine, fitter.data, gains, known_numbers(model, axis, believed))
    if extra is not None:
        start = _with_extra(start, extra, fitter.data)
    return fitter.fit(start)


def _with_extra(start: AxisModel, extra: AxisModel, data: Sequence[AxisData]) -> AxisModel:
    """A model with those effects of another one that it does not have, and their entries."""
    mine = {e.id for e in start.machine.effects}
    for effect in extra.machine.effects:
        if effect.subject == data[0].axis and effect.id not in mine:
            entries = [e for e in extra.entries if e.owner == effect.id]
            if entries:
                start = start.extended(effect, entries)
    kept = {e.label for e in start.entries}
    phases = [e for e in extra.entries if e.owner in NUISANCES and e.label not in kept]
    return replace(start, entries=(*start.entries, *phases))


def decide(models: Sequence[CompetingModel], fits: Sequence[Sequence[AxisFit]]) -> Decision:
    """Which of several explanations both instruments support best.

    Args:
        models: The explanations.
        fits: For each of them its fits to the logs, one per axis.
    """
    logs = [sum(f.evidence for f in row) for row in fits]
    joint = [replace(m, evidence=m.evidence + e) for m, e in zip(models, logs, strict=True)]
    best = max(range(len(models)), key=lambda j: joint[j].evidence)
    others = [j for j in range(len(models)) if j != best]
    share, told = names_to_tell([(joint[j].effect_id, joint[j]) for j in others], joint[best].evidence)
    return Decision(
        models[best].effect_id,
        {models[j].effect_id: models[best].evidence - models[j].evidence for j in others},
        {models[j].effect_id: logs[best] - logs[j] for j in others},
        share,
        {i: p for i, (p, _) in told.items()},
    )
