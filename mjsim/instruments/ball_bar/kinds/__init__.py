"""Kinds of ball-bar tests, one per file of this folder; every file here is loaded."""

import pkgutil
from importlib import import_module

from mjsim.instruments.ball_bar.kinds.base import KINDS, Kind, able_kinds, all_keys, kind_of, register

for _module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["KINDS", "Kind", "able_kinds", "all_keys", "kind_of", "register"]
