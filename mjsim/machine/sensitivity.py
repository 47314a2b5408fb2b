"""First derivatives of the ball-bar reading of the ideal machine along a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.machine.chain import Axis, Chain
from mjsim.machine.kinematics import bar_vector, read_along, turn_about


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
