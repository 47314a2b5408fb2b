"""What the readings show where friction is not the same everywhere: with the way, along the travel, in a turn of the
motor.

Every drive has such friction: a lubricant film, a preload that changes along a guideway, a screw or a bearing that is a
little bent. What is diagnosed has one number for the friction of an axis. A model without the rest takes it for a
torque ripple, for another gain, or for a curve of an unknown cause.

A shape is a factor on the friction level by one function of the motion:

    way       the sign of the axis' motion
    travel    waves of the axis' place that are long beside a turn of the motor, over the travel that the tests cover
    turn      sine and cosine of n turns of the motor

The drive is simulated with them (:mod:`mjsim.simulation.drive` has the level). Friction that changes slowly along the
travel is no more than its level at each reversal.
"""

from __future__ import annotations

from dataclasses import replace

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


def variation_of_friction(problem: Problem, machine: Machine) -> CommonError:
    """Every shape in which the friction of an axis may vary; the size is the RMS share of the friction.

    Args:
        problem: The measured tests.
        machine: Its drives, and their play, say what friction does to the readings.
    """
    linear = Linearisation(problem, machine, np.zeros(0))
    plant = linear.plant
    columns = [i for i, a in enumerate(plant.chain.letters) if plant.axes[a].coulomb]
    covered = {i: (min(q[:, i].min() for q in linear.loads), max(q[:, i].max() for q in linear.loads)) for i in columns}

    def of_axis(k: int, i: int) -> np.ndarray:
        letter, place = plant.chain.letters[i], linear.loads[k][:, i]
        axis = replace(plant.axes[letter], friction_ripple=(0.0, 1.0, 0.0))
        if not problem.motions[k].moves[i]:
            return np.zeros((len(place), _SHAPES))

        def reading(**changed: object) -> np.ndarray:
            drive = replace(axis, **changed)
            return linear.of_drive(k, replace(plant, axes={**plant.axes, letter: drive}), letter)

        given = reading()

        def by(**changed: object) -> np.ndarray:
            return (reading(**changed) - given) / _PART

        low, high = covered[i]
        way = by(asymmetry=axis.asymmetry + _PART)
        level = by(friction_ripple=(_PART, 0.0, 0.5 * np.pi))
        # while the level changes slowly, it is that of the place
        travel = level[:, None] * np.cos(np.pi * np.outer((place - low) / (high - low), _LONG))
        turn = [by(friction_ripple=(_PART, n, phase)) for n in _ORDERS for phase in (0.0, 0.5 * np.pi)]
        each = np.sqrt([_WAY, 2.0 * _TRAVEL / len(_LONG), _TURN / len(_ORDERS)])
        return np.column_stack([each[0] * way, each[1] * travel, *(each[2] * wave for wave in turn)])

    def of_test(k: int) -> np.ndarray:
        return np.hstack([np.zeros((len(linear.loads[k]), 0)), *(of_axis(k, i) for i in columns)])

    return CommonError("friction_varies", _USUAL, problem.map(of_test))
