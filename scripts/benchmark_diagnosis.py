#!/usr/bin/env python3
"""How far can the diagnosis be trusted? Campaigns of the independent generator (tests/independent), whose answers are
known.

    scripts/benchmark_diagnosis run [--half tune|publish] [--category C ...] [--only TEXT] [--jobs N] [--out FILE]
    scripts/benchmark_diagnosis run --simple OTHER-FILE ...
    scripts/benchmark_diagnosis report [--out FILE] [--half publish] [--simple OTHER-FILE] [--pages docs]

`run` writes one line per campaign into FILE (default benchmark-diagnosis.jsonl) and goes on where it stopped; a
campaign that is in the file already is not run again. One half of the bank is for tuning, the other is published. A
half takes some two hours on two cores: ideal machines a quarter of it, real ones the rest. With --simple two
simple methods answer instead of the diagnosis, into that file (see scripts/diagnosis_baselines.py); `report --simple`
prints their figures beside. `report` also keeps the answers, in PAGES/data.
"""

from __future__ import annotations

import argparse
import gzip
import json
import multiprocessing
import os
import random
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from itertools import groupby
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # one campaign per core; before numpy is imported, here and in the workers
ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "scripts")]
_GROUP = 6


def run_group(cases: list, out: Path, answer: Callable) -> int:
    """Generate and diagnose cases that share tests and machine (their signatures are computed once); each goes into
    the file at once.
    """
    for case in cases:
        row = run_case(case, answer)
        with out.open("a") as file:  # one short write each: lines of several processes do not mix
            file.write(json.dumps(row) + "\n")
        print(summary(row), flush=True)
    return len(cases)


def run_case(case, answer: Callable) -> dict:
    """One campaign: written as files, read and answered as a user's, on one thread."""
    from independent import campaign as generator
    from independent import heldout

    row = {
        "name": case.name,
        "category": case.category,
        "half": case.half,
        "machine": case.machine,
        "tests": len(case.tests),
        "noise_um": case.noise_um,
        "commit": commit(),
    }
    further = case.within or case.catalogue() or case.unlisted()
    return row | answer(case, generator.write, heldout.write_heldout if further else None)


@cache
def commit() -> str:
    """Short name of the version that answers."""
    return subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout[:-1]


