"""A user's own effect class made safe to call: what its methods do is watched, what they give is checked.

Every method and property of :class:`Effect` that the class overrides is replaced by one that runs it under
:mod:`mjsim.effects.guard` and says in one sentence which file, effect and method went wrong, and how.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial, wraps
from typing import Any

from mjsim.effects import guard
from mjsim.effects.results import CHECKS, Unusable, wrong
from mjsim.errors import EffectTimeout, InputError, SimulationError
from mjsim.machine.effect import Effect

#: Texts that say what an effect is.
_TEXTS = ("title", "definition", "source", "signature")
#: Special methods that mjsim calls without naming them.
_SPECIAL = ("__init__", "__repr__", "__eq__", "__hash__")
#: Methods that make an effect: what they refuse is the user's values, not their own fault.
_MAKERS = ("__init__", "replaced", "one_way", "variants", "shapes")
_MEND = "mend the file, or take the effect out of the machine"


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
        if why := wrong(p):
            refuse(f"parameters: {why}", "mjsim.Parameter(name, meaning, lower, upper, neutral=..., scale=...)")
    if cls.parameters_of.__func__ is Effect.parameters_of.__func__ and not set(cls.free) <= {p.name for p in cls.parameters}:
        refuse(f"free = {cls.free!r}", f"a tuple with names out of {', '.join(p.name for p in cls.parameters)}")
    for name in _TEXTS:
        if not isinstance(getattr(cls, name), str):
            refuse(f"{name} = {getattr(cls, name)!r}", "a text")


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
    check = CHECKS.get(name)

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
            what = str(cause) if isinstance(cause, Unusable) else fault.what
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
