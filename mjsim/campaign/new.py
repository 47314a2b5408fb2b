"""A new campaign's folder: commented files that run as they are."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomlkit

from mjsim.errors import InputError
from mjsim.io.files import check_writable, write_all

#: Folder of the files that a new campaign begins with.
TEMPLATE = Path(__file__).resolve().parent / "template"
#: A campaign of planned tests, before its tables.
_PLANNED = """# A campaign: the tests of one machine, in the order of measuring.
# Keys end in their unit. docs/campaign-format.md explains every key.
# When a test is measured: mjsim import FILE --campaign FOLDER --test NAME

name = {name}
machine = "machine.toml"

[instrument]
kind = "{kind}"
resolution_um = {resolution_um:g}
range_mm = {range_mm:g}
sample_rate_Hz = {sample_rate_Hz:g}
"""
#: Numbers of an ordinary ball bar.
BALL_BAR = {"resolution_um": 0.1, "range_mm": 1.0, "sample_rate_Hz": 200.0}
_FILES = {"campaign.toml": "campaign.toml", "machine.toml": "machine.toml", "README.md": "traces/README.md"}


def new_campaign(folder: str | Path, name: str | None = None) -> list[Path]:
    """Start a campaign: campaign.toml, machine.toml and an empty folder for the traces; all of it, or nothing.

    Args:
        folder: new, or empty.
        name: of the campaign; the folder's when missing.

    Returns:
        The files.

    Raises:
        InputError: the folder holds something already, or cannot be written.
    """
    folder = Path(folder)
    name = check_new_folder(folder, name, "campaign")
    texts = {place: (TEMPLATE / source).read_text(encoding="utf-8") for source, place in _FILES.items()}
    contents = {
        folder / place: text.replace('"@NAME@"', json.dumps(name, ensure_ascii=False)) for place, text in texts.items()
    }
    return write_new(contents)


def planned_text(name: str, tests: Sequence[dict[str, Any]], kind: str = "ball_bar") -> str:
    """A campaign.toml of tests that are not measured yet.

    Args:
        name: of the campaign.
        tests: their tables, in the order of measuring; there may be none yet.
        kind: of the instrument.
    """
    text = _PLANNED.format(name=json.dumps(name, ensure_ascii=False), kind=kind, **BALL_BAR)
    return text + "".join("\n[[test]]\n" + tomlkit.dumps(t).rstrip() + "\n" for t in tests)


def new_planned_campaign(
    folder: str | Path, machine_file: str, tests: Sequence[dict[str, Any]], instrument: str | None = None
) -> list[Path]:
    """Start a campaign of planned tests: campaign.toml, machine.toml and a folder for the traces; all, or nothing.

    Args:
        folder: new, or empty.
        machine_file: text of the machine file.
        tests: tables of the tests.
        instrument: kind of it; a ball bar when missing.

    Returns:
        The files.

    Raises:
        InputError: the folder holds something already, or cannot be written.
    """
    folder = Path(folder)
    name = check_new_folder(folder, None, "campaign")
    contents = {
        folder / "campaign.toml": planned_text(name, tests, kind=instrument or "ball_bar"),
        folder / "machine.toml": machine_file,
        folder / "traces" / "README.md": (TEMPLATE / "README.md").read_text(encoding="utf-8"),
    }
    return write_new(contents)


def write_new(contents: dict[Path, str]) -> list[Path]:
    """Write the files of a new folder; all of them, or nothing.

    Args:
        contents: texts by file.

    Returns:
        The files.

    Raises:
        InputError: they cannot be written.
    """
    check_writable(next(iter(contents)))
    write_all(contents)
    return list(contents)


def check_new_folder(folder: Path, name: str | None, what: str) -> str:
    """The name of what is started in a folder, which has to be new or empty.

    Args:
        folder: new, or empty.
        name: as the user gives it; the folder's when missing.
        what: is started, for messages.

    Raises:
        InputError: the name is none, or the folder holds something already.
    """
    name = name if name is not None else folder.absolute().name
    if not name or not name.isprintable() or len(name) > 200:
        raise InputError(f"{folder}: {name[:60]!r} is no name for a {what}; give a printable one with --name")
    if folder.is_dir():
        inside = sorted(p.name for p in folder.iterdir())
        if inside:
            more = f" and {len(inside) - 1} more" if len(inside) > 1 else ""
            raise InputError(f"{folder}: is not empty, it holds {inside[0]!r}{more}; allowed: a new or an empty folder")
    elif os.path.lexists(folder):
        raise InputError(f"{folder}: exists already and is no folder; allowed: a new or an empty folder")
    return name
