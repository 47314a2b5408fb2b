#!/usr/bin/env python3
"""How often are mistakes of the user recognised, and how often is a right campaign called wrong?

    benchmark_mistakes.py [--half tune|publish] [--every N] [--planted NAME] [--jobs N] [--page docs/mistakes.md]

Every N-th campaign of the independent generator (healthy and faulty machines; answers known) is looked at as it is, and
then once with each mistake in it: signs and units of all traces or of one, directions of all tests or of one, two
traces exchanged, a rotary axis with the other sense in the machine file.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import zlib
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is imported
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests")]

#: What is multiplied with in the files: a reading of 1 µm becomes this many of the unit.
FACTORS = {"sign": -1.0, "mm": 1e-3, "mil": 1 / 25.4, "inch": 1 / 25.4e3, "microinch": 1 / 25.4e-3}
#: The table stands behind this line of the page.
MARK = "<!-- scripts/benchmarks/benchmark_mistakes.py -->"
PLANTED = [f"{who}: {what}" for who in ("all", "one") for what in (*FACTORS, "direction")] + [
    "two: swapped",
    "axis: sense",
]


def spoil(campaign, planted: str, rng):
    """The campaign with a mistake in it, and the tests that have it; ``None`` where it cannot have that one."""
    import numpy as np

    from mjsim.instruments.ball_bar.measurement import Trace

    who, what = planted.split(": ")
    names = [t.name for t in campaign.measured]
    if what == "swapped":
        spans = {t.name: round(float(np.ptp(campaign.traces[t.name].time)), 1) for t in campaign.measured}
        pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :] if abs(spans[a] - spans[b]) < 0.3]
        if not pairs:
            return None
        a, b = pairs[rng.integers(len(pairs))]
        traces = {**campaign.traces, a: campaign.traces[b], b: campaign.traces[a]}
        return replace(campaign, traces=traces), {a, b}
    if what == "direction":
        names = [t.name for t in campaign.measured if t.kind != "rotary"]
        chosen = set(names if who == "all" else [names[rng.integers(len(names))]])
        other = {"CW": "CCW", "CCW": "CW"}
        tests = tuple(replace(t, direction=other[t.direction]) if t.name in chosen else t for t in campaign.tests)
        return replace(campaign, tests=tests), chosen
    chosen = set(names if who == "all" else [names[rng.integers(len(names))]])
    limit = campaign.instrument.range
    traces = dict(campaign.traces)
    for name in chosen:
        t = traces[name]
        value = FACTORS[what] * t.deviation
        inside = np.abs(value) < limit
        traces[name] = Trace(t.time, np.where(inside, value, 0.0), t.valid & inside)
    if any(traces[n].valid.sum() < 50 for n in chosen):
        return None
    return replace(campaign, traces=traces), chosen


def run(case, kinds: list[str]) -> list[tuple[str, str, str]]:
    """(campaign, planted, outcome) for one campaign as it is and with every mistake of ``kinds``."""
    import numpy as np
    from independent import bank

    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import read_machine
    from mjsim.inference.mistakes.recognise import recognise

    rng = np.random.default_rng(zlib.crc32(case.name.encode()))
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        bank.write_case(case, Path(folder))
        campaign = read_campaign(folder)
        machine = read_machine(campaign.machine_file)
    found = recognise(campaign, machine, 1).mistakes
    rows.append((case.name, "nothing", "none" if not found else "ALARM " + "; ".join(m.sentence for m in found)))
    for planted in kinds:
        if planted == "axis: sense":
            spoiled = with_wrong_sense(campaign, machine, rng)
        else:
            plain = spoil(campaign, planted, rng)
            spoiled = plain and (plain[0], machine, plain[1])
        if spoiled is None:
            continue
        found = recognise(spoiled[0], spoiled[1], 1).mistakes
        rows.append((case.name, planted, judge(planted, spoiled[2], found)))
    return rows


def with_wrong_sense(campaign, machine, rng):
    """Campaign and machine whose file has the other sense of a rotary axis that some test turns by its positions, and
    these tests; ``None`` where there is none.
    """
    from mjsim.inference.mistakes.sense import with_other_sense

    turned = {t.name: t.axis for t in campaign.measured if t.kind == "rotary"}
    if not turned:
        return None
    axes = sorted(set(turned.values()))
    axis = axes[rng.integers(len(axes))]
    other = with_other_sense(machine, axis)
    tests = tuple(replace(t, chain=other.chain) for t in campaign.tests)
    return replace(campaign, tests=tests), other, {name for name, a in turned.items() if a == axis}


def judge(planted: str, chosen: set[str], found) -> str:
    """right, none, or WRONG with what was said instead."""
    if not found:
        return "none"
    what = planted.split(": ")[1]
    said = {n for m in found for n in m.tests}
    kinds = {m.unit or m.kind for m in found}
    same = kinds == {what} or {what, *kinds} <= {"swapped", "direction"}
    if same and any(m.either for m in found):
        return "either" if said >= chosen else "WRONG either " + str(said)
    if same and said == chosen:
        return "right"
    if same and said < chosen:
        return "part"
    return "WRONG " + "; ".join(m.sentence for m in found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--half", choices=("tune", "publish"), default="tune")
    parser.add_argument("--every", type=int, default=10, help="take every N-th campaign (default 10)")
    parser.add_argument("--planted", nargs="*", default=PLANTED, help="what is planted; nothing: only false alarms")
    parser.add_argument("--worlds", nargs="*", default=["ideal", "real", "wild"], help="worlds of campaigns")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--page", type=Path, help="write the table there")
    options = parser.parse_args()
    from independent import bank

    cases = [c for c in bank.cases() if c.half == options.half and bank.world(c.category) in options.worlds]
    cases = cases[:: options.every]
    count: Counter = Counter()
    kinds = options.planted
    with ProcessPoolExecutor(options.jobs) as pool:
        for rows in pool.map(run, cases, [kinds] * len(cases)):
            for name, planted, outcome in rows:
                count[planted, outcome.split()[0]] += 1
                if outcome not in ("right", "none", "part", "either"):
                    print(f"{name} [{planted}]: {outcome}", file=sys.stderr, flush=True)
    lines = [
        "| mistake | campaigns | named | one of two tests | for some of the tests | not noticed | named wrongly |",
        "|---|---|---|---|---|---|---|",
    ]
    for planted in ["nothing", *kinds]:
        n = {o: count[planted, o] for o in ("right", "either", "part", "none", "WRONG", "ALARM")}
        named = "–" if planted == "nothing" else n["right"]
        lines.append(
            f"| {planted} | {sum(n.values())} | {named} | {n['either']} | {n['part']} | {n['none']} | "
            f"{n['WRONG'] + n['ALARM']} |"
        )
    text = "\n".join(lines) + "\n"
    print(text)
    if options.page:
        head, mark, _ = options.page.read_text().partition(MARK)
        options.page.write_text(f"{head}{mark}\n\n{text}\n{len(cases)} campaigns of the {options.half} half.\n")


if __name__ == "__main__":
    main()
