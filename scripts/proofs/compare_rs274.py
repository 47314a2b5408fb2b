#!/usr/bin/env python3
"""Compare how mjsim reads NC programs with the canonical motions of LinuxCNC's stand-alone interpreter ``rs274``.

    scripts/proofs/compare_rs274.py part.ngc other.ngc
    scripts/proofs/compare_rs274.py --machine machine.toml --ini xyzac-trt.ini demos/*.ngc

Every end of a canonical motion is held against the end of the same motion as mjsim has it, in the coordinates of the
program, and every chord of an arc against the circle. A program of plain blocks is read by mjsim itself, one with
variables or o-words through the interpreter. The interpreter prints four decimals. It knows nothing of tilted planes:
there the ends are turned as LinuxCNC's remap.py turns them, and the tool is held against the normal of the plane.
"""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mjsim.campaign.machine_file import read_machine
from mjsim.errors import InputError
from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.machine.kinematics import spindle_in_work
from mjsim.nc.interpreter import Configuration, canonical, needs_interpreter
from mjsim.nc.limits import scale
from mjsim.nc.read import NCFile, read_nc

_CALL = re.compile(r"\s*\d+\s+N\S*\s+(\w+)\((.*)\)\s*$")


@dataclass(frozen=True)
class End:
    """Where a canonical motion ends.

    Attributes:
        line: Of the program.
        place: (axes,) mm and degrees; not a number where the interpreter does not know it.
        circle: First and second axis of a plane, and the centre in it, where the motion is an arc.
        normal: (3,) of the tilted plane that the tool is normal to, if any.
        turns: Whether it is a code that turns the rotary axes, of which the interpreter prints no motion.
    """

    line: int
    place: np.ndarray
    circle: tuple | None = None
    normal: np.ndarray | None = None
    turns: bool = False


def canonical_ends(file: Path, chain: Chain, ini: Path | None) -> list[End]:
    """Ends of all motions of ``rs274``; tilted planes by the rotations of LinuxCNC's remap.py."""
    configuration = Configuration(ini)
    printed, error = canonical(file.read_text(errors="replace"), file, chain, configuration)
    if error:
        raise InputError(f"{file}: rs274 says {error}")
    letters, out = "XYZABC", []
    line, inch, plane, silent = 0, False, "XY", False
    zero, preset, last = np.zeros(6), np.zeros(6), np.zeros(0)
    frame: tuple[Rotation, np.ndarray] | None = None
    turned = False
    for text in printed:
        call = _CALL.match(text)
        if not call:
            continue
        name, arguments = call[1], call[2]
        if name == "MESSAGE":
            found = re.match(r'"@line (\d+)"', arguments)
            line = int(found[1]) if found else line
            silent = arguments == '"@sync"' or (silent and not arguments.startswith(('"@tip', '"@away')))
            if arguments.startswith('"@G'):
                code, *given = arguments.strip('"')[2:].split()
                words = {k: float(v) for k, _, v in (w.partition("=") for w in given) if "#" not in v}
                xyz = np.array([words.get(a, np.nan) for a in "xyz"])
                if code in ("68.2", "68.4"):
                    order = "".join("xyz"[int(c) - 1].upper() for c in f"{int(words.get('q', 313))}")
                    tilt = Rotation.from_euler(order, [words.get(a, 0.0) for a in "ijk"], degrees=True)
                    before = (
                        frame if frame is not None and code == "68.4" else (Rotation.identity(), (zero + preset)[:3])
                    )
                    frame = before[0] * tilt, before[1] + before[0].apply(np.nan_to_num(xyz))
                    turned = False
                elif code == "69":
                    frame = None
                elif frame is not None:
                    turned = True
                    place = np.full(6, np.nan)
                    place[:3] = frame[0].apply(xyz) + frame[1] if code == "53.3" else np.nan
                    place = place[[letters.index(a) for a in chain.letters]]
                    out.append(End(line, place, None, frame[0].apply([0, 0, 1]), turns=True))
                last = np.zeros(0)
        elif name == "USE_LENGTH_UNITS":
            inch = "INCH" in arguments
        elif name == "SELECT_PLANE":
            plane = arguments.rpartition("_")[2]
        elif name in ("SET_G5X_OFFSET", "SET_G92_OFFSET"):
            values = np.array([float(v) for v in arguments.split(",")][-6:])
            values[:3] *= 25.4 if inch else 1.0
            zero, preset = (values, preset) if "G5X" in name else (zero, values)
        elif name in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED", "ARC_FEED"):
            values = np.array([float(v) for v in arguments.split(",")])
            circle, place = None, values[:6].copy()
            if name == "ARC_FEED":
                i, j, k = {"XY": (0, 1, 2), "XZ": (2, 0, 1), "YZ": (1, 2, 0)}[plane]
                place = np.zeros(6)
                place[[i, j, k]], place[3:] = values[[0, 1, 5]], values[6:9]
                centre = values[2:4] * (25.4 if inch else 1.0) + (zero + preset)[[i, j]]
                circle = (i, j, centre)
            place[:3] *= 25.4 if inch else 1.0
            normal = None
            if frame is None:
                place += zero + preset
            else:
                place[:3] = frame[0].apply(np.where(place[:3] < -5e4, np.nan, place[:3])) + frame[1]
                place[3:] = np.nan
                normal = frame[0].apply([0, 0, 1]) if turned else None
            if configuration.moves_tool:
                place[:3] -= _radius(*place[3:])
            end = place[[letters.index(a) for a in chain.letters]]
            if not silent and (circle is not None or not np.array_equal(end, last, equal_nan=True)):
                out.append(End(line, end, circle, normal))
            last = end
    return out


