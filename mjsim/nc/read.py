"""Reading an NC program as the motion that it commands. What is not understood is refused, nothing is guessed."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.kinematics import AXES, LINEAR
from mjsim.nc.commanded import Commanded
from mjsim.nc.dialects import Dialect
from mjsim.nc.dialects import dialect as find_dialect
from mjsim.nc.gcode import GCodeError, Line, parse_line
from mjsim.nc.limits import scale

_LARGEST = 20_000_000
_UNITS = np.array([scale(a) for a in AXES])
_IGNORED_G = {17, 18, 19, 40, 43, 50, 61, 64, 69, 80, 5.1}
_ZEROS = {54, 55, 56, 57, 58, 59}
_ELSEWHERE = {28, 30, 53}
_WORDS_WITH = {4: "PXUFS", 64: "PQ", 5.1: "QR", 43: "H", 43.4: "H", 28: "XYZAC", 30: "XYZACP", 53: "XYZAC"}


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


def read_nc(path: Path | str, dialect: str = "fanuc", reversed: tuple[str, ...] = (), rollover: bool = False) -> NCFile:
    """Read G-code as a commanded motion.

    Args:
        path: the file. dialect: whose F convention and spellings it has.
        reversed: rotary axes (of A, C) whose command on the machine has the other sign.
        rollover: C goes the short way to its absolute positions (programs with C within 0 to 360°).

    Raises:
        InputError: names file, line, what was found and what is allowed.
    """
    path = Path(path)
    return parse_nc(_text(path), path, dialect, reversed, rollover)


def parse_nc(text: str, path: Path, dialect: str = "fanuc", reversed: tuple[str, ...] = (), rollover: bool = False) -> NCFile:
    """As :func:`read_nc` for a program's text; ``path`` is its name in messages."""
    reader = _Reader(find_dialect(dialect), tuple(reversed), rollover)
    number = 0
    try:
        for number, line in enumerate(text.splitlines(), start=1):
            reader.take(parse_line(line, reader.d.name != "siemens"), number)
            if reader.ended:
                break
    except GCodeError as error:
        raise InputError(f"{path}, line {number}: {error}") from None
    if not reader.seconds:
        raise InputError(f"{path}: no block with a feed; allowed: an NC program with G1 blocks")
    motion = Commanded(np.array(reader.seconds), np.array(reader.points) * _UNITS, reader.feed_tip)
    feed = " and ".join(f"G{k}" for k in sorted(reader.kinds))
    return NCFile(path, dialect, motion, np.array(reader.lines), feed, tuple(a for a in AXES if a not in reader.named))


def motion_csv(motion: Commanded) -> str:
    """The motion at every point as CSV: time_s by the blocks, axis positions in mm and degrees."""
    text = io.StringIO()
    header = ",".join(["time_s", *(f"{a}_{'mm' if a in LINEAR else 'deg'}" for a in AXES)])
    np.savetxt(text, np.column_stack([motion.knots, motion.axes / _UNITS]), "%.7f", ",", header=header, comments="")
    return text.getvalue()


def _text(path: Path) -> str:
    if not path.is_file():
        raise InputError(f"{path}: no such file; allowed: an NC program")
    if path.stat().st_size > _LARGEST:
        raise InputError(f"{path}: {path.stat().st_size / 1e6:.0f} MB; allowed: up to {_LARGEST / 1e6:.0f} MB")
    data = path.read_bytes()
    if b"\0" in data:
        raise InputError(f"{path}: byte {data.index(0)} is not text; allowed: an NC program")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:  # comments of older controls; the words are ASCII anyhow
        return data.decode("latin-1")


