"""Torques that vary with the motor's angle: which orders stand out of what a model leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjsim.inference.axis_logs.data import AxisData
from mjsim.inference.axis_logs.fit import AxisFit, LogFitter
from mjsim.inference.axis_logs.gains import torque_against
from mjsim.machine.model import build

#: Highest order that is looked at, cycles per motor revolution; orders this far apart are two; an order is whole where
#: it lies nearer to one than this, and the recording cannot tell (assumed).
_HIGHEST, APART, _NEAR = 24.0, 0.3, 0.13
#: Waves that the travel of a recording must cover for it to show an order.
_COVERED = 0.7
#: Share of the largest speed below which an axis stands; blocks that a wave needs; cells of the angle per revolution.
_STANDS, _PER_WAVE, _CELLS = 0.02, 4.0, 256


def missing_torque(fitter: LogFitter, fit: AxisFit, k: int) -> np.ndarray:
    """Torque against the motor that recording ``k`` has beside the model's, block means (blocks,) N·m.

    It is what the linear part of the loop needs for the residual: that of the control less those of inertia and
    viscous friction.
    """
    d = fitter.data[k]
    axis = build(fit.model.machine.under(d.test.controller)).axes[d.axis]
    residual = d.record.actual - fitter.positions(fit.model, fit.model.vector, k)
    against = d.means(torque_against(axis, d, residual))
    speed = np.gradient(d.means(residual) * axis.gear, d.block * d.step)
    return -against - axis.viscous * speed - axis.inertia * np.gradient(speed, d.block * d.step)


def strongest_orders(fitter: LogFitter, fit: AxisFit, most: int = 3) -> list[float]:
    """Orders of torque ripple that explain most of the missing torque while the axis moves, the strongest first."""
    gear = fit.model.machine.drives[fit.model.axis].gear
    spectra = [_spectrum(*_moving(d, missing_torque(fitter, fit, k), gear)) for k, d in enumerate(fitter.data)]
    turns = max(s.turns for s in spectra)
    orders = np.arange(0.5, _HIGHEST, min(0.25, 0.25 / turns))
    gain = np.zeros(len(orders))
    for s, independent in zip(spectra, fit.independent, strict=False):  # of the positions
        seen = (orders <= s.highest) & (orders * s.turns >= _COVERED)
        share = np.where(seen, np.interp(orders, s.orders, s.share), 0.0)
        gain -= independent * s.moving * np.log(1.0 - share)
    inner = np.concatenate([[0.0], gain, [0.0]])
    peak = np.flatnonzero((gain >= inner[:-2]) & (gain >= inner[2:]) & (gain > 0.0))
    best = orders[peak[np.argsort(-gain[peak])][:most]]
    return list(dict.fromkeys(_whole(float(order), turns) for order in best))


def orders_over(angle: np.ndarray, values: np.ndarray, most: int = 3) -> list[float]:
    """Orders of the waves over a motor's angle (n,) rad that explain most of some values (n,), the strongest first."""
    rate = np.abs(np.gradient(angle))
    moves = rate > _STANDS * rate.max()
    if moves.sum() < _CELLS:
        return []
    s = _spectrum(angle[moves], values[moves], 1.0)
    orders = np.arange(0.5, min(_HIGHEST, s.highest), min(0.25, 0.25 / max(s.turns, 1e-9)))
    orders = orders[orders * s.turns >= _COVERED]
    share = np.concatenate([[0.0], np.interp(orders, s.orders, s.share), [0.0]])
    peak = np.flatnonzero((share[1:-1] >= share[:-2]) & (share[1:-1] >= share[2:]))
    return [_whole(float(orders[i]), s.turns) for i in peak[np.argsort(-share[1:-1][peak])][:most]]


@dataclass(frozen=True)
class _Spectrum:
    """Share of a torque's mean square that one wave explains.

    Attributes:
        orders: Cycles per revolution, (n,).
        share: (n,), below 1.
        highest: Order up to which the blocks resolve a wave.
        turns: Revolutions that the axis covers.
        moving: Share of the blocks in which it moves.
    """

    orders: np.ndarray
    share: np.ndarray
    highest: float
    turns: float
    moving: float


def _spectrum(angle: np.ndarray, torque: np.ndarray, moving: float) -> _Spectrum:
    """Spectrum of a torque over the angle, without its means in the two directions."""
    rate = np.gradient(angle)
    for way in (rate > 0.0, rate <= 0.0):
        torque = torque - np.where(way, torque[way].mean() if way.any() else 0.0, 0.0)
    turns = float(np.ptp(angle)) / (2.0 * np.pi)
    cell = ((angle - angle.min()) / (2.0 * np.pi) * _CELLS).astype(int)
    sums = np.bincount(cell, torque)
    size = 4 * max(len(sums), _CELLS)
    power = np.abs(np.fft.rfft(sums, size)) ** 2
    share = 2.0 * power / max(len(torque) * float(torque @ torque), 1e-30)
    highest = 2.0 * np.pi / (_PER_WAVE * float(np.median(np.abs(rate))))
    return _Spectrum(np.arange(len(power)) * _CELLS / size, np.minimum(share, 0.99), highest, turns, moving)


def _moving(d: AxisData, torque: np.ndarray, gear: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Angle and torque of the blocks in which the axis moves, and their share of all."""
    angle = d.means(d.record.actual) * gear
    rate = np.abs(np.gradient(angle))
    moves = rate > _STANDS * rate.max()
    return angle[moves], torque[moves], float(moves.mean())


def _whole(order: float, turns: float) -> float:
    """A whole order where the recording cannot tell it from one."""
    near = round(order)
    return float(near) if near and abs(order - near) < min(_NEAR, 0.5 / turns) else round(order, 3)


def near(order: float, others: Sequence[float]) -> bool:
    """Whether an order is one of those that are there."""
    return any(abs(order - other) < APART for other in others)
