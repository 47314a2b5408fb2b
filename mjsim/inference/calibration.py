"""Effects that a machine of its class may have: always fitted, with the tolerance as prior, and a finding only
beyond it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from mjsim.campaign.tolerance import RATIO, TYPICAL_TOLERANCE, unit_of_size
from mjsim.effects import registry
from mjsim.inference.data_sheet import OF_SHEET, sheet_of
from mjsim.inference.effect_vector import EffectVector
from mjsim.machine.effect import Effect, Parameter
from mjsim.machine.model import FRICTION_PARAMETERS, Machine
from mjsim.machine.redundant import visible_orders

#: Orders of a rotary axis' error motion where none is stated, the first that is no location error in another form:
#: twice per turn (once per turn hides in the ball's offset).
_ORDERS = (2, -2, 3)
#: A limit is this many standard deviations of the prior.
LIMIT_DEVIATIONS = 2.0


@dataclass(frozen=True)
class Calibrated:
    """One effect with a tolerance.

    Attributes:
        free: The effect with its fitted entries, at the prior mean.
        mean: Prior mean of the entries, (n,) in typical sizes.
        deviation: Prior standard deviations, (n,) in typical sizes.
        limits: Limit of each leading parameter by name, in the unit of its name.
    """

    free: EffectVector
    mean: np.ndarray
    deviation: np.ndarray
    limits: dict[str, float]

    @property
    def key(self) -> str:
        """Key of the effect."""
        return self.free.effect.key

    def prior_of(self, f: EffectVector) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Prior means and deviations of a fitted effect's entries, (n,) each, and which of them the tolerance is about:
        waves of other orders are causes of their own.
        """
        if f.names != ("components",) or len(self.mean) == len(f.vector):
            return self.mean, self.deviation, np.ones(len(f.vector), bool)
        orders = [round(row[0]) for row in self.free.effect.values["components"]]
        means = dict(zip(orders, self.mean.reshape(-1, 2), strict=True))
        mine = [round(row[0]) for row in f.effect.values["components"]]
        mean = np.concatenate([means.get(n, np.zeros(2)) for n in mine])
        own = np.repeat([n in means for n in mine], 2)
        deviation = np.where(own, self.deviation.max(), f.prior[1] if f.prior is not None else 1.0)
        return mean, deviation, own


def sheet_range(machine: Machine, effect: Effect) -> dict[str, tuple[float, float]]:
    """Between what the data sheet lets those sizes of an effect be that are its numbers, by the parameter's name.

    Args:
        machine: As its file says.
        effect: Of an axis.
    """
    names = {key: name for name, key in FRICTION_PARAMETERS.items()} if effect.kind == "friction" else {}
    if effect.kind in OF_SHEET:
        names = {"ratio": OF_SHEET[effect.kind]}
    given, sheet = machine.effect(effect.id), {p.name: p for p in sheet_of(machine) if p.axis == effect.subject}
    out = {}
    for p in effect.parameters_of(effect.subject):
        stated = p.neutral if given is None else given.values[p.name]
        if p.name in names and stated is not None:
            number = sheet[names[p.name]]
            out[p.name] = stated * number.ratio(-LIMIT_DEVIATIONS), stated * number.ratio(LIMIT_DEVIATIONS)
    return out


def sheet_deviations(machine: Machine, f: EffectVector) -> np.ndarray:
    """Standard deviations of the entries of a friction that stand for numbers of the data sheet, (n,) typical sizes;
    zero for all other entries. Such a number is as uncertain as the sheet where the friction is not fitted.

    Args:
        machine: As its file says.
        f: Effect of a model.
    """
    out = np.zeros(len(f.vector))
    if f.effect.kind == "friction":
        for name, (low, high) in sheet_range(machine, f.effect).items():
            if name in f.names:
                out[f.names.index(name)] = 0.5 * (high - low) / LIMIT_DEVIATIONS / f.specs[name].scale
    return out


