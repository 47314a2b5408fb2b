#!/usr/bin/env python3
"""How often would a healthy machine raise an alarm? Simulated nulls through the whole search.

    .venv/bin/python scripts/null_bank.py [N] [--seed S] [--out FILE]

Each null is one campaign of the example's tests (a random three to six of them) of a machine whose data sheet is off by
its tolerances, with set-up errors, trigger shifts, coloured noise and quantisation. Prints the largest gain that any
catalogue effect reaches in each, against the threshold above which the search calls it an effect. The nulls come from
mjsim's own drives, so this calibrates the threshold; it does not prove the physics.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.model import Campaign
from mjsim.estimation.criteria import is_feasible
from mjsim.estimation.data_sheet import calibrated, data_sheet
from mjsim.estimation.fit import Fitter
from mjsim.estimation.mistakes.checked_problem import trusted_problem
from mjsim.estimation.nuisance import LENGTH, SPINDLE_BALL, TABLE_BALL, TRIGGER
from mjsim.estimation.selection import ModelSelection
from mjsim.estimation.settings import DIAGNOSIS
from mjsim.estimation.signatures import SignatureBank, seeds
from mjsim.instruments.ball_bar.measurement import Trace
from mjsim.io.resources import examples
from mjsim.machine.kinematics import reading
from mjsim.machine.model import Machine, build
from mjsim.simulation.axes import AxesMotion


def null_campaign(campaign: Campaign, machine: Machine, rng: np.random.Generator) -> Campaign:
    """A healthy campaign: data sheet off by its tolerances (cut at 2.5 σ), everything of the measurement chain
    drawn from its priors.
    """
    true = build(calibrated(machine, np.clip(rng.standard_normal(len(data_sheet(machine.chain))), -2.5, 2.5)))
    chosen = sorted(rng.choice(len(campaign.tests), size=int(rng.integers(3, 7)), replace=False))
    setups = {t.setup: (rng.normal(0, TABLE_BALL, 3), rng.normal(0, SPINDLE_BALL, 3)) for t in campaign.tests}
    length = rng.normal(0, LENGTH)
    tests, traces = [], {}
    for k in chosen:
        t = campaign.tests[k]
        motion = AxesMotion(t)
        q = motion.load(true)
        table, spindle = setups[t.setup]
        q[:, :3] += spindle
        d = reading(true.chain, q, np.asarray(t.table_ball) + table, t.length, true.geometry) + length
        lo, hi = motion.program.measured_span
        time = np.arange(np.ceil(lo / 0.005), np.floor(hi / 0.005) + 1) * 0.005
        x = np.interp(time - np.clip(rng.normal(0, TRIGGER), -0.05, 0.05), motion.time, d)
        noise, state, a = np.empty(len(time)), rng.normal(0, 0.1e-6), float(np.exp(-0.005 / 0.06))
        for i in range(len(time)):
            state = a * state + rng.normal(0, 0.1e-6 * np.sqrt(1 - a * a))
            noise[i] = state
        value = np.round((x + noise + rng.normal(0, 0.04e-6, len(time))) / 0.1e-6) * 0.1e-6
        tests.append(t)
        traces[t.name] = Trace(time, value, np.ones(len(time), bool))
    return replace(campaign, tests=tuple(tests), traces=traces)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    base = read_campaign(examples() / "healthy", traces=False)
    machines = [read_machine(examples() / name / "machine.toml") for name in ("healthy", "two-candidates")]
    rows = []
    for number in range(options.count):
        rng = np.random.default_rng([options.seed, number])
        machine = machines[number % 2]
        problem = trusted_problem(null_campaign(base, machine, rng), build(machine))
        fitter = Fitter(problem, machine)
        selection = ModelSelection(fitter)
        start = selection.start()
        bank = SignatureBank(problem, start)
        bank.compute(seeds(machine))
        best = [
            (round(r[0], 1), r[2].id)
            for r in selection.ranked_candidates(start, bank)
            if is_feasible(machine, r[1], r[2])
        ][:3]
        square = start.sum_squares / problem.count
        rows.append({"number": number, "tests": [t.name for t in problem.tests], "best": best, "mean_square": square})
        print(json.dumps(rows[-1]), flush=True)
    gains = np.array([r["best"][0][0] for r in rows])
    above = int((gains > DIAGNOSIS.likelihood_ratio).sum())
    print(
        f"{above} of {len(gains)} nulls above {DIAGNOSIS.likelihood_ratio:g}; median {np.median(gains):.1f}, "
        f"largest {gains.max():.1f}"
    )
    if options.out:
        options.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
