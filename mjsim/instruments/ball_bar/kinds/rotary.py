"""One rotary axis turns and the linear axes follow (ISO 10791-6; paper, section 2.3)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mjsim.instruments.ball_bar.kinds.base import FROM, TO, Key, Turn, place_name, register, spindle_name
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import Axis, Chain
from mjsim.machine.inverse import linear_positions
from mjsim.machine.kinematics import turn_about
from mjsim.units import DEG, MM

_AXIS = Key("axis", "axis", words=lambda chain: chain.rotary, help="The axis.")
_WORDS = ("tangential", "radial", "axial")
_SENSITIVE = Key("sensitive_direction", "sensitive", words=_WORDS, option="--sensitive", help="How the bar stands.")

#: The table ball must be so far from the axis, m.
_NEAREST = 1e-3


@register
class Rotary(Turn):
    name = "rotary"
    keys = (_AXIS, FROM, TO, _SENSITIVE)
    moves_on_table = False

    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        OT = np.asarray(test.table_ball)
        turning = test.chain.axis(test.axis)
        axis, across = turning.ccw * turning.direction, _across(test)  # the bar stands where it stands in any sense
        radial = across / np.linalg.norm(across)
        bar = {"radial": radial, "axial": axis, "tangential": np.cross(axis, radial)}[test.sensitive]
        q = np.zeros((len(phi), test.chain.count))
        q[:, test.chain.index(test.axis)] = phi
        away = test.length * bar
        if turning in test.chain.tool:  # the table ball rests, and the bar turns about it with the head
            away = -away if test.sensitive == "radial" else away  # the head is on that side of the spindle ball
            away = np.column_stack(turn_about(turning, list(np.tile(away, (len(phi), 1)).T), phi))
        q[:, test.chain.linear_columns] = linear_positions(test.chain, q, OT + away)
        return q

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        return q[:, test.chain.index(test.axis)]

    def radius(self, test: BallBarTest) -> float:
        away, axis = _across(test), test.chain.axis(test.axis)
        if axis.tilted:
            return float(np.linalg.norm(away))
        first, second = axis.across
        return float(np.hypot(away[first], away[second]))

    def words(self, test: BallBarTest) -> str:
        return f"{test.axis} from {test.start / DEG:g}° to {test.stop / DEG:g}°, {test.component or test.sensitive}"

    def repeats(self, test: BallBarTest) -> bool:
        return abs(test.stop - test.start) > 4 * np.pi - 1e-9

    def turns(self, test: BallBarTest) -> str:
        return test.axis

    def wrong(self, test: BallBarTest) -> str:
        if wrong := super().wrong(test):
            return wrong
        if self.radius(test) >= _NEAREST:
            wrong = self.out_of_reach(test) if test.chain.carried else ""
            return wrong + self.nearest(test) if wrong else ""
        if test.chain.axis(test.axis) in test.chain.tool:
            swivel = [a.letter for a in test.chain.swivelling if not a.vertical]
            return (
                f"axis = {test.axis!r}: the spindle ball lies on this axis, so that turning it moves no ball; allowed: "
                f"{', '.join(swivel) or 'an axis that carries the table'}"
            )
        at = [float(f"{p / MM:.9g}") for p in test.table_ball]
        return f"table_ball_mm = {at} lies on the {test.axis} axis; allowed: at least 1 mm away from it"

    def cannot(self, chain: Chain) -> str:
        return super().cannot(chain) or ("" if chain.rotary else "it turns a rotary axis, and the machine has none")

    def short_name(self, test: BallBarTest) -> str:
        sensitive = "" if test.component else f"{test.sensitive}-"
        return f"rotary-{test.axis.lower()}-{sensitive}{self.way(test).lower()}-{place_name(test)}{spindle_name(test)}"

    def proposals(self, chain: Chain, length: float, height: float) -> Iterator[BallBarTest]:
        turn = {a.letter: _first_turn(chain, a) for a in (*chain.turning, *chain.swivelling)}
        for sensitive in _WORDS:
            for axis, (x, start, stop) in turn.items():
                test = BallBarTest("", self.name, (x, 0.0, height), length, 0.0, revolutions=1, chain=chain)
                test = replace(test, sensitive=sensitive, axis=axis, start=start, stop=stop)
                if not self.wrong(test):
                    yield test


def _across(test: BallBarTest) -> np.ndarray:
    """From the centreline at a right angle to the ball that the axis moves, (3,) m: the table's, or the spindle's where
    the axis swivels the head.
    """
    axis = test.chain.axis(test.axis)
    ball = np.zeros(3) if axis in test.chain.tool else np.asarray(test.table_ball)
    away = ball - axis.centre
    if not axis.tilted:
        return away * (1.0 - np.abs(axis.direction))
    return away - (away @ axis.direction) * axis.direction


def _first_turn(chain: Chain, axis: Axis) -> tuple[float, float, float]:
    """X of the table ball, m, and the ends of the first turn of an axis that a plan looks at, rad."""
    if axis.letter in chain.round_axes:
        return 0.1, 0.0, axis.ccw * 2 * np.pi
    low, high = (-60 * DEG, 60 * DEG) if axis in chain.tool else (-20 * DEG, 90 * DEG)
    return 0.0, axis.ccw * low, axis.ccw * high
