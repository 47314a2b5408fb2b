"""What makes the deviation: every effect's part of it, by itself, and what the drives lag behind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.machine.effect import axis_of_subject
from mjsim.prediction.contour import Contour
from mjsim.prediction.influence import Influence
from mjsim.prediction.result import Cause

#: What the drives make of curves and corners.
SERVO_LAG = "servo lag"
_ALL = "all axes"


@dataclass(frozen=True)
class Parts:
    """The deviation normal to the path, cause by cause.

    Attributes:
        keys: Of the effects; :data:`SERVO_LAG` is the last one.
        axes: Letter of the axis that each belongs to.
        parts: (causes, n, 3) m; they add up to the deviation.
        along: Each one's share of the deviation's size, signed, (causes, n) m; they add up to the size.
    """

    keys: tuple[str, ...]
    axes: tuple[str, ...]
    parts: np.ndarray
    along: np.ndarray

    @classmethod
    def of(cls, influence: Influence, found: Contour) -> Parts:
        """Of a machine's deviation from a path."""
        chain = influence.run.chain
        effects = [e for e in influence.machine.effects if not e.is_neutral]
        own = [-across(found, influence.change(e, None)) for e in effects]
        parts = np.stack([*own, found.normal - sum(own, np.zeros_like(found.normal))])
        size = found.size
        direction = found.normal / np.where(size > 0.0, size, 1.0)[:, None]
        axes = [axis_of_subject(e.subject, chain) or _ALL for e in effects]
        keys = (*(e.key for e in effects), SERVO_LAG)
        return cls(keys, (*axes, _ALL), parts, np.einsum("cni,ni->cn", parts, direction))

    def causes(self, worst: int) -> tuple[Cause, ...]:
        """Every cause, the largest first; ``worst`` is the instant of the largest deviation."""
        rows = zip(self.keys, self.axes, self.parts, self.along[:, worst], strict=True)
        out = [Cause(key, axis, _rms(part), float(share)) for key, axis, part, share in rows]
        return tuple(sorted(out, key=lambda c: -c.rms))

    def by_axis(self, worst: int) -> tuple[Cause, ...]:
        """The same with all causes of an axis together."""
        out = []
        for axis in dict.fromkeys(self.axes):
            mine = [k for k, a in enumerate(self.axes) if a == axis]
            name = SERVO_LAG if [self.keys[k] for k in mine] == [SERVO_LAG] else axis
            part = self.parts[mine].sum(axis=0)
            out.append(Cause(name, axis, _rms(part), float(self.along[mine, worst].sum())))
        return tuple(sorted(out, key=lambda c: -c.rms))

    def main(self, at: int) -> tuple[str, float]:
        """The cause that adds most to the deviation at one instant, and its share there, m."""
        k = int(np.argmax(self.along[:, at]))
        return self.keys[k], float(self.along[k, at])


def across(found: Contour, change: np.ndarray) -> np.ndarray:
    """The part of changes (n, 3, …) that is normal to the path."""
    along = np.einsum("ni...,ni->n...", change, found.tangent)
    return change - np.einsum("n...,ni->ni...", along, found.tangent)


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.einsum("ni,ni->n", x, x))))
