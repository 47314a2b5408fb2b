"""Amplitude over peaks per turn (paper, Fig. 3), with the amplitude that noise alone gives at every order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.inference.pitch.components import noise_excess, threshold
from mjsim.inference.pitch.curve import Curve
from mjsim.inference.pitch.directions import HIGHEST, TurnDirection
from mjsim.inference.pitch.model import PitchModel, State
from mjsim.inference.pitch.terms import UNIT, Wave
from mjsim.units import DEG


@dataclass(frozen=True)
class Spectrum:
    """(m,) each: order per turn, and in degrees the modified curve's amplitude, noise alone (RMS), and what a
    component must exceed.
    """

    orders: np.ndarray
    amplitude: np.ndarray
    floor: np.ndarray
    limit: np.ndarray


def amplitude(position: np.ndarray, value: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Amplitude of ``value`` (n,) at positions ``position`` (n,) rad, evenly weighted over the position, at
    ``orders`` (m,).
    """
    weight = np.abs(np.gradient(position))
    kernel = np.exp(-1j * orders[:, None] * position)
    return 2.0 * np.abs(kernel @ (weight * value)) / weight.sum()


def spectrum(model: PitchModel, state: State, direction: TurnDirection, curve: Curve) -> Spectrum:
    """Spectrum of one direction's modified curve at whole orders from 1 to the highest."""
    orders = np.arange(1.0, HIGHEST + 1.0)
    columns = np.vstack([_whitened(model, state, direction, k, orders) for k in direction.tests])
    rest = np.concatenate([model.whitened(k, model.residual(k, state)) for k in direction.tests])
    own = 0.5 * np.einsum("ij,ij->j", columns, columns).reshape(-1, 2).sum(axis=1)
    own = np.maximum(own, 1e-9 * own.max())
    gain = ((rest @ columns) ** 2).reshape(-1, 2).sum(axis=1) / own
    raised = noise_excess(gain, orders, model.settings.floor_orders)
    floor = np.sqrt(2.0 * raised / own) * UNIT / DEG
    limit = np.sqrt(threshold(2 * HIGHEST, model.settings.false_alarm) * raised / own) * UNIT / DEG
    return Spectrum(orders, amplitude(curve.position, curve.modified, orders) / DEG, floor, limit)


def _whitened(model: PitchModel, state: State, direction: TurnDirection, k: int, orders: np.ndarray) -> np.ndarray:
    """Sine and cosine of all orders, whitened, (rows, 2 m)."""
    s, shift = model.problem.samples[k], model.problem.shift(k, state.nuisance)
    x, factor = (
        s.sample(model.position[k][direction.axis], shift),
        s.sample(model.factor(k, Wave(direction.axis, direction.direction, 1.0)), shift),
    )
    wave = UNIT * factor[:, None] * np.exp(1j * orders * x[:, None])
    return model.whitened(k, np.stack([wave.imag, wave.real], axis=2).reshape(len(x), -1))
