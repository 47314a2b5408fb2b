"""Where a ball stands about a rotary axis."""

from __future__ import annotations

import numpy as np

from mjsim.machine.chain import Axis


def radius_of(axis: Axis, ball: np.ndarray) -> tuple[float, np.ndarray]:
    """Where a ball stands about a rotary axis, seen from that axis.

    Args:
        axis: Of the chain.
        ball: Centre of the ball in the work frame, (3,) m.

    Returns:
        Its angle, rad, and the unit vector (3,) from the axis to the ball; those of angle 0 for a ball on the axis.
    """
    along = axis.direction
    first = np.eye(3)[(int(np.argmax(np.abs(along))) + 1) % 3]  # x for an axis along z
    first = first - along * (along @ first)
    first /= np.linalg.norm(first)
    second = np.cross(along, first)
    arm = ball - axis.centre
    angle = float(np.arctan2(arm @ second, arm @ first))
    return angle, np.cos(angle) * first + np.sin(angle) * second
