"""The part of requirements.lock that the core and the named extras or dependency groups need: scripts/locked.py
report dev.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def requirements(groups: list[str]) -> set[str]:
    """Names of the packages that pyproject.toml asks for, in the core and in ``groups``."""
    document = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    tables = {**document["project"]["optional-dependencies"], **document["dependency-groups"]}
    names = set()
    wanted = [document["project"]["dependencies"], *(tables[group] for group in groups)]
    for requirement in (r for table in wanted for r in table):
        name, extras = re.fullmatch(r"([\w.-]+)(?:\[([\w,]+)\])?[^\]]*", requirement).groups()
        names |= requirements(extras.split(",")) if name == "mjsim" else {name}
    return names


def locked(names: set[str]) -> str:
    """The lock's entries of packages and of all that these need in turn, which the comments "via" say."""
    entries = re.split(r"(?m)^(?=\w)", (ROOT / "requirements.lock").read_text(encoding="utf-8"))[1:]
    parents = [set(re.findall(r"(?m)^ +#(?: via)? +([\w.-]+)", entry)) for entry in entries]
    known = [re.match(r"[\w.-]+", entry)[0] for entry in entries]
    found: set[str] = set()
    while names - found:
        found |= names
        names = {name for name, above in zip(known, parents, strict=True) if above & found}
    return "".join(entry for name, entry in zip(known, entries, strict=True) if name in found)


if __name__ == "__main__":
    print(locked(requirements(sys.argv[1:])), end="")
