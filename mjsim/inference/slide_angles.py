"""What the readings show where slides turn as they travel: roll, pitch and yaw of a guideway that is not straight.

Every real slide turns by some µrad (ISO 230-1: angular error motion). Over the arm from its functional point to the
balls that is a displacement. It is the same in all tests that pass a place, and differs from test to test with the arm.
A model without it believes locations, straightness and squareness too much, and names one where a slide turns.

A shape is a polynomial of the slide's place (Legendre's, over the travel that the tests cover), and zero where the axis
stands at zero. Whether a machine has such turns, and how large they are, the evidence says
(:mod:`mjsim.inference.discrepancy`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.polynomial import legendre

from mjsim.inference.discrepancy import CommonError
from mjsim.inference.problem import Problem
from mjsim.inference.samples import GRID_STEPS
from mjsim.machine.model import Machine, build
from mjsim.simulation.bar import reading_in

#: Highest degree of the polynomials (assumed: a guideway has no shorter wave than the travel that the tests cover).
_DEGREE = 3
#: Half of the travel on which a slide turns by the unit, m: one that travels less turns less.
_HALF = 0.1
#: Turn by which the readings are derived, rad.
_TURN = 1e-6
#: Turn of an ordinary slide, RMS over 200 mm of travel, rad: what is there of the 60 µrad over 500 mm that ISO 10791-1
#: allows (assumed).
_USUAL = 6e-6


def turns_of_slides(problem: Problem, machine: Machine) -> CommonError:
    """Every shape in which a slide may turn; the size is the RMS turn over 200 mm of travel, rad.

    Args:
        problem: The measured tests.
        machine: As given; what else it has changes nothing here.
    """
    plant, chain = build(replace(machine, effects=())), machine.chain
    axes = problem.map(lambda k: np.ascontiguousarray(problem.motions[k].load(plant, GRID_STEPS)[:, : chain.count]))
    covered = np.vstack(axes)

    def one(k: int) -> np.ndarray:
        q = np.zeros((len(axes[k]), len(chain.columns)))
        q[:, : chain.count] = axes[k]
        still, out = reading_in(problem.tests[k], q, plant.geometry), []
        for letter in chain.linear:
            i = chain.index(letter)
            shapes = _shapes(axes[k][:, i], covered[:, i].min(), covered[:, i].max())
            for m in (m for m in chain.motions if m.axis == letter and m.name in chain.angular):
                turned = q.copy()
                turned[:, chain.columns.index(m.name)] = _TURN
                arm = (reading_in(problem.tests[k], turned, plant.geometry) - still) / _TURN
                out.append(arm[:, None] * shapes)
        return np.hstack(out)

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
