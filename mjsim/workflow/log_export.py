"""Compared axis logs as CSV files that a spreadsheet opens."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mjsim.campaign.model import Campaign
from mjsim.io.files import check_writable, write_all
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.units import DEG, MM, UM
from mjsim.workflow.export import FIGURES, as_csv, wanted
from mjsim.workflow.log_compare import ComparedAxis, compare_logs


def export_logs(
    campaign: Campaign,
    machine: Machine,
    out: str | Path,
    tests: Sequence[str] = (),
    decimal_comma: bool = False,
    force: bool = False,
    threads: int = 2,
    progress: Progress = silent,
    figures: str = FIGURES,
) -> list[Path]:
    """Compare, and write a CSV per axis of every log, and their figures.

    Args:
        campaign: What is compared.
        machine: With what.
        out: Folder.
        tests: Only these logs.
        decimal_comma: Semicolons and decimal commas, with a byte order mark.
        force: Replace files.
        threads: Simulations side by side.
        progress: Called as work gets on.
        figures: File of the table of figures.

    Returns:
        The files.

    Raises:
        InputError: A log has no recording, or a file exists and ``force`` is false.
    """
    names = wanted(campaign, [t.name for t in campaign.logs.recorded], tests, "log")
    chosen = [t for t in campaign.logs.recorded if t.name in names]
    files = [f"{t.name}-{a}.csv" for t in chosen for a in t.axes]
    for file in (*files, figures):
        check_writable(Path(out) / file, force)
    result = compare_logs(campaign, machine, threads, progress)
    contents, lines = {}, [["log", "axis", "unit", "rms", "max", "noise", "following_rms", "shift_ms"]]
    for t in result.tests:
        if t.test not in chosen:
            continue
        for a in t.axes.values():
            contents[f"{t.test.name}-{a.axis}.csv"] = log_rows(a)
            lines.append(figure_row(t.test.name, a))
    contents[figures] = lines
    write_all({Path(out) / file: as_csv(rows, decimal_comma) for file, rows in contents.items()}, force)
    return [Path(out) / file for file in contents]


def log_rows(a: ComparedAxis) -> list[list[str]]:
    """Header and samples: time, command, measured and simulated position, their difference, speed and torque."""
    place, unit = (DEG, "deg") if a.rotary else (MM, "mm")
    fine, small = (DEG, "deg") if a.rotary else (UM, "um")
    head = ["time_s", f"command_{unit}", f"measured_{unit}", f"simulated_{unit}", f"residual_{small}"]
    head += [f"velocity_{unit}_per_s", "torque_Nm"]
    columns = [a.time, a.command / place, a.measured / place, a.simulated / place, a.residual / fine]
    columns += [a.velocity / place, a.torque]
    if a.recorded_torque is not None:
        head.append("recorded_torque_Nm")
        columns.append(a.recorded_torque)
    forms = ["{:.6f}"] * 4 + ["{:.5f}", "{:.5f}", "{:.7g}", "{:.7g}"]
    table = np.column_stack(columns)
    return [head, *([f.format(v) for f, v in zip(forms, row, strict=False)] for row in table)]


def figure_row(name: str, a: ComparedAxis) -> list[str]:
    """What one axis of one log comes to."""
    unit, symbol = (DEG, "deg") if a.rotary else (UM, "um")
    following = float(np.sqrt(np.mean((a.command - a.measured) ** 2)))
    numbers = (a.rms, float(np.abs(a.residual).max()), a.noise.rms, following)
    return [name, a.axis, symbol, *(f"{v / unit:.4f}" for v in numbers), f"{a.shift * 1e3:.4f}"]
