"""The controls that mjsim writes corrections for: one file each."""

from __future__ import annotations

from mjsim.compensation.controls.base import Control, Settings
from mjsim.compensation.controls.fanuc import Fanuc
from mjsim.compensation.controls.heidenhain import Heidenhain
from mjsim.compensation.controls.linuxcnc import LinuxCNC
from mjsim.compensation.controls.neutral import Neutral
from mjsim.compensation.controls.sinumerik import Sinumerik
from mjsim.errors import InputError

CONTROLS: dict[str, type[Control]] = {c.name: c for c in (LinuxCNC, Sinumerik, Heidenhain, Fanuc, Neutral)}


def control(name: str, settings: Settings | None = None) -> Control:
    """The control with this name.

    Raises:
        InputError: there is none.
    """
    if name not in CONTROLS:
        raise InputError(f"unknown control {name!r}; allowed: {', '.join(CONTROLS)}")
    return CONTROLS[name](settings)
