"""What an effect is: one physical cause of motion error, one class in one file.

A subclass names its parameters (unit in the name, bounds, the value that switches it off), says where it acts by overriding
:meth:`Effect.apply` (drive, transmission, geometry), and is picked up everywhere by :func:`mjsim.effects.registry.register`.
"""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from mjsim.errors import InputError
from mjsim.io.inputs import shown
from mjsim.machine.motion import Motion
from mjsim.machine.plant import Plant
from mjsim.units import unit_of

#: Most components of one effect: each is an operation in every step of a simulation.
MOST_COMPONENTS = 1000


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, in the units of its name.

    Attributes:
        name: e.g. ``width_deg``; the unit is its ending.
        meaning: one line.
        lower, upper: allowed closed range.
        neutral: the value that switches the effect off (leading parameters only).
        default: value when the file leaves it out; ``None`` makes it required.
        kind: ``number``, ``components`` (a list of [order, amplitude, phase_deg]) or ``choice``.
        choices: allowed texts of a ``choice``.
        scale: a typical size, in the same unit: the step of numerical derivatives and of searches.
        inverse: fitted as its reciprocal (a stiffness is off at infinity; its compliance is off at zero).
    """

    name: str
    meaning: str
    lower: float = -1e9
    upper: float = 1e9
    neutral: float | None = None
    default: Any = None
    kind: str = "number"
    choices: tuple[str, ...] = ()
    scale: float = 1.0
    inverse: bool = False

    def encode(self, value: float) -> float:
        """A value as fits see it, in typical sizes."""
        return self.scale / value if self.inverse else value / self.scale

    def decode(self, x: float) -> float:
        """The value, inside its bounds, that fits see as ``x``."""
        if self.inverse:
            return max(self.scale / x, self.lower) if x > self.scale / self.upper else self.upper
        return min(max(x * self.scale, self.lower), self.upper)

    @property
    def factor(self) -> float:
        """Factor to SI."""
        return unit_of(self.name)[0]

    @property
    def unit(self) -> str:
        """Symbol of the unit, empty for ratios and orders."""
        return unit_of(self.name)[1]

    @property
    def leading(self) -> bool:
        """Whether this parameter's neutral value switches the whole effect off."""
        return self.neutral is not None or self.kind == "components"


