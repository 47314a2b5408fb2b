"""How far can the diagnosis be trusted? Campaigns of the independent generator (tests/independent), whose answers are
known.

    benchmark_diagnosis.py run [--half tune|publish] [--world ideal|real|wild ...] [--processes N] [--timeout S]
    benchmark_diagnosis.py run --category C ... --only TEXT --most N
    benchmark_diagnosis.py run --simple OTHER-FILE ...
    benchmark_diagnosis.py write --folder F [choices as of run]
    benchmark_diagnosis.py report [--half publish] [--simple OTHER-FILE] [--pages docs]

`run` appends one line of JSON per campaign to FILE (--out) and goes on where it stopped. Ctrl-C lets the groups of
campaigns that are running finish, a second one stops at once. One half of the bank is for tuning, and each of its
campaigns is printed. The other is published: it is run by whole worlds, nobody looks into a campaign of it, and the
figures come at its end with one line per miss. --publish lifts that, for who has published.

With --simple two simple methods answer instead of the diagnosis, into that file (see diagnosis_baselines.py);
`report --simple` prints their figures beside. `report` writes the page, its figure and, in PAGES/data, the answers.
`write` writes campaigns as folders with answers.toml.
"""

from __future__ import annotations

import argparse
import gzip
import json
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from functools import cache
from itertools import groupby
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # one campaign per core; before numpy is imported, here and in the workers
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "scripts" / "benchmarks")]
_GROUP = 6


@cache
def commit() -> str:
    """Short name of the version that answers."""
    return subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout[:-1]


def run_group(cases: list, out: Path, answer: Callable, timeout: float, quiet: bool) -> int:
    """Generate and diagnose cases that share tests and machine (their signatures are computed once); each goes into
    the file at once. Their number.
    """
    for case in cases:
        row = run_case(case, answer, timeout)
        file = os.open(out, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.write(file, (json.dumps(row) + "\n").encode())  # one write each: lines of several processes do not mix
        os.close(file)
        if not quiet:
            print(_line(row), flush=True)
    return len(cases)


def run_case(case, answer: Callable, timeout: float) -> dict:
    """One campaign, written as files and read and answered as a user's, on one thread.

    Args:
        case: Of the bank.
        answer: Adds to the row of a case what hides and what was said, :func:`answer` or :func:`answer_simply`.
        timeout: Seconds of the processor after which it counts as crashed.
    """
    from independent.bank import world

    row = {k: getattr(case, k) for k in ("name", "category", "half", "noise_um")}
    row |= {"world": world(case.category), "commit": commit()}
    signal.signal(signal.SIGPROF, _out_of_time)
    signal.setitimer(signal.ITIMER_PROF, timeout)
    try:
        answer(case, row)
    except Exception:  # a crash is a failure to report, not the end of the bank
        row["error"] = traceback.format_exc(limit=-3).replace(f"{ROOT}/", "")
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return row


def _out_of_time(*_) -> None:
    raise TimeoutError("out of time")


def answer(case, row: dict, heldout: bool | None = None) -> None:
    """Adds the true answer of a case, what mjsim says, and the seconds of the processor; with ``heldout`` also how
    much of the error of other tests it predicts (``None``: where there is an error).
    """
    from independent.bank import write_case

    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import read_machine
    from mjsim.commands.diagnose import diagnose
    from mjsim.commands.diagnosis import write_effect_file
    from mjsim.commands.edit import with_effect_file
    from mjsim.io.files import finite

    with tempfile.TemporaryDirectory() as folder:
        heldout = case.erring if heldout is None else heldout
        row["answer"] = write_case(case, Path(folder), heldout)
        began = time.process_time()
        campaign = read_campaign(folder)
        machine = read_machine(campaign.machine_file)
        diagnosis = diagnose(campaign, machine, threads=1)
        row["result"] = finite(diagnosis.to_json())
        row["seconds"] = round(time.process_time() - began, 1)
        if heldout:
            fitted, unknown = diagnosis.machine, write_effect_file(diagnosis, Path(folder)).unexplained
            if unknown:
                fitted = with_effect_file(fitted, unknown.effect_file)
            row["heldout_um"], row["heldout_removed"] = removed(Path(folder) / "heldout", fitted)


def answer_simply(case, row: dict) -> None:
    """Adds the true answer of a case, and what two simple methods say. Neither has a model that could predict other
    tests.
    """
    from diagnosis_baselines import Baselines
    from independent.bank import write_case

    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import read_machine

    with tempfile.TemporaryDirectory() as folder:
        row["answer"] = write_case(case, Path(folder))
        began = time.process_time()
        campaign = read_campaign(folder)
        row["results"] = Baselines(campaign, read_machine(campaign.machine_file)).answers()
        row["seconds"] = round(time.process_time() - began, 1)


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
    """Answer the campaigns that are not in the file yet."""
    published, wanted = options.half == "publish" and not options.publish, chosen(options)
    from diagnosis_page import summary
    from diagnosis_score import score

    out, method = (options.simple, answer_simply) if options.simple else (options.out, answer)
    done = {r["name"] for r in _lines(out)}
    groups = _groups([c for c in wanted if c.name not in done][: options.most])
    todo = sum(len(g) for g in groups)
    print(f"{todo} campaigns to run, {len(wanted) - todo} done before or left out", flush=True)
    began, count = time.time(), 0
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.processes, mp_context=context, initializer=_deaf) as pool:
        futures = [pool.submit(run_group, g, out, method, options.timeout, published) for g in groups]
        _stop_by_keyboard(futures)
        for future in as_completed(futures):
            if future.cancelled():
                continue
            count += future.result()
            left = (time.time() - began) / count * (todo - count) / 60.0
            print(f"{count} of {todo} done, about {left:.0f} min left", flush=True)
    if count == todo and not options.simple:
        print(*summary([score(r) for r in _lines(out) if r["half"] == options.half]), sep="\n")


