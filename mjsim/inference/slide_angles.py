"""What the readings show where slides turn as they travel: roll, pitch and yaw of a guideway that is not straight.

Every real slide turns by some µrad (ISO 230-1: angular error motion). Over the arm from its functional point to the
balls that is a displacement. It is the same in all tests that pass a place, and differs from test to test with the arm.
A model without it believes locations, straightness and squareness too much, and names one where a slide turns.

Where its functional point is not known well, a turn also moves what the slide carries: across the axis, where that is a
straightness, and along it.

A shape is a polynomial of the slide's place (Legendre's, over the travel that the tests cover), and zero where the axis
stands at zero. Whether a machine has such turns, and how large they are, the evidence says
(:mod:`mjsim.inference.discrepancy`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.polynomial import legendre

from mjsim.inference.discrepancy import CommonError
from mjsim.inference.linearisation import Linearisation
from mjsim.inference.problem import Problem
from mjsim.machine.model import Machine

#: Highest degree of the polynomials (assumed: a guideway has no shorter wave than the travel that the tests cover).
_DEGREE = 3
#: Half of the travel on which a slide turns by the unit, m: one that travels less turns less.
_HALF = 0.1
#: Turn of an ordinary slide, RMS over 200 mm of travel, rad: what is there of the 60 µrad over 500 mm that ISO 10791-1
#: allows (assumed).
_USUAL = 6e-6
#: How far a slide's functional point may be from where the machine file has it, across the axis, m (assumed).
_ARM = 0.3


def turns_of_slides(problem: Problem, machine: Machine) -> CommonError:
    """Every shape in which a slide may turn; the size is the RMS turn over 200 mm of travel, rad.

    Args:
        problem: The measured tests.
        machine: As given; what else it has changes nothing here.
    """
    linear, chain = Linearisation(problem, replace(machine, effects=()), np.zeros(0)), machine.chain
    covered = np.vstack(linear.loads)
    arms = []
    for a in chain.linear:
        i = chain.index(a)
        arms += [(i, linear.by_motion(chain.columns.index(n))) for n in chain.error_motion(a) if n in chain.angular]
        arms.append((i, [_ARM * s.axes[:, i] for s in problem.sensitivity]))

    def one(k: int) -> np.ndarray:
        places = linear.loads[k]
        return np.hstack(
            [arm[k][:, None] * _shapes(places[:, i], covered[:, i].min(), covered[:, i].max()) for i, arm in arms]
        )

    return CommonError("slide_turns", _USUAL, problem.map(one))


def _shapes(place: np.ndarray, low: float, high: float) -> np.ndarray:
    """Shapes of a turn along a travel from ``low`` to ``high`` at places (n,), m: (n, _DEGREE), zero at the axis' zero.

    All of them together have an RMS of one over the travel, about their mean, where that is 200 mm long.
    """
    half = 0.5 * (high - low)
    if half <= 0.0:
        return np.zeros((len(place), _DEGREE))
    at = np.append(place, np.clip(0.0, low, high))
    values = legendre.legvander((at - 0.5 * (low + high)) / half, _DEGREE)[:, 1:]
    rms = np.sqrt((1.0 / (2.0 * np.arange(1, _DEGREE + 1) + 1.0)).sum())
    return (values[:-1] - values[-1]) * (half / _HALF / rms)
