"""Writes the folder of the five-axis machine's model, or compares one.

    python scripts/figures/build_solids.py [FOLDER] [--check]

The solids (``assets/*.stl``) are made here from their dimensions, all of which are assumed. A solid is a list of closed
pieces, so none needs a Boolean operation. Lengths are in metres. ``five_axis.xml`` and ``scene.xml`` are not made: they
are text in ``models/``, edited by hand, and copied. Only they name the meshes, the densities, the joints and the shapes
for collisions.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from mjsim.io import resources

# -- closed pieces that solids are put together from -------------------------------------------------------------------

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


# -- solids as files ---------------------------------------------------------------------------------------------------

#: The first 80 bytes of every file; constant, so that the same solid is the same file.
_HEADER = b"mjsim five-axis machine, metres".ljust(80, b" ")
_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True)
class Part:
    """A mesh of the model.

    Attributes:
        mesh: its name in the model; its file is ``assets/<mesh>.stl``.
        pieces: closed pieces whose sum it is.
    """

    mesh: str
    pieces: list[Piece]


@dataclass(frozen=True)
class Body:
    """What moves as one.

    Attributes:
        name: of the body in the model.
        parts: its meshes.
    """

    name: str
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Machine:
    """A machine as solids.

    Attributes:
        bodies: all of them, in world coordinates with all axes at zero, except for the fixture, whose origin is its
            ball's centre.
    """

    bodies: tuple[Body, ...]


def solid(pieces: list[Piece]) -> trimesh.Trimesh:
    """The sum of pieces as MuJoCo reads it from a file.

    Vertices are rounded to 0.1 µm, so that no platform's last bit shows, and then to single precision.

    Args:
        pieces: closed, each on its own.

    Returns:
        The mesh, m.
    """
    vertices = [(np.round(v, 7) + 0.0).astype(np.float32) for v, _ in pieces]
    offsets = np.cumsum([0, *(len(v) for v in vertices)])
    faces = [f + offset for (_, f), offset in zip(pieces, offsets, strict=False)]
    return trimesh.Trimesh(np.vstack(vertices).astype(float), np.vstack(faces), process=False)


def stl(part: Part) -> bytes:
    """The file of a part: binary STL in metres, with a constant header.

    Args:
        part: to be written.

    Returns:
        The file's content.

    Raises:
        ValueError: a piece is not closed.
    """
    mesh = solid(part.pieces)
    if not mesh.is_watertight and not trimesh.Trimesh(mesh.vertices, mesh.faces, process=True).is_watertight:
        raise ValueError(f"{part.mesh}: a piece is not closed")
    faces = np.zeros(len(mesh.faces), _FACE)
    faces["corners"] = mesh.vertices[mesh.faces]
    return _HEADER + np.array(len(faces), "<u4").tobytes() + faces.tobytes()


# -- the dimensions that several parts of a machine share --------------------------------------------------------------


@dataclass(frozen=True)
class Dimensions:
    """Lengths in m, densities in kg/m³. The origin is the intersection of the tilting axis and the table's axis.

    Attributes:
        table_radius: of the round table.
        table_bottom: height of its lower face.
        table_top: height of its surface.
        slot_width: of a T-slot.
        slot_depth: of a T-slot.
        slots: how many T-slots there are, evenly spread.
        ball_height: of the table ball's centre.
        ball_radius: of both balls of the bar.
        cheek_inner: distance of the cradle's cheeks from the middle, inside.
        cheek_outer: the same, outside.
        cheek_top: height of the cheeks' upper face.
        plate_depth: of a balance plate on a cheek, along y.
        deck_top: height of the upper face of the slide under the cradle.
        guide: distance of that slide's guides from the middle.
        bed_rear: y where the bed's front part ends and the block under the column begins.
        bed_guide_end: y of the rear ends of the bed's guides.
        x_screw_front: y of the front of the bearing blocks of the column's screw.
        column_face: y of the column's front.
        floor: height of the floor.
        cradle_density: of the cradle's casting, as in the class ``light_casting`` of the model.
        plate_density: of journals and balance plates, as in the class ``steel``.
        table_density: of the table, as in the class ``machined``.
    """

    table_radius: float
    table_bottom: float
    table_top: float
    slot_width: float
    slot_depth: float
    slots: int
    ball_height: float
    ball_radius: float
    cheek_inner: float
    cheek_outer: float
    cheek_top: float
    plate_depth: float
    deck_top: float
    guide: float
    bed_rear: float
    bed_guide_end: float
    x_screw_front: float
    column_face: float
    floor: float
    cradle_density: float
    plate_density: float
    table_density: float


# -- solids of the table's side ----------------------------------------------------------------------------------------

#: Where the bed stands on feet, (x, y), m.
_FEET = [(s * x, y) for x, y in ((0.55, -1.0), (0.55, 0.0), (0.85, 1.1), (0.85, 1.6)) for s in (-1, 1)]


def bed(d: Dimensions) -> dict[str, list[Piece]]:
    """Bed with the guides, the screw and the motor of the slide, and the block that the column stands on."""
    bottom, rear = d.floor + 0.08, d.bed_rear
    front = [(-1.16, bottom), (-1.16, -0.76), (-1.08, -0.68), (rear, -0.68), (rear, bottom)]
    return {
        "bed_casting": [
            prism("x", front, -0.66, 0.66),
            bevelled(-1.02, 1.02, rear, 1.72, bottom, -0.5, 0.03),
            *mirrored(lambda s: box(*span(s, 0.35, 0.49), -1.04, rear, -0.68, -0.61)),
        ],
        "bed_guides": [
            *mirrored(lambda s: box(*span(s, d.guide - 0.02, d.guide + 0.02), -1.03, d.bed_guide_end, -0.61, -0.575)),
            cylinder("y", 0.02, -1.0, 0.86, (0.0, -0.61), 24),
        ],
        "bed_trim": [
            cylinder("y", 0.075, -1.30, -1.16, (0.0, -0.86)),
            box(-0.10, 0.10, -1.18, -1.00, -0.68, -0.55),
            box(-0.08, 0.08, 0.80, 0.90, -0.68, -0.56),
            box(-0.70, 0.70, -1.20, 0.90, d.floor + 0.04, d.floor + 0.14),
        ],
        "bed_feet": [
            *(cylinder("z", 0.07, d.floor, d.floor + 0.06, foot, 24) for foot in _FEET),
            bevelled(-0.98, 0.98, 0.96, 1.68, d.floor, d.floor + 0.09, 0.02),
        ],
    }


def y_slide(d: Dimensions) -> dict[str, list[Piece]]:
    """Slide with the two supports of the cradle, and the cradle's worm gear and motor."""
    t = np.linspace(np.radians(-20), np.radians(200), 33)
    support = [(-0.27, d.deck_top), (0.27, d.deck_top), *((0.175 * math.cos(a), 0.175 * math.sin(a)) for a in t)]
    lower = [(-0.19, -0.19), (0.19, -0.19), (0.22, -0.15)]
    upper = [(0.22, 0.16), (0.16, 0.20), (-0.16, 0.20), (-0.22, 0.14), (-0.22, -0.15)]
    carriage = (d.guide - 0.055, d.guide + 0.055)
    return {
        "y_slide_casting": [
            bevelled(-0.6, 0.6, -0.34, 0.34, -0.51, d.deck_top, 0.02),
            *mirrored(lambda s: prism("x", support, *span(s, 0.45, 0.58))),
        ],
        "y_slide_carriages": [
            box(*span(s, *carriage), *span(e, 0.16, 0.33), -0.572, -0.510) for s in (1, -1) for e in (1, -1)
        ],
        "y_slide_caps": [revolve("x", [(0.135, -0.580), (0.135, -0.600), (0.115, -0.615)])],
        "a_drive": [
            prism("x", [*lower, *upper], 0.580, 0.700),
            cylinder("y", 0.060, -0.46, -0.22, (0.65, -0.11)),  # to the front: behind, it would meet the column
            revolve("x", [(0.110, 0.700), (0.110, 0.715), (0.095, 0.725)]),
        ],
    }


