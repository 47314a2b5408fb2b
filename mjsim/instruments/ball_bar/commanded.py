"""The motion that the blocks of an NC program command: straight lines from point to point, each with its duration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.machine.inverse import linear_positions


@dataclass(frozen=True, eq=False)
class Commanded:
    """Points and block times. All axes of a block move in proportion, as a control interpolates linearly.

    Attributes:
        seconds: (n,) duration of each block by its F, s, above 0.
        points: (n + 1, axes) where the blocks begin and end, m and rad.
        tip: whether the linear axes of ``points`` are the tool tip's in the work frame (tool centre point control),
            which the control turns into axis positions all along a block; otherwise they are axis positions.
        chain: the machine's axes.
        clocked: whether the times are those of a control that ran, with its own accelerations at the ends.
    """

    seconds: np.ndarray
    points: np.ndarray
    tip: bool = False
    chain: Chain = FIVE_AXIS
    clocked: bool = False

    @cached_property
    def knots(self) -> np.ndarray:
        """Time at every point, (n + 1,) s, from 0."""
        return np.concatenate([[0.0], np.cumsum(self.seconds)])

    @property
    def duration(self) -> float:
        """Sum of the block times, s: no acceleration at the ends."""
        return float(self.knots[-1])

    @cached_property
    def axes(self) -> np.ndarray:
        """Axis positions at the points, (n + 1, axes) m and rad."""
        return self._machine(self.points)

    def at(self, time: np.ndarray) -> np.ndarray:
        """Axis positions (n, axes) m and rad at ``time`` (n,) s of block time, held at both ends."""
        time = np.asarray(time, float)
        return self._machine(np.column_stack([np.interp(time, self.knots, column) for column in self.points.T]))

    def speeds(self) -> np.ndarray:
        """Mean speed of every axis in every block, (n, axes) m/s and rad/s, signed."""
        return np.diff(self.axes, axis=0) / self.seconds[:, None]

    def _machine(self, points: np.ndarray) -> np.ndarray:
        if not self.tip:
            return points
        linear, rotary = self.chain.linear_columns, self.chain.rotary_columns
        return np.hstack([linear_positions(self.chain, points, points[:, linear]), points[:, rotary]])
