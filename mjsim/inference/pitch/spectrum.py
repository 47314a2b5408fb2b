"""Amplitude over peaks per turn (paper, Fig. 3), with the amplitude that noise alone gives at every order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.effects import registry
from mjsim.inference.fit import Fit
from mjsim.inference.hypotheses import WIDTHS, prior_log_odds
from mjsim.inference.pitch.curve import Curve, reached
from mjsim.inference.pitch.directions import TurnDirection
from mjsim.inference.problem import Problem
from mjsim.inference.search import LEAST
from mjsim.inference.spectrum import HIGHEST_ROTARY
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


def spectrum(problem: Problem, fit: Fit, direction: TurnDirection, line: Curve) -> Spectrum:
    """Spectrum of one direction's modified curve at whole orders from 1 to the highest.

    Args:
        problem: The tests with the whitening of the model.
        fit: The model.
        direction: Of the axis.
        line: Its curves.
    """
    orders = np.arange(1.0, HIGHEST_ROTARY + 1.0)
    columns = np.vstack([_whitened(problem, fit, direction, k, orders) for k in direction.tests])
    own = 0.5 * np.einsum("ij,ij->j", columns, columns).reshape(-1, 2).sum(axis=1)
    own = np.maximum(own, 1e-9 * own.max())
    one, subject = registry.effect_class(f"pitch_error.{direction.axis}", problem.chain)
    unit = one.parameters_of(subject)[0].scale
    log_odds = prior_log_odds(one(subject, components=[], direction=direction.direction), 1)
    limit = unit * least_amplitude(own * (unit * DEG) ** 2, log_odds)
    return Spectrum(orders, amplitude(line.position, line.modified, orders) / DEG, np.sqrt(2.0 / own) / DEG, limit)


def least_amplitude(information: np.ndarray, log_odds: float) -> np.ndarray:
    """Amplitude from which the evidence for a wave is what the search asks for, (m,) typical sizes.

    Args:
        information: About its sine and its cosine, (m,) each.
        log_odds: Logarithm of its prior odds.
    """
    share = information[:, None] / (information[:, None] + WIDTHS**-2.0)
    need = LEAST - log_odds + np.log(len(WIDTHS)) + np.log1p(information[:, None] * WIDTHS**2)
    return np.sqrt((2.0 * need / (share * information[:, None])).min(axis=1))


def _whitened(problem: Problem, fit: Fit, direction: TurnDirection, k: int, orders: np.ndarray) -> np.ndarray:
    """Sine and cosine of all orders, m per rad, whitened, (rows, 2 m)."""
    x, per_rad = reached(problem, fit, k, direction.axis)
    waves = np.stack([side(orders * x[:, None]) for side in (np.sin, np.cos)], axis=2)
    return problem.whiten_test(k, per_rad[:, None] * waves.reshape(len(x), -1))
