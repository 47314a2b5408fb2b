"""Axis events along a test: where each axis reverses."""

from __future__ import annotations

import numpy as np

from mjsim.instruments.ball_bar.program import Program

#: Extent within which a point counts as being at a reversal, rad of the test's angle.
NEAR = np.radians(6.0)

#: Reversals so close to an end of the measured part still show in it, s.
_EDGE = 0.2


def reversals(program: Program) -> dict[str, np.ndarray]:
    """Signed test angles φ (rad) at which each axis reverses in the measured part, its ends included; other axes
    are left out.
    """
    lo, hi = program.measured_span
    time = np.linspace(max(0.0, lo - _EDGE), min(program.duration, hi + _EDGE), 20001)
    q, phi = program.commands(time), program.phi(time)
    out = {}
    for i, axis in enumerate(program.test.chain.letters):
        step = np.diff(q[:, i])
        step[np.abs(step) < 1e-12] = 0.0
        moving = np.flatnonzero(step)
        if len(moving) < 2:
            continue
        turn = moving[np.flatnonzero(np.diff(np.sign(step[moving])))]
        if len(turn):
            out[axis] = phi[turn + 1]
    return out


def event_at(phi: float, events: dict[str, np.ndarray]) -> str:
    """The axis event nearest to an angle: ``"reversal of Y"``, or ``"between reversals"``."""
    near = [(float(np.min(np.abs(a - phi))), axis) for axis, a in events.items()]
    distance, axis = min(near, default=(np.inf, ""))
    return f"reversal of {axis}" if distance <= NEAR else "between reversals"
