"""Solids of the table's side: bed, slide, cradle, turntable, fixture. Mesh name -> pieces."""

from __future__ import annotations

import math

import numpy as np

from mjsim.machine.modelling.dimensions import Dimensions
from mjsim.machine.modelling.pieces import (
    Piece,
    bevelled,
    box,
    cylinder,
    mirrored,
    prism,
    revolve,
    sector,
    span,
    sphere,
    tube,
    turned,
)

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