def calibrated_effects(machine: Machine) -> list[Calibrated]:
    """Every effect of the kinds for which the machine file states a tolerance, on every subject that the machine
    has.
    """
    return _of_table(machine, machine.tolerance)


def expected_effects(machine: Machine) -> list[Calibrated]:
    """Every effect that a machine of its class may have.

    These are of the kinds for which the machine file states a tolerance. Where it states none, they are of the kinds
    that a typical machine has.
    """
    return _of_table(machine, machine.tolerance or TYPICAL_TOLERANCE)


def _of_table(machine: Machine, table: Mapping[str, Mapping[str, float]]) -> list[Calibrated]:
    classes = registry.kinds_of(machine.effects)
    return [c for kind, limits in table.items() for c in _of_kind(machine, classes[kind], limits)]


def _of_kind(machine: Machine, cls: type[Effect], limits: Mapping[str, float]) -> Iterator[Calibrated]:
    for subject in cls.subjects_of(machine.chain):
        present = machine.effect(f"{cls.kind}.{subject}")
        sizes = {
            p.name: limit
            for p in cls.parameters_of(subject)
            if p.leading and (limit := _limit(p, subject, limits, present, machine.factor))
        }
        if not sizes:
            continue
        effect, names = _at_mean(machine, cls, subject, present, tuple(sizes))
        free = EffectVector(effect, names)
        deviation = np.concatenate(
            [np.full(_entries(free, n), sizes[n] / LIMIT_DEVIATIONS / free.specs[n].scale) for n in names if n in sizes]
        )
        yield Calibrated(free.with_prior(free.vector, deviation), free.vector, deviation, sizes)


def _limit(
    p: Parameter, subject: str, limits: Mapping[str, float], present: Effect | None, factor: float | None
) -> float | None:
    """Limit of a leading parameter in the unit of its name, or ``None`` where the table has none. A stated value may be
    off by the factor within which it is believed.
    """
    unit = unit_of_size(p, subject)
    if unit in limits:
        return limits[unit]
    if RATIO in limits and present is not None and p.kind == "number":
        return max(limits[RATIO], (factor or 1.0) - 1.0) * abs(present.values[p.name])
    return None


def _at_mean(
    machine: Machine, cls: type[Effect], subject: str, present: Effect | None, sizes: tuple[str, ...]
) -> tuple[Effect, tuple[str, ...]]:
    """The effect where its prior is centred, and what is fitted: the sizes, and the phase of a wave."""
    if "components" in sizes:
        have = present.values["components"] if present else []
        orders = {round(row[0]) for row in have}
        waves = [[float(n), 0.0, 0.0] for n in _orders(machine, subject) if round(n) not in orders]
        rows = [*have, *waves]
        return (present.replaced(components=rows) if present else cls(subject, components=rows)), ("components",)
    phase = tuple(p.name for p in cls.parameters_of(subject) if p.name == "phase_deg")
    names = (*sizes, *phase)
    if present is not None:
        return present, names
    values = {p.name: p.neutral for p in cls.parameters_of(subject) if p.leading}
    order = next((p for p in cls.parameters_of(subject) if p.name == "order"), None)
    if order is not None and order.lower > 0.0:  # it does not go round
        values["order"] = float(_ORDERS[0])
    elif order is not None:
        visible = visible_orders(machine.chain, subject, "amplitude_urad" in values)
        values["order"] = float(next((k for k in _ORDERS if k in visible), _ORDERS[0]))
    return cls(subject, **values), names


def _orders(machine: Machine, subject: str) -> tuple[float, float]:
    """Waves that a pitch error has as a rule: one and two per turn of a screw, or per tooth of a worm wheel."""
    once = machine.drives[subject].gear if machine.chain.is_rotary(subject) else 1.0
    return once, 2.0 * once


def _entries(free: EffectVector, name: str) -> int:
    """Entries of the vector that belong to one size."""
    if name == "components":
        return 2 * len(free.effect.values["components"])
    return 2 if free.polar and name == free.amplitude else 1
