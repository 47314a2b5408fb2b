"""What an effect is: one physical cause of motion error, one class in one file.

A subclass names its parameters (unit in the name, bounds, the value that switches it off), says where it acts by
overriding :meth:`Effect.apply` (drive, transmission, geometry), and is picked up everywhere by
:func:`mjsim.effects.registry.register`. What a search for causes wants to know stands beside it, in ``search``
(:class:`mjsim.machine.effect.SearchHints`).
"""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from mjsim.errors import InputError
from mjsim.io.inputs import shown
from mjsim.machine.axis import is_rotary
from mjsim.machine.chain import CHAINS, COORDINATES, Chain
from mjsim.machine.plant import Motion, Plant
from mjsim.machine.temperatures import SENSOR, SENSOR_NAMES
from mjsim.units import unit_of

# -- one parameter of an effect ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, in the units of its name.

    Attributes:
        name: e.g. ``width_deg``; the unit is its ending.
        meaning: one line.
        lower, upper: allowed closed range.
        neutral: the value that switches the effect off (leading parameters only).
        default: value when the file leaves it out; ``None`` makes it required.
        kind: ``number``, ``components`` (a list of [order, amplitude, phase_deg]), ``choice``, or ``sensor`` (name of a
            temperature sensor of the campaign).
        choices: allowed texts of a ``choice``.
        scale: a typical size, in the same unit: the step of numerical derivatives and of searches.
        inverse: fitted as its reciprocal (a stiffness is off at infinity; its compliance is off at zero).
        log: fitted as its logarithm (a time constant is above zero, and known to a factor rather than to seconds).
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
    log: bool = False

    def encode(self, value: float) -> float:
        """A value as fits see it, in typical sizes."""
        if self.log:
            return math.log(value / self.scale)
        return self.scale / value if self.inverse else value / self.scale

    def decode(self, x: float) -> float:
        """The value, inside its bounds, that fits see as ``x``."""
        if self.inverse:
            return max(self.scale / x, self.lower) if x > self.scale / self.upper else self.upper
        value = self.scale * math.exp(min(x, 700.0)) if self.log else x * self.scale
        return min(max(value, self.lower), self.upper)

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


# -- what can be done about a cause, and what ball-bar software calls it -----------------------------------------------


@dataclass(frozen=True)
class Remedy:
    """What can be done about a cause.

    Attributes:
        kind: ``adjust`` (a setting or a mechanical adjustment), ``compensate`` (a table or parameter of the control),
            ``maintain`` (a part, or the machine's surroundings) or ``share`` (belongs to every machine: taking it out
            of a simulation only says how much it makes).
        term: in the vocabulary of ball-bar software; empty where it has none.
        text: in one or two sentences.
        rotary: the text for a rotary axis, where it differs: one has a screw and a nut, the other a worm and a bearing.
    """

    kind: str
    term: str
    text: str
    rotary: str = ""

    def on(self, subject: str) -> Remedy:
        """The remedy as it fits an axis.

        Args:
            subject: what the effect acts on, such as the letter of an axis.
        """
        return replace(self, text=self.rotary, rotary="") if self.rotary and is_rotary(subject) else self

    @property
    def repairable(self) -> bool:
        """Whether a repair is meant, not only a share."""
        return self.kind != "share"


#: What is said of an effect that names no remedy.
UNKNOWN = Remedy("maintain", "", "Your own effect. The catalogue has no remedy for it.")


# -- what a search for causes wants to know about an effect ------------------------------------------------------------

#: Values of parameters by name, from which a fit starts.
Values = dict[str, Any]
#: Effects from which a fit starts, each with the names of what is free.
Starts = Sequence[tuple[Any, tuple[str, ...]]]


#: What stood in the class of an effect before there were hints.
MOVED = ("free", "seeds", "quasi_static", "scanned", "least", "variants")


def _none(*_: Any) -> Starts:
    return []


