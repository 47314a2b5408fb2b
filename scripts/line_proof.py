#!/usr/bin/env python3
"""How often the 95 % intervals of a laser's findings hold: play and scale on one line, an angular error on two.

Each machine is made by the independent generator; its noise is 0.3 µm, at 9 targets in 3 runs from either side.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from independent import positions

import mjsim

LINE = {"name": "laser-x", "axis": "X", "ends": (0.0, 300.0), "count": 9, "runs": 3}
#: Errors of a machine, its tests, and what is to be found: effect, number, true value.
CASES = (
    (
        {"play": {"X": 6e-6}, "scale": {"X": 60e-6}},
        [LINE],
        (("backlash.X", "width_um", 6.0), ("scale_error.X", "ppm", 60.0)),
    ),
    (
        {"angle": {"EBX": (40e-6, 0.0)}},
        [LINE | {"line_mm": [0.0, 0.0, 200.0]}, LINE | {"name": "low"}],
        (("angular_error.EBX", "linear_urad", 40.0), ("angular_error.EBX", "quadratic_urad", 0.0)),
    ),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=16)
    count = parser.parse_args().machines
    found: dict[str, list[float]] = {}
    named = 0
    for seed in range(100, 100 + count):
        for errors, tests, wanted in CASES:
            with tempfile.TemporaryDirectory() as folder:
                positions.write(folder, seed, errors, tests, tolerance={"angular_error": {"urad": 12.0}})
                campaign = mjsim.read_campaign(folder)
                result = mjsim.diagnose(campaign, mjsim.read_machine(campaign.machine_file))
            named += {e.effect.id for e in result.effects} == {name for name, _, _ in wanted}
            for e in result.effects:
                for name, key, true in wanted:
                    if e.effect.id == name:
                        low, high = e.ci95[key]
                        found.setdefault(f"{name} {key}", []).append(
                            (e.effect.values[key] - true) / (high - low) * 3.92
                        )
    print(f"{named} of {2 * count} campaigns: what was planted was found and nothing else")
    for name, z in found.items():
        inside, rms = sum(abs(x) < 1.96 for x in z), float(np.sqrt(np.mean(np.square(z))))
        print(f"{name}: {inside} of {len(z)} inside the 95 % interval, z {rms:.2f} RMS")


if __name__ == "__main__":
    main()
