#!/usr/bin/env python3
"""Does the planned test decide? Campaigns of the independent generator with a cause that they cannot tell from another
one.

    .venv/bin/python scripts/proofs/plan_proof.py [NAME ...]

For each pair: the campaign is diagnosed (ambiguous), the next test is planned, the generator measures it on the same
machine with the same bar and a set-up of its own, and the longer campaign is diagnosed again. Prints one line per step.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from independent import layouts
from independent.campaign import Case, write_files

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.commands.diagnose import diagnose
from mjsim.commands.diagnosis import Diagnosis

_SLOW_CONES = (layouts.cone(15, (50, 0), feed=800.0), layouts.cone(15, (0, 50), "CW", feed=800.0))
_TURNS = tuple(layouts.rotary("C", *ends, (100, 0), "tangential", 2000.0) for ends in ((0, 360), (360, 0)))
_CIRCLES = tuple(layouts.circle("XY", way, 2000.0) for way in ("CCW", "CW"))
#: What hides, what it is mistaken for, and the tests that were measured first.
PAIRS = {
    "servo_gain.C": ("M2", {"id": "servo_gain.C", "ratio": 1.02}, "servo_delay.C", _SLOW_CONES),
    "backlash.C": ("M1", {"id": "backlash.C", "width_deg": 0.002}, "servo_delay.C", (*_TURNS, *_CIRCLES)),
    "scale_error.X": ("M3", {"id": "scale_error.X", "ppm": 25.0}, "scale_error.Y", _CIRCLES),
}


def said(result: Diagnosis) -> str:
    """Verdict and names in one line."""
    names = [e.effect.id + (f" (or {', '.join(e.alternatives)})" if e.alternatives else "") for e in result.effects]
    return f"{result.verdict}: {'; '.join(names) or 'nothing'}"


def prove(name: str, folder: Path, tell=print) -> tuple[Diagnosis, Diagnosis | None]:
    """Diagnoses before and after the planned test."""
    machine, hidden, rival, tests = PAIRS[name]
    case = Case(name, machine, tuple(layouts.arrange(list(tests))), (hidden,), seed=77)
    first = _diagnosed(case, folder / "first")
    tell(f"{name} (rival {rival}), {len(tests)} tests: {said(first)}")
    if first.next_test is None:
        return first, None
    plan = first.next_test
    planned = {**plan["test"], "trace": f"traces/{plan['test']['name']}.csv", "started_s": 2000.0}
    expected = f"expected difference {plan['difference_um']} µm, {plan['separation']} σ, {plan['minutes']} min"
    tell(f"  planned: {plan['test']['name']}, {expected}")
    second = _diagnosed(replace(case, tests=(*case.tests, planned)), folder / "second")
    tell(f"  with it: {said(second)}")
    return first, second


def _diagnosed(case: Case, folder: Path) -> Diagnosis:
    write_files(case, folder)
    campaign = read_campaign(folder)
    return diagnose(campaign, read_machine(campaign.machine_file))


def main() -> None:
    for name in sys.argv[1:] or PAIRS:
        with tempfile.TemporaryDirectory() as folder:
            prove(name, Path(folder), lambda text: print(text, flush=True))


if __name__ == "__main__":
    main()
