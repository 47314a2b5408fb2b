"""What a machine is put together from where only its chain is known: links of boxes, cylinders and spheres."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from mjsim.machine.chain import Axis

#: Play between parts that slide on each other or turn in each other, m: they never touch.
GAP = 0.002


@dataclass(frozen=True)
class Solid:
    """A box, cylinder or sphere, in world coordinates while all axes are at 0.

    Attributes:
        shape: ``box``, ``cylinder`` or ``sphere``.
        centre: (3,) m.
        size: half edges of a box, radius and half length of a cylinder, radius of a sphere, m.
        material: by which it is drawn.
        along: direction of a cylinder.
        name: of the geom; empty where it needs none.
    """

    shape: str
    centre: tuple[float, ...]
    size: tuple[float, ...]
    material: str = "white"
    along: tuple[float, ...] = (0.0, 0.0, 1.0)
    name: str = ""

    def corners(self) -> np.ndarray:
        """Points that enclose it, (n, 3) m."""
        centre = np.array(self.centre)
        if self.shape == "sphere":
            return centre + self.size[0] * np.vstack([np.eye(3), -np.eye(3)])
        if self.shape == "box":
            return centre + np.array(list(product((-1.0, 1.0), repeat=3))) * self.size
        radius, half = self.size
        d = np.array(self.along)
        side = np.cross(d, np.eye(3)[int(np.argmin(np.abs(d)))])
        side /= np.linalg.norm(side)
        t = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)[:, None]
        ring = radius / np.cos(np.pi / 16) * (np.cos(t) * side + np.sin(t) * np.cross(d, side))
        return np.vstack([centre + half * d + ring, centre - half * d + ring])


@dataclass
class Link:
    """What moves as one.

    Attributes:
        name: of the body.
        role: what it is on the machine: turntable, cradle, slide, ...
        axis: that moves it; ``None`` for what stands.
        sign: +1 where the axis moves it by its position, −1 where a slide carries the workpiece.
        solids: of which it consists.
    """

    name: str
    role: str
    axis: Axis | None = None
    sign: float = 1.0
    solids: list[Solid] = field(default_factory=list)

    @property
    def origin(self) -> np.ndarray:
        """Origin of its frame while all axes are at 0, (3,) m: on the centreline of its axis."""
        return np.zeros(3) if self.axis is None else self.axis.centre


def box(x: Sequence[float], y: Sequence[float], z: Sequence[float], material: str = "white") -> Solid:
    """A box between two planes along every axis, m."""
    ranges = [sorted(r) for r in (x, y, z)]
    centre = tuple(float(a + b) / 2 for a, b in ranges)
    return Solid("box", centre, tuple(float(b - a) / 2 for a, b in ranges), material)


def oriented_box(
    along: int, span: Sequence[float], across: Sequence[float], z: Sequence[float], material: str
) -> Solid:
    """A box by its extent along the horizontal coordinate ``along`` (0 or 1), across it, and in height, m."""
    return box(span, across, z, material) if along == 0 else box(across, span, z, material)


def rod(
    start: Sequence[float] | np.ndarray, end: Sequence[float] | np.ndarray, radius: float, material: str = "steel"
) -> Solid:
    """A cylinder from one point to another, m."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(b - a))
    centre, along = (a + b) / 2, (b - a) / length
    return Solid("cylinder", tuple(map(float, centre)), (radius, length / 2), material, tuple(map(float, along)))


def points(solids: Iterable[Solid]) -> np.ndarray:
    """Corners of all of them, (n, 3) m."""
    return np.vstack([s.corners() for s in solids])


def from_axis(axis: Axis, solids: Iterable[Solid]) -> tuple[np.ndarray, np.ndarray]:
    """Places along a rotary axis and distances from it of all corners, (n,) m each."""
    away = points(solids) - axis.centre
    along = away @ axis.direction
    return along, np.linalg.norm(away - along[:, None] * axis.direction, axis=1)
