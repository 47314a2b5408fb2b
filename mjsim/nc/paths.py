"""Commanded axis positions along each kind of test as a function of its angle φ (paper's appendix; ISO 230-4 for circles)."""

from __future__ import annotations

import numpy as np

from mjsim.campaign.model import Test
from mjsim.kinematics import work_to_machine

#: The two axes of a circular test, φ counting from the first to the second.
PLANES = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0)}


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


def cone_frustum(test: Test, phi: np.ndarray) -> np.ndarray:
    """Axis commands (n, 5) of the cone-frustum test at φ (n,) rad: eq. A.1 to A.9."""
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


def circular(test: Test, phi: np.ndarray) -> np.ndarray:
    """Axis commands (n, 5) of the two-axis circular test of ISO 230-4 at φ (n,) rad."""
    q = np.zeros((len(phi), 5))
    q[:, :3] = test.table_ball
    first, second = PLANES[test.plane]
    q[:, first] += test.length * np.cos(phi)
    q[:, second] += test.length * np.sin(phi)
    return q


def rotary(test: Test, phi: np.ndarray) -> np.ndarray:
    """Axis commands (n, 5) when one rotary axis turns to φ (n,) rad and the linear axes follow (paper, section 2.3)."""
    OT = np.asarray(test.table_ball)
    a, flat = ([0.0, 0.0, 1.0], [1, 1, 0]) if test.axis == "C" else ([1.0, 0.0, 0.0], [0, 1, 1])
    radial = OT * flat / np.linalg.norm(OT * flat)
    bar = {"radial": radial, "axial": np.array(a), "tangential": np.cross(a, radial)}[test.sensitive]
    zero = np.zeros_like(phi)
    A, C = (zero, phi) if test.axis == "C" else (phi, zero)
    return np.column_stack([work_to_machine(A, C, OT + test.length * bar), A, C])


def peripheral_radius(test: Test) -> float:
    """Radius (m) of the circle on which the feed F is programmed."""
    if test.kind == "cone_frustum" and test.sensitive == "perpendicular":
        return test.length * float(np.cos(test.half_apex))
    if test.kind == "rotary":
        x, y, z = test.table_ball
        return float(np.hypot(x, y) if test.axis == "C" else np.hypot(y, z))
    return test.length


PATHS = {"cone_frustum": cone_frustum, "circular": circular, "rotary": rotary}
