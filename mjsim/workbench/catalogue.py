"""The catalogue of effects as the workbench shows it: by axis, with sliders that have sensible ends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mjsim.digits import estimate, wave_ends
from mjsim.effects import registry
from mjsim.machine.effect import Effect, Parameter, axis_of_subject
from mjsim.machine.model import Machine
from mjsim.plots.style import step_below
from mjsim.units import suffix_of

#: A slider covers the whole range of a parameter where that is at most so many typical sizes.
_WHOLE = 800.0
#: Otherwise it reaches so many typical sizes to either side of off.
_REACH = 20.0
#: Steps of a slider.
_STEPS = 1000


@dataclass(frozen=True)
class Entry:
    """One effect of the catalogue on one subject.

    Attributes:
        id: ``kind.SUBJECT``.
        title: One line.
        definition: The formula.
        signature: What one sees in the traces.
        axis: Letter of the axis that it belongs to; empty where it belongs to none.
    """

    id: str
    title: str
    definition: str
    signature: str
    axis: str

    @property
    def name(self) -> str:
        """The kind in words, with the subject where that is not the axis: ``straightness EYX``."""
        kind, _, subject = self.id.partition(".")
        return kind.replace("_", " ") + ("" if subject == self.axis else f" {subject}")


@dataclass(frozen=True)
class Slider:
    """Ends and step of a slider, in the parameter's unit; ``lower`` and ``upper`` are the catalogue's bounds."""

    low: float
    high: float
    step: float
    lower: float
    upper: float


#: Kinds of effects that both instruments show; the other kinds of the motion of a motor only a log can show.
_BOTH = (
    "friction",
    "viscous_friction",
    "velocity_gain",
    "servo_gain",
    "servo_delay",
    "velocity_feedforward",
    "torque_ripple",
)


def entries(machine: Machine, logs: bool = False) -> list[Entry]:
    """The catalogue for a machine, with the effects of its own files, in the order of its ids.

    Args:
        machine: Its axes and effects count.
        logs: What axis logs can show, in place of what a ball bar can.
    """
    out, chain = [], machine.chain
    for kind, cls in registry.kinds_of(machine.effects).items():
        if cls.for_logs != logs and not (logs and kind in _BOTH):
            continue
        for subject in cls.subjects_of(chain):
            if cls.follows_sensor(subject) and not machine.sensors:
                continue
            axis = axis_of_subject(subject, chain)
            out.append(Entry(f"{kind}.{subject}", cls.title, cls.definition, cls.signature, axis))
    return out


def by_axis(machine: Machine, logs: bool = False) -> dict[str, list[Entry]]:
    """The catalogue by the letters of the axes, in their order; what belongs to no axis comes last."""
    out: dict[str, list[Entry]] = {a: [] for a in machine.chain.letters}
    for entry in entries(machine, logs):
        out.setdefault(entry.axis, []).append(entry)
    return {axis: rows for axis, rows in out.items() if rows}


def switched_on(effect_id: str, machine: Machine) -> Effect:
    """An effect at the size from which its fits start.

    Args:
        effect_id: ``kind.SUBJECT``.
        machine: Its axes and its temperature sensors count.

    Raises:
        InputError: There is no such effect.
    """
    cls, subject = registry.effect_class(effect_id, machine.chain)
    parameters = cls.parameters_of(subject)
    seeds = cls.search.seeds_of(parameters, subject, machine.chain, machine.sensors)
    values = dict(seeds[0]) if seeds else {}
    for p in parameters:
        if p.kind == "components":
            values.setdefault(p.name, [[1.0, p.scale, 0.0]])
        elif p.kind == "number" and p.default is None:
            values.setdefault(p.name, _beside_neutral(p))
    return cls(subject, **values)


def _beside_neutral(p: Parameter) -> float:
    """A typical value: one typical size from off, or the typical size itself."""
    if p.neutral is None or not math.isfinite(p.neutral):
        return min(max(p.scale, p.lower), p.upper)
    return min(max(p.neutral + p.scale, p.lower), p.upper)


def slider(p: Parameter, value: float) -> Slider:
    """The slider of a number: the catalogue's bounds where they are near, otherwise the sizes that occur.

    Args:
        p: The parameter.
        value: Its present value, which the slider reaches as well.
    """
    off = p.neutral if p.neutral is not None else p.default if p.default is not None else 0.0
    off = off if math.isfinite(off) else p.scale
    if math.isfinite(p.lower) and math.isfinite(p.upper) and p.upper - p.lower <= _WHOLE * p.scale:
        low, high = p.lower, p.upper
    else:
        low, high = max(p.lower, off - _REACH * p.scale), min(p.upper, off + _REACH * p.scale)
    if math.isfinite(value):
        low, high = min(low, value), max(high, value)
    return Slider(low, high, step_below((high - low) / _STEPS), p.lower, p.upper)


def limits(p: Parameter) -> str:
    """The bounds of a parameter in words, such as ``0 to 1 °``."""
    ends = [("any" if not math.isfinite(x) or abs(x) >= 1e9 else f"{x:g}") for x in (p.lower, p.upper)]
    return f"{ends[0]} to {ends[1]} {p.unit}".rstrip().replace("-", "−")


def words(effect: Effect, intervals: Mapping[str, Any] | None = None) -> str:
    """The values of an effect in one line, such as ``width 0.002 °``, as their 95 % intervals allow."""
    known = intervals or {}
    parts = []
    for p in effect.parameters_of(effect.subject):
        value = effect.values.get(p.name)
        if p.kind == "components":
            rows = list(enumerate(value or []))
            largest = sorted(rows, key=lambda row: -abs(row[1][1]))[:2]
            ends = known.get(p.name)
            parts.append(", ".join(f"order {w[0]:g}: {estimate(w[1], wave_ends(ends, i, 1))}" for i, w in largest))
        elif isinstance(value, float) and (p.leading or value != p.default):
            parts.append(f"{spoken(p)} {estimate(value, known.get(p.name))} {p.unit}".rstrip())
        elif isinstance(value, str):
            parts.append(value)
    return ", ".join(part for part in parts if part)


def spoken(p: Parameter) -> str:
    """A parameter's name without its unit, in words."""
    return p.name.removesuffix(f"_{suffix_of(p.name)}").replace("_", " ")