def cradle(d: Dimensions, plate_height: float) -> dict[str, list[Piece]]:
    """Cradle that tilts the table.

    Args:
        d: dimensions of the machine.
        plate_height: of the balance plates on its cheeks, m.

    Returns:
        Mesh name -> pieces.
    """
    inner, outer, top = d.cheek_inner, d.cheek_outer, d.cheek_top
    right = [(0.17, -0.20), (0.28, -0.03), (0.28, 0.07), (0.25, top)]
    left = [(-0.25, top), (-0.28, 0.07), (-0.28, -0.03)]
    half = d.plate_depth / 2
    return {
        "cradle_casting": [
            *mirrored(lambda s: prism("x", [(-0.17, -0.20), *right, *left], *span(s, inner, outer))),
            box(-inner, inner, -0.165, 0.165, -0.198, -0.15),
            revolve("z", [(0.2, -0.15), (0.16, -0.11), (0.16, -0.005)]),
        ],
        "cradle_journals": mirrored(
            lambda s: revolve("x", [(0.125, s * outer), (0.125, s * 0.425), (0.085, s * 0.425), (0.085, s * 0.450)])
        ),
        "cradle_plates": mirrored(lambda s: box(*span(s, inner, outer), -half, half, top, top + plate_height)),
    }


def table(d: Dimensions) -> dict[str, list[Piece]]:
    """Round table with T-slots.

    It looks the same after a turn by a slot's pitch. So it is balanced, and its inertia about the tilting axis does
    not change as it turns. Scale and mark are paint without mass: degrees on the rim, and an arrow to see the angle by.
    """
    pitch = 2 * math.pi / d.slots
    floor, top, radius = d.table_top - d.slot_depth, d.table_top, d.table_radius
    disc = [(0.300, d.table_bottom), (radius, d.table_bottom + 0.010), (radius, floor)]
    teeth = [
        sector((0.060, radius), (floor, top), (k * pitch, (k + 1) * pitch), d.slot_width, 12) for k in range(d.slots)
    ]
    paint, middle = (top - 0.001, top + 0.0006), pitch / 2
    rim = (radius - 0.001, radius + 0.0008)
    return {
        "table_base": [revolve("z", [(0.150, 0.005), (0.150, d.table_bottom)], n=96), revolve("z", disc, n=96)],
        "table_top": [*teeth, tube(0.025, 0.048, floor, top - 0.002)],
        "table_scale": _degrees(radius, floor + 0.006),
        "table_mark": [
            prism("z", turned([(0.292, 0.0), (0.235, 0.028), (0.235, -0.028)], middle), *paint),
            sector((0.075, 0.230), paint, (middle, middle + 1e-9), -0.012, 1),
            sector(rim, (floor + 0.001, top), (middle - 0.07, middle + 0.07), 0.0, 8),
        ],
    }


