"""Instruments, one a folder; the class of each is in its module ``instrument``, and every folder here is loaded."""

import pkgutil
from importlib import import_module

for _folder in pkgutil.iter_modules(__path__):
    if _folder.ispkg:
        import_module(f"{__name__}.{_folder.name}.instrument")
