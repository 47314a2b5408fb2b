"""The hidden-effect walk-through: compare, diagnose, add, watch the error fall, report."""

from __future__ import annotations

import os
import secrets
import shutil
from dataclasses import dataclass
from pathlib import Path

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import machine_of, write_machine
from mjsim.commands import history as ladder
from mjsim.commands.ball_bar.compare import BarComparison, compare_bars
from mjsim.commands.diagnose import diagnose
from mjsim.commands.diagnosis import Diagnosis
from mjsim.errors import InputError
from mjsim.io.files import check_writable, write_whole
from mjsim.io.resources import examples
from mjsim.plots.output import ladder_plot, overview_plot
from mjsim.progress import Progress, silent
from mjsim.report.build import diagnosed
from mjsim.report.page import render
from mjsim.report.write import need_report

EXAMPLE = "hidden-backlash"


@dataclass(frozen=True)
class Demo:
    """What the walk-through produced.

    Attributes:
        folder: the working copy of the example.
        diagnosis: of the machine as given.
        steps: the ladder.
        picture: the ladder's.
        report: the page, or None.
        no_report: why there is none.
    """

    folder: Path
    diagnosis: Diagnosis
    steps: list[ladder.Step]
    picture: Path
    report: Path | None
    no_report: str = ""


def prepare(out: Path) -> Path:
    """A working copy of the example in ``out``.

    Raises:
        InputError: ``out`` exists and is no folder that an earlier walk-through has made.
    """
    marker = out / ".mjsim-demo"
    check_writable(marker, force=True)
    if out.exists():
        if not marker.is_file() and any(out.iterdir() if out.is_dir() else [out]):
            raise InputError(f"{out}: exists already and was not made by mjsim demo; name another folder with --out")
    target = Path(os.path.realpath(out))
    stage = target.with_name(f".{target.name[:80]}.{secrets.token_hex(6)}")
    try:
        shutil.copytree(examples() / EXAMPLE, stage, ignore=shutil.ignore_patterns("heldout"))
        (stage / marker.name).write_text("made by mjsim demo; it may be replaced by the next one\n", encoding="utf-8")
        if target.exists():
            shutil.rmtree(target)
        stage.rename(target)
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(stage, ignore_errors=True)
    return out


def first_look(folder: Path, threads: int = 2, progress: Progress = silent) -> tuple[BarComparison, Path]:
    """Compare the campaign in a folder that :func:`prepare` has made; the comparison and its picture."""
    campaign = read_campaign(folder)
    result = compare_bars(campaign, machine_of(campaign), threads, progress)
    picture = folder / "measured-and-simulated.png"
    progress("plotting", 0, 1)
    overview_plot(result, picture)
    return result, picture


def walk(folder: Path, threads: int = 2, progress: Progress = silent) -> Demo:
    """Run the walk-through in a folder that :func:`prepare` has made: diagnose, add, ladder, report.

    The report is left out where the extra "report" is not installed.
    """
    campaign = read_campaign(folder)
    machine = machine_of(campaign)
    result = diagnose(campaign, machine, threads=threads, progress=progress)
    rungs: list[tuple[str, str, BarComparison]] = [("start", "", result.before)]
    rungs += [("add", e.effect.id, c) for e, c in zip(result.effects, result.rungs[1:], strict=True)]
    original = campaign.machine_file
    steps = [ladder.step_of(action, effect, original, c) for action, effect, c in rungs]
    ladder.record(campaign, steps)
    write_machine(result.machine, original, original, force=True)
    picture = folder / "ladder.png"
    ladder_plot(steps, picture)
    try:
        need_report()
    except InputError as error:
        return Demo(folder, result, steps, picture, None, str(error))
    report = folder / "report.html"
    write_whole(report, render(diagnosed(result, threads, progress, thorough=False)), force=True)
    return Demo(folder, result, steps, picture, report)
