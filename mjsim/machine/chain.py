"""Kinematic reference of the machine, written from the equations (not from the MJCF).

It is the oracle that MuJoCo's site distance is tested against, and the fast path that the diagnosis searches with.
Sources: Kato, Tsutsumi, Sato 2013, eq. A.9; location errors of the rotary axes as in ISO 230-7 and ISO 230-1, composed
as documented for the effect catalogue (``docs/theory.md``).

Frames: the origin of work and machine frame is where the A and C centrelines intersect at X = Y = Z = A = C = 0.
Axis positions are arrays ``q`` of shape (n, 5) in the order X, Y, Z (m), A, C (rad); four more columns, where present, are the
rotary table's error motion (:data:`COLUMN`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

AXES = ("X", "Y", "Z", "A", "C")
LINEAR = ("X", "Y", "Z")
ROTARY = ("A", "C")
INDEX = {a: i for i, a in enumerate(AXES)}
#: Columns of a motion: the five axes, then the rotary table's error motion in the cradle frame (m, m, rad, rad).
COLUMN = {**INDEX, "EXC": 5, "EYC": 6, "EAC": 7, "EBC": 8}


@dataclass
class Geometry:
    """Location errors and squareness. All zero is the ideal machine.

    ``location`` holds metres and radians under the ISO names EX0C EY0C EA0C EB0C EY0A EZ0A EB0A EC0A;
    ``squareness`` radians under XY YZ ZX.
    """

    location: dict[str, float] = field(default_factory=dict)
    squareness: dict[str, float] = field(default_factory=dict)

    def displacement(self, axis: str) -> tuple[np.ndarray, np.ndarray]:
        """Shift (3,) m and rotation (3, 3) of a rotary axis' frame, in the frame that carries it."""
        e = {k: self.location.get(k, 0.0) for k in ("EX0C", "EY0C", "EA0C", "EB0C", "EY0A", "EZ0A", "EB0A", "EC0A")}
        if axis == "C":
            return np.array([e["EX0C"], e["EY0C"], 0.0]), rotation("y", e["EB0C"]) @ rotation("x", e["EA0C"])
        return np.array([0.0, e["EY0A"], e["EZ0A"]]), rotation("z", e["EC0A"]) @ rotation("y", e["EB0A"])


def rotation(axis: str, angle: np.ndarray | float) -> np.ndarray:
    """Rotation matrices about a coordinate axis: (..., 3, 3) for an angle array of shape (...)."""
    c, s = np.cos(angle), np.sin(angle)
    one, zero = np.ones_like(c), np.zeros_like(c)
    rows = {
        "x": ((one, zero, zero), (zero, c, -s), (zero, s, c)),
        "y": ((c, zero, s), (zero, one, zero), (-s, zero, c)),
        "z": ((c, -s, zero), (s, c, zero), (zero, zero, one)),
    }[axis]
    return np.stack([np.stack(r, axis=-1) for r in rows], axis=-2)


