"""Kinematic reference of a machine, written from the equations (not from the MJCF).

It is the oracle that MuJoCo's site distance is tested against, and the fast path that the diagnosis searches with.
Sources: Kato, Tsutsumi, Sato 2013, eq. A.6 to A.9; location errors of the rotary axes as in ISO 230-7 and ISO 230-1,
composed as documented for the effect catalogue (``docs/theory.md``).

Frames: the origin of work and machine frame is where the rotary centrelines intersect while all axes are at 0. Axis
positions are arrays ``q`` of shape (n, axes) in the chain's order, m and rad; four more columns, where present, are the
rotary table's error motion (:attr:`mjsim.machine.chain.Chain.columns`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mjsim.machine.chain import Axis, Chain


@dataclass
class Geometry:
    """Location errors and squareness. All zero is the ideal machine.

    Attributes:
        location: m and rad by the names of :attr:`~mjsim.machine.chain.Chain.location_errors`.
        squareness: rad by the names of :attr:`~mjsim.machine.chain.Chain.squareness`.
    """

    location: dict[str, float] = field(default_factory=dict)
    squareness: dict[str, float] = field(default_factory=dict)

    def displacement(self, chain: Chain, axis: str) -> tuple[np.ndarray, np.ndarray]:
        """Shift (3,) m and rotation (3, 3) of a rotary axis' frame, in the frame that carries it.

        Of the two rotations, the one about the later coordinate is the outer one.
        """
        shift, turn = np.zeros(3), np.eye(3)
        for error in chain.location_errors:
            value = self.location.get(error.name, 0.0)
            if error.axis == axis and error.rotation:
                turn = rotation(error.along, value) @ turn
            elif error.axis == axis:
                shift[error.along] = value
        return shift, turn


def rotation(along: int, angle: float) -> np.ndarray:
    """Rotation matrix (3, 3) by ``angle`` (rad) about coordinate ``along`` (0, 1 or 2)."""
    return np.array(_turned(list(np.eye(3)), along, angle))


def _turned(point: list, along: int, angle: np.ndarray | float) -> list:
    """A point's coordinates [x, y, z], numbers or (n,) each, turned by ``angle`` (rad) about coordinate ``along``."""
    i, j = (along + 1) % 3, (along + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    out = list(point)
    out[i], out[j] = c * point[i] - s * point[j], s * point[i] + c * point[j]
    return out


def _coordinates(points: np.ndarray, n: int) -> list[np.ndarray]:
    """x, y, z, (n,) each, of points (n, 3) or one point (3,)."""
    return list(np.broadcast_to(np.asarray(points, float), (n, 3)).T)


def work_to_machine(chain: Chain, q: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Machine coordinates of work-frame points; eq. A.9 for the paper's machine.

    Args:
        chain: the machine's axes.
        q: (n, axes) axis positions; the rotary ones count, rad.
        points: (n, 3) or (3,) in the work frame, m.

    Returns:
        (n, 3) m.

    >>> from mjsim.machine.chain import FIVE_AXIS
    >>> quarter = np.array([[0, 0, 0, 0, np.pi / 2]])  # the table turned by 90°
    >>> work_to_machine(FIVE_AXIS, quarter, [0.1, 0.0, 0.155]).round(6).tolist()
    [[0.0, 0.1, 0.155]]
    """
    p = _coordinates(points, len(q))
    for axis in chain.turning:
        p = _turned(p, axis.along, q[:, chain.index(axis.letter)])
    return np.column_stack(p)


def machine_to_work(chain: Chain, q: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Inverse of :func:`work_to_machine`: work coordinates (n, 3) of machine ``points`` (n, 3), m."""
    p = _coordinates(points, len(q))
    for axis in reversed(chain.turning):
        p = _turned(p, axis.along, -q[:, chain.index(axis.letter)])
    return np.column_stack(p)


def aim(chain: Chain, direction: np.ndarray) -> np.ndarray:
    """Rotary positions that bring work-frame directions onto the spindle; eq. A.6 and A.7 for the paper's machine.

    The table turns the direction into the plane that the tilting axis sweeps; the tilting axis, whose angle is never
    negative, then raises it. Where the direction is the table's axis, the table's position is arbitrary: the
    neighbour's value is kept.

    Args:
        chain: the machine's axes.
        direction: (n, 3) unit vectors.

    Returns:
        (n, axes) axis positions, rad; the linear ones are 0, the table's are continuous.
    """
    x, y, z = np.asarray(direction, float).T
    # what tilts upwards lies horizontally at a right angle to the tilting axis: vertical × tilting axis
    ahead = np.cross([0.0, 0.0, 1.0], chain.axis(chain.tilt_axis).direction)
    table = np.arctan2(ahead[1] * x, ahead[1] * y) if ahead[1] else np.arctan2(-ahead[0] * y, ahead[0] * x)
    pole = np.hypot(x, y) < 1e-12
    if pole.any() and not pole.all():
        at = np.flatnonzero(~pole)
        table = table[at[np.searchsorted(at, np.arange(len(table))).clip(0, len(at) - 1)]]
    q = np.zeros((len(x), chain.count))
    q[:, chain.index(chain.tilt_axis)] = np.arccos(np.clip(z, -1.0, 1.0))
    q[:, chain.index(chain.table_axis)] = np.unwrap(table)
    return q


def table_ball(chain: Chain, q: np.ndarray, point: np.ndarray, geometry: Geometry | None = None) -> np.ndarray:
    """Table-ball centre relative to the spindle ball at X = Y = Z = 0, with all location errors and table motions.

    Each rotary axis turns the point; then its location errors act, ``R p + shift``. The table's error motion acts
    between: displacement, then tilt about both coordinates, the first one outermost.

    Args:
        chain: the machine's axes.
        q: (n, axes) axis positions, or with the table's error motion behind, m and rad.
        point: (3,) table-ball centre in the work frame, m.
        geometry: location errors; ``None`` is the ideal machine.

    Returns:
        (n, 3) m.
    """
    p = _coordinates(point, len(q))
    for axis in chain.turning:
        p = _turned(p, axis.along, q[:, chain.index(axis.letter)])
        if axis.letter == chain.table_axis and q.shape[1] > chain.count:
            p = _moved(p, axis, q[:, chain.count :])
        if geometry is not None and geometry.location:
            shift, turn = geometry.displacement(chain, axis.letter)
            p = list((np.column_stack(p) @ turn.T + shift).T)
    return np.column_stack(p)


def _moved(point: list, axis: Axis, motion: np.ndarray) -> list:
    """A point on the rotary table after the table's error ``motion``, (n, 4): displacements m, tilts rad."""
    first, second = axis.across
    p = list(point)
    p[first], p[second] = p[first] + motion[:, 0], p[second] + motion[:, 1]
    return _turned(_turned(p, second, motion[:, 3]), first, motion[:, 2])


def bar_vector(chain: Chain, q: np.ndarray, point: np.ndarray, geometry: Geometry | None = None) -> np.ndarray:
    """Vector from the table ball to the spindle ball in machine axes.

    Args:
        chain: the machine's axes.
        q: (n, axes) axis positions on the load side, or with the table's error motion behind, m and rad.
        point: (3,) table-ball centre in the work frame while the rotary axes are at 0, m.
        geometry: location errors and squareness; ``None`` is the ideal machine.

    Returns:
        (n, 3) m.
    """
    spindle = q[:, chain.linear_columns].copy()
    angles = geometry.squareness if geometry is not None else {}
    for error in chain.squareness if angles else ():
        spindle[:, error.along] += error.sign * angles.get(error.name, 0.0) * q[:, chain.index(error.axis)]
    return spindle - table_ball(chain, q, point, geometry)


def reading(
    chain: Chain, q: np.ndarray, point: np.ndarray, length: float, geometry: Geometry | None = None
) -> np.ndarray:
    """Ball-bar reading ``|OS − OT| − L``, positive outward, (n,) m; arguments as :func:`bar_vector`, and the bar's
    length, m.
    """
    return np.linalg.norm(bar_vector(chain, q, point, geometry), axis=1) - length


@dataclass(frozen=True)
class BarSensitivity:
    """First derivatives of the reading along a motion.

    Attributes:
        axes: (n, axes) per axis position, m/m and m/rad.
        spindle: (n, 3) per spindle-ball offset in machine axes, m/m.
        table: (n, 3) per table-ball offset in the work frame, m/m.
    """

    axes: np.ndarray
    spindle: np.ndarray
    table: np.ndarray


def sensitivity(chain: Chain, q: np.ndarray, point: np.ndarray) -> BarSensitivity:
    """Derivatives of the ideal machine's reading.

    Args:
        chain: the machine's axes.
        q: (n, axes) axis positions, m and rad.
        point: (3,) table-ball centre in the work frame, m.
    """
    bar = bar_vector(chain, q, point)
    unit = bar / np.linalg.norm(bar, axis=1)[:, None]
    axes = np.zeros((len(q), chain.count))
    axes[:, chain.linear_columns] = unit
    p = _coordinates(point, len(q))
    for number, axis in enumerate(chain.turning, start=1):
        p = _turned(p, axis.along, q[:, chain.index(axis.letter)])
        per_rad = list(np.cross(axis.direction, np.column_stack(p)).T)
        for outer in chain.turning[number:]:
            per_rad = _turned(per_rad, outer.along, q[:, chain.index(outer.letter)])
        axes[:, chain.index(axis.letter)] = -np.einsum("ni,ni->n", unit, np.column_stack(per_rad))
    return BarSensitivity(axes, unit, -machine_to_work(chain, q, unit))
