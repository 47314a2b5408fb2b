"""Reading an NC program as the motion that it commands. What is not understood is refused, nothing is guessed."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.io.inputs import file_bytes
from mjsim.machine.chain import FIVE_AXIS, Chain, is_rotary
from mjsim.nc.dialects import dialect as find_dialect
from mjsim.nc.gcode import GCodeError, parse_line
from mjsim.nc.limits import scale
from mjsim.nc.modal import Modal

_LARGEST = 20_000_000


@dataclass(frozen=True)
class NCFile:
    """An NC program that was read.

    Attributes:
        path: the file. dialect: how it was read. motion: what it commands, from its first feed block to its last.
        lines: (n + 1,) line in which each point of the motion stands.
        feed: ``G94``, ``G93`` or ``G93 and G94``. unnamed: axes that no word names; they stay at 0.
    """

    path: Path
    dialect: str
    motion: Commanded
    lines: np.ndarray
    feed: str
    unnamed: tuple[str, ...]

    def place(self, i: int) -> str:
        """Words for point ``i``: file and line."""
        return f"{self.path}, line {self.lines[i]}"


def read_nc(
    path: Path | str,
    dialect: str = "fanuc",
    reversed: tuple[str, ...] = (),
    rollover: bool = False,
    chain: Chain = FIVE_AXIS,
) -> NCFile:
    """Read G-code as a commanded motion.

    Args:
        path: the file. dialect: whose F convention and spellings it has.
        reversed: rotary axes whose command on the machine has the other sign.
        rollover: the table axis goes the short way to its absolute positions (programs with it within 0 to 360°).
        chain: the machine's axes.

    Raises:
        InputError: names file, line, what was found and what is allowed.
    """
    path = Path(path)
    return parse_nc(_text(path), path, dialect, reversed, rollover, chain)


def parse_nc(
    text: str,
    path: Path,
    dialect: str = "fanuc",
    reversed: tuple[str, ...] = (),
    rollover: bool = False,
    chain: Chain = FIVE_AXIS,
) -> NCFile:
    """As :func:`read_nc` for a program's text; ``path`` is its name in messages."""
    reader = Modal(find_dialect(dialect), tuple(reversed), rollover, chain)
    number = 0
    try:
        for number, line in enumerate(text.splitlines(), start=1):
            reader.take(parse_line(line, reader.d.name == "siemens", chain), number)
            if reader.ended:
                break
    except GCodeError as error:
        hint = (
            " (it looks like a Siemens program: say --dialect siemens)"
            if dialect != "siemens" and _siemens(text, path)
            else ""
        )
        raise InputError(f"{path}, line {number}: {error}{hint}") from None
    if not reader.seconds:
        raise InputError(f"{path}: no block with a feed; allowed: an NC program with G1 blocks")
    motion = Commanded(np.array(reader.seconds), np.array(reader.points) * _units(chain), reader.feed_tip, chain)
    feed = " and ".join(f"G{k}" for k in sorted(reader.kinds))
    return NCFile(
        path, dialect, motion, np.array(reader.lines), feed, tuple(a for a in chain.letters if a not in reader.named)
    )


def _siemens(text: str, path: Path) -> bool:
    """Whether a program is a Siemens one: by its file's ending, or by words that only such programs have."""
    return path.suffix.lower() in (".mpf", ".spf") or bool(re.search(r"\bG7[01]0\b|\bTRAORI\b|\bFGROUP\b", text))


def motion_csv(motion: Commanded) -> str:
    """The motion at every point as CSV: time_s by the blocks, axis positions in mm and degrees."""
    text = io.StringIO()
    header = ",".join(["time_s", *(f"{a}_{'deg' if is_rotary(a) else 'mm'}" for a in motion.chain.letters)])
    np.savetxt(
        text,
        np.column_stack([motion.knots, motion.axes / _units(motion.chain)]),
        "%.7f",
        ",",
        header=header,
        comments="",
    )
    return text.getvalue()


def _units(chain: Chain) -> np.ndarray:
    """SI per unit of the program, (axes,)."""
    return np.array([scale(a) for a in chain.letters])


def _text(path: Path) -> str:
    data = file_bytes(
        path,
        _LARGEST,
        f"allowed: an NC program of up to {_LARGEST / 1e6:.0f} MB",
        "no such file; allowed: an NC program",
    )
    if b"\0" in data:
        raise InputError(f"{path}: byte {data.index(0)} is not text; allowed: an NC program")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:  # comments of older controls; the words are ASCII anyhow
        return data.decode("latin-1")