def _degrees(radius: float, bottom: float) -> list[Piece]:
    """A tick every 5 degrees on a rim, m; those every 30 degrees are longer."""
    half, inner, outer = 0.0009, radius - 0.001, radius + 0.0004
    ring = [(inner, -half), (outer, -half), (outer, half), (inner, half)]
    heights = [0.014 if k % 6 == 0 else 0.008 for k in range(72)]
    return [prism("z", turned(ring, math.radians(5 * k)), bottom, bottom + h) for k, h in enumerate(heights)]


def table_fixture(d: Dimensions) -> dict[str, list[Piece]]:
    """Post with a magnetic cup under the table ball, whose centre is the origin."""
    bottom = d.table_top - d.ball_height
    return {
        "fixture_base": [revolve("z", [(0.026, bottom), (0.026, bottom + 0.014), (0.022, bottom + 0.018)])],
        "fixture_post": [revolve("z", [(0.0100, bottom + 0.018), (0.0085, -0.024), (0.0085, -0.018)])],
        "fixture_cup": [revolve("z", [(0.0085, -0.018), (0.0110, -0.014), (0.0100, -0.0078)])],
        "ball": [sphere(d.ball_radius)],
    }


# -- solids of the tool's side -----------------------------------------------------------------------------------------


def column(d: Dimensions) -> dict[str, list[Piece]]:
    """Portal with the guides, the screw and the motor of the slide that goes across."""
    face = d.column_face
    upright = [(face, -0.50), (1.66, -0.50), (1.40, 0.85), (1.40, 1.42), (face, 1.42)]
    panel = [(1.06, -0.3), (1.5, -0.3), (1.3, 0.75), (1.06, 0.75)]
    return {
        "column_casting": [
            *mirrored(lambda s: prism("x", upright, *span(s, 0.6, 0.96))),
            box(-0.6, 0.6, face, 1.34, 0.5, 1.42),
            box(-0.6, 0.6, 1.08, 1.56, -0.5, -0.2),
        ],
        "column_guides": [
            *(box(-0.95, 0.95, 0.950, face, z - 0.022, z + 0.022) for z in (0.62, 1.30)),
            cylinder("x", 0.020, -0.90, 0.90, (0.945, 0.96), 24),
        ],
        "column_trim": [
            bevelled(-0.98, 0.98, face + 0.02, 1.42, 1.42, 1.5, 0.02),
            box(0.86, 0.96, d.x_screw_front, face, 0.89, 1.03),
            box(-0.96, -0.88, d.x_screw_front, face, 0.9, 1.02),
            cylinder("x", 0.06, 0.96, 1.2, (0.93, 0.96)),
            *mirrored(lambda s: prism("x", panel, *span(s, 0.96, 0.975))),
        ],
    }


