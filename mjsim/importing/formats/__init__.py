"""File formats of recorded traces, one per file of this folder; every file here is loaded."""

import pkgutil
from importlib import import_module

from mjsim.importing.formats.base import Format, read_any, register

for _module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["Format", "read_any", "register"]