@dataclass(frozen=True)
class SearchHints:
    """How a diagnosis looks for an effect.

    Attributes:
        free: names of the parameters that are fitted; by default those that switch the effect off. Names that a subject
            does not have are left out.
        seeds: values from which fits start: a list, or a function of subject and chain. By default, the parameters that
            switch the effect off are one typical size away from their neutral values.
        quasi_static: whether the effect follows from the motion of the axes, without a new simulation of the drives.
        scanned: whether its orders or frequencies are read off a spectrum instead of being fitted from seeds.
        least: smallest departure of the leading parameter from neutral that makes sense as a cause of its own
            (assumed).
        looks_like: kinds of effects on the same axis in whose place it makes sense below ``least`` as well.
        stated: whether it is another number of the data sheet or of the control, or a limit, than stated: a machine as
            stated has none of it. Of the others every axis has some.
        within_tolerance: whether it is looked for only where the machine file states its tolerance, or has it already:
            what no single place of the ball can tell from other effects needs an expected size.
        width: prior standard deviation of the leading parameters, typical sizes, where physics says it; by default
            several are tried.
        variants: function of the effect that the user's machine has already: other ways in which it may be wrong.
    """

    free: tuple[str, ...] = ()
    seeds: Sequence[Values] | Callable[[str, Chain], Sequence[Values]] | None = None
    quasi_static: bool = True
    scanned: bool = False
    least: float = 0.0
    looks_like: tuple[str, ...] = ()
    stated: bool = False
    within_tolerance: bool = False
    width: float | None = None
    variants: Callable[[Any], Starts] = _none

    def free_of(self, parameters: Sequence[Parameter]) -> tuple[str, ...]:
        """Names of the ``parameters`` (of one subject) that a diagnosis fits."""
        if not self.free:
            return tuple(p.name for p in parameters if p.leading)
        known = {p.name for p in parameters}
        return tuple(n for n in self.free if n in known)

    def seeds_of(
        self, parameters: Sequence[Parameter], subject: str, chain: Chain, sensors: Sequence[str] = ()
    ) -> list[Values]:
        """Values from which a diagnosis starts.

        Args:
            parameters: of the subject.
            subject: what the effect acts on.
            chain: axes of the machine.
            sensors: of temperature that were recorded; an effect that follows one has seeds for each of them.
        """
        if self.seeds is None:
            seeds: list[Values] = [{p.name: p.neutral + p.scale for p in parameters if p.neutral is not None}]
        else:
            seeds = list(self.seeds(subject, chain) if callable(self.seeds) else self.seeds)
        follows = next((p.name for p in parameters if p.kind == "sensor"), None)
        return seeds if follows is None else [{**s, follows: sensor} for s in seeds for sensor in sensors]


#: Most components of one effect: each is an operation in every step of a simulation.
MOST_COMPONENTS = 1000
#: Highest order of one.
MOST_ORDER = 2000


class Effect(ABC):
    """One physical cause of motion error. ``values`` holds the parameters as the file gives them (units of their
    names).

    Attributes:
        kind: first half of the id.
        subjects: second halves: a tuple, or a function of the machine's chain (:mod:`mjsim.machine.effect`).
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
            if not 0 < order <= MOST_ORDER or not abs(amplitude) <= p.upper or not math.isfinite(phase):
                raise InputError(
                    f"effect {self.id}: component {shown(list(row))} is out of bounds; "
                    f"allowed: order above 0 to {MOST_ORDER}, amplitude up to {p.upper:g}, finite phase"
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


# -- what effects act on, as functions of the machine's chain, for the attribute ``subjects`` of an effect -------------


def every_axis(chain: Chain) -> tuple[str, ...]:
    """All axes."""
    return chain.letters


def linear_axes(chain: Chain) -> tuple[str, ...]:
    """Linear axes."""
    return chain.linear


def rotary_axes(chain: Chain) -> tuple[str, ...]:
    """Rotary axes."""
    return chain.rotary


def wobbling_axes(chain: Chain) -> tuple[str, ...]:
    """Rotary axes with an error motion: those that go round, and those of a head; where no point in space is measured,
    none.
    """
    if not chain.spatial:
        return ()
    return tuple(a.letter for a in chain.axes if a.letter in chain.round_axes or a in chain.swivelling)


def tilting_axes(chain: Chain) -> tuple[str, ...]:
    """Rotary axes that are not vertical: gravity acts on what they carry."""
    return tuple(a.letter for a in chain.axes if a.rotary and not a.vertical)


def axis_pairs(chain: Chain) -> tuple[str, ...]:
    """Pairs of linear axes, as XY."""
    return chain.planes


def straightness_errors(chain: Chain) -> tuple[str, ...]:
    """Straightness errors of the linear axes, as EYX: along Y, of the X axis."""
    return chain.straightness


def angular_errors(chain: Chain) -> tuple[str, ...]:
    """Angular errors of the linear axes, as EAX: about the X coordinate, of the X axis."""
    return chain.angular


def location_errors(chain: Chain) -> tuple[str, ...]:
    """Location errors of the rotary axes, as EC0A: about Z, of the A axis."""
    return tuple(e.name for e in chain.location_errors)


def axis_of_subject(subject: str, chain: Chain) -> str:
    """Letter of the axis that an effect on ``subject`` belongs to; empty where there is none."""
    if subject in chain.letters:
        return subject
    for error in (*chain.location_errors, *chain.squareness):
        if error.name == subject:
            return error.axis
    return subject[-1] if subject[-1:] in chain.letters else ""  # as ISO 230-1 names errors: the axis last


def in_words(subject: str, chain: Chain) -> str:
    """What a geometric error moves, and where, such as ``C centreline turned about Y, on A``; empty for other subjects.

    Args:
        subject: name of a location error, or of two axes that are not square.
        chain: axes of the machine.
    """
    for error in chain.location_errors:
        if error.name == subject:
            way = "turned about" if error.rotation else "displaced along"
            carrier = chain.carrier(error.axis)
            on = f"on {carrier}" if carrier else "on the bed"
            return f"{error.axis} centreline {way} {COORDINATES[error.along]}, {on}"
    if subject in chain.planes:
        return f"{subject[0]} and {subject[1]} not square"
    return ""
