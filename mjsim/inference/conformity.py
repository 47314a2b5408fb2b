"""Probability that a number lies beyond its limit, from what a measurement says of it (JCGM 106)."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import erfc

#: Points of the normal distribution by which sizes of waves are judged.
_DRAWS = 2000


def beyond(off: np.ndarray, covariance: np.ndarray, limit: float) -> float:
    """Probability that a number, or the size of a wave, is farther than a limit from what is expected.

    Args:
        off: Departure from what is expected, (1,), or of a wave its cosine and sine, (2,).
        covariance: Of that, (n, n).
        limit: Largest departure allowed.
    """
    if len(off) == 2:
        return _radius_beyond(off, covariance, limit)
    x, sd = float(off[0]), math.sqrt(max(float(covariance[0, 0]), 1e-30))
    return min(
        0.5 * float(erfc((limit - x) / sd / math.sqrt(2)) + erfc((limit + x) / sd / math.sqrt(2))),
        1.0,
    )


def _radius_beyond(centre: np.ndarray, covariance: np.ndarray, limit: float) -> float:
    """Probability that a point of the plane with this normal distribution is farther than ``limit`` from the origin."""
    share = (np.arange(_DRAWS) + 0.5) / _DRAWS
    radius, angle = np.sqrt(-2.0 * np.log(share)), 2.0 * np.pi * np.arange(_DRAWS) * 0.6180339887498949
    values, vectors = np.linalg.eigh(covariance)
    points = vectors * np.sqrt(np.maximum(values, 0.0)) @ np.vstack([radius * np.cos(angle), radius * np.sin(angle)])
    return float(np.mean(np.hypot(*(centre[:, None] + points)) > limit))
