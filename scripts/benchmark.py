"""Speed of the simulation on one core: a 75 s cone-frustum test with every effect of the catalogue on.

Three things are timed in turn, again and again, and medians are shown: `simulate` as a user calls it (model, NC program, steps,
reading), its MuJoCo steps alone, and a bare rollout of the same model and number of steps without the callback.
"""

from __future__ import annotations

import argparse
import math
import statistics
import time

import mujoco
import numpy as np
from mujoco import rollout

from mjsim.campaign.model import Test
from mjsim.effects import registry
from mjsim.engine import callback, mjmodel
from mjsim.engine.drive import STEP, SUBSTEPS
from mjsim.engine.plant import Plant, build
from mjsim.engine.simulate import _prepare, simulate
from mjsim.machine.files import read_machine
from mjsim.machine.model import Machine
from mjsim.resources import examples

TARGET_S = 0.75
DEG = math.pi / 180.0
#: θ = 15°, β = 10°, two turns at 1000 mm/min: 74.9 s.
TEST = Test(
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
    """Every kind and subject of the catalogue at a typical size; what the machine has already stays as it is."""
    for effect_id in registry.all_ids():
        if machine.effect(effect_id) is not None:
            continue
        cls, subject = registry.effect_class(effect_id)
        values = {}
        for p in cls.parameters_of(subject):
            if p.kind == "components":
                values[p.name] = [[72.0, p.scale, 30.0], [360.0, 0.3 * p.scale, 0.0]]
            elif p.kind == "number" and p.neutral is not None:
                values[p.name] = min(p.upper, p.neutral + p.scale)
            elif p.kind == "number" and p.default is None:
                values[p.name] = min(p.upper, max(p.lower, 3.0 * p.scale))
        machine = machine.with_effect(cls(subject, **values))
    return machine


def timed(action) -> float:
    """Seconds that ``action`` takes."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def steps_of(plant: Plant):
    """A function that runs the test's MuJoCo steps (with or without the callback), and their number."""
    base = mjmodel.build_model(plant)
    _, grid, sent, model, data = _prepare(base, plant, TEST, STEP)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    initial = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, initial, full)
    control = np.vstack([sent[1:], sent[-1:]])

    def steps() -> None:
        rollout.rollout(model, data, initial[None], control[None])

    def driven() -> None:
        callback.install()
        try:
            steps()
        finally:
            callback.uninstall()

    return driven, steps, len(grid)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9, help="how often each of the three is timed (default 9)")
    repeats = max(1, parser.parse_args().repeats)
    shipped = read_machine(examples() / "hidden-backlash" / "machine.toml")
    print(f"MuJoCo {mujoco.__version__}, step {STEP * 1e3:g} ms, {SUBSTEPS} drive sub-steps; median of {repeats}, one core")
    for title, machine in (("the machine's own friction only", shipped), ("every effect of the catalogue", with_every_effect(shipped))):
        plant = build(machine)
        driven, bare, n = steps_of(plant)
        whole = lambda machine=machine: simulate(machine, [TEST], threads=1)  # noqa: E731
        for warm_up in (whole, driven, bare):
            warm_up()
        times = [(timed(whole), timed(driven), timed(bare)) for _ in range(repeats)]
        total, with_callback, without = (statistics.median(t) for t in zip(*times, strict=True))
        ratio = statistics.median(d / b for _, d, b in times)
        duration = (n - 1) * STEP
        print(f"\n{title}: {len(plant.effects)} effects, {len(plant.ops)} transmission operations, a test of {duration:.1f} s")
        verdict = f"target {TARGET_S} s {'met' if total < TARGET_S else 'MISSED'}"
        for name, seconds, note in (
            ("simulate", total, f", {duration / total:.0f} times real time; {verdict}"),
            ("its MuJoCo steps", with_callback, f", {ratio:.2f} times the bare rollout"),
            ("bare rollout", without, ""),
        ):
            print(f"  {name:16}  {seconds:6.3f} s  {seconds / n * 1e6:5.2f} µs per step{note}")


if __name__ == "__main__":
    main()
