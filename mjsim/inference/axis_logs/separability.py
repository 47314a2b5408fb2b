"""What the recordings of one axis cannot separate, and which motion would."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.inference.axis_logs.entries import CONTROLLER, DRIVE, NUISANCES, Entry
from mjsim.inference.axis_logs.fit import AxisFit

#: Share of its prior variance that a combination keeps when the data say little about it.
_KEPT = 0.25
#: Prior standard deviation up to which a number counts as known.
_EXACT = 0.02
#: Share of its prior deviation from which a number counts as open, and the distance at which it is at a bound.
_OPEN, _AT_BOUND = 0.5, 1e-6
#: Least share of an entry in such a combination for it to be named.
_NAMED = 0.15


@dataclass(frozen=True)
class Inseparable:
    """Numbers of which the data fix a combination only.

    Attributes:
        axis: Letter.
        labels: Of the entries.
        remedy: What would separate them, one sentence.
    """

    axis: str
    labels: tuple[str, ...]
    remedy: str


def inseparable(fit: AxisFit) -> tuple[Inseparable, ...]:
    """Combinations of the free numbers that keep most of their prior variance.

    Nuisances are left out; they have no meaning for the machine.
    """
    entries = fit.model.entries
    wide = [e.owner not in NUISANCES and _EXACT < e.deviation < np.inf for e in entries]
    mine = [j for j, there in enumerate(wide) if there]
    if not mine:
        return ()
    prior = np.array([min(entries[j].deviation, 10.0) for j in mine])
    covariance = fit.covariance[np.ix_(mine, mine)] / np.outer(prior, prior)
    values, vectors = np.linalg.eigh(covariance)
    out = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        if value < _KEPT:
            break
        named = [j for j, share in zip(mine, vector**2, strict=True) if share > _NAMED]
        weak = [j for j in named if entries[j].owner not in (DRIVE, CONTROLLER) and entries[j].deviation > 5.0]
        labels = tuple(entries[j].label for j in named)
        if named and len(weak) < len(named):
            out.append(Inseparable(fit.model.axis, labels, remedy([entries[j] for j in named])))
    return tuple(out)


def remedy(entries: list[Entry]) -> str:
    """The next recording that tells some numbers apart."""
    names = {e.name for e in entries}
    if "inertia" in names or "velocity_gain" in names:
        return (
            "record the torque or the current as well, or read one velocity gain from the control: positions alone "
            "fix the ratios of torques only"
        )
    if "integral_time" in names or "position_gain" in names:
        return "record a step of 0.1 mm and a stop from full speed, at two position gains"
    if "viscous" in names:
        return "record constant speeds, slow and fast, in both directions"
    if {"coulomb_Nm", "presliding_rad", "static_ratio"} & names:
        return "record a slow circle or a slow to-and-fro of 1 mm: many reversals at low speed"
    return "record the same motion at another speed"


def intervals(fit: AxisFit) -> dict[str, tuple[float, float, float]]:
    """Value, low and high (95 %) of every entry by its label, in its own unit."""
    out = {}
    deviations = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    for e, x, sd in zip(fit.model.entries, fit.model.vector, deviations, strict=True):
        ends = [e.encode(e.value) + z * sd for z in (-1.96, 1.96)]
        low, high = (np.exp(min(v, 300.0)) if e.log else v * e.scale for v in ends)
        out[e.label] = (e.decode(x), float(low), float(high))
    return out


def undetermined(fit: AxisFit) -> tuple[str, ...]:
    """Labels of the numbers that the recordings do not determine: the fit ended at a bound, or their interval is
    about as wide as before the recordings.
    """
    deviations, out = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0)), []
    for e, x, sd in zip(fit.model.entries, fit.model.vector, deviations, strict=True):
        at_bound = bool(np.min(np.abs(np.array(e.bounds) - x)) < _AT_BOUND * max(abs(x), 1.0))
        if e.owner not in NUISANCES and (at_bound or (e.log and sd > _OPEN * e.deviation)):
            out.append(e.label)
    return tuple(out)
