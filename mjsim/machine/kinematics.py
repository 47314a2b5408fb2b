"""Kinematic reference of a machine, written from the equations (not from the MJCF).

It is the oracle that MuJoCo's site distance is tested against, and the fast path that the diagnosis searches with.
Sources: Kato, Tsutsumi, Sato 2013, eq. A.9; location errors of the rotary axes as in ISO 230-7 and ISO 230-1, composed
as documented in ``docs/theory.md``.

Frames: with all axes at 0, work frame and machine frame coincide and the spindle ball is at their origin. A rotary
table's centreline passes through it unless it is offset. Axis positions are arrays ``q`` of shape (n, axes) in the
chain's order, m and rad; more columns, where present, are error motions
(:attr:`mjsim.machine.chain.Chain.columns`).

Linear axes that stand on no rotary axis add up to one vector, whichever side they are on. So the spindle ball's
place is that vector plus what the head does, relative to what the table does.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mjsim.machine.chain import COORDINATES, Axis, Chain, ErrorMotion


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

    def slide(self, chain: Chain, letter: str) -> np.ndarray:
        """Direction (3,) of a linear axis: its unit vector, and what squareness adds to it."""
        direction = chain.axis(letter).direction
        for error in chain.squareness:
            if error.axis == letter:
                direction[error.along] += error.sign * self.squareness.get(error.name, 0.0)
        return direction


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


def turn_about(axis: Axis, vector: list, angle: np.ndarray) -> list:
    """Vectors [x, y, z], (n,) each, turned by ``angle`` (n,) rad about the direction of a rotary axis."""
    if not axis.tilted:
        return _turned(vector, axis.along, axis.ccw * angle)
    (a, b, c), (x, y, z) = axis.unit, vector  # Rodrigues
    cos, sin = np.cos(angle), np.sin(angle)
    along = (a * x + b * y + c * z) * (1.0 - cos)
    return [
        cos * x + sin * (b * z - c * y) + a * along,
        cos * y + sin * (c * x - a * z) + b * along,
        cos * z + sin * (a * y - b * x) + c * along,
    ]


def _coordinates(points: np.ndarray, n: int) -> list[np.ndarray]:
    """x, y, z, (n,) each, of points (n, 3) or one point (3,)."""
    return list(np.broadcast_to(np.asarray(points, float), (n, 3)).T)


def work_side(chain: Chain) -> tuple[Axis, ...]:
    """Axes that turn the workpiece, and linear ones on top of these, from the workpiece to the bed."""
    return tuple(a for a in chain.work if a.rotary or a.letter in chain.carried)


def tool_side(chain: Chain) -> tuple[Axis, ...]:
    """Axes that turn the tool, and linear ones on top of these, from the tool to the bed."""
    return tuple(a for a in reversed(chain.tool) if a.rotary or a.letter in chain.carried)


def work_to_machine(chain: Chain, q: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Machine coordinates of work-frame points; eq. A.9 for the paper's machine.

    Args:
        chain: the machine's axes.
        q: (n, axes) axis positions, m and rad; what turns the workpiece counts, and what stands on that.
        points: (n, 3) or (3,) in the work frame, m.

    Returns:
        (n, 3) m.

    >>> from mjsim.machine.chain import FIVE_AXIS
    >>> quarter = np.array([[0, 0, 0, 0, np.pi / 2]])  # the table turned by 90°
    >>> work_to_machine(FIVE_AXIS, quarter, [0.1, 0.0, 0.155]).round(6).tolist()
    [[0.0, 0.1, 0.155]]
    """
    return carried_by(chain, work_side(chain), q, points, -1.0)


