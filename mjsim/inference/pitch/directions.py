"""The directions in which the tangential tests of a campaign turned an axis, and what their arcs allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.inference.problem import Problem
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest

#: Highest number of peaks per turn that is looked for (paper, Fig. 3).
HIGHEST = 800
#: Waves that pass faster than this, per block, are not looked for.
BAND = 0.45


@dataclass(frozen=True)
class TurnDirection:
    """One axis turning in one direction: its tests, and what their arc allows.

    Attributes:
        axis: letter of the rotary axis.
        direction: CW or CCW.
        tests: indices of its tangential tests, the longest arc first.
        teeth: of the worm wheel.
        arc: longest arc measured, rad.
        speed: of the fastest, turns per s.
    """

    axis: str
    direction: str
    tests: tuple[int, ...]
    teeth: float
    arc: float
    speed: float

    @property
    def resolution(self) -> float:
        """Difference of two orders that make one peak more over the arc, per turn."""
        return 2 * np.pi / self.arc

    @property
    def lowest(self) -> float:
        """Order from which on a wave counts as a component; what is slower lies below the tooth order."""
        return self.teeth - self.resolution

    def highest(self, block: float) -> float:
        """Highest order that blocks of ``block`` s still show."""
        return min(float(HIGHEST), BAND / (block * self.speed))


def turn_directions(problem: Problem, axis: str, teeth: float) -> list[TurnDirection]:
    """The directions in which tangential tests of an axis turned it, CW before CCW."""
    out = []
    for direction in ("CW", "CCW"):
        mine = [k for k, t in enumerate(problem.tests) if tangential(t, axis) and kind_of(t).way(t) == direction]
        if not mine:
            continue
        arcs = {k: _arc(problem, k, axis) for k in mine}
        mine.sort(key=lambda k: (-round(arcs[k], 2), problem.tests[k].feed))
        speed = max(arcs[k] / (2 * np.pi * np.ptp(problem.samples[k].centre)) for k in mine)
        out.append(TurnDirection(axis, direction, tuple(mine), teeth, arcs[mine[0]], speed))
    return out


def tangential(test: BallBarTest, axis: str) -> bool:
    """Whether a test measures the axis in the tangential direction."""
    return kind_of(test).turns(test) == axis and test.sensitive == "tangential"


def _arc(problem: Problem, k: int, axis: str) -> float:
    s = problem.samples[k]
    q = problem.motions[k].program.commands(s.centre[s.good])
    return float(np.ptp(q[:, problem.chain.index(axis)]))
