"""A user's own effect class made safe to call: what its methods do is watched, what they give is checked.

Every method and property of :class:`Effect` that the class overrides is replaced by one that runs it under
:mod:`mjsim.effects.guard` and says in one sentence which file, effect and method went wrong, and how.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable
from functools import partial, wraps
from typing import Any

import numpy as np

from mjsim.effects import guard
from mjsim.effects.base import Effect, Parameter
from mjsim.errors import EffectTimeout, InputError, SimulationError

#: Texts that say what an effect is.
_TEXTS = ("title", "definition", "source", "signature")
#: Special methods that mjsim calls without naming them.
_SPECIAL = ("__init__", "__repr__", "__eq__", "__hash__")
#: Methods that make an effect: what they refuse is the user's values, not their own fault.
_MAKERS = ("__init__", "replaced", "one_way", "variants", "shapes")
_MEND = "mend the file, or take the effect out of the machine"
#: A position error beyond this, m or rad, is no error of a machine; mostly it is one in other units.
_LARGEST = 1.0


def check_class(cls: type[Effect]) -> None:
    """Refuse an effect class whose attributes are not what :class:`Effect` says.

    Raises:
        InputError: names class and attribute.
    """

    def refuse(what: str, allowed: str) -> None:
        raise InputError(f"effect class {cls.__name__}: {what}; allowed: {allowed}")

    for name in ("kind", "subjects", "parameters", *_TEXTS):
        if not hasattr(cls, name):
            raise InputError(f"effect class {cls.__name__}: the class attribute {name!r} is missing")
    if not isinstance(cls.kind, str) or not cls.kind.isidentifier():
        refuse(f"kind = {cls.kind!r}", "a name of letters, digits and _")
    named = isinstance(cls.subjects, (tuple, list)) and all(isinstance(s, str) and s.isidentifier() for s in cls.subjects)
    if not named or not cls.subjects or len(set(cls.subjects)) < len(cls.subjects):
        refuse(f"subjects = {cls.subjects!r}", 'a tuple of different names such as ("X", "Y")')
    if not isinstance(cls.parameters, (tuple, list)):
        refuse(f"parameters = {cls.parameters!r}", "a tuple of mjsim.Parameter")
    for p in cls.parameters:
        if why := _wrong(p):
            refuse(f"parameters: {why}", "mjsim.Parameter(name, meaning, lower, upper, neutral=..., scale=...)")
    if cls.parameters_of.__func__ is Effect.parameters_of.__func__ and not set(cls.free) <= {p.name for p in cls.parameters}:
        refuse(f"free = {cls.free!r}", f"a tuple with names out of {', '.join(p.name for p in cls.parameters)}")
    for name in _TEXTS:
        if not isinstance(getattr(cls, name), str):
            refuse(f"{name} = {getattr(cls, name)!r}", "a text")


def _wrong(p: Any) -> str:
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


def guard_class(cls: type[Effect]) -> None:
    """Replace, in ``cls`` and the bases of the user's own, everything that mjsim calls by what :func:`_watched` makes of it."""
    known = {*(n for n in dir(Effect) if not n.startswith("__")), *Effect.__annotations__, *_SPECIAL}
    for owner in cls.__mro__:
        if owner.__module__.partition(".")[0] in ("mjsim", "builtins", "abc", "typing"):
            continue
        for name, member in list(vars(owner).items()):
            if name not in known or getattr(member, "_watched_by_mjsim", False):
                continue
            if isinstance(member, (classmethod, staticmethod)):
                setattr(owner, name, type(member)(_watched(member.__func__, name, cls)))
            elif isinstance(member, property) and member.fget is not None:
                setattr(owner, name, property(_watched(member.fget, name, None), member.fset, member.fdel, member.__doc__))
            elif callable(member) and not isinstance(member, type):
                setattr(owner, name, _watched(member, name, None))


