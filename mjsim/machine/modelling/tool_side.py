"""Solids of the tool's side: column, slides across and along the spindle, spindle. Mesh name -> pieces."""

from __future__ import annotations

import numpy as np

from mjsim.machine.modelling.dimensions import Dimensions
from mjsim.machine.modelling.pieces import (
    Piece,
    bevelled,
    box,
    cylinder,
    loft,
    mirrored,
    place,
    prism,
    revolve,
    span,
    sphere,
)


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
