"""What would be gained by repairing one cause: the final model simulated without it.

Causes are ranked as ball-bar software ranks them, by what each makes of the whole error. The order comes from the
drives alone (:mod:`mjsim.simulation.axes`, which agrees with the multibody model to far below 0.1 µm). The best repairs
are then simulated in full; what nobody can repair is not, since it only fills the table.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.commands.ball_bar.compare import BarComparison, overlay
from mjsim.commands.diagnosis import Diagnosis
from mjsim.digits import estimate
from mjsim.errors import InputError
from mjsim.inference.disturbances import readmitted, without_disturbances
from mjsim.inference.mistakes.checked_problem import trusted_problem
from mjsim.inference.nuisance_fit import fit_nuisance
from mjsim.inference.problem import Problem
from mjsim.inference.samples import GRID_STEPS
from mjsim.inference.vibration import phased, phased_at
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.effect import Effect, Remedy
from mjsim.machine.kinematics import Geometry
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import AxisPlant
from mjsim.plots.polar import centre_of, off_centre
from mjsim.progress import Progress, counted, silent
from mjsim.report.content import RepairRow, WhatIf
from mjsim.simulation.axes import time_grid
from mjsim.simulation.bar import reading_in
from mjsim.simulation.drive import STEP
from mjsim.simulation.multibody import Reading, Simulation
from mjsim.simulation.readings import readings_of
from mjsim.units import UM

# -- the ladder of models ----------------------------------------------------------------------------------------------

KINEMATICS, SIMULATION = "kinematics", "full simulation"
#: The step of a machine whose file states a tolerance.
WITHIN = "calibrated within tolerance"


@dataclass(frozen=True)
class Model:
    """One model laid over the measurement: its label, what it holds in one sentence, how it was computed, the
    comparison.
    """

    label: str
    what: str
    how: str
    comparison: BarComparison


def prepared(result: Diagnosis, threads: int = 2) -> Problem:
    """The campaign as the diagnosis has judged it: with the disturbances left out that its final model does not
    follow.
    """
    problem = trusted_problem(result.campaign, result.before.machine, threads)
    if not any(problem.outliers.values()) and not any(t.outliers for t in result.after.tests):
        return problem
    readings = problem.readings(build(phased(problem, result.machine)))
    nuisance = fit_nuisance(problem, readings)
    return readmitted(without_disturbances(problem, readings, nuisance), readings, nuisance)


def rigid(test: BallBarTest) -> Simulation:
    """A test on ideal axes: every axis stands where its command is."""
    program = Program(test)
    time = time_grid(program)
    command = program.commands(time)
    deviation = reading_in(test, command, Geometry())
    return Simulation(test, time, program.phi(time), command, command, deviation)


def run(problem: Problem, machine: Machine, stage: str, threads: int = 2, progress: Progress = silent) -> list[Reading]:
    """All tests in the multibody model, with progress."""
    return readings_of(machine, problem.tests, threads, counted(progress, stage, len(problem.tests)))


def basis(problem: Problem, given: BarComparison, threads: int = 2, progress: Progress = silent) -> list[Model]:
    """The models up to the machine as given, whose comparison is there already."""
    machine = given.machine
    ideal = overlay(problem, replace(machine, effects=()), [rigid(t) for t in problem.tests])
    out = [
        Model(
            "rigid kinematics",
            "Ideal axes. Only ball positions, bar length and trigger shifts are fitted.",
            KINEMATICS,
            ideal,
        )
    ]
    effects = ", ".join(e.key for e in machine.effects)
    if effects:
        bare = replace(machine, effects=())
        drives = overlay(problem, bare, run(problem, bare, "simulating the drives alone", threads, progress))
        out.append(
            Model("+ drives", "The servo loops of all axes, without friction and other effects.", SIMULATION, drives)
        )
        out.append(Model("machine as given", f"The machine file as it is, with {effects}.", SIMULATION, given))
    else:
        out.append(
            Model(
                "machine as given", "The servo loops of all axes. The machine file has no effects.", SIMULATION, given
            )
        )
    return out


def ladder(
    result: Diagnosis, problem: Problem, threads: int = 2, progress: Progress = silent, apart: bool = True
) -> tuple[list[Model], int]:
    """Every model of a diagnosis, and the place of the machine as given among them.

    Args:
        apart: simulate the last effect without the calibrated data sheet as well, so that each has a step of its own.
    """
    out = basis(problem, result.before, threads, progress)
    start = len(out) - 1
    found = [e.effect for e in result.effects]
    told = {e.effect.key: _values(e.effect, e.ci95) for e in result.effects}
    within = [c.effect.effect for c in result.calibration]
    if within and found:
        text = f"All {len(within)} effects with a tolerance, at the values that the data and the tolerance give them."
        out.append(Model(WITHIN, text, SIMULATION, result.rungs[0]))
    own = result.own_rungs
    for i, effect in enumerate(found[:own]):
        last = i == len(found) - 1
        text = f"{effect.title}: {told[effect.key]}. Data sheet as given."
        if not last:
            out.append(Model(f"+ {effect.key}", text, SIMULATION, result.rungs[i + 1]))
        elif apart:
            whole, begin = phased_at(problem, result.before.machine.with_effects([*within, *found]))
            simulations = run(problem, whole, "simulating the data sheet as given", threads, progress)
            out.append(Model(f"+ {effect.key}", text, SIMULATION, overlay(problem, whole, simulations, begin)))
    if own < len(found):
        text = f"The other {len(found) - own} effects: {', '.join(e.key for e in found[own:])}. Data sheet calibrated."
        out.append(Model(f"+ {len(found) - own} more", text, SIMULATION, result.after))
        return out, start
    inside = "Drive and friction values are adjusted within the data sheet's tolerances"
    if found and not apart:
        out.append(
            Model(
                f"+ {found[-1].key}", f"{found[-1].title}: {told[found[-1].key]}. {inside}.", SIMULATION, result.after
            )
        )
    elif within and not found:
        text = f"The final model: {len(within)} effects with a tolerance. {inside}."
        out.append(Model(WITHIN, text, SIMULATION, result.after))
    else:
        out.append(Model("data sheet calibrated", f"The final model. {inside}.", SIMULATION, result.after))
    return out, start


def _values(effect: Effect, ci95: dict) -> str:
    rows = effect.values.get("components")
    if rows:
        return "orders " + ", ".join(f"{row[0]:g}" for row in rows)
    told = ((k, estimate(v, ci95.get(k)) if isinstance(v, float) else v) for k, v in effect.values.items())
    return ", ".join(f"{k} = {v}" for k, v in told)


DRIVES = "drives alone"
ALL = "all repairs together"
_FORMER = " as in the file"
#: Difference of two axes' lags that is no cause, s: what exact settings leave (0.03 % of some 20 ms).
_LAG = 0.02e-3


@dataclass(frozen=True)
class Cause:
    """Something that could be repaired: its name, title and remedy, and the machine after the repair."""

    name: str
    title: str
    remedy: Remedy
    machine: Machine


@dataclass(frozen=True)
class _Errors:
    """RMS of the deviation over all tests [µm], and G or peak to valley of each [µm]."""

    rms_um: float
    tests_um: list[float]


def lag(axis: AxisPlant) -> float:
    """How long an axis is behind its command at constant speed, s."""
    return (1.0 - axis.feedforward) / axis.position_gain + axis.delay


def causes(machine: Machine, given: Machine, found: Collection[str] = (), inside: Collection[str] = ()) -> list[Cause]:
    """Everything in ``machine`` that could be taken out one by one; friction that was ``found`` (keys) to be off what
    ``given`` has
    can also go back to that. Effects within their tolerance (keys ``inside``) go together."""
    out = []
    for effect in machine.effects:
        if effect.is_neutral or effect.key in inside:
            continue
        out.append(Cause(effect.key, effect.title, effect.remedy.on(effect.subject), machine.without(effect.key)))
        former = given.effect(effect.key)
        if effect.kind == "friction" and effect.key in found and former is not None:
            what = Remedy(
                "maintain",
                "reversal spikes",
                "It differs from the machine file. Check lubrication, seals, covers and preload.",
            )
            out.append(
                Cause(
                    f"{effect.key}{_FORMER}",
                    "Friction differs from the machine file",
                    what,
                    machine.with_effect(former),
                )
            )
    if inside:
        what = Remedy("share", "", "A machine of this class may have it. The calibration shows each number.")
        out.append(Cause(WITHIN, "Everything that was calibrated", what, _as_given(machine, given, inside)))
    lags = {a: lag(drive) for a, drive in build(machine).axes.items()}
    if max(lags.values()) - min(lags.values()) > _LAG:
        spread = ", ".join(f"{a} {lags[a] * 1e3:.2f}" for a in lags)
        title = f"Axes lag differently: {spread} ms"
        what = Remedy("adjust", "servo mismatch", "Set gains, feedforward and delays so that all axes lag alike.")
        out.append(Cause("servo lag", title, what, _matched(machine, lags)))
    return out


def _as_given(machine: Machine, given: Machine, keys: Collection[str]) -> Machine:
    """``machine`` with some effects as ``given`` has them, or without them."""
    for key in keys:
        former = given.effect(key)
        machine = machine.without(key) if former is None else machine.with_effect(former)
    return machine


def _matched(machine: Machine, lags: dict[str, float]) -> Machine:
    """``machine`` with every axis delayed to the lag of the slowest one."""
    from mjsim.effects import registry

    for axis, behind in lags.items():
        missing = (max(lags.values()) - behind) * 1e3
        present = machine.effect(f"servo_delay.{axis}")
        delay = missing + (present.values["delay_ms"] if present else 0.0)
        try:
            machine = machine.with_effect(registry.make(f"servo_delay.{axis}", machine.chain, delay_ms=delay))
        except InputError:  # farther apart than a delay can be
            continue
    return machine


def what_if(
    problem: Problem,
    final: BarComparison,
    given: Machine,
    found: Collection[str] = (),
    threads: int = 2,
    progress: Progress = silent,
    full: int = 3,
    inside: Collection[str] = (),
) -> WhatIf | None:
    """Repair every cause in a machine alone, the best repair first, then all repairs together.

    Args:
        problem: the campaign.
        final: the machine in question, simulated.
        given: the machine as the user has it.
        found: keys of the effects that a diagnosis found.
        threads: tests simulated side by side.
        progress: told what is being done.
        full: the best repairs that are simulated in the multibody model. With more than one, all repairs together are
            as well.
        inside: keys of the effects within their tolerance.

    Returns:
        None when there is nothing to take out.

    Raises:
        SimulationError: see :func:`mjsim.simulation.multibody.simulate`.
    """
    machine = phased(problem, final.machine)
    every = causes(machine, given, found, inside)
    if not every:
        return None
    known = final.readings if machine is final.machine else ()
    simulated = _of_readings(problem, known) if known else _of_simulation(problem, machine, threads, progress)
    base = {DRIVES: _of_drives(problem, machine), SIMULATION: simulated}
    progress("repairing one by one", 0, len(every))
    rows = [_row(problem.tests, c, _of_drives(problem, c.machine), base[DRIVES], DRIVES) for c in every]
    by_name = {c.name: c for c in every}
    for _ in range(len(every)):
        rows.sort(key=lambda r: -r.gain_um)
        repairs = [i for i, r in enumerate(rows) if r.kind != "share"]
        at = next((i for i in repairs[:full] if rows[i].how == DRIVES), None)
        if at is None:
            break
        c = by_name[rows[at].cause]
        rows[at] = _row(problem.tests, c, _of_simulation(problem, c.machine, threads, progress), simulated, SIMULATION)
    if sum(r.kind != "share" for r in rows) > 1:
        repaired = _all_repaired(machine, given, every)
        same = next((r for r in rows if r.how == SIMULATION and _alike(by_name[r.cause].machine, repaired)), None)
        rows.append(_together(problem, repaired, base, full > 1, threads, progress, same))
    return WhatIf(simulated.rms_um, simulated.tests_um, rows)


def _alike(a: Machine, b: Machine) -> bool:
    """Whether two machines with the same drives have the same effects."""
    return {e.key: e.values for e in a.effects} == {e.key: e.values for e in b.effects}


def _together(
    problem: Problem,
    repaired: Machine,
    base: dict[str, _Errors],
    full: bool,
    threads: int,
    progress: Progress,
    same: RepairRow | None,
) -> RepairRow:
    """All repairs in one row; ``same`` is the simulated row of a single repair that leaves the same machine, if
    there is one.
    """
    title = "Everything above that can be repaired. What stays comes from the servo loops and from friction."
    how = SIMULATION if full else DRIVES
    if same is not None and full:
        after = _Errors(same.rms_um, list(same.tests_um))
    else:
        after = _of_simulation(problem, repaired, threads, progress) if full else _of_drives(problem, repaired)
    return _row(problem.tests, Cause(ALL, title, Remedy("adjust", "", ""), repaired), after, base[how], how)


def _all_repaired(machine: Machine, given: Machine, every: list[Cause]) -> Machine:
    """``machine`` with every repair made; lags then differ no longer, or by the drives' own settings."""
    for c in every:
        key = c.name.removesuffix(_FORMER)
        former = given.effect(key)
        if key != c.name and former is not None:
            machine = machine.with_effect(former)
        elif c.remedy.repairable and machine.effect(key) is not None:
            machine = machine.without(key)
    return machine


