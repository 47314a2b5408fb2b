"""Build the solids of models/five_axis.xml as binary STL files.

Every solid is a list of convex or swept pieces, each closed on its own, so no Boolean operation is needed and the volume
integrals that MuJoCo takes with ``inertia="exact"`` are the sums over the pieces. All vertices are given in metres in
the world frame at X = Y = Z = A = C = 0 (origin: intersection of the A and C centrelines), except the parts of the
table fixture and the ball, which are centred on their ball. The dimensions are assumed: a machine with a 620 mm table.

    python scripts/build_model.py            write models/assets/*.stl and print the mass balance
    python scripts/build_model.py --check    exit 1 unless the files in models/assets are the ones this script makes

One dimension is solved for, not chosen: the height of the balance plates on the cradle's cheeks, such that the centre
of mass of cradle and table lies on the A centreline.
"""

from __future__ import annotations

import argparse
import math
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import trimesh

MODELS = Path(__file__).resolve().parent.parent / "models"
ASSETS = MODELS / "assets"
XML = MODELS / "five_axis.xml"

# Assumed dimensions [m] that several parts share.
TABLE_RADIUS = 0.310
TABLE_BOTTOM, TABLE_TOP = 0.030, 0.080  # the A centreline passes 80 mm below the table surface
SLOT_WIDTH, SLOT_DEPTH, SLOTS = 0.014, 0.025, 8  # 14 mm T-slots, ISO 299
BALL_HEIGHT = 0.155  # OT = (., ., 155) mm in the paper
BALL_RADIUS = 0.0127
CHEEK_INNER, CHEEK_OUTER, CHEEK_TOP = 0.365, 0.415, 0.100
DECK_TOP = -0.380
GUIDE_Y = 0.420  # |x| of the Y guides
COLUMN_FACE = 0.980  # y of the column's front
FLOOR = -1.150

# Data sheet of the drives: motor-side inertia J [kg m2], gear = 2 pi / lead or worm-wheel teeth.
DRIVES = {
    "X": (0.0100, 2 * math.pi / 0.010),
    "Y": (0.0130, 2 * math.pi / 0.010),
    "Z": (0.0105, 2 * math.pi / 0.010),
    "A": (0.0042, 60.0),
    "C": (0.0036, 72.0),
}

Piece = tuple[np.ndarray, np.ndarray]  # vertices (n, 3), faces (m, 3)


# Pieces.


def loft(rings: Iterable[np.ndarray]) -> Piece:
    """A closed solid through rings of equally many points; the first and last ring are convex and become the caps."""
    rings = [np.asarray(r, float) for r in rings]
    n = len(rings[0])
    faces = []
    for k in range(len(rings) - 1):
        a, b = k * n, (k + 1) * n
        for i in range(n):
            j = (i + 1) % n
            faces += [(a + i, a + j, b + j), (a + i, b + j, b + i)]
    last = (len(rings) - 1) * n
    for i in range(1, n - 1):
        faces += [(0, i + 1, i), (last, last + i, last + i + 1)]
    vertices, faces = np.vstack(rings), np.array(faces)
    if signed_volume(vertices, faces) < 0:
        faces = faces[:, ::-1]
    return vertices, faces


def signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def place(axis: str, uv: np.ndarray, w: float) -> np.ndarray:
    """Points of a plane normal to `axis` at `w`; uv are (y, z), (x, z) or (x, y) for axis x, y, z."""
    return np.insert(np.asarray(uv, float), "xyz".index(axis), w, axis=1)


def prism(axis: str, polygon: Iterable[tuple[float, float]], lo: float, hi: float) -> Piece:
    polygon = np.asarray(list(polygon), float)
    return loft([place(axis, polygon, lo), place(axis, polygon, hi)])


def box(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float) -> Piece:
    return prism("z", [(x0, y0), (x1, y0), (x1, y1), (x0, y1)], z0, z1)


