"""What one linear step with a cause promises, and where the phases of a wave start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.estimation.axis_logs.candidates import Candidate
from mjsim.estimation.axis_logs.entries import PHASE, AxisModel, Entry
from mjsim.estimation.axis_logs.fit import AxisFit, LogFitter, priors_of
from mjsim.estimation.axis_logs.likelihood import Gain
from mjsim.machine.effect import Effect

#: Angle of a wave, rad, that an axis must run through for its phase to be estimated.
_HALF_WAVE = np.pi


@dataclass(frozen=True)
class LinearStep:
    """One linear step with a cause.

    Attributes:
        candidate: The cause.
        model: With the cause, at the start.
        vector: Of the model, with the cause's entries after the step, (p,).
        left: Residuals after the step, (n,) per recording.
    """

    candidate: Candidate
    model: AxisModel
    vector: np.ndarray
    left: Sequence[np.ndarray]

    @property
    def effect(self) -> Effect:
        """The cause after the step, of which no entry goes farther than in a fit."""
        start, largest = self.model.vector, priors_of(self.model).largest
        effect = self.model.at(start + np.clip(self.vector - start, -largest, largest)).effect(self.candidate.effect.id)
        assert effect is not None
        return effect

    def gain(self, before: AxisFit, fitter: LogFitter, penalty: float) -> Gain:
        """What the step explains beyond the fit ``before``, less the ``penalty`` of every entry beyond the first."""
        more = len(self.model.entries) - len(before.model.entries) - 1
        return Gain.of(before.residual, self.left, fitter.independent(self.left), fitter.noise).less(penalty * more)


def linear_step(fitter: LogFitter, fit: AxisFit, candidate: Candidate) -> LinearStep:
    """What one linear step with a cause leaves of the residuals of a fit without it."""
    model = candidate.extend(fit.model)
    if candidate.wave:
        model = with_phases(fitter, fit, model, candidate)
    names = {e.label for e in candidate.entries}
    vector = model.vector
    residual = fitter.residual(model, vector)
    new = [j for j, e in enumerate(model.entries) if e.label in names or fit.model.place(e.label) is None]
    columns = fitter.columns(model, vector, residual, new)
    old = [j for j, e in enumerate(fit.model.entries) if model.place(e.label) is not None and e.label not in names]
    deviation = np.array(
        [fit.model.entries[j].deviation for j in old] + [model.entries[j].deviation for j in new], dtype=float
    )
    size = [np.hstack([d[:, old], c]) * w for d, c, w in zip(fit.design, columns, fit.weight, strict=True)]
    white = [r * w for r, w in zip(residual, fit.weight, strict=True)]
    design, target = np.vstack(size), np.concatenate(white)
    normal = design.T @ design + np.diag(deviation**-2.0)
    step = np.linalg.solve(normal + 1e-9 * np.diag(np.diag(normal)), design.T @ target)
    bounds = [fit.model.entries[j].bounds for j in old] + [model.entries[j].bounds for j in new]
    now = np.array([fit.model.vector[j] for j in old] + [vector[j] for j in new])
    step = np.clip(now + step, *np.array(bounds).T) - now
    parts = zip(white, size, fit.weight, strict=True)
    left = [(r - columns @ step) / w for r, columns, w in parts]
    vector[new] += step[len(old) :]
    return LinearStep(candidate, model, vector, left)


def with_phases(fitter: LogFitter, fit: AxisFit, model: AxisModel, candidate: Candidate) -> AxisModel:
    """A model with a wave over the screw's angle: its phase is each set-up's own, started from a linear fit."""
    kind, parts = candidate.wave, [e.label for e in candidate.entries]
    i, j = (model.place(label) for label in parts)
    assert i is not None and j is not None
    zero = model.vector
    zero[[i, j]] = 1e-6, 0.0
    columns = fitter.columns(model, zero, fit.residual, [i, j])
    waves: dict[str, list[np.ndarray]] = {d.test.setup: [] for d in fitter.data}
    order, gear = candidate.cycles, model.machine.drives[model.axis].gear
    for k, d in enumerate(fitter.data):
        if np.ptp(d.record.actual) * gear * order < _HALF_WAVE and d.test.setup != fitter.first_setup:
            continue  # it cannot tell the phase
        design = np.hstack([columns[k], fit.design[k]]) * fit.weight[k]
        wide = np.array([e.deviation for e in candidate.entries] + [e.deviation for e in fit.model.entries])
        ridge = np.where(wide > 0.0, np.maximum(wide, 1e-9), 1e3) ** -2.0
        part = np.linalg.solve(design.T @ design + np.diag(ridge), design.T @ (fit.residual[k] * fit.weight[k]))
        waves[d.test.setup].append(part[:2])
    means = {setup: np.mean(parts, axis=0) for setup, parts in waves.items() if parts}
    first = means[fitter.first_setup]
    amplitude = float(np.mean([np.hypot(*w) for w in means.values()]))
    angle = float(np.arctan2(first[1], first[0]))
    entries = []
    for e in model.entries:
        if e.label in parts:
            value = amplitude * (np.cos(angle) if e.label == parts[0] else np.sin(angle)) * e.scale
            entries.append(replace(e, value=float(value)))
        elif e.owner != PHASE or e.name != kind:
            entries.append(e)
    for setup in waves:
        if setup != fitter.first_setup:
            wave = means.get(setup, first)
            turned = float(np.arctan2(wave[1], wave[0])) - angle
            entries.append(Entry(PHASE, kind, turned, setup, deviation=10.0))
    return AxisModel(model.machine, model.axis, tuple(entries))
