"""The campaigns of a fleet: where they are, what they consist of, and how one travels to another computer."""

from __future__ import annotations

import hashlib
import json
import os
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mjsim.batch.describe import versions
from mjsim.campaign.temperature import FILE
from mjsim.errors import InputError
from mjsim.io.cache import code

_CAMPAIGN = "campaign.toml"


@dataclass(frozen=True)
class Options:
    """How every campaign is diagnosed.

    Attributes:
        max_effects: At most so many missing effects are looked for; without it as many as the data prove.
        as_is: Do not look for a wrong unit, sign or direction first.
    """

    max_effects: int | None = None
    as_is: bool = False


@dataclass(frozen=True)
class Job:
    """One campaign.

    Attributes:
        folder: Where it is.
        key: Hash of its files, of the versions and of the options: the same key, the same result.
    """

    folder: Path
    key: str


def campaigns_in(folders: Sequence[Path]) -> list[Path]:
    """Folders with a ``campaign.toml``, in order and each once: the given ones, and what lies below them.

    What lies below a campaign, such as its held-out tests, belongs to it and is not looked at.

    Raises:
        InputError: A folder is missing, or has no campaign.
    """
    out: dict[Path, None] = {}
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; allowed: a campaign's folder, or one with campaigns below it")
        found = False
        for place, below, files in os.walk(folder):
            below[:] = sorted(name for name in below if not name.startswith("."))
            if _CAMPAIGN in files:
                out.setdefault(Path(place).resolve())
                below.clear()
                found = True
        if not found:
            raise InputError(f"{folder}: has no campaign.toml, and no folder below it has one")
    return list(out)


def job_of(folder: Path, options: Options) -> Job:
    """A campaign as a job."""
    digest = hashlib.sha256(json.dumps([versions(), vars(options), code()]).encode())
    for name, content in sorted(files_of(folder).items()):
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return Job(folder, digest.hexdigest()[:32])


def files_of(folder: Path) -> dict[str, bytes]:
    """What a campaign consists of: its files by their path relative to the folder. What is missing is left out."""
    folder = folder.resolve()
    names = {_CAMPAIGN, FILE}
    campaign = _table(folder / _CAMPAIGN)
    machine = str(campaign.get("machine", "machine.toml"))
    names.add(machine)
    for test in _tables(campaign.get("test")):
        names |= {str(test[key]) for key in ("trace", "program") if key in test}
    beside = os.path.dirname(machine)
    for effect in _tables(_table(folder / machine).get("effect")):
        if "file" in effect:
            names.add(os.path.join(beside, str(effect["file"])))
    out = {}
    for name in names:
        try:
            out[Path(os.path.relpath(folder / name, folder)).as_posix()] = (folder / name).read_bytes()
        except (OSError, ValueError):
            continue
    return out


def unpack(files: dict[str, bytes], into: Path) -> Path:
    """Write the files of a campaign below ``into``; the campaign's folder there."""
    up = max((name.split("/").count("..") for name in files), default=0)
    folder = into.joinpath(*(f"level{i}" for i in range(up)), "campaign")
    for name, content in files.items():
        place = Path(os.path.normpath(folder / name))
        if not place.is_relative_to(into):
            raise InputError(f"{name}: lies outside of the campaign; allowed: paths relative to it")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
    return folder


def _table(file: Path) -> dict:
    """A TOML file as it is; empty where it cannot be read, which the diagnosis says."""
    try:
        return tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError):
        return {}


def _tables(value: object) -> list[dict]:
    return [row for row in value if isinstance(row, dict)] if isinstance(value, list) else []
