"""An off-screen OpenGL context, or one sentence that says what to install."""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from importlib import import_module

from mjsim.errors import InputError

#: System packages of the software renderer, as scripts/setup installs them.
PACKAGES = "libegl1 libegl-mesa0 libgl1-mesa-dri libopengl0"
_OFF = ("disable", "disabled", "off", "false", "0")
_ON = ("enable", "enabled", "on", "true", "1")
#: Renderers by platform, the one that is taken by itself first; and other names of GLFW in MUJOCO_GL.
_SYSTEMS = {"linux": ("egl", "osmesa", "glfw"), "darwin": ("cgl", "glfw"), "win32": ("glfw",)}
_GLFW = ("glx", "wgl")


def chosen() -> str:
    """The renderer that is used: the user's MUJOCO_GL, or EGL on Linux, CGL on macOS and GLFW on Windows.

    It is not set here. MuJoCo reads it when it is imported, and fails at once where what it names is missing; the
    context is made here instead, so that it also works where MuJoCo was imported long before.

    Raises:
        InputError: MUJOCO_GL names nothing that exists, or says that there is no renderer, or MuJoCo cannot be imported
            with it.
    """
    systems = _SYSTEMS.get(sys.platform, ("glfw",))
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wanted in _OFF:
        raise InputError(
            f"MUJOCO_GL={wanted} switches off rendering, which a picture of the machine needs; unset it or say "
            f"MUJOCO_GL={systems[0]}"
        )
    if wanted and wanted not in (*systems, *_ON, *_GLFW):
        raise InputError(f"MUJOCO_GL={wanted}: no such renderer; allowed: {', '.join(systems)}, or not set at all")
    system = wanted if wanted in systems else "glfw" if wanted in _GLFW else systems[0]
    with advice(system):
        import_module("mujoco")
    return system


def make_context(width: int, height: int):
    """A current OpenGL context with ``free()``, for pictures of up to that size (pixels).

    Raises:
        InputError: there is no OpenGL on this computer; the sentence names the packages that bring it.
    """
    system = chosen()
    with advice(system):
        context = _context_class(system)(width, height)
        context.make_current()
    return context


@contextlib.contextmanager
def advice(system: str) -> Iterator[None]:
    """Whatever goes wrong with OpenGL in the block becomes one sentence; what the drivers print meanwhile is dropped.

    Raises:
        InputError: in place of any exception; what the bindings raise differs from library to library.
    """
    try:
        with _quiet_stderr(), warnings.catch_warnings(action="ignore"):
            yield
    except Exception as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        remedy = "install the driver of the graphics card"
        if sys.platform == "linux":
            other = "" if system == "egl" else "unset MUJOCO_GL to use EGL; "
            remedy = f"{other}on Debian or Ubuntu: sudo apt-get install -y --no-install-recommends {PACKAGES}"
        raise InputError(
            f"cannot render the machine: no OpenGL for off-screen pictures ({system}: {reason}); {remedy}"
        ) from None


def _context_class(system: str) -> Callable:
    if system == "egl":
        from mujoco.egl import GLContext
    elif system == "cgl":
        from mujoco.cgl import GLContext
    elif system == "osmesa":
        from mujoco.osmesa import GLContext
    else:
        from mujoco.glfw import GLContext
    return GLContext


@contextlib.contextmanager
def _quiet_stderr():
    """Drivers talk on the process' stderr while they look for devices; the user gets one sentence instead."""
    saved = os.dup(2)
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(sink)
