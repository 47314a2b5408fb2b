"""One rotary axis turns and the linear axes follow (ISO 10791-6; paper, section 2.3)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mjsim.ballbar.kinds.base import FROM, TO, Arc, Key, place_name, register
from mjsim.ballbar.measurement import BallBarTest
from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import work_to_machine
from mjsim.units import DEG, MM

_AXIS = Key("axis", "axis", words=lambda chain: chain.rotary, help="The axis.")
_WORDS = ("tangential", "radial", "axial")
_SENSITIVE = Key("sensitive_direction", "sensitive", words=_WORDS, option="--sensitive", help="How the bar stands.")

#: The table ball must be so far from the axis, m.
_NEAREST = 1e-3


@register
class Rotary(Arc):
    name = "rotary"
    keys = (_AXIS, FROM, TO, _SENSITIVE)
    moves_on_table = False

    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        OT = np.asarray(test.table_ball)
        axis = test.chain.axis(test.axis).direction
        across = OT * (1.0 - axis)
        radial = across / np.linalg.norm(across)
        bar = {"radial": radial, "axial": axis, "tangential": np.cross(axis, radial)}[test.sensitive]
        q = np.zeros((len(phi), test.chain.count))
        q[:, test.chain.index(test.axis)] = phi
        q[:, test.chain.linear_columns] = work_to_machine(test.chain, q, OT + test.length * bar)
        return q

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        return q[:, test.chain.index(test.axis)]

    def radius(self, test: BallBarTest) -> float:
        first, second = test.chain.axis(test.axis).across
        return float(np.hypot(test.table_ball[first], test.table_ball[second]))

    def words(self, test: BallBarTest) -> str:
        return f"{test.axis} from {test.start / DEG:g}° to {test.stop / DEG:g}°, {test.sensitive}"

    def turns(self, test: BallBarTest) -> str:
        return test.axis

    def wrong(self, test: BallBarTest) -> str:
        if (wrong := super().wrong(test)) or self.radius(test) >= _NEAREST:
            return wrong
        at = [float(f"{p / MM:.9g}") for p in test.table_ball]
        return f"table_ball_mm = {at} lies on the {test.axis} axis; allowed: at least 1 mm away from it"

    def short_name(self, test: BallBarTest) -> str:
        way = "cw" if test.stop < test.start else "ccw"
        return f"rotary-{test.axis.lower()}-{test.sensitive}-{way}-{place_name(test)}"

    def proposals(self, chain: Chain, length: float, height: float) -> Iterator[BallBarTest]:
        turn = {chain.table_axis: (0.1, 0.0, 2 * np.pi), chain.tilt_axis: (0.0, -20 * DEG, 90 * DEG)}
        for sensitive in _WORDS:
            for axis, (x, start, stop) in turn.items():
                test = BallBarTest("", self.name, (x, 0.0, height), length, 0.0, revolutions=1, chain=chain)
                yield replace(test, sensitive=sensitive, axis=axis, start=start, stop=stop)
