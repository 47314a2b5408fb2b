"""The predicted error of parts, for the page."""

from __future__ import annotations

from collections.abc import Sequence

from mjsim.machine.model import Machine
from mjsim.plots.part import part_figure
from mjsim.prediction.part_run import PartRun
from mjsim.progress import Progress, silent
from mjsim.report.content import PartSection
from mjsim.workflow.diagnosis import Diagnosis
from mjsim.workflow.saved import saved_of


def part_sections(
    parts: Sequence[PartRun], machine: Machine, result: Diagnosis | None = None, progress: Progress = silent
) -> list[PartSection]:
    """One section per program.

    Args:
        parts: The programs.
        machine: Where they run, unless a diagnosis says so.
        result: Diagnosis of the machine.
        progress: Told what is being done.

    Raises:
        InputError: A program cannot be read or does not fit the machine.
    """
    saved = saved_of(result) if result is not None and result.posterior is not None else None
    out = []
    for k, part in enumerate(parts):
        progress("predicting parts", k, len(parts))
        predicted = part.on(machine if saved is None else saved.machine, saved)
        out.append(PartSection(predicted.to_json(blocks=False), part_figure(predicted)))
    return out