def _radius(w: float, b: float, c: float) -> np.ndarray:
    """What W adds to the joints of a bridge mill, (3,) mm (LinuxCNC, src/emc/kinematics/5axiskins.c: ``s2r``)."""
    p, t = np.radians(180.0 - b), np.radians(c)
    return w * np.array([np.sin(p) * np.cos(t), np.sin(p) * np.sin(t), np.cos(p)])


def _tool(chain: Chain, place: np.ndarray) -> np.ndarray:
    """Direction of the tool of a head, (3,)."""
    turn = Rotation.identity()
    for axis in chain.swivelling[::-1]:
        turn = turn * Rotation.from_rotvec(np.radians(place[chain.index(axis.letter)]) * np.array(axis.unit))
    return turn.apply([0, 0, 1])


def compare(nc: NCFile, wanted: list[End]) -> tuple[float, float, float, int]:
    """Largest difference of ends in µm and degrees, of chords from their circles in µm, and the number of motions.

    Raises:
        InputError: the motions do not follow each other in the same order.
    """
    chain = nc.motion.chain
    units = np.array([scale(a) for a in chain.letters])
    points, linear = nc.motion.points / units, chain.linear_columns
    at, linear_um, degrees, off, count = 0, 0.0, 0.0, 0.0, 0
    begun, last = False, np.zeros(len(units))
    for one in wanted:
        line, end, circle, ahead = one.line, one.place, one.circle, at + 1
        if not begun:  # moves before the first feed block are left out
            before, last = last, end
            if line == nc.lines[1] and np.nanmax(np.abs(before - points[0]), initial=0.0) < 2e-3:
                begun = True
            elif line == nc.lines[0] and np.nanmax(np.abs(end - points[0]), initial=0.0) < 2e-3:
                begun, ahead = True, 0
            else:
                continue
        if ahead >= len(points):
            break
        if one.turns and nc.lines[ahead] != line:  # the axes were there already
            continue
        if ahead == 0:
            pass
        elif circle is not None:
            while (
                ahead + 1 < len(points)
                and nc.lines[ahead + 1] == nc.lines[ahead]
                and (np.abs(points[ahead] - end).max() > 2e-4)
            ):
                ahead += 1
            i, j, centre = circle
            radii = np.hypot(*(points[at : ahead + 1][:, [i, j]] - centre).T)
            off = max(off, float(np.abs(radii - radii[0]).max()) * 1e3)
        if one.turns:  # a place of the axes in the reader, and of the tip in the program
            points[ahead, linear] = spindle_in_work(chain, (points[ahead] * units)[None])[0] / units[linear]
        difference = np.nan_to_num(np.abs(points[ahead] - end))
        linear_um = max(linear_um, float(difference[linear].max()) * 1e3)
        degrees = max(degrees, float(difference[linear.stop :].max(initial=0.0)))
        if one.normal is not None:
            degrees = max(degrees, float(np.degrees(np.linalg.norm(_tool(chain, points[ahead]) - one.normal))))
        at, count = ahead, count + 1
    if at < len(points) - 1:
        raise InputError(f"{nc.path}: {len(points) - 1 - at} points have no canonical motion")
    return linear_um, degrees, off, count


def main() -> int:
    """Print one line per program."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--machine", type=Path, help="machine file whose axes the programs move")
    parser.add_argument("--ini", type=Path, help="configuration of LinuxCNC with subprograms and tools")
    a = parser.parse_args()
    chain = read_machine(a.machine).chain if a.machine else FIVE_AXIS
    worst = 0
    for file in a.files:
        try:
            nc = read_nc(file, "linuxcnc", chain=chain, ini=a.ini)
            linear, degrees, off, count = compare(nc, canonical_ends(file, chain, a.ini))
        except InputError as error:
            print(f"{file.name}: refused: {error}")
            worst = 1
            continue
        inches = bool(re.search(r"\bG20", file.read_text(errors="replace"), re.IGNORECASE))
        by = "through rs274" if needs_interpreter(file.read_text(errors="replace")) else "by mjsim"
        most = 1.5 if inches else 1.0  # half of the last decimal that is printed is 1.27 µm
        good = linear <= most and off <= 2.0 * most and degrees <= 1e-4
        print(
            f"{file.name}: read {by}, {count} motions, ends within {linear:.3f} µm and {degrees:.6f}°, arcs within "
            f"{off:.3f} µm{'' if good else ': DIFFERS'}"
        )
        worst = worst or int(not good)
    return worst


if __name__ == "__main__":
    sys.exit(main())
