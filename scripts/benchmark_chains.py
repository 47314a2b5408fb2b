"""The diagnosis on machines with other chains: campaigns of the independent generator, one line a campaign.

Four families (BC trunnion, B head over C table, fork head, nutating table), ideal machines and real ones. Every third
campaign hides nothing. It goes on where it stopped: what OUT has is not made again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))
sys.path.insert(0, str(ROOT / "scripts"))


def cases(count: int, families: list[str]):
    """``count`` campaigns of each family on ideal machines, then as many on real ones."""
    from independent.chains import FAMILIES, ChainCase, causes

    for real in (False, True):
        for number in range(count):
            for family in families or FAMILIES:
                known = causes(family)
                hidden = () if number % 3 == 2 else (known[(number - number // 3) % len(known)],)
                name = f"{family}-{'real' if real else 'ideal'}-{number:02d}"
                yield ChainCase(name, family, 1000 * real + number, hidden, real)


def main() -> None:
    from diagnosis_report import mark
    from independent import chains
    from independent.chains import FAMILIES

    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import read_machine
    from mjsim.workflow.diagnose import diagnose

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="file of JSON lines")
    parser.add_argument("--count", type=int, default=40, help="campaigns of a family, ideal and real each")
    parser.add_argument("--family", action="append", default=[], help="one family only; repeatable")
    parser.add_argument("--most", type=int, default=10_000, help="new campaigns of this call")
    options = parser.parse_args()
    rows = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    done = {r["name"] for r in rows}
    for case in cases(options.count, options.family):
        if case.name in done or len(rows) - len(done) >= options.most:
            continue
        with tempfile.TemporaryDirectory() as folder:
            answer = chains.write(case, folder)
            campaign = read_campaign(folder)
            start = time.monotonic()
            result = diagnose(campaign, read_machine(campaign.machine_file)).to_json()
        row = {"name": case.name, "answer": answer, "seconds": time.monotonic() - start, "result": result}
        row["mark"] = mark(row)
        rows.append(row)
        with options.out.open("a") as file:
            file.write(json.dumps(row) + "\n")
        print(f"{case.name:32} {row['mark']:8} {row['seconds']:6.1f} s", flush=True)
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
