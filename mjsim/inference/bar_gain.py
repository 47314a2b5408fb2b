"""What the readings show where a ball bar reads too much or too little: the gain of its sensor.

A bar that nobody has calibrated for long may be off by a percent. All that a machine does by its speed then looks a
percent larger or smaller, the same in all tests, and a model without a gain explains that by a drive. A bar with a
certificate is believed.
"""

from __future__ import annotations

import numpy as np

from mjsim.inference.discrepancy import CommonError
from mjsim.inference.fit import Fit
from mjsim.inference.problem import Problem
from mjsim.instruments.ball_bar.measurement import BallBarData

#: Standard deviation of the gain of a bar without a certificate (assumed).
_USUAL = 0.01


def gain_of_bar(problem: Problem, fit: Fit) -> CommonError:
    """The one shape of a gain, which is what is read; the size is the share by which it is off.

    Args:
        problem: The measured tests.
        fit: Of the machine: what was measured itself would explain its noise.
    """

    def one(k: int) -> np.ndarray:
        bar = problem.campaign.instruments[problem.tests[k].instrument]
        known = not isinstance(bar, BallBarData) or bar.certificate
        return (0.0 if known else 1.0) * (fit.readings[k] + problem.offsets(k, fit.nuisance))[:, None]

    return CommonError("bar_gain", _USUAL, problem.map(one))
