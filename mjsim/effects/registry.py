"""The open catalogue of effects: built-in files, installed entry points, and a user's own file."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache, partial
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from mjsim.effects import guard
from mjsim.effects.hooks import check_class, guard_class
from mjsim.errors import InputError
from mjsim.io.inputs import is_file
from mjsim.machine.effect import Effect

_E = TypeVar("_E", bound=Effect)
_REGISTRY: dict[str, type[Effect]] = {}
_NOT_EFFECTS = {"confine", "guard", "hooks", "last_resort", "registry", "results"}


def register(cls: type[_E]) -> type[_E]:
    """Class decorator: makes an effect known under its ``kind``. A clash of names is refused.

    What a class that is not mjsim's own overrides is watched from then on (:mod:`mjsim.effects.hooks`).
    """
    check_class(cls)
    other = _REGISTRY.get(cls.kind)
    if other is not None and other.__module__ != cls.__module__:
        raise InputError(f"effect kind {cls.kind!r} of {cls.__module__} is already taken by {other.__module__}; choose another kind")
    guard_class(cls)
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
            guard.watched("", point.load, guard.LOAD_SHARE, f"effect {point.name!r}")
        except (guard.Fault, InputError) as error:
            package = point.dist.name if point.dist else "?"
            raise InputError(f"effect {point.name!r} of the installed package {package}: {error}; mend or uninstall the package") from error


def kinds() -> dict[str, type[Effect]]:
    """All known effect classes by kind."""
    _load_installed()
    return dict(sorted(_REGISTRY.items()))


def all_ids() -> list[str]:
    """Every ``kind.SUBJECT`` of the catalogue."""
    return [f"{k}.{s}" for k, cls in kinds().items() for s in cls.subjects]


def load_file(path: Path) -> type[Effect]:
    """Load a user's own effect: a Python file that defines and registers exactly one effect class.

    Raises:
        InputError: the file cannot be read or run, or does not register exactly one effect.
    """
    _load_installed()
    if path.suffix != ".py" or not is_file(path):
        raise InputError(f"effect file {path}: no such file; allowed: the path of a Python file (.py) that registers one effect")
    before = dict(_REGISTRY)
    module = ModuleType(f"mjsim_user_{path.stem}")
    module.__file__ = str(path)
    try:
        guard.watched(str(path), partial(_run, path, module), guard.LOAD_SHARE, f"effect file {path}")
    except InputError as error:
        restore(before)
        raise InputError(f"effect file {path}: {error}") from None
    except guard.Fault as fault:
        restore(before)
        raise InputError(f"effect file {path}: {_why(fault)}") from fault
    new = [cls for cls in _REGISTRY.values() if cls.__module__ == module.__name__ and (before.get(cls.kind) is not cls)]
    if len(new) != 1:
        restore(before)
        raise InputError(f"effect file {path}: {len(new)} effect classes registered; allowed: exactly one class with @register")
    return new[0]


def _run(path: Path, module: ModuleType) -> None:
    exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)  # no __pycache__ beside the user's file


def _why(fault: guard.Fault) -> str:
    where = "" if fault.line is None else f" (line {fault.line})"
    if fault.timeout:
        return f"{fault.what} while it was loaded{where}; mend it, or allow three times more with the variable {guard.VARIABLE}"
    return f"{fault.what.removeprefix('raised ')}{where}"


def restore(before: dict[str, type[Effect]]) -> None:
    """Make the known effects those of ``before``, as :func:`kinds` gave them."""
    _REGISTRY.clear()
    _REGISTRY.update(before)


def effect_class(effect_id: str) -> tuple[type[Effect], str]:
    """Class and subject of an id; an unknown id raises an :class:`InputError` that lists what there is."""
    kind, _, subject = effect_id.partition(".")
    known = kinds()
    if kind not in known:
        raise InputError(f"unknown effect {effect_id!r}; known kinds: {', '.join(known)}")
    if subject not in known[kind].subjects:
        raise InputError(f"unknown effect {effect_id!r}; {kind} exists for: {', '.join(known[kind].subjects)}")
    return known[kind], subject


def make(effect_id: str, **values: Any) -> Effect:
    """An effect by id.

    Raises:
        InputError: unknown id or parameter, or a value out of bounds.

    >>> make("backlash.A", width_deg=0.002)
    backlash.A(width_deg=0.002)
    """
    cls, subject = effect_class(effect_id)
    return cls(subject, **values)
