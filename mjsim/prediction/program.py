"""The program of a part: an NC file, or a built-in one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.machine.chain import Chain
from mjsim.nc.read import read_nc
from mjsim.prediction.parts import PARTS, part
from mjsim.units import MM


@dataclass(frozen=True)
class Reading:
    """How an NC file is read; as :func:`mjsim.nc.read.read_nc` has it.

    Attributes:
        dialect: Whose program it is.
        reversed: Rotary axes of the other sign.
        rollover: Whether a round axis goes the short way.
        skip: Whether blocks with ``/`` are left out.
        ini: Configuration of LinuxCNC.
    """

    dialect: str = "fanuc"
    reversed: tuple[str, ...] = ()
    rollover: bool | None = None
    skip: bool = False
    ini: Path | None = None


def program_of(
    name: str,
    chain: Chain,
    zero: tuple[float, float, float] = (0.0, 0.0, 0.0),
    feed: float = 1000.0 * MM / 60.0,
    dialect: str | Reading = "fanuc",
) -> tuple[str, Commanded, np.ndarray | None, tuple[str, ...]]:
    """A program by the name of a built-in part or of an NC file.

    Args:
        name: One of :data:`mjsim.prediction.parts.PARTS`, or a path.
        chain: The machine's axes.
        zero: Zero point of the part in the work frame, (3,) m; an NC file's positions count from there.
        feed: Of a built-in part, m/s.
        dialect: Of an NC file, or all that says how it is read.

    Returns:
        Its name, its motion, the lines of its points (``None`` for a built-in part), and sentences on what had to be
        settled.

    Raises:
        InputError: the file cannot be read as a motion.
    """
    place = np.asarray(zero, float)
    if name in PARTS:
        return PARTS[name][1], part(name, chain, place, feed), None, ()
    how = dialect if isinstance(dialect, Reading) else Reading(dialect)
    nc = read_nc(Path(name), how.dialect, how.reversed, how.rollover, chain, how.skip, how.ini)
    points = nc.motion.points.copy()
    points[:, chain.linear_columns] += place
    listed = tuple(f"{word} ({n}, first in line {line})" for word, (line, n) in nc.ignored.items())
    said = (*nc.warnings, *([f"words that change no motion: {', '.join(listed)}"] if listed else []))
    return Path(name).name, replace(nc.motion, points=points), nc.lines, said
