"""PHD2 guide logs: the right-ascension axis of a telescope mount, as a star shows it.

The log is described at https://openphdguiding.org (Guide Log) and written by its public source (guidinglog.cpp). Each
frame has the distance of the star from where it should be, in pixels, and the pulse with which the mount was corrected,
in ms. What the axis would have done without pulses is the distance and all pulses before it:

    error = distance + rate · (Σ pulses west − Σ pulses east) + moves of the lock position

``Pixel scale`` gives arc seconds, ``xRate`` the pixels per second of a pulse. At the declination δ, an angle of the
axis is seen 1/cos δ smaller. The axis is commanded to turn with the sky, 360° in a sidereal day of 86164.0905 s.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.formats.base import Format, register
from mjsim.importing.reading import Options
from mjsim.importing.table import Table
from mjsim.io.inputs import check_rows, read_bytes

SIDEREAL_DAY = 86164.0905
_COLUMNS = ("Time", "mount", "RARawDistance", "RADuration", "RADirection")
_HEADER = {
    "scale": re.compile(r"Pixel scale = ([\d.]+)"),
    "rate": re.compile(r"xRate = ([\d.]+)"),
    "declination": re.compile(r"Dec = ([-+\d.]+) deg"),
}
_DITHER = re.compile(r"DITHER by ([-+\d.]+), ([-+\d.]+)")


@register
class PHD2(Format):
    """A guide log of PHD2, with the lines ``Guiding Begins``, ``Pixel scale`` and ``Frame,Time,mount,…``."""

    def recognises(self, head: str) -> bool:
        return ("Guiding Begins at" in head and "Pixel scale" in head) or head.lstrip().startswith("PHD2 version")

    def read(self, path: Path, options: Options) -> Table:
        text = read_bytes(path).decode("utf-8", errors="replace")
        check_rows(path, text.count("\n"))
        runs = [r for r in (_run(path, part) for part in re.split(r"(?m)^(?=Guiding Begins at)", text)) if r]
        if not runs:
            raise InputError(f"{path}: no run of guiding with Pixel scale, xRate and frames; allowed: a guide log")
        longest = max(range(len(runs)), key=lambda i: len(runs[i][0]))
        lines, time, error, notes = runs[longest]
        motor = time / SIDEREAL_DAY * 360.0
        if len(runs) > 1:
            notes.append(f"{len(runs)} runs of guiding in the file, the longest is taken")
        notes.append("the axis turns with the sky; its error is the star's distance with all pulses taken back")
        values = np.column_stack([time, motor, motor, motor + error])
        axis = "RA"
        return Table(
            path,
            ("time", "RA command", "RA motor", "RA star"),
            ("s", "deg", "deg", "deg"),
            values,
            np.array(lines),
            (),
            (f"PHD2 guide log, {len(time)} frames", *notes),
            (("", "time"), (axis, "command"), (axis, "actual"), (axis, "load")),
        )


def _run(path: Path, text: str) -> tuple[list[int], np.ndarray, np.ndarray, list[str]] | None:
    """Frame numbers, times (n,) s, and errors (n,) deg of one run of guiding, with notes; nothing where it has none."""
    head = {k: float(m[1]) for k, pattern in _HEADER.items() if (m := pattern.search(text))}
    place: dict[str, int] = {}
    rows, pulses, moved, dithers, lost = [], 0.0, 0.0, 0, 0
    for line in text.splitlines():
        if line.startswith("Frame,"):
            place = {name: i for i, name in enumerate(line.strip().split(","))}
        elif line.startswith("INFO:"):
            if (m := _DITHER.search(line)) is not None:
                moved, dithers = moved + float(m[1]), dithers + 1
        elif place and line[:1].isdigit():
            cells = [c.strip('" ') for c in line.split(",")]
            try:
                kind, at, seen, pulse, way = (cells[place[c]] for c in _COLUMNS[1:2] + _COLUMNS[:1] + _COLUMNS[2:])
            except (KeyError, IndexError):
                continue
            if kind != "Mount":
                continue  # an adaptive optics unit moves the picture, not the axis
            if seen:
                rows.append((int(cells[0]), float(at), float(seen) + pulses + moved))
            lost += not seen
            pulses += float(pulse or 0.0) * 1e-3 * head.get("rate", 0.0) * {"W": 1.0, "E": -1.0}.get(way, 0.0)
    if len(rows) < 2 or not {"scale", "rate"} <= set(head):
        return None
    declination = head.get("declination", 0.0)
    numbers, time, error = zip(*rows, strict=True)
    notes = [f"{head['scale']:g}″ a pixel, pulses {head['rate']:g} pixels/s, declination {declination:g}°"]
    notes += [f"{dithers} moves of the lock position taken back"] if dithers else []
    notes += [f"{lost} frames without the star left out"] if lost else []
    size = head["scale"] / 3600.0 / max(float(np.cos(np.radians(declination))), 0.02)
    return list(numbers), np.array(time), np.array(error) * size, notes
