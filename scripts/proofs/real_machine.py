"""Compute the figures of the page "A real machine" from a copy of the recordings: docs/real-machine.md.

    python scripts/proofs/real_machine.py --table TABLE --emps EMPS --screw SCREW

TABLE is a campaign with two logs of a two-axis table under two controllers, EMPS one with the benchmark's four periods,
SCREW one with steps and ramps of a single ball screw under three controllers.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.model import Campaign
from mjsim.commands.axis_log.compare import compare_logs
from mjsim.commands.axis_log.diagnose import diagnose_logs
from mjsim.commands.axis_log.diagnosis import LogDiagnosis
from mjsim.inference.axis_logs.candidates import Catalogue
from mjsim.inference.axis_logs.data import axis_data
from mjsim.inference.axis_logs.fit import LogFitter
from mjsim.inference.axis_logs.gains import read_gains
from mjsim.inference.axis_logs.separability import intervals
from mjsim.inference.axis_logs.start import start_model
from mjsim.instruments.axis_log.measurement import Recording
from mjsim.machine.model import Machine
from mjsim.units import UM

#: Published parameters of EMPS (Janot, Gautier, Brunot 2019): kg, N·s/m, N, N; and a period of its motion, s.
PUBLISHED = {"inertia": 95.1089, "viscous": 203.5034, "coulomb": 20.3935, "offset": -3.1648}
PERIOD = 6.24


def timed(work: Callable[[], LogDiagnosis]) -> LogDiagnosis:
    """A diagnosis, with the time it took printed."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    print(f"({time.perf_counter() - wall:.0f} s, {time.process_time() - cpu:.0f} s of processor time)")
    return result


def ladders(result: LogDiagnosis) -> None:
    """RMS of every recording as one cause after the other enters the model."""
    for axis, s in result.selections.items():
        names = [t.test.name for t in result.before.tests if axis in t.axes]
        print(f"\n| {axis} | " + " | ".join(names) + " |\n|---|" + "---|" * len(names))
        rows = [("data sheet", s.given), ("data sheet fitted", s.sheet), *s.rungs, ("final", s.fit)]
        for name, fit in rows:
            print(
                f"| {name} | " + " | ".join(f"{np.sqrt(m) / UM:.2f}" for m in fit.mean_squares[: fit.positions]) + " |"
            )


def causes(result: LogDiagnosis) -> None:
    """What was found, each number with its interval."""
    print(f"\nverdict: {result.verdict}")
    for e in result.effects:
        print(f"- {e.effect.id}: {e.effect.values}, 95 %: {e.ci95}, not told from {e.alternatives or 'nothing else'}")
    for s in result.sheet:
        known = s.source if s.known else "sheet only"
        low, high = (c / s.stated for c in s.ci95)
        where = f" ({s.controller})" if s.controller else ""
        print(f"- {s.axis} {s.name}{where}: {s.found / s.stated:.3f} of the sheet, {low:.3f} to {high:.3f}, {known}")


def predictions(campaign: Campaign, machine: Machine) -> None:
    """Every log predicted by the machine that was fitted to each single one."""
    names = [t.name for t in campaign.of("axis_log").measured]
    for fitted_to in names:
        fitted = diagnose_logs(campaign.only([fitted_to]), machine).machine
        for name in names:
            (log,) = compare_logs(campaign.only([name]), fitted).tests
            axes = ", ".join(f"{a} {x.rms / UM:.2f}" for a, x in log.axes.items())
            radial = f", radial {log.circle.rms / UM:.2f}" if log.circle else ""
            print(f"fitted to {fitted_to}, held against {name}: {axes}{radial} µm RMS")


def parts(campaign: Campaign, cut: float) -> Campaign:
    """A campaign whose only log is cut in two, ``before`` and ``after``."""
    test, (recording,) = campaign.of("axis_log").tests[0], campaign.traces.values()
    early = recording.time < cut
    logs = {"before": early, "after": ~early}
    tests = tuple(replace(test, name=name) for name in logs)
    return replace(campaign, tests=tests, traces={n: _cut(recording, k) for n, k in logs.items()})


def _cut(recording: Recording, kept: np.ndarray) -> Recording:
    time = recording.time[kept]
    axes = {}
    for letter, r in recording.axes.items():
        more = {n: v[kept] for n, v in vars(r).items() if v is not None}
        axes[letter] = replace(r, **more)
    return Recording(time - time[0], axes)


def published_form(campaign: Campaign, machine: Machine) -> None:
    """EMPS in the form of the publication: inertia, viscous and Coulomb friction and a constant force, nothing else."""
    data = axis_data(campaign, "X", machine)
    fitter, gains = LogFitter(machine, data), read_gains(machine, data)
    model = start_model(machine, data, gains)
    found = Catalogue(machine, data).missing(model)
    for kind in ("friction", "constant_force"):
        model = next(c for c in found if c.effect.kind == kind).extend(model)
    # Coulomb friction as such: bristles as stiff as they start
    kept = tuple(replace(e, deviation=1e-4) if e.name == "presliding_rad" else e for e in model.entries)
    fit = fitter.polished(fitter.fit(replace(model, entries=kept)))
    gear = machine.drives["X"].gear
    found_numbers = intervals(fit)
    rows = {
        "inertia": ("drive.inertia", gear**2, "kg"),
        "viscous": ("drive.viscous", gear**2, "N·s/m"),
        "coulomb": ("friction.X.coulomb_Nm", gear, "N"),
        "offset": ("constant_force.X.torque_Nm", gear, "N"),
    }
    print(f"\npublished form: {fit.rms / UM:.2f} µm RMS\n\n| number | published | found | 95 % | difference |")
    print("|---|---|---|---|---|")
    for name, (label, factor, unit) in rows.items():
        value, low, high = (factor * x for x in found_numbers[label])
        apart = 100.0 * (value / PUBLISHED[name] - 1.0)
        stated = PUBLISHED[name]
        print(f"| {name} ({unit}) | {stated:.2f} | {value:.2f} | {low:.2f} to {high:.2f} | {apart:+.1f} % |")


def main() -> None:
    """Print the figures of the campaigns that are given."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--table", type=Path)
    parser.add_argument("--emps", type=Path)
    parser.add_argument("--screw", type=Path)
    given = parser.parse_args()
    for folder in filter(None, (given.table, given.emps, given.screw)):
        campaign = read_campaign(folder)
        machine = read_machine(campaign.machine_file)
        print(f"\n## {campaign.name}\n")
        result = timed(lambda c=campaign, m=machine: diagnose_logs(c, m))
        ladders(result)
        causes(result)
        for log in result.after.tests:
            if log.circle:
                before = next(t for t in result.before.tests if t.test.name == log.test.name)
                assert before.circle is not None
                print(f"radial of {log.test.name}: {before.circle.rms / UM:.2f} → {log.circle.rms / UM:.2f} µm")
        if folder == given.emps:
            published_form(campaign, machine)
            campaign = parts(campaign, 3 * PERIOD)
        if folder != given.screw:
            predictions(campaign, machine)


if __name__ == "__main__":
    main()
