#!/usr/bin/env python3
"""Compare how mjsim reads NC programs with the canonical motions of LinuxCNC's stand-alone interpreter ``rs274``.

    scripts/compare_rs274.py part.ngc other.ngc
    scripts/compare_rs274.py --machine machine.toml --ini xyzac-trt.ini demos/*.ngc

Every end of a canonical motion is held against the end of the same motion as mjsim has it, in the coordinates of the
program, and every chord of an arc against the circle. A program of plain blocks is read by mjsim itself, one with
variables or o-words through the interpreter. The interpreter prints four decimals.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

import numpy as np

from mjsim.campaign.machine_file import read_machine
from mjsim.errors import InputError
from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.nc.interpreter import Configuration, canonical, needs_interpreter
from mjsim.nc.limits import scale
from mjsim.nc.read import NCFile, read_nc

_CALL = re.compile(r"\s*\d+\s+N\S*\s+(\w+)\((.*)\)\s*$")


def canonical_ends(file: Path, chain: Chain, ini: Path | None) -> list[tuple[int, np.ndarray, tuple | None]]:
    """Line, end (axes,) in mm and degrees, and circle (first and second axis, centre) of every motion of ``rs274``."""
    configuration = Configuration(ini)
    printed, error = canonical(file.read_text(errors="replace"), file, chain, configuration)
    if error:
        raise InputError(f"{file}: rs274 says {error}")
    letters, out = "XYZABC", []
    line, inch, plane, silent = 0, False, "XY", False
    zero, preset, last = np.zeros(6), np.zeros(6), np.zeros(0)
    for text in printed:
        call = _CALL.match(text)
        if not call:
            continue
        name, arguments = call[1], call[2]
        if name == "MESSAGE":
            found = re.match(r'"@line (\d+)"', arguments)
            line = int(found[1]) if found else line
            silent = arguments == '"@sync"' or (silent and not arguments.startswith('"@tip'))
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
            place += zero + preset
            end = place[[letters.index(a) for a in chain.letters]]
            if not silent and (circle is not None or not np.array_equal(end, last)):
                out.append((line, end, circle))
            last = end
    return out


def compare(nc: NCFile, wanted: list[tuple[int, np.ndarray, tuple | None]]) -> tuple[float, float, float, int]:
    """Largest difference of ends in µm and degrees, of chords from their circles in µm, and the number of motions.

    Raises:
        InputError: the motions do not follow each other in the same order.
    """
    units = np.array([scale(a) for a in nc.motion.chain.letters])
    points, linear = nc.motion.points / units, nc.motion.chain.linear_columns
    at, linear_um, degrees, off, count = 0, 0.0, 0.0, 0.0, 0
    begun, last = False, np.zeros(len(units))
    for line, end, circle in wanted:
        ahead = at + 1
        if not begun:  # moves before the first feed block are left out
            before, last = last, end
            if line == nc.lines[1] and np.abs(before - points[0]).max() < 2e-3:
                begun = True
            elif line == nc.lines[0] and np.abs(end - points[0]).max() < 2e-3:
                begun, ahead = True, 0
            else:
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
        if ahead >= len(points):
            break
        difference = np.abs(points[ahead] - end)
        linear_um = max(linear_um, float(difference[linear].max()) * 1e3)
        degrees = max(degrees, float(difference[linear.stop :].max(initial=0.0)))
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
