"""The commands as Python functions: ``add`` and ``remove`` an effect, with the ladder kept."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from mjsim.campaign.machine_file import machine_document, machine_of, read_machine, text_without
from mjsim.campaign.model import Campaign
from mjsim.campaign.temperature import in_campaign
from mjsim.commands import history as ladder
from mjsim.commands.ball_bar.compare import BarComparison, compare_bars
from mjsim.commands.calibrate import fit_within_tolerance
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.bar_search import BarSearch
from mjsim.inference.considered import with_instrument
from mjsim.inference.fit import Fitter
from mjsim.inference.mistakes.checked_problem import checked_problem, trusted_problem
from mjsim.inference.problem import Problem
from mjsim.inference.search import Model
from mjsim.inference.vibration import separate
from mjsim.io.files import write_all
from mjsim.io.toml import read_text
from mjsim.machine.chain import Chain
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine
from mjsim.progress import Progress, silent
from mjsim.threads import one_blas_thread
from mjsim.units import UM


@dataclass(frozen=True)
class Change:
    """What adding or removing an effect did: the effect, its 95 % intervals, and the comparisons before and after.

    ``effect`` and ``before`` are missing where the file of a removed effect could not be loaded.
    """

    id: str
    effect: Effect | None
    ci95: dict
    before: BarComparison | None
    after: BarComparison
    machine: Machine


def resolve_effect(name: str | Path, chain: Chain) -> tuple[type[Effect], list[str], Path | None]:
    """Class, possible subjects and source file of what the user names: an id, or the path of an effect file.

    Args:
        name: the id, or the path.
        chain: axes of the machine.

    Raises:
        InputError: there is no such effect, or the file is no effect file.
    """
    name = str(name)
    if name.endswith(".py") or Path(name).name != name:
        cls = registry.load_file(Path(name))
        return cls, list(cls.subjects_of(chain)), Path(name).resolve()
    cls, subject = registry.effect_class(name, chain)
    return cls, [subject], None


def file_reference(source: Path, machine_file: Path) -> str:
    """An effect file as a machine file names it: relative where it lies beside or below the machine file, so that
    both can move.
    """
    folder = machine_file.resolve().parent
    return source.relative_to(folder).as_posix() if source.is_relative_to(folder) else str(source)


def with_effect_file(machine: Machine, file: str | Path) -> Machine:
    """The machine with the effect of a file that mjsim wrote, at full size."""
    cls, (subject, *_), source = resolve_effect(Path(file).resolve(), machine.chain)
    assert source is not None
    effect = cls(subject, gain=1.0)
    named = {**machine.effect_files, effect.id: file_reference(source, machine.file)}
    return replace(machine, effect_files=named).with_effect(effect)


@one_blas_thread
def add(
    campaign: Campaign,
    effect: str | Path,
    machine_file: str | Path | None = None,
    threads: int = 2,
    progress: Progress = silent,
    record: bool = True,
    force: bool = False,
) -> Change:
    """Fit an effect to the campaign and put it into the machine file.

    The drives' data sheet, and what the machine file has a tolerance for, are calibrated during the fit, but not
    written: the file gets the effect only.

    Args:
        campaign: with at least one measured test.
        effect: id of the catalogue, or path of a Python file with one effect.
        machine_file: file to add it to; the campaign's machine when missing.
        threads: tests simulated side by side.
        progress: stage, done, total.
        record: write machine file and history.
        force: add an effect that makes the residual larger, too.

    Raises:
        InputError: unknown effect, one that this campaign cannot show, or one that makes the residual larger.
    """
    machine = machine_of(campaign, machine_file)
    cls, subjects, source = resolve_effect(effect, machine.chain)
    campaign = _with_traces(campaign)
    if record:
        ladder.read_history(campaign)  # a damaged history stops us before the work
    problem = checked_problem(campaign, machine, threads)
    progress("fitting", 0, 1)
    fitted_effect, ci95 = best_effect(problem, machine, cls, subjects)
    if source is not None:
        machine = replace(
            machine, effect_files={**machine.effect_files, fitted_effect.id: file_reference(source, machine.file)}
        )
    before = compare_bars(campaign, machine, threads, progress, problem)
    fitted = machine.with_effect(fitted_effect)
    after = compare_bars(campaign, fitted, threads, progress, problem)
    if after.rms > before.rms and not force:
        sizes = ((k, v) for k, v in fitted_effect.values.items() if isinstance(v, (int, float)))
        found = ", ".join(f"{k} = {v:.4g}" for k, v in sizes) or "what was found"
        raise InputError(
            f"{machine.file}: {fitted_effect.id} makes the model worse: the residual RMS goes from "
            f"{before.rms / UM:.3f} to {after.rms / UM:.3f} µm with {found}; nothing was written "
            "(--force adds it all the same)"
        )
    change = Change(fitted_effect.id, fitted_effect, ci95, before, after, fitted)
    if record:
        _record(campaign, "add", change, machine.file, machine_document(fitted, machine.file))
    return change


def remove(
    campaign: Campaign,
    effect: str,
    machine_file: str | Path | None = None,
    threads: int = 2,
    progress: Progress = silent,
) -> Change:
    """Take an effect out of the machine file again.

    Raises:
        InputError: the machine does not have it.
    """
    path = Path(machine_file if machine_file is not None else campaign.machine_file)
    try:
        machine = machine_of(campaign, path)
    except InputError:
        text = text_without(path, effect)
        if text == read_text(path):
            raise
        without = in_campaign(read_machine(path, text), campaign)
        return _remove_unreadable(campaign, effect, without, text, threads, progress)
    present = machine.effect(effect)
    if present is None:
        have = ", ".join(e.key for e in machine.effects) or "none"
        raise InputError(f"{machine.path}: has no effect {effect!r}; it has: {have}")
    campaign = _with_traces(campaign)
    ladder.read_history(campaign)  # a damaged history stops us before the work
    problem = trusted_problem(campaign, machine, threads)
    before = compare_bars(campaign, machine, threads, progress, problem)
    without = machine.without(present.key)
    after = compare_bars(campaign, without, threads, progress, problem)
    change = Change(present.id, present, {}, before, after, without)
    _record(campaign, "remove", change, machine.file, machine_document(without, machine.file))
    return change


def _remove_unreadable(
    campaign: Campaign, effect_id: str, without: Machine, text: str, threads: int, progress: Progress
) -> Change:
    """Take out an effect whose file is gone or broken: the error before cannot be known."""
    campaign = _with_traces(campaign)
    ladder.read_history(campaign)
    change = Change(effect_id, None, {}, None, compare_bars(campaign, without, threads, progress), without)
    _record(campaign, "remove", change, without.file, text)
    return change


def _with_traces(campaign: Campaign) -> Campaign:
    """The ball-bar tests of a campaign, of which one was measured."""
    bars = campaign.in_motion
    bars.need_traces("the error before and after needs at least one measured test")
    return bars


def _record(campaign: Campaign, action: str, change: Change, path: Path, text: str) -> None:
    """Write the machine file's new ``text`` and the history."""
    start = [ladder.step_of("start", "", path, change.before)] if change.before else []
    steps = ladder.with_steps(campaign, [*start, ladder.step_of(action, change.id, path, change.after, text)])
    write_all({**ladder.changed_machine(text, path, campaign), ladder.history_file(campaign): steps}, force=True)


