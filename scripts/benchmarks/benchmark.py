"""How fast mjsim is: one table with what was measured, the target, and the ratio to a bare MuJoCo rollout of the same
number of steps.

    benchmark.py                    everything, some five minutes on two cores
    benchmark.py --only simulate    one part: simulate, commands, memory or growth (may be repeated)
    benchmark.py --write            also docs/speed.md and its picture

The bare rollout is `mujoco.rollout` with the shipped machine's model and the same number of 1 ms steps, without drives,
effects, commands and files, on one core, timed in the same run. Other work on the machine makes everything slower, and
the ratios less.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

# one core for what is timed in this process, before numpy is imported; the commands get all
os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

import mujoco
import numpy as np
from benchmark_commands import commands, growth, memory
from benchmark_page import Row, header, table, write_page
from mujoco import rollout

from mjsim.campaign.machine_file import read_machine
from mjsim.effects import registry
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.io.resources import examples
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.simulation import callback, mjmodel
from mjsim.simulation.drive import STEP, SUBSTEPS
from mjsim.simulation.multibody import prepare, simulate

ROOT = Path(__file__).resolve().parents[2]
PARTS = ("simulate", "commands", "memory", "growth")
#: Times real time on one core.
TARGET = 150.0
DEG = math.pi / 180.0
#: θ = 15°, β = 10°, two turns at 1000 mm/min: 74.9 s.
TEST = BallBarTest(
    "cone15",
    "cone_frustum",
    table_ball=(0.05, 0.02, 0.155),
    length=0.1,
    feed=1.0 / 60.0,
    half_apex=15 * DEG,
    inclination=10 * DEG,
    revolutions=2,
)


def with_every_effect(machine: Machine) -> Machine:
    """Every kind and subject of the catalogue at a typical size, elastic transmissions and sticking friction
    included.
    """
    for effect_id in registry.all_ids(sensors=False):
        present = machine.effect(effect_id)
        if present is not None:
            machine = machine.with_effect(present.replaced(static_ratio=1.2)) if present.kind == "friction" else machine
            continue
        cls, subject = registry.effect_class(effect_id)
        values = {}
        for p in cls.parameters_of(subject):
            if p.kind == "components":
                values[p.name] = [[72.0, p.scale, 30.0], [360.0, 0.3 * p.scale, 0.0]]
            elif p.inverse:
                values[p.name] = 3.0 * p.scale
            elif p.kind == "number" and p.neutral is not None:
                values[p.name] = min(p.upper, p.neutral + p.scale)
            elif p.kind == "number" and p.default is None:
                values[p.name] = min(p.upper, max(p.lower, 3.0 * p.scale))
        effect = cls(subject, **values)
        if effect.is_neutral:
            raise SystemExit(f"{effect_id} is neutral at {values}: the benchmark would leave it out")
        machine = machine.with_effect(effect)
    return machine


def timed(action: Callable[[], object]) -> tuple[float, float]:
    """Seconds that ``action`` takes, and seconds of processor time."""
    start, processor = time.perf_counter(), time.process_time()
    action()
    return time.perf_counter() - start, time.process_time() - processor


def steps_of(plant: Plant) -> tuple[Callable[[], object], Callable[[], object], int]:
    """Functions that run the test's MuJoCo steps with and without the callback, and the number of steps."""
    _, grid, _, sent, model, data = prepare(mjmodel.build_model(plant), plant, TEST, STEP)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, initial, full)
    control = np.vstack([sent[1:], sent[-1:]])

    def steps() -> None:
        rollout.rollout(model, data, initial[None], control[None])

    def driven() -> None:
        with callback.installed():
            steps()

    return driven, steps, len(grid)


def bare_step(machine: Machine, repeats: int = 5) -> float:
    """Seconds per step of a bare rollout of ``machine``, on one core."""
    _, steps, n = steps_of(build(machine))
    return statistics.median(timed(steps)[0] for _ in range(repeats)) / n


def simulation(machine: Machine, repeats: int) -> list[Row]:
    """One test of 75 s on one core: as a user calls it, and its MuJoCo steps alone."""
    rows = []
    for title, m in (("friction only", machine), ("every effect", with_every_effect(machine))):
        plant = build(m)
        driven, bare, n = steps_of(plant)

        def whole(m: Machine = m) -> None:
            simulate(m, [TEST], threads=1)

        for warm_up in (whole, driven, bare):
            warm_up()
        times = [(timed(whole), timed(driven), timed(bare)) for _ in range(repeats)]
        (total, alone), (with_callback, _), (without, _) = (
            [statistics.median(kind) for kind in zip(*t, strict=True)] for t in zip(*times, strict=True)
        )
        ratios = [statistics.median(t[i][0] / t[2][0] for t in times) for i in (0, 1)]
        duration = (n - 1) * STEP
        what = f"{title} ({len(m.effects)} effects, {len(plant.ops)} transmission operations)"
        measured = f"{total:.3f} s ({alone:.3f} s of processor time), {duration / total:.0f} times real time"
        goal = duration / TARGET
        limit = f"{goal:.2f} s, {TARGET:.0f} times"
        rows += [
            Row(
                f"simulate a {duration:.0f} s test, one core: {what}",
                measured,
                limit,
                ratios[0],
                total <= goal,
                alone <= goal,
            ),
            Row("  its MuJoCo steps", f"{with_callback:.3f} s, {with_callback / n * 1e6:.2f} µs a step", "", ratios[1]),
            Row("  bare rollout of that model", f"{without:.3f} s, {without / n * 1e6:.2f} µs a step", "", 1.0),
        ]
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=PARTS, help="this part (may be repeated)")
    parser.add_argument("--repeats", type=int, default=9, help="how often a simulation is timed (default 9)")
    parser.add_argument(
        "--write", action="store_true", help="write docs/speed.md and docs/images/speed.png; needs all parts"
    )
    options = parser.parse_args()
    wanted = options.only or PARTS
    if options.write and set(wanted) != set(PARTS):
        parser.error("--write needs all parts: leave --only out")
    machine = read_machine(examples() / "hidden-backlash" / "machine.toml")
    head = header(f"step {STEP * 1e3:g} ms, {SUBSTEPS} drive sub-steps")
    print(head, flush=True)
    bare = bare_step(machine)
    rows, curves = [], []
    work: dict[str, Callable[[], tuple[list[Row], list]]] = {
        "simulate": lambda: (simulation(machine, max(1, options.repeats)), []),
        "commands": lambda: (commands(bare), []),
        "memory": memory,
        "growth": lambda: growth(bare),
    }
    for part in PARTS:
        if part in wanted:
            begin = time.perf_counter()
            more, lines = work[part]()
            rows, curves = rows + more, curves + lines
            print(
                f"{part}: {time.perf_counter() - begin:.0f} s, load average {os.getloadavg()[0]:.1f}",
                file=sys.stderr,
                flush=True,
            )
    print(table(rows))
    if options.write:
        for path in write_page(ROOT / "docs", head, rows, curves):
            print(f"written: {path.relative_to(ROOT)}")
    if any(r.met is False and not r.alone for r in rows):
        sys.exit(1)


if __name__ == "__main__":
    main()
