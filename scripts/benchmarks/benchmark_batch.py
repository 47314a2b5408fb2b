"""Speed of a sweep: two cores against one, and one core against a bare rollout of the same MuJoCo steps.

The same jobs (a 75 s cone-frustum test with a machine of its own in every run) are run by ``mjsim batch``'s own workers
on one thread and on two, and as bare rollouts of the same models without the callback; also bare rollouts on two
threads at once, which say what the machine itself gives at that moment. All are timed in turn, again and again: other
processes only ever make them slower, so the best of each is what the code can do. The median of the rounds' ratios is
printed too, and ratios of processor time, which count no waiting for a core that other processes have.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

# no threads in linear algebra: the runs are the threads
os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

import mujoco
import numpy as np
from mujoco import rollout

from mjsim.batch.run import batch
from mjsim.batch.scheduler import crew_of, work_off
from mjsim.batch.simulate import Simulator
from mjsim.batch.sweep import Sweep, read_sweep
from mjsim.io.resources import examples
from mjsim.machine.model import build
from mjsim.simulation import callback, mjmodel
from mjsim.simulation.drive import STEP
from mjsim.simulation.multibody import prepare
from mjsim.threads import one_blas_thread

SWEEP = """
name = "benchmark"
campaign = "hidden-backlash"
tests = ["cone15-centre-ccw"]
design = "tolerances"
samples = {runs}
[[vary]]
parameter = "backlash.A.width_deg"
values = [0.002]
"""
TARGET_CORES, TARGET_BARE = 1.8, 1.3


def timed(action) -> tuple[float, float]:
    """Seconds that ``action`` takes, and seconds of processor time of all its threads."""
    start, cpu = time.perf_counter(), time.process_time()
    action()
    return time.perf_counter() - start, time.process_time() - cpu


def bare_rollouts(sweep: Sweep):
    """``run(threads)``: every job's model rolled out with the same controls, without the callback."""
    full, made = mujoco.mjtState.mjSTATE_FULLPHYSICS, []
    for job in sweep.jobs():
        plant = build(sweep.machine(job.run))
        *_, sent, model, data = prepare(mjmodel.build_model(plant), plant, sweep.test_of(job), STEP)
        initial = np.zeros(mujoco.mj_stateSize(model, full))
        mujoco.mj_getState(model, data, initial, full)
        made.append((model, data, initial[None], np.vstack([sent[1:], sent[-1:]])[None]))

    def run(threads: int) -> None:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda args: rollout.rollout(*args), made))

    return run, sum(control.shape[1] for *_, control in made)


@one_blas_thread
def simulations(simulator: Simulator, sweep: Sweep, threads: int) -> None:
    """All jobs as ``mjsim batch`` runs them, nothing written."""
    with callback.installed(), crew_of(ThreadPoolExecutor(threads), threads, None) as crew:
        work_off(crew, sweep.jobs(), lambda job: crew.executor.submit(simulator.run, job), lambda *_: None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=12, help="how often each is timed (default 12)")
    parser.add_argument("--runs", type=int, default=8, help="simulations of one timing (default 8)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        (Path(scratch) / "hidden-backlash").symlink_to(examples() / "hidden-backlash")
        file = Path(scratch) / "sweep.toml"
        file.write_text(SWEEP.format(runs=options.runs))
        sweep = read_sweep(file)
        bare, steps = bare_rollouts(sweep)
        simulator = Simulator(sweep)
        measured = {
            "1 core": lambda: simulations(simulator, sweep, 1),
            "2 cores": lambda: simulations(simulator, sweep, 2),
            "bare, 1 core": lambda: bare(1),
            "bare, 2 cores": lambda: bare(2),
            "whole command, 2 cores": lambda: batch(sweep, Path(tempfile.mkdtemp(dir=scratch)), 2),
        }
        for action in measured.values():
            action()
        times = {name: [] for name in measured}
        for _ in range(options.rounds):
            for name, action in measured.items():
                times[name].append(timed(action))
    report(times, steps, options)


def report(times: dict[str, list[tuple[float, float]]], steps: int, options: argparse.Namespace) -> None:
    """Print the table and both ratios."""
    print(
        f"MuJoCo {mujoco.__version__}, {options.runs} simulations of {steps // options.runs} steps, "
        f"{options.rounds} rounds in turn"
    )
    print(f"load average of the machine's {os.cpu_count()} cores at the end: {os.getloadavg()[0]:.1f}")
    for name, t in times.items():
        wall, cpu = zip(*t, strict=True)
        text = f"best {min(wall):6.3f} s, median {statistics.median(wall):6.3f} s; processor time {min(cpu):6.3f} s"
        print(f"  {name:22}  {text}, {min(cpu) / steps * 1e6:5.2f} µs per step")
    for what, a, b, target, more in (
        ("two cores over one", "1 core", "2 cores", TARGET_CORES, True),
        ("  (bare rollouts: the machine itself)", "bare, 1 core", "bare, 2 cores", None, True),
        ("one core over a bare rollout", "1 core", "bare, 1 core", TARGET_BARE, False),
        ("whole command over its runs, two cores", "whole command, 2 cores", "2 cores", None, False),
    ):
        wall, cpu = (min(x[k] for x in times[a]) / min(x[k] for x in times[b]) for k in (0, 1))
        middle = statistics.median(x[0] / y[0] for x, y in zip(times[a], times[b], strict=True))
        verdict = ""
        if target is not None:
            met = wall >= target if more else wall <= target
            verdict = f"; target {'at least' if more else 'at most'} {target}: {'met' if met else 'MISSED'}"
        print(
            f"{what}: {wall:.2f} times (best of each), {middle:.2f} (median of rounds), {cpu:.2f} in processor "
            f"time{verdict}"
        )


if __name__ == "__main__":
    main()
