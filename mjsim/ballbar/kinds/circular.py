"""Circular test of two linear axes (ISO 230-4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjsim.ballbar.kinds.base import Kind

if TYPE_CHECKING:
    from mjsim.ballbar.measurement import BallBarTest

#: The two axes of a plane, φ counting from the first to the second.
PLANES = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0)}


class Circular(Kind):
    name = "circular"
    needed = ("plane", "direction")

    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        q = np.zeros((len(phi), 5))
        q[:, :3] = test.table_ball
        first, second = PLANES[test.plane]
        q[:, first] += test.length * np.cos(phi)
        q[:, second] += test.length * np.sin(phi)
        return q

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        first, second = PLANES[test.plane]
        away = q[:, :3] - test.table_ball
        return np.arctan2(away[:, second], away[:, first])

    def words(self, test: BallBarTest) -> str:
        return f"circle {test.plane}, {test.direction}"

    def place(self, test: BallBarTest) -> str:
        return test.plane
