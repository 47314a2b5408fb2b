"""What the structure of a wild machine does beside the catalogue: slides that turn, modes that ring, balls that are
eggs.

Every function takes the machine's ideal kinematics: these errors are micrometres, and first order is enough. All are
tables of the true machine's effects, as those of the catalogue, under names that mjsim does not know:

    slide_angles.X      {"A": [linear, quadratic, cubic], "B": ..., "C": ..., "point_mm": [x, y, z]}   µrad at 100 mm
    functional_point.X  {"mm": [x, y, z]}   about which the angular errors of the catalogue turn; at 0 without it
    structural_mode.tool, structural_mode.table
                        {"frequency_Hz", "damping_ratio", "along": [x, y, z], "share"}
    egg.spindle, egg.table
                        {"amplitude_um", "axis": [x, y, z]}
"""

from __future__ import annotations

import numpy as np
from scipy.signal import cont2discrete, lfilter

from .chains import Kinematics
from .kinematics import MICRO

#: Travel at which the angles of a slide are stated, m.
AT = 0.1


def turn_by_slides(machine: Kinematics, effects: dict, q: dict[str, np.ndarray], ball: np.ndarray) -> np.ndarray:
    """Displacement of the spindle ball against the table ball, (n, 3) m, by slides that roll, pitch and yaw.

    A slide that turns by ε(q) about its functional point moves the ball that it carries by ε × arm. The arm is what the
    axes between that slide and the ball make of it.

    Args:
        machine: ideal kinematics. effects: id -> parameters. q: axis -> position (n,), m and rad. ball: table ball, m.
    """
    out = np.zeros((len(next(iter(q.values()))), 3))
    for name, e in effects.items():
        kind, axis = name.split(".")[0], name[-1]
        if kind == "angular_error":
            mine = [e["linear_urad"], e.get("quadratic_urad", 0.0)]
            point = effects.get(f"functional_point.{axis}", {"mm": [0.0, 0.0, 0.0]})["mm"]
            e = {"A": [0.0], "B": [0.0], "C": [0.0], name[-2]: mine, "point_mm": point}
        elif kind != "slide_angles":
            continue
        side = axis in machine.sides[1]
        chain = machine.sides[side]  # from the ball to the bed
        outside = {a: v for a, v in q.items() if a not in chain[chain.index(axis) :]}
        end = machine.ends({a: outside.get(a, np.zeros(len(out))) for a in q}, {}, ball)[side]
        travel = q[axis] / AT
        angles = [sum(c * travel ** (k + 1) for k, c in enumerate(e[about])) for about in "ABC"]
        moved = np.cross(MICRO * np.column_stack(angles), end - 1e-3 * np.array(e["point_mm"]))
        out += moved if side else -moved
    return out


def ring(acceleration: np.ndarray, frequency: float, damping: float, step: float) -> np.ndarray:
    """Deflection of a mass on a spring whose foot is accelerated: u'' + 2 ζ ω u' + ω² u = −a, at rest at first.

    Args:
        acceleration: of the foot, (n,) m/s², straight between its samples. frequency: Hz. damping: ratio. step: s.
    """
    omega = 2.0 * np.pi * frequency
    top, bottom, _ = cont2discrete(([-1.0], [1.0, 2.0 * damping * omega, omega**2]), step, method="foh")
    return lfilter(np.ravel(top), bottom, acceleration)


def ring_modes(
    machine: Kinematics, effects: dict, q: dict[str, np.ndarray], ball: np.ndarray, step: float
) -> np.ndarray:
    """Displacement of the spindle ball against the table ball, (n, 3) m, by modes of the spindle head and of the
    table that the axes excite. ``q`` is on a grid of ``step`` s; arguments as of :func:`turn_by_slides`.
    """
    out = np.zeros((len(next(iter(q.values()))), 3))
    modes = {n.split(".")[1]: e for n, e in effects.items() if n.startswith("structural_mode.")}
    if not modes:
        return out
    ends = dict(zip(("table", "tool"), machine.ends(q, {}, ball), strict=True))
    for where, e in modes.items():
        direction = np.array(e["along"]) / np.linalg.norm(e["along"])
        along = np.broadcast_to(ends[where] @ direction, len(out))  # a table on the bed is one point for all instants
        acceleration = np.gradient(np.gradient(along, step), step)
        u = e["share"] * ring(acceleration, e["frequency_Hz"], e["damping_ratio"], step)
        out += (1.0 if where == "tool" else -1.0) * np.outer(u, direction)
    return out


def read_eggs(machine: Kinematics, effects: dict, q: dict[str, np.ndarray], ball: np.ndarray) -> np.ndarray:
    """What balls that are longer along one axis of their own add to the reading, (n,) m: amplitude (cos²(angle between
    the bar and the axis) − 1/3). Each ball turns with what holds it.
    """
    out = np.zeros(len(next(iter(q.values()))))
    if not {"egg.table", "egg.spindle"} & effects.keys():
        return out
    table, spindle = machine.ends(q, {}, ball)
    bar = spindle - table
    bar /= np.linalg.norm(bar, axis=1)[:, None]
    for which, name in enumerate(("egg.table", "egg.spindle")):
        if e := effects.get(name):
            axis = np.array(e["axis"]) / np.linalg.norm(e["axis"])
            end = machine.ends(q, {}, ball + axis * (which == 0), axis * (which == 1))[which]
            along = np.sum((end - (table, spindle)[which]) * bar, axis=1)
            out += MICRO * e["amplitude_um"] * (along**2 - 1.0 / 3.0)
    return out
