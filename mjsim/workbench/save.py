"""Writing a model of the workbench to its machine file, with the same history as ``mjsim add`` and ``mjsim remove``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mjsim.campaign.machine_file import machine_document
from mjsim.commands import history
from mjsim.commands.ball_bar.compare import BarComparison, overlay
from mjsim.errors import InputError
from mjsim.inference.vibration import phased_at
from mjsim.io.files import write_all
from mjsim.io.toml import read_text
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.simulation.multibody import Reading
from mjsim.units import UM
from mjsim.workbench.overlay import Readings


@dataclass(frozen=True)
class Change:
    """One difference between two models: ``action`` is add (also of other values) or remove, ``machine`` the model
    with it and all the differences before it.
    """

    action: str
    effect: str
    machine: Machine

    @property
    def words(self) -> str:
        """Such as ``+ backlash.A``."""
        return f"{'+' if self.action == 'add' else '−'} {self.effect}"


def changes(before: Machine, after: Machine) -> list[Change]:
    """Steps from one model to another: what is gone, then what is new or has other values."""
    out, machine = [], before
    for e in before.effects:
        if after.effect(e.key) is None or all(e.key != f.key for f in after.effects):
            machine = machine.without(e.key)
            out.append(Change("remove", e.key, machine))
    known = {e.key: e for e in before.effects}
    for e in after.effects:
        if e.key not in known or known[e.key].values != e.values:
            machine = machine.with_effect(e)
            out.append(Change("add", e.key, machine))
    return out


def save(
    readings: Readings,
    before: Machine,
    after: Machine,
    text: str,
    force: bool = False,
    progress: Progress = silent,
) -> list[Change]:
    """Write a model to its machine file and its steps to the campaign's history.

    Args:
        readings: Of the campaign.
        before: The model that the file has.
        after: The model that it shall have.
        text: What the file had when it was read.
        force: Save a model that fits worse, too.
        progress: Stage, done, total.

    Returns:
        What was written; nothing is written where there is no difference.

    Raises:
        InputError: The file was changed meanwhile, nothing was measured, or the model fits worse.
    """
    path = after.file
    steps = changes(before, after)
    if not steps:
        return []
    check_unchanged(path, text)
    campaign = readings.opened.campaign
    if readings.opened.problem is None:
        raise InputError(f"{campaign.folder / 'campaign.toml'}: no test has a trace; the history needs the errors")
    first = last = _compared(readings, before)
    rows, document = [history.step_of("start", "", path, first)], text
    for i, step in enumerate(steps):
        progress("simulating what is saved", i, len(steps))
        last = _compared(readings, step.machine)
        document = machine_document(step.machine, path, document)
        rows.append(history.step_of(step.action, step.effect, path, last, document))
    if last.rms > first.rms and not force:
        raise InputError(
            f"{path}: the model fits worse than the file's: the residual RMS goes from {first.rms / UM:.3f} to "
            f"{last.rms / UM:.3f} µm; nothing was written"
        )
    check_unchanged(path, text)
    contents = {
        **history.changed_machine(document, path, campaign),
        history.history_file(campaign): history.with_steps(campaign, rows),
    }
    write_all(contents, force=True)
    return steps


def _compared(readings: Readings, machine: Machine) -> BarComparison:
    """What ``mjsim compare`` gives, from readings that are kept."""
    problem = readings.opened.problem
    assert problem is not None
    simulated = readings.multibody(machine, [t.name for t in problem.tests])
    machine, begin = phased_at(problem, machine)
    return overlay(problem, machine, [Reading(t, simulated[t.name].deviation) for t in problem.tests], begin)


def check_unchanged(path: Path, text: str) -> None:
    """Refuse to write a machine file that has another ``text`` than when it was read.

    Raises:
        InputError: It has.
    """
    if read_text(path) != text:
        raise InputError(f"{path}: was changed since it was opened; open the campaign again to see what it has now")