class Effect(ABC):
    """Base class. ``values`` holds the parameters as the file gives them (units of their names).

    Class attributes to set: ``kind`` (first half of the id), ``subjects``, ``parameters``, ``title``, ``definition``,
    ``source``, ``signature``. Raises :class:`InputError` for an unknown subject, parameter, or a value out of bounds.
    """

    kind: ClassVar[str]
    subjects: ClassVar[tuple[str, ...]]
    parameters: ClassVar[tuple[Parameter, ...]]
    title: ClassVar[str]
    definition: ClassVar[str]
    source: ClassVar[str]
    signature: ClassVar[str]
    #: True where the whole effect can be found from the axes' motion without simulating the drive again.
    quasi_static: ClassVar[bool] = True
    #: Parameters that a diagnosis fits; the others keep their defaults.
    free: ClassVar[tuple[str, ...]] = ()
    #: A pitch error's orders are found by a spectrum, not by seeds.
    scanned: ClassVar[bool] = False
    #: Smallest departure of the leading parameter from neutral that makes sense as a cause of its own (assumed).
    least: ClassVar[float] = 0.0
    #: Relative standard deviation that the data sheet allows a parameter: inside four of it there is no effect.
    tolerances: ClassVar[dict[str, float]] = {}

    def __init__(self, subject: str, **values: Any) -> None:
        if subject not in self.subjects:
            raise InputError(f"effect {self.kind}.{subject}: unknown subject {subject!r}; allowed: {', '.join(self.subjects)}")
        self.subject = subject
        specs = {p.name: p for p in self.parameters_of(subject)}
        for name in values:
            if name not in specs:
                raise InputError(f"effect {self.id}: unknown parameter {name!r}; allowed: {', '.join(specs)}")
        self.values: dict[str, Any] = {}
        for name, p in specs.items():
            if name in values:
                self.values[name] = self._checked(p, values[name])
            elif p.default is not None:
                self.values[name] = p.default
            elif p.kind != "choice":
                raise InputError(f"effect {self.id}: parameter {name!r} is missing")

    @classmethod
    def parameters_of(cls, subject: str) -> tuple[Parameter, ...]:
        """Parameters for one subject (units can differ between linear and rotary axes)."""
        return cls.parameters

    @classmethod
    def free_of(cls, subject: str) -> tuple[str, ...]:
        """Names that a diagnosis fits for one subject; by default the leading parameters."""
        return cls.free or tuple(p.name for p in cls.parameters_of(subject) if p.leading)

    @classmethod
    def seeds(cls, subject: str) -> list[dict[str, Any]]:
        """Starting values from which a diagnosis searches: leading parameters at a typical size off neutral."""
        return [{p.name: p.neutral + p.scale for p in cls.parameters_of(subject) if p.neutral is not None}]

    def variants(self) -> Sequence[tuple[Effect, tuple[str, ...]]]:
        """Other ways in which this effect of the user's machine may be wrong: its values, and what is free then, beside ``free``."""
        return []

    def shapes(self, present: Effect | None) -> Sequence[tuple[Effect, tuple[str, ...]]]:
        """Other shapes that a diagnosis tries once this effect is found, before it believes a second effect: where to start, what is free.

        ``present`` is the effect as the user's machine has it, if it has.
        """
        return []

    @property
    def way(self) -> float:
        """+1 where the effect acts only while its axis turns CCW (its coordinate grows), −1 for CW, 0 for both."""
        return {"CCW": 1.0, "CW": -1.0}.get(self.values.get("direction", ""), 0.0)

    def one_way(self) -> list[Effect]:
        """The same effect acting in one direction of motion only, once per direction; empty where it has one already or knows none."""
        ways = next((p.choices for p in self.parameters_of(self.subject) if p.name == "direction"), ())
        return [] if "direction" in self.values else [self.replaced(direction=way) for way in ways]

    @property
    def id(self) -> str:
        """``kind.SUBJECT``."""
        return f"{self.kind}.{self.subject}"

    @property
    def key(self) -> str:
        """What must be unique in one machine: the id, and the direction where the effect has one."""
        direction = self.values.get("direction") if hasattr(self, "values") else None
        return f"{self.id}[{direction}]" if direction else self.id

    def _checked(self, p: Parameter, value: Any) -> Any:
        if p.kind == "choice":
            if value not in p.choices:
                raise InputError(f"effect {self.id}: {p.name} = {shown(value)}; allowed: {', '.join(p.choices)}")
            return value
        if p.kind == "components":
            return self._checked_components(p, value)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise InputError(f"effect {self.id}: {p.name} = {shown(value)} is not a number")
        if not p.lower <= value <= p.upper:
            raise InputError(
                f"effect {self.id}: {p.name} = {value:g} is out of bounds; allowed: {p.lower:g} to {p.upper:g} {p.unit}".rstrip()
            )
        return float(value)

    def _checked_components(self, p: Parameter, value: Any) -> list[list[float]]:
        if not isinstance(value, (list, tuple)):
            raise InputError(f"effect {self.id}: components = {shown(value)}; allowed: a list of [order, amplitude, phase_deg]")
        if len(value) > MOST_COMPONENTS:
            raise InputError(f"effect {self.id}: {len(value)} components; allowed: up to {MOST_COMPONENTS}")
        rows = []
        for row in value:
            number = isinstance(row, (list, tuple)) and len(row) == 3
            if not number or any(isinstance(x, bool) or not isinstance(x, (int, float)) for x in row):
                raise InputError(f"effect {self.id}: component {shown(row)}; allowed: [order, amplitude, phase_deg], three numbers")
            order, amplitude, phase = row
            if not 0 < order <= 2000 or not abs(amplitude) <= p.upper or not math.isfinite(phase):
                raise InputError(
                    f"effect {self.id}: component {shown(list(row))} is out of bounds; "
                    f"allowed: order above 0 to 2000, amplitude up to {p.upper:g}, finite phase"
                )
            rows.append([float(x) for x in row])
        return rows

    def si(self, name: str) -> float:
        """A number parameter in SI."""
        return self.values[name] * next(p.factor for p in self.parameters_of(self.subject) if p.name == name)

    @property
    def is_neutral(self) -> bool:
        """True when the leading parameters switch the effect off; the plant then leaves it out altogether."""
        leading = [p for p in self.parameters_of(self.subject) if p.leading]
        return all(
            not any(row[1] for row in self.values[p.name]) if p.kind == "components" else self.values[p.name] == p.neutral for p in leading
        )

    def replaced(self, **values: Any) -> Self:
        """The same effect with some parameters changed."""
        return type(self)(self.subject, **{**self.values, **values})

    def apply(self, plant: Plant) -> None:
        """Enter the effect into the plant: its drives, transmissions or geometry. Values in SI."""

    @property
    def in_python(self) -> bool:
        """Whether the effect has a Python part (:meth:`position_error`)."""
        return type(self).position_error is not Effect.position_error

    def position_error(self, motion: Motion) -> np.ndarray | None:
        """A user's own effect in plain Python: what it adds to the load side's axis positions, (n, 5) m and rad.

        ``None`` (default) means the effect has no Python part. Called with arrays of any length n, in time order.
        """
        return None

    def __repr__(self) -> str:
        return f"{self.id}({', '.join(f'{k}={v}' for k, v in self.values.items())})"
