"""Circular test of linear axes (ISO 230-4), in the plane of two of them or in any other plane."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from mjsim.instruments.ball_bar.kinds.base import DIRECTION, REVOLUTIONS, Angle, Key, Kind, number_name, register
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import Chain
from mjsim.units import DEG

_PLANE = Key("plane", "plane", words=lambda chain: chain.planes, help="Its plane.")
_LEAN = Key(
    "lean_deg",
    "lean",
    DEG,
    Annotated[float, Field(ge=-90, le=90)],
    needed=False,
    option="--lean",
    help="The circle leans out of its plane by this angle, ° (default 0).",
)
_LEAN_ABOUT = Key(
    "lean_about_deg",
    "lean_about",
    DEG,
    Angle,
    needed=False,
    option="--lean-about",
    help="Angle φ of the diameter about which it leans, ° (default 0).",
)

#: Lean of the circles that a plan looks at, rad: the spindle stays clear of the table (assumed).
_PLANNED_LEAN = 15.0 * DEG


@register
class Circular(Kind):
    """A circle in the plane of two linear axes, φ counting from the first to the second; or one that leans out of this
    plane, about one of its diameters.
    """

    name = "circular"
    keys = (_PLANE, _LEAN, _LEAN_ABOUT, DIRECTION, REVOLUTIONS)

    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        q = np.zeros((len(phi), test.chain.count))
        q[:, test.chain.linear_columns] = test.table_ball
        if _leans(test):
            first, second = _sides(test)
            q[:, test.chain.linear_columns] += test.length * (
                np.outer(np.cos(phi), first) + np.outer(np.sin(phi), second)
            )
            return q
        first, second = map(test.chain.index, test.plane)
        q[:, first] += test.length * np.cos(phi)
        q[:, second] += test.length * np.sin(phi)
        return q

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        away = q[:, test.chain.linear_columns] - test.table_ball
        if _leans(test):
            first, second = _sides(test)
            return np.arctan2(away @ second, away @ first)
        first, second = map(test.chain.index, test.plane)
        return np.arctan2(away[:, second], away[:, first])

    def wrong(self, test: BallBarTest) -> str:
        if "lean_about" in test.more and not _leans(test):
            return "lean_about_deg without a lean_deg; allowed: both, or neither"
        return ""

    def words(self, test: BallBarTest) -> str:
        if _leans(test):
            lean, about = _lean(test)
            return f"circle {test.plane} leaning by {lean / DEG:g}° about φ = {about / DEG:g}°, {test.direction}"
        return f"circle {test.plane}, {test.direction}"

    def plane(self, test: BallBarTest) -> str:
        return "" if _leans(test) else test.plane

    def short_name(self, test: BallBarTest) -> str:
        leaning = "".join(f"-{number_name(v / DEG)}" for v in _lean(test)) if _leans(test) else ""
        return f"circle-{test.plane.lower()}{leaning}-{test.direction.lower()}"

    def proposals(self, chain: Chain, length: float, height: float) -> Iterator[BallBarTest]:
        for plane in chain.planes:
            yield BallBarTest("", self.name, (0.0, 0.0, height), length, 0.0, plane=plane, chain=chain)

    def variations(self, test: BallBarTest) -> Iterator[BallBarTest]:
        if not _leans(test):
            for about in (0.0, 90.0):
                yield replace(test, more={"lean": _PLANNED_LEAN, "lean_about": about * DEG})


def _lean(test: BallBarTest) -> tuple[float, float]:
    """By how much the circle leans, and the angle φ of the diameter about which it does, rad."""
    return float(test.more.get("lean", 0.0)), float(test.more.get("lean_about", 0.0))


def _leans(test: BallBarTest) -> bool:
    return _lean(test)[0] != 0.0


def _sides(test: BallBarTest) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (3,) from the table ball to the circle at φ = 0° and 90°."""
    lean, about = _lean(test)
    flat = np.eye(3)[list(map(test.chain.index, test.plane))]
    # a circle turned about a diameter: what lies along it stays, what lies across it rises
    hinge = np.cos(about) * flat[0] + np.sin(about) * flat[1]
    across = np.cross(np.cross(flat[0], flat[1]), hinge)
    risen = np.cos(lean) * across + np.sin(lean) * np.cross(hinge, across)
    return np.cos(about) * hinge - np.sin(about) * risen, np.sin(about) * hinge + np.cos(about) * risen
