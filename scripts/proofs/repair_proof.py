"""How much of the error goes when blind machines are compensated with what mjsim wrote, and whether the forecast holds.

Machines of the independent generator are diagnosed and compensated. The generator then reads the files with its own
readers, applies them with its own arithmetic, and runs its own machine. Results are kept per machine: a second run
continues where the first one stopped.

    scripts/proofs/repair_proof.py run FOLDER --kind faulty --count 30 [--control sinumerik]
    scripts/proofs/repair_proof.py report FOLDER
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from independent import bank, controls, drives, transmission  # noqa: E402
from independent.campaign import Case, _true, write  # noqa: E402
from independent.kinematics import MICRO, bar_reading  # noqa: E402
from independent.programs import Program  # noqa: E402
from independent.simulate import grid  # noqa: E402

from mjsim.campaign.files import read_campaign  # noqa: E402
from mjsim.campaign.machine_file import read_machine  # noqa: E402
from mjsim.compensation.compensate import compensate, write_compensation  # noqa: E402

#: Kinds that a control can correct, by what its files can take.
COMPENSABLE = (
    "backlash",
    "pitch_error",
    "worm_wear",
    "scale_error",
    "gravity_windup",
    "straightness",
    "squareness",
    "axis_location",
    "servo_gain",
)
#: A table has no number for the direction of a rotary axis, or none of one axis by another, in these controls.
LACKS = {
    "linuxcnc": (
        "straightness",
        "squareness",
        "servo_gain",
        "axis_location.EA",
        "axis_location.EB",
        "axis_location.EC",
    ),
    "fanuc": ("axis_location.EA", "axis_location.EB", "axis_location.EC"),
}


def machines(kind: str) -> list[Case]:
    """Machines of one kind: ``faulty`` ones have a cause that matters among the small errors, ``sound`` ones do not."""
    return [replace(c, tolerance_stated=True) for c in bank.real() if c.category == f"real-{kind}"]


def reading(case: Case, test: dict, effects: dict, drive: dict, told: controls.Told | None) -> np.ndarray:
    """Noise-free reading about the set-up over the measured part, (n,) m."""
    program = Program(test)
    instants = grid(program)
    driven = program if told is None else controls.Corrected(program, told)
    drive = {a: dict(d) for a, d in drive.items()}
    for axis, gain in (told.gain if told else {}).items():
        printed = json_machine(case)["drive"][axis]["position_gain_per_s"]
        drive[axis]["position_gain_per_s"] *= gain / printed
    motor, _ = drives.run(drive, effects, driven, instants)
    load = transmission.load_side(motor, test["started_s"] + instants, drive, effects)
    low, high = program.window
    part = slice(int(np.ceil(low / drives.GRID)), int(high / drives.GRID), 5)
    at = np.ascontiguousarray(load[part])
    bar = bar_reading(at, program.ball, program.length, effects)
    ideal = program.commands(instants[part])
    columns = [np.ones(len(at))]
    for k in range(3):  # what the places of both balls and the bar's length can make
        off = 1e-6 * np.eye(3)[k]
        for ball, spindle in ((off, 0.0 * off), (0.0 * off, off)):
            ends = [bar_reading(ideal, program.ball + w * ball, program.length, {}, w * spindle) for w in (1.0, -1.0)]
            columns.append((ends[0] - ends[1]) / 2e-6)
    matrix = np.column_stack(columns)
    return bar - matrix @ np.linalg.lstsq(matrix, bar, rcond=1e-6)[0]


def json_machine(case: Case) -> dict:
    from independent.machines import nominal

    return nominal(case.machine)


def prove(case: Case, folder: Path, control: str) -> dict:
    """Diagnose, compensate, and run the corrected machine."""
    began = time.process_time()
    case = case.resolved()
    write(case, folder)
    c = read_campaign(folder)
    m = read_machine(c.machine_file)
    result = compensate(c, m, control, threads=1)
    spent = time.process_time() - began
    write_compensation(result, folder / "corrections", force=True)
    told = controls.READERS[control](folder / "corrections")
    drive, effects = _true(case)
    lacks = LACKS.get(control, ())
    perfect = {
        k: v for k, v in effects.items() if k.split(".")[0] not in COMPENSABLE or any(k.startswith(x) for x in lacks)
    }
    sums = np.zeros(3)
    count = 0
    tests = []
    for test in case.tests:
        if case.unlisted():
            raise ValueError("machines with an unlisted cause are not part of this")
        r = [
            reading(case, test, effects, drive, None),
            reading(case, test, effects, drive, told),
            reading(case, test, perfect, drive, None),
        ]
        sums += [float(x @ x) for x in r]
        count += len(r[0])
        tests.append([float(np.sqrt(np.mean(x * x)) / MICRO) for x in r])
    before, after, best = np.sqrt(sums / count) / MICRO
    said = [x * 1e6 for x in result.forecast.rms()]
    return {
        "name": case.name,
        "control": control,
        "before_um": before,
        "after_um": after,
        "perfect_um": best,
        "gone": (before**2 - after**2) / (before**2 - best**2),
        "forecast_um": said[1],
        "forecast_before_um": said[0],
        "forecast_error": said[1] / after - 1.0,
        "tests": tests,
        "forecast_tests": [[x * 1e6 for x in t.rms()] for t in result.forecast.tests],
        "left": [x.key for x in result.corrections.left],
        "corrects": list(result.corrected),
        "cpu_s": spent,
    }


def run(folder: Path, kind: str, count: int, control: str) -> None:
    for case in machines(kind)[:count]:
        out = folder / f"{control}-{case.name}.json"
        if out.exists():
            continue
        out.parent.mkdir(parents=True, exist_ok=True)
        row = prove(case, folder / "campaigns" / f"{control}-{case.name}", control)
        out.write_text(json.dumps({**row, "kind": kind}))
        print(
            f"{case.name}: {row['before_um']:.2f} -> {row['after_um']:.2f} µm (perfect {row['perfect_um']:.2f}), "
            f"{100 * row['gone']:.1f} % gone, forecast {row['forecast_um']:.2f} µm, {row['cpu_s']:.0f} s",
            flush=True,
        )


def report(folder: Path) -> None:
    rows = [json.loads(f.read_text()) for f in sorted(folder.glob("*.json"))]
    for control in sorted({r["control"] for r in rows}):
        faulty = [r for r in rows if r["control"] == control and r["kind"] == "faulty"]
        sound = [r for r in rows if r["control"] == control and r["kind"] == "sound"]
        if faulty:
            gone = np.array([r["gone"] for r in faulty])
            off = np.abs([r["forecast_error"] for r in faulty])
            print(
                f"{control}: {len(faulty)} faulty machines: median {100 * np.median(gone):.1f} % of the compensable "
                f"squared error gone (lowest {100 * gone.min():.1f} %)"
            )
            print(
                f"    forecast within 10 % for {int((off <= 0.1).sum())} of {len(off)}, median off by "
                f"{100 * np.median(off):.1f} %, at most {100 * off.max():.1f} %"
            )
        if sound:
            worse = np.array([r["after_um"] / r["before_um"] - 1.0 for r in sound])
            off = np.abs([r["forecast_error"] for r in sound])
            print(
                f"{control}: {len(sound)} sound machines: {int((worse > 0.02).sum())} worse by more than 2 % "
                f"(worst {100 * worse.max():+.1f} %), median {100 * np.median(worse):+.1f} %; forecast within 10 % for "
                f"{int((off <= 0.1).sum())}, median off by {100 * np.median(off):.1f} %"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=("run", "report"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kind", choices=("faulty", "sound"), default="faulty")
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--control", choices=tuple(controls.READERS), default="sinumerik")
    a = parser.parse_args()
    report(a.folder) if a.action == "report" else run(a.folder, a.kind, a.count, a.control)


if __name__ == "__main__":
    main()