def bevelled(x0, x1, y0, y1, z0, z1, c: float) -> Piece:
    """A box with its four vertical edges and its top edges chamfered by c."""

    def octagon(s: float) -> list[tuple[float, float]]:
        a, b, d, e = x0 + s, x1 - s, y0 + s, y1 - s
        return [(a + c, d), (b - c, d), (b, d + c), (b, e - c), (b - c, e), (a + c, e), (a, e - c), (a, d + c)]

    return loft([place("z", octagon(0), z0), place("z", octagon(0), z1 - c), place("z", octagon(c), z1)])


def circle(radius: float, n: int, centre=(0.0, 0.0)) -> np.ndarray:
    t = 2 * np.pi * (np.arange(n) + 0.5) / n
    return np.asarray(centre) + radius * np.column_stack([np.cos(t), np.sin(t)])


def revolve(axis: str, profile: Iterable[tuple[float, float]], centre=(0.0, 0.0), n: int = 64) -> Piece:
    """A solid of revolution; profile is [(radius, coordinate along the axis), ...]."""
    return loft([place(axis, circle(r, n, centre), w) for r, w in profile])


def cylinder(axis: str, radius: float, lo: float, hi: float, centre=(0.0, 0.0), n: int = 48) -> Piece:
    return revolve(axis, [(radius, lo), (radius, hi)], centre, n)


def sphere(radius: float) -> Piece:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def sector(r0: float, r1: float, z0: float, z1: float, start: float, stop: float, gap: float, n: int) -> Piece:
    """An annular sector between angles start and stop, its flanks set back by half of gap parallel to the radii."""
    rings = []
    inner, outer = (math.asin(gap / 2 / r) for r in (r0, r1))
    for s in np.linspace(0, 1, n + 1):
        ring = []
        for r, z, back in ((r0, z0, inner), (r1, z0, outer), (r1, z1, outer), (r0, z1, inner)):
            t = (1 - s) * (start + back) + s * (stop - back)
            ring.append((r * math.cos(t), r * math.sin(t), z))
        rings.append(ring)
    return loft(rings)


def tube(r0: float, r1: float, z0: float, z1: float, n: int = 64) -> Piece:
    """A hollow cylinder about z."""
    rings = np.array([place("z", circle(r, n), z) for r, z in ((r0, z0), (r1, z0), (r1, z1), (r0, z1))])
    faces = []
    for k in range(4):
        a, b = k * n, (k + 1) % 4 * n
        for i in range(n):
            j = (i + 1) % n
            faces += [(a + i, a + j, b + j), (a + i, b + j, b + i)]
    vertices, faces = rings.reshape(-1, 3), np.array(faces)
    return vertices, faces if signed_volume(vertices, faces) > 0 else faces[:, ::-1]


def mirrored(make: Callable[[float], Piece | list[Piece]]) -> list[Piece]:
    """make(+1) and make(-1) together."""
    out: list[Piece] = []
    for sign in (1.0, -1.0):
        piece = make(sign)
        out += piece if isinstance(piece, list) else [piece]
    return out


def span(sign: float, a: float, b: float) -> tuple[float, float]:
    return (sign * a, sign * b) if sign > 0 else (sign * b, sign * a)


# Parts that stand still.


def bed() -> dict[str, list[Piece]]:
    front = [(-1.16, FLOOR + 0.08), (-1.16, -0.76), (-1.08, -0.68), (0.92, -0.68), (0.92, FLOOR + 0.08)]
    return {
        "bed_casting": [
            prism("x", front, -0.66, 0.66),
            bevelled(-1.02, 1.02, 0.92, 1.72, FLOOR + 0.08, -0.5, 0.03),
            *mirrored(lambda s: box(*span(s, 0.35, 0.49), -1.04, 0.9, -0.68, -0.61)),
        ],
        "bed_guides": [
            *mirrored(lambda s: box(*span(s, GUIDE_Y - 0.02, GUIDE_Y + 0.02), -1.03, 0.89, -0.61, -0.575)),
            cylinder("y", 0.02, -1.0, 0.86, (0.0, -0.61), 24),
        ],
        "bed_trim": [
            cylinder("y", 0.075, -1.30, -1.16, (0.0, -0.86)),
            box(-0.10, 0.10, -1.18, -1.00, -0.68, -0.55),
            box(-0.08, 0.08, 0.80, 0.90, -0.68, -0.56),
            box(-0.70, 0.70, -1.20, 0.90, FLOOR + 0.04, FLOOR + 0.14),
        ],
        "bed_feet": [
            cylinder("z", 0.07, FLOOR, FLOOR + 0.06, (x, y), 24)
            for x, y in [(-0.55, -1.0), (0.55, -1.0), (-0.55, 0.0), (0.55, 0.0), (-0.85, 1.1), (0.85, 1.1), (-0.85, 1.6), (0.85, 1.6)]
        ]
        + [bevelled(-0.98, 0.98, 0.96, 1.68, FLOOR, FLOOR + 0.09, 0.02)],
    }


