"""A program with everything that its prediction needs: where the part stands, the tool, the allowed deviation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjsim.commands.saved import SavedDiagnosis
from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.machine.chain import Chain
from mjsim.machine.model import Machine
from mjsim.nc.read import read_nc
from mjsim.prediction.parts import PARTS, part
from mjsim.prediction.predict import predict
from mjsim.prediction.result import Prediction
from mjsim.units import MM


@dataclass(frozen=True)
class Reading:
    """How an NC file is read; as :func:`mjsim.nc.read.read_nc` has it.

    Attributes:
        dialect: Whose program it is; ``None``: as its ending and its words say.
        reversed: Rotary axes of the other sign.
        rollover: Whether a round axis goes the short way.
        skip: Whether blocks with ``/`` are left out.
        ini: Configuration of LinuxCNC.
    """

    dialect: str | None = None
    reversed: tuple[str, ...] = ()
    rollover: bool | None = None
    skip: bool = False
    ini: Path | None = None


#: As most programs are read.
READING = Reading()


@dataclass(frozen=True)
class PartRun:
    """One program on one table.

    Attributes:
        program: Name of a built-in part, or an NC file.
        zero: Zero point of the part in the work frame, (3,) m.
        tool: Tool's length less that of the spindle ball's holder, m.
        feed: Of a built-in part, m/s.
        reading: How an NC file is read.
        tolerance: Allowed deviation normal to the path, m, or ``None``.
    """

    program: str
    zero: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tool: float = 0.0
    feed: float = 1000.0 * MM / 60.0
    reading: Reading = READING
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if self.tolerance is not None and not self.tolerance > 0.0:
            raise InputError(f"tolerance of the part: {self.tolerance * 1e6:g} µm; allowed: above 0 µm")
        if not self.feed > 0.0:
            raise InputError(f"feed of the part: {self.feed / MM * 60:g} mm/min; allowed: above 0 mm/min")

    def on(self, machine: Machine, saved: SavedDiagnosis | None = None) -> Prediction:
        """The error of the part on a machine.

        Args:
            machine: Where it runs, unless ``saved`` has it.
            saved: Diagnosis of the machine.

        Raises:
            InputError: The file cannot be read, or the program does not fit the machine.
        """
        chain = machine.chain if saved is None else saved.machine.chain
        name, motion, lines, notes = program_of(self.program, chain, self.zero, self.feed, self.reading)
        return replace(predict(motion, machine, name, saved, self.tolerance, self.tool, self.zero, lines), notes=notes)


def program_of(
    name: str,
    chain: Chain,
    zero: tuple[float, float, float] = (0.0, 0.0, 0.0),
    feed: float = 1000.0 * MM / 60.0,
    reading: Reading = READING,
) -> tuple[str, Commanded, np.ndarray | None, tuple[str, ...]]:
    """A program by the name of a built-in part or of an NC file.

    Args:
        name: One of :data:`mjsim.prediction.parts.PARTS`, or a path.
        chain: The machine's axes.
        zero: Zero point of the part in the work frame, (3,) m; an NC file's positions count from there.
        feed: Of a built-in part, m/s.
        reading: How an NC file is read.

    Returns:
        Its name, its motion, the lines of its points (``None`` for a built-in part), and sentences on what had to be
        settled.

    Raises:
        InputError: the file cannot be read as a motion.
    """
    place = np.asarray(zero, float)
    if name in PARTS:
        return PARTS[name][1], part(name, chain, place, feed), None, ()
    if not Path(name).exists():
        raise InputError(f"{name}: no such file; allowed: an NC program, or one of {', '.join(PARTS)}")
    how = reading
    nc = read_nc(Path(name), how.dialect, how.reversed, how.rollover, chain, how.skip, how.ini)
    points = nc.motion.points.copy()
    points[:, chain.linear_columns] += place
    listed = tuple(f"{word} ({n}, first in line {line})" for word, (line, n) in nc.ignored.items())
    said = (*nc.warnings, *([f"words that change no motion: {', '.join(listed)}"] if listed else []))
    return Path(name).name, replace(nc.motion, points=points), nc.lines, said