def work_to_machine(A: np.ndarray, C: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Eq. A.9: machine coordinates (n, 3) of work-frame ``points`` (n, 3) or (3,) at A, C (n,) in rad.

    >>> turned = work_to_machine(np.zeros(1), np.full(1, np.pi / 2), [0.1, 0.0, 0.155])  # C by 90°
    >>> turned.round(6).tolist()
    [[0.0, 0.1, 0.155]]
    """
    x, y, z = np.broadcast_arrays(*np.moveaxis(np.asarray(points, float), -1, 0))
    ca, sa, cc, sc = np.cos(A), np.sin(A), np.cos(C), np.sin(C)
    u, v = cc * x - sc * y, sc * x + cc * y
    return np.stack([u + 0 * ca, ca * v - sa * z, sa * v + ca * z], axis=-1)


def machine_to_work(A: np.ndarray, C: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Inverse of :func:`work_to_machine`: work coordinates (n, 3) of machine ``points`` (n, 3) at A, C (n,) in rad."""
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    ca, sa, cc, sc = np.cos(A), np.sin(A), np.cos(C), np.sin(C)
    v = ca * y + sa * z
    return np.stack([cc * x + sc * v, cc * v - sc * x, ca * z - sa * y], axis=-1)


def table_ball(q: np.ndarray, point: np.ndarray, geometry: Geometry | None = None) -> np.ndarray:
    """Table-ball centre relative to the Y slide's frame, (n, 3) m, with all location errors and table motions.

    ``p <- Rz(C) p``; displacement and tilt ``Rx Ry`` of the table's error motion; ``Ry(EB0C) Rx(EA0C) p + (EX0C, EY0C, 0)``;
    ``Rx(A) p``; ``Rz(EC0A) Ry(EB0A) p + (0, EY0A, EZ0A)``.
    """
    A, C = q[:, 3], q[:, 4]
    moving = q.shape[1] > 5
    if not moving and (geometry is None or not geometry.location):
        return work_to_machine(A, C, point)
    location = geometry.location if geometry else {}
    e = {k: location.get(k, 0.0) for k in ("EX0C", "EY0C", "EA0C", "EB0C", "EY0A", "EZ0A", "EB0A", "EC0A")}
    p = np.einsum("nij,j->ni", rotation("z", C), np.asarray(point, float))
    if moving:
        p[:, :2] += q[:, 5:7]
        p = np.einsum("nij,njk,nk->ni", rotation("x", q[:, 7]), rotation("y", q[:, 8]), p)
    p = p @ (rotation("y", e["EB0C"]) @ rotation("x", e["EA0C"])).T + [e["EX0C"], e["EY0C"], 0.0]
    p = np.einsum("nij,nj->ni", rotation("x", A), p)
    return p @ (rotation("z", e["EC0A"]) @ rotation("y", e["EB0A"])).T + [0.0, e["EY0A"], e["EZ0A"]]


def bar_vector(q: np.ndarray, point: np.ndarray, geometry: Geometry | None = None) -> np.ndarray:
    """Vector from the table ball to the spindle ball, (n, 3) m, in machine axes.

    Args:
        q: axis positions (n, 5) on the load side, m and rad.
        point: table-ball centre in the work frame at A = C = 0, m.
        geometry: location errors and squareness; ``None`` is the ideal machine.
    """
    s = q[:, :3]
    if geometry is not None and geometry.squareness:
        sq = geometry.squareness
        s = s + np.stack(
            [
                -sq.get("XY", 0.0) * q[:, 1] + sq.get("ZX", 0.0) * q[:, 2],
                -sq.get("YZ", 0.0) * q[:, 2],
                np.zeros(len(q)),
            ],
            axis=1,
        )
    return s - table_ball(q, point, geometry)


def reading(q: np.ndarray, point: np.ndarray, length: float, geometry: Geometry | None = None) -> np.ndarray:
    """Ball-bar reading ``|OS - OT| - L`` in m, (n,), positive outward."""
    return np.linalg.norm(bar_vector(q, point, geometry), axis=1) - length


@dataclass(frozen=True)
class BarSensitivity:
    """First derivatives of the reading along a motion.

    Attributes:
        axes: (n, 5) per axis position, m/m and m/rad.
        spindle: (n, 3) per spindle-ball offset in machine axes, m/m.
        table: (n, 3) per table-ball offset in the work frame, m/m.
    """

    axes: np.ndarray
    spindle: np.ndarray
    table: np.ndarray


def sensitivity(q: np.ndarray, point: np.ndarray) -> BarSensitivity:
    """Derivatives of the ideal machine's reading at axis positions ``q`` (n, 5)."""
    A, C = q[:, 3], q[:, 4]
    b = bar_vector(q, point)
    u = b / np.linalg.norm(b, axis=1)[:, None]
    ca, sa, cc, sc = np.cos(A), np.sin(A), np.cos(C), np.sin(C)
    p = q[:, :3] - b
    dA = np.stack([np.zeros(len(q)), -p[:, 2], p[:, 1]], axis=1)
    x, y, _ = point
    du, dv = -sc * x - cc * y, cc * x - sc * y
    dC = np.stack([du, ca * dv, sa * dv], axis=1)
    table = -np.stack(
        [
            u[:, 0] * cc + u[:, 1] * ca * sc + u[:, 2] * sa * sc,
            -u[:, 0] * sc + u[:, 1] * ca * cc + u[:, 2] * sa * cc,
            -u[:, 1] * sa + u[:, 2] * ca,
        ],
        axis=1,
    )
    axes = np.column_stack([u, -np.einsum("ni,ni->n", u, dA), -np.einsum("ni,ni->n", u, dC)])
    return BarSensitivity(axes, u, table)
