"""The open catalogue of effects: built-in files, installed entry points, and a user's own file."""

from __future__ import annotations

import importlib
import math
import pkgutil
from collections.abc import Iterable
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from mjsim.errors import InputError, SimulationError, probably_meant
from mjsim.machine import own
from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.machine.effect import MOVED, Effect, Parameter, Remedy, SearchHints
from mjsim.units import DIMENSIONLESS, UNITS, has_unit

_E = TypeVar("_E", bound=Effect)
_REGISTRY: dict[str, type[Effect]] = {}
_NOT_EFFECTS = {"registry"}
#: Texts that say what an effect is.
_TEXTS = ("title", "definition", "source", "signature")


def register(cls: type[_E]) -> type[_E]:
    """Class decorator: makes an effect known under its ``kind``.

    Raises:
        InputError: a class attribute is not what :class:`Effect` says, or the kind is taken.
    """
    if why := _wrong(cls):
        raise InputError(f"effect class {cls.__name__}: {why}")
    other = _REGISTRY.get(cls.kind)
    if other is not None and other.__module__ != cls.__module__ and not (_is_from_file(other) and _is_from_file(cls)):
        raise InputError(
            f"effect kind {cls.kind!r} of {cls.__module__} is already taken by {other.__module__}; choose another kind"
        )
    _REGISTRY[cls.kind] = cls
    return cls


@cache
def _load_installed() -> None:
    package = importlib.import_module("mjsim.effects")
    for module in pkgutil.iter_modules(package.__path__):
        if module.name not in _NOT_EFFECTS:
            importlib.import_module(f"mjsim.effects.{module.name}")
    for point in entry_points(group="mjsim.effects"):
        try:
            point.load()
        except Exception as error:
            package = point.dist.name if point.dist else "?"
            raise InputError(
                f"effect {point.name!r} of the installed package {package}: {type(error).__name__}: {error}; mend "
                f"or uninstall the package"
            ) from error


def kinds() -> dict[str, type[Effect]]:
    """All known effect classes by kind."""
    _load_installed()
    return dict(sorted(_REGISTRY.items()))


def kinds_of(effects: Iterable[Effect]) -> dict[str, type[Effect]]:
    """Effect classes by kind that concern one machine: a user's file belongs to the machines that name it.

    Args:
        effects: of the machine.
    """
    shared = {kind: cls for kind, cls in kinds().items() if not _is_from_file(cls)}
    return dict(sorted((shared | {e.kind: type(e) for e in effects}).items()))


def _is_from_file(cls: type[Effect]) -> bool:
    """Whether a class comes from a user's file."""
    return cls.__module__.startswith(own.USER_MODULE)


def all_ids(chain: Chain = FIVE_AXIS, for_logs: bool = False, sensors: bool = True) -> list[str]:
    """Every ``kind.SUBJECT`` of the catalogue for a machine with these axes, without those of users' files.

    Args:
        chain: axes of the machine.
        for_logs: those that are looked for in axis logs only, instead of all others.
        sensors: also those that follow a temperature sensor.
    """
    return [
        f"{k}.{s}"
        for k, cls in kinds_of(()).items()
        if cls.for_logs == for_logs
        for s in cls.subjects_of(chain)
        if sensors or not cls.follows_sensor(s)
    ]


def load_file(path: Path) -> type[Effect]:
    """Load a user's own effect: a Python file that defines and registers exactly one effect class.

    Raises:
        InputError: the file cannot be read or run, or does not register exactly one effect.
    """
    _load_installed()
    if path.suffix != ".py" or not path.is_file():
        raise InputError(
            f"effect file {path}: no such file; allowed: the path of a Python file (.py) that registers one effect"
        )
    before = dict(_REGISTRY)
    module = ModuleType(f"{own.USER_MODULE}{path.stem}")
    module.__file__ = str(path)
    try:
        with own.running(f"effect file {path}", module.__name__):
            exec(
                compile(path.read_bytes(), str(path), "exec"), module.__dict__
            )  # no __pycache__ beside the user's file
        new = [
            cls for cls in _REGISTRY.values() if cls.__module__ == module.__name__ and before.get(cls.kind) is not cls
        ]
        if not new:
            raise InputError(f"effect file {path}: no class has @mjsim.register above it")
        if len(new) > 1:
            names = ", ".join(cls.__name__ for cls in new)
            raise InputError(
                f"effect file {path}: {len(new)} classes have @mjsim.register above them ({names}); allowed: one "
                f"class a file"
            )
    except BaseException as error:
        restore(before)
        if isinstance(error, SimulationError):
            raise InputError(str(error)) from error
        raise
    return new[0]


