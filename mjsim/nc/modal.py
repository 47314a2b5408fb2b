"""Executing lines of G-code: modal words, positions, and the time that each block takes by its F."""

from __future__ import annotations

import numpy as np

from mjsim.errors import InputError
from mjsim.machine.chain import Chain
from mjsim.nc.dialects import Dialect
from mjsim.nc.gcode import GCodeError, Line

_IGNORED_G = {17, 18, 19, 40, 50, 61, 64, 69, 80, 5.1}
_ZEROS = {54, 55, 56, 57, 58, 59}
_ELSEWHERE = {28, 30, 53}
#: Words that a G code may have beside the axes.
_WORDS_WITH = {4: "PXUFS", 64: "PQ", 5.1: "QR", 43: "H", 43.4: "H", 30: "P"}


class Modal:
    """What a control remembers from block to block, and the path that it collects.

    Attributes:
        points: where blocks begin and end, mm and degrees. seconds: of each block. lines: in which a point stands.
        kinds: 93, 94: feed modes of the blocks. feed_tip: tool centre point control in them. named: axes that some word
            names.
        ended: the program's end has been read.
    """

    def __init__(self, d: Dialect, reversed: tuple[str, ...], rollover: bool, chain: Chain) -> None:
        self.d, self.rollover, self.chain = d, rollover, chain
        wrong = set(reversed) - set(chain.rotary)
        if wrong:
            raise InputError(f"reversed axis {sorted(wrong)[0]!r}; allowed: {', '.join(chain.rotary)}")
        self.sign = np.array([-1.0 if a in reversed else 1.0 for a in chain.letters])
        self.at = np.full(chain.count, np.nan)  # mm and degrees; unknown until a word says it
        self.motion, self.absolute, self.inch, self.mode = 0, True, False, 94
        self.tip = self.feed_tip = False
        self.feed: float | None = None
        self.group, self.radius = np.ones(chain.count), d.weights(chain)
        self.points: list[np.ndarray] = []
        self.seconds: list[float] = []
        self.lines: list[int] = []
        self.kinds: set[int] = set()
        self.named: set[str] = set()
        self.over = self.ended = False
        self.last, self.zero, self.pause = 0, 0.0, ""

    def take(self, line: Line, number: int) -> None:
        """Execute one line.

        Raises:
            GCodeError: it cannot be executed without guessing.
        """
        self._groups(line)
        if line.tip is not None:
            self._switch_tip(line.tip)
        special = self._modes(line)
        self._check_words(line, special)
        if special in _ELSEWHERE:
            self._pause(f"G{special:g}")
            self.at = self.at.copy()
            for a in set(line.words) & set(self.chain.letters):
                self.at[self.chain.index(a)] = np.nan  # somewhere on the machine
                self.named.add(a)
        elif special == 4:
            self._pause("the dwell G4")
        elif set(line.words) & set(self.chain.letters):
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
            elif g in (43, 49):  # one group with G43.4
                self._switch_tip(False)
            elif g in _ZEROS and self.zero in (0.0, g):
                self.zero = g
            elif g == 4 or g in _ELSEWHERE:
                special = g
            elif g not in _IGNORED_G:
                units = " ".join(f"G{u}" for u in self.d.units) + (" G43.4" if self.d.name == "fanuc" else "")
                raise GCodeError(
                    f"G{g:g}; allowed in the dialect {self.d.name}: G0 G1 (straight lines), G90 G91, G93 G94, {units}, "
                    "G4 G28 G30 G53 outside the feed blocks, one of G54 to G59, G17 G40 G43 G49 G61 G64 G80 (no "
                    "arcs, cycles, macros)"
                )
        return special

    def _switch_tip(self, on: bool) -> None:
        if on != self.tip:
            self.tip, self.at = on, self.at.copy()
            self.at[self.chain.linear_columns] = np.nan  # the linear axes mean something else from now on

    def _check_words(self, line: Line, special: float | None) -> None:
        axes = self.chain.letters
        allowed = (
            {*"FSTHD"} | (set(axes) if special != 4 else set()) | {w for g in line.g for w in _WORDS_WITH.get(g, "")}
        )
        for letter in line.words:
            if letter not in allowed:
                raise GCodeError(
                    f"the word {letter}{line.words[letter]:g}; allowed: {' '.join(axes)} F, and N S T H D, which "
                    f"move nothing"
                )
        if self.d.strict_point and special != 4:
            for a in line.words:
                if a not in line.points and (a in axes or (a == "F" and self.mode == 93)):
                    v = line.words[a]
                    raise GCodeError(
                        f"{a}{v:g} without a decimal point, which means {v:g} or {v:g} smallest increments as the "
                        f"control is set "
                        f"(Fanuc parameter 3401#0); allowed: {a}{v:g}."
                    )

    def _groups(self, line: Line) -> None:
        if line.group is not None:
            self.group = np.array([1.0 if a in line.group or not line.group else 0.0 for a in self.chain.letters])
        for axis, radius in line.radius.items():
            self.radius[self.chain.index(axis)] = radius * np.pi / 180.0

    def _f(self, line: Line) -> float:
        f = line.words["F"]
        if f < 1e-6:
            raise GCodeError(f"F{f:g}; allowed: a feed above 0, from 0.000001 on")
        return f

    def _move(self, line: Line, number: int) -> None:
        if "F" in line.words:
            self.feed = self._f(line)
        end, start = self._target(line), self.at
        if self.motion == 0:
            self._pause("the rapid move G0")
            self.at, self.last = end, self.last if self.seconds else number
            return
        if np.array_equal(end, start):
            return
        if self.over:
            raise GCodeError(
                f"a feed block after {self.pause} behind line {self.last}, which takes an unknown time; allowed: "
                f"one path"
            )
        if self.seconds and self.tip != self.feed_tip:
            raise GCodeError(
                "tool centre point control switched within the path; allowed: before the first or after the last "
                "feed block"
            )
        if not self.seconds:
            start = np.array(
                [
                    0.0 if np.isnan(v) and a not in self.named else v
                    for a, v in zip(self.chain.letters, start, strict=True)
                ]
            )
            end = np.where(np.isnan(end), start, end)
        for a, v in zip(self.chain.letters, start, strict=True):
            if np.isnan(v):
                raise GCodeError(f"a feed block before {a} has a known place; allowed: a G0 or G90 word of {a} first")
        if not self.seconds:
            self.points.append(start)
            self.lines.append(self.last or number)
            self.feed_tip = self.tip
        self.seconds.append(self._minutes(end - start, line) * 60.0)
        self.points.append(end)
        self.lines.append(number)
        self.kinds.add(self.mode)
        self.at, self.last = end, number

    def _target(self, line: Line) -> np.ndarray:
        end = self.at.copy()
        for i, a in enumerate(self.chain.letters):
            if a not in line.words:
                continue
            value = self.sign[i] * line.words[a] * (25.4 if self.inch and not self.chain.is_rotary(a) else 1.0)
            if not self.absolute:
                if np.isnan(end[i]):
                    raise GCodeError(f"G91 with {a} before {a} has a known place; allowed: G90 with {a} first")
                end[i] += value
            elif a in line.shortest or (a in self.chain.round_axes and self.rollover):
                before = 0.0 if np.isnan(end[i]) else end[i]
                end[i] = value if np.isnan(end[i]) else before + (value - before + 180.0) % 360.0 - 180.0
            else:
                end[i] = value
            if self.seconds and self.motion == 1 and a not in self.named:
                raise GCodeError(
                    f"{a} for the first time, within the path; allowed: every axis that moves is named at the "
                    f"start point"
                )
            self.named.add(a)
        return end

    def _minutes(self, step: np.ndarray, line: Line) -> float:
        if self.mode == 93 and "F" not in line.words:
            raise GCodeError("no F in a block of G93; allowed: F in each of its blocks")
        if self.feed is None:
            raise GCodeError("a feed block before any F of this mode; allowed: F first")
        if self.mode == 93:
            return 1.0 / self.feed
        size = step / np.array([1.0 if a.rotary else 25.4 for a in self.chain.axes]) if self.inch else step
        if self.tip:
            length = float(np.linalg.norm(size[self.chain.linear_columns]))
            if length == 0.0:
                raise GCodeError(
                    "axes turn while the tool tip rests: F has no meaning with tool centre point control; allowed: G93"
                )
        else:
            length = float(np.linalg.norm(size * self.group * self.radius)) or float(
                np.linalg.norm(size[self.chain.rotary_columns])
            )
        return length / self.feed

    def _m(self, m: float) -> None:
        if m in (2, 17, 30):
            self.ended = True
        elif m in (0, 1, 60):
            self._pause(f"the stop M{m:g}")
        elif m in (428, 429) and self.d.name == "linuxcnc":  # switchable kinematics of its five-axis configurations
            self._switch_tip(m == 428)
        elif m in (128, 129) and self.d.name != "linuxcnc":  # HEIDENHAIN's tool centre point control
            self._switch_tip(m == 128)
        elif m >= 96 or m != int(m):
            raise GCodeError(f"M{m:g}; allowed: no calls of other programs")

    def _pause(self, what: str) -> None:
        """Something of unknown duration: the path is over, or has not begun."""
        if self.seconds and not self.over:
            self.over, self.pause = True, what