def column() -> dict[str, list[Piece]]:
    upright = [(COLUMN_FACE, -0.50), (1.66, -0.50), (1.40, 0.85), (1.40, 1.42), (COLUMN_FACE, 1.42)]
    return {
        "column_casting": [
            *mirrored(lambda s: prism("x", upright, *span(s, 0.6, 0.96))),
            box(-0.6, 0.6, COLUMN_FACE, 1.34, 0.5, 1.42),
            box(-0.6, 0.6, 1.08, 1.56, -0.5, -0.2),
        ],
        "column_guides": [box(-0.95, 0.95, 0.950, COLUMN_FACE, z - 0.022, z + 0.022) for z in (0.62, 1.30)]
        + [cylinder("x", 0.020, -0.90, 0.90, (0.945, 0.96), 24)],
        "column_trim": [
            bevelled(-0.98, 0.98, COLUMN_FACE + 0.02, 1.42, 1.42, 1.5, 0.02),
            box(0.86, 0.96, 0.9, COLUMN_FACE, 0.89, 1.03),
            box(-0.96, -0.88, 0.9, COLUMN_FACE, 0.9, 1.02),
            cylinder("x", 0.06, 0.96, 1.2, (0.93, 0.96)),
            *mirrored(lambda s: prism("x", [(1.06, -0.3), (1.5, -0.3), (1.3, 0.75), (1.06, 0.75)], *span(s, 0.96, 0.975))),
        ],
    }


# Parts that move.


def y_slide() -> dict[str, list[Piece]]:
    t = np.linspace(np.radians(-20), np.radians(200), 33)
    support = [(-0.27, DECK_TOP)] + [(0.27, DECK_TOP)] + [(0.175 * math.cos(a), 0.175 * math.sin(a)) for a in t]
    return {
        "y_slide_casting": [
            bevelled(-0.6, 0.6, -0.34, 0.34, -0.51, DECK_TOP, 0.02),
            *mirrored(lambda s: prism("x", support, *span(s, 0.45, 0.58))),
        ],
        "y_slide_carriages": [
            box(*span(s, GUIDE_Y - 0.055, GUIDE_Y + 0.055), *span(e, 0.16, 0.33), -0.572, -0.510) for s in (1, -1) for e in (1, -1)
        ],
        "y_slide_caps": [revolve("x", [(0.135, -0.580), (0.135, -0.600), (0.115, -0.615)])],
        # Worm gear box and motor of the A axis, on the side of +X.
        "a_drive": [
            prism(
                "x",
                [(-0.19, -0.19), (0.19, -0.19), (0.22, -0.15), (0.22, 0.16), (0.16, 0.20), (-0.16, 0.20), (-0.22, 0.14), (-0.22, -0.15)],
                0.580,
                0.700,
            ),
            cylinder("y", 0.060, 0.22, 0.46, (0.65, -0.11)),
            revolve("x", [(0.110, 0.700), (0.110, 0.715), (0.095, 0.725)]),
        ],
    }


