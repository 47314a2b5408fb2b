"""Machines that warm up while they are measured, and the file of their temperatures.

A spindle is heated while it turns and cools towards the room, a bed follows the room slowly, and the room itself drifts
over the day: three bodies of one time constant each, integrated in steps of a second. What the machine makes of it is
the sum of every temperature's rise since the clock's zero times a number of its axis.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from . import campaign, layouts, positions, sphere

STEP = 1.0
#: Time constants of spindle and bed, s; heating of the spindle, K above the room where it never stops.
SPINDLE, BED, HEATED = 900.0, 4000.0, 9.0


def histories(seed: int, duration: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Instants, s, and true temperatures of spindle, bed and room, °C.

    The spindle runs for drawn spells with pauses between. The room rises and falls within hours.
    """
    rng = np.random.default_rng([seed, 77])
    time = np.arange(0.0, duration + STEP, STEP)
    runs, at = np.zeros(len(time)), 0.0
    while at < duration:
        on, off = rng.uniform(300.0, 1200.0), rng.uniform(200.0, 900.0)
        runs[(time >= at) & (time < at + on)] = 1.0
        at += on + off
    period, phase = rng.uniform(5000.0, 9000.0), rng.uniform(0.0, 2.0 * np.pi)
    room = 21.0 + 1.2 * np.sin(2.0 * np.pi * time / period + phase)
    spindle, bed = np.empty_like(time), np.empty_like(time)
    spindle[0], bed[0] = room[0] + 0.5, room[0] - 0.3
    for i in range(1, len(time)):
        spindle[i] = spindle[i - 1] + STEP / SPINDLE * (room[i - 1] + HEATED * runs[i - 1] - spindle[i - 1])
        bed[i] = bed[i - 1] + STEP / BED * (room[i - 1] - bed[i - 1])
    return time, {"spindle": spindle, "bed": bed, "room": room}


def write_record(
    folder: Path | str,
    time: np.ndarray,
    true: dict[str, np.ndarray],
    seed: int = 0,
    every: float = 30.0,
    noise: float = 0.02,
    resolution: float = 0.01,
) -> None:
    """Writes temperature.csv: a sample ``every`` s of each sensor, with noise and resolution in K."""
    rng = np.random.default_rng([seed, 78])
    kept = slice(None, None, round(every / STEP))
    shown = [
        np.round((t[kept] + rng.normal(0.0, noise, len(t[kept]))) / resolution) * resolution for t in true.values()
    ]
    rows = [",".join([f"{t:.0f}", *(f"{v:.2f}" for v in row)]) for t, *row in zip(time[kept], *shown, strict=True)]
    Path(folder, "temperature.csv").write_text("\n".join([",".join(["time_s", *true]), *rows, ""]))


def moved(true: dict[str, np.ndarray], planted: dict[tuple[str, str], float]) -> dict[str, np.ndarray]:
    """Displacement of every axis, µm, at the instants of the temperatures.

    Args:
        true: Temperatures by sensor.
        planted: µm/K by axis and sensor.
    """
    out: dict[str, np.ndarray] = {}
    for (axis, sensor), size in planted.items():
        out[axis] = out.get(axis, 0.0) + size * (true[sensor] - true[sensor][0])
    return out


def spread(tests: list[dict], gap: float) -> list[dict]:
    """Tests that begin so many seconds later than in their layout, one after another: the machine works between."""
    return [t | {"started_s": t["started_s"] + gap * i} for i, t in enumerate(tests)]


def write_bar(
    folder: Path | str,
    seed: int,
    planted: dict[tuple[str, str], float],
    layout: str = "short",
    gap: float = 400.0,
    drift: dict[str, np.ndarray] | None = None,
    within: tuple[dict, ...] = (),
) -> None:
    """A ball-bar campaign with its temperatures.

    Args:
        folder: Made where it is not there.
        seed: Of everything that is drawn.
        planted: As for :func:`moved`.
        layout: Of :mod:`.layouts`.
        gap: As for :func:`spread`.
        drift: Further displacements by axis, µm at every second, that no temperature explains.
        within: Small errors of the machine, tables as in machine.toml.
    """
    tests = spread(layouts.layout(layout), gap)
    time, true = histories(seed, tests[-1]["started_s"] + 300.0)
    sums = moved(true, planted)
    for axis, more in (drift or {}).items():
        sums[axis] = sums.get(axis, 0.0) + np.interp(time, STEP * np.arange(len(more)), more)
    hidden = tuple({"id": f"drift.{a}", "clock_s": time[::10], "um": um[::10]} for a, um in sums.items())
    case = campaign.Case("warm", "M1", tuple(tests), hidden, seed=seed, within=within, tolerance_stated=bool(within))
    campaign.write_files(case, folder)
    write_record(folder, time, true, seed)


def write_sphere(
    folder: Path | str,
    seed: int,
    planted: dict[tuple[str, str], float],
    minutes: float = 3.0,
    drift: dict | None = None,
    **how,
) -> dict:
    """A probed sphere with its temperatures: a point every so many minutes. Returns the true errors of the machine.

    ``drift`` are further displacements by axis, µm as a function of the time in s, that no temperature explains.
    """
    errors = sphere.write(folder, seed, **how)
    file = Path(folder, "traces", "points.csv")
    head, *rows = file.read_text().splitlines()
    clock = 60.0 * minutes * np.arange(len(rows))
    time, true = histories(seed, clock[-1] + 300.0)
    sums, names, out = moved(true, planted), head.split(","), []
    for axis, more in (drift or {}).items():
        sums[axis] = sums.get(axis, 0.0) + more(time)
    for at, row in zip(clock, rows, strict=True):
        cells = row.split(",")
        for axis, um in sums.items():  # where the tool has gone too far, the machine stops that much before
            k = names.index(f"d{axis.lower()}_um")
            cells[k] = f"{float(cells[k]) - np.interp(at, time, um):.4f}"
        out.append(",".join([*cells, f"{at:.0f}"]))
    file.write_text("\n".join([f"{head},time_s", *out, ""]))
    write_record(folder, time, true, seed)
    return errors


def write_positions(folder: Path | str, seed: int, planted: dict[tuple[str, str], float], errors: dict, **how) -> None:
    """A laser along X whose readings take two hours, with the temperatures."""
    time, true = histories(seed, 9000.0)
    sums = moved(true, planted)
    drift = {a: (lambda clock, um=um: 1e-6 * np.interp(clock, time, um)) for a, um in sums.items()}
    test = {"name": "laser-x", "axis": "X", "ends": (-100.0, 100.0), "count": 11, "pause_s": 60.0}
    positions.write(folder, seed, errors, [test | {"drift": drift["X"]}], **how)
    write_record(folder, time, true, seed)
