"""Derivatives of modelled block means with respect to what is free in the model of an axis: by differences.

A phase of a wave needs no simulation: turning a wave by a small angle adds a part of its cosine to its sine, and the
derivatives with respect to these two parts are there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from mjsim.inference.axis_logs.data import AxisData
from mjsim.inference.axis_logs.entries import (
    CONTROLLER,
    NUISANCES,
    OUTPUT_ZERO,
    PER_TORQUE,
    PHASE,
    START_TORQUE,
    ZERO,
    AxisModel,
)
from mjsim.machine.plant import AxisPlant

#: Step of numerical derivatives, units of the vector.
_STEP = 1e-3
#: An axis as each controller runs it, by the controller's name.
AxisRuns = Mapping[str | None, AxisPlant]


class Simulator(Protocol):
    """What simulates the recordings of an axis: :class:`mjsim.inference.axis_logs.fit.LogFitter`."""

    data: tuple[AxisData, ...]
    rows: tuple[AxisData, ...]
    rows_of: list[tuple[int, ...]]
    measured: list[np.ndarray]

    def axes(self, model: AxisModel, vector: np.ndarray) -> AxisRuns: ...
    def means(self, axes: AxisRuns, model: AxisModel, vector: np.ndarray, k: int) -> tuple[np.ndarray, ...]: ...
    def map(self, jobs: Sequence) -> list: ...


def columns(
    fitter: Simulator,
    model: AxisModel,
    vector: np.ndarray,
    residual: Sequence[np.ndarray],
    entries: Sequence[int] | None = None,
    central: bool = False,
) -> tuple[np.ndarray, ...]:
    """Derivatives of the modelled block means, (blocks, len(entries)) per row.

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
    of_entry = {j: [k for k in range(len(fitter.data)) if _shows(fitter, model, j, k)] for j in which}
    shown = {j: [i for k in of_entry[j] for i in fitter.rows_of[k]] for j in which}

    def moved(j: int, by: float) -> list[np.ndarray]:
        """Modelled block means of the recordings that an entry changes, with the entry moved."""
        other = vector.copy()
        other[j] += by
        axes = now if model.entries[j].owner in NUISANCES else fitter.axes(model, other)
        return [x for k in of_entry[j] for x in fitter.means(axes, model, other, k)]

    def slopes(j: int) -> list[np.ndarray]:
        e = model.entries[j]
        if e.owner in (ZERO, OUTPUT_ZERO):  # simply added
            mine = [fitter.rows[i].is_position == (e.owner == ZERO) for i in shown[j]]
            return [np.full(len(residual[i]), e.scale * there) for i, there in zip(shown[j], mine, strict=True)]
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
            most = fitter.rows[k].lost / _STEP
            out[k][:, at[j]] = np.clip(np.nan_to_num(column), -most, most)
    for j, (cosine, sine) in parts.items():
        for k in shown[j]:
            out[k][:, at[j]] = vector[cosine] * out[k][:, at[sine]] - vector[sine] * out[k][:, at[cosine]]
    return out


def along_torques(
    fitter: Simulator, model: AxisModel, vector: np.ndarray, design: Sequence[np.ndarray]
) -> tuple[np.ndarray, ...]:
    """Derivatives that are right along one direction: all torques of an axis larger by one share.

    Where all of them are free, the motion stays as it is. Derivatives by each, with the kinks of a limit in them, do
    not cancel exactly, and a number would be known that no recording shows.

    Args:
        fitter: Simulates.
        model: What is free.
        vector: Where.
        design: Derivatives there, (blocks, p) per row.
    """
    way = torque_direction(model, vector)
    if not way.any():
        return tuple(design)
    ends = []
    for by in (_STEP, -_STEP):
        at = vector + by * way
        axes = fitter.axes(model, at)
        found = fitter.map([(fitter.means, axes, model, at, k) for k in range(len(fitter.data))])
        ends.append(
            {i: x for rows, xs in zip(fitter.rows_of, found, strict=True) for i, x in zip(rows, xs, strict=True)}
        )
    slopes = [(ends[0][i] - ends[1][i]) / (2.0 * _STEP) for i in range(len(design))]
    return tuple(d + np.outer(s - d @ way, way) / (way @ way) for d, s in zip(design, slopes, strict=True))


def torque_direction(model: AxisModel, vector: np.ndarray) -> np.ndarray:
    """How a vector (p,) changes where all torques that are free grow by one share, (p,)."""
    out = np.zeros(len(model.entries))
    for j, e in enumerate(model.entries):
        effect = model.machine.effect(e.owner)
        amplitudes = [p.name for p in effect.parameters_of(effect.subject)] if effect is not None else []
        is_wave = e.name.startswith(("cosine", "sine"))
        of_wave = effect is not None and (effect.kind == "cogging" or "amplitude_Nm" in amplitudes)
        grows = e.name in ("inertia", "viscous", "velocity_gain", START_TORQUE) or e.name.endswith("_Nm")
        if grows or (is_wave and of_wave):
            out[j] = 1.0 if e.log else vector[j]
        elif e.owner == PER_TORQUE:
            out[j] = -vector[j]
    return out


def _shows(fitter: Simulator, model: AxisModel, j: int, k: int) -> bool:
    """Whether an entry of the vector changes recording ``k``."""
    e, d = model.entries[j], fitter.data[k]
    if e.owner == CONTROLLER:
        return e.where == d.test.controller
    if e.owner == PHASE:
        return e.where == d.test.setup
    if e.owner == PER_TORQUE:
        return any(e.where == fitter.rows[i].channel for i in fitter.rows_of[k])
    return e.owner not in NUISANCES or e.where == d.name


def _parts_of(model: AxisModel, j: int) -> tuple[int, int] | None:
    """Places of the two parts of the wave whose phase an entry is."""
    e = model.entries[j]
    if e.owner != PHASE:
        return None
    kind, _, order = e.name.partition(" ")
    cosine, sine = (model.place(f"{kind}.{model.axis}.{part} {order}".rstrip()) for part in ("cosine", "sine"))
    return None if cosine is None or sine is None else (cosine, sine)
