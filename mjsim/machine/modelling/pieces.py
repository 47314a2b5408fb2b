"""Closed pieces that solids are put together from: lofts, prisms, boxes, turned pieces, sectors, tubes.

Every piece is closed on its own, so a solid that is a list of pieces needs no Boolean operation. Lengths are in metres.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
import trimesh

#: Vertices (n, 3) in m and faces (m, 3), which are numbers of vertices, counterclockwise from outside.
Piece = tuple[np.ndarray, np.ndarray]


def signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """The volume inside a closed surface.

    Args:
        vertices: (n, 3), m.
        faces: (m, 3), numbers of vertices.

    Returns:
        m³, negative where the faces are clockwise from outside.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def place(axis: str, points: np.ndarray | Sequence[tuple[float, float]], height: float) -> np.ndarray:
    """Points of a plane that an axis is normal to.

    Args:
        axis: ``x``, ``y`` or ``z``.
        points: (n, 2), m: (y, z), (x, z) or (x, y) for the axis x, y, z.
        height: where the plane is along the axis, m.

    Returns:
        (n, 3), m.
    """
    return np.insert(np.asarray(points, float), "xyz".index(axis), height, axis=1)


def loft(rings: Iterable[np.ndarray]) -> Piece:
    """A solid through rings; the first and the last become its caps.

    Args:
        rings: of equally many points each, (n, 3), m; the first and the last are convex.

    Returns:
        The piece.
    """
    rings = [np.asarray(r, float) for r in rings]
    n = len(rings[0])
    faces = [face for k in range(len(rings) - 1) for face in _wall(k * n, (k + 1) * n, n)]
    last = (len(rings) - 1) * n
    for i in range(1, n - 1):
        faces += [(0, i + 1, i), (last, last + i, last + i + 1)]
    return _outwards(np.vstack(rings), np.array(faces))


def _wall(lower: int, upper: int, n: int) -> list[tuple[int, int, int]]:
    """Faces between two rings of n points; lower and upper are the numbers of their first points."""
    faces = []
    for i in range(n):
        j = (i + 1) % n
        faces += [(lower + i, lower + j, upper + j), (lower + i, upper + j, upper + i)]
    return faces


def _outwards(vertices: np.ndarray, faces: np.ndarray) -> Piece:
    return vertices, faces if signed_volume(vertices, faces) > 0 else faces[:, ::-1]


def prism(axis: str, polygon: Sequence[tuple[float, float]] | np.ndarray, low: float, high: float) -> Piece:
    """A convex polygon pulled along an axis.

    Args:
        axis: ``x``, ``y`` or ``z``.
        polygon: its corners, as :func:`place` takes them, m.
        low: where the piece begins along the axis, m.
        high: where it ends, m.

    Returns:
        The piece.
    """
    return loft([place(axis, polygon, low), place(axis, polygon, high)])


def box(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> Piece:
    """A box between two planes along every axis, m."""
    return prism("z", [(x0, y0), (x1, y0), (x1, y1), (x0, y1)], z0, z1)


def bevelled(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float, c: float) -> Piece:
    """A box, m, with its four vertical edges and its top edges chamfered by c, m."""

    def octagon(s: float) -> list[tuple[float, float]]:
        a, b, d, e = x0 + s, x1 - s, y0 + s, y1 - s
        return [(a + c, d), (b - c, d), (b, d + c), (b, e - c), (b - c, e), (a + c, e), (a, e - c), (a, d + c)]

    return loft([place("z", octagon(0), z0), place("z", octagon(0), z1 - c), place("z", octagon(c), z1)])


def circle(radius: float, n: int, centre: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """n points on a circle in a plane, (n, 2), m."""
    t = 2 * np.pi * (np.arange(n) + 0.5) / n
    return np.asarray(centre) + radius * np.column_stack([np.cos(t), np.sin(t)])


def revolve(
    axis: str, profile: Iterable[tuple[float, float]], centre: tuple[float, float] = (0.0, 0.0), n: int = 64
) -> Piece:
    """A turned piece.

    Args:
        axis: it is turned about, ``x``, ``y`` or ``z``.
        profile: radius and coordinate along the axis of every ring, m.
        centre: where the axis is in the plane normal to it, m.
        n: points of a ring.

    Returns:
        The piece.
    """
    return loft([place(axis, circle(radius, n, centre), height) for radius, height in profile])


def cylinder(
    axis: str, radius: float, low: float, high: float, centre: tuple[float, float] = (0.0, 0.0), n: int = 48
) -> Piece:
    """A cylinder between two heights along its axis, m; the other arguments are those of :func:`revolve`."""
    return revolve(axis, [(radius, low), (radius, high)], centre, n)


def sphere(radius: float) -> Piece:
    """A sphere about the origin, of 1280 faces; radius in m."""
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def sector(
    radii: tuple[float, float], heights: tuple[float, float], angles: tuple[float, float], gap: float, n: int
) -> Piece:
    """A sector of a ring about z.

    Args:
        radii: inner and outer, m.
        heights: bottom and top, m.
        angles: where it begins and ends, rad.
        gap: its flanks are set back by half of this, parallel to the radii, m.
        n: steps from flank to flank.

    Returns:
        The piece.
    """
    (r0, r1), (z0, z1), (start, stop) = radii, heights, angles
    inner, outer = (math.asin(gap / 2 / r) for r in radii)
    rings = []
    for s in np.linspace(0, 1, n + 1):
        ring = []
        for r, z, back in ((r0, z0, inner), (r1, z0, outer), (r1, z1, outer), (r0, z1, inner)):
            t = (1 - s) * (start + back) + s * (stop - back)
            ring.append((r * math.cos(t), r * math.sin(t), z))
        rings.append(np.array(ring))
    return loft(rings)


def tube(r0: float, r1: float, z0: float, z1: float, n: int = 64) -> Piece:
    """A hollow cylinder about z: inner and outer radius, bottom and top, m; n points of a ring."""
    rings = [place("z", circle(r, n), z) for r, z in ((r0, z0), (r1, z0), (r1, z1), (r0, z1))]
    faces = [face for k in range(4) for face in _wall(k * n, (k + 1) % 4 * n, n)]
    return _outwards(np.vstack(rings), np.array(faces))


def turned(points: np.ndarray | Sequence[tuple[float, float]], angle: float) -> np.ndarray:
    """Points of a plane, (n, 2), m, turned about its origin by an angle, rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(points) @ np.array([[c, s], [-s, c]])


def mirrored(make: Callable[[float], Piece]) -> list[Piece]:
    """What ``make`` makes for the sides +1 and -1."""
    return [make(1.0), make(-1.0)]


def span(side: float, a: float, b: float) -> tuple[float, float]:
    """The interval from a to b on the side +1, and its mirror image on the side -1, ascending."""
    return (side * a, side * b) if side > 0 else (side * b, side * a)
