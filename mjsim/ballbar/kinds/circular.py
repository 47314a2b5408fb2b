"""Circular test of two linear axes (ISO 230-4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjsim.ballbar.kinds.base import Kind

if TYPE_CHECKING:
    from mjsim.ballbar.measurement import BallBarTest


class Circular(Kind):
    """A circle in the plane of two linear axes, φ counting from the first to the second."""

    name = "circular"
    needed = ("plane", "direction")

    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        q = np.zeros((len(phi), test.chain.count))
        q[:, test.chain.linear_columns] = test.table_ball
        first, second = map(test.chain.index, test.plane)
        q[:, first] += test.length * np.cos(phi)
        q[:, second] += test.length * np.sin(phi)
        return q

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        first, second = map(test.chain.index, test.plane)
        away = q[:, test.chain.linear_columns] - test.table_ball
        return np.arctan2(away[:, second], away[:, first])

    def words(self, test: BallBarTest) -> str:
        return f"circle {test.plane}, {test.direction}"

    def place(self, test: BallBarTest) -> str:
        return test.plane
