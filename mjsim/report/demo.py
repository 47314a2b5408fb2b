"""The hidden-effect walk-through: compare, diagnose, add, watch the error fall, report."""

from __future__ import annotations

import os
import secrets
import shutil
from dataclasses import dataclass
from pathlib import Path

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine, write_machine
from mjsim.errors import InputError
from mjsim.io.files import check_writable, write_whole
from mjsim.io.resources import examples
from mjsim.progress import Progress, silent
from mjsim.workflow import history as ladder
from mjsim.workflow.compare import Comparison
from mjsim.workflow.diagnose import Diagnosis, diagnose

EXAMPLE = "hidden-backlash"


@dataclass(frozen=True)
class Demo:
    """What the walk-through produced: the working copy, the diagnosis, the ladder and the report."""

    folder: Path
    diagnosis: Diagnosis
    steps: list[ladder.Step]
    report: Path


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
        (stage / marker.name).write_text("made by mjsim demo; it may be replaced by the next one\n")
        if target.exists():
            shutil.rmtree(target)
        stage.rename(target)
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(stage, ignore_errors=True)
    return out


def run(out: Path, threads: int = 2, progress: Progress = silent) -> Demo:
    """Prepare ``out`` and run the walk-through in it.

    Raises:
        InputError: as :func:`prepare`.
    """
    return walk(prepare(out), threads, progress)


def walk(folder: Path, threads: int = 2, progress: Progress = silent) -> Demo:
    """Run the walk-through in a folder that :func:`prepare` has made."""
    from mjsim.report.build import build_report

    campaign = read_campaign(folder)
    machine = read_machine(campaign.machine_file)
    result = diagnose(campaign, machine, threads=threads, progress=progress)
    rungs: list[tuple[str, str, Comparison]] = [("start", "", result.before)]
    rungs += [("add", e.effect.id, c) for e, c in zip(result.effects, result.rungs[1:], strict=True)]
    original = campaign.machine_file
    steps = [ladder.step_of(action, effect, original, c) for action, effect, c in rungs]
    ladder.record(campaign, steps)
    write_machine(result.machine, original, original, force=True)
    report = folder / "report.html"
    write_whole(report, build_report(result, threads, progress, thorough=False), force=True)
    return Demo(folder, result, steps, report)