class _Reader:
    """Modal state of a control, in program units (mm or inch, degrees, minutes)."""

    def __init__(self, d: Dialect, reversed: tuple[str, ...], rollover: bool) -> None:
        self.d, self.rollover = d, rollover
        wrong = set(reversed) - {"A", "C"}
        if wrong:
            raise InputError(f"reversed axis {sorted(wrong)[0]!r}; allowed: A, C")
        self.sign = np.array([-1.0 if a in reversed else 1.0 for a in AXES])
        self.at = np.full(5, np.nan)  # mm and degrees; unknown until a word says it
        self.motion, self.absolute, self.inch, self.mode = 0, True, False, 94
        self.tip = self.feed_tip = False
        self.feed: float | None = None
        self.weights = d.weights
        self.points: list[np.ndarray] = []
        self.seconds: list[float] = []
        self.lines: list[int] = []
        self.kinds: set[int] = set()
        self.named: set[str] = set()
        self.over = self.ended = False
        self.last, self.zero, self.pause = 0, 0.0, ""

    def take(self, line: Line, number: int) -> None:
        """Execute one line."""
        self._groups(line)
        if line.tip is not None:
            self._switch_tip(line.tip)
        special = self._modes(line)
        self._check_words(line, special)
        if special in _ELSEWHERE:
            self._pause(f"G{special:g}")
            self.at = self.at.copy()
            for a in set(line.words) & set(AXES):
                self.at[AXES.index(a)] = np.nan  # somewhere on the machine
                self.named.add(a)
        elif special == 4:
            self._pause("the dwell G4")
        elif set(line.words) & set(AXES):
            self._move(line, number)
        elif "F" in line.words:
            self.feed = self._f(line)
        for m in line.m:
            self._m(m)

    def _modes(self, line: Line) -> float | None:
        special = None
        for g in line.g:
            if g in (0, 1):
                self.motion = int(g)
            elif g in (90, 91):
                self.absolute = g == 90
            elif g in (93, 94):
                self.mode, self.feed = int(g), self.feed if g == self.mode else None
            elif g in self.d.units:
                self.inch = g == 20
            elif g == 43.4 and self.d.name == "fanuc":
                self._switch_tip(True)
            elif g == 49:
                self._switch_tip(False)
            elif g in _ZEROS and self.zero in (0.0, g):
                self.zero = g
            elif g == 4 or g in _ELSEWHERE:
                special = g
            elif g not in _IGNORED_G:
                units = " ".join(f"G{u}" for u in self.d.units) + (" G43.4" if self.d.name == "fanuc" else "")
                raise GCodeError(
                    f"G{g:g}; allowed in the dialect {self.d.name}: G0 G1 (straight lines), G90 G91, G93 G94, {units}, "
                    "G4 G28 G30 G53 outside the feed blocks, one of G54 to G59, G17 G40 G43 G49 G61 G64 G80 (no arcs, cycles, macros)"
                )
        return special

    def _switch_tip(self, on: bool) -> None:
        if on != self.tip:
            self.tip, self.at = on, self.at.copy()
            self.at[:3] = np.nan  # X, Y, Z mean something else from now on

    def _check_words(self, line: Line, special: float | None) -> None:
        allowed = {*"FSTHD"} | ({*"XYZAC"} if special != 4 else set()) | {w for g in line.g for w in _WORDS_WITH.get(g, "")}
        for letter in line.words:
            if letter not in allowed:
                raise GCodeError(f"the word {letter}{line.words[letter]:g}; allowed: X Y Z A C F, and N S T H D, which move nothing")
        if self.d.strict_point and special != 4:
            for a in line.words:
                if a not in line.points and (a in AXES or (a == "F" and self.mode == 93)):
                    v = line.words[a]
                    raise GCodeError(
                        f"{a}{v:g} without a decimal point, which is {v:g} or {v:g} smallest increments, as the control is set "
                        f"(Fanuc parameter 3401#0); allowed: {a}{v:g}."
                    )

    def _groups(self, line: Line) -> None:
        if (line.group is not None or line.radius or line.tip is not None) and self.d.name != "siemens":
            raise GCodeError("a word of Sinumerik controls (FGROUP, FGREF, TRAORI); allowed: with the dialect siemens")
        if line.group is not None:
            self.weights = np.array([1.0 if a in line.group or not line.group else 0.0 for a in AXES])
        for axis, radius in line.radius.items():
            if axis not in "AC" or radius <= 0:
                raise GCodeError(f"FGREF[{axis}]={radius:g}; allowed: a radius above 0 of A or C")
            self.weights[AXES.index(axis)] *= radius * np.pi / 180.0

    def _f(self, line: Line) -> float:
        f = line.words["F"]
        if f <= 0:
            raise GCodeError(f"F{f:g}; allowed: a feed above 0")
        return f

    def _move(self, line: Line, number: int) -> None:
        if "F" in line.words:
            self.feed = self._f(line)
        end, start = self._target(line), self.at
        if self.motion == 0:
            self._pause("the rapid move G0")
            self.at = end
            return
        if np.array_equal(end, start):
            return
        if self.over:
            raise GCodeError(f"a feed block after {self.pause} behind line {self.last}, which takes an unknown time; allowed: one path")
        if not self.seconds:
            start = np.array([0.0 if np.isnan(v) and a not in self.named else v for a, v in zip(AXES, start, strict=True)])
            end = np.where(np.isnan(end), start, end)
            for a, v in zip(AXES, start, strict=True):
                if np.isnan(v):
                    raise GCodeError(f"a feed block before {a} has a known place; allowed: a G0 or G90 word of {a} first")
            self.points.append(start)
            self.lines.append(self.last or number)
            self.feed_tip = self.tip
        elif self.tip != self.feed_tip:
            raise GCodeError("tool centre point control switched within the path; allowed: before the first or after the last feed block")
        self.seconds.append(self._minutes(end - start, line) * 60.0)
        self.points.append(end)
        self.lines.append(number)
        self.kinds.add(self.mode)
        self.at, self.last = end, number

    def _target(self, line: Line) -> np.ndarray:
        end = self.at.copy()
        for i, a in enumerate(AXES):
            if a not in line.words:
                continue
            value = self.sign[i] * line.words[a] * (25.4 if self.inch and i < 3 else 1.0)
            if not self.absolute:
                if np.isnan(end[i]):
                    raise GCodeError(f"G91 with {a} before {a} has a known place; allowed: G90 with {a} first")
                end[i] += value
            elif a in line.shortest or (a == "C" and self.rollover):
                before = 0.0 if np.isnan(end[i]) else end[i]
                end[i] = value if np.isnan(end[i]) else before + (value - before + 180.0) % 360.0 - 180.0
            else:
                end[i] = value
            if self.seconds and a not in self.named:
                raise GCodeError(f"{a} for the first time, within the path; allowed: every axis that moves is named at the start point")
            self.named.add(a)
        return end

    def _minutes(self, step: np.ndarray, line: Line) -> float:
        if self.mode == 93:
            if "F" not in line.words:
                raise GCodeError("no F in a block of G93; allowed: F in each of its blocks")
            return 1.0 / self.feed
        if self.feed is None:
            raise GCodeError("a feed block before any F of this mode; allowed: F first")
        size = step / np.array([25.4] * 3 + [1.0] * 2) if self.inch else step
        if self.tip:
            length = float(np.linalg.norm(size[:3]))
            if length == 0.0:
                raise GCodeError("axes turn while the tool tip rests: F has no meaning with tool centre point control; allowed: G93")
        else:
            length = float(np.linalg.norm(size * self.weights)) or float(np.linalg.norm(size[3:]))
        return length / self.feed

    def _m(self, m: float) -> None:
        if m in (2, 17, 30):
            self.ended = True
        elif m in (0, 1, 60):
            self._pause(f"the stop M{m:g}")
        elif m >= 96 or m != int(m):
            raise GCodeError(f"M{m:g}; allowed: no calls of other programs")

    def _pause(self, what: str) -> None:
        """Something of unknown duration: the path is over, or has not begun."""
        if self.seconds and not self.over:
            self.over, self.pause = True, what
