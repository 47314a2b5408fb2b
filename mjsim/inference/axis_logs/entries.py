"""What a fit of axis logs may move: numbers of the drive, of its controllers, of effects, and nuisances.

Every entry is one number of a vector. Positive numbers enter by their logarithms, so that a step of 0.01 is one
percent; the others in units of a typical size.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mjsim.inference.axis_logs.descent import Priors
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine

#: Owners of entries that are no effects.
DRIVE, CONTROLLER, SHIFT, ZERO, START_TORQUE, PHASE = "drive", "controller", "shift", "zero", "start_torque", "phase"
START_PLAY, GLIDE, DRAG, OFFSET = "start_play", "glide", "drag", "offset"
#: Mass over stiffness of a drive; a factor on what its model takes for granted.
LAG, LOAD = "lag", "load"
#: Of a recorded torque or current: its number per torque of the motor, its zero, and by how much it is late.
PER_TORQUE, OUTPUT_ZERO, OUTPUT_LATE = "per_torque", "output_zero", "output_late"
NUISANCES = (SHIFT, ZERO, START_TORQUE, PHASE, START_PLAY, GLIDE, DRAG, LAG, LOAD, OFFSET)
NUISANCES = (*NUISANCES, PER_TORQUE, OUTPUT_ZERO, OUTPUT_LATE)
#: Longest step of a logarithm.
_LONGEST = 1.5


@dataclass(frozen=True)
class Entry:
    """One free number.

    Attributes:
        owner: ``drive``, ``controller``, a nuisance, or the id of an effect.
        name: Attribute, or parameter of the effect.
        where: Name of the controller, the test or the set-up; empty where there is none.
        value: From which it starts, SI or the parameter's unit.
        deviation: Prior standard deviation, in units of the vector; infinite: no prior.
        log: Whether the vector has its logarithm.
        scale: Typical size of one that has not.
        lower: Least value.
        upper: Largest value.
        centre: Prior mean, as a value; by default ``value``.
    """

    owner: str
    name: str
    value: float
    where: str = ""
    deviation: float = np.inf
    log: bool = False
    scale: float = 1.0
    lower: float = -np.inf
    upper: float = np.inf
    centre: float | None = None

    @property
    def label(self) -> str:
        """Unique in one model."""
        return ".".join(filter(None, (self.owner, self.where, self.name)))

    def encode(self, value: float) -> float:
        """A value as the vector has it."""
        return math.log(value) if self.log else value / self.scale

    def decode(self, x: float) -> float:
        """The value that the vector has as ``x``, within its bounds."""
        return min(max(math.exp(x) if self.log else x * self.scale, self.lower), self.upper)

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest entry of the vector."""
        low = math.log(max(self.lower, 1e-300)) if self.log else self.lower / self.scale
        return low, (math.log(self.upper) if self.log else self.upper / self.scale)

    @property
    def mean(self) -> float:
        """Prior mean in units of the vector."""
        return self.encode(self.value if self.centre is None else self.centre)


@dataclass(frozen=True)
class KnownNumbers:
    """What another instrument knows of the numbers of an axis.

    Attributes:
        entries: The numbers, with what is known of each by itself as its prior.
        covariance: Of all of them, in units of the vector, (n, n).
    """

    entries: tuple[Entry, ...] = ()
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))


