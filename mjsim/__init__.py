"""mjsim: find out what is wrong with a machine tool from its measurements.

The commands are functions here, as :func:`simulate`, :func:`compare`, :func:`diagnose`. Names are loaded when they are
first used. A function never bears the name of a package: ``mjsim.effects`` is the folder of the effects,
:func:`list_effects` lists them.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_WHERE = {
    "read_campaign": "mjsim.campaign.files",
    "read_machine": "mjsim.campaign.machine_file",
    "write_machine": "mjsim.campaign.machine_file",
    "simulate": "mjsim.simulation.multibody",
    "check": "mjsim.commands.check",
    "write_corrected": "mjsim.commands.check",
    "compare": "mjsim.commands.compare",
    "calibrate": "mjsim.commands.calibrate",
    "geometry": "mjsim.commands.geometry",
    "diagnose": "mjsim.commands.diagnose",
    "import_log": "mjsim.importing.logs",
    "explain": "mjsim.commands.explain",
    "plan": "mjsim.commands.plan",
    "compensate": "mjsim.compensation.compensate",
    "write_compensation": "mjsim.compensation.compensate",
    "ControlSettings": "mjsim.compensation.controls",
    "predict": "mjsim.prediction.predict",
    "part": "mjsim.prediction.parts",
    "identify_pitch_errors": "mjsim.inference.pitch.identify",
    "make_report": "mjsim.report.write",
    "make_certificate": "mjsim.report.certificate",
    "add": "mjsim.commands.edit",
    "remove": "mjsim.commands.edit",
    "history": "mjsim.commands.history",
    "list_effects": "mjsim.effects.registry",
    "animate": "mjsim.animation.movie",
    "animate_ladder": "mjsim.animation.ladder",
    "figures": "mjsim.paper.figures",
    "run_batch": "mjsim.batch.run",
    "run_fleet": "mjsim.batch.fleet",
    "write_nc": "mjsim.nc.write",
    "read_nc": "mjsim.nc.read",
    "driven_by": "mjsim.instruments.ball_bar.program",
    "feed_report": "mjsim.nc.control",
    "run_on_linuxcnc": "mjsim.linuxcnc.run",
    "LinuxCNCSettings": "mjsim.linuxcnc.configuration",
    "NCOptions": "mjsim.nc.write",
    "Control": "mjsim.nc.control",
    "new_campaign": "mjsim.campaign.new",
    "import_trace": "mjsim.importing.importer",
    "import_features": "mjsim.importing.features",
    "imported_features": "mjsim.importing.features",
    "export": "mjsim.commands.export",
    "open_workbench": "mjsim.workbench.state",
    "make_effect": "mjsim.effects.registry",
    "Effect": "mjsim.machine.effect",
    "Parameter": "mjsim.machine.effect",
    "SearchHints": "mjsim.machine.effect",
    "Remedy": "mjsim.machine.effect",
    "Motion": "mjsim.machine.plant",
    "register": "mjsim.effects.registry",
    "InputError": "mjsim.errors",
    "SimulationError": "mjsim.errors",
}
_RENAMED = {
    "history": "read_history",
    "list_effects": "kinds",
    "make_report": "report",
    "open_workbench": "workbench",
    "run_batch": "batch",
    "run_fleet": "fleet",
    "make_effect": "make",
    "NCOptions": "Options",
    "ControlSettings": "Settings",
    "run_on_linuxcnc": "run_test",
    "LinuxCNCSettings": "Settings",
}

__all__ = ["__version__", *_WHERE]  # pyright: ignore[reportUnsupportedDunderAll]; type checkers read __init__.pyi


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'mjsim' has no attribute {name!r}")
    return getattr(import_module(_WHERE[name]), _RENAMED.get(name, name))


def __dir__() -> list[str]:
    return sorted(__all__)
