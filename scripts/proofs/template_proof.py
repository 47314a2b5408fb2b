#!/usr/bin/env python3
"""What a template costs, and what ten minutes cost: causes named, beside those named with the true data sheet.

    .venv/bin/python scripts/proofs/template_proof.py OUT.jsonl [--count 60]

The independent generator draws machines: each number of a drive lies within a factor of two of a template's, each on
its own, but for the gain of the velocity loop, which is tuned to the inertia within a factor of 1.5. Lead, teeth and
position gain are known: they are on the drawing and in the control. Two of three machines hide one cause. Each machine
runs the full plan of its template (``mjsim plan --new``), whose traces are diagnosed with the data sheet (off by its
tolerances, as ever) and with the template alone. It also runs the plan of ten minutes, which is diagnosed with the
template. The script goes on where it stopped: what OUT has is not made again.
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.extend(str(Path(__file__).resolve().parents[2] / name) for name in ("tests", "scripts/benchmarks"))

import numpy as np
from diagnosis_score import names_of, score
from independent import machines, templates
from independent.campaign import Case, write

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.machine_templates import FACTOR, SIZES, TEMPLATES
from mjsim.campaign.new import machine_text
from mjsim.commands.diagnose import diagnose
from mjsim.inference.planning.whole_campaign import CampaignPlanner, possible_tests
from mjsim.instruments.base import table_of
from mjsim.io.files import finite
from mjsim.machine.chain import chain_of

#: Velocity loops are tuned to the inertia within this factor.
_TUNED = 1.5
#: Sizes of what hides, µm RMS over the campaign.
_SIZES = (0.5, 1.2, 0.8)
#: A name with such a probability is confident.
_CONFIDENT = 0.95
#: Machine time of the short plan, minutes.
_SHORT = 10.0


def draw_rows(size, rng: np.random.Generator) -> tuple[tuple[float, ...], ...]:
    """The data sheet of a machine of some size, in the order of the generator's: lead or teeth, Kpp, Kvp, Ti, J,
    viscous, gravity, Coulomb, presliding.
    """
    rows = []
    for axis in machines.AXES:
        d = size.rotary if axis in "ABC" else size.linear
        ti, inertia, viscous, coulomb, presliding = FACTOR ** rng.uniform(-1.0, 1.0, 5)
        tuned = np.clip(inertia * _TUNED ** rng.uniform(-1.0, 1.0), 1.0 / FACTOR, FACTOR)
        numbers = (d.velocity_gain * tuned, d.integral_time * ti, d.inertia * inertia, d.viscous * viscous)
        lifted = d.lifted if axis == "Z" else 0.0
        more = (lifted, d.coulomb * coulomb, d.presliding * presliding)
        gear = int(d.gear) if axis in "ABC" else d.gear
        rows.append((gear, d.position_gain, *(float(f"{v:.3g}") for v in (*numbers, *more))))
    return tuple(rows)


@functools.cache
def template_text(name: str) -> str:
    """The machine file of a template, whose rotary axes count as the generator's machines do."""
    template = TEMPLATES[name]
    return machine_text(chain_of(template.chain.configuration), name, template)


