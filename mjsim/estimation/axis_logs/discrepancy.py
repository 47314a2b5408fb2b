"""What a model leaves of axis logs beside the noise: a process in time whose size is estimated.

As for the ball bar (:mod:`mjsim.estimation.discrepancy`), no model of a drive is complete, and what it leaves is no
noise: it is correlated. So every recording has a discrepancy ``d``, a sum of cosines over its time with independent
normal amplitudes:

    d(t) = Σ aₙ cos(π n (t + ½ h)/T),   Var aₙ = σ²(octave of n)

T is the length of the recording, h the length of a block. The variances are constant in every octave, as in
:mod:`mjsim.estimation.axis_logs.likelihood`, and zero where a model explains everything. They are those of the largest
evidence, with the parameters of the model marginalised (MacKay, "Bayesian interpolation", Neural Computation 4 (1992)
415-447). The evidence of a cause is that beside it: what a cause explains counts for little where as much is left.

What a sound machine may leave follows from its tolerance, as stated or as is typical. The friction of an axis is as
stated only within it, and another one at each place and at each hour, which no model has. What this does to the
recording is allowed, up to the pitch error of its class, and beside it one step of the encoder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import dct
from scipy.special import ndtr

from mjsim.campaign.tolerance import RATIO, TYPICAL_TOLERANCE
from mjsim.estimation.axis_logs.data import AxisData
from mjsim.estimation.axis_logs.entries import AxisModel
from mjsim.estimation.discrepancy import marginalised
from mjsim.machine.model import Machine
from mjsim.units import DEG, UM

#: The lowest frequencies share one variance up to this one, in half waves over the recording: each alone says nothing.
_LOWEST = 8
#: How often the variances are taken anew.
_ROUNDS = 6
#: Largest prior standard deviation of an entry, in units of the vector: evidence needs a proper prior (assumed: thirty
#: times what is typical of an effect).
_WIDEST = 30.0


@dataclass(frozen=True)
class LogDiscrepancy:
    """What a fitted model leaves of the recordings of an axis.

    Attributes:
        evidence: Log evidence of the recordings, the model's entries marginalised.
        left: RMS of the discrepancy in each recording, axis units.
        allowed: RMS that a sound machine may leave in each, axis units.
        beyond: Probability for each that more than that is left.
    """

    evidence: float
    left: tuple[float, ...]
    allowed: tuple[float, ...]
    beyond: tuple[float, ...]

    @property
    def probability(self) -> float:
        """That more is left than a sound machine leaves, in the recording that shows it best."""
        return max(self.beyond)


def allowed_in(
    machine: Machine, model: AxisModel, design: Sequence[np.ndarray], data: Sequence[AxisData]
) -> tuple[float, ...]:
    """RMS that a sound machine may leave in each recording, axis units.

    Args:
        machine: As given, with its tolerance.
        model: With the friction of the axis.
        design: Derivatives of the modelled block means, (blocks, p) per recording.
        data: The recordings.
    """
    limits, most = (machine.tolerance or TYPICAL_TOLERANCE).get("friction", {}), pitch_limit(machine, model.axis)
    place, out = model.place(f"friction.{model.axis}.coulomb_Nm"), []
    for d, columns in zip(data, design, strict=True):
        friction = 0.0
        if place is not None:
            e = model.entries[place]
            share = limits.get(RATIO, limits.get("Nm", 0.0) / max(e.value, 1e-12))
            moved = columns[:, place] * (share if e.log else share * e.value / e.scale)
            friction = float(np.sqrt(np.mean(moved**2)))
        out.append(float(np.hypot(d.resolution, min(friction, most))))
    return tuple(out)


def pitch_limit(machine: Machine, axis: str) -> float:
    """Pitch error that an axis of a sound machine may have, axis units."""
    pitch = (machine.tolerance or TYPICAL_TOLERANCE).get("pitch_error", {})
    return pitch.get("deg", 0.0) * DEG if machine.chain.is_rotary(axis) else pitch.get("um", 0.0) * UM


def discrepancy_of(
    model: AxisModel,
    residual: Sequence[np.ndarray],
    design: Sequence[np.ndarray],
    data: Sequence[AxisData],
    allowed: Sequence[float],
) -> LogDiscrepancy:
    """What a fitted model leaves.

    Args:
        model: With the fitted values.
        residual: Measured less modelled block means per recording, (blocks,) axis units.
        design: Derivatives of the modelled ones, (blocks, p) each.
        data: The recordings.
        allowed: What a sound machine may leave in each, axis units.
    """
    precision = np.minimum([e.deviation for e in model.entries], _WIDEST) ** -2.0
    departure = np.array([e.encode(e.value) - e.mean for e in model.entries])
    rows = [np.asarray(dct(r / d.noise.rms, norm="ortho")) for r, d in zip(residual, data, strict=True)]
    columns = [np.asarray(dct(c / d.noise.rms, axis=0, norm="ortho")) for c, d in zip(design, data, strict=True)]
    octaves = [np.maximum(np.log2(np.maximum(np.arange(len(r)), _LOWEST) / _LOWEST), 0.0).astype(int) for r in rows]
    expected = [r**2 for r in rows]  # squares of the amplitudes, of noise and discrepancy together
    evidence = -np.inf
    for _ in range(_ROUNDS):
        power = [np.bincount(o, x) / np.bincount(o) for o, x in zip(octaves, expected, strict=True)]
        variance = [np.maximum(p, 1.0)[o] for p, o in zip(power, octaves, strict=True)]
        normal = sum(c.T @ (c / v[:, None]) for c, v in zip(columns, variance, strict=True))
        score = sum(c.T @ (r / v) for r, c, v in zip(rows, columns, variance, strict=True))
        square = sum(float(r @ (r / v)) for r, v in zip(rows, variance, strict=True))
        log_det = sum(float(np.log(v).sum()) for v in variance)
        evidence, step = marginalised(np.asarray(normal), np.asarray(score), square, log_det, precision, departure)
        covariance = np.linalg.inv(normal + np.diag(precision))
        # where the entries are as well as they can be known
        expected = [
            (r - c @ step) ** 2 + np.einsum("ij,jk,ik->i", c, covariance, c) for r, c in zip(rows, columns, strict=True)
        ]
    found = [_left(r, o, u, d.noise.rms) for r, o, u, d in zip(rows, octaves, allowed, data, strict=True)]
    left, beyond = zip(*found, strict=True)
    return LogDiscrepancy(evidence, left, tuple(allowed), beyond)


def _left(rows: np.ndarray, octave: np.ndarray, allowed: float, noise: float) -> tuple[float, float]:
    """RMS of the discrepancy of one recording, axis units, and the probability that it is larger than allowed.

    The variance of each octave is known as well as its number of amplitudes tells.

    Args:
        rows: Amplitudes of what the model leaves, in the noise.
        octave: Of each.
        allowed: RMS, axis units.
        noise: RMS, axis units.
    """
    count, power = np.bincount(octave), np.bincount(octave, rows**2)
    square = float(np.maximum(power - count, 0.0).sum()) / len(rows)
    spread = float(np.sqrt(np.sum(2.0 * np.maximum(power, count) ** 2 / count))) / len(rows)
    return noise * float(np.sqrt(square)), float(ndtr((square - (allowed / noise) ** 2) / spread))