def cradle(plate_height: float) -> dict[str, list[Piece]]:
    cheek = [
        (-0.17, -0.20),
        (0.17, -0.20),
        (0.28, -0.03),
        (0.28, 0.07),
        (0.25, CHEEK_TOP),
        (-0.25, CHEEK_TOP),
        (-0.28, 0.07),
        (-0.28, -0.03),
    ]
    return {
        "cradle_casting": [
            *mirrored(lambda s: prism("x", cheek, *span(s, CHEEK_INNER, CHEEK_OUTER))),
            box(-CHEEK_INNER, CHEEK_INNER, -0.165, 0.165, -0.198, -0.15),
            revolve("z", [(0.2, -0.15), (0.16, -0.11), (0.16, -0.005)]),
        ],
        "cradle_journals": mirrored(
            lambda s: revolve("x", [(0.125, s * CHEEK_OUTER), (0.125, s * 0.425), (0.085, s * 0.425), (0.085, s * 0.450)])
        ),
        "cradle_plates": mirrored(lambda s: box(*span(s, CHEEK_INNER, CHEEK_OUTER), -0.22, 0.22, CHEEK_TOP, CHEEK_TOP + plate_height)),
    }


def table() -> dict[str, list[Piece]]:
    """Eightfold symmetric, so that it is balanced and the inertia about A does not change with C."""
    pitch = 2 * math.pi / SLOTS
    floor = TABLE_TOP - SLOT_DEPTH
    ticks = []
    for k in range(72):
        half, height = 0.0009, 0.014 if k % 6 == 0 else 0.008
        ring = np.array(
            [(TABLE_RADIUS - 0.001, -half), (TABLE_RADIUS + 0.0004, -half), (TABLE_RADIUS + 0.0004, half), (TABLE_RADIUS - 0.001, half)]
        )
        t = math.radians(5 * k)
        turned = ring @ np.array([[math.cos(t), math.sin(t)], [-math.sin(t), math.cos(t)]])
        ticks.append(prism("z", turned, floor + 0.006, floor + 0.006 + height))
    z0, z1 = TABLE_TOP - 0.001, TABLE_TOP + 0.0006
    arrow = np.array([(0.292, 0.0), (0.235, 0.028), (0.235, -0.028)]) @ np.array(
        [[math.cos(pitch / 2), math.sin(pitch / 2)], [-math.sin(pitch / 2), math.cos(pitch / 2)]]
    )
    return {
        "table_base": [
            revolve("z", [(0.150, 0.005), (0.150, TABLE_BOTTOM)], n=96),
            revolve("z", [(0.300, TABLE_BOTTOM), (TABLE_RADIUS, TABLE_BOTTOM + 0.010), (TABLE_RADIUS, floor)], n=96),
        ],
        "table_top": [sector(0.060, TABLE_RADIUS, floor, TABLE_TOP, k * pitch, (k + 1) * pitch, SLOT_WIDTH, 12) for k in range(SLOTS)]
        + [tube(0.025, 0.048, floor, TABLE_TOP - 0.002)],
        # Paint, without mass: the degree scale on the rim and the arrow and strip that show where C is.
        "table_scale": ticks,
        "table_mark": [
            prism("z", arrow, z0, z1),
            sector(0.075, 0.230, z0, z1, pitch / 2, pitch / 2 + 1e-9, -0.012, 1),
            sector(TABLE_RADIUS - 0.001, TABLE_RADIUS + 0.0008, floor + 0.001, TABLE_TOP, pitch / 2 - 0.07, pitch / 2 + 0.07, 0.0, 8),
        ],
    }


def table_fixture() -> dict[str, list[Piece]]:
    """Magnetic-cup post under the table ball; the origin is the ball's centre. Without mass."""
    bottom = TABLE_TOP - BALL_HEIGHT
    return {
        "fixture_base": [revolve("z", [(0.026, bottom), (0.026, bottom + 0.014), (0.022, bottom + 0.018)])],
        "fixture_post": [revolve("z", [(0.0100, bottom + 0.018), (0.0085, -0.024), (0.0085, -0.018)])],
        "fixture_cup": [revolve("z", [(0.0085, -0.018), (0.0110, -0.014), (0.0100, -0.0078)])],
        "ball": [sphere(BALL_RADIUS)],
    }


