"""What the readings show where a machine warms and cools while it is measured: its tool drifts against its table.

Every machine drifts by some micrometres in an hour, with its own heat and with the hall's, and seldom as an exponential
(ISO 230-3). A set-up takes up where the balls are, but not how they move while a test runs. It is one drift, on one
clock: tests that follow each other see the same.

A shape is a wave of the campaign's clock, times what the reading shows of a displacement along a linear axis. Waves of
n halves over the campaign have an amplitude of 1/n, as a random walk has. No iron warms and cools within two minutes:
shorter halves are left out.
"""

from __future__ import annotations

import math

import numpy as np

from mjsim.inference.discrepancy import CommonError
from mjsim.inference.problem import Problem
from mjsim.inference.samples import GRID
from mjsim.machine.model import Machine

#: Shortest half wave, s, and most of them over the campaign (assumed).
_SHORTEST, _MOST = 120.0, 12
#: Drift of an ordinary machine, RMS over half an hour in each axis, m (assumed). In less time it is less, as that of a
#: random walk.
_USUAL, _TIME = 2e-6, 1800.0


def drift_of_machine(problem: Problem, machine: Machine) -> CommonError:
    """Every shape in which the tool may drift against the table; the size is the RMS over the campaign, m.

    Args:
        problem: The measured tests.
        machine: Its linear axes.
    """
    chain = machine.chain
    across = [chain.index(a) for a in chain.linear]
    clocks = [
        t.started + GRID * np.arange(len(s.axes)) for t, s in zip(problem.tests, problem.sensitivity, strict=True)
    ]
    first, last = min(c[0] for c in clocks), max(c[-1] for c in clocks)
    span = max(last - first, _SHORTEST)
    halves = np.arange(1, 1 + min(int(span / _SHORTEST), _MOST))
    amplitude = np.sqrt(2.0 / np.sum(halves**-2.0)) / halves

    def one(k: int) -> np.ndarray:
        waves = amplitude * np.cos(np.pi * np.outer((clocks[k] - first) / span, halves))
        shown = problem.sensitivity[k].axes[:, across]
        return (shown[:, :, None] * waves[:, None, :]).reshape(len(waves), -1)

    return CommonError("drift", _USUAL * math.sqrt(span / _TIME), problem.map(one))