def _row(tests: tuple[BallBarTest, ...], cause: Cause, after: _Errors, before: _Errors, how: str) -> RepairRow:
    gain = before.rms_um - after.rms_um
    return RepairRow(
        cause.name,
        cause.title,
        cause.remedy.term,
        cause.remedy.kind,
        cause.remedy.text,
        how,
        after.rms_um,
        round(gain, 4),
        round(100.0 * gain / before.rms_um, 1) if before.rms_um else 0.0,
        after.tests_um if how == SIMULATION else (),
        *_circle(tests, before.tests_um, after.tests_um),
    )


def _circle(
    tests: tuple[BallBarTest, ...], before: list[float], after: list[float]
) -> tuple[str, float | None, float | None]:
    """Name of the circular test whose G falls most, by how much [µm] and per cent; empty where there is no such
    test.
    """
    falls = [(b - a, b, t.name) for t, b, a in zip(tests, before, after, strict=True) if kind_of(t).goes_round]
    if not falls:
        return "", None, None
    fall, whole, name = max(falls, key=lambda f: f[0])
    return name, round(fall, 4), round(100.0 * fall / whole, 1) if whole else 0.0


def _of_drives(problem: Problem, machine: Machine) -> _Errors:
    readings = problem.readings(build(machine))
    every = STEP * GRID_STEPS
    return _errors(problem.tests, [(np.arange(len(r)) * every, r) for r in readings])


