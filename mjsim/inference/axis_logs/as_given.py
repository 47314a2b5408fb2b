"""A machine as it is against recordings of one axis: the nuisances alone are fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjsim.inference.axis_logs.entries import PHASE, AxisModel
from mjsim.inference.axis_logs.fit import AxisFit, LogFitter
from mjsim.inference.axis_logs.start import nuisance_model, waves_of
from mjsim.machine.model import Machine

#: Angles of the screw at the start that are tried before a fit.
_ANGLES = 36


def fit_as_given(fitter: LogFitter, machine: Machine) -> AxisFit:
    """The machine as it is with the nuisances fitted.

    The angle of the screw at the start of a set-up is one number. Every wave over it starts from the best of a
    grid of such angles; phases are then fitted one by one.
    """
    model = nuisance_model(machine, fitter.data)
    waves = waves_of(machine, fitter.data[0].axis)
    if waves:
        model = _turned(fitter, model, waves)
    return fitter.fit(model)


def _turned(fitter: LogFitter, model: AxisModel, waves: dict[str, float]) -> AxisModel:
    """A model whose phases start from the best angle of the screw in every set-up."""
    angles = np.linspace(0.0, 2.0 * np.pi, _ANGLES, endpoint=False) / min(1.0, *waves.values())
    vectors = []
    for angle in angles:
        shifts = [waves[e.name] * angle if e.owner == PHASE else None for e in model.entries]
        vectors.append(np.array([v if s is None else _wrapped(s) for v, s in zip(model.vector, shifts, strict=True)]))
    squares = np.array([[float(r @ r) for r in fitter.residual(model, v)] for v in vectors])
    chosen = {}
    for setup in {d.test.setup for d in fitter.data}:
        mine = [k for k, d in enumerate(fitter.data) if d.test.setup == setup]
        chosen[setup] = vectors[int(np.argmin(np.log(squares[:, mine]).sum(axis=1)))]
    started = [
        replace(e, value=float(chosen[e.where][j]), centre=0.0) if e.owner == PHASE else e
        for j, e in enumerate(model.entries)
    ]
    return AxisModel(model.machine, model.axis, tuple(started))


def _wrapped(angle: float) -> float:
    """An angle between −π and π."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)