def x_slide() -> dict[str, list[Piece]]:
    return {
        "x_slide_casting": [bevelled(-0.33, 0.33, 0.745, 0.915, 0.50, 1.42, 0.02)],
        "x_slide_carriages": [box(*span(s, 0.18, 0.32), 0.915, 0.948, z - 0.055, z + 0.055) for s in (1, -1) for z in (0.62, 1.30)]
        + [box(*span(s, 0.125, 0.215), 0.712, 0.745, z - 0.08, z + 0.08) for s in (1, -1) for z in (0.62, 1.28)],
        "x_slide_trim": [box(-0.075, 0.075, 0.745, 0.905, 1.42, 1.52), cylinder("z", 0.065, 1.52, 1.78, (0.0, 0.825))],
    }


def z_slide() -> dict[str, list[Piece]]:
    plan = [(-0.24, 0.52), (0.24, 0.52), (0.24, 0.40), (0.15, -0.06), (0.09, -0.135), (-0.09, -0.135), (-0.15, -0.06), (-0.24, 0.40)]
    plan = np.array(plan)
    shrunk = np.array([0.0, 0.20]) + (plan - [0.0, 0.20]) * 0.94
    return {
        "z_slide_casting": [
            loft([place("z", shrunk, 0.57), place("z", plan, 0.60), place("z", plan, 0.97), place("z", shrunk, 1.00)]),
            bevelled(-0.24, 0.24, 0.52, 0.690, 0.54, 1.50, 0.02),
        ],
        "z_slide_guides": [
            *mirrored(lambda s: box(*span(s, 0.15, 0.19), 0.69, 0.711, 0.55, 1.47)),
            cylinder("z", 0.016, 0.55, 1.47, (0.0, 0.712), 24),
        ],
        "z_slide_motor": [
            revolve("z", [(0.120, 1.00), (0.120, 1.03), (0.100, 1.04), (0.100, 1.30), (0.080, 1.33)]),
        ],
        "z_slide_trim": mirrored(lambda s: prism("x", [(0.541, 0.62), (0.67, 0.62), (0.67, 1.38), (0.541, 1.38)], *span(s, 0.238, 0.246))),
    }


def spindle() -> dict[str, list[Piece]]:
    return {
        "spindle_housing": [revolve("z", [(0.072, 0.300), (0.088, 0.330), (0.088, 0.530), (0.105, 0.540), (0.105, 0.570)])],
        "spindle_nose": [revolve("z", [(0.040, 0.220), (0.044, 0.224), (0.044, 0.262), (0.064, 0.266), (0.064, 0.300)])],
        "spindle_holder": [
            revolve("z", [(0.0060, 0.022), (0.0065, 0.085), (0.0160, 0.105), (0.0160, 0.150), (0.0310, 0.165), (0.0310, 0.220)]),
        ],
        "spindle_cup": [revolve("z", [(0.0095, 0.0085), (0.0105, 0.014), (0.0060, 0.022)])],
    }


# Mass balance.


def solid(pieces: list[Piece]) -> trimesh.Trimesh:
    """The part as MuJoCo will read it: vertices rounded to 0.1 um (so that no platform's last bit shows), then to float32."""
    offset, vertices, faces = 0, [], []
    for v, f in pieces:
        vertices.append(np.float32(np.round(v, 7) + 0.0))
        faces.append(f + offset)
        offset += len(v)
    return trimesh.Trimesh(np.vstack(vertices).astype(float), np.vstack(faces), process=False)


def densities() -> dict[str, float]:
    """Density of every default class of the model file [kg/m3]; classes of no mass have none."""
    out: dict[str, float] = {}

    def walk(node: ET.Element, density: float) -> None:
        geom = node.find("geom")
        if geom is not None:
            density = 0.0 if geom.get("mass") == "0" else float(geom.get("density", density))
        out[node.get("class", "main")] = density
        for child in node.findall("default"):
            walk(child, density)

    walk(ET.parse(XML).getroot().find("default"), 1000.0)
    return out


def bodies() -> dict[str, dict[str, str]]:
    """Body name -> {mesh: default class} of the model file."""
    root = ET.parse(XML).getroot().find("worldbody")
    return {b.get("name"): {g.get("mesh"): g.get("class") for g in b.findall("geom")} for b in root.iter("body")}


