"""Vibration: lines of constant frequency in what does not repeat from one revolution to the next.

A vibration's phase is free in every test, so it is a nuisance with a size: it is looked for before everything else, in
single samples (blocks would average it away, :mod:`mjsim.inference.lines`), and left out of the data while the other
effects are searched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.effects.vibration import Vibration
from mjsim.inference.lines import Line, find, phases_of, records_of
from mjsim.inference.nuisance_fit import fit_nuisance
from mjsim.inference.problem import Problem
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine, build


@dataclass(frozen=True)
class Separated:
    """A problem whose data have no vibrations in them.

    Attributes:
        problem: With all vibrations left out of the data; the noise is estimated without them.
        machine: Without vibrations.
        lines: What was left out: what was found, and what the machine as given has, with the phases of the tests.
    """

    problem: Problem
    machine: Machine
    lines: tuple[Line, ...]


def separate(problem: Problem, machine: Machine) -> Separated:
    """Take vibrations out of the data: those of ``machine``, with the phases of the tests, and what else is found."""
    rigid = without_vibrations(machine)
    readings = problem.readings(build(rigid))
    nuisance = fit_nuisance(problem, readings)
    lines: list[Line] = []
    data = problem
    while len(lines) < problem.settings.most_vibrations:
        line = find(data, data.sample_residuals(readings, nuisance), nuisance)
        if line is None or any(_same(line.effect, other.effect) for other in lines):
            break
        lines.append(line)
        data = _without(problem, [line.effect for line in lines], nuisance)
    left = [e for e in machine.effects if e.kind == "vibration" and not any(_same(e, line.effect) for line in lines)]
    if left:
        weak = phased(data, replace(rigid, effects=(*rigid.effects, *left)), readings, nuisance)
        lines += [Line(e, {}, (), 0.0) for e in weak.effects if e.kind == "vibration"]
        data = _without(problem, [line.effect for line in lines], nuisance)
    return Separated(data, rigid, tuple(lines))


def without_vibrations(machine: Machine) -> Machine:
    """The machine without its vibrations."""
    return replace(machine, effects=tuple(e for e in machine.effects if e.kind != "vibration"))


def is_news(line: Line, machine: Machine) -> bool:
    """Whether ``machine`` lacks this vibration, or has it at another size (outside the interval and by more than a
    tenth).
    """
    for e in machine.effects:
        if e.kind == "vibration" and _same(e, line.effect):
            a, b = e.values["amplitude_um"], line.effect.values["amplitude_um"]
            return (
                bool(line.ci95)
                and abs(a - b) > 0.1 * b
                and not line.ci95["amplitude_um"][0] <= a <= line.ci95["amplitude_um"][1]
            )
    return True


def _same(a: Effect, b: Effect) -> bool:
    return a.subject == b.subject and abs(a.values["frequency_Hz"] - b.values["frequency_Hz"]) < 0.1


def _without(problem: Problem, waves: Sequence[Effect], nuisance: np.ndarray) -> Problem:
    """The problem with vibrations left out of its data."""

    def part(k: int) -> np.ndarray:
        shift = problem.shift(k, nuisance)
        parts = (_wave(problem, k, wave, shift) for wave in waves)
        return sum(parts, np.zeros(len(problem.samples[k].time)))

    return problem.without([part(k) for k in range(len(problem.samples))])


def phased(
    problem: Problem, machine: Machine, readings: list[np.ndarray] | None = None, nuisance: np.ndarray | None = None
) -> Machine:
    """``machine`` with the phases that its vibrations have in the measured tests; see :func:`phased_at`."""
    return phased_at(problem, machine, readings, nuisance)[0]


def phased_at(
    problem: Problem, machine: Machine, readings: list[np.ndarray] | None = None, nuisance: np.ndarray | None = None
) -> tuple[Machine, np.ndarray | None]:
    """``machine`` with the phases that its vibrations have in the measured tests, and the nuisances that these phases
    belong to: at a trigger one period off they look nearly as good. ``None`` where nothing vibrates.

    Args:
        problem: The measured tests.
        machine: The machine.
        readings: Simulated ones of the machine without vibrations, one per test, m; made where missing.
        nuisance: Fitted to ``readings``, (problem.nuisances.size,); where missing, it is fitted, and again without
            the vibrations, which disturb the triggers.
    """
    waves = _vibrations(machine)
    if not waves:
        return machine, None
    if readings is None:
        readings = problem.readings(build(without_vibrations(machine)))
    if nuisance is None:
        nuisance = fit_nuisance(problem, readings)
        found = _with_phases(problem, waves, readings, nuisance)
        nuisance = fit_nuisance(_without(problem, found, nuisance), readings)
    for effect in _with_phases(problem, waves, readings, nuisance):
        machine = machine.with_effect(effect)
    return machine, nuisance


def at_own_noise(problem: Problem, machine: Machine, nuisance: np.ndarray) -> Problem:
    """The same data with the noise that they have without the vibrations of ``machine`` (:func:`phased_at`)."""
    waves = _vibrations(machine)
    return _without(problem, waves, nuisance).restored()


def _vibrations(machine: Machine) -> list[Vibration]:
    return [e for e in machine.effects if isinstance(e, Vibration) and not e.is_neutral]


def _with_phases(
    problem: Problem, waves: list[Vibration], readings: list[np.ndarray], nuisance: np.ndarray
) -> list[Vibration]:
    """The vibrations with the phases that they have in every test at these triggers."""
    out = []
    rest = problem.sample_residuals(readings, nuisance)
    for effect in waves:
        records = records_of(problem, rest, nuisance, False)
        i, f = problem.chain.index(effect.subject), effect.values["frequency_Hz"]
        out.append(effect.with_phases(phases_of(records, f, i)))
        rest = [r - _wave(problem, k, out[-1], problem.shift(k, nuisance)) for k, r in enumerate(rest)]
    return out


def _wave(problem: Problem, k: int, effect, shift: float) -> np.ndarray:
    """What a vibration adds to every sample of test ``k``, m."""
    s = problem.samples[k]
    w = 2.0 * np.pi * effect.values["frequency_Hz"]
    weight = s.sample_all(problem.sensitivity[k].axes[:, problem.chain.index(effect.subject)], shift)
    return weight * effect.si("amplitude_um") * np.sin(w * (s.time - shift) + effect.phases.get(s.test.recording, 0.0))
