"""Cone-frustum test of five axes (ISO 10791-6; paper's appendix)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjsim.ballbar.kinds.base import Kind
from mjsim.machine.kinematics import aim, machine_to_work, work_to_machine
from mjsim.units import DEG

if TYPE_CHECKING:
    from mjsim.ballbar.measurement import BallBarTest


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
        q = aim(test.chain, T)
        q[:, test.chain.linear_columns] = work_to_machine(test.chain, q, P)
        return q

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        x, y, z = (machine_to_work(test.chain, q, q[:, test.chain.linear_columns]) - test.table_ball).T
        return np.arctan2(y, np.cos(test.inclination) * x - np.sin(test.inclination) * z)  # the circle leans by β about Y

    def radius(self, test: BallBarTest) -> float:
        return test.length * float(np.cos(test.half_apex)) if test.sensitive == "perpendicular" else test.length

    def words(self, test: BallBarTest) -> str:
        return f"cone frustum θ = {test.half_apex / DEG:g}°, β = {test.inclination / DEG:g}°, {test.sensitive}, {test.direction}"
