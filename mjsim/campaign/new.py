"""A new campaign's folder: commented files that run as they are."""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import shutil
from pathlib import Path

from mjsim.errors import InputError
from mjsim.io.files import check_writable

_TEMPLATE = Path(__file__).resolve().parent / "template"
_FILES = {"campaign.toml": "campaign.toml", "machine.toml": "machine.toml", "README.md": "traces/README.md"}


def new_campaign(folder: str | Path, name: str | None = None) -> list[Path]:
    """Start a campaign: campaign.toml, machine.toml and an empty folder for the traces; all of it, or nothing.

    Args:
        folder: new, or empty. name: of the campaign; the folder's when missing.

    Returns:
        The files.

    Raises:
        InputError: the folder holds something already, or cannot be written.
    """
    folder = Path(folder)
    name = name if name is not None else folder.absolute().name
    if not name or not name.isprintable() or len(name) > 200:
        raise InputError(f"{folder}: {name[:60]!r} is no name for a campaign; give a printable one with --name")
    if folder.is_dir():
        inside = sorted(p.name for p in folder.iterdir())
        if inside:
            more = f" and {len(inside) - 1} more" if len(inside) > 1 else ""
            raise InputError(f"{folder}: is not empty, it holds {inside[0]!r}{more}; allowed: a new or an empty folder")
    elif os.path.lexists(folder):
        raise InputError(f"{folder}: exists already and is no folder; allowed: a new or an empty folder")
    check_writable(folder / "campaign.toml")
    try:
        _build(folder, name)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    return [folder / f for f in _FILES.values()]


def _build(folder: Path, name: str) -> None:
    """Write the files beside the folder and move them into its place."""
    target = Path(os.path.realpath(folder))
    above = [p for p in target.parents if not os.path.lexists(p)]
    stage = target.parent / f".{target.name[:80]}.{secrets.token_hex(6)}"
    moved: list[Path] = []
    done = False
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        stage.mkdir()
        for source, place in _FILES.items():
            text = (_TEMPLATE / source).read_text(encoding="utf-8").replace('"@NAME@"', json.dumps(name, ensure_ascii=False))
            (stage / place).parent.mkdir(exist_ok=True)
            (stage / place).write_text(text, encoding="utf-8")
        if target.is_dir():  # somebody may be working in it: it stays the same folder
            for item in list(stage.iterdir()):
                moved.append(target / item.name)
                os.rename(item, moved[-1])
        else:
            mask = os.umask(0)
            os.umask(mask)
            stage.chmod(0o777 & ~mask)
            os.rename(stage, target)
        done = True
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        for p in () if done else moved:
            shutil.rmtree(p) if p.is_dir() else p.unlink(missing_ok=True)
        for p in () if done else above:
            with contextlib.suppress(OSError):
                p.rmdir()
