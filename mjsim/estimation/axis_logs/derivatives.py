"""Derivatives of modelled block means with respect to what is free in the model of an axis: by differences.

A phase of a wave needs no simulation: turning a wave by a small angle adds a part of its cosine to its sine, and the
derivatives with respect to these two parts are there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from mjsim.estimation.axis_logs.data import AxisData
from mjsim.estimation.axis_logs.entries import CONTROLLER, NUISANCES, PHASE, ZERO, AxisModel
from mjsim.machine.plant import AxisPlant

#: Step of numerical derivatives, units of the vector.
_STEP = 1e-3
#: A residual beyond so many metres or radians belongs to a model that has run away.
LOST = 0.1
#: An axis as each controller runs it, by the controller's name.
AxisRuns = Mapping[str | None, AxisPlant]


class Simulator(Protocol):
    """What simulates the recordings of an axis: :class:`mjsim.estimation.axis_logs.fit.LogFitter`."""

    data: tuple[AxisData, ...]
    measured: list[np.ndarray]

    def axes(self, model: AxisModel, vector: np.ndarray) -> AxisRuns: ...
    def means(self, axes: AxisRuns, model: AxisModel, vector: np.ndarray, k: int) -> np.ndarray: ...
    def map(self, jobs: Sequence) -> list: ...


def columns(
    fitter: Simulator,
    model: AxisModel,
    vector: np.ndarray,
    residual: Sequence[np.ndarray],
    entries: Sequence[int] | None = None,
    central: bool = False,
) -> tuple[np.ndarray, ...]:
    """Derivatives of the modelled block means, (blocks, len(entries)) per recording.

    Args:
        fitter: Simulates.
        model: What is free.
        vector: Where.
        residual: There.
        entries: Places in the vector; all by default.
        central: By differences to both sides: what the recordings cannot separate looks separable otherwise.
    """
    which = list(range(len(vector)) if entries is None else entries)
    at = {j: i for i, j in enumerate(which)}
    parts = {j: p for j in which if (p := _parts_of(model, j)) is not None and at.keys() >= set(p)}
    now = fitter.axes(model, vector)
    shown = {j: [k for k in range(len(fitter.data)) if _shows(fitter, model, j, k)] for j in which}

    def moved(j: int, by: float) -> list[np.ndarray]:
        """Modelled block means of the recordings that an entry changes, with the entry moved."""
        other = vector.copy()
        other[j] += by
        axes = now if model.entries[j].owner in NUISANCES else fitter.axes(model, other)
        return [fitter.means(axes, model, other, k) for k in shown[j]]

    def slopes(j: int) -> list[np.ndarray]:
        if model.entries[j].owner == ZERO:  # simply added
            return [np.full(len(residual[k]), model.entries[j].scale) for k in shown[j]]
        low, high = model.entries[j].bounds
        step = _STEP if vector[j] + _STEP <= high else -_STEP
        if central and low + _STEP < vector[j] < high - _STEP:
            both = zip(moved(j, step), moved(j, -step), strict=True)
            return [(a - b) / (2.0 * step) for a, b in both]
        step = max(vector[j] + step, low) - vector[j]
        return [(a - (fitter.measured[k] - residual[k])) / step for k, a in zip(shown[j], moved(j, step), strict=True)]

    out = tuple(np.zeros((len(r), len(which))) for r in residual)
    simulated = [j for j in which if j not in parts]
    for j, found in zip(simulated, fitter.map([(slopes, j) for j in simulated]), strict=True):
        for k, column in zip(shown[j], found, strict=True):
            out[k][:, at[j]] = np.clip(np.nan_to_num(column), -LOST / _STEP, LOST / _STEP)
    for j, (cosine, sine) in parts.items():
        for k in shown[j]:
            out[k][:, at[j]] = vector[cosine] * out[k][:, at[sine]] - vector[sine] * out[k][:, at[cosine]]
    return out


def _shows(fitter: Simulator, model: AxisModel, j: int, k: int) -> bool:
    """Whether an entry of the vector changes recording ``k``."""
    e, d = model.entries[j], fitter.data[k]
    if e.owner == CONTROLLER:
        return e.where == (d.test.controller or next(iter(model.machine.controllers)))
    if e.owner == PHASE:
        return e.where == d.test.setup
    return e.owner not in NUISANCES or e.where == d.name


def _parts_of(model: AxisModel, j: int) -> tuple[int, int] | None:
    """Places of the two parts of the wave whose phase an entry is."""
    e = model.entries[j]
    if e.owner != PHASE:
        return None
    kind, _, order = e.name.partition(" ")
    cosine, sine = (model.place(f"{kind}.{model.axis}.{part} {order}".rstrip()) for part in ("cosine", "sine"))
    return None if cosine is None or sine is None else (cosine, sine)
