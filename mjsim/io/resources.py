"""Files that ship with the package: the MJCF model and the example campaigns."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent


def _folder(packaged: str, in_repository: str) -> Path:
    inside = _PACKAGE / packaged
    return inside if inside.is_dir() else _PACKAGE.parent / in_repository


def model_file() -> Path:
    """``five_axis.xml``: the machine alone."""
    return _folder("_models", "models") / "five_axis.xml"


def scene_file() -> Path:
    """``scene.xml``: the machine on a floor, with light, sky and cameras."""
    return model_file().with_name("scene.xml")


def examples() -> Path:
    """Folder of the example campaigns."""
    return _folder("_examples", "examples")
