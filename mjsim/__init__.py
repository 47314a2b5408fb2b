"""mjsim: find out what is wrong with a five-axis machine from its ball-bar measurements.

The commands of the same names are functions here: :func:`simulate`, :func:`compare`, :func:`diagnose`, :func:`plan`, :func:`add`,
:func:`remove`, :func:`history`, :func:`effects`. Names are loaded when they are first used.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.1.0"

_WHERE = {
    "read_campaign": "mjsim.campaign.files",
    "read_machine": "mjsim.machine.files",
    "write_machine": "mjsim.machine.files",
    "simulate": "mjsim.engine.simulate",
    "check": "mjsim.checking.check",
    "write_corrected": "mjsim.checking.check",
    "compare": "mjsim.compare",
    "diagnose": "mjsim.diagnose",
    "plan": "mjsim.plan",
    "identify_pitch_errors": "mjsim.identification.identify",
    "report": "mjsim.report.write",
    "add": "mjsim.workflow",
    "remove": "mjsim.workflow",
    "history": "mjsim.ladder",
    "effects": "mjsim.effects.registry",
    "animate": "mjsim.animation.movie",
    "animate_ladder": "mjsim.animation.ladder",
    "figures": "mjsim.paper.figures",
    "batch": "mjsim.batch.run",
    "write_nc": "mjsim.nc.write",
    "read_nc": "mjsim.nc.read",
    "driven_by": "mjsim.nc.program",
    "feed_report": "mjsim.nc.control",
    "NCOptions": "mjsim.nc.write",
    "Control": "mjsim.nc.control",
    "new_campaign": "mjsim.campaign.new",
    "import_trace": "mjsim.importing.importer",
    "import_features": "mjsim.importing.features",
    "imported_features": "mjsim.importing.features",
    "export": "mjsim.export",
    "make_effect": "mjsim.effects.registry",
    "Effect": "mjsim.effects.base",
    "Parameter": "mjsim.effects.base",
    "Motion": "mjsim.effects.motion",
    "register": "mjsim.effects.registry",
    "InputError": "mjsim.errors",
    "SimulationError": "mjsim.errors",
}
_RENAMED = {"history": "read_history", "effects": "kinds", "make_effect": "make", "NCOptions": "Options"}

__all__ = ["__version__", *_WHERE]  # pyright: ignore[reportUnsupportedDunderAll]; type checkers read __init__.pyi


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'mjsim' has no attribute {name!r}")
    return getattr(import_module(_WHERE[name]), _RENAMED.get(name, name))


def __dir__() -> list[str]:
    return sorted(__all__)


class _Package(ModuleType):
    """The package: importing ``mjsim.compare`` or another module of a function's name does not hide the function."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _WHERE and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
