"""Both rotary axes turn and the linear axes follow: tests AK4, BK4 and CK4 of ISO 10791-6, with a ball bar."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.kinds.base import (
    FROM,
    TO,
    Angle,
    Key,
    Turn,
    number_name,
    place_name,
    register,
    spindle_name,
)
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import COORDINATES, Axis, Chain
from mjsim.machine.inverse import linear_positions
from mjsim.units import DEG, MM

_AXIS = Key("axis", "axis", words=lambda chain: chain.rotary, help="The axis.")
_SECOND_FROM = Key(
    "second_from_deg", "second_start", DEG, Angle, option="--second-from", help="The other axis at the start, °."
)
_SECOND_TO = Key("second_to_deg", "second_stop", DEG, Angle, option="--second-to", help="The other axis at the end, °.")
_SENSITIVE = Key(
    "sensitive_direction", "sensitive", words=COORDINATES, option="--sensitive", help="How the bar stands."
)

#: The linear axes must follow by at least this much for each radian, m.
_LEAST = 1e-3
#: The other axis has to turn at least so far, rad; less is a rotary test.
_SECOND_LEAST = 1.0 * DEG
#: Places of a path at which the linear axes' speed is taken.
_LOOKED_AT = 361
#: Step of the derivative there, rad.
_STEP = 1e-5


@register
class Simultaneous(Turn):
    """φ is the command of ``axis``; the other rotary axis turns in proportion. The spindle ball rests in the frame of
    the workpiece, and so does the bar.
    """

    name = "simultaneous"
    keys = (_AXIS, FROM, TO, _SECOND_FROM, _SECOND_TO, _SENSITIVE)
    moves_on_table = False

    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        q = np.zeros((len(phi), test.chain.count))
        q[:, test.chain.index(test.axis)] = phi
        q[:, test.chain.index(_second(test))] = _second_at(test, phi)
        ball = np.array(test.table_ball)
        ball[COORDINATES.index(test.sensitive)] += test.length
        q[:, test.chain.linear_columns] = linear_positions(test.chain, q, ball)
        return q

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        return q[:, test.chain.index(test.axis)]

    def radius(self, test: BallBarTest) -> float:
        """Largest path of the linear axes together for a radian of φ, m: their feed never exceeds that of the test."""
        more = tuple(sorted(test.more.items()))
        return _fastest(
            test.chain, test.axis, test.start, test.stop, test.table_ball, test.length, test.sensitive, more
        )

    def turned(self, test: BallBarTest) -> BallBarTest:
        ends = {"second_start": test.more["second_stop"], "second_stop": test.more["second_start"]}
        return replace(super().turned(test), more={**test.more, **ends})

    def ending(self, test: BallBarTest, stop: float) -> BallBarTest:
        second = float(_second_at(test, np.array([stop]))[0])
        return replace(test, stop=stop, more={**test.more, "second_stop": second})

    def wrong(self, test: BallBarTest) -> str:
        if wrong := super().wrong(test):
            return wrong
        second, start, stop = _second(test), test.more["second_start"], test.more["second_stop"]
        if abs(float(stop) - float(start)) < _SECOND_LEAST:
            return (
                f"second_from_deg and second_to_deg are {abs(float(stop) - float(start)) / DEG:g}° apart; allowed: at "
                f'least {_SECOND_LEAST / DEG:g}°; where {second} rests, the test is of kind "rotary"'
            )
        if wrong := self.out_of_reach(test):
            return wrong + self.nearest(test)
        if self.radius(test) < _LEAST:
            return (
                f"{test.axis} and {second} pass through the spindle ball, so that no linear axis follows; allowed: "
                "a table ball that lies further from them, or another sensitive_direction"
            )
        return ""

    def cannot(self, chain: Chain) -> str:
        if wrong := super().cannot(chain):
            return wrong
        if len(chain.rotary) < 2:
            nearest = f"; nearest possible: rotary, of {chain.rotary[0]} alone" if chain.rotary else ""
            return f"it turns two rotary axes, and the machine has {len(chain.rotary) or 'none'}{nearest}"
        return ""

    def words(self, test: BallBarTest) -> str:
        start, stop = (float(test.more[k]) / DEG for k in ("second_start", "second_stop"))
        seen = test.component or f"bar along {test.sensitive}"
        return (
            f"{test.axis} from {test.start / DEG:g}° to {test.stop / DEG:g}° with {_second(test)} from {start:g}° to "
            f"{stop:g}°, {seen}"
        )

    def short_name(self, test: BallBarTest) -> str:
        axes = f"{test.axis}{_second(test)}".lower()
        turns = test.stop - test.start, float(test.more["second_stop"]) - float(test.more["second_start"])
        ends = "-".join(number_name(round(v / DEG)) for v in turns)
        sensitive = "" if test.component else f"{test.sensitive.lower()}-"
        place = f"{place_name(test)}{spindle_name(test)}"
        return f"simultaneous-{axes}-{ends}-{sensitive}{self.way(test).lower()}-{place}"

    def proposals(self, chain: Chain, length: float, height: float) -> Iterator[BallBarTest]:
        if self.cannot(chain):
            return
        first, second = sorted((chain.axis(a) for a in chain.rotary), key=lambda a: a.letter not in chain.round_axes)
        for sensitive in reversed(COORDINATES):
            start, stop = _usual_turn(chain, first)
            low, high = _usual_turn(chain, second)
            test = BallBarTest("", self.name, (0.1, 0.0, height), length, 0.0, revolutions=1, chain=chain)
            test = replace(test, axis=first.letter, start=start, stop=stop, sensitive=sensitive)
            test = replace(test, more={"second_start": low, "second_stop": high})
            if not self.wrong(test):
                yield test

    def variations(self, test: BallBarTest) -> Iterator[BallBarTest]:
        _, y, z = test.table_ball
        start, stop = test.more["second_start"], test.more["second_stop"]
        other = replace(test, more={**test.more, "second_start": stop, "second_stop": start})
        for one in (
            *(replace(test, sensitive=s) for s in COORDINATES if s != test.sensitive),
            other,
            *(replace(test, table_ball=(x * MM, y, z)) for x in (-100, 50, 150)),
        ):
            if not self.wrong(one):
                yield one


def _second(test: BallBarTest) -> str:
    """Letter of the rotary axis that turns beside the one that the test names."""
    return next(a for a in test.chain.rotary if a != test.axis)


def _second_at(test: BallBarTest, phi: np.ndarray) -> np.ndarray:
    """Position of the other rotary axis at φ, (n,) rad."""
    start, stop = float(test.more["second_start"]), float(test.more["second_stop"])
    return start + (phi - test.start) / (test.stop - test.start) * (stop - start)


@lru_cache(maxsize=256)
def _fastest(chain: Chain, axis: str, start: float, stop: float, ball, length: float, sensitive: str, more) -> float:
    """Largest path of the linear axes for a radian of φ, m."""
    test = BallBarTest("", Simultaneous.name, ball, length, 0.0, chain=chain, axis=axis, start=start, stop=stop)
    test, phi = replace(test, sensitive=sensitive, more=dict(more)), np.linspace(start, stop, _LOOKED_AT)
    try:
        before, after = (Simultaneous().path(test, phi + h)[:, chain.linear_columns] for h in (-_STEP, _STEP))
    except InputError:  # `wrong` says why
        return 0.0
    return float(np.linalg.norm(after - before, axis=1).max()) / (2 * _STEP)


def _usual_turn(chain: Chain, axis: Axis) -> tuple[float, float]:
    """Ends of the turn of an axis that a plan looks at, rad."""
    low, high = (0.0, 360 * DEG) if axis.letter in chain.round_axes else (-20 * DEG, 90 * DEG)
    if axis in chain.tool:
        low, high = (-90 * DEG, 90 * DEG) if axis.vertical else (-60 * DEG, 60 * DEG)
    return axis.ccw * low + 0.0, axis.ccw * high  # no minus before a zero
