"""Running a user's own code, which may do anything: raise, leave, loop for ever, print, eat all memory.

The code runs in a thread of its own while the caller waits for it, so that the caller goes on when the time is up, whatever the code
is doing then. What is still running is stopped by an exception that is raised in it again and again until it ends; code that waits
outside Python (a long ``time.sleep``) ends when it comes back, or with the process, which does not wait for it.

Until the code ends ``print`` goes to stderr, since stdout may be a command's JSON, and memory is limited to what the machine has.
"""

from __future__ import annotations

import contextvars
import ctypes
import math
import os
import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from mjsim.effects import confine, last_resort
from mjsim.errors import InputError

#: Environment variable with the seconds that one call of a user's code may take.
VARIABLE = "MJSIM_EFFECT_TIMEOUT_S"
#: Its default; a plain-Python loop over all instants of a long test takes some seconds.
CALL_S = 60.0
#: Loading a file may take this share of it.
LOAD_SHARE = 1.0 / 3.0
#: How long a caller waits for code that is told to stop, and how often it is told, s.
_STOPPING_S, _AGAIN_S = 1.0, 0.01
#: A caller looks up this often while it waits, s.
_SLICE_S = 0.5
#: Longest part of a user's own message that is repeated.
_LONGEST = 200


class _Stop(BaseException):
    """Ends code that took too long; no ``Exception``, so that ``except Exception`` does not keep it. See :meth:`_Worker.abandon`."""


class Fault(Exception):
    """A user's code did not end well.

    Attributes:
        what: what happened, e.g. ``raised ValueError: no`` or ``did not end within 60 s``.
        line: of the user's file where it happened, or ``None``.
        timeout: True when the time was up.
    """

    def __init__(self, what: str, line: int | None, timeout: bool = False) -> None:
        super().__init__(what)
        self.what, self.line, self.timeout = what, line, timeout


def limit() -> float:
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
        raise InputError(f"environment variable {VARIABLE} = {text!r}; allowed: seconds above 0, up to 86400 (default {CALL_S:g})")
    return value


def watched(file: str, code: Callable[[], Any], share: float = 1.0, label: str = "") -> Any:
    """The result of ``code()``, a user's code that stands in ``file``.

    Called from inside such code it is a plain call: the outer one watches.

    Args:
        share: of the time limit. label: what is called, as the last sentence of the process names it where nothing else can stop it.

    Raises:
        Fault: the code raised anything, or took too long. An :class:`InputError` goes on as it is.
    """
    if getattr(_here, "inside", False):
        return code()
    seconds = limit() * share
    worker = _idle_worker()
    context = contextvars.copy_context()
    with confine.confined():
        try:
            done, value = _answer(
                worker, lambda: context.run(code), seconds, f"{label} {_late(seconds)} ({place(file, None)}); mend the file"
            )
        except queue.Empty:
            line = _line_of_frame(sys._current_frames().get(worker.number), file)
            worker.abandon()
            raise Fault(_late(seconds), line, timeout=True) from None
        except BaseException:  # the user of the program stops it
            worker.abandon()
            raise
    _idle.append(worker)
    if done:
        return value
    if isinstance(value, InputError):
        raise value
    raise Fault(f"raised {said(value)}", line_of(value, file)) from value


def _late(seconds: float) -> str:
    return f"did not end within {seconds:.3g} s"


def _answer(worker: _Worker, job: Callable[[], Any], seconds: float, sentence: str) -> tuple[bool, Any]:
    """What the worker has to give; ``queue.Empty`` when the time is up. Waits in slices, between which signals come through."""
    timers, until = last_resort.timers(), time.monotonic() + seconds
    left = seconds
    try:
        if timers:
            timers.put_off(worker, left + last_resort.GRACE_S, sentence)
        worker.jobs.put(job)
        while True:
            try:
                return worker.answers.get(timeout=min(max(left, 0.0), _SLICE_S))
            except queue.Empty:
                left = until - time.monotonic()
                if left <= 0.0:
                    raise
            if timers:
                timers.put_off(worker, left + last_resort.GRACE_S, sentence)
    finally:
        if timers:
            timers.forget(worker)


