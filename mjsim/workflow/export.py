"""Compared traces and their ISO 230-4 figures as CSV files that a spreadsheet opens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from mjsim.ballbar.iso230 import circular_figures
from mjsim.ballbar.kinds import kind_of
from mjsim.ballbar.measurement import Trace
from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.io.files import check_writable, write_all
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.units import DEG, MM, UM
from mjsim.workflow.compare import ComparedTest, Comparison, compare

FIGURES, PAIRS = "figures.csv", "figures-both-directions.csv"
_ISO = {"circular_error_um": "G_um", "radial_max_um": "Fmax_um", "radial_min_um": "Fmin_um"}


def wanted(campaign: Campaign, known: Sequence[str], asked: Sequence[str], what: str) -> list[str]:
    """Names of what is exported, in the order of the campaign: all that is ``known``, or what was ``asked`` for.

    Raises:
        InputError: No such ``what`` has a trace.
    """
    for name in asked:
        if name not in known:
            raise InputError(
                f"{campaign.folder / 'campaign.toml'}: no {what} {name!r} with a trace; it has: "
                f"{', '.join(known) or 'none'}"
            )
    return [name for name in known if not asked or name in asked]


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
    """Compare, and write a CSV per measured test, ``figures.csv`` and, for paths run both ways,
    ``figures-both-directions.csv``.

    Args:
        campaign, machine: what is compared; the set-up's nuisances are fitted over all its tests.
        out: folder. tests: only these. decimal_comma: semicolons and decimal commas, with a byte order mark, as
            spreadsheets of many languages expect. force: replace files.

    Returns:
        The files.

    Raises:
        InputError: a test is not measured, or a file exists and ``force`` is false.
    """
    names = wanted(campaign, [t.name for t in campaign.measured], tests, "test")
    for name in names:
        if f"{name}.csv" in (FIGURES, PAIRS):
            raise InputError(
                f"{campaign.folder / 'campaign.toml'}: test {name!r} would be written to the file of the figures; "
                f"rename it"
            )
    for file in (*(f"{n}.csv" for n in names), FIGURES, PAIRS):
        check_writable(Path(out) / file, force)
    result = compare(campaign, machine, threads, progress)
    contents = {
        f"{t.test.name}.csv": trace_rows(t, campaign.traces[t.test.name]) for t in result.tests if t.test.name in names
    }
    contents[FIGURES] = figure_rows(result, names)
    if len(pairs := pair_rows(result, names)) > 1:
        contents[PAIRS] = pairs
    write_all({Path(out) / file: as_csv(rows, decimal_comma) for file, rows in contents.items()}, force)
    return [Path(out) / f for f in contents]


def trace_rows(t: ComparedTest, recorded: Trace) -> list[list[str]]:
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


def figure_rows(result: Comparison, names: Sequence[str]) -> list[list[str]]:
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
    rows = [[*head, *both]]
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
        rows.append(
            [*how, *rest, f"{t.trigger * 1e3:.3f}", *(c for what in ("measured", "simulated") for c in _iso(t, what))]
        )
    return rows


def _iso(t: ComparedTest, what: str) -> list[str]:
    if not t.iso:
        return [""] * 5
    figures = asdict(circular_figures(t.phi[t.valid], getattr(t, what)[t.valid]))
    return [*(f"{figures[k]:.4f}" for k in _ISO), *(f"{c:.4f}" for c in figures["centre_um"])]


def pair_rows(result: Comparison, names: Sequence[str]) -> list[list[str]]:
    """Header and one row per path run both ways: G(b) and D of both traces, µm."""
    rows = [["ccw", "cw", *(f"{what}_{k}_um" for what in ("measured", "simulated") for k in ("Gb", "D"))]]
    for b in result.bidirectional:
        if b["ccw"] in names and b["cw"] in names:
            values = [
                b[what][k] for what in ("measured", "simulated") for k in ("circular_error_um", "mean_radial_error_um")
            ]
            rows.append([b["ccw"], b["cw"], *(f"{v:.4f}" for v in values)])
    return rows


def as_csv(rows: list[list[str]], decimal_comma: bool) -> str:
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
