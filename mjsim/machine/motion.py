"""What a plain-Python effect may depend on: the axes' motion with its rates, reversals and motor torques."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Motion:
    """What a plain-Python effect may depend on; arrays over n instants, which cannot be written into.

    Attributes:
        time: s from the program's start, (n,).
        clock: s on the campaign clock, (n,).
        position: load-side axis positions so far, (n, axes) m and rad, in the order of the machine's chain.
        velocity, acceleration: their rates, (n, axes).
        since_reversal: s since each axis last reversed or started to move, (n, axes).
        torque: of each motor, N·m, less what gravity takes, (n, axes): J dω/dt + C ω + friction (paper, Fig. 2).
        axes: letters of the axes, one a column.
        ball: centre of the table ball in the work frame, (3,) m.
    """

    time: np.ndarray
    clock: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    since_reversal: np.ndarray
    torque: np.ndarray
    axes: tuple[str, ...]
    ball: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def column(self, axis: str) -> int:
        """Column of an axis in the arrays."""
        return self.axes.index(axis)