def _of_simulation(problem: Problem, machine: Machine, threads: int, progress: Progress) -> _Errors:
    return _of_readings(problem, [r.deviation for r in run(problem, machine, "simulating repairs", threads, progress)])


def _of_readings(problem: Problem, readings: Sequence[np.ndarray]) -> _Errors:
    return _errors(problem.tests, [(time_grid(Program(t)), r) for t, r in zip(problem.tests, readings, strict=True)])


def _errors(tests: tuple[BallBarTest, ...], readings: list[tuple[np.ndarray, np.ndarray]]) -> _Errors:
    squares, seconds, spans = 0.0, 0.0, []
    for test, (time, reading) in zip(tests, readings, strict=True):
        program = Program(test)
        first, last = program.measured_span
        inside = (time >= first) & (time <= last)
        rest = about_circle(test, program.phi(time[inside]), reading[inside])
        squares += float(np.mean(rest**2)) * (last - first)
        seconds += last - first
        spans.append(round(float(np.ptp(rest)) / UM, 4))
    return _Errors(round((squares / seconds) ** 0.5 / UM, 4), spans)


def about_circle(test: BallBarTest, phi: np.ndarray, reading: np.ndarray) -> np.ndarray:
    """Readings (n,) m less their least-squares circle; less their mean for a test that does not go round."""
    rest = reading - off_centre(centre_of(test, phi, reading), phi)
    return rest - rest.mean()
