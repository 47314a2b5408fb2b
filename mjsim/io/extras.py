"""Packages that only some commands need: the extras of pyproject.toml."""

from __future__ import annotations

from importlib.util import find_spec

from mjsim.errors import InputError


def need(what: str, extra: str, *modules: str) -> None:
    """Refuse to begin something that lacks its packages.

    Args:
        what: the command or function, as the user knows it.
        extra: the extra of pyproject.toml that brings the packages.
        modules: what is imported from them.

    Raises:
        InputError: one of the modules is not installed; the sentence says how to install it.
    """
    if not all(map(find_spec, modules)):
        raise InputError(f'{what} needs the extra "{extra}": pip install "mjsim[{extra}]"')