def x_slide() -> dict[str, list[Piece]]:
    """Slide on the column, with the carriages of both guides and the motor of the slide along the spindle."""
    return {
        "x_slide_casting": [bevelled(-0.33, 0.33, 0.745, 0.915, 0.50, 1.42, 0.02)],
        "x_slide_carriages": [
            *(box(*span(s, 0.18, 0.32), 0.915, 0.948, z - 0.055, z + 0.055) for s in (1, -1) for z in (0.62, 1.30)),
            *(box(*span(s, 0.125, 0.215), 0.712, 0.745, z - 0.08, z + 0.08) for s in (1, -1) for z in (0.62, 1.28)),
        ],
        "x_slide_trim": [
            box(-0.075, 0.075, 0.745, 0.905, 1.42, 1.52),
            cylinder("z", 0.065, 1.52, 1.78, (0.0, 0.825)),
        ],
    }


def z_slide() -> dict[str, list[Piece]]:
    """Slide along the spindle: the head that carries the spindle, its guides and the spindle's motor."""
    right = [(0.24, 0.40), (0.15, -0.06), (0.09, -0.135)]
    left = [(-x, y) for x, y in reversed(right)]
    plan = np.array([(-0.24, 0.52), (0.24, 0.52), *right, *left])
    shrunk = np.array([0.0, 0.20]) + (plan - [0.0, 0.20]) * 0.94
    panel = [(0.541, 0.62), (0.67, 0.62), (0.67, 1.38), (0.541, 1.38)]
    return {
        "z_slide_casting": [
            loft([place("z", shrunk, 0.57), place("z", plan, 0.60), place("z", plan, 0.97), place("z", shrunk, 1.00)]),
            bevelled(-0.24, 0.24, 0.52, 0.690, 0.54, 1.50, 0.02),
        ],
        "z_slide_guides": [
            *mirrored(lambda s: box(*span(s, 0.15, 0.19), 0.69, 0.711, 0.55, 1.47)),
            cylinder("z", 0.016, 0.55, 1.47, (0.0, 0.712), 24),
        ],
        "z_slide_motor": [revolve("z", [(0.120, 1.00), (0.120, 1.03), (0.100, 1.04), (0.100, 1.30), (0.080, 1.33)])],
        "z_slide_trim": mirrored(lambda s: prism("x", panel, *span(s, 0.238, 0.246))),
    }


def spindle(d: Dimensions) -> dict[str, list[Piece]]:
    """Spindle with a holder and the ball of the bar, whose centre is the origin."""
    housing = [(0.072, 0.300), (0.088, 0.330), (0.088, 0.530), (0.105, 0.540), (0.105, 0.570)]
    nose = [(0.040, 0.220), (0.044, 0.224), (0.044, 0.262), (0.064, 0.266), (0.064, 0.300)]
    holder = [(0.0060, 0.022), (0.0065, 0.085), (0.0160, 0.105), (0.0160, 0.150), (0.0310, 0.165), (0.0310, 0.220)]
    return {
        "spindle_housing": [revolve("z", housing)],
        "spindle_nose": [revolve("z", nose)],
        "spindle_holder": [revolve("z", holder)],
        "spindle_cup": [revolve("z", [(0.0095, 0.0085), (0.0105, 0.014), (0.0060, 0.022)])],
        "ball": [sphere(d.ball_radius)],
    }


# -- one dimension is solved for ---------------------------------------------------------------------------------------


def plate_height(d: Dimensions) -> float:
    """The height at which the first moment of cradle and table about the tilting axis vanishes.

    Args:
        d: dimensions and densities of the machine.

    Returns:
        m.

    Raises:
        ValueError: cradle and table are top-heavy, so that no balance plate on top helps.
    """
    frame, disc = cradle(d, 1.0), table(d)
    weighed = {
        "cradle_casting": (frame["cradle_casting"], d.cradle_density),
        "cradle_journals": (frame["cradle_journals"], d.plate_density),
        "table_base": (disc["table_base"], d.table_density),
        "table_top": (disc["table_top"], d.table_density),
    }
    need = -sum(density * _first_moment(pieces) for pieces, density in weighed.values())
    # density * area * (cheek_top + height / 2) * height = need
    area = 2 * (d.cheek_outer - d.cheek_inner) * d.plate_depth
    q = need / (d.plate_density * area)
    if q <= 0:
        raise ValueError(f"cradle and table are top-heavy by {-need:.3f} kg m, balance plates on top cannot help")
    return math.sqrt(d.cheek_top**2 + 2 * q) - d.cheek_top


