"""Circular test of two linear axes (ISO 230-4)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mjsim.ballbar.kinds.base import DIRECTION, REVOLUTIONS, Key, Kind, register
from mjsim.ballbar.measurement import BallBarTest
from mjsim.machine.chain import Chain


@register
class Circular(Kind):
    """A circle in the plane of two linear axes, φ counting from the first to the second."""

    name = "circular"
    keys = (Key("plane", "plane", words=lambda chain: chain.planes, help="Its plane."), DIRECTION, REVOLUTIONS)

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

    def plane(self, test: BallBarTest) -> str:
        return test.plane

    def short_name(self, test: BallBarTest) -> str:
        return f"circle-{test.plane.lower()}-{test.direction.lower()}"

    def proposals(self, chain: Chain, length: float, height: float) -> Iterator[BallBarTest]:
        for plane in chain.planes:
            yield BallBarTest("", self.name, (0.0, 0.0, height), length, 0.0, plane=plane, chain=chain)
