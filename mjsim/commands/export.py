"""Compared recordings and their figures as CSV files that a spreadsheet opens."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mjsim.campaign.model import Campaign
from mjsim.commands.any_instrument import FIGURES, Rows, plain_tables
from mjsim.commands.axis_log.tables import tables_of_logs
from mjsim.commands.ball_bar.tables import tables_of_bars
from mjsim.commands.compare import compare
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io.files import check_writable, write_all
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent

#: What is written of an instrument, where it is more than of any instrument.
_TABLES = {**{n: tables_of_bars for n, i in INSTRUMENTS.items() if i.in_motion}, LogTest.instrument: tables_of_logs}


def export(
    campaign: Campaign,
    machine: Machine,
    out: str | Path,
    tests: Sequence[str] = (),
    decimal_comma: bool = False,
    force: bool = False,
    threads: int = 2,
    progress: Progress = silent,
) -> list[Path]:
    """Compare, and write a CSV per measured test (of an axis log: per axis), and their figures.

    Args:
        campaign: What is compared.
        machine: With what; what is fitted of a set-up is fitted over all its tests.
        out: Folder.
        tests: Only these.
        decimal_comma: Semicolons and decimal commas, with a byte order mark, as spreadsheets of many languages expect.
        force: Replace files.
        threads: Simulations side by side.
        progress: Called as work gets on.

    Returns:
        The files.

    Raises:
        InputError: A test is not measured, or a file exists and ``force`` is false.
    """
    chosen = [t.name for t in campaign.only(tests).measured]
    check_writable(Path(out) / FIGURES, force)
    result = compare(campaign, machine, threads, progress)
    contents = {}
    for part in result.parts:
        names = [t.test.name for t in part.tests if t.test.name in chosen]
        if not names:
            continue
        tables = _TABLES.get(part.instrument, plain_tables)(part, names)
        if FIGURES in contents:
            tables[f"figures-{INSTRUMENTS[part.instrument].noun.split()[-1]}s.csv"] = tables.pop(FIGURES)
        contents |= tables
    write_all({Path(out) / file: as_csv(rows, decimal_comma) for file, rows in contents.items()}, force)
    return [Path(out) / file for file in contents]


def as_csv(rows: Rows, decimal_comma: bool) -> str:
    """Rows as the text of a CSV file.

    Args:
        rows: Header and cells.
        decimal_comma: Semicolons and decimal commas, with a byte order mark.
    """
    if not decimal_comma:
        return "".join(",".join(row) + "\n" for row in rows)
    head, *body = rows
    lines = [";".join(head), *(";".join(c.replace(".", ",") if _is_number(c) else c for c in row) for row in body)]
    return "\ufeff" + "".join(line + "\r\n" for line in lines)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
