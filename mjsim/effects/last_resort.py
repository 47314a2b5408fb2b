"""The end of the process when a user's code holds Python's lock and never gives it back, as ``sum(range(10**15))`` does.

No Python can run then, so the C library's own timers do what is left to do: one says the sentence, one ends the process with
status 1. Only a command line asks for that; in a notebook the user restarts the kernel. Systems without such timers go on without.
"""

from __future__ import annotations

import ctypes
import shlex
from typing import ClassVar

#: Time beyond a call's own limit after which nobody else will stop it, s.
GRACE_S = 2.0
_CLOCK_MONOTONIC, _SIGEV_THREAD = 1, 2


class _Event(ctypes.Structure):
    """``struct sigevent``, 64 bytes."""

    _fields_: ClassVar = [
        ("value", ctypes.c_void_p),
        ("signo", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("rest", ctypes.c_char * 32),
    ]


class _Times(ctypes.Structure):
    """``struct itimerspec``."""

    _fields_: ClassVar = [(n, ctypes.c_long) for n in ("every_s", "every_ns", "first_s", "first_ns")]


class LastResort:
    """Two timers that :meth:`put_off` winds up again and again; they run off when nobody does."""

    def __init__(self) -> None:
        self._libc = ctypes.PyDLL(None)  # calls keep Python's lock: whoever wants it for ever comes before or after, not in between
        self._text = ctypes.create_string_buffer(4096)
        self._users: set[object] = set()
        self._say = self._timer("system", ctypes.addressof(self._text))
        self._leave = self._timer("_exit", 1)

    def _timer(self, function: str, value: int) -> ctypes.c_void_p:
        event = _Event(value, 0, _SIGEV_THREAD, ctypes.cast(getattr(self._libc, function), ctypes.c_void_p), None)
        timer = ctypes.c_void_p()
        if self._libc.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
            raise OSError("no timer")
        return timer

    def put_off(self, user: object, seconds: float, sentence: str) -> None:
        """The process ends with ``sentence`` on stderr after ``seconds``, unless somebody calls this again, or all users :meth:`forget`."""
        self._users.add(user)
        self._set(self._leave, seconds + 1.0)
        command = f"printf '%s\\n' {shlex.quote('mjsim: ' + sentence)} >&2".encode()
        self._text.value = command if len(command) < len(self._text) else b":"
        self._set(self._say, seconds)

    def forget(self, user: object) -> None:
        """This user needs the timers no more."""
        self._users.discard(user)
        if not self._users:
            self._set(self._say, 0.0)
            self._set(self._leave, 0.0)

    def _set(self, timer: ctypes.c_void_p, seconds: float) -> None:
        times = _Times(0, 0, int(seconds), int(seconds % 1.0 * 1e9))
        self._libc.timer_settime(timer, 0, ctypes.byref(times), None)


_timers: LastResort | None = None


def wanted() -> None:
    """From now on calls of a user's code that nobody can stop end the process."""
    global _timers
    if _timers is None:
        try:
            _timers = LastResort()
        except (OSError, AttributeError):  # a C library without such timers
            _timers = None


def timers() -> LastResort | None:
    """The timers, where they are wanted and there are any."""
    return _timers
