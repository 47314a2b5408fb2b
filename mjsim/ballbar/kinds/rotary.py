"""One rotary axis turns and the linear axes follow (ISO 10791-6; paper, section 2.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mjsim.ballbar.kinds.base import Kind
from mjsim.machine.kinematics import work_to_machine
from mjsim.units import DEG, MM

if TYPE_CHECKING:
    from mjsim.ballbar.measurement import BallBarTest

#: The table ball must be so far from the axis, m.
_NEAREST = 1e-3


class Rotary(Kind):
    """Its φ is the axis' command from ``start`` to ``stop``: no circle that is gone round, so plots and figures treat it apart."""

    name = "rotary"
    needed = ("axis", "from_deg", "to_deg", "sensitive_direction")
    optional = ()
    directions = ("tangential", "radial", "axial")

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

    def place(self, test: BallBarTest) -> str:
        return test.axis

    def derived(self, given: dict[str, Any]) -> dict[str, Any]:
        return {"direction": "CCW" if given["stop"] > given["start"] else "CW", "revolutions": 1}

    def wrong(self, test: BallBarTest) -> str:
        if test.start == test.stop:
            return f"from_deg and to_deg are both {test.start / DEG:g}; the axis would not turn"
        if self.radius(test) < _NEAREST:
            at = [float(f"{p / MM:.9g}") for p in test.table_ball]
            return f"table_ball_mm = {at} lies on the {test.axis} axis; allowed: at least 1 mm away from it"
        return ""