@dataclass(frozen=True)
class AxisModel:
    """One axis with everything that is free.

    Attributes:
        machine: With the effects in it; what is free gets its value from the vector.
        axis: Letter.
        entries: What is free.
        known: What another instrument knows of them.
    """

    machine: Machine
    axis: str
    entries: tuple[Entry, ...] = ()
    known: KnownNumbers = field(default_factory=KnownNumbers)
    _places: dict[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_places", {e.label: i for i, e in enumerate(self.entries)})

    @property
    def vector(self) -> np.ndarray:
        """Starting values, (p,)."""
        return np.array([e.encode(e.value) for e in self.entries])

    @property
    def priors(self) -> Priors:
        """Priors and bounds of the vector."""
        low, high = np.array([e.bounds for e in self.entries]).reshape(-1, 2).T
        mean, deviation = np.array([(e.mean, e.deviation) for e in self.entries]).reshape(-1, 2).T
        largest = np.array([_LONGEST if e.log else np.inf for e in self.entries])
        return Priors(mean, deviation, low, high, largest, *self._known_together(mean))

    def _known_together(self, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Means (p,) of what is known of several entries together, and what that adds to the precision that they have
        by themselves, (p, p). An entry that was given more room is not believed to be as known.
        """
        centre, coupling = mean.copy(), np.zeros((len(mean), len(mean)))
        places = [(i, self.place(e.label)) for i, e in enumerate(self.known.entries)]
        pairs = [
            (i, j) for i, j in places if j is not None and self.entries[j].deviation <= self.known.entries[i].deviation
        ]
        if pairs:
            mine, at = (list(x) for x in zip(*pairs, strict=True))
            covariance = self.known.covariance[np.ix_(mine, mine)]
            coupling[np.ix_(at, at)] = np.linalg.inv(covariance) - np.diag(1.0 / np.diag(covariance))
            centre[at] = [self.known.entries[i].mean for i in mine]
        return centre, coupling

    def place(self, label: str) -> int | None:
        """Where an entry stands in the vector."""
        return self._places.get(label)

    def nuisance(self, vector: np.ndarray, owner: str, where: str, name: str = "") -> float:
        """Value of a nuisance; 0 where it is not free. ``name`` is the kind of the effect whose phase it is."""
        i = self._places.get(f"{owner}.{where}.{name or owner}")
        return self.entries[i].decode(vector[i]) if i is not None else 0.0

    def at(self, vector: np.ndarray) -> Machine:
        """The machine with the vector's values."""
        machine = self.machine
        values = [e.decode(x) for e, x in zip(self.entries, vector, strict=True)]
        effects: dict[str, dict[str, Any]] = {}
        controllers = {n: dict(c) for n, c in machine.controllers.items()}
        drive = machine.drives[self.axis]
        for e, value in zip(self.entries, values, strict=True):
            if e.owner == DRIVE:
                drive = replace(drive, **{e.name: value})
            elif e.owner == CONTROLLER:
                now = controllers[e.where][self.axis]
                plain = e.name in ("position_gain", "velocity_gain", "integral_time", "feedforward")
                changed = replace(now, **{e.name: value}) if plain else now.with_control(**{e.name: value})
                controllers[e.where][self.axis] = changed
            elif e.owner not in NUISANCES:
                effects.setdefault(e.owner, {})[e.name] = value
        machine = replace(machine, drives={**machine.drives, self.axis: drive}, controllers=controllers)
        for effect_id, numbers in effects.items():
            effect = machine.effect(effect_id)
            assert effect is not None, effect_id
            machine = machine.with_effect(_changed(effect, numbers))
        return machine

    def with_values(self, vector: np.ndarray) -> AxisModel:
        """The model that starts from a vector's values; priors stay where they are."""
        kept = tuple(
            replace(e, value=e.decode(x), centre=e.value if e.centre is None else e.centre)
            for e, x in zip(self.entries, vector, strict=True)
        )
        return replace(self, machine=self.at(vector), entries=kept)

    def as_printed(self) -> AxisModel:
        """The model with the numbers of the data sheet back at their prior means."""
        printed = tuple(
            replace(e, value=e.centre) if e.owner in (DRIVE, CONTROLLER) and e.centre is not None else e
            for e in self.entries
        )
        return replace(self, entries=printed)

    def extended(self, effect: Effect, entries: Sequence[Entry]) -> AxisModel:
        """The model with an effect, or other values of one, and entries; those of the same name give way."""
        fresh = {e.label for e in entries}
        kept = tuple(e for e in self.entries if e.label not in fresh)
        return replace(self, machine=self.machine.with_effect(effect), entries=(*kept, *entries))

    def without(self, effect_id: str, former: Effect | None = None) -> AxisModel:
        """The model less one effect, or with its ``former`` values."""
        entries = tuple(e for e in self.entries if e.owner != effect_id)
        entries = tuple(e for e in entries if e.owner != PHASE or e.name.split()[0] != effect_id.partition(".")[0])
        machine = self.machine.without(effect_id)
        return replace(self, machine=machine.with_effect(former) if former else machine, entries=entries)

    def without_wave(self, effect_id: str, order: float) -> AxisModel:
        """The model less one of several waves of an effect."""
        effect = self.machine.effect(effect_id)
        assert effect is not None
        rows = [row for row in effect.values["components"] if row[0] != order]
        if not rows:
            return self.without(effect_id)
        gone = {f"{part} {order:g}" for part in ("cosine", "sine", effect.kind)}
        kept = tuple(e for e in self.entries if e.name not in gone)
        return replace(self, machine=self.machine.with_effect(effect.replaced(components=rows)), entries=kept)

    def values(self) -> Mapping[str, float]:
        """Present values by label."""
        return {e.label: e.value for e in self.entries}


def _changed(effect: Effect, numbers: dict[str, Any]) -> Effect:
    """An effect with other numbers; amplitude and phase may come as the two parts of a wave."""
    for name in [n for n in numbers if n.startswith("cosine")]:
        order = name.removeprefix("cosine").strip()
        c, s = numbers.pop(name), numbers.pop(name.replace("cosine", "sine"))
        size, phase = math.hypot(c, s), math.degrees(math.atan2(s, c))
        if order:
            rows = [list(row) for row in numbers.get("components", effect.values["components"])]
            numbers["components"] = [[o, size, phase] if f"{o:g}" == order else [o, a, p] for o, a, p in rows]
        else:
            amplitude = next(p for p in effect.parameters_of(effect.subject) if p.name.startswith("amplitude_"))
            numbers |= {amplitude.name: min(size, amplitude.upper), "phase_deg": phase}
    return effect.replaced(**numbers)