def mass_properties(parts: dict[str, list[Piece]], names: Iterable[str]) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia about the world origin of the named bodies' meshes."""
    density, tree = densities(), bodies()
    mass, moment, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    for name in names:
        for mesh, kind in tree[name].items():
            rho = density[kind]
            if rho == 0.0:
                continue
            p = solid(parts[mesh]).mass_properties
            m, c = rho * p.volume, p.center_mass
            mass += m
            moment += m * c
            inertia += rho * p.inertia / p.density + m * (c @ c * np.eye(3) - np.outer(c, c))
    return mass, moment / mass if mass else moment, inertia


def balance_plate_height() -> float:
    """Height of the balance plates [m]: the first moment of cradle and table about the A centreline is zero."""
    fixed = cradle(1.0) | table()
    del fixed["cradle_plates"]
    density, tree = densities(), bodies()
    need = 0.0
    for mesh, pieces in fixed.items():
        p = solid(pieces)
        kind = tree["cradle"].get(mesh) or tree["table"].get(mesh)
        need -= density[kind] * p.volume * p.center_mass[2]
    # rho * area * (CHEEK_TOP + h/2) * h = need
    area = 2 * (CHEEK_OUTER - CHEEK_INNER) * 0.44
    q = need / (density[tree["cradle"]["cradle_plates"]] * area)
    if q <= 0:
        raise ValueError(f"cradle and table are top-heavy by {-need:.3f} kg m, balance plates cannot help")
    return math.sqrt(CHEEK_TOP**2 + 2 * q) - CHEEK_TOP


def build() -> dict[str, list[Piece]]:
    parts: dict[str, list[Piece]] = {}
    for group in (bed(), column(), y_slide(), cradle(balance_plate_height()), table(), table_fixture(), x_slide(), z_slide(), spindle()):
        parts |= group
    return parts


def stl(pieces: list[Piece]) -> bytes:
    """Binary STL with a constant header."""
    mesh = solid(pieces)
    if not mesh.is_watertight and not trimesh.Trimesh(mesh.vertices, mesh.faces, process=True).is_watertight:
        raise ValueError("a piece is not closed")
    record = np.zeros(len(mesh.faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    record["corners"] = mesh.vertices[mesh.faces]
    header = b"mjsim five-axis machine, metres".ljust(80, b" ")
    return header + np.uint32(len(record)).astype("<u4").tobytes() + record.tobytes()


def report(parts: dict[str, list[Piece]]) -> str:
    """Masses, and the armatures that make up the data sheet's J * gear^2."""
    mass_x = mass_properties(parts, ["x_slide", "z_slide", "spindle"])[0]
    mass_y = mass_properties(parts, ["y_slide", "cradle", "table"])[0]
    mass_z = mass_properties(parts, ["z_slide", "spindle"])[0]
    _, com, inertia_a = mass_properties(parts, ["cradle", "table"])
    inertia_c = mass_properties(parts, ["table"])[2]
    carried = {"X": mass_x, "Y": mass_y, "Z": mass_z, "A": inertia_a[0, 0], "C": inertia_c[2, 2]}
    lines = [f"balance plates {1e3 * balance_plate_height():.3f} mm, centre of mass of cradle and table {np.round(1e6 * com, 3)} um"]
    for axis, (j, gear) in DRIVES.items():
        total = j * gear**2
        lines.append(f"{axis}: J gear^2 = {total:.9g}, bodies = {carried[axis]:.9g}, armature = {total - carried[axis]:.10g}")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare with models/assets instead of writing")
    check = parser.parse_args().check
    parts = build()
    files = {f"{name}.stl": stl(pieces) for name, pieces in parts.items()}
    present = {p.name for p in ASSETS.glob("*.stl")}
    if check:
        wrong = sorted(n for n, b in files.items() if n not in present or (ASSETS / n).read_bytes() != b)
        wrong += sorted(present - set(files))
        if wrong:
            print("differ from what scripts/build_model.py makes:", ", ".join(wrong))
        return 1 if wrong else 0
    ASSETS.mkdir(parents=True, exist_ok=True)
    for name in present - set(files):
        (ASSETS / name).unlink()
    for name, content in files.items():
        (ASSETS / name).write_bytes(content)
    print(report(parts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
