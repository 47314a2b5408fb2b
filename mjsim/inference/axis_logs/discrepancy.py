"""What a model leaves of axis logs beside the noise: a process in time whose size is estimated.

As for the ball bar (:mod:`mjsim.inference.discrepancy`), no model of a drive is complete, and what it leaves is no
noise: it is correlated. So every recording has a discrepancy ``d``, a sum of cosines over its time with independent
normal amplitudes:

    d(t) = Σ aₙ cos(π n (t + ½ h)/T),   Var aₙ = σ²(octave of n)

T is the length of the recording, h the length of a block. The variances are constant in every octave: slow misfit, of
which a recording has few independent values, does not hide what is fast, nor count as if every sample were independent.
They are zero where a model explains everything. They are those of the largest evidence, with the parameters of the
model marginalised within their bounds (MacKay, "Bayesian interpolation", Neural Computation 4 (1992) 415-447). The
evidence of a cause is that beside it: what a cause explains counts for little where as much is left.

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
from mjsim.inference.axis_logs.data import AxisData
from mjsim.inference.axis_logs.descent import bounded_step
from mjsim.inference.axis_logs.entries import AxisModel
from mjsim.machine.model import Machine
from mjsim.units import DEG, UM

#: The lowest frequencies share one variance up to this one, in half waves over the recording: each alone says nothing.
_LOWEST = 8
#: Share by which the torque of a sound motor differs from its current times a number (assumed: slots and saturation).
_TORQUE = 0.03
#: How often the variances are taken anew at most; they are settled where the log evidence gains less, nats.
_ROUNDS, _SETTLED = 12, 0.1


@dataclass(frozen=True)
class LogDiscrepancy:
    """What a fitted model leaves of the recordings of an axis.

    Attributes:
        evidence: Log evidence of the recordings, the model's entries marginalised.
        missing: Log evidence that a model which leaves nothing would have more.
        step: From the model's vector to the likeliest one within its bounds, if the derivatives hold, (p,).
        left: RMS of the discrepancy in each recording, axis units.
        allowed: RMS that a sound machine may leave in each, axis units.
        beyond: Probability for each that more than that is left.
    """

    evidence: float
    missing: float
    step: np.ndarray
    left: tuple[float, ...]
    allowed: tuple[float, ...]
    beyond: tuple[float, ...]

    @property
    def probability(self) -> float:
        """That more is left than a sound machine leaves, in the recording that shows it best."""
        return max(self.beyond, default=0.0)


def allowed_in(
    machine: Machine, model: AxisModel, design: Sequence[np.ndarray], data: Sequence[AxisData]
) -> tuple[float, ...]:
    """RMS that a sound machine may leave in each row, axis units or those of a recorded torque.

    Args:
        machine: As given, with its tolerance.
        model: With the friction of the axis.
        design: Derivatives of the modelled block means, (blocks, p) per row.
        data: The rows.
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
        if not d.is_position:
            varies = _TORQUE * float(np.sqrt(np.mean(d.recorded**2)))
            out.append(float(np.linalg.norm([d.resolution, friction, varies])))
            continue
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
    noise: Sequence[float],
    allowed: Sequence[float],
) -> LogDiscrepancy:
    """What a model leaves, and its log evidence.

    Args:
        model: With the values at which the residuals are. It need not be fitted: one linear step is taken.
        residual: Measured less modelled block means per recording, (blocks,) axis units.
        design: Derivatives of the modelled ones, (blocks, p) each.
        noise: RMS of each recording's noise, axis units.
        allowed: What a sound machine may leave in each, axis units.
    """
    priors, vector = model.priors, model.vector
    precision, room = priors.precision, priors.room(vector)
    root = np.linalg.inv(np.linalg.cholesky(precision)).T  # of the covariance
    rows = [np.asarray(dct(r / s, norm="ortho")) for r, s in zip(residual, noise, strict=True)]
    columns = [np.asarray(dct(c / s, axis=0, norm="ortho")) for c, s in zip(design, noise, strict=True)]
    octaves = [np.maximum(np.log2(np.maximum(np.arange(len(r)), _LOWEST) / _LOWEST), 0.0).astype(int) for r in rows]
    expected = [r**2 for r in rows]  # squares of the amplitudes, of noise and discrepancy together
    evidence, before, step, variance = -np.inf, -np.inf, np.zeros(len(vector)), rows
    for _ in range(_ROUNDS):
        power = [np.bincount(o, x) / np.bincount(o) for o, x in zip(octaves, expected, strict=True)]
        variance = [np.maximum(p, 1.0)[o] for p, o in zip(power, octaves, strict=True)]
        normal, pull, square = precision, priors.pull(vector), priors.squares(vector)
        for r, c, v in zip(rows, columns, variance, strict=True):
            normal = normal + c.T @ (c / v[:, None])
            pull = pull + c.T @ (r / v)
            square += float(r @ (r / v)) + float(np.log(v).sum())
        step = bounded_step(normal, pull, 0.0, *room)
        # in the deviations of the priors no eigenvalue is below one: a model that has run away is singular by rounding
        sizes, ways = np.linalg.eigh(root.T @ normal @ root)
        sizes = np.maximum(sizes, 1.0)
        flexibility = float(np.log(sizes).sum())
        evidence = -0.5 * (square - float((2.0 * pull - normal @ step) @ step) + flexibility)
        if evidence < before + _SETTLED:
            break
        before, spread = evidence, root @ ways / np.sqrt(sizes)
        # where the entries are as well as they can be known
        expected = [(r - c @ step) ** 2 + np.sum((c @ spread) ** 2, axis=1) for r, c in zip(rows, columns, strict=True)]
    found = [_left(r, o) for r, o in zip(rows, octaves, strict=True)]
    left = tuple(s * float(np.sqrt(square)) for s, (square, _) in zip(noise, found, strict=True))
    limits = zip(found, allowed, noise, strict=False)  # of torques, nothing is said
    beyond = tuple(float(ndtr((square - (most / s) ** 2) / spread)) for (square, spread), most, s in limits)
    missing = 0.5 * sum(float(np.log(v).sum()) for v in variance)
    return LogDiscrepancy(evidence, missing, step, left, tuple(allowed), beyond)


def _left(rows: np.ndarray, octave: np.ndarray) -> tuple[float, float]:
    """Mean square of the discrepancy of one recording, in its noise, and the standard deviation of that.

    The variance of each octave is known as well as its number of amplitudes tells.

    Args:
        rows: Amplitudes of what the model leaves, in the noise.
        octave: Of each.
    """
    count, power = np.bincount(octave), np.bincount(octave, rows**2)
    square = float(np.maximum(power - count, 0.0).sum()) / len(rows)
    return square, float(np.sqrt(np.sum(2.0 * np.maximum(power, count) ** 2 / count))) / len(rows)