def said(error: BaseException) -> str:
    """Type and message of an error in a user's code, one line of limited length."""
    try:
        text = " ".join(str(error).split())
    except Exception:  # an exception class of the user's own can fail at this as well
        text = ""
    text = text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def line_of(error: BaseException, file: str) -> int | None:
    """The innermost line of ``file`` that an error passed through; for a syntax error the line that is wrong."""
    if isinstance(error, SyntaxError) and error.filename == file:
        return error.lineno
    lines = [number for frame, number in traceback.walk_tb(error.__traceback__) if frame.f_code.co_filename == file]
    return lines[-1] if lines else None


def _line_of_frame(frame: FrameType | None, file: str) -> int | None:
    while frame is not None:
        if frame.f_code.co_filename == file:
            return frame.f_lineno
        frame = frame.f_back
    return None


def place(file: str, line: int | None) -> str:
    """File name and line as messages have them."""
    return Path(file).name + ("" if line is None else f", line {line}")


_here = threading.local()
#: Workers that wait for a job. Appending and popping are atomic.
_idle: list[_Worker] = []
os.register_at_fork(after_in_child=_idle.clear)  # threads do not come along


def _idle_worker() -> _Worker:
    try:
        return _idle.pop()
    except IndexError:
        return _Worker()


class _Worker(threading.Thread):
    """Runs one job at a time until it is abandoned; a daemon, so that the process can end whatever a job does."""

    def __init__(self) -> None:
        super().__init__(name="mjsim own effect", daemon=True)
        self.jobs: queue.SimpleQueue[Callable[[], Any]] = queue.SimpleQueue()
        self.answers: queue.SimpleQueue[tuple[bool, Any]] = queue.SimpleQueue()
        self._abandoned = False
        self.start()
        self.number = self.ident or 0

    def run(self) -> None:
        calm = partial(_CALM, threading.get_ident(), None)
        try:
            _here.inside = True
            while not self._abandoned:
                try:
                    answer = (True, self.jobs.get()())
                except BaseException as error:  # whatever the user's code raises, SystemExit and KeyboardInterrupt too
                    calm()  # first of all: an exception of `abandon` has the next one in its wake
                    answer = (False, error)
                    if self._abandoned:
                        sys.settrace(None)
                self.answers.put(answer)
                del answer  # a waiting worker keeps no results alive
        except _Stop:
            calm()
            sys.settrace(None)

    def abandon(self) -> None:
        """Stop the job that runs, and never give this worker another one."""
        self._abandoned = True
        until = time.monotonic() + _STOPPING_S
        stop = _stop_of(self.number)
        while self.is_alive() and time.monotonic() < until:
            stop()
            self.join(_AGAIN_S)
        if self.is_alive():
            threading.Thread(target=self._insist, args=(stop,), name="mjsim stops an own effect", daemon=True).start()

    def _insist(self, stop: Callable[[], None]) -> None:
        while self.is_alive():
            stop()
            self.join(_SLICE_S)


#: ``PyThreadState_SetAsyncExc``: an exception (or none) for a thread, raised before one of its next instructions.
_RAISE_IN, _CALM = (
    ctypes.PYFUNCTYPE(None, ctypes.c_ulong, what)(("PyThreadState_SetAsyncExc", ctypes.pythonapi))
    for what in (ctypes.py_object, ctypes.c_void_p)
)


def _stop_of(thread: int) -> Callable[[], None]:
    """A function that raises a :class:`_Stop` in a thread.

    Each one has the next in its wake when it is caught: ``except: pass`` in a loop keeps the first, and the second comes outside of it.
    That must happen in C, where nothing can come between, so the exception's ``__init__`` is that C function itself.
    """
    wake: Any = type("Stop", (_Stop,), {})
    raise_it = partial(_RAISE_IN, thread, wake)
    wake.__init__ = _raise_in_handler if sys.version_info[:2] == (3, 12) else staticmethod(raise_it)
    return raise_it


def _raise_in_handler(_: _Stop) -> None:
    """Raise a :class:`_Stop` in the line that comes next in this thread: that of the handler, if the one that is being made is caught.

    Python 3.12 counts the jump back from a handler to its loop as part of what the handler guards, so that one in the wake of another is
    always caught. Whatever traces this thread, a debugger say, is lost with it.
    """

    def trace(frame: FrameType, event: str, _: Any) -> None:
        if event == "line":  # of a frame that is there already: calls to come are not looked into
            raise _Stop

    frame = sys._getframe().f_back
    sys.settrace(trace)
    while frame is not None and frame.f_code.co_filename != __file__:
        frame.f_trace = trace
        frame = frame.f_back
