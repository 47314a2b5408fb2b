"""Reading an NC program as the motion that it commands. What is not understood is refused, nothing is guessed."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.io.inputs import file_bytes
from mjsim.machine.chain import FIVE_AXIS, Chain, is_rotary
from mjsim.nc.dialects import dialect as find_dialect
from mjsim.nc.interpreter import Configuration, carry_out, needs_interpreter
from mjsim.nc.klartext import Klartext, statements
from mjsim.nc.limits import scale
from mjsim.nc.meanings import MEANINGS
from mjsim.nc.modal import Modal
from mjsim.nc.words import GCodeError, letter_block, siemens_block

_LARGEST = 20_000_000


@dataclass(frozen=True)
class NCFile:
    """An NC program that was read.

    Attributes:
        path: The file.
        dialect: How it was read.
        motion: What it commands, from its first feed block to its last, with the rapid moves and dwells in between.
        lines: (n + 1,) line in which each point of the motion stands.
        feed: ``G94``, ``G93`` or ``G93 and G94``.
        unnamed: Axes that no word names; they stay at 0.
        ignored: Words that change no motion, each with the first line and the number of times.
        warnings: Sentences on what had to be settled.
    """

    path: Path
    dialect: str
    motion: Commanded
    lines: np.ndarray
    feed: str
    unnamed: tuple[str, ...]
    ignored: dict[str, tuple[int, int]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def place(self, i: int) -> str:
        """Words for point ``i``: file and line."""
        return f"{self.path}, line {self.lines[i]}"


def read_nc(
    path: Path | str,
    dialect: str | None = None,
    reversed: tuple[str, ...] = (),
    rollover: bool | None = None,
    chain: Chain = FIVE_AXIS,
    skip: bool = False,
    ini: Path | str | None = None,
) -> NCFile:
    """Read a program as a commanded motion.

    Args:
        path: The file.
        dialect: Whose codes, spellings and F convention it has; ``None``: as its ending and its words say, and
            otherwise Fanuc's.
        reversed: Rotary axes whose command on the machine has the other sign.
        rollover: Whether a round axis goes the short way to its absolute positions (programs with it within 0 to 360°);
            ``None``: where it would turn by more than half a turn in a feed move, which is then said.
        chain: The machine's axes.
        skip: Whether blocks with ``/`` are left out.
        ini: Configuration of LinuxCNC that says its kinematics, and where its subprograms and tools are.

    Raises:
        InputError: names file, line, what was found and what is allowed.
    """
    path = Path(path)
    return parse_nc(_text(path), path, dialect, reversed, rollover, chain, skip, ini)


def parse_nc(
    text: str,
    path: Path,
    dialect: str | None = None,
    reversed: tuple[str, ...] = (),
    rollover: bool | None = None,
    chain: Chain = FIVE_AXIS,
    skip: bool = False,
    ini: Path | str | None = None,
) -> NCFile:
    """As :func:`read_nc` for a program's text; ``path`` is its name in messages."""
    d = find_dialect(dialect or _looks_like(text, path) or "fanuc", reading=True)
    modal = Modal(d, MEANINGS[d.name](), chain, tuple(reversed), rollover, skip)
    configuration = Configuration(None if ini is None else Path(ini))
    try:
        if d.name == "linuxcnc" and configuration.begins_at_tip:
            modal.switch_tip(True)
        if d.name == "linuxcnc" and needs_interpreter(text):
            carry_out(text, path, modal, configuration)
        else:
            _run(text, modal)
        found = modal.result()
    except GCodeError as error:
        raise InputError(f"{path}, line {modal.number}: {error}{_hint(text, path, d.name)}") from None
    if found is None:
        raise InputError(
            f"{path}: no block with a feed, and no rapid move between known places; allowed: an NC program with feed "
            "blocks, as G1 or L"
        )
    motion, lines = found
    ignored = {word: (where[0], len(where)) for word, where in modal.ignored.items()}
    feed = " and ".join(f"G{k}" for k in sorted(modal.kinds))
    unnamed = tuple(a for a in chain.letters if a not in modal.named)
    return NCFile(path, d.name, motion, lines, feed, unnamed, ignored, tuple(modal.warnings.values()))


def _run(text: str, modal: Modal) -> None:
    """Carry out all lines of a program."""
    lines = text.splitlines()
    klartext = Klartext(modal) if modal.d.name == "heidenhain" else None
    if klartext is not None and re.search(r"^\s*\d*\s*BEGIN\s+PGM\b", text, re.MULTILINE | re.IGNORECASE):
        for number, statement in statements(lines):
            klartext.take(statement, number)
            if modal.ended:
                return
        return
    for number, line in enumerate(lines, start=1):
        modal.number = number
        if klartext is not None:
            modal.motion = 1 if number == 1 else modal.motion
            if line.lstrip().startswith("%") and re.search(r"\bG70\b", line, re.IGNORECASE):
                modal.inch = modal.feed_inch = True
            plain = re.sub(r"^\s*N\d+\s*", "", line).replace("*", " ").partition(";")[0].strip()
            if re.match(r"(PLANE|FUNCTION)\b", plain, re.IGNORECASE):
                motion = modal.motion
                klartext.take(plain, number)
                modal.motion = motion
                continue
            modal.take(letter_block(line, modal.variables, "*"), number)
        elif modal.d.name == "siemens":
            modal.take(siemens_block(line, modal.variables), number)
        else:
            modal.take(letter_block(line, modal.variables), number)
        if modal.ended:
            return


def _looks_like(text: str, path: Path) -> str:
    """The dialect that a program's ending and words speak for; empty where they speak for none."""
    if re.search(r"\bBEGIN\s+PGM\b|^%\S+\s+G7[01]\s*\*", text, re.MULTILINE) or path.suffix.lower() in (".h", ".i"):
        return "heidenhain"
    if path.suffix.lower() in (".mpf", ".spf") or re.search(r"\bG7[01]0\b|\bTRAORI\b|\bFGROUP\b", text):
        return "siemens"
    return "linuxcnc" if path.suffix.lower() == ".ngc" else ""


def _hint(text: str, path: Path, dialect: str) -> str:
    """What to say where a program looks like that of another control."""
    other = _looks_like(text, path)
    if other in ("", dialect):
        return ""
    control = {"heidenhain": "HEIDENHAIN", "siemens": "Siemens", "linuxcnc": "LinuxCNC"}[other]
    return f" (it looks like a {control} program: say --dialect {other})"


def motion_csv(motion: Commanded) -> str:
    """The motion at every point as CSV: time_s by the blocks, axis positions in mm and degrees."""
    text = io.StringIO()
    header = ",".join(["time_s", *(f"{a}_{'deg' if is_rotary(a) else 'mm'}" for a in motion.chain.letters)])
    units = np.array([scale(a) for a in motion.chain.letters])
    table = np.column_stack([motion.knots, motion.axes / units])
    np.savetxt(text, table, "%.7f", ",", header=header, comments="")
    return text.getvalue()


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
