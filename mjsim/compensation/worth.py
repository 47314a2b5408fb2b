"""Which of the known errors are worth typing into a control, and why the others are not."""

from __future__ import annotations

from dataclasses import dataclass

from mjsim.commands.saved import Known, SavedDiagnosis
from mjsim.digits import estimate, expanded
from mjsim.machine.effect import Effect, Parameter

#: Kinds that are part of the drive and not of its position: no table or offset changes them.
NOT_POSITION = (
    "friction",
    "viscous_friction",
    "velocity_gain",
    "torque_ripple",
    "drive_compliance",
    "velocity_feedforward",
    "servo_delay",
    "vibration",
)


@dataclass(frozen=True)
class Left:
    """An error that is not corrected, and why.

    Attributes:
        key: Of the effect.
        reason: One sentence.
    """

    key: str
    reason: str


@dataclass(frozen=True)
class Worth:
    """One effect that is worth correcting.

    Attributes:
        known: As diagnosed.
        effect: Reduced to the numbers that are larger than their uncertainty.
        uncertainty: 95 % half width of each remaining size, in the unit of its name; empty where none is known.
        sizes: The sizes themselves, by the same labels.
    """

    known: Known
    effect: Effect
    uncertainty: dict[str, float]
    sizes: dict[str, float]


def worth_typing(saved: SavedDiagnosis) -> tuple[list[Worth], list[Left]]:
    """The errors of a diagnosed machine that are worth correcting, and the others with the reason."""
    worth, left = [], []
    for known in saved.known:
        effect = known.effect
        if effect.is_neutral or effect.kind in NOT_POSITION:
            if known.origin == "found":
                left.append(Left(effect.key, _DRIVE.get(effect.kind, "it is repaired at the drive, not by a table")))
            continue
        if known.alternatives:
            left.append(Left(effect.key, f"ambiguous: the data cannot tell it from {', '.join(known.alternatives)}"))
            continue
        if not known.observable:
            left.append(Left(effect.key, "not observable: the tests say no more about it than its tolerance does"))
            continue
        reduced, small = _reduced(known)
        left += [Left(effect.key, text) for text in small]
        if reduced is not None:
            worth.append(reduced)
    return worth, left


_DRIVE = {
    "friction": "friction acts on the torque; check lubrication and preload, or tune the control's own friction "
    "compensation (compensate --friction)",
    "servo_delay": "a delay is no position error; delay the other axes by the same time where the control can",
    "velocity_feedforward": "set the feedforward of this axis as that of the others",
    "velocity_gain": "set the velocity gain of this axis as the data sheet says",
    "vibration": "a vibration has to be found at its source",
}


def _reduced(known: Known) -> tuple[Worth | None, list[str]]:
    """The effect without the sizes that are smaller than their uncertainty, and sentences on those."""
    effect = known.effect
    values, small, kept, sizes = dict(effect.values), [], {}, {}
    for p in effect.parameters_of(effect.subject):
        if p.kind == "components":
            rows = []
            for i, row in enumerate(values[p.name]):
                half = _half(known.ci95.get(p.name), i)
                label = f"order {row[0]:g}"
                if half is not None and row[1] <= half:
                    small.append(_too_small(label, row[1], half, p, effect))
                elif row[1]:
                    rows.append(row)
                    sizes[label] = row[1]
                    if half is not None:
                        kept[label] = half
            values[p.name] = rows
        elif p.neutral is not None:
            half = _half(known.ci95.get(p.name))
            size = values[p.name] - p.neutral
            if half is not None and abs(size) <= half:
                small.append(_too_small(p.name, size, half, p, effect))
                values[p.name] = p.neutral
            elif size:
                sizes[p.name] = values[p.name]
                if half is not None:
                    kept[p.name] = half
    reduced = effect.replaced(**values)
    return (None if reduced.is_neutral else Worth(known, reduced, kept, sizes)), small


def _half(interval: list | None, component: int | None = None) -> float | None:
    """Half width of a 95 % interval; of one component's amplitude where its number is given."""
    if not interval:
        return None
    low, high = interval
    if component is not None:
        return 0.5 * (high[component][1] - low[component][1])
    return 0.5 * (high - low)


def _too_small(label: str, size: float, half: float, p: Parameter, effect: Effect) -> str:
    unit = unit_text(p, effect)
    ends = size - half, size + half
    return (
        f"not worth typing: {label} is {estimate(size, ends)} {expanded(ends)}{unit}, smaller than its own uncertainty"
    )


def unit_text(p: Parameter, effect: Effect) -> str:
    """Unit of a size with a blank before it, empty for ratios."""
    from mjsim.machine.chain import is_rotary

    if p.kind == "components":
        return "°" if is_rotary(effect.subject) else " µm"
    return "°" if p.unit == "°" else f" {p.unit}" if p.unit else ""
