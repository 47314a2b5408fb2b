"""Makes the motion that plain-Python effects and generic terms see from axis positions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from mjsim.machine.plant import Motion
from mjsim.simulation.drive import bristle

if TYPE_CHECKING:
    from mjsim.machine.plant import Plant

#: When an axis has last reversed that has not done so yet, s before the program's start.
LONG_AGO = 1e9


class MotionTracker:
    """Makes :class:`Motion` from positions that arrive in time order, in pieces of any length.

    Rates are backward differences, so that pieces of one instant and whole motions give the same numbers.
    """

    def __init__(self, step: float, started: float, plant: Plant, ball: tuple[float, float, float]) -> None:
        self.step, self.started, self._axes, self._ball = step, started, plant.chain.letters, np.array(ball)
        axes = [plant.axes[a] for a in plant.chain.letters]
        self._gear, self._inertia, self._viscous, self._coulomb, self._presliding = (
            np.array([getattr(a, n) for a in axes]) for n in ("gear", "inertia", "viscous", "coulomb", "presliding")
        )
        count = len(axes)
        self._bristle = np.zeros(count)
        self._last: np.ndarray | None = None
        self._velocity, self._sign, self._turned = np.zeros(count), np.zeros(count), np.full(count, -LONG_AGO)

    def follow(self, time: np.ndarray, position: np.ndarray) -> Motion:
        """The motion at the instants ``time`` (n,), one step apart and following the earlier ones; ``position`` (n,
        axes).
        """
        if self._last is None:
            self._last = position[0]
        velocity = np.diff(position, axis=0, prepend=np.array(self._last)[None]) / self.step
        acceleration = np.diff(velocity, axis=0, prepend=self._velocity[None]) / self.step
        sign = np.sign(np.where(np.abs(velocity) < 1e-9, 0.0, velocity))
        since = np.empty_like(position)
        for i in range(position.shape[1]):
            moving = np.where(sign[:, i] != 0.0, np.arange(len(time)), -1)
            last = np.maximum.accumulate(moving)
            held = np.where(last >= 0, sign[np.maximum(last, 0), i], self._sign[i])
            before = np.concatenate([[self._sign[i]], held[:-1]])
            changed = (held != before) & (before != 0.0)
            start = np.maximum.accumulate(np.where(changed, time, -np.inf))
            turned = np.maximum(start, self._turned[i])
            since[:, i] = time - turned
            self._sign[i], self._turned[i] = held[-1], turned[-1]
        self._last, self._velocity = position[-1].copy(), velocity[-1].copy()
        friction = np.empty_like(position)
        _bristles(velocity * self._gear * self.step, self._presliding, self._bristle, friction)
        torque = (
            self._inertia * self._gear * acceleration + self._viscous * self._gear * velocity + self._coulomb * friction
        )
        shut = map(_shut, (time, self.started + time, position, velocity, acceleration, since, torque))
        return Motion(*shut, axes=self._axes, ball=_shut(self._ball))


def _shut(x: np.ndarray) -> np.ndarray:
    """The same numbers, which a user's effect cannot change."""
    x = x.view()
    x.flags.writeable = False
    return x


@njit(cache=True, nogil=True, error_model="numpy")
def _bristles(turned, presliding, z, out):
    """Friction over the Coulomb level, (n, axes), from motor angles turned per instant: LuGre's bristles at slow
    sliding.
    """
    for k in range(turned.shape[0]):
        for i in range(turned.shape[1]):
            d = turned[k, i]
            z[i], _ = bristle(z[i], 1.0 if d > 0.0 else -1.0, abs(d) / presliding[i])
            out[k, i] = z[i]
