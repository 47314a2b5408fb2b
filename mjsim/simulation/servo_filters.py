"""The control law of an axis as filters of its samples."""

from __future__ import annotations

import numpy as np

from mjsim.machine.plant import AxisPlant


def filters(axis: AxisPlant, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients R, S, T (R[0] = 1) that give x from command and actual angle."""
    law = axis.control.law
    if law is not None:
        R, S, T = (np.array(c, float) for c in (law.R, law.S, law.T))
        return R / R[0], S / R[0], T / R[0]
    Kp, ff, lag, over = axis.position_gain, axis.feedforward, axis.control.torque_lag, axis.control.velocity_samples
    if lag < 0.5 * step and axis.control.sample_time == 0.0:
        # a continuous control: what it gives in the middle of the step, from the last three samples
        ahead, rate = np.array([1.5, -0.5, 0.0]), np.array([2.0, -3.0, 1.0]) / step
        return np.ones(1), Kp * ahead + rate, Kp * ahead + ff * rate
    if lag < 0.5 * step:
        difference = np.zeros(over + 1)
        difference[0], difference[-1] = 1.0 / (over * step), -1.0 / (over * step)
        gain = Kp * np.eye(over + 1)[0]
        return np.ones(1), gain + difference, gain + ff * difference
    w = 2.0 / step
    d = np.array([1.0 + lag * w, 1.0 - lag * w])
    return d / d[0], np.array([Kp + w, Kp - w]) / d[0], np.array([Kp + ff * w, Kp - ff * w]) / d[0]


def position_part(axis: AxisPlant, step: float) -> np.ndarray:
    """The part of S that acts on the position: of the load where the loop is closed there. A law has one encoder."""
    law, lag = axis.control.law, axis.control.torque_lag
    if law is not None:
        return np.array(law.S, float) / law.R[0]
    if lag < 0.5 * step:
        return axis.position_gain * np.array([1.5, -0.5] if axis.control.sample_time == 0.0 else [1.0])
    return axis.position_gain * np.ones(2) / (1.0 + 2.0 * lag / step)


def set_point_share(axis: AxisPlant, step: float) -> float:
    """The velocity set-point Kpp (r − y) + ratio·s r as T and the position's part have it, over its value.

    A law has none: there its limit is of no effect.
    """
    lag = axis.control.torque_lag
    if axis.control.law is not None:
        return np.inf
    return 1.0 if lag < 0.5 * step else 2.0 / (1.0 + 2.0 * lag / step)


def samples_of_set_point(axis: AxisPlant, step: float) -> int:
    """Samples for which a velocity set-point is held."""
    return max(1, round(axis.control.position_sample_time / step))
