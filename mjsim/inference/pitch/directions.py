"""The directions in which the tangential tests of a campaign turned an axis, and what their arcs allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.inference.problem import Problem
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest


@dataclass(frozen=True)
class TurnDirection:
    """One axis turning in one direction: its tests, and what their arc allows.

    Attributes:
        axis: letter of the rotary axis.
        direction: CW or CCW.
        tests: indices of its tangential tests, the longest arc first.
        teeth: of the worm wheel.
        arc: longest arc measured, rad.
    """

    axis: str
    direction: str
    tests: tuple[int, ...]
    teeth: float
    arc: float

    @property
    def resolution(self) -> float:
        """Difference of two orders that make one peak more over the arc, per turn."""
        return 2 * np.pi / self.arc

    @property
    def lowest(self) -> float:
        """Order up to which a curve is drawn without what is slower: one resolution below the tooth order."""
        return self.teeth - self.resolution


def turn_directions(problem: Problem, axis: str, teeth: float) -> list[TurnDirection]:
    """The directions in which tangential tests of an axis turned it, CW before CCW."""
    out = []
    for direction in ("CW", "CCW"):
        mine = [k for k, t in enumerate(problem.tests) if tangential(t, axis) and kind_of(t).way(t) == direction]
        if not mine:
            continue
        arcs = {k: _arc(problem, k, axis) for k in mine}
        mine.sort(key=lambda k: (-round(arcs[k], 2), problem.tests[k].feed))
        out.append(TurnDirection(axis, direction, tuple(mine), teeth, arcs[mine[0]]))
    return out


def tangential(test: BallBarTest, axis: str) -> bool:
    """Whether a test measures the axis in the tangential direction."""
    return kind_of(test).turns(test) == axis and test.sensitive == "tangential"


def _arc(problem: Problem, k: int, axis: str) -> float:
    s = problem.samples[k]
    q = problem.motions[k].program.commands(s.centre[s.good])
    return float(np.ptp(q[:, problem.chain.index(axis)]))
