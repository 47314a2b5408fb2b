"""Errors that every number carries beside those of the fit: of the instrument, of recorded temperatures, and of the
choice of the model.

What instrument or temperatures may be off is ``D c`` in the whitened readings, with c normal of variance 1. A fit
with c among its unknowns has the covariance ``C + C Jᵀ D S⁻¹ Dᵀ J C``, where ``S = 1 + Dᵀ D - Dᵀ J C Jᵀ D`` is what
prior and data know of c. The covariance grows by that. The estimate is that of an instrument without errors: an error
that would move it much shows as a misfit.

A recorded temperature is a line between means, and each of these has an error of its own. It moves every axis that
follows the sensor.

Models with something else in the place of a finding have other values of all other numbers. Their spread, weighted with
their probabilities, is added as that of a mixture.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from mjsim.inference.design import Design
from mjsim.inference.fit import Fit
from mjsim.inference.problem import Problem
from mjsim.inference.samples import GRID

#: Names of what is considered.
INSTRUMENT, TEMPERATURE, CHOICE = "instrument", "temperature", "choice of the model"
#: Pieces of a test over which the hysteresis of a bar stays the same: it has no law that the readings could teach
#: (assumed: eight in a revolution).
_PIECES = 16
#: Probability below which another model does not count.
_LEAST = 1e-3


def harmonics(unit: np.ndarray) -> np.ndarray:
    """Forms of a ball that a bar sees: the harmonics of degree 2 (oval) and 3 (three lobes).

    Args:
        unit: Directions from the ball's centre, (n, 3) of length 1.

    Returns:
        (n, 12): the squares of each degree sum to 1 in every direction (Schmidt's normalisation).
    """
    x, y, z = unit.T
    oval = [
        math.sqrt(3.0) * x * y,
        math.sqrt(3.0) * y * z,
        math.sqrt(3.0) * z * x,
        math.sqrt(0.75) * (x * x - y * y),
        0.5 * (3.0 * z * z - 1.0),
    ]
    lobes = [
        0.5 * z * (5.0 * z * z - 3.0),
        math.sqrt(0.375) * x * (5.0 * z * z - 1.0),
        math.sqrt(0.375) * y * (5.0 * z * z - 1.0),
        math.sqrt(3.75) * z * (x * x - y * y),
        math.sqrt(15.0) * x * y * z,
        math.sqrt(0.625) * x * (x * x - 3.0 * y * y),
        math.sqrt(0.625) * y * (3.0 * x * x - y * y),
    ]
    return np.column_stack([*oval, *lobes])


def errors_of_bar(problem: Problem, fit: Fit) -> Design:
    """What the ball bar may be off, whitened, one standard deviation a column: first a difference between growing and
    falling readings, which is another one in every piece of a test, then gain of its sensor and form of its balls.
    """
    bars = [problem.campaign.instruments[t.instrument] for t in problem.tests]

    def by_piece(k: int) -> np.ndarray:
        s = problem.samples[k]
        piece = np.arange(len(s.centre)) * _PIECES // len(s.centre)
        out = np.zeros((len(piece), _PIECES))
        rate = np.sign(np.gradient(fit.readings[k], GRID))
        out[np.arange(len(piece)), piece] = 0.5 * bars[k].hysteresis * s.sample(rate, problem.shift(k, fit.nuisance))
        return problem.whiten_test(k, out)

    def of_all(k: int) -> np.ndarray:
        s, sens, shift = problem.samples[k], problem.sensitivity[k], problem.shift(k, fit.nuisance)
        forms = np.hstack([harmonics(-sens.table), harmonics(sens.spindle)])
        # two balls with two degrees each share the variance of the form; certificates state two standard deviations
        columns = [0.25 * bars[k].form * s.sample(column, shift) for column in forms.T]
        return np.column_stack([0.5 * bars[k].gain_uncertainty * s.mean, *columns])

    return _of_tests(problem, problem.map(by_piece), problem.whiten_tests(problem.map(of_all)))


def _of_tests(problem: Problem, own: Sequence[np.ndarray], of_all: np.ndarray | None = None) -> Design:
    """Errors of ball-bar tests: those of each test (m, k), and those of all, whitened but for what tests share."""
    ends = np.cumsum([0, *(o.shape[1] for o in own)])
    blocks = [(np.arange(a, b), o) for a, b, o in zip(ends[:-1], ends[1:], own, strict=True)]
    return Design(blocks, int(ends[-1]), of_all, problem.shared)


def following(fit: Fit) -> dict[str, list[tuple[str, float]]]:
    """Axes of a model that follow each sensor, with their sizes in m/K."""
    out: dict[str, list[tuple[str, float]]] = {}
    for e in fit.machine.effects:
        if e.follows_sensor(e.subject) and not e.is_neutral:
            size = next(e.si(p.name) for p in e.parameters_of(e.subject) if p.leading)
            out.setdefault(e.values["sensor"], []).append((e.subject, size))
    return out


def temperatures_of_bar(problem: Problem, fit: Fit) -> Design | None:
    """What errors of the temperatures make of ball-bar tests, whitened, one standard deviation a column; ``None`` where
    the model follows no sensor.
    """
    sensors, t = following(fit), fit.machine.temperatures
    if t is None or not sensors:
        return None

    def one(k: int) -> np.ndarray:
        s, axes, chain = problem.samples[k], problem.sensitivity[k].axes, problem.chain
        clock, shift = problem.tests[k].started + GRID * np.arange(len(axes)), problem.shift(k, fit.nuisance)
        columns = []
        for sensor, moved in sensors.items():
            way = sum(size * axes[:, chain.index(axis)] for axis, size in moved)
            columns += [s.sample(way * w, shift) for w in t.uncertainty(sensor) * t.weights(sensor, clock).T]
        return problem.whiten_test(k, np.column_stack(columns))

    return _of_tests(problem, problem.map(one))


def with_instrument(problem: Problem, fit: Fit) -> Fit:
    """A finished fit, whitened by these data, whose covariance has the errors of the ball bar and the temperatures."""
    fit = consider(fit, INSTRUMENT, errors_of_bar(problem, fit))
    temperatures = temperatures_of_bar(problem, fit)
    return fit if temperatures is None else consider(fit, TEMPERATURE, temperatures)


def consider(fit: Fit, name: str, errors: Design | np.ndarray) -> Fit:
    """A finished fit whose covariance has further errors.

    Args:
        fit: Whitened as the errors are.
        name: Of what they are from.
        errors: One standard deviation a column, (count, k).
    """
    cross = fit.design.T @ errors
    moves = fit.linear.solve(cross)
    known = (errors.T @ errors - cross.T @ moves) / fit.linear.weight
    values, vectors = np.linalg.eigh(0.5 * (known + known.T))
    columns = moves @ (vectors / np.sqrt(1.0 + np.maximum(values, 0.0)))  # rounding may leave less than nothing
    return replace(fit, considered={**fit.considered, name: columns})


class Alternative(Protocol):
    """A model with something else in the place of a finding."""

    @property
    def fit(self) -> Fit: ...
    @property
    def evidence(self) -> float: ...


def with_choice(fit: Fit, rivals_of: Mapping[str, Sequence[tuple[str, Alternative]]], evidence: float) -> Fit:
    """A finished fit that knows of other models; arguments as of :func:`moves_of_models`."""
    return replace(fit, considered={**fit.considered, CHOICE: moves_of_models(fit, rivals_of, evidence)})


def moves_of_models(
    fit: Fit, rivals_of: Mapping[str, Sequence[tuple[str, Alternative]]], evidence: float
) -> np.ndarray:
    """How the vector of a fit moves with models that have something else in the place of a finding, (p, k): the sum of
    the columns' squares is the covariance of the mixture around its mean.

    A finding has no number in a model without it: how sure it is, is what its probability says. A model may also have
    the same effect from another seed: with a Stribeck peak and without one, friction has two numbers.

    Args:
        fit: The model.
        rivals_of: The others and the ids of what they have instead, by the finding's key.
        evidence: Log evidence of the model.
    """
    columns = [np.zeros((fit.parameters.size, 0))]
    for rivals in rivals_of.values():
        logs = np.array([0.0, *(m.evidence - evidence for _, m in rivals)])
        share = np.exp(logs - np.logaddexp.reduce(logs))
        moves = np.zeros((len(logs), fit.parameters.size))
        moves[1:] = [move_to(fit, m.fit) for _, m in rivals]
        kept = (share > _LEAST) | (np.arange(len(share)) == 0)
        moves, share = moves[kept], share[kept] / share[kept].sum()
        columns.append((moves - share @ moves).T * np.sqrt(share))
    found = np.hstack(columns)
    return found[:, np.abs(found).max(axis=0, initial=0.0) > 0.0]


def move_to(fit: Fit, other: Fit) -> np.ndarray:
    """How the vector of a fit moves to the values of another one of the same data, (p,); zero where that has none."""
    theirs = {f.effect.key: f.effect for f in other.effects}
    values = other.parameters.split(other.vector)
    for f in fit.effects:
        if f.effect.key in theirs:
            values[f.block.name] = f.with_effect(theirs[f.effect.key]).vector
    out = np.zeros(fit.parameters.size)
    for name, own in fit.parameters.split(fit.vector).items():
        if len(values.get(name, ())) == len(own):
            out[fit.parameters[name]] = values[name] - own
    return out
