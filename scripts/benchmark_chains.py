"""The diagnosis on machines with other chains: campaigns of the independent generator, one line a campaign.

Four families (BC trunnion, B head over C table, fork head, nutating table), ideal machines and real ones. Every third
campaign hides nothing. Campaigns run side by side, one a core. It goes on where it stopped: what OUT has is not made
again.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import tempfile
import time
import traceback
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # one campaign per core; before numpy is imported, here and in the workers
ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
sys.path.insert(0, str(ROOT / "scripts"))


def cases(count: int, families: list[str]):
    """``count`` campaigns of each family on ideal machines and as many on real ones, in turns."""
    from independent.chains import FAMILIES, ChainCase, causes

    for number in range(count):
        for real in (False, True):
            for family in families or FAMILIES:
                known = causes(family)
                hidden = () if number % 3 == 2 else (known[(number - number // 3) % len(known)],)
                name = f"{family}-{'real' if real else 'ideal'}-{number:02d}"
                yield ChainCase(name, family, 1000 * real + number, hidden, real)


def answered(case) -> dict:
    """One campaign, written as files and answered as a user's. Seconds are those of the processor."""
    from diagnosis_report import mark
    from independent import chains

    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import read_machine
    from mjsim.workflow.diagnose import diagnose

    row = {"name": case.name}
    with tempfile.TemporaryDirectory() as folder:
        try:
            row["answer"] = chains.write(case, folder)
            start = time.process_time()
            campaign = read_campaign(folder)
            row["result"] = diagnose(campaign, read_machine(campaign.machine_file), threads=1).to_json()
            row["seconds"] = round(time.process_time() - start, 1)
        except Exception:  # a crash is a failure to report, not the end of the bank
            row |= {"error": traceback.format_exc(limit=-3), "seconds": 0.0}
    return row | {"mark": mark(row)}


def main() -> None:
    from independent.chains import FAMILIES

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="file of JSON lines")
    parser.add_argument("--count", type=int, default=40, help="campaigns of a family, ideal and real each")
    parser.add_argument("--family", action="append", default=[], help="one family only; repeatable")
    parser.add_argument("--most", type=int, default=10_000, help="new campaigns of this call")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="campaigns side by side")
    options = parser.parse_args()
    rows = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    done = {r["name"] for r in rows}
    new = [case for case in cases(options.count, options.family) if case.name not in done][: options.most]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context) as pool:
        for future in as_completed([pool.submit(answered, case) for case in new]):
            row = future.result()
            rows.append(row)
            with options.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(f"{row['name']:32} {row['mark']:8} {row['seconds']:6.1f} s", flush=True)
    print("| family | machines | campaigns | right | partly | missed | wrong | crash | median s |")
    print("|---|---|---|---|---|---|---|---|---|")
    for kind in ("ideal", "real"):
        for family in options.family or FAMILIES:
            mine = [r for r in rows if r["name"].startswith(f"{family}-{kind}-")]
            if not mine:
                continue
            marks = [r["mark"] for r in mine]
            counts = " | ".join(str(marks.count(m)) for m in ("right", "partly", "missed", "wrong", "crash"))
            seconds = sorted(r["seconds"] for r in mine)[len(mine) // 2]
            print(f"| {family} | {kind} | {len(mine)} | {counts} | {seconds:.0f} |")


if __name__ == "__main__":
    main()