def best_effect(problem: Problem, machine: Machine, cls: type[Effect], subjects: list[str]) -> tuple[Effect, dict]:
    """The effect at its best values on its best subject, with their 95 % intervals; vibrations are left out of the
    data meanwhile.
    """
    separated = separate(problem, machine)
    if cls.kind == "vibration":
        mine = [line for line in separated.lines if line.effect.subject in subjects and line.ci95]
        if not mine:
            raise InputError(
                f"effect vibration.{'/'.join(subjects)}: no line of constant frequency along this axis stands out "
                f"of the noise"
            )
        return mine[0].effect, mine[0].ci95
    fitter = Fitter(separated.problem, separated.machine)
    model = max((fit_effect(fitter, cls, s) for s in subjects), key=lambda m: m.evidence)
    best = with_instrument(model.problem, model.fit)
    free = best.effects[-1]
    return free.effect, free.interval(free.vector, best.covariance_of(free))


def fit_effect(fitter: Fitter, cls: type[Effect], subject: str) -> Model:
    """Best fit of one effect over its starting points, beside what the machine file has a tolerance for.

    Raises:
        InputError: the campaign cannot show it.
    """
    effect_id = f"{cls.kind}.{subject}"
    found = BarSearch(fitter, only=[(cls, subject)]).with_effect(fit_within_tolerance(fitter, without=effect_id))
    if found is None:
        raise InputError(
            f"effect {effect_id} does not change any reading of this campaign, so it cannot be fitted; allowed: an "
            "effect on an axis that moves in its tests"
        )
    return found
