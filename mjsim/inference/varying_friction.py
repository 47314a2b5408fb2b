"""What the readings show where friction is not the same everywhere: with the way, along the travel, in a turn of the
motor.

Every drive has such friction: a lubricant film, a preload that changes along a guideway, a screw or a bearing that is a
little bent. What is diagnosed has one number for the friction of an axis. A model without the rest takes it for a
torque ripple, for another gain, or for a curve of an unknown cause.

Each axis has a size of its own: one worn screw says nothing about the others. A shape is a factor on the friction level
by one function of the motion:

    way       the sign of the axis' motion
    travel    waves of the axis' place that are long beside a turn of the motor, over the travel that the tests cover
    turn      sine and cosine of n turns of the motor

The drive is simulated with them (:mod:`mjsim.simulation.drive` has the level). Friction that changes slowly along the
travel is no more than its level at each reversal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from mjsim.inference.discrepancy import CommonError
from mjsim.inference.linearisation import Linearisation
from mjsim.inference.problem import Problem
from mjsim.machine.model import Machine

#: Shares of the variance: with the way, along the travel, in a turn of the motor (assumed).
_WAY, _TRAVEL, _TURN = 0.2, 0.4, 0.4
#: Half waves along the travel: the longest eight, each as large as the others (assumed).
_LONG = np.arange(1, 9)
#: Waves in a turn of the motor (assumed: shorter ones leave next to nothing).
_ORDERS = (1.0, 2.0)
#: Shapes of an axis.
_SHAPES = 1 + len(_LONG) + 2 * len(_ORDERS)
#: Share of the friction by which the readings are derived.
_PART = 0.02
#: Share of an ordinary drive's friction by which it varies, RMS (assumed).
_USUAL = 0.2


def variation_of_friction(problem: Problem, machine: Machine) -> Iterator[CommonError]:
    """Every shape in which the friction of each axis may vary; the size is the RMS share of the friction.

    Args:
        problem: The measured tests.
        machine: Its drives, and their play, say what friction does to the readings.
    """
    linear = Linearisation(problem, machine, np.zeros(0))
    plant = linear.plant
    for i, letter in enumerate(plant.chain.letters):
        low, high = min(q[:, i].min() for q in linear.loads), max(q[:, i].max() for q in linear.loads)
        if high == low or not plant.axes[letter].coulomb:
            continue
        shapes = partial(_of_axis, linear, letter, low, high)
        yield CommonError(f"friction_varies.{letter}", _USUAL, problem.map(shapes))


def _of_axis(linear: Linearisation, letter: str, low: float, high: float, k: int) -> np.ndarray:
    """What the shapes of an axis that travels from ``low`` to ``high`` leave in test ``k``, (n, _SHAPES) m."""
    plant, i = linear.plant, linear.plant.chain.index(letter)
    place = linear.loads[k][:, i]
    if not linear.problem.motions[k].moves[i]:
        return np.zeros((len(place), _SHAPES))
    axis = replace(plant.axes[letter], friction_ripple=(0.0, 1.0, 0.0))

    def reading(**changed: object) -> np.ndarray:
        drive = replace(axis, **changed)
        return linear.of_drive(k, replace(plant, axes={**plant.axes, letter: drive}), letter)

    given = reading()

    def by(**changed: object) -> np.ndarray:
        return (reading(**changed) - given) / _PART

    way = by(asymmetry=axis.asymmetry + _PART)
    level = by(friction_ripple=(_PART, 0.0, 0.5 * np.pi))
    # while the level changes slowly, it is that of the place
    travel = level[:, None] * np.cos(np.pi * np.outer((place - low) / (high - low), _LONG))
    turn = [by(friction_ripple=(_PART, n, phase)) for n in _ORDERS for phase in (0.0, 0.5 * np.pi)]
    each = np.sqrt([_WAY, 2.0 * _TRAVEL / len(_LONG), _TURN / len(_ORDERS)])
    return np.column_stack([each[0] * way, each[1] * travel, *(each[2] * wave for wave in turn)])
