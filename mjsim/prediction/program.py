"""The program of a part: an NC file, or a built-in one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.machine.chain import Chain
from mjsim.nc.read import read_nc
from mjsim.prediction.parts import PARTS, part
from mjsim.units import MM


def program_of(
    name: str,
    chain: Chain,
    zero: tuple[float, float, float] = (0.0, 0.0, 0.0),
    feed: float = 1000.0 * MM / 60.0,
    dialect: str = "fanuc",
) -> tuple[str, Commanded, np.ndarray | None]:
    """A program by the name of a built-in part or of an NC file.

    Args:
        name: One of :data:`mjsim.prediction.parts.PARTS`, or a path.
        chain: The machine's axes.
        zero: Zero point of the part in the work frame, (3,) m; an NC file's positions count from there.
        feed: Of a built-in part, m/s.
        dialect: Of an NC file.

    Returns:
        Its name, its motion, and the lines of its points (``None`` for a built-in part).

    Raises:
        InputError: the file cannot be read as a motion.
    """
    place = np.asarray(zero, float)
    if name in PARTS:
        return PARTS[name][1], part(name, chain, place, feed), None
    nc = read_nc(Path(name), dialect, chain=chain)
    points = nc.motion.points.copy()
    points[:, chain.linear_columns] += place
    return Path(name).name, replace(nc.motion, points=points), nc.lines
