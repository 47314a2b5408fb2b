"""Many cases of the fuzz tests, and a table of what was tried; see ``scripts/fuzz``."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OUTCOMES = ("refused", "usage", "accepted")


def main(words: list[str]) -> int:
    """Run, and print a row per reader and command; 1 where a property failed, 2 for wrong words."""
    try:
        factor, *seeds = [int(w) for w in words] or [20]
        if factor < 1:
            raise ValueError
    except ValueError:
        print("fuzz: whole numbers: FACTOR above 0, then seeds", file=sys.stderr)
        return 2
    seeds = seeds or [int(time.time())]
    tally: Counter = Counter()
    found = 0
    begun = time.monotonic()
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            table = Path(folder) / "tally"
            env = {**os.environ, "MJSIM_FUZZ": str(factor), "MJSIM_FUZZ_TABLE": str(table)}
            call = [sys.executable, "-m", "pytest", "-q", "-n", "2", "--dist=load", f"--hypothesis-seed={seed}", "tests"]
            run = subprocess.run([*call, "-k", "test_fuzz"], cwd=ROOT, env=env)
            found += run.returncode != 0
            for line in table.read_text().splitlines() if table.exists() else ():
                what, outcome, count = json.loads(line)
                tally[what, outcome] += count
    names = sorted({what for what, _ in tally})
    width = max(map(len, names), default=4)
    print(f"\n{'':{width}} {'cases':>8}" + "".join(f" {o:>9}" for o in OUTCOMES))
    for name in [*names, "all"]:
        row = [sum(n for (what, o), n in tally.items() if o == outcome and name in (what, "all")) for outcome in OUTCOMES]
        print(f"{name:{width}} {sum(row):8}" + "".join(f" {n:9}" for n in row))
    where = "no finding" if not found else f"FINDINGS with {found} of {len(seeds)} seeds: see above"
    print(f"\nfactor {factor}, seeds {' '.join(map(str, seeds))}, {time.monotonic() - begun:.0f} s: {where}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
