"""Calls of a user's own effect: errors named with file and line, and results checked.

The file runs with the rights of whoever starts mjsim, as any Python of theirs; nothing here confines it.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mjsim.errors import InputError, SimulationError
from mjsim.machine.effect import Effect
from mjsim.machine.plant import Motion, Plant

#: A user's file becomes a module of this name and the file's.
USER_MODULE = "mjsim_user_"
#: A larger position error, m or rad, is mostly one in other units.
LARGEST = 1.0


@contextmanager
def running(what: str, module: str, parameters: Iterable[str] = ()) -> Iterator[None]:
    """Inside, code of a user's ``module`` runs; what goes wrong in it becomes one sentence that names the line.

    Args:
        what: what is called, for the sentence, e.g. ``effect mine.A: apply``.
        module: the ``__module__`` of the effect's class.
        parameters: names that the effect has; a KeyError is mostly another one.

    Raises:
        SimulationError: the code raised anything, ``SystemExit`` too.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        hint = "; the motion's arrays cannot be changed: work on a copy" if "read-only" in str(error) else ""
        if isinstance(error, KeyError) and parameters:
            hint = f"; the effect has the parameters {', '.join(parameters)}"
        said = (
            f": {error}"
            if isinstance(error, InputError)
            else f" raised {type(error).__name__}: {error}".removesuffix(": ")
        )
        raise SimulationError(f"{what}{said}{_where(error, module)}{hint}") from error


def apply(effect: Effect, plant: Plant) -> None:
    """``effect.apply(plant)``, guarded where the effect is a user's own.

    Raises:
        SimulationError: it raised, or put numbers into the plant with which nothing can be simulated.
    """
    if not is_own(type(effect)):
        effect.apply(plant)
        return
    what = f"effect {effect.id}: apply"
    with running(what, type(effect).__module__, effect.values):
        effect.apply(plant)
    if why := plant.unusable():
        raise SimulationError(
            f"{what} put {why}{_defined(effect.apply)}; allowed: finite numbers, inertias, gains and gears above 0"
        )


def position_error(effect: Any, motion: Motion) -> np.ndarray:
    """What a user's plain-Python effect adds to the axes, (n, axes) m and rad.

    Raises:
        SimulationError: it raised, or returned anything but finite numbers of that shape.
    """
    what = f"effect {effect.id}: position_error"
    with running(what, type(effect).__module__, effect.values):
        value = effect.position_error(motion)
    try:
        out = None if value is None else np.asarray(value)
        wrong = _wrong(out, motion.position.shape)
    except ValueError:
        out, wrong = None, "rows of different lengths"
    if wrong or out is None:
        raise SimulationError(
            f"{what} returned {wrong}{_defined(effect.position_error)}; "
            f"allowed: an array of finite numbers, m and rad, shape {motion.position.shape}"
        )
    return out


def is_own(cls: type) -> bool:
    """Whether a class is a user's own: from their file, an installed package, or a script."""
    return cls.__module__.partition(".")[0] != "mjsim"


def _wrong(out: np.ndarray | None, shape: tuple[int, ...]) -> str:
    """What is wrong with a position error, or nothing."""
    if out is None:
        return "None: is `return` missing?"
    if out.dtype.kind not in "fiu":
        return f"{out.dtype} instead of numbers"
    if out.shape != shape:
        return f"shape {out.shape}"
    peak = float(np.max(np.abs(out), initial=0.0))  # NaN where there is one
    if not math.isfinite(peak):
        return f"numbers that are not finite ({int((~np.isfinite(out)).sum())} of {out.size})"
    return f"{peak:.3g}, more than {LARGEST:g} m or rad (µm or degrees?)" if peak > LARGEST else ""


def _where(error: BaseException, module: str) -> str:
    """File and line of ``module`` that an error passed through last; for a syntax error the line that is wrong."""
    places = [
        (f.f_code.co_filename, line)
        for f, line in traceback.walk_tb(error.__traceback__)
        if f.f_globals.get("__name__") == module
    ]
    if isinstance(error, SyntaxError) and error.filename and error.lineno:
        places.append((error.filename, error.lineno))
    return f" ({Path(places[-1][0]).name}, line {places[-1][1]})" if places else ""


def _defined(method: Any) -> str:
    """File and line where a method is defined."""
    code = getattr(method, "__code__", None)
    return f" ({Path(code.co_filename).name}, line {code.co_firstlineno})" if code else ""
