"""The ladder of models: rigid kinematics, the drives, the machine as given, each effect found, the calibrated data
sheet.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from mjsim.commands.ball_bar.compare import BarComparison, overlay
from mjsim.commands.diagnosis import Diagnosis
from mjsim.digits import estimate
from mjsim.inference.disturbances import readmitted, without_disturbances
from mjsim.inference.mistakes.checked_problem import trusted_problem
from mjsim.inference.nuisance_fit import fit_nuisance
from mjsim.inference.problem import Problem
from mjsim.inference.vibration import phased, phased_at
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.effect import Effect
from mjsim.machine.kinematics import Geometry
from mjsim.machine.model import Machine, build
from mjsim.progress import Progress, counted, silent
from mjsim.simulation.axes import time_grid
from mjsim.simulation.bar import reading_in
from mjsim.simulation.multibody import Reading, Simulation
from mjsim.simulation.readings import readings_of

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
    problem = trusted_problem(result.campaign, build(result.before.machine), threads)
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
