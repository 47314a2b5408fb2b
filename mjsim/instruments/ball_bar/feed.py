"""Feed profile along a circular path: constant peripheral acceleration at both ends, constant feed between."""

from __future__ import annotations

import numpy as np

#: Peripheral acceleration at both ends of a test, m/s² (assumed; the paper does not print one).
ACCELERATION = 0.5


def trapezoid(length: float, feed: float, acceleration: float = ACCELERATION):
    """Travel along a path of ``length`` (m) from rest to rest.

    Returns:
        ``(duration, travel)``: the duration in s and a function of time (n,) s that gives the distance travelled (n,)
        m; it holds its ends. A path too short for the feed gets a triangular profile.

    >>> duration, travel = trapezoid(length=0.1, feed=0.01)
    >>> round(duration, 3), round(float(travel(duration / 2)), 3)
    (10.02, 0.05)
    """
    feed = min(feed, float(np.sqrt(acceleration * length)))
    ramp = feed / acceleration
    duration = length / feed + ramp

    def travel(t: np.ndarray) -> np.ndarray:
        t = np.clip(np.asarray(t, float), 0.0, duration)
        rest = duration - t
        up, down = 0.5 * acceleration * t**2, length - 0.5 * acceleration * rest**2
        return np.where(t < ramp, up, np.where(rest < ramp, down, feed * (t - 0.5 * ramp)))

    return duration, travel
