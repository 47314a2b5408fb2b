"""One rotary axis turns and the linear axes follow (ISO 10791-6; paper, section 2.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mjsim.ballbar.kinds.base import Kind
from mjsim.machine.chain import INDEX, work_to_machine
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
        a, flat = ([0.0, 0.0, 1.0], [1, 1, 0]) if test.axis == "C" else ([1.0, 0.0, 0.0], [0, 1, 1])
        radial = OT * flat / np.linalg.norm(OT * flat)
        bar = {"radial": radial, "axial": np.array(a), "tangential": np.cross(a, radial)}[test.sensitive]
        zero = np.zeros_like(phi)
        A, C = (zero, phi) if test.axis == "C" else (phi, zero)
        return np.column_stack([work_to_machine(A, C, OT + test.length * bar), A, C])

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        return q[:, INDEX[test.axis]]

    def radius(self, test: BallBarTest) -> float:
        x, y, z = test.table_ball
        return float(np.hypot(x, y) if test.axis == "C" else np.hypot(y, z))

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
