"""When an effect that a machine of its class may have is a finding: beyond its tolerance, or proven."""

from __future__ import annotations

from collections.abc import Collection, Mapping

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


def proven(fit: Fit, kept: Collection[str], prior_log_odds: float) -> list[str]:
    """Keys of those effects of ``kept`` beside which, at typical sizes as prior, the data leave no doubt that they are
    there.
    """
    return [f.effect.key for f in fit.effects if f.effect.key in kept and log_odds(fit, f) + prior_log_odds > 0.0]


def is_beyond(fit: Fit, f: EffectVector, expected: Calibrated) -> bool:
    """Whether the 95 % interval of a calibrated effect lies beyond its limit, see :func:`beyond`."""
    return beyond(fit, f, expected) > 1.0


def beyond(fit: Fit, f: EffectVector, expected: Calibrated, misfit: float = 1.0) -> float:
    """Least size of a calibrated effect by its 95 % interval, in units of its limit; of the number that lies farthest.

    Variances are ``misfit`` times as large: what the model fails to explain counts as noise.
    """
    intervals = f.interval(f.vector, max(1.0, misfit) * fit.covariance_of(f))
    return max(
        (
            max(low - centre, centre - high) / limit
            for name, limit in expected.limits.items()
            for low, high, centre in _sizes(intervals[name], expected, name)
        ),
        default=0.0,
    )


def stands(fit: Fit, key: str, expected: Mapping[str, Calibrated], misfit: float, enough: float) -> bool:
    """Whether a finding holds beside something unknown.

    Args:
        fit: The model, fitted together with a curve for the unknown.
        key: Of the finding.
        expected: Effects that a machine of its class has, by key. These have to be beyond their limit.
        misfit: Mean square of what is left with the curve, in units of the noise.
        enough: The others need a misfit of at most so much: they may imitate what the curve leaves.
    """
    f = next(f for f in fit.effects if f.effect.key == key)
    if key not in expected:
        return misfit < enough
    return is_beyond(fit, f, expected[key]) and not _at_bound(f, expected[key])


def _at_bound(f: EffectVector, expected: Calibrated) -> bool:
    """Whether a size was driven to the end of what is possible, as by something else that it cannot explain."""
    sizes = [(f.effect.values[n], f.specs[n]) for n in expected.limits if n != "components"]
    return any(not p.lower < size < p.upper for size, p in sizes)


def _sizes(interval: list, expected: Calibrated, name: str) -> list[tuple[float, float, float]]:
    """Lower end, upper end and prior mean of one size, or of every wave; that of a wave of another order is 0."""
    if name != "components":
        return [(interval[0], interval[1], expected.free.effect.values[name])]
    centre = {round(row[0]): row[1] for row in expected.free.effect.values[name]}
    return [(low[1], high[1], centre.get(round(low[0]), 0.0)) for low, high in zip(*interval, strict=True)]
