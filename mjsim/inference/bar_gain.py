"""What the readings show where a ball bar reads too much or too little: the gain of its sensor.

A bar that nobody has calibrated for long may be off by a percent. All that a machine does by its speed then looks a
percent larger or smaller, the same in all tests, and a model without a gain explains that by a drive. A bar with a
certificate is believed.
"""

from __future__ import annotations

import numpy as np

from mjsim.inference.discrepancy import CommonError
from mjsim.inference.problem import Problem
from mjsim.inference.samples import GRID_STEPS
from mjsim.instruments.ball_bar.measurement import BallBarData
from mjsim.machine.model import Machine, build

#: Standard deviation of the gain of a bar without a certificate (assumed).
_USUAL = 0.01


def gain_of_bar(problem: Problem, machine: Machine) -> CommonError:
    """The one shape of a gain; the size is the share by which it is off.

    It is what the machine as given reads. What a set-up adds to that is a part of every model anyway. A fitted machine
    would bring what its fit lacks, and a measured reading its noise: both explain too much.

    Args:
        problem: The measured tests.
        machine: The machine as given.
    """
    plant = build(machine)

    def one(k: int) -> np.ndarray:
        bar = problem.campaign.instruments[problem.tests[k].instrument]
        if not isinstance(bar, BallBarData) or bar.certificate:
            return np.zeros((len(problem.sensitivity[k].axes), 1))
        return problem.motions[k].reading(plant, GRID_STEPS)[:, None]

    return CommonError("bar_gain", _USUAL, problem.map(one))