def carried_by(chain: Chain, side: tuple[Axis, ...], q: np.ndarray, points: np.ndarray, sign: float) -> np.ndarray:
    """Points (n, 3) or (3,) of the far end of a ``side`` where its axes carry them, (n, 3) m."""
    p = _coordinates(points, len(q))
    for axis in side:
        at = q[:, chain.index(axis.letter)]
        if axis.rotary:
            p = turn_about(axis, [x - c for x, c in zip(p, axis.point, strict=True)], at)
            p = [x + c for x, c in zip(p, axis.point, strict=True)]
        else:
            p = [x + sign * at * u for x, u in zip(p, axis.unit, strict=True)]
    return np.column_stack(p)


def machine_to_work(chain: Chain, q: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Inverse of :func:`work_to_machine`: work coordinates (n, 3) of machine ``points`` (n, 3), m."""
    p = _coordinates(points, len(q))
    for axis in reversed(work_side(chain)):
        at = q[:, chain.index(axis.letter)]
        if axis.rotary:
            p = turn_about(axis, [x - c for x, c in zip(p, axis.point, strict=True)], -at)
            p = [x + c for x, c in zip(p, axis.point, strict=True)]
        else:
            p = [x + at * u for x, u in zip(p, axis.unit, strict=True)]
    return np.column_stack(p)


def grounded(chain: Chain, q: np.ndarray) -> np.ndarray:
    """Sum of the linear axes that stand on no rotary axis, (n, 3) m."""
    if not chain.carried:
        return q[:, chain.linear_columns].copy()
    out = q[:, chain.linear_columns].copy()
    out[:, [chain.index(a) for a in chain.carried]] = 0.0
    return out


def spindle_in_work(chain: Chain, q: np.ndarray) -> np.ndarray:
    """The spindle ball of the ideal machine in the work frame.

    Args:
        chain: the machine's axes.
        q: (n, axes) axis positions, m and rad.

    Returns:
        (n, 3) m.
    """
    spindle = grounded(chain, q)
    if chain.swivelling:
        spindle += carried_by(chain, tool_side(chain), q, np.zeros(3), 1.0)
    return machine_to_work(chain, q, spindle)


def tool_direction(chain: Chain, q: np.ndarray) -> np.ndarray:
    """Direction from the tool's tip to the spindle in the work frame of the ideal machine, (n, 3)."""
    d = _coordinates(np.array([0.0, 0.0, 1.0]), len(q))
    for axis in chain.swivelling:
        d = turn_about(axis, d, q[:, chain.index(axis.letter)])
    for axis in reversed(chain.turning):
        d = turn_about(axis, d, -q[:, chain.index(axis.letter)])
    return np.column_stack(d)


def table_ball(chain: Chain, q: np.ndarray, point: np.ndarray, geometry: Geometry | None = None) -> np.ndarray:
    """Table-ball centre relative to the spindle ball at X = Y = Z = 0, with all location errors and error motions.

    Each rotary axis turns the point about its centreline; then its location errors act, ``R p + shift``. Its error
    motion acts between: displacement, then tilt about both coordinates, the first one outermost. A linear axis turns
    the point about its functional point, which its angular errors leave in place, and then moves it.

    Args:
        chain: the machine's axes.
        q: (n, axes) axis positions, or with error motions behind, m and rad.
        point: (3,) table-ball centre in the work frame, m.
        geometry: location errors and squareness; ``None`` is the ideal machine.

    Returns:
        (n, 3) m.
    """
    side = chain.work if chain.slides_turn(q.shape[1]) else work_side(chain)
    return carried_really(chain, side, q, point, geometry, -1.0)


def spindle_ball(
    chain: Chain, q: np.ndarray, geometry: Geometry | None = None, tip: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> np.ndarray:
    """Spindle-ball centre, as :func:`table_ball`, (n, 3) m; linear axes on the table's side count as if they were here,
    unless there are angular errors.

    Args:
        chain: the machine's axes.
        q: (n, axes) axis positions, or with error motions behind, m and rad.
        geometry: location errors and squareness; ``None`` is the ideal machine.
        tip: where the tool's tip is instead, seen from the spindle ball with all axes at 0, m.
    """
    if chain.slides_turn(q.shape[1]):
        return carried_really(chain, chain.tool[::-1], q, np.array(tip), geometry, 1.0)
    spindle = grounded(chain, q)
    angles = geometry.squareness if geometry is not None else {}
    for error in chain.squareness if angles else ():
        if error.axis not in chain.carried:
            spindle[:, error.along] += error.sign * angles.get(error.name, 0.0) * q[:, chain.index(error.axis)]
    for motion in _present(chain, q):
        if motion.axis in chain.linear and motion.axis not in chain.carried:
            spindle[:, motion.along] += q[:, chain.columns.index(motion.name)]
    if chain.swivelling:
        return spindle + carried_really(chain, tool_side(chain), q, np.array(tip), geometry, 1.0)
    return spindle + np.array(tip) if any(tip) else spindle


def _present(chain: Chain, q: np.ndarray) -> tuple[ErrorMotion, ...]:
    """Error motions that have a column in ``q``."""
    return chain.motions[: q.shape[1] - chain.count]


def carried_really(
    chain: Chain, side: tuple[Axis, ...], q: np.ndarray, point: np.ndarray, geometry: Geometry | None, sign: float
) -> np.ndarray:
    """A point of the far end of a ``side`` where its axes carry it with all their errors, (n, 3) m."""
    p = _coordinates(point, len(q))
    motions = _present(chain, q)
    for axis in side:
        mine = [m for m in motions if m.axis == axis.letter]
        at = q[:, chain.index(axis.letter)]
        by = {m.name: q[:, chain.columns.index(m.name)] for m in mine}
        if not axis.rotary:
            if turns := [m for m in mine if m.rotation]:
                centre = chain.functional_point(axis.letter)
                p = _moved(axis, [x - c for x, c in zip(p, centre, strict=True)], turns, by)
                p = [x + c for x, c in zip(p, centre, strict=True)]
            direction = axis.direction if geometry is None else geometry.slide(chain, axis.letter)
            p = [x + sign * at * u for x, u in zip(p, direction, strict=True)]
            for m in mine:
                if not m.rotation:
                    p[m.along] = p[m.along] + sign * by[m.name]
            continue
        p = turn_about(axis, [x - c for x, c in zip(p, axis.point, strict=True)], at)
        if mine:
            p = _moved(axis, p, mine, by)
        if geometry is not None and geometry.location:
            shift, turn = geometry.displacement(chain, axis.letter)
            p = list((np.column_stack(p) @ turn.T + shift).T)
        p = [x + c for x, c in zip(p, axis.point, strict=True)]
    return np.column_stack(p)


def _moved(axis: Axis, point: list, motions: list[ErrorMotion], by: dict[str, np.ndarray]) -> list:
    """A point behind an ``axis`` after its error motion ``by`` name, (n,) m or rad: displacements, then tilts, the one
    about the first coordinate outermost.
    """
    p = list(point)
    for m in motions:
        if m.axial:
            p = [x + by[m.name] * u for x, u in zip(p, axis.centreline, strict=True)]
        elif not m.rotation:
            p[m.along] = p[m.along] + by[m.name]
    for m in reversed(motions):
        if m.rotation:
            p = _turned(p, m.along, by[m.name])
    return p


def bar_vector(
    chain: Chain,
    q: np.ndarray,
    point: np.ndarray,
    geometry: Geometry | None = None,
    tip: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """Vector from the table ball to the spindle ball in machine axes.

    Args:
        chain: the machine's axes.
        q: (n, axes) axis positions on the load side, or with error motions behind, m and rad.
        point: (3,) or (n, 3) table-ball centre in the work frame while the rotary axes are at 0, m.
        geometry: location errors and squareness; ``None`` is the ideal machine.
        tip: as :func:`spindle_ball`.

    Returns:
        (n, 3) m.
    """
    return spindle_ball(chain, q, geometry, tip) - table_ball(chain, q, point, geometry)


def reading(
    chain: Chain,
    q: np.ndarray,
    point: np.ndarray,
    length: float,
    geometry: Geometry | None = None,
    component: str = "",
) -> np.ndarray:
    """Ball-bar reading ``|OS − OT| − L``, positive outward, (n,) m; arguments as :func:`bar_vector`, and the bar's
    length, m. With a ``component`` (X, Y or Z) that coordinate of ``OT − OS`` instead, which one sensor of an R-test
    reads.
    """
    bar = bar_vector(chain, q, point, geometry)
    return bar @ read_along(component) if component else np.linalg.norm(bar, axis=1) - length


def read_along(component: str) -> np.ndarray:
    """What a sensor along a coordinate makes of the vector from the table ball to the spindle ball, (3,); zero where
    there is none.
    """
    return np.array([-1.0 if c == component else 0.0 for c in COORDINATES])


# -- first derivatives of the ball-bar reading of the ideal machine along a motion -------------------------------------


@dataclass(frozen=True)
class BarSensitivity:
    """First derivatives of the reading along a motion.

    Attributes:
        axes: (n, axes) per axis position, m/m and m/rad.
        spindle: (n, 3) per spindle-ball offset in the spindle's frame, which is parallel to the machine's axes while
            no head turns, m/m.
        table: (n, 3) per table-ball offset in the work frame, m/m.
    """

    axes: np.ndarray
    spindle: np.ndarray
    table: np.ndarray


def sensitivity(chain: Chain, q: np.ndarray, point: np.ndarray, component: str = "") -> BarSensitivity:
    """Derivatives of the ideal machine's reading.

    Args:
        chain: the machine's axes.
        q: (n, axes) axis positions, m and rad.
        point: (3,) table-ball centre in the work frame, m.
        component: Coordinate that is read; empty: the distance of the balls.
    """
    if component:
        unit = np.broadcast_to(read_along(component), (len(q), 3))
    else:
        bar = bar_vector(chain, q, point)
        unit = bar / np.linalg.norm(bar, axis=1)[:, None]
    axes = np.zeros((len(q), chain.count))
    axes[:, chain.linear_columns] = unit
    _per_axis(chain, chain.work, q, point, unit, -1.0, axes)
    _per_axis(chain, tuple(reversed(chain.tool)), q, np.zeros(3), unit, 1.0, axes)
    spindle = _back(chain, chain.swivelling, q, unit) if chain.swivelling else unit
    return BarSensitivity(axes, spindle, -_back(chain, chain.turning, q, unit))


def _per_axis(
    chain: Chain, side: tuple[Axis, ...], q: np.ndarray, point: np.ndarray, unit: np.ndarray, sign: float, out
) -> None:
    """Enter the columns of the axes of one ``side``, from its far end to the bed, that turn or stand on what turns."""
    p = list(np.broadcast_to(np.asarray(point, float), (len(q), 3)).T)
    for number, axis in enumerate(side, start=1):
        at, outer = q[:, chain.index(axis.letter)], [a for a in side[number:] if a.rotary]
        if not axis.rotary:
            if not outer:
                continue
            p = [x + sign * at * u for x, u in zip(p, axis.unit, strict=True)]
            moved = list(np.broadcast_to(sign * axis.direction, (len(q), 3)).T)
        else:
            p = turn_about(axis, [x - c for x, c in zip(p, axis.point, strict=True)], at)
            moved = list(np.cross(axis.direction, np.column_stack(p)).T)
            p = [x + c for x, c in zip(p, axis.point, strict=True)]
        for other in outer:
            moved = turn_about(other, moved, q[:, chain.index(other.letter)])
        out[:, chain.index(axis.letter)] = sign * np.einsum("ni,ni->n", unit, np.column_stack(moved))


def _back(chain: Chain, turning: tuple[Axis, ...], q: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Machine ``vectors`` (n, 3) in the frame behind the rotary axes ``turning``, which go from there to the bed."""
    v = list(vectors.T)
    for axis in reversed(turning):
        v = turn_about(axis, v, -q[:, chain.index(axis.letter)])
    return np.column_stack(v)
