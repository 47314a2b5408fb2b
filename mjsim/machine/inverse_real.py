"""Axis positions for a wanted pose on a machine with geometric errors, where there is no closed form.

Newton's method, damped as by Levenberg and Marquardt, from the ideal machine's positions.
"""

from __future__ import annotations

import numpy as np

from mjsim.errors import InputError
from mjsim.machine.chain import Chain
from mjsim.machine.inverse import pose
from mjsim.machine.kinematics import Geometry, carried_really, spindle_ball, table_ball, tool_side, work_side

#: Steps of the derivatives, m and rad; the functions are smooth, and errors of the slopes only slow the method down.
_STEP = 1e-6
#: A pose is reached when the ball is this close, m; directions count alike, in rad.
_REACHED = 1e-13
_MOST_STEPS = 30
_UP = np.array([0.0, 0.0, 1.0])


def real_pose(chain: Chain, points: np.ndarray, direction: np.ndarray, geometry: Geometry) -> np.ndarray:
    """Axis positions that bring the spindle ball of a real machine to ``points`` with the tool in ``direction``.

    Args:
        chain: the machine's axes.
        points: (n, 3) of the spindle ball in the work frame, m.
        direction: (n, 3) unit vectors in the work frame, from the tool's tip to the spindle. What the axes cannot do
            about the tool's direction, as one with fewer rotary axes, is left.
        geometry: location errors and squareness.

    Returns:
        (n, axes) m and rad.

    Raises:
        InputError: the ideal axes do not reach a direction, or the real ones do not come to a place.
    """
    q = pose(chain, points, direction)
    damping, rest = 1e-9, _rest(chain, q, points, direction, geometry)
    for _ in range(_MOST_STEPS):
        slope = np.stack(
            [
                (_rest(chain, q + h, points, direction, geometry) - _rest(chain, q - h, points, direction, geometry))
                / (2 * _STEP)
                for h in _STEP * np.eye(chain.count)
            ],
            axis=2,
        )
        normal = np.einsum("nij,nik->njk", slope, slope) + damping * np.eye(chain.count)
        step = np.linalg.solve(normal, np.einsum("nij,ni->nj", slope, rest)[:, :, None])[:, :, 0]
        tried = _rest(chain, q - step, points, direction, geometry)
        if np.abs(tried).max() <= np.abs(rest).max() or np.abs(step).max() < 1e-9:
            q, rest, damping = q - step, tried, damping / 10.0
        else:
            damping = 100.0 * damping
        if np.abs(step).max() < _REACHED:
            break
    if np.abs(rest[:, :3]).max() > 1e-9:
        raise InputError(
            f"configuration {chain.configuration!r}: the axes do not come to a place within 1 nm; allowed: places and "
            "errors for which they do"
        )
    return q


def _rest(chain: Chain, q: np.ndarray, points: np.ndarray, direction: np.ndarray, geometry: Geometry) -> np.ndarray:
    """What is left of place, m, and direction, rad, (n, 6)."""
    place = spindle_ball(chain, q, geometry) - table_ball(chain, q, points, geometry)
    tool = carried_really(chain, tool_side(chain), q, _UP, geometry, 1.0)
    tool = tool - carried_really(chain, tool_side(chain), q, np.zeros(3), geometry, 1.0)
    work = carried_really(chain, work_side(chain), q, points + direction, geometry, -1.0)
    work = work - carried_really(chain, work_side(chain), q, points, geometry, -1.0)
    return np.hstack([place, tool - work])
