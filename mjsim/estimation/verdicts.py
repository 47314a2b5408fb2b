"""When an effect that a machine of its class may have is a finding: beyond its tolerance, or proven."""

from __future__ import annotations

import numpy as np

from mjsim.estimation.calibration import Calibrated
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fit

#: Prior standard deviation, in typical sizes, from which an entry of an effect is a free shape.
_UNINFORMED = 100.0


def log_odds(fit: Fit, f: EffectVector) -> float:
    """Logarithm of the evidence with an effect of the model over that without it (Savage-Dickey density ratio)."""
    assert f.prior is not None
    mean, deviation = f.prior
    informed = deviation < _UNINFORMED
    departure, covariance = (f.vector - mean)[informed], fit.covariance_of(f)[np.ix_(informed, informed)]
    shrunk = np.linalg.slogdet(covariance)[1] - 2.0 * np.log(deviation[informed]).sum()
    return 0.5 * float(departure @ np.linalg.solve(covariance, departure) + shrunk)


def is_beyond(fit: Fit, f: EffectVector, expected: Calibrated) -> bool:
    """Whether the 95 % interval of a calibrated effect lies beyond its limit."""
    intervals = f.interval(f.vector, fit.covariance_of(f))
    for name, limit in expected.limits.items():
        for low, high, centre in _sizes(intervals[name], expected, name):
            if low - centre > limit or high - centre < -limit:
                return True
    return False


def _sizes(interval: list, expected: Calibrated, name: str) -> list[tuple[float, float, float]]:
    """Lower end, upper end and prior mean of one size, or of every wave."""
    if name != "components":
        return [(interval[0], interval[1], expected.free.effect.values[name])]
    rows = expected.free.effect.values[name]
    return [(low[1], high[1], row[1]) for low, high, row in zip(*interval, rows, strict=False)]
