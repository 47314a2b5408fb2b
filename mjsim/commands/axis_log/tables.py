"""Compared axis logs and their figures as rows of a table."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from mjsim.commands.any_instrument import FIGURES, Rows
from mjsim.commands.axis_log.compare import ComparedAxis, LogComparison


def tables_of_logs(result: LogComparison, names: Collection[str]) -> dict[str, Rows]:
    """A table per axis of every log, and their figures, by file.

    Args:
        result: All logs.
        names: Of the logs whose tables are wanted.
    """
    chosen = [t for t in result.tests if t.test.name in names]
    out = {f"{t.test.name}-{a.axis}.csv": log_rows(a) for t in chosen for a in t.channels}
    head = ["log", "axis", "unit", "rms", "max", "noise", "following_rms", "shift_ms"]
    return out | {FIGURES: [head, *(figure_row(t.test.name, a) for t in chosen for a in t.channels)]}


def log_rows(a: ComparedAxis) -> Rows:
    """Header and samples: time, command, measured and simulated position, their difference, speed and torque."""
    place, unit = a.travel.size, a.travel.suffix
    fine, small = a.channel.size, a.channel.suffix
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
    numbers = (a.rms, a.maximum, a.noise, a.following)
    return [name, a.axis, a.channel.suffix, *(f"{v / a.channel.size:.4f}" for v in numbers), f"{a.shift * 1e3:.4f}"]
