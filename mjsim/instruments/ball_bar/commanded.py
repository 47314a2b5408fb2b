"""The motion that the blocks of an NC program command: straight lines from point to point, each with its duration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.machine.inverse import linear_positions
from mjsim.machine.kinematics import spindle_in_work


@dataclass(frozen=True, eq=False)
class Commanded:
    """Points and block times. All axes of a block move in proportion, as a control interpolates linearly.

    Attributes:
        seconds: (n,) duration of each block by its F, s, above 0.
        points: (n + 1, axes) where the blocks begin and end, m and rad. A point is given in the coordinates of the
            block that ends there, the first one in those of the block that begins there.
        tip: whether the linear axes of ``points`` are the tool tip's in the work frame (tool centre point control),
            which the control turns into axis positions all along a block; otherwise they are axis positions. One answer
            for all blocks, or (n,).
        chain: the machine's axes.
        clocked: whether the times are those of a control that ran, with its own accelerations at the ends.
        cutting: (n,) whether a block is a feed block, and no rapid move or dwell; ``None``: all are.
        stops: (n,) whether the control waits at the end of a block until the axes are there; ``None``: nowhere.
    """

    seconds: np.ndarray
    points: np.ndarray
    tip: bool | np.ndarray = False
    chain: Chain = FIVE_AXIS
    clocked: bool = False
    cutting: np.ndarray | None = None
    stops: np.ndarray | None = None

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
        return self._machine(self.points, self._of_point)

    @property
    def cuts(self) -> np.ndarray:
        """Whether each block is a feed block, (n,)."""
        return np.ones(len(self.seconds), bool) if self.cutting is None else self.cutting

    @property
    def paths(self) -> list[tuple[int, int]]:
        """First and last block of every stretch of feed blocks."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], self.cuts, [False]]).astype(int)))
        return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]

    def part(self, first: int, last: int) -> Commanded:
        """The blocks from ``first`` to ``last``."""
        points, tips = self.points[first : last + 2].copy(), self._tips[first : last + 1]
        points[0] = self._starts[first]
        tip = tips if len(set(tips.tolist())) > 1 else bool(tips[0])
        cutting, stops = (None if x is None else x[first : last + 1] for x in (self.cutting, self.stops))
        return Commanded(self.seconds[first : last + 1], points, tip, self.chain, self.clocked, cutting, stops)

    def at(self, time: np.ndarray) -> np.ndarray:
        """Axis positions (n, axes) m and rad at ``time`` (n,) s of block time, held at both ends."""
        time = np.asarray(time, float)
        if isinstance(self.tip, (bool, np.bool_)):
            columns = [np.interp(time, self.knots, column) for column in self.points.T]
            return self._machine(np.column_stack(columns), np.full(len(time), self.tip))
        block = np.clip(np.searchsorted(self.knots, time, side="right") - 1, 0, len(self.seconds) - 1)
        share = np.clip((time - self.knots[block]) / self.seconds[block], 0.0, 1.0)[:, None]
        start = self._starts[block]
        return self._machine(start + share * (self.points[block + 1] - start), self._tips[block])

    def speeds(self) -> np.ndarray:
        """Mean speed of every axis in every block, (n, axes) m/s and rad/s, signed."""
        return np.diff(self.axes, axis=0) / self.seconds[:, None]

    @property
    def _tips(self) -> np.ndarray:
        return np.broadcast_to(np.asarray(self.tip, bool), (len(self.seconds),))

    @property
    def _of_point(self) -> np.ndarray:
        return np.concatenate([self._tips[:1], self._tips])

    @cached_property
    def _starts(self) -> np.ndarray:
        """Where every block begins, in its own coordinates, (n, axes)."""
        out = self.points[:-1].copy()
        switched = np.flatnonzero(self._of_point[:-1] != self._tips)
        if len(switched):
            q, linear = self.axes[switched], self.chain.linear_columns
            out[switched] = q
            tip = self._tips[switched]
            if tip.any():
                out[switched[tip], linear] = spindle_in_work(self.chain, q[tip])
        return out

    def _machine(self, points: np.ndarray, tip: np.ndarray) -> np.ndarray:
        """Axis positions of points, of which those with ``tip`` have the tip's coordinates."""
        if not tip.any():
            return points
        out, linear = points.copy(), self.chain.linear_columns
        out[tip, linear] = linear_positions(self.chain, points[tip], points[tip, linear])
        return out
