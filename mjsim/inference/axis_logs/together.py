"""Findings whose size is known only together with other numbers.

A cause may be needed beyond doubt and its leading number be open: friction that saturates at high speed and viscous
friction share one curve. The 95 % interval of the number then holds the value that means no cause at all. What is known
is the number where the others are as found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.digits import with_interval
from mjsim.inference.axis_logs.entries import CONTROLLER, DRIVE, NUISANCES, AxisModel, Entry
from mjsim.inference.axis_logs.fit import AxisFit
from mjsim.machine.effect import Effect
from mjsim.machine.model import sheet_name

#: Most numbers that are taken as found, and the standard normal deviate of a 95 % interval.
_MOST, _95 = 3, 1.96


@dataclass(frozen=True)
class KnownTogether:
    """The leading number of a finding whose interval holds the value that means no cause.

    Attributes:
        parameter: Its name.
        value: As found, in its unit.
        others: Numbers that are taken as found, in words; empty where no few numbers make it known.
        ci95: Low and high where these are as found; of the number alone where there are none.
    """

    parameter: str
    value: float
    others: tuple[str, ...]
    ci95: tuple[float, float]

    @property
    def sentence(self) -> str:
        """One sentence for users."""
        known = with_interval(self.value, self.ci95)
        if not self.others:
            return (
                f"the size is open: {self.parameter} = {known} (95 %), whose interval "
                " holds the value that means no cause"
            )
        where = "where that is" if len(self.others) == 1 else "where these are"
        return (
            f"{self.parameter} is known only together with {' and '.join(self.others)}: {where} as found, it "
            f"is {known} (95 %)"
        )


def known_together(fit: AxisFit, effect_id: str, order: float | None = None) -> KnownTogether | None:
    """How the leading number of a finding is known; nothing where its own interval excludes that there is no cause.

    Args:
        fit: The final model.
        effect_id: Of the finding.
        order: Of the wave of an effect with several.
    """
    effect = fit.model.machine.effect(effect_id)
    assert effect is not None
    lead = leading_number(fit.model, effect, order)
    if lead is None:
        return None
    direction, name, distance = lead
    covariance = fit.covariance
    if abs(distance) > _95 * deviation_along(covariance, direction, []):
        return None
    entries, held = fit.model.entries, []
    able = [j for j, e in enumerate(entries) if e.owner not in NUISANCES and not direction[j]]
    while abs(distance) <= _95 * deviation_along(covariance, direction, held) and len(held) < min(_MOST, len(able)):
        held.append(
            min((j for j in able if j not in held), key=lambda j: deviation_along(covariance, direction, [*held, j]))
        )
    known = abs(distance) > _95 * deviation_along(covariance, direction, held)
    spread = _95 * deviation_along(covariance, direction, held if known else [])
    value, ends = _in_unit(fit.model, direction, spread)
    return KnownTogether(name, value, tuple(_words(entries[j], effect_id) for j in held) if known else (), ends)


def leading_number(model: AxisModel, effect: Effect, order: float | None) -> tuple[np.ndarray, str, float] | None:
    """Direction of the leading number in the vector, its name, and how far it is from the value that means no cause."""
    suffix, direction = (f" {order:g}" if order is not None else ""), np.zeros(len(model.entries))
    places = [model.place(f"{effect.id}.{part}{suffix}") for part in ("cosine", "sine")]
    if places[0] is not None and places[1] is not None:
        parts = model.vector[[places[0], places[1]]]
        size = float(np.hypot(*parts))
        direction[[places[0], places[1]]] = parts / max(size, 1e-30)
        name = "amplitude" if order is not None else next(p.name for p in effect.parameters if "amplitude" in p.name)
        return direction, name, size
    for p in effect.parameters_of(effect.subject):
        j = model.place(f"{effect.id}.{p.name}")
        if j is not None and p.neutral is not None:
            e = model.entries[j]
            if e.log and p.neutral <= 0.0:
                return None  # a logarithm never holds it
            direction[j] = 1.0
            return direction, p.name, float(model.vector[j] - e.encode(p.neutral))
    return None


def deviation_along(covariance: np.ndarray, direction: np.ndarray, held: list[int]) -> float:
    """Standard deviation along a direction where the entries ``held`` are known."""
    own = float(direction @ covariance @ direction)
    if held:
        shared = covariance[held] @ direction
        own -= float(shared @ np.linalg.lstsq(covariance[np.ix_(held, held)], shared, rcond=1e-12)[0])
    return float(np.sqrt(max(own, 0.0)))


def _in_unit(model: AxisModel, direction: np.ndarray, spread: float) -> tuple[float, tuple[float, float]]:
    """Value of the leading number and the ends of its interval, in its unit."""
    j = int(np.argmax(np.abs(direction)))
    e = model.entries[j]
    if not e.name.startswith(("cosine", "sine")):
        low, high = (e.encode(e.value) + sign * spread for sign in (-1.0, 1.0))
        return e.value, (float(np.exp(low)), float(np.exp(high))) if e.log else (low * e.scale, high * e.scale)
    size = float(model.vector @ direction) * e.scale
    return size, (size - spread * e.scale, size + spread * e.scale)


def _words(entry: Entry, effect_id: str) -> str:
    """An entry in words."""
    if entry.owner == effect_id:
        return entry.name
    if entry.owner == DRIVE:
        return f"the {sheet_name(entry.name)[0]} of the data sheet"
    if entry.owner == CONTROLLER:
        return f"the {sheet_name(entry.name)[0]} of controller {entry.where}"
    return f"{entry.name} of {entry.owner}"