def answered(case, write, write_heldout=None) -> dict:
    """The true answer of a case, what mjsim says (``write`` makes the files), and the seconds of the processor; with
    ``write_heldout`` also how much of the error of other tests it predicts.
    """
    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import read_machine
    from mjsim.cli.common import finite
    from mjsim.workflow.diagnose import diagnose
    from mjsim.workflow.diagnosis import write_effect_file
    from mjsim.workflow.edit import with_effect_file

    row: dict = {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            row["answer"] = write(case, Path(folder))
            began = time.process_time()
            campaign = read_campaign(folder)
            machine = read_machine(campaign.machine_file)
            diagnosis = diagnose(campaign, machine, threads=1)
            row["result"] = finite(diagnosis.to_json())
            row["seconds"] = round(time.process_time() - began, 1)
            if write_heldout:
                write_heldout(case, folder)
                fitted, unknown = diagnosis.machine, write_effect_file(diagnosis, Path(folder)).unexplained
                if unknown:
                    fitted = with_effect_file(fitted, unknown.effect_file)
                row["heldout_um"], row["heldout_removed"] = removed(Path(folder) / "heldout", fitted)
        except Exception:  # a crash is a failure to report, not the end of the bank
            row["error"] = traceback.format_exc(limit=-3)
    return row


def answered_simply(case, write, write_heldout=None) -> dict:
    """The true answer of a case, and what two simple methods say. Neither has a model that could predict other tests,
    so ``write_heldout`` is not called.
    """
    from diagnosis_baselines import Baselines

    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import read_machine

    row: dict = {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            row["answer"] = write(case, Path(folder))
            began = time.process_time()
            campaign = read_campaign(folder)
            row["results"] = Baselines(campaign, read_machine(campaign.machine_file)).answers()
            row["seconds"] = round(time.process_time() - began, 1)
        except Exception:  # a crash is a failure to report, not the end of the bank
            row["error"] = traceback.format_exc(limit=-3)
    return row


def removed(folder: Path, machine) -> tuple[float, float]:
    """RMS error of tests outside a campaign, in µm, and the share of its square that a fitted machine predicts. The
    ball's place is left out (first harmonic), as it is set up anew for each.
    """
    import numpy as np

    from mjsim.campaign.files import read_campaign
    from mjsim.machine.model import build
    from mjsim.simulation.axes import AxesMotion

    left = error = 0.0
    plant = build(machine)
    tests = read_campaign(folder / "campaign.toml").tests
    for test in tests:
        phi, true, nominal = np.loadtxt(folder / f"{test.name}.truth.csv", delimiter=",", skiprows=1).T
        motion = AxesMotion(test)
        place = np.degrees(motion.program.phi(motion.time))
        order = np.argsort(place, kind="stable")
        predicted = np.interp(phi, place[order], motion.reading(plant)[order] * 1e6)
        turning = (abs(phi) > 30.0) & (abs(phi) < 690.0)  # away from the run-in and the run-out
        angle = np.radians(phi[turning])
        basis = np.column_stack([np.ones(len(angle)), np.cos(angle), np.sin(angle)])

        def shape(x, basis=basis, turning=turning):
            return x[turning] - basis @ np.linalg.lstsq(basis, x[turning], rcond=None)[0]

        left += float(np.mean(shape(true - predicted) ** 2))
        error += float(np.mean(shape(true - nominal) ** 2))
    return round(np.sqrt(error / len(tests)), 4), round(1.0 - left / error, 4)


def run(options: argparse.Namespace) -> None:
    from independent import bank

    out, answer = (options.simple, answered_simply) if options.simple else (options.out, answered)
    done = {json.loads(line)["name"] for line in out.read_text().splitlines()} if out.exists() else set()
    todo = [c for c in bank.cases() if c.name not in done and (not options.half or c.half == options.half)]
    if options.category:
        todo = [c for c in todo if c.category in options.category]
    if options.only:
        todo = [c for c in todo if options.only in c.name]
    todo = todo[: options.most]

    def place(c) -> tuple:
        return (c.category == "null", c.machine, json.dumps(c.tests))

    groups = []
    for _, members in groupby(sorted(todo, key=place), key=place):
        members = list(members)
        groups += [members[i : i + _GROUP] for i in range(0, len(members), _GROUP)]
    random.Random(1).shuffle(groups)  # a run that is stopped early is a fair sample
    print(f"{len(todo)} campaigns to run, {len(done)} done before", flush=True)
    began, count = time.time(), 0
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context) as pool:
        for future in as_completed([pool.submit(run_group, g, out, answer) for g in groups]):
            count += future.result()
            left = (time.time() - began) / count * (len(todo) - count) / 60.0
            print(f"{count} of {len(todo)} done, about {left:.0f} min left", flush=True)


def summary(row: dict) -> str:
    """One line about a campaign: mark, name, what was said."""
    from diagnosis_figures import mark

    if "error" in row:
        return f"CRASH {row['name']}: {row['error'].strip().splitlines()[-1]}"
    if "results" in row:
        return f"{row['name']}: " + "; ".join(f"{k} {len(r['effects'])} effects" for k, r in row["results"].items())
    r = row["result"]
    said = [e["id"] + (f" ({', '.join(e['alternatives'])})" if e["alternatives"] else "") for e in r["effects"]]
    rest = f" + unknown {r['unexplained']['axes'][0]} {r['unexplained']['variable']}" if r["unexplained"] else ""
    return f"{mark(row):9s} {row['name']}: {r['verdict']} {'; '.join(said)}{rest}  {row['seconds']:.0f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=("run", "report"))
    parser.add_argument("--half", choices=("tune", "publish"))
    parser.add_argument("--category", nargs="*")
    parser.add_argument("--only", help="campaigns whose name contains this")
    parser.add_argument("--most", type=int, help="at most so many campaigns")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--out", type=Path, default=ROOT / "benchmark-diagnosis.jsonl")
    parser.add_argument("--simple", type=Path, help="file of the answers of two simple methods")
    parser.add_argument("--pages", type=Path, default=ROOT / "docs", help="folder of the pages")
    parser.add_argument("--remark", default="", help="paragraphs for the page")
    options = parser.parse_args()
    if options.action == "run":
        run(options)
        return
    from diagnosis_report import page_of_ideal_machines
    from diagnosis_report_real import page_of_real_machines

    rows = rows_of(options.out, options.half)
    simple = rows_of(options.simple, options.half) if options.simple else []
    real = [r for r in rows if r["category"].startswith("real")]
    ideal = [r for r in rows if not r["category"].startswith("real")]
    pages = (
        ("diagnosis-benchmark", ideal, page_of_ideal_machines),
        ("diagnosis-benchmark-real", real, page_of_real_machines),
    )
    for name, mine, page in pages:
        if mine:
            lines = page(mine, simple, options.remark)
            (options.pages / f"{name}.md").write_text("\n".join(lines).rstrip() + "\n")
            print(f"page written to {options.pages / name}.md, its rows to {keep(mine, options.pages, name)}")
    if simple:
        keep(simple, options.pages, "simple-methods")


def keep(rows: list[dict], pages: Path, name: str) -> Path:
    """Write rows beside the pages, compressed; the file."""
    file = pages / "data" / f"{name}.jsonl.gz"
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(gzip.compress("".join(json.dumps(r) + "\n" for r in rows).encode(), mtime=0))
    return file


def rows_of(file: Path, half: str | None) -> list[dict]:
    """Rows of one half of the bank."""
    rows = [json.loads(line) for line in file.read_text().splitlines()]
    return [r for r in rows if r["half"] == (half or "publish")]


if __name__ == "__main__":
    main()
