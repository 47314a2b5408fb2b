"""Compared recordings and their figures as CSV files that a spreadsheet opens."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.commands.any_instrument import FIGURES, Rows, plain_tables
from mjsim.commands.axis_log.tables import tables_of_logs
from mjsim.commands.ball_bar.compare import BarComparison, ComparedBarTest
from mjsim.commands.compare import compare
from mjsim.errors import InputError
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.iso230 import circular_figures
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import Trace
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io.files import check_writable, write_all
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.units import DEG, MM, UM

# -- compared traces and their ISO 230-4 figures as rows of a table ----------------------------------------------------

#: File of the figures of paths that were run both ways.
PAIRS = "figures-both-directions.csv"
_ISO = {"circular_error_um": "G_um", "radial_max_um": "Fmax_um", "radial_min_um": "Fmin_um"}


def tables_of_bars(result: BarComparison, names: Collection[str]) -> dict[str, Rows]:
    """A table per test, their figures, and those of paths run both ways, by file.

    Args:
        result: All tests.
        names: Of the tests whose tables are wanted.

    Raises:
        InputError: A test has the name of a file of figures.
    """
    campaign = result.campaign
    for name in names:
        if f"{name}.csv" in (FIGURES, PAIRS):
            raise InputError(
                f"{campaign.folder / 'campaign.toml'}: test {name!r} would be written to the file of the figures; "
                f"rename it"
            )
    chosen = [t for t in result.tests if t.test.name in names]
    out = {f"{t.test.name}.csv": trace_rows(t, campaign.traces[t.test.name]) for t in chosen}
    out[FIGURES] = figure_rows(result, names)
    if len(pairs := pair_rows(result, names)) > 1:
        out[PAIRS] = pairs
    return out


def trace_rows(t: ComparedBarTest, recorded: Trace) -> list[list[str]]:
    """Header and samples: recorded time (s), signed angle φ (°), measured, simulated and residual (µm), 1 where the
    sample counts.

    What was not recorded is empty; a sample that was left out as an outlier is there, with 0.
    """
    rows = [["time_s", "phi_deg", "measured_um", "simulated_um", "residual_um", "valid"]]
    there = np.isin(t.time, recorded.time[recorded.valid])
    measured, residual = (np.where(there, x, np.nan) / UM for x in (t.measured, t.residual))
    columns = np.column_stack([t.time, t.phi / DEG, measured, t.simulated / UM, residual])
    for (time, phi, *values), valid in zip(columns, t.valid, strict=True):
        rows.append(
            [f"{time:.6f}", f"{phi:.6f}", *("" if np.isnan(v) else f"{v:.4f}" for v in values), str(int(valid))]
        )
    return rows


def figure_rows(result: BarComparison, names: Collection[str]) -> list[list[str]]:
    """Header and one row per test: how it was run, the residual, ISO 230-4 figures of both traces (µm; empty for
    part circles).
    """
    head = ["test", "kind", "plane_or_axis", "direction", "feed_mm_min", "bar_length_mm", "samples",
        "samples_left_out", "residual_rms_um",
            "residual_max_um", "noise_um", "trigger_ms"]  # fmt: skip
    both = [
        f"{what}_{short}"
        for what in ("measured", "simulated")
        for short in (*_ISO.values(), "centre_1_um", "centre_2_um")
    ]
    sphere = any(t.ranges for t in result.tests)
    rows = [[*head, *both, *(("measured_range_um", "simulated_range_um") if sphere else ())]]
    for t in result.tests:
        if t.test.name not in names:
            continue
        kind = kind_of(t.test)
        place = kind.plane(t.test) or kind.turns(t.test)
        how = [
            t.test.name,
            t.test.kind,
            place,
            t.test.direction,
            f"{t.test.feed / MM * 60:g}",
            f"{t.test.length / MM:g}",
        ]
        rest = [
            str(len(t.valid)),
            str(int((~t.valid).sum())),
            f"{t.rms / UM:.4f}",
            f"{t.maximum / UM:.4f}",
            f"{result.noise / UM:.4f}",
        ]
        rest.append(f"{t.trigger * 1e3:.3f}")
        rows.append([*how, *rest, *(c for what in ("measured", "simulated") for c in _iso(t, what))])
        if sphere:
            rows[-1] += [f"{t.ranges[what]['range_um']:.4f}" for what in ("measured", "simulated")]
    return rows


def _iso(t: ComparedBarTest, what: str) -> list[str]:
    if not t.iso:
        return [""] * 5
    figures = asdict(circular_figures(t.phi[t.valid], getattr(t, what)[t.valid]))
    return [*(f"{figures[k]:.4f}" for k in _ISO), *(f"{c:.4f}" for c in figures["centre_um"])]


def pair_rows(result: BarComparison, names: Collection[str]) -> list[list[str]]:
    """Header and one row per path run both ways: G(b) and D of both traces, µm."""
    rows = [["ccw", "cw", *(f"{what}_{k}_um" for what in ("measured", "simulated") for k in ("Gb", "D"))]]
    for b in result.bidirectional:
        if b["ccw"] in names and b["cw"] in names:
            values = [
                b[what][k] for what in ("measured", "simulated") for k in ("circular_error_um", "mean_radial_error_um")
            ]
            rows.append([b["ccw"], b["cw"], *(f"{v:.4f}" for v in values)])
    return rows


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
