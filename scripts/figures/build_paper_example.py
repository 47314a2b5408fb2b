#!/usr/bin/env python3
"""Writes examples/kato2013: the paper's measurements, made again by the independent generator of the tests.

    .venv/bin/python scripts/figures/build_paper_example.py [FOLDER]

Deterministic. What is taken from the paper and what is assumed stands in tests/independent/kato2013.py and in the
machine file.
"""

from __future__ import annotations

import gzip
import sys
from pathlib import Path

import tomlkit

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from independent import kato2013, machines
from independent.campaign import write_files

ROOT = Path(__file__).resolve().parents[2]
HEAD = """\
The machine of N. Kato, M. Tsutsumi, R. Sato, IJMTM 64 (2013) 1-11, as far as the paper prints it:
from the paper: configuration, worm teeth of A (60) and C (72), the kinds of effects.
assumed: every drive value, friction and the width of the backlash. The C axis is 0.7 % faster than the
linear axes, as without such a difference the bulges of the paper's Fig. 8b do not come out.
The pitch errors of A and C are not in here: `mjsim identify pitch-error` finds them (paper, section 2.3)."""
SOURCE = {"lead_mm": "assumed", "worm_teeth": "paper, section 3.1 and Fig. 3"}


def machine_file(nominal: dict) -> str:
    """machine.toml with the source of every value."""
    doc = tomlkit.document()
    for line in HEAD.splitlines():
        doc.add(tomlkit.comment(line))
    doc.add("name", "Kato 2013")
    doc.add("configuration", nominal["configuration"])
    drives = tomlkit.table(is_super_table=True)
    for axis, values in nominal["drive"].items():
        table = tomlkit.table()
        for key, value in values.items():
            table.add(key, tomlkit.item(value).comment(SOURCE.get(key, "assumed")))
        drives.add(axis, table)
    doc.add("drive", drives)
    effects = tomlkit.aot()
    for effect in nominal["effect"]:
        table = tomlkit.table()
        for key, value in effect.items():
            table.add(key, tomlkit.item(value) if key == "id" else tomlkit.item(value).comment("assumed"))
        effects.append(table)
    doc.add("effect", effects)
    return tomlkit.dumps(doc)


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "examples" / "kato2013"
    case = kato2013.case()
    write_files(case, folder)
    (folder / "machine.toml").write_text(machine_file(machines.nominal(case.machine)))
    text = (folder / "campaign.toml").read_text()
    for trace in sorted((folder / "traces").glob("*.csv")):
        trace.with_suffix(".csv.gz").write_bytes(gzip.compress(trace.read_bytes(), 9, mtime=0))
        trace.unlink()
        text = text.replace(f'{trace.name}"', f'{trace.name}.gz"')
    (folder / "campaign.toml").write_text(text)


if __name__ == "__main__":
    main()
