"""The answer in the report's first box: which axis, what is wrong with it, how much, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mjsim.commands.diagnosis import Diagnosis
from mjsim.commands.finding import DiagnosedEffect
from mjsim.digits import decimals_of, half_of, wave_ends
from mjsim.effects.registry import kinds
from mjsim.inference.unexplained import Unexplained
from mjsim.machine.chain import COORDINATES, is_linear, is_rotary
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.report.numbers import fixed
from mjsim.units import UM, percent, unit_of

#: Ends of names that have no article: one says "backlash of X", but "a command delay of X".
_WITHOUT_ARTICLE = ("backlash", "friction", "inertia", "presliding", "wear", "wind-up under gravity")


def headlines(result: Diagnosis) -> list[str]:
    """One line per missing effect, such as ``C axis: position gain about 3 % too high, or a command delay of C.``"""
    lines = [_line(e, result.before.machine) for e in result.effects[:_MOST]]
    if len(result.effects) > _MOST:
        lines.append(f"And {len(result.effects) - _MOST} smaller causes, each with its share in the table.")
    if result.unexplained:
        lines.append(_unknown(result.unexplained))
    return lines or ["No effect is missing from the machine's model."]


#: Causes that the first box names; the table below has the others.
_MOST = 4
#: What an unknown error depends on, in a sentence.
_VARIABLES = {
    "position": "its position",
    "direction": "its direction and position",
    "velocity": "its velocity",
    "acceleration": "its acceleration",
    "torque": "its motor's torque",
    "time_since_reversal": "the time since its last reversal",
    "clock_time": "the time of day",
}


def _unknown(rest: Unexplained) -> str:
    axes = " and ".join(rest.axes)
    return (
        f"{axes} axis: an unknown error of {_short(rest.rms / UM)} µm RMS that depends on {_VARIABLES[rest.variable]}."
    )


def _line(found: DiagnosedEffect, given: Machine) -> str:
    effect = found.effect
    cause = f"{_place(effect.subject)}: {sized(effect, given.effect(effect.key), found.ci95)}"
    others = [_named(effect_id) for effect_id in found.alternatives]
    if others and found.probability is not None:
        cause += f" ({percent(found.probability)})"
        others = [f"{o} ({percent(found.others[i])})" for o, i in zip(others, found.alternatives, strict=True)]
    return f"{cause}{''.join(f', or {other}' for other in others)}."


def _place(subject: str) -> str:
    return f"{subject} axis" if is_linear(subject) or is_rotary(subject) else subject


def _named(effect_id: str) -> str:
    """An effect of which no size is known, such as ``a command delay of C``."""
    name, _, one_of_many = effect_id.removesuffix("]").partition("[")
    kind, _, subject = name.partition(".")
    known = kinds().get(kind)
    name = noun(known) if known else kind.replace("_", " ")
    if known is not None and known.follows_sensor(subject):
        subject += f" by the sensor {one_of_many}"
    if name.endswith("gain"):
        name = f"wrong {name}"
    if name.endswith(_WITHOUT_ARTICLE):
        return f"{name} of {subject}"
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name} of {subject}"


def noun(effect: Effect | type[Effect]) -> str:
    """Name of an effect in a sentence."""
    return effect.noun or effect.kind.replace("_", " ")


def sized(effect: Effect, former: Effect | None = None, intervals: Mapping[str, Any] | None = None) -> str:
    """An effect with its size in words, such as ``position gain about 3 % too high``.

    Args:
        effect: the effect as it was fitted.
        former: the same effect as the machine file has it, if it does.
        intervals: 95 % intervals by parameter. Two digits are said, fewer where an interval knows fewer.
    """
    name = noun(effect)
    direction = f" while it turns {effect.values['direction']}" if "direction" in effect.values else ""
    if effect.follows_sensor(effect.subject):
        direction = f" by the sensor {effect.values['sensor']}"
    leading = [p for p in effect.parameters_of(effect.subject) if p.leading]
    if not leading:
        return name + direction
    # of a straightness, the larger of its two shapes
    parameter = leading[0] if len(leading) == 1 else max(leading, key=lambda p: abs(effect.values[p.name]))
    value, ends = effect.values[parameter.name], (intervals or {}).get(parameter.name)
    if parameter.kind == "components":
        return f"{name} {_components(value, '°' if is_rotary(effect.subject) else 'µm', ends)}{direction}"
    if parameter.neutral == 1.0:
        return f"{name} {_percent(value, ends)}{direction}"
    old = former.values.get(parameter.name) if former else None
    change = ""
    if isinstance(old, float) and old:
        change = f" ({_percent(value / old, _times(ends, 1.0 / old), 'above', 'below')} the machine file's)"
    unit = unit_of(parameter.name)[1]
    if parameter.name.endswith("ratio"):
        size = f"{_short(100.0 * value, _times(ends, 100.0))} %"
    else:
        size = f"{_short(value, ends)} {unit}".replace(" °", "°").rstrip()
    return f"{name} {'with a stiffness ' if parameter.inverse else ''}of about {size}{direction}{change}"


def _components(rows: list, unit: str, intervals: list | None) -> str:
    i = max(range(len(rows)), key=lambda k: abs(rows[k][1]))
    order, amplitude, _ = rows[i]
    more = f" and {len(rows) - 1} more" if len(rows) > 1 else ""
    size = f"{_short(abs(amplitude), wave_ends(intervals, i, 1))} {unit}".replace(" °", "°")
    return f"of about {size} at order {order:g}{more}"


def _percent(ratio: float, ends: Sequence[float] | None, above: str = "too high", below: str = "too low") -> str:
    change = 100.0 * (ratio - 1.0)
    return f"about {_short(abs(change), _times(ends, 100.0))} % {above if change > 0 else below}"


def _times(ends: Sequence[float] | None, factor: float) -> list[float] | None:
    return None if ends is None else [factor * x for x in ends]


def _short(value: float, ends: Sequence[float] | None = None) -> str:
    """Two significant digits, such as 0.0020, 3.1 or 4100; fewer where its 95 % interval knows fewer."""
    decimals = 1 - int(f"{value:.1e}".partition("e")[2])
    return fixed(value, min(decimals, decimals_of(value, ends)) if half_of(ends) else decimals)


def explained(result: Diagnosis) -> str:
    """How sure the answer is, and what to do next, in short sentences."""
    tests = len(result.before.tests)
    many = f"These {tests} tests" if tests != 1 else "This one test"
    if result.verdict == "ambiguous":
        return f"{many} cannot decide. {_next(result.next_test)}".strip()
    if result.verdict == "identified":
        also = " The unknown error comes on top of that." if result.unexplained else ""
        return f"No other effect of the catalogue explains the measurement as well.{also}"
    if result.verdict == "unknown":
        return "The error repeats. No effect of the catalogue explains it."
    return "The model explains the measurement down to the noise and the data sheet's tolerances."


def _next(following: dict | None) -> str:
    if following is None:
        return ""
    minutes, short = round(following["minutes"]), short_test(following["test"])
    if following["decides"]:
        return f"Next: one {minutes}-minute test ({short})."
    return f"No test within reach decides. The best is one of {minutes} minutes ({short})."


def short_test(table: dict) -> str:
    """A test's table as in campaign.toml, in a few words: kind, plane or axis, place of the ball, feed."""
    kind = "R-test" if "sphere_mm" in table else table["kind"].partition("_")[0]
    ball = table["sphere_mm"] if "sphere_mm" in table else table["table_ball_mm"]
    words = [" ".join(str(x) for x in (kind, table.get("plane"), table.get("axis")) if x)]
    words += [f"{axis} {value:g} mm" for axis, value in zip(COORDINATES[:2], ball[:2], strict=True) if value]
    return ", ".join([*words, f"{table['feed_mm_min']:g} mm/min"])
