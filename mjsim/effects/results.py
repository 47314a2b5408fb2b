"""What the methods of a user's own effect may give: each result is checked where it comes, so that the message can name the method."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from mjsim.machine.effect import Effect, Parameter

#: A position error beyond this, m or rad, is no error of a machine; mostly it is one in other units.
_LARGEST = 1.0


class Unusable(Exception):
    """What a method gave cannot be used; the message goes on with what is allowed."""


def wrong(p: Any) -> str:
    """What is wrong with a parameter, or nothing."""
    if not isinstance(p, Parameter):
        return f"{p!r} is no mjsim.Parameter"
    if not isinstance(p.name, str) or not p.name.isidentifier():
        return f"name = {p.name!r} is no name"
    if p.kind not in ("number", "components", "choice"):
        return f"kind of {p.name} = {p.kind!r} is none of number, components, choice"
    if p.kind == "choice" and not (p.choices and all(isinstance(c, str) for c in p.choices)):
        return f"choices of {p.name} = {p.choices!r} are no texts"
    if p.kind == "number":
        optional = [x for x in (p.neutral, p.default) if x is not None]
        if not all(isinstance(x, (int, float)) and not math.isnan(x) for x in (p.lower, p.upper, p.scale, *optional)):
            return f"{p.name} has something else than numbers as bounds, neutral, default or scale"
        if not 0.0 < p.scale < math.inf:
            return f"scale of {p.name} = {p.scale:g} is not above 0"
        if not all(p.lower <= x <= p.upper for x in (p.lower, *optional)):
            return f"bounds of {p.name} are {p.lower:g} to {p.upper:g}, which leaves out its neutral or default value"
    return ""


def _gave(value: Any, allowed: str) -> Unusable:
    shown = " ".join(repr(value).split())
    return Unusable(f"gave {shown if len(shown) <= 60 else type(value).__name__}; allowed: {allowed}")


def _position_error(value: Any, effect: Effect, motion: Any) -> np.ndarray:
    shape = motion.position.shape
    allowed = f"an array of finite numbers, m and rad, shape {shape}"
    if value is None:
        raise _gave(None, allowed)
    out = np.asarray(value)
    if out.dtype.kind not in "fiu":
        raise Unusable(f"gave {_kind(value, out)}; allowed: {allowed}")
    if out.shape != shape:
        raise Unusable(f"gave shape {out.shape}; allowed: {allowed}")
    out = out.astype(float)  # a copy: the effect may keep and change its own
    peak = max(out.max(initial=0.0), -out.min(initial=0.0))  # NaN where there is one
    if not np.isfinite(peak):
        raise Unusable(f"gave numbers that are not finite ({int((~np.isfinite(out)).sum())} of {out.size}); allowed: {allowed}")
    if peak > _LARGEST:
        raise Unusable(f"gave {peak:.3g}; allowed: errors up to {_LARGEST:g}, in m and rad (not µm or degrees)")
    return out


def _kind(value: Any, array: np.ndarray) -> str:
    return f"an array of {array.dtype}" if isinstance(value, np.ndarray) else f"a {type(value).__name__} of {array.dtype}"


def _values(value: Any, specs: Iterable[Parameter]) -> bool:
    """Whether ``value`` is a dictionary of parameters of these names."""
    return isinstance(value, dict) and set(value) <= {p.name for p in specs}


def _seeds(value: Any, *args: Any) -> list:
    specs = _specs(args)
    if not isinstance(value, (list, tuple)) or not all(_values(v, specs) for v in value):
        raise _gave(value, f"a list of dictionaries with values of {', '.join(p.name for p in specs) or 'no parameter'}")
    return list(value)


def _specs(args: tuple) -> tuple[Parameter, ...]:
    """Parameters of the class and subject with which a class method was called."""
    owner = args[0] if isinstance(args[0], type) else None
    return owner.parameters_of(args[1]) if owner is not None else ()


def _free_of(value: Any, *args: Any) -> tuple:
    names = [p.name for p in _specs(args)]
    if not isinstance(value, (list, tuple)) or not set(value) <= set(names):
        raise _gave(value, f"a tuple with names out of {', '.join(names)}")
    return tuple(value)


def _parameters_of(value: Any, *args: Any) -> tuple:
    if not isinstance(value, (list, tuple)) or any(wrong(p) for p in value):
        raise _gave(value, "a tuple of mjsim.Parameter")
    return tuple(value)


def _variants(value: Any, *args: Any) -> list:
    def pair(x: Any) -> bool:
        return isinstance(x, (tuple, list)) and len(x) == 2 and isinstance(x[0], Effect) and isinstance(x[1], (tuple, list))

    if not isinstance(value, (list, tuple)) or not all(map(pair, value)):
        raise _gave(value, "a list of (effect, names of free parameters)")
    return list(value)


def _effects(value: Any, *args: Any) -> list:
    if not isinstance(value, (list, tuple)) or not all(isinstance(x, Effect) for x in value):
        raise _gave(value, "a list of effects")
    return list(value)


def _effect(value: Any, *args: Any) -> Effect:
    if not isinstance(value, Effect):
        raise _gave(value, "an effect")
    return value


def _number(value: Any, *args: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not math.isfinite(value):
        raise _gave(value, "a finite number")
    return float(value)


def _truth(value: Any, *args: Any) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        raise _gave(value, "True or False")
    return bool(value)


def _text(value: Any, *args: Any) -> str:
    if not isinstance(value, str):
        raise _gave(value, "a text")
    return value


def _init(value: Any, effect: Effect, *args: Any) -> None:
    if not isinstance(vars(effect).get("values"), dict) or "subject" not in vars(effect):
        raise Unusable("did not call super().__init__(subject, **values), which it must")


def _act(value: Any, effect: Effect, plant: Any) -> None:
    if why := plant.unusable():
        raise Unusable(f"put {why}; allowed: finite numbers, inertias, gains and gears above 0")


CHECKS: dict[str, Callable[..., Any]] = {
    "__init__": _init,
    "position_error": _position_error,
    "apply": _act,
    "seeds": _seeds,
    "free_of": _free_of,
    "parameters_of": _parameters_of,
    "variants": _variants,
    "shapes": _variants,
    "one_way": _effects,
    "replaced": _effect,
    "si": _number,
    "way": _number,
    "is_neutral": _truth,
    "id": _text,
    "key": _text,
    "__repr__": _text,
}
