"""Whether LinuxCNC can run here."""

from __future__ import annotations

import os
import shutil
import subprocess

from mjsim.errors import InputError

#: The modules ``linuxcnc`` and ``hal`` are those of the system's own Python.
PYTHON = "/usr/bin/python3"
_PROGRAMS = ("linuxcncsvr", "halcmd", "milltask", "rtapi_app", "io")
_INSTALL = "sudo apt-get install -y --no-install-recommends linuxcnc-uspace"


def missing() -> str:
    """What is missing to run LinuxCNC here, as a noun with a remedy; empty where nothing is."""
    for name in _PROGRAMS:
        if shutil.which(name) is None:
            return f"the program {name} (run: {_INSTALL})"
    if not os.access(PYTHON, os.X_OK) or _fails(PYTHON, "-c", "import hal, linuxcnc"):
        return f"the modules linuxcnc and hal of {PYTHON} (run: {_INSTALL})"
    if _fails(*unshare(), "true"):
        return "the right to make namespaces (unshare; a container needs the capability SYS_ADMIN)"
    return ""


def needed() -> None:
    """Refuse to go on where LinuxCNC cannot run.

    Raises:
        InputError: something is missing.
    """
    if what := missing():
        raise InputError(f"LinuxCNC cannot run here: {what} is missing")


def unshare() -> list[str]:
    """Command that runs another one in namespaces of its own, so that nothing of a control stays behind."""
    mine = [] if os.getuid() == 0 else ["--user", "--map-current-user", "--keep-caps"]
    return ["unshare", *mine, "--ipc", "--net", "--pid", "--mount", "--fork", "--kill-child", "--mount-proc"]


def environment() -> dict[str, str]:
    """The environment without what is meant for another Python or a display."""
    return {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "DISPLAY", "LD_PRELOAD")}


def _fails(*command: str) -> bool:
    return subprocess.run(command, env=environment(), capture_output=True, stdin=subprocess.DEVNULL).returncode != 0
