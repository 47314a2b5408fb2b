"""Machines that warm up while they are probed: whether a drift is given to the sensor that it follows.

Run it with the project's Python. The independent
generator plants a number of µm/K on one axis for one of three sensors, or a drift that follows none of them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
from independent import warming

import mjsim
from mjsim.campaign.machine_file import machine_of

#: Standard deviation of what is planted, µm/K; size and first period of a drift that follows no sensor, µm and s.
PLANTED, DRIFT, PERIOD = 5.0, 8.0, 2500.0


def found_in(folder: Path) -> tuple[str, dict[str, dict]]:
    """The verdict, and findings that follow a sensor, by key, as in the JSON."""
    campaign = mjsim.read_campaign(folder)
    result = mjsim.diagnose(campaign, machine_of(campaign))
    said = {e.effect.key: e.to_json(result.machine) for e in result.effects}
    return result.verdict, {key: row for key, row in said.items() if key.startswith("thermal_expansion")}


def planted_one(folder: Path, seed: int) -> tuple[str, float]:
    """Writes a machine that follows one sensor; its key and its size in µm/K."""
    rng = np.random.default_rng([seed, 5])
    axis, sensor = str(rng.choice(list("XYZ"))), str(rng.choice(["spindle", "bed", "room"]))
    size = float(rng.normal(0.0, PLANTED))
    warming.write_sphere(folder, seed, {(axis, sensor): size})
    return f"thermal_expansion.{axis}[{sensor}]", size


def planted_none(folder: Path, seed: int) -> None:
    """Writes a machine that goes up and down by itself."""
    period = PERIOD + 37.0 * seed
    warming.write_sphere(folder, seed, {}, drift={"Z": lambda t: DRIFT * np.sin(2.0 * np.pi * t / period + seed)})


def main() -> None:
    """Print how many were right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=20, help="of each kind")
    count = parser.parse_args().machines
    right, inside, wrong, missed, given, unknown = 0, 0, 0, [], 0, 0
    for seed in range(count):
        with tempfile.TemporaryDirectory() as scratch:
            key, size = planted_one(Path(scratch), seed)
            _, found = found_in(Path(scratch))
            wrong += len(set(found) - {key})
            if key not in found:
                missed.append(size)
                continue
            low, high = found[key]["ci95"]["expansion_um_per_K"]
            right += 1
            inside += low <= size <= high
    for seed in range(count):
        with tempfile.TemporaryDirectory() as scratch:
            planted_none(Path(scratch), seed)
            verdict, found = found_in(Path(scratch))
            given += bool(found)
            unknown += verdict == "unknown"
    sizes = ", ".join(f"{s:.1f}" for s in missed)
    print(f"{count} machines follow a sensor: {right} were given to it, {inside} of their 95 % intervals hold")
    print(f"not named: {sizes or 'none'} µm/K; given to another sensor: {wrong}")
    print(f"{count} machines drift by themselves: {given} were given to a sensor, {unknown} called unknown")


if __name__ == "__main__":
    main()
