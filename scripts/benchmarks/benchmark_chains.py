"""The diagnosis on machines with other chains: campaigns of the independent generator, one line a campaign.

Four families (BC trunnion, B head over C table, fork head, nutating table), ideal machines and real ones. Six of twenty
campaigns hide nothing, two hide a cause that is in no catalogue, twelve hide one that is. Every campaign has draws of
its own. Real machines have data sheets drawn by chance, and limits in their machine file. Campaigns run side by side,
one a core. It goes on where it stopped: what OUT has is not made again.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # one campaign per core; before numpy is imported, here and in the workers
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "scripts" / "benchmarks")]


def cases(count: int, families: list[str]):
    """``count`` campaigns of each family on ideal machines and as many on real ones, in turns."""
    from independent.chain_campaigns import UNLISTED, ChainCase, causes
    from independent.chains import FAMILIES

    for number in range(count):
        for real in (False, True):
            for place, family in enumerate(families or FAMILIES):
                seed = 100_000 + 10_000 * real + 1000 * list(FAMILIES).index(family) + number
                drives = f"R{seed}" if real else ("M1", "M2", "M3", "M4", "M5")[(number + place) % 5]
                known = causes(family, drives)
                hidden: tuple = (known[(number - number // 3) % len(known)],)
                if number % 10 == 9:
                    hidden = (UNLISTED[(number // 10 + 2 * real) % len(UNLISTED)],)
                elif number % 3 == 2:
                    hidden = ()
                name = f"{family}-{'real' if real else 'ideal'}-{number:02d}"
                yield ChainCase(name, family, seed, hidden, real, drives=drives)


def answer_of(case) -> dict:
    """One campaign, written as files and answered as a user's."""
    from benchmark_diagnosis import answer, run_case
    from diagnosis_score import score

    row = run_case(case, partial(answer, heldout=case.real and not case.unlisted()), 3600.0)
    return row | {"mark": score(row).mark}


def named(s) -> list[bool]:
    """For every hidden cause of the catalogue: whether it was named, alone or with others that look like it."""
    from diagnosis_score import names_of

    said = {name for e in s.row["result"]["effects"] for name in names_of(e)}
    return [e["id"] in said for e in s.row["answer"]["effect"]]


def figures(rows: list[dict]) -> None:
    """Prints rates in the words of docs/diagnosis-benchmark.md, ideal and real machines apart."""
    from diagnosis_figures import counts, false_alarms, numbers_of, predicted, rate, recognised, right_axis, wrong_names
    from diagnosis_score import score

    table = (
        ("false alarms on sound machines", false_alarms),
        ("hidden causes named", named),
        ("campaigns with a wrong confident name, of the others", wrong_names),
        ("causes outside the catalogue recognised", recognised),
        ("... on the right axis", right_axis),
        ("95 % intervals that hold the truth", numbers_of),
        ("0.95 or more of the error of other tests predicted", predicted),
    )
    parts = [[score(r) for r in rows if f"-{kind}-" in r["name"]] for kind in ("ideal", "real")]
    print("\n| | ideal machines | real machines |\n|---|---|---|")
    for title, figure in table:
        print(f"| {title} | {' | '.join(rate(*counts(figure, part)) for part in parts)} |")


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
        for future in as_completed([pool.submit(answer_of, case) for case in new]):
            row = future.result()
            rows.append(row)
            with options.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(f"{row['name']:32} {row['mark']:8} {row.get('seconds', 0.0):6.1f} s", flush=True)
    print("| family | machines | campaigns | right | partly | missed | wrong | crash | median s |")
    print("|---|---|---|---|---|---|---|---|---|")
    for kind in ("ideal", "real"):
        for family in options.family or FAMILIES:
            mine = [r for r in rows if r["name"].startswith(f"{family}-{kind}-")]
            if not mine:
                continue
            marks = [r["mark"] for r in mine]
            counts = " | ".join(str(marks.count(m)) for m in ("right", "partly", "missed", "wrong", "crash"))
            seconds = sorted(r.get("seconds", 0.0) for r in mine)[len(mine) // 2]
            print(f"| {family} | {kind} | {len(mine)} | {counts} | {seconds:.0f} |")
    figures(rows)


if __name__ == "__main__":
    main()
