"""Centre and direction of each rotary axis from circles through the measured centres, as the cycles of controls print
them.

While one rotary axis turns and the others stand, the centre of the sphere goes round on a circle. Its plane's normal is
the direction of the axis, its centre lies on it. The cycles take the probe for calibrated and the linear axes for
perfect; so squareness and straightness errors go into these numbers (SINUMERIK CYCLE996, HEIDENHAIN KinematicsOpt).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mjsim.instruments.sphere.measurement import Points, SphereTest
from mjsim.machine.kinematics import Geometry, bar_vector
from mjsim.units import DEG

#: Fewest positions of a circle, and the least angle that they span, rad: below that a circle means nothing.
_FEWEST, _SPAN = 3, 30.0 * DEG
#: Step of derivatives, m and rad.
_STEP = 1e-5


@dataclass(frozen=True)
class Circle:
    """What one rotary axis does to the sphere.

    Attributes:
        axis: Its letter.
        test: Name of the test.
        centre: Of the circle, machine frame, (3,) m.
        direction: Unit vector along the axis, (3,).
        radius: m.
        rows: Points on it.
    """

    axis: str
    test: str
    centre: np.ndarray
    direction: np.ndarray
    radius: float
    rows: np.ndarray


def circle_through(points: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Centre (3,), direction (3,) and radius of the circle through points (n, 3), least squares, all in m.

    Args:
        points: At least three, not on a line.
        along: Which of the two directions of the normal is wanted, (3,).
    """
    middle = points.mean(axis=0)
    first, second, normal = np.linalg.svd(points - middle, full_matrices=False)[2]
    normal = normal * np.sign(normal @ along)
    flat = (points - middle) @ np.column_stack([first, second])
    a = np.column_stack([2.0 * flat, np.ones(len(flat))])
    x, y, c = np.linalg.lstsq(a, (flat**2).sum(axis=1), rcond=None)[0]
    return middle + x * first + y * second, normal, float(np.sqrt(c + x * x + y * y))


def circles_of(test: SphereTest, points: Points, deviation: np.ndarray | None = None) -> list[Circle]:
    """The circle of every rotary axis that turns alone somewhere in a test, over the largest angle.

    Args:
        test: The test.
        points: What was measured.
        deviation: In the place of the measured one, (n, 3) m.
    """
    chain = test.chain
    if chain.carried:  # the machine frame is none of axis positions
        return []
    centres = points.position[:, chain.linear_columns] + (points.deviation if deviation is None else deviation)
    angles = points.position[:, chain.rotary_columns]
    out = []
    for i, letter in enumerate(chain.rotary):
        others = np.delete(angles, i, axis=1)
        best: np.ndarray | None = None
        for place in np.unique(np.round(others / (0.01 * DEG)), axis=0):
            rows = np.flatnonzero((np.round(others / (0.01 * DEG)) == place).all(axis=1))
            turned = np.unique(np.round(angles[rows, i] / (0.01 * DEG)))
            if len(turned) < _FEWEST or _spanned(angles[rows, i]) < _SPAN:
                continue
            if best is None or _spanned(angles[rows, i]) > _spanned(angles[best, i]) + 1e-6:
                best = rows
        if best is not None and np.linalg.norm(np.ptp(centres[best], axis=0)) > 1e-3:
            axis = chain.axis(letter)
            along = np.array(axis.unit, float)
            others_at = angles[best[0]].copy()
            others_at[i] = 0.0
            centre, direction, radius = circle_through(centres[best], _turned_by_others(test, letter, others_at, along))
            out.append(Circle(letter, test.name, centre, direction, radius, best))
    return out


def _spanned(angles: np.ndarray) -> float:
    """Angle that positions cover, rad: a full turn less its largest gap."""
    a = np.sort(np.mod(angles, 2 * np.pi))
    return 2 * np.pi - float(np.diff(np.append(a, a[0] + 2 * np.pi)).max())


def _turned_by_others(test: SphereTest, letter: str, angles: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Direction (3,) of an axis while the axes that carry it stand at ``angles`` (rotary,), rad."""
    from mjsim.machine.kinematics import turn_about

    chain, out = test.chain, [np.array([v]) for v in along]
    for side in (chain.work, tuple(reversed(chain.tool))):
        letters = [a.letter for a in side]
        if letter in letters:
            for a in side[letters.index(letter) + 1 :]:
                if a.rotary:
                    at = np.array([angles[chain.rotary.index(a.letter)]])
                    out = turn_about(a, out, at)
    return np.array([float(v[0]) for v in out])


def location_errors(tests: Sequence[SphereTest], recordings: Mapping[str, Points]) -> dict[str, float]:
    """Location errors that the circles alone give, m and rad by name; those that no circle shows are left out.

    Args:
        tests: Measured tests.
        recordings: By name of the test.
    """
    best: dict[str, tuple[SphereTest, Circle]] = {}
    for t in tests:
        for c in circles_of(t, recordings[t.name]):
            now = best.get(c.axis)
            if now is None or _angle(recordings, c, t) > _angle(recordings, now[1], now[0]) + 1e-6:
                best[c.axis] = t, c
    if not best:
        return {}
    names = [e.name for e in tests[0].chain.location_errors]

    def seen(errors: dict[str, float] | None) -> np.ndarray:
        """Centre and direction of all circles; as measured, or as a machine with these errors shows them."""
        out = []
        for axis, (t, c) in best.items():
            points = recordings[t.name]
            if errors is None:
                found = c
            else:
                made = -bar_vector(t.chain, points.position, np.array(t.sphere), Geometry(errors, {}))
                found = next(x for x in circles_of(t, points, made) if x.axis == axis)
            across = [k for k in range(3) if k != int(np.argmax(np.abs(c.direction)))]
            out += [*found.centre[across], *found.direction[across]]
        return np.array(out)

    ideal = seen({})
    columns = np.column_stack([(seen({n: _STEP}) - ideal) / _STEP for n in names])
    # a number that circles of this campaign do not determine has no unique solution
    _, values, vectors = np.linalg.svd(columns)
    rank = int((values > 1e-6 * values[0]).sum())
    x = np.linalg.lstsq(columns, seen(None) - ideal, rcond=1e-6)[0]
    hidden = np.abs(vectors[rank:]).max(axis=0) if rank < len(names) else np.zeros(len(names))
    return {n: float(v) for n, v, h in zip(names, x, hidden, strict=True) if h < 1e-3}


def _angle(recordings: Mapping[str, Points], c: Circle, t: SphereTest) -> float:
    """Angle over which a circle was measured, rad."""
    return _spanned(recordings[c.test].position[c.rows, t.chain.index(c.axis)])
