"""Cone-frustum test of five axes (ISO 10791-6; paper's appendix)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjsim.ballbar.kinds.base import Kind
from mjsim.machine.chain import machine_to_work, work_to_machine
from mjsim.units import DEG

if TYPE_CHECKING:
    from mjsim.ballbar.measurement import BallBarTest


def tool_axis(i: np.ndarray, j: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A and C (rad, C unwrapped) that bring the work-frame direction (i, j, k) onto the spindle: eq. A.6 and A.7.

    ``sgn(i)·arccos(j/√(i²+j²))`` is atan2(i, j). Where the direction is the C axis itself C is arbitrary: the neighbour's
    value is kept.
    """
    A = np.arccos(np.clip(k, -1.0, 1.0))
    pole = np.hypot(i, j) < 1e-12
    C = np.arctan2(i, j)
    if pole.any() and not pole.all():
        at = np.flatnonzero(~pole)
        C = C[at[np.searchsorted(at, np.arange(len(C))).clip(0, len(at) - 1)]]
    return A, np.unwrap(C)


class ConeFrustum(Kind):
    name = "cone_frustum"
    needed = ("half_apex_deg", "inclination_deg", "sensitive_direction", "direction")
    directions = ("perpendicular", "parallel")

    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        """Eq. A.1 to A.9."""
        L, theta, beta = test.length, test.half_apex, test.inclination
        if test.sensitive == "perpendicular":
            P = np.stack([L * np.cos(theta) * np.cos(phi), L * np.cos(theta) * np.sin(phi), np.full_like(phi, L * np.sin(theta))], 1)
            apex = np.array([0.0, 0.0, L / np.sin(theta)])
        else:
            P = np.stack([L * np.cos(phi), L * np.sin(phi), np.zeros_like(phi)], 1)
            apex = np.array([0.0, 0.0, L / np.tan(theta)])
        tilt = np.array([[np.cos(beta), 0.0, np.sin(beta)], [0.0, 1.0, 0.0], [-np.sin(beta), 0.0, np.cos(beta)]])
        OT = np.asarray(test.table_ball)
        P, apex = P @ tilt.T + OT, tilt @ apex + OT
        T = apex - P
        T /= np.linalg.norm(T, axis=1)[:, None]
        A, C = tool_axis(*T.T)
        return np.column_stack([work_to_machine(A, C, P), A, C])

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        x, y, z = (machine_to_work(q[:, 3], q[:, 4], q[:, :3]) - test.table_ball).T
        return np.arctan2(y, np.cos(test.inclination) * x - np.sin(test.inclination) * z)  # the circle leans by β about Y

    def radius(self, test: BallBarTest) -> float:
        return test.length * float(np.cos(test.half_apex)) if test.sensitive == "perpendicular" else test.length

    def words(self, test: BallBarTest) -> str:
        return f"cone frustum θ = {test.half_apex / DEG:g}°, β = {test.inclination / DEG:g}°, {test.sensitive}, {test.direction}"
