"""Does the suite notice? Ten small bugs are planted one by one in a copy of the repository, and the tests have to fail
each time.

    .venv/bin/python scripts/mutation_check.py [NAME...]

For each bug the tests nearest to it run first and then, unless they have failed, all others. Prints what noticed it and
how long that took; exit status 1 if a bug stays unnoticed.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Bug:
    """``old`` in ``file`` becomes ``new``; ``near`` are the test modules that run first."""

    name: str
    what: str
    file: str
    old: str
    new: str
    near: str


BUGS = (
    Bug(
        "kinematics",
        "the A axis' tilt about Y has the other sign",
        "mjsim/machine/kinematics.py",
        "turn = rotation(error.along, value) @ turn",
        'turn = rotation(error.along, -value if error.name == "EB0A" else value) @ turn',
        "test_kinematics test_model",
    ),
    Bug(
        "servo",
        "the integral time acts on the position loop as well",
        "mjsim/simulation/drive.py",
        "Kv / (Ti * J)], [-Kp",
        "Kv * (1.0 + 1e-3 * Kp) / (Ti * J)], [-Kp",
        "test_drive test_oracle_drives",
    ),
    Bug(
        "friction",
        "the bristle's mean over a sub-step is its end",
        "mjsim/simulation/drive.py",
        "mean = end + (z - end) * (1.0 - e) / a",
        "mean = zn",
        "test_drive test_convergence test_oracle_drives",
    ),
    Bug(
        "backlash",
        "the whole play is taken for half of it",
        "mjsim/effects/backlash.py",
        "0.5 * self.si(name)",
        "self.si(name)",
        "test_effects",
    ),
    Bug(
        "pitch error",
        "the phase has the other sign",
        "mjsim/effects/pitch_error.py",
        "math.radians(phase)",
        "-math.radians(phase)",
        "test_effects",
    ),
    Bug(
        "nuisance fit",
        "the trigger's derivative has the other sign",
        "mjsim/inference/problem.py",
        "out[:, 7] = -s.sample",
        "out[:, 7] = s.sample",
        "test_estimation",
    ),
    Bug(
        "prior odds",
        "most causes are expected in every machine",
        "mjsim/inference/hypotheses.py",
        "CAUSE = -7.0",
        "CAUSE = 7.0",
        "test_estimation test_bank test_examples",
    ),
    Bug(
        "units",
        "a microinch is a tenth of what it is",
        "mjsim/importing/units.py",
        "25.4e-3 * UM",
        "2.54e-3 * UM",
        "test_import",
    ),
    Bug(
        "file writing",
        "what was half-written stays when a command fails",
        "mjsim/io/files.py",
        "            one.remove()\n",
        "            pass\n",
        "test_writing test_bad_input test_files",
    ),
    Bug(
        "batch resume",
        "a run of which one test is done is not finished",
        "mjsim/batch/run.py",
        "if job not in done",
        "if job.run not in {run for run, _ in done}",
        "test_batch",
    ),
)


def copy_of_repository(folder: Path) -> None:
    """The tracked files, and the environment as a link."""
    names = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split("\0")
    for name in filter(None, names):
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, target)


def plant(bug: Bug, folder: Path) -> None:
    """Put the bug in."""
    file = folder / bug.file
    text = file.read_text()
    if text.count(bug.old) != 1:
        raise SystemExit(
            f"{bug.name}: {bug.file} has {text.count(bug.old)} places with {bug.old!r}; the check needs exactly one"
        )
    file.write_text(text.replace(bug.old, bug.new))


def noticed(folder: Path, modules: list[str]) -> str:
    """The first test of ``modules`` that fails; empty where none does."""
    env = os.environ | {
        "PYTHONPATH": str(folder),
        "PYTHONDONTWRITEBYTECODE": "1",
        "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl"),
        "MPLBACKEND": "Agg",
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-x",
        "-n",
        "2",
        "--dist=loadfile",
        "--durations=0",
        "--durations-min=1e9",
    ]
    done = subprocess.run([*command, *modules], cwd=folder, env=env, capture_output=True, text=True)
    if done.returncode == 0:
        return ""
    failed = re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
    if not failed:
        raise SystemExit(f"pytest ended with status {done.returncode}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return failed[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help=f"of: {', '.join(b.name for b in BUGS)} (default: all)")
    chosen = parser.parse_args().names
    missed = 0
    print("| bug | what is wrong | noticed by | s |\n|---|---|---|---|", flush=True)
    for bug in BUGS:
        if chosen and bug.name not in chosen:
            continue
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            copy_of_repository(folder)
            plant(bug, folder)
            begin = time.monotonic()
            near = [f"tests/{m}.py" for m in bug.near.split()]
            others = sorted(
                f"tests/{p.name}" for p in (folder / "tests").glob("test_*.py") if f"tests/{p.name}" not in near
            )
            others.remove("tests/test_upkeep.py")  # lint and types are no test of what a program does
            by = noticed(folder, near) or noticed(folder, others)
            missed += not by
            print(f"| {bug.name} | {bug.what} | {by or 'NOTHING'} | {time.monotonic() - begin:.0f} |", flush=True)
    sys.exit(bool(missed))


if __name__ == "__main__":
    main()