def chosen(options: argparse.Namespace) -> list:
    """Cases that the options choose; of the published half, whole worlds."""
    if options.half == "publish" and not options.publish:
        if options.category or options.only or options.most or options.action == "write":
            sys.exit("the published half is run by whole worlds; allowed without --publish: run, and --world")
    from independent.bank import cases, world

    return [
        c
        for c in cases()
        if c.half == options.half
        and (not options.world or world(c.category) in options.world)
        and (not options.category or c.category in options.category)
        and (not options.only or options.only in c.name)
    ]


def write(options: argparse.Namespace) -> None:
    """Write campaigns as folders, with answers.toml for all of them."""
    import tomlkit
    from independent.bank import write_case

    answers = {}
    for case in chosen(options)[: options.most]:
        began = time.process_time()
        answers[case.name] = write_case(case, options.folder / case.name, case.erring)
        print(f"{case.name}: {time.process_time() - began:.1f} s", flush=True)
        (options.folder / "answers.toml").write_text(tomlkit.dumps(answers))


def _groups(cases: list) -> list[list]:
    """Cases that share tests and machine together, at most _GROUP, all in an order of chance: a run that is stopped
    early is a fair sample.
    """

    from independent.campaign import Case

    def place(c) -> str:
        return json.dumps([c.machine, c.tests]) if isinstance(c, Case) else c.name

    out = []
    for _, members in groupby(sorted(cases, key=place), key=place):
        members = list(members)
        out += [members[i : i + _GROUP] for i in range(0, len(members), _GROUP)]
    random.Random(1).shuffle(out)
    return out


def _deaf() -> None:
    """Workers leave Ctrl-C to their parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _stop_by_keyboard(futures: list[Future]) -> None:
    """The first Ctrl-C keeps what has not begun from beginning, the second one ends at once."""

    def stop(*_) -> None:
        if [f for f in futures if not f.done() and f.cancel()]:
            print("stopping once the running groups are done; Ctrl-C again to stop at once", flush=True)
            return
        for process in multiprocessing.active_children():
            process.terminate()
        os._exit(1)

    signal.signal(signal.SIGINT, stop)


def _line(row: dict) -> str:
    """One line about a campaign: mark, name, what was said."""
    from diagnosis_page import said
    from diagnosis_score import score

    if "results" in row:
        return f"{row['name']}: " + "; ".join(f"{k} {len(r['effects'])} effects" for k, r in row["results"].items())
    s = score(row)
    return f"{s.mark:7s} {row['name']}: {said(s)}  {row.get('seconds', 0.0):.0f} s"


def _lines(file: Path) -> list[dict]:
    """Rows of a file."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def report(options: argparse.Namespace) -> None:
    """Write the page, its figure and its answers."""
    from diagnosis_page import NAME, page
    from diagnosis_score import score
    from independent import bank

    rows = [r for r in _lines(options.out) if r["half"] == options.half]
    missing = {c.name for c in bank.cases() if c.half == options.half} - {r["name"] for r in rows}
    if missing and options.half == "publish" and not options.publish:
        sys.exit(f"{options.out}: {len(missing)} campaigns of the published half have no answer; allowed: all answered")
    simple = [r for r in _lines(options.simple) if r["half"] == options.half] if options.simple else []
    lines = page([score(r) for r in rows], simple, options.remark, options.pages)
    (options.pages / f"{NAME}.md").write_text("\n".join(lines).rstrip() + "\n")
    for name, kept in ((NAME, rows), ("simple-methods", simple)):
        if kept:
            file = options.pages / "data" / f"{name}.jsonl.gz"
            file.parent.mkdir(exist_ok=True)
            file.write_bytes(gzip.compress("".join(json.dumps(r) + "\n" for r in kept).encode(), mtime=0))
            print(f"{len(kept)} answers in {file}")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=("run", "write", "report"))
    parser.add_argument("--half", choices=("tune", "publish"), help="default: publish for report, else tune")
    parser.add_argument("--world", nargs="*", choices=("ideal", "real", "wild"))
    parser.add_argument("--category", nargs="*")
    parser.add_argument("--only", help="campaigns whose name contains this")
    parser.add_argument("--most", type=int, help="at most so many campaigns")
    parser.add_argument("--publish", action="store_true", help="look into the published half: it is blind no more")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--timeout", type=float, default=3600.0, help="processor seconds of one campaign")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmark-diagnosis.jsonl")
    parser.add_argument("--folder", type=Path, default=ROOT / "bank", help="where write puts the campaigns")
    parser.add_argument("--simple", type=Path, help="file of the answers of two simple methods")
    parser.add_argument("--pages", type=Path, default=ROOT / "docs", help="folder of the page")
    parser.add_argument("--remark", default="", help="paragraphs for the page")
    options = parser.parse_args()
    options.half = options.half or ("publish" if options.action == "report" else "tune")
    {"run": run, "write": write, "report": report}[options.action](options)


if __name__ == "__main__":
    main()