def _wrong(cls: type[Effect]) -> str:
    """What is wrong with the attributes of an effect class, and what is allowed; nothing where all is well."""
    for name in ("kind", "subjects", "parameters", *_TEXTS):
        if not hasattr(cls, name):
            return f"the class attribute {name!r} is missing"
    if not isinstance(cls.kind, str) or not cls.kind.isidentifier():
        return f"kind = {cls.kind!r}; allowed: a name of letters, digits and _"
    if wrong := [name for name in MOVED if hasattr(cls, name)]:
        return f"the class attribute {wrong[0]!r} is none; allowed: search = mjsim.SearchHints({wrong[0]}=...)"
    subjects = cls.subjects_of(FIVE_AXIS) if callable(cls.subjects) else cls.subjects
    named = isinstance(subjects, (tuple, list)) and all(isinstance(s, str) and s.isidentifier() for s in subjects)
    if not named or not subjects or len(set(subjects)) < len(subjects):
        return f"subjects = {subjects!r}; allowed: a tuple of different names such as {FIVE_AXIS.letters[:2]}"
    if not isinstance(cls.search, SearchHints):
        return f"search = {cls.search!r}; allowed: mjsim.SearchHints(...)"
    if not isinstance(cls.remedy, Remedy):
        return f"remedy = {cls.remedy!r}; allowed: mjsim.Remedy(kind, term, text)"
    for name in (*_TEXTS, "noun"):
        if not isinstance(getattr(cls, name), str):
            return f"{name} = {getattr(cls, name)!r}; allowed: a text"
    known = set()
    for subject in subjects:
        parameters = cls.parameters_of(subject)
        if not isinstance(parameters, (tuple, list)) or not all(isinstance(p, Parameter) for p in parameters):
            return f"parameters = {parameters!r}; allowed: a tuple of mjsim.Parameter"
        if why := next(filter(None, map(_wrong_parameter, parameters)), ""):
            return why
        known |= {p.name for p in parameters}
    if not set(cls.search.free) <= known:
        return f"free = {cls.search.free!r}; allowed: a tuple with names out of {', '.join(sorted(known))}"
    return ""


def _wrong_parameter(p: Parameter) -> str:
    """What is wrong with a parameter, and what is allowed; nothing where all is well."""
    if not isinstance(p.name, str) or not p.name.isidentifier():
        return f"the parameter name {p.name!r}; allowed: a name of letters, digits and _"
    if p.kind not in ("number", "components", "choice", "sensor"):
        return f"kind of the parameter {p.name} = {p.kind!r}; allowed: number, components, choice, sensor"
    if p.kind == "choice" and not (p.choices and all(isinstance(c, str) for c in p.choices)):
        return f"choices of the parameter {p.name} = {p.choices!r}; allowed: a tuple of texts"
    if p.kind != "number":
        return ""
    if not has_unit(p.name) and p.name.rpartition("_")[2] not in DIMENSIONLESS:
        return (
            f"the parameter name {p.name!r} has no unit; allowed endings: {', '.join('_' + u for u in UNITS)}, "
            f"and for plain numbers: {', '.join(DIMENSIONLESS)}"
        )
    numbers = [x for x in (p.lower, p.upper, p.scale, p.neutral, p.default) if x is not None]
    if not all(isinstance(x, (int, float)) and not math.isnan(x) for x in numbers):
        return f"the parameter {p.name} has bounds, scale, neutral or default {numbers}; allowed: numbers"
    if not 0.0 < p.scale < math.inf:
        return f"scale of the parameter {p.name} = {p.scale:g}; allowed: above 0"
    if not all(p.lower <= x <= p.upper for x in (p.lower, p.neutral, p.default) if x is not None):
        return (
            f"the parameter {p.name} has the bounds {p.lower:g} to {p.upper:g}; allowed: bounds around its neutral "
            f"and default values"
        )
    return ""


def restore(before: dict[str, type[Effect]]) -> None:
    """Make the known effects those of ``before``, as :func:`kinds` gave them."""
    _REGISTRY.clear()
    _REGISTRY.update(before)


def effect_class(effect_id: str, chain: Chain = FIVE_AXIS) -> tuple[type[Effect], str]:
    """Class and subject of an id.

    Args:
        effect_id: ``kind.SUBJECT``.
        chain: axes of the machine.

    Raises:
        InputError: the id is unknown.
    """
    kind, _, subject = effect_id.partition(".")
    known = kinds()
    if kind not in known:
        raise InputError(  # all kinds are more than fits in a sentence
            f"unknown effect {effect_id!r}{probably_meant(kind, known)}; allowed: KIND.SUBJECT, such as "
            f"backlash.{chain.letters[0]}; `mjsim effects` lists the known kinds"
        )
    subjects = known[kind].subjects_of(chain)
    if subject not in subjects:
        able = ", ".join(subjects) or "no axis of this machine"
        raise InputError(f"unknown effect {effect_id!r}; {kind} exists for: {able}")
    return known[kind], subject


def make(effect_id: str, chain: Chain = FIVE_AXIS, **values: Any) -> Effect:
    """An effect by id.

    Args:
        effect_id: ``kind.SUBJECT``.
        chain: axes of the machine.
        **values: parameters.

    Raises:
        InputError: unknown id or parameter, or a value out of bounds.

    >>> make("backlash.A", width_deg=0.002)
    backlash.A(width_deg=0.002)
    """
    cls, subject = effect_class(effect_id, chain)
    return cls(subject, **values)
