"""Touches of a probe on a sphere: from which sides, and the centre that follows from where the probe has switched.

A tip of radius r touches a sphere of radius R where their centres are R + r apart. The four coordinates of the centre
and of that distance follow from four touches or more (least squares; the pre-travel of the probe is in the distance).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.sphere.measurement import SphereTest
from mjsim.machine.chain import COORDINATES
from mjsim.machine.kinematics import bar_vector

#: Sides from which a sphere is touched, machine frame: from above first.
_SIDES = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], float)
#: Cosine of the angle between a side and the stem of the sphere within which nobody touches: 60°.
_STEM = 0.5
#: Fewest touches from which a centre follows.
FEWEST_TOUCHES = 4
#: Numbers in a line of a file that LinuxCNC writes of its probings: its nine axes.
LOGGED = 9


def sides_of_points(test: SphereTest) -> list[np.ndarray]:
    """From which sides each planned point is touched, (k, 3) machine frame: where the stem is in the way, from none.

    Args:
        test: With its positions; the stem stands on the table, away from the spindle at zero.

    Raises:
        InputError: A head turns the probe, or the stem of a point is above the sphere.
    """
    chain = test.chain
    if chain.swivelling:
        raise InputError(
            f'test "{test.name}": the head turns with {chain.swivelling[0].letter}; allowed: a probing program for '
            "machines whose table turns"
        )
    position, ball = test.planned.position, np.array(test.sphere)
    below = ball - np.array([0.0, 0.0, 1.0])
    stem = bar_vector(chain, position, ball) - bar_vector(chain, position, below)  # from the sphere to its foot
    out = []
    for i, way in enumerate(stem):
        kept = _SIDES[_SIDES @ way <= _STEM]
        if len(kept) < FEWEST_TOUCHES or not kept[0][2]:
            raise InputError(
                f'test "{test.name}", point {i + 1}: the stem of the sphere is in the way; allowed: positions at which '
                "the table does not hang over"
            )
        out.append(kept)
    return out


def centre_of(contacts: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (3,) and distance of the tip from it that fit some contacts (k, 3) best, m.

    Differences of |p − c|² = d² are linear in the centre; the sum of squares of p is exact for a sphere.
    """
    mean = contacts.mean(axis=0)
    p = contacts - mean
    columns = np.column_stack([2.0 * p, np.ones(len(p))])
    x = np.linalg.lstsq(columns, (p**2).sum(axis=1), rcond=None)[0]
    return mean + x[:3], float(np.sqrt(x[3] + x[:3] @ x[:3]))


def centres_of_log(test: SphereTest, values: np.ndarray) -> np.ndarray:
    """Centres (n, 3) m of the planned points.

    Args:
        test: With its positions.
        values: Where the probe has switched, in the order of the program, (touches, n) m, the linear axes first.

    Raises:
        InputError: There are more or fewer touches than the program makes.
    """
    sides = sides_of_points(test)
    ends = np.cumsum([0, *map(len, sides)])
    # LinuxCNC 2.9 writes a line for every way down beside the sphere too, where the probe did not switch
    down = np.array([not side[2] for point in sides for side in point])
    touches = np.arange(len(down)) + np.cumsum(down)
    if len(values) == len(down) + down.sum():
        values = values[touches]
    if len(values) != len(down):
        raise InputError(
            f'test "{test.name}": {len(values)} touches; allowed: the {len(down)} of its program, in their order, or '
            f"{len(down) + down.sum()} with the ways down beside the sphere"
        )
    return np.array([centre_of(values[a:b, : len(COORDINATES)])[0] for a, b in pairwise(ends)])
