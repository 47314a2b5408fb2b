"""Calls of a user's own effect: errors named with file and line, results checked, and a limit on the time of one call.

The file runs with the rights of whoever starts mjsim, as any Python of theirs; nothing here confines it. The limit is
kept by the signal SIGALRM. Python runs signal handlers in its main thread only, and between two of its own
instructions: a call in another thread, on a system without that signal, or inside one long call of a C library has no
limit.
"""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from mjsim.errors import EffectTimeout, InputError, SimulationError
from mjsim.machine.effect import Effect
from mjsim.machine.motion import Motion
from mjsim.machine.plant import Plant

#: A user's file becomes a module of this name and the file's.
USER_MODULE = "mjsim_user_"
#: Environment variable with the seconds that one call may take.
VARIABLE = "MJSIM_EFFECT_TIMEOUT_S"
#: Its default. A plain-Python loop over all instants of a long test takes some seconds.
CALL_S = 60.0
#: A larger position error, m or rad, is mostly one in other units.
LARGEST = 1.0


class _TimeUp(BaseException):
    """Raised in the user's code by the signal. No ``Exception``, so that ``except Exception`` does not keep it."""


@contextmanager
def running(what: str, module: str, parameters: Iterable[str] = ()) -> Iterator[None]:
    """Inside, code of a user's ``module`` runs; what goes wrong in it becomes one sentence that names the line.

    In the main thread ``print`` goes to stderr, since stdout may be a command's JSON.

    Args:
        what: what is called, for the sentence, e.g. ``effect mine.A: apply``.
        module: the ``__module__`` of the effect's class.
        parameters: names that the effect has; a KeyError is mostly another one.

    Raises:
        SimulationError: the code raised anything, ``SystemExit`` too.
        EffectTimeout: the time was up.
    """
    seconds = _limit()
    try:
        with _alarm(seconds), _no_stdout():
            yield
    except _TimeUp as up:
        raise EffectTimeout(
            f"{what} did not end within {seconds:g} s{_where(up, module)}; mend the file, "
            f"or allow more seconds with the environment variable {VARIABLE}"
        ) from None
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


def _limit() -> float:
    """Seconds that one call may take.

    Raises:
        InputError: the environment variable is no such number.
    """
    text = os.environ.get(VARIABLE, "").strip()
    try:
        value = float(text) if text else CALL_S
    except ValueError:
        value = math.nan
    if not 0.0 < value <= 86400.0:
        raise InputError(
            f"environment variable {VARIABLE} = {text!r}; allowed: seconds above 0, up to 86400 (default {CALL_S:g})"
        )
    return value


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _no_stdout() -> AbstractContextManager:
    return redirect_stdout(sys.stderr) if _in_main_thread() else nullcontext()  # stdout is the whole process'


@contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    """SIGALRM raises inside after ``seconds``; nothing happens where the timer runs already, for a call around this
    one.
    """
    if not _in_main_thread() or not hasattr(signal, "setitimer") or signal.getitimer(signal.ITIMER_REAL)[0]:
        yield
        return

    def stop(number: int, frame: object) -> None:
        raise _TimeUp

    former = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, former or signal.SIG_DFL)


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
