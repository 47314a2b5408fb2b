"""The geometry of real machines from campaigns of the independent generator: how often the 95 % intervals hold.

Every machine of the four families is a little wrong everywhere, within the limits of its class. One line a campaign in
OUT; what OUT has is not made again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))


def one(family: str, seed: int) -> dict:
    """The numbers of one machine: true value, estimate, half width of the interval, whether it is determined."""
    from independent.chains import ChainCase, write

    from mjsim.campaign.files import read_campaign
    from mjsim.campaign.machine_file import read_machine
    from mjsim.commands.geometry import geometry

    case = ChainCase(f"{family}-{seed}", family, 7000 + seed, (), True)
    _, effects = case.true()
    with tempfile.TemporaryDirectory() as folder:
        write(case, folder)
        campaign = read_campaign(folder)
        found = geometry(campaign, read_machine(campaign.machine_file))
    numbers = {n.id: [effects[n.id][n.parameter], n.value, n.half_width, n.determined] for n in found.numbers}
    return {"name": case.name, "family": family, "ratio": found.ratio, "numbers": numbers}


def main() -> None:
    from independent.chains import FAMILIES

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="file of JSON lines")
    parser.add_argument("--count", type=int, default=10, help="machines of a family")
    options = parser.parse_args()
    rows = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    done = {r["name"] for r in rows}
    for seed in range(options.count):
        for family in FAMILIES:
            if f"{family}-{seed}" in done:
                continue
            rows.append(one(family, seed))
            with options.out.open("a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print(
        "| family | machines | numbers | in their 95 % interval | determined | median half width of location errors |"
    )
    print("|---|---|---|---|---|---|")
    for family in FAMILIES:
        mine = [r["numbers"] for r in rows if r["family"] == family]
        all_ = [n for numbers in mine for n in numbers.values()]
        inside = sum(abs(value - true) <= half for true, value, half, _ in all_)
        halves = {
            unit: sorted(n[2] for numbers in mine for name, n in numbers.items() if name.split(".")[1][:2] in kinds)
            for unit, kinds in (("µm", ("EX", "EY", "EZ")), ("µrad", ("EA", "EB", "EC")))
        }
        width = ", ".join(f"{values[len(values) // 2]:.1f} {unit}" for unit, values in halves.items() if values)
        known = sum(n[3] for n in all_)
        print(
            f"| {family} | {len(mine)} | {len(all_)} | {inside / len(all_):.0%} | {known / len(all_):.0%} | {width} |"
        )


if __name__ == "__main__":
    main()
