"""What the first steps with a cause promise, and where the phases of a wave start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjsim.inference.axis_logs.candidates import Candidate
from mjsim.inference.axis_logs.entries import PHASE, AxisModel, Entry
from mjsim.inference.axis_logs.fit import AxisFit, LogFitter

#: Angle of a wave, rad, that an axis must run through for its phase to be estimated.
_HALF_WAVE = np.pi
#: Steps that are made with every cause.
_FIRST = 2


def take_first_steps(fitter: LogFitter, fit: AxisFit, *causes: Candidate) -> AxisFit:
    """What the first steps with causes, from where they start, make of a fit without them, whose derivatives serve."""
    model = fit.model
    for c in causes:
        model = c.extend(model)
        if c.wave:
            model = with_phases(fitter, fit, model, c)
    anew = {e.label for c in causes for e in c.entries}
    return fitter.fit(model, _FIRST, 1, former=fit, anew=anew, renew=False)


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
    return replace(model, entries=tuple(entries))