def _first_moment(pieces: list[Piece]) -> float:
    """Volume times height of its centre, m⁴."""
    properties = solid(pieces).mass_properties
    return float(properties.volume * properties.center_mass[2])


DIMENSIONS = Dimensions(
    table_radius=0.310,
    table_bottom=0.030,
    table_top=0.080,  # the tilting axis passes 80 mm below the table's surface
    slot_width=0.014,  # ISO 299
    slot_depth=0.025,
    slots=8,
    ball_height=0.155,  # OT = (., ., 155) mm in the paper
    ball_radius=0.0127,
    cheek_inner=0.365,
    cheek_outer=0.415,
    cheek_top=0.100,
    plate_depth=0.440,
    deck_top=-0.380,
    guide=0.420,
    bed_rear=0.950,  # behind the motor of the cradle at the end of travel
    bed_guide_end=0.940,
    x_screw_front=0.920,
    column_face=0.980,
    floor=-1.150,
    cradle_density=1800.0,
    plate_density=7850.0,
    table_density=7200.0,
)


def machine(dimensions: Dimensions = DIMENSIONS) -> Machine:
    """The machine as solids, with balance plates that put the centre of mass on the tilting axis.

    Args:
        dimensions: of the machine.

    Returns:
        Its bodies: the tool's side first, then the table's.

    Raises:
        ValueError: cradle and table are top-heavy, so that no balance plate on top helps.
    """
    d = dimensions
    made = {
        "column": column(d),
        "x_slide": x_slide(),
        "z_slide": z_slide(),
        "spindle": spindle(d),
        "bed": bed(d),
        "y_slide": y_slide(d),
        "cradle": cradle(d, plate_height(d)),
        "table": table(d),
        "table_fixture": table_fixture(d),
    }
    return Machine(
        tuple(Body(name, tuple(Part(mesh, pieces) for mesh, pieces in parts.items())) for name, parts in made.items())
    )


# -- the folder of a machine model -------------------------------------------------------------------------------------


def contents(machine: Machine) -> dict[str, bytes]:
    """The files of a model's folder.

    Args:
        machine: whose solids are made. The MJCF files are the package's, as they are: only they name the meshes, the
            densities, the joints and the shapes for collisions.

    Returns:
        Path inside the folder -> content.
    """
    parts = {part.mesh: part for body in machine.bodies for part in body.parts}
    meshes = {f"assets/{mesh}.stl": stl(part) for mesh, part in parts.items()}
    texts = {file.name: file.read_bytes() for file in (resources.model_file(), resources.scene_file())}
    return meshes | texts


def write_folder(machine: Machine, folder: Path) -> None:
    """Write the meshes and the MJCF files of a machine; meshes of another machine in ``assets`` are removed.

    Args:
        machine: to be written.
        folder: made where there is none. Other files in it stay.
    """
    files = contents(machine)
    (folder / "assets").mkdir(parents=True, exist_ok=True)
    for name in _meshes(folder) - set(files):
        (folder / name).unlink()
    for name, content in files.items():
        (folder / name).write_bytes(content)


def differences(machine: Machine, folder: Path) -> list[str]:
    """What in a folder is not as :func:`write_folder` would write it.

    Args:
        machine: to compare with.
        folder: of a model.

    Returns:
        Paths inside the folder, sorted: files that are missing or have another content, meshes that are too many.
    """
    files = contents(machine)
    wrong = {n for n, content in files.items() if not (folder / n).is_file() or (folder / n).read_bytes() != content}
    return sorted(wrong | (_meshes(folder) - set(files)))


def _meshes(folder: Path) -> set[str]:
    return {f"assets/{file.name}" for file in (folder / "assets").glob("*.stl")}


def main() -> int:
    """Run the command; exit status 1 where ``--check`` finds a difference."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    shipped = resources.model_file().parent
    parser.add_argument("folder", nargs="?", type=Path, default=shipped, help="of the model (default: the shipped one)")
    parser.add_argument("--check", action="store_true", help="compare the folder instead of writing it")
    arguments = parser.parse_args()
    made = machine()
    if not arguments.check:
        write_folder(made, arguments.folder)
        return 0
    wrong = differences(made, arguments.folder)
    if wrong:
        print(f"{arguments.folder}: not as this program writes it: {', '.join(wrong)}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
