"""What an effect is: one physical cause of motion error, one class in one file.

A subclass names its parameters (unit in the name, bounds, the value that switches it off), says where it acts by
overriding :meth:`Effect.apply` (drive, transmission, geometry), and is picked up everywhere by
:func:`mjsim.effects.registry.register`. What a search for causes wants to know stands beside it, in ``search``
(:class:`mjsim.machine.hints.SearchHints`).
"""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Callable
from typing import Any, ClassVar, Self

import numpy as np

from mjsim.errors import InputError
from mjsim.io.inputs import shown
from mjsim.machine.chain import CHAINS, Chain
from mjsim.machine.hints import SearchHints
from mjsim.machine.motion import Motion
from mjsim.machine.parameter import Parameter
from mjsim.machine.plant import Plant
from mjsim.machine.remedy import UNKNOWN, Remedy
from mjsim.machine.temperatures import SENSOR, SENSOR_NAMES

#: Most components of one effect: each is an operation in every step of a simulation.
MOST_COMPONENTS = 1000


class Effect(ABC):
    """One physical cause of motion error. ``values`` holds the parameters as the file gives them (units of their
    names).

    Attributes:
        kind: first half of the id.
        subjects: second halves: a tuple, or a function of the machine's chain (:mod:`mjsim.machine.subjects`).
        parameters: of every subject; where they differ, :meth:`parameters_of` says so.
        title: one line for lists.
        definition: the formula.
        source: where the formula comes from.
        signature: what one sees in the traces.
        noun: name in a sentence, such as ``command delay``; by default the kind.
        remedy: what can be done about it.
        search: what a search for causes wants to know; by default it follows from the parameters.
        for_logs: whether it is looked for in axis logs only.

    Raises:
        InputError: the subject or a parameter is unknown, missing, or a value is out of bounds.
    """

    kind: ClassVar[str]
    subjects: ClassVar[tuple[str, ...] | Callable[[Chain], tuple[str, ...]]]
    parameters: ClassVar[tuple[Parameter, ...]]
    title: ClassVar[str]
    definition: ClassVar[str]
    source: ClassVar[str]
    signature: ClassVar[str]
    noun: ClassVar[str] = ""
    remedy: ClassVar[Remedy] = UNKNOWN
    search: ClassVar[SearchHints] = SearchHints()
    for_logs: ClassVar[bool] = False

    def __init__(self, subject: str, **values: Any) -> None:
        if not any(subject in self.subjects_of(chain) for chain in CHAINS):
            allowed = dict.fromkeys(s for chain in CHAINS for s in self.subjects_of(chain))
            raise InputError(
                f"effect {self.kind}.{subject}: unknown subject {subject!r}; allowed: {', '.join(allowed)}"
            )
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
    def subjects_of(cls, chain: Chain) -> tuple[str, ...]:
        """What the effect can act on in a machine with these axes."""
        subjects = cls.subjects
        return tuple(subjects(chain) if callable(subjects) else subjects)

    @classmethod
    def parameters_of(cls, subject: str) -> tuple[Parameter, ...]:
        """Parameters for one subject (units can differ between linear and rotary axes)."""
        return cls.parameters

    @classmethod
    def follows_sensor(cls, subject: str) -> bool:
        """Whether the effect on a subject is the effect of a temperature that a sensor recorded."""
        return any(p.kind == "sensor" for p in cls.parameters_of(subject))

    def direction_sign(self, chain: Chain) -> float:
        """Sign of the velocity at which the effect acts: +1, −1, or 0 where it acts in both directions.

        Args:
            chain: the machine's axes. CCW is how the axis turns what it carries; its sense says whether its position
                grows then.
        """
        ccw = {"CCW": 1.0, "CW": -1.0}.get(self.values.get("direction", ""), 0.0)
        return ccw * chain.axis(self.subject).ccw if ccw else 0.0

    @property
    def id(self) -> str:
        """``kind.SUBJECT``."""
        return f"{self.kind}.{self.subject}"

    @property
    def key(self) -> str:
        """What must be unique in one machine: the id, and the direction or the sensor where the effect has one."""
        values = getattr(self, "values", {})
        one_of_many = values.get("direction") or values.get("sensor")
        return f"{self.id}[{one_of_many}]" if one_of_many else self.id

    def _checked(self, p: Parameter, value: Any) -> Any:
        if p.kind == "choice":
            if value not in p.choices:
                raise InputError(f"effect {self.id}: {p.name} = {shown(value)}; allowed: {', '.join(p.choices)}")
            return value
        if p.kind == "components":
            return self._checked_components(p, value)
        if p.kind == "sensor":
            if not isinstance(value, str) or not SENSOR.fullmatch(value):
                raise InputError(f"effect {self.id}: {p.name} = {shown(value)}; allowed: {SENSOR_NAMES}")
            return value
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise InputError(f"effect {self.id}: {p.name} = {shown(value)} is not a number")
        if not p.lower <= value <= p.upper:
            raise InputError(
                f"effect {self.id}: {p.name} = {value:g} is out of bounds; allowed: {p.lower:g} to {p.upper:g} "
                f"{p.unit}".rstrip()
            )
        return float(value)

    def _checked_components(self, p: Parameter, value: Any) -> list[list[float]]:
        if not isinstance(value, (list, tuple)):
            raise InputError(
                f"effect {self.id}: components = {shown(value)}; allowed: a list of [order, amplitude, phase_deg]"
            )
        if len(value) > MOST_COMPONENTS:
            raise InputError(f"effect {self.id}: {len(value)} components; allowed: up to {MOST_COMPONENTS}")
        rows = []
        for row in value:
            number = isinstance(row, (list, tuple)) and len(row) == 3
            if not number or any(isinstance(x, bool) or not isinstance(x, (int, float)) for x in row):
                raise InputError(
                    f"effect {self.id}: component {shown(row)}; allowed: [order, amplitude, phase_deg], three numbers"
                )
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
            not any(row[1] for row in self.values[p.name])
            if p.kind == "components"
            else self.values[p.name] == p.neutral
            for p in leading
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
        """A user's own effect in plain Python: what it adds to the load side's axis positions, (n, axes) m and rad.

        ``None`` (default) means the effect has no Python part. Called with arrays of any length n, in time order.
        """
        return None

    def __repr__(self) -> str:
        return f"{self.id}({', '.join(f'{k}={v}' for k, v in self.values.items())})"
