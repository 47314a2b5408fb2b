"""Writing the program that probes a sphere at planned positions, for LinuxCNC.

Every position is approached with the probe above everything. The rotary axes come from the side that is planned. Then
the sphere is touched from above and from the sides that its stem leaves free, with ``G38.2`` (LinuxCNC 2.9 G-Code
Reference, G38.n Straight Probe: it stops on contact, and an error ends the program where there is none). Down beside
the sphere it goes with ``G38.3``, which stops too where something is in the way. LinuxCNC writes where the probe has
switched into a file: ``(PROBEOPEN …)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.base import LEAD_ROTARY
from mjsim.instruments.sphere.measurement import SphereTest, sides_of_points
from mjsim.nc.limits import Limits, check_travel, model_limits, scale
from mjsim.nc.read import NCFile, parse_nc
from mjsim.units import DEG, MM

#: Decimals of positions, mm and degrees.
_DECIMALS = 4


@dataclass(frozen=True)
class Probing:
    """How a sphere is probed.

    Attributes:
        sphere: Diameter of the sphere, m.
        tip: Diameter of the probe's tip, m.
        clearance: From where the tip starts to where it would touch; so far it goes on beyond, too, m.
        safe: Height above the highest place of the sphere at which the rotary axes move, m.
        feed: Of the touches, m/s.
        descent: Of the way down beside the sphere, m/s.
    """

    sphere: float
    tip: float
    clearance: float = 3 * MM
    safe: float = 100 * MM
    feed: float = 100 * MM / 60.0
    descent: float = 1000 * MM / 60.0

    @property
    def reach(self) -> float:
        """Distance of the centres where the tip touches, m."""
        return 0.5 * (self.sphere + self.tip)


def probing_program(
    test: SphereTest, how: Probing, limits: Limits | None = None, machine: str = ""
) -> tuple[str, NCFile]:
    """The program of a planned test, and the motion that it commands if the probe never switches.

    Args:
        test: With its positions.
        how: Of the probing.
        limits: Of the axes; without it the machine model's.
        machine: Name of the machine, for the comments.

    Raises:
        InputError: Nothing is planned, a head turns, the stem is in the way, or an axis leaves its travel.
    """
    if not test.angles:
        raise InputError(f'test "{test.name}": no positions are planned')
    if how.clearance >= how.reach:
        raise InputError(f"clearance of {how.clearance / MM:g} mm; allowed: less than {how.reach / MM:g} mm")
    letters, planned = test.chain.letters, test.planned
    linear = letters[test.chain.linear_columns]
    rotary = letters[test.chain.rotary_columns]
    top = planned.position[:, 2].max() + how.safe
    lines = [*_head(test, how, machine), "G90 G17 G21 G40 G80 G54", "G94", "M5", f"(PROBEOPEN {test.name}.txt)"]
    spindle = None if planned.spindle.any() else 0.0  # where it turns, its angle at the start is not left to chance
    for i, sides in enumerate(sides_of_points(test)):
        centre = planned.position[i, test.chain.linear_columns]
        angles = planned.position[i, test.chain.rotary_columns]
        lead = angles - planned.side[i] * LEAD_ROTARY
        lines += [f"(point {i + 1})", f"G0 {_words(linear[2:], [top])}", f"G0 {_words(rotary, lead)}"]
        lines += [f"G0 {_words(rotary, angles)}"] if len(rotary) else []
        if planned.spindle[i] != spindle:
            spindle = planned.spindle[i]
            lines.append(f"M19 R{np.mod(spindle / DEG, 360.0):.3f}")
        lines.append(f"G0 {_words(linear[:2], centre[:2])}")
        above = centre[2] + how.reach + how.clearance
        lines.append(f"G0 {_words(linear[2:], [above])}")
        for side in sides:
            start, end = (centre + d * side for d in (how.reach + how.clearance, how.reach - how.clearance))
            if not side[2]:
                lines.append(f"G0 {_words(linear[:2], start[:2])}")
                lines.append(f"G38.3 {_words(linear[2:], start[2:])} F{how.descent / MM * 60:g}")
            lines.append(f"G38.2 {_words(linear, end)} F{how.feed / MM * 60:g}")
            lines.append(f"G0 {_words(linear, start)}")
            if not side[2]:
                lines.append(f"G0 {_words(linear[2:], [above])}")
    text = "\n".join([*lines, f"G0 {_words(linear[2:], [top])}", "(PROBECLOSE)", "M2", ""])
    read = parse_nc(text, Path(f"{test.name}.ngc"), "linuxcnc", chain=test.chain)
    check_travel(read.motion, limits or model_limits(test.chain), read.place)
    return text, read


def _words(letters, values) -> str:
    """Words of some axes at their values, m and rad."""
    return " ".join(f"{a}{v / scale(a) + 0.0:.{_DECIMALS}f}" for a, v in zip(letters, values, strict=True))


def _head(test: SphereTest, how: Probing, machine: str) -> list[str]:
    x, y, z = (f"{v / MM:g}" for v in test.sphere)
    rows = [
        f"mjsim sphere test {test.name}",
        *([f"machine {machine}"] if machine else []),
        f"sphere X{x} Y{y} Z{z} mm on the table with all axes at 0, {how.sphere / MM:g} mm; tip {how.tip / MM:g} mm",
        f"{len(test.angles)} positions of the tip's centre, axis positions without tool centre point control",
        "zero point and length of the probe as for the ball-bar programs of this machine",
        f"the rotary axes move {how.safe / MM:g} mm above the highest place of the sphere",
        "not tried on a real control: run it clear of everything first",
    ]
    return [f"({row.replace('(', '[').replace(')', ']')})" for row in rows]