@functools.cache
def planned(name: str) -> tuple[tuple[dict, ...], tuple[dict, ...]]:
    """The tests of the full and of the short plan of a template."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "machine.toml"
        file.write_text(template_text(name), encoding="utf-8")
        machine = read_machine(file)
        tests = [t for t in possible_tests(machine) if t.kind != "simultaneous"]  # the generator lacks these
        planner = CampaignPlanner(machine, threads=1, tests=tests)
    full, short = planner.plan().tests, planner.plan(_SHORT).tests
    return tuple(map(_to_measure, full)), tuple(map(_to_measure, short))


def _to_measure(test) -> dict:
    return table_of(test) | {"trace": f"traces/{test.name}.csv", "started_s": test.started}


def draw_case(number: int) -> tuple[Case, str]:
    """A machine and its campaign by the full plan, with the name of the template that its user takes."""
    rng = np.random.default_rng([91, number])
    size = SIZES[number % len(SIZES)]
    name, template = f"T{number}", f"trunnion-a-{size.name}"
    machines._ROWS[name] = draw_rows(size, rng)
    kind, subject = templates.SINGLES[int(rng.integers(len(templates.SINGLES)))]
    hidden, target = (), ()
    if (number // len(SIZES)) % 3:
        hidden = (templates.single(kind, subject, name, rng),)
        target = (min(_SIZES[int(rng.integers(len(_SIZES)))], templates.largest(kind, subject)),)
    label = f"{number:03d}-{f'{kind}.{subject}' if hidden else 'sound'}"
    return Case(label, name, planned(template)[0], hidden, target, seed=90_000 + number).resolved(), template


def answer_of(folder: Path, machine_file: Path, row: dict) -> dict:
    """The answer with one machine file, and its score."""
    began = time.process_time()
    campaign = read_campaign(folder)
    try:
        result = diagnose(campaign, read_machine(machine_file), threads=1)
        said = row | {"result": finite(result.to_json())}
    except Exception as error:  # a crash is a failure to report, not the end of the run
        said = row | {"error": repr(error)}
    return said | {"seconds": round(time.process_time() - began, 1)}


def run_case(number: int) -> dict:
    """The three answers on one machine."""
    case, template = draw_case(number)
    short = replace(case, tests=planned(template)[1])
    with tempfile.TemporaryDirectory() as name:
        folder, other = Path(name), Path(name) / "template.toml"
        other.write_text(template_text(template), encoding="utf-8")
        row = {"name": case.name, "noise_um": case.noise_um}
        full = row | {"answer": write(case, folder / "full")}
        ten = row | {"answer": write(short, folder / "short")}
        return {
            "sheet": answer_of(folder / "full", folder / "full" / "machine.toml", full),
            "template": answer_of(folder / "full", other, full),
            "ten minutes": answer_of(folder / "short", other, ten),
        }


def named(row: dict) -> bool:
    """Whether the hidden cause is a finding or one of its alternatives."""
    hidden = {e["id"] for e in row["answer"].get("effect", [])}
    return bool(hidden & {name for e in row.get("result", {}).get("effects", []) for name in names_of(e)})


def figures(rows: list[dict]) -> None:
    """Prints how often each answer was right, and how many of the causes it named that the true data sheet allows."""
    sound = [r for r in rows if not r["sheet"]["answer"].get("effect")]
    print(f"\n{len(rows)} campaigns, {len(sound)} of sound machines")
    print("| answer | hidden causes named | of the clear | of those that the sheet named | sound machines right |"
          " campaigns with a wrong name, p ≥ 0.95 | crash | median s |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for arm in rows[0]:
        scored = [score(r[arm]) for r in rows]
        hidden = [named(r[arm]) for r in rows if r not in sound]
        allowed = [named(r[arm]) for r in rows if named(r["sheet"])]
        clear = [c for s in scored for c in s.clear]
        right = [score(r[arm]).mark == "right" for r in sound]
        wrong = [any(p >= _CONFIDENT and not true for p, true in s.findings) for s in scored]
        cells = [f"{sum(x)} of {len(x)}" for x in (hidden, clear, allowed, right, wrong)]
        crashed, seconds = sum(s.mark == "crash" for s in scored), np.median([r[arm]["seconds"] for r in rows])
        print(f"| {arm} | {' | '.join(cells)} | {crashed} | {seconds:.0f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="file of JSON lines")
    parser.add_argument("--count", type=int, default=60)
    options = parser.parse_args()
    rows = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    done = {r["sheet"]["name"].split("-")[0] for r in rows}
    for number in range(options.count):
        if f"{number:03d}" in done:
            continue
        row = run_case(number)
        rows.append(row)
        with options.out.open("a") as file:
            file.write(json.dumps(row) + "\n")
        marks = ", ".join(f"{arm} {score(row[arm]).mark} in {row[arm]['seconds']:.0f} s" for arm in row)
        print(f"{row['sheet']['name']:36} {marks}", flush=True)
    figures(rows)


if __name__ == "__main__":
    main()