def _watched(code: Callable[..., Any], name: str, cls: type[Effect] | None) -> Callable[..., Any]:
    """``code`` under watch, its result checked. ``cls``: where the first argument is not an effect."""
    if getattr(code, "_watched_by_mjsim", False):
        return code
    written = getattr(inspect.unwrap(code), "__code__", None)
    file, first = (written.co_filename, written.co_firstlineno) if written else ("", None)
    check = _CHECKS.get(name)

    def checked(*args: Any, **kwargs: Any) -> Any:
        value = code(*args, **kwargs)
        return value if check is None else check(value, *args)

    @wraps(code)
    def run(*args: Any, **kwargs: Any) -> Any:
        label = f"effect {_id(cls, args)}: {name}"
        try:
            return guard.watched(file, partial(checked, *args, **kwargs), label=label)
        except InputError as error:
            if name in _MAKERS:  # a value that is out of bounds
                raise
            what, line, cause, advice, sort = f"raised {guard.said(error)}", guard.line_of(error, file), error, _MEND, SimulationError
        except guard.Fault as fault:
            cause, line, advice = fault.__cause__, fault.line, _advice(fault)
            what = str(cause) if isinstance(cause, _Unusable) else fault.what
            sort = EffectTimeout if fault.timeout else SimulationError
        where = f" ({guard.place(file, line or first)})" if file else ""
        raise sort(f"{label} {what}{where}; {advice}") from cause

    marked: Any = run
    marked._watched_by_mjsim = True
    return marked


def _id(cls: type[Effect] | None, args: tuple) -> str:
    """``kind.SUBJECT`` without a call of the user's code; the kind alone where there is no effect yet."""
    first = args[0] if args else None
    if isinstance(first, Effect):
        subject = vars(first).get("subject", args[1] if len(args) > 1 and isinstance(args[1], str) else None)
        return f"{_kind_of(type(first))}.{subject}" if subject else _kind_of(type(first))
    return _kind_of(cls or first)


def _kind_of(cls: Any) -> str:
    return str(getattr(cls, "kind", getattr(cls, "__name__", "?")))


def _advice(fault: guard.Fault) -> str:
    cause = fault.__cause__
    if fault.timeout:
        return f"mend the file, or allow more seconds with the environment variable {guard.VARIABLE}"
    if isinstance(cause, ValueError) and "read-only" in str(cause):
        return "what the motion holds cannot be written into: work on a copy"
    return _MEND


class _Unusable(Exception):
    """What a method gave cannot be used; the message goes on with what is allowed."""


def _gave(value: Any, allowed: str) -> _Unusable:
    shown = " ".join(repr(value).split())
    return _Unusable(f"gave {shown if len(shown) <= 60 else type(value).__name__}; allowed: {allowed}")


# -- what the methods may give ------------------------------------------------------------------------------------------------------


def _position_error(value: Any, effect: Effect, motion: Any) -> np.ndarray:
    shape = motion.position.shape
    allowed = f"an array of finite numbers, m and rad, shape {shape}"
    if value is None:
        raise _gave(None, allowed)
    out = np.asarray(value)
    if out.dtype.kind not in "fiu":
        raise _Unusable(f"gave {_kind(value, out)}; allowed: {allowed}")
    if out.shape != shape:
        raise _Unusable(f"gave shape {out.shape}; allowed: {allowed}")
    out = out.astype(float)  # a copy: the effect may keep and change its own
    if not np.isfinite(out).all():
        raise _Unusable(f"gave numbers that are not finite ({int((~np.isfinite(out)).sum())} of {out.size}); allowed: {allowed}")
    if np.abs(out).max(initial=0.0) > _LARGEST:
        raise _Unusable(f"gave {np.abs(out).max():.3g}; allowed: errors up to {_LARGEST:g}, in m and rad (not µm or degrees)")
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
    if not isinstance(value, (list, tuple)) or any(_wrong(p) for p in value):
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
        raise _Unusable("did not call super().__init__(subject, **values), which it must")


def _act(value: Any, effect: Effect, plant: Any) -> None:
    if why := plant.unusable():
        raise _Unusable(f"put {why}; allowed: finite numbers, inertias, gains and gears above 0")


_CHECKS: dict[str, Callable[..., Any]] = {
    "__init__": _init,
    "position_error": _position_error,
    "act": _act,
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
