"""Carrying out blocks of G-code: what a control remembers from block to block, and the moves that come of it.

One class for all dialects. A table of each dialect (:mod:`mjsim.nc.meanings`) says what a code does there.
"""

from __future__ import annotations

from typing import NoReturn, Protocol

import numpy as np

from mjsim.errors import InputError
from mjsim.machine.axis import ALONG
from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import rotation
from mjsim.nc.dialects import Dialect
from mjsim.nc.track import Track, chords
from mjsim.nc.words import ABSOLUTE, CENTRES, INCREMENTAL, Block, GCodeError, Value

#: Coordinates of a plane: first, second, normal to it.
_PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
#: How far the radii at both ends of an arc may differ, mm; more is said (HEIDENHAIN's circleDeviation is 0.016 mm).
_ROUND = 0.02
#: How far above the last depth a pecking cycle begins again, mm (assumed: a parameter of the control).
_PECK = 1.0
#: Words that break the corner to the next contour.
_CORNERS = {",R", ",C", "RND", "CHR", "CHF"}
#: Words that move nothing.
_HARMLESS = {"S", "T", "H", "D", "N"}
#: Modal motion of a control.
RAPID, LINE, CLOCKWISE, COUNTERCLOCKWISE = range(4)


class Meaning(Protocol):
    """What the codes of a dialect mean.

    Attributes:
        allowed: What the dialect allows, for messages.
        words: Addresses that are allowed in every block.
        arc_words: Addresses that an arc may have beside I, J, K.
        vector_words: Addresses of a direction of the tool.
        rapid_stops: Whether the axes come to rest at the end of a rapid move.
    """

    rapid_stops: bool
    allowed: str
    words: frozenset[str]
    arc_words: frozenset[str]
    vector_words: frozenset[str]

    def of_g(self, modal: Modal, g: float) -> tuple[str, str]:
        """What a G code does, and the words that it takes."""
        ...

    def of_m(self, modal: Modal, m: float) -> tuple[str, str]:
        """What an M code does, and the words that it takes."""
        ...

    def prepare(self, modal: Modal, block: Block) -> None:
        """What words of the dialect do before the codes."""

    def dwell(self, modal: Modal, block: Block) -> float:
        """Duration of G4, s."""
        ...

    def turns(self, block: Block) -> int:
        """Whole turns of an arc beside the part of one."""
        ...

    def vector(self, modal: Modal, block: Block) -> np.ndarray | None:
        """Direction of the tool that a block commands, (3,)."""
        ...


class Modal(Track):
    """A control that carries out G-code.

    Args:
        d: Dialect. meaning: Table of its codes. chain: The machine's axes.
        reversed: Rotary axes whose command on the machine has the other sign.
        rollover: Whether a round axis goes the short way to its absolute positions; ``None``: the program does not say,
            so that it goes the short way where it would turn by more than half a turn, and that is said.
        skip: Whether blocks with ``/`` are left out.

    Raises:
        InputError: ``reversed`` names an axis that does not turn.
    """

    def __init__(
        self,
        d: Dialect,
        meaning: Meaning,
        chain: Chain,
        reversed: tuple[str, ...] = (),
        rollover: bool | None = None,
        skip: bool = False,
    ) -> None:
        super().__init__(chain)
        self.d, self.meaning, self.rollover, self.skip = d, meaning, rollover, skip
        wrong = set(reversed) - set(chain.rotary)
        if wrong:
            raise InputError(f"reversed axis {sorted(wrong)[0]!r}; allowed: {', '.join(chain.rotary)}")
        self.sign = np.array([-1.0 if a in reversed else 1.0 for a in chain.letters])
        self.motion, self.plane = RAPID, 17
        self.absolute, self.centre_absolute, self.inch = True, False, False
        self.mode, self.feed, self.spindle = 94, None, 0.0
        self.feed_inch = False
        self.kinds: set[int] = set()
        self.group, self.radius = np.ones(chain.count), d.weights(chain)
        self.exact = self.exact_once = self.length = self.vectors = self.ended = False
        self.zero = ""
        self.cycle: dict | None = None
        self.high = True  # after a hole, back to where the cycle began (G98)
        self.rounding = 0.0
        self.code = 0.0
        self.by_axes = False  # directions of the tool change with the rotary axes, not on a great circle
        self.repeated: tuple[float, float, float, float] | None = None
        self.pole: np.ndarray | None = None
        self.base_turn, self.base_origin = np.eye(3), np.zeros(3)  # without a rotation in the plane (G68)
        self.local = np.zeros(3)  # zero point beside that of the workpiece
        self.variables: dict[str, float] = {}
        self.ignored: dict[str, list[int]] = {}

    # -- one block -----------------------------------------------------------------------------------------------------

    def take(self, block: Block, number: int) -> None:
        """Carry out one block.

        Raises:
            GCodeError: it cannot be carried out without guessing.
        """
        self.number = number
        if block.skip:
            if self.skipped():
                return
        self.meaning.prepare(self, block)
        used, free, special = set(_HARMLESS), set(), ""
        for g in block.g:
            action, words = self.meaning.of_g(self, g)
            used |= set(words)
            if action.startswith("!"):
                special = action[1:]
                self.code = g
            elif action == "ignored":
                self.ignore(f"G{g:g}")
                free |= set(words)
            else:
                getattr(self, f"_{action}")(g, block)
        for m in block.m:
            used |= set(self.meaning.of_m(self, m)[1])
        if special == "dwell" and self.d.name == "linuxcnc" and self._moves(block):  # dwells, then moves
            self._dwell(block)
            block.words.pop("P", None)
            special = ""
        self._check_words(block, used, free, special)
        for word in _HARMLESS & set(block.words) - set(used - _HARMLESS):
            self.ignore(word)
        if "S" in block.words and special != "dwell":
            self.spindle = block.words["S"].number
        if special:
            getattr(self, f"_{special}")(block)
        elif self._moves(block):
            self._go(block)
        elif "F" in block.words:
            self.feed = self._f(block)
        corner = set(block.words) & _CORNERS
        if corner and (special or self.motion == RAPID or not self._moves(block)):
            raise GCodeError(f"{min(corner)} in a block without a contour; allowed: in feed blocks")
        for m in block.m:
            self._m(m, block)
        self.exact_once = False

    def skipped(self) -> bool:
        """Whether a block with ``/`` is left out, by a switch of the control."""
        done = "left out" if self.skip else "carried out"
        self.warn("skip", f"line {self.number}: blocks with / are {done} (a switch of the control)")
        return self.skip

    def ignore(self, what: str) -> None:
        """List a word that changes nothing here."""
        self.ignored.setdefault(what, []).append(self.number)

    def refuse(self, what: str) -> NoReturn:
        """Refuse a word by its name.

        Raises:
            GCodeError: always.
        """
        raise GCodeError(f"{what}; allowed in the dialect {self.d.name}: {self.meaning.allowed}")

    def _moves(self, block: Block) -> bool:
        words = set(block.words)
        if words & set(self.chain.letters) or words & self.meaning.vector_words:
            return True
        if self.cycle is not None and words & {"R"}:
            return True
        return self.motion >= CLOCKWISE and bool(words & {*CENTRES, "CR", "R"})

    def _check_words(self, block: Block, used: set[str], free: set[str], special: str) -> None:
        axes = set(self.chain.letters)
        allowed = (
            used | {"F"} | (axes if special != "dwell" else set()) | self.meaning.words | self.meaning.vector_words
        )
        if not special and self.motion >= CLOCKWISE:
            allowed |= {*CENTRES, *self.meaning.arc_words}
        if self.cycle is not None and not special:
            allowed |= set("RQPKL")
        if self.vectors:
            allowed |= set(CENTRES)
        for letter, value in block.words.items():
            if letter not in allowed:
                raise GCodeError(
                    f"the word {letter}{value.number:g}; allowed: {' '.join(self.chain.letters)} F, and N S T H D, "
                    f"which move nothing"
                )
        if self.d.strict_point and special != "dwell":
            for a, value in block.words.items():
                if (
                    not value.exact
                    and a not in free
                    and (a in axes or a in CENTRES or a == "R" or (a == "F" and self.mode == 93))
                ):
                    v = value.number
                    raise GCodeError(
                        f"{a}{v:g} without a decimal point, which means {v:g} or {v:g} smallest increments as the "
                        f"control is set (Fanuc parameter 3401#0); allowed: {a}{v:g}."
                    )

    # -- G codes: modal ------------------------------------------------------------------------------------------------

    def _set_motion(self, g: float, block: Block) -> None:
        self.motion, self.cycle = int(g), None

    def _set_probing(self, g: float, block: Block) -> None:
        """A probing move (LinuxCNC): a feed move that ends where the probe switches, at its end at the latest."""
        self.warn("probing", f"line {self.number}: a probe that never switches is taken for every G38")
        self._set_motion(LINE, block)

    def _set_plane(self, g: float, block: Block) -> None:
        self.plane = int(g)

    def _set_absolute(self, g: float, block: Block) -> None:
        self.absolute = g == 90

    def _set_centre(self, g: float, block: Block) -> None:
        self.centre_absolute = g == 90.1

    def _set_feed_mode(self, g: float, block: Block) -> None:
        self.mode, self.feed = int(g), self.feed if g == self.mode else None

    def _set_inch(self, g: float, block: Block) -> None:
        self.inch = self.feed_inch = True

    def _set_mm(self, g: float, block: Block) -> None:
        self.inch = self.feed_inch = False

    def _set_inch_lengths(self, g: float, block: Block) -> None:
        self.inch, self.feed_inch = True, False
        self.warn("inch", f"line {self.number}: G{g:g} leaves F in the control's own unit; taken as mm/min")

    def _set_exact(self, g: float, block: Block) -> None:
        self.exact = True

    def _set_exact_once(self, g: float, block: Block) -> None:
        self.exact_once = True

    def _set_path(self, g: float, block: Block) -> None:
        self.exact = False
        if g not in (64, 64.0) or set(block.words) & {"P", "Q"}:
            self.ignore(
                f"G{g:g}" + "".join(f" {w}{block.words[w].number:g}" for w in ("P", "Q", "ADIS") if w in block.words)
            )

    def _set_zero(self, g: float, block: Block) -> None:
        name = f"G{g:g}" + (f" P{block.words['P'].number:g}" if g in (54.1, 154) and "P" in block.words else "")
        if self.zero not in ("", name):
            raise GCodeError(f"G{g:g}, a second zero point beside {self.zero}; allowed: one of G54 to G59 and the like")
        self.zero = name

    def _set_length(self, g: float, block: Block) -> None:
        """G43: from now on coordinates are those of the tool's tip."""
        self.length = True
        if self.d.name != "linuxcnc":
            self._set_tcp(False)

    def _set_tip(self, g: float, block: Block) -> None:
        self.length, self.vectors = True, g == 43.5
        self._set_tcp(True)

    def _unset_length(self, g: float, block: Block) -> None:
        if self.length:
            self.length, self.vectors = False, False
            self.change(tcp=self.tcp and self.d.name == "linuxcnc", forget=True)

    def _set_tcp(self, on: bool) -> None:
        """Tool centre point control with a length that only the control knows: where an axis is turned, the coordinates
        are not known afterwards.
        """
        rotary = self.at[self.chain.rotary_columns]
        straight = not np.nan_to_num(rotary).any()
        if on != self.tcp:
            self.flush()
            before = self.at
            self.change(tcp=on, forget=not straight)
            if straight:
                self.at = before.copy()

    def switch_tip(self, on: bool) -> None:
        """Tool centre point control on or off with the axes at rest; the control counts in the tool's length before and
        after.
        """
        if on != self.tcp:
            self.change(tcp=on)

    def _set_high(self, g: float, block: Block) -> None:
        self.high = g == 98

    def _end_cycle(self, g: float, block: Block) -> None:
        self.cycle = None

    # -- G codes: once -------------------------------------------------------------------------------------------------

    def _dwell(self, block: Block) -> None:
        self.flush()
        seconds = self.meaning.dwell(self, block)
        self.rest(seconds)

    def _elsewhere(self, block: Block) -> None:
        """G28, G30, G53, SUPA: a place that only the control knows."""
        letters = tuple(a for a in self.chain.letters if a in block.words)
        for a in letters:
            self.named.setdefault(a, self.number)
        self.rest()
        if self.tip or not self.plain:
            letters = (*self.chain.linear, *(a for a in letters if a in self.chain.rotary))
        self.lose(letters)

    def _shift(self, block: Block) -> None:
        """G52, cycle 7: a zero point beside that of the workpiece; axes that are not named keep theirs."""
        if self.follows or not self.plain:
            self.refuse("a shift of the zero point in turned coordinates")
        for i, a in enumerate(self.chain.linear):
            if a in block.words:
                word = block.words[a]
                self.local[i] = self.millimetres(word) + (self.local[i] if word.how == INCREMENTAL else 0.0)
        if any(a in block.words for a in self.chain.rotary):
            self.refuse("a shift of a rotary axis")
        self.base_origin = self.local.copy()
        self.change(self.base_turn, self.base_origin)

    def _unshift(self, g: float, block: Block) -> None:
        self.local = np.zeros(3)
        self.unset_frames()

    def _preset(self, block: Block) -> None:
        """G92: the place where the axes are gets other numbers from now on."""
        self.flush()
        if not self.known(self.at) or not self.plain:
            self.refuse("G92 at a place that is not known, or in turned coordinates")
        origin = self.origin.copy()
        for i, a in enumerate(self.chain.letters):
            if a in block.words and i < len(self.chain.linear):
                origin[i] += self._filled(self.at)[i] - self.millimetres(block.words[a])
            elif a in block.words:
                self.refuse(f"G92 of {a}")
        self.base_origin, self.local = origin, origin.copy()
        self.change(self.base_turn, origin)

    def _rotate(self, block: Block) -> None:
        """G68: coordinates turned in the plane about a point."""
        i, j, k = _PLANES[self.plane]
        at = self._filled(self.at)[:3].copy()
        for column in (i, j):
            if self.chain.letters[column] in block.words:
                at[column] = self.millimetres(block.words[self.chain.letters[column]])
        if "R" not in block.words:
            self.refuse("G68 without R")
        turn = rotation(k, np.radians(block.words["R"].number))
        at[k] = 0.0
        if np.isnan(at).any():
            self.refuse("G68 about a place that is not known")
        self.change(self.base_turn @ turn, self.base_origin + self.base_turn @ (at - turn @ at))

    def _tilt(self, block: Block) -> None:
        """G68.2: a tilted plane by its origin and three angles.

        I, J, K turn about Z, the new X and the new Z (FANUC B-64484EN/03, 7.14: Euler angles). LinuxCNC and others say
        another order with Q: 1, 2, 3 for the axes.
        """
        origin, angles = self._tilt_words(block)
        self.set_tilt(self._euler(block, angles), self.local + origin)

    def _tilt_more(self, block: Block) -> None:
        """G68.4: a tilted plane that begins at the present one."""
        origin, angles = self._tilt_words(block)
        self.set_tilt(self.base_turn @ self._euler(block, angles), self.base_turn @ origin + self.base_origin)

    def _tilt_words(self, block: Block) -> tuple[np.ndarray, np.ndarray]:
        origin = np.array([self.millimetres(block.words[a]) if a in block.words else 0.0 for a in self.chain.linear])
        return origin, np.array([block.words[a].number if a in block.words else 0.0 for a in CENTRES])

    def _euler(self, block: Block, angles: np.ndarray) -> np.ndarray:
        if "P" in block.words and block.words["P"].number not in (0.0, 1.0):
            self.refuse(f"G68.2 P{block.words['P'].number:g}")
        order = f"{int(block.words['Q'].number)}" if "Q" in block.words else "313"
        if "P" in block.words and block.words["P"].number == 1.0:  # roll, pitch, yaw about fixed axes
            order = "123" if "Q" not in block.words else order
            turns = [rotation(int(c) - 1, np.radians(v)) for c, v in zip(order, angles, strict=True)]
            return turns[2] @ turns[1] @ turns[0]
        if len(order) != 3 or set(order) - set("123"):
            self.refuse(f"G68.2 Q{order}")
        turns = [rotation(int(c) - 1, np.radians(v)) for c, v in zip(order, angles, strict=True)]
        return turns[0] @ turns[1] @ turns[2]

    def set_tilt(self, turn: np.ndarray, origin: np.ndarray) -> None:
        """A tilted plane that follows the workpiece."""
        self.base_turn, self.base_origin = np.asarray(turn, float), np.asarray(origin, float)
        self.change(self.base_turn, self.base_origin, follows=True)

    def unset_frames(self) -> None:
        """Coordinates of the workpiece again, with its shifted zero point."""
        self.base_turn, self.base_origin = np.eye(3), self.local.copy()
        self.change(self.base_turn, self.base_origin, follows=False)

    def _untilt(self, g: float, block: Block) -> None:
        self.unset_frames()

    def _blank(self, block: Block) -> None:
        """Size of the blank, for the control's graphics."""
        self.ignore(f"G{self.code:g}")

    def _stop(self, block: Block) -> None:
        self.rest()

    def _broken(self, block: Block) -> None:
        """A rounding or a chamfer as a block of its own, behind the contour whose end it breaks (HEIDENHAIN)."""
        self.break_corner("round" if self.code == 25 else "chamfer", self.millimetres(block.words.get("R", Value(0.0))))

    def break_corner(self, kind: str, size: float) -> None:
        """Break the corner behind the last contour."""
        if self.pending is None or not self.pending.cutting:
            self.refuse("a rounding or chamfer without a contour before it")
        else:
            self.pending.corner = (kind, size) if size > 0.0 else None

    def _orient(self, block: Block) -> None:
        """G53.1: the rotary axes turn until the tool is normal to the plane. G53.6 keeps its tip where it is."""
        if not self.follows:
            self.refuse(f"G{self.code:g} without a tilted plane")
        Track.orient(self, keep_tip=self.code == 53.6)

    # -- moves ---------------------------------------------------------------------------------------------------------

    def millimetres(self, value: Value) -> float:
        """A length of the program in mm."""
        return value.number * (25.4 if self.inch else 1.0)

    def _f(self, block: Block) -> float:
        f = block.words["F"].number
        if f < 1e-6:
            raise GCodeError(f"F{f:g}; allowed: a feed above 0, from 0.000001 on")
        return f

    def _go(self, block: Block) -> None:
        if "F" in block.words:
            self.feed = self._f(block)
        vector = self.meaning.vector(self, block)
        end = self.target(block)
        if self.cycle is not None:
            self._holes(block, end)
            return
        if self.motion >= CLOCKWISE:
            self._arc(block, end)
        else:
            self.straight(end, self.motion == RAPID, "F" in block.words, vector, block)
        if self.repeated is not None:
            self.drill(self.repeated)

    def target(self, block: Block) -> np.ndarray:
        """Where a block ends, program coordinates (axes,)."""
        end = self.at.copy()
        for i, a in enumerate(self.chain.letters):
            if a not in block.words:
                continue
            word = block.words[a]
            value = self.sign[i] * (word.number if self.chain.is_rotary(a) else self.millimetres(word))
            if word.how == INCREMENTAL or (not self.absolute and word.how == ""):
                if np.isnan(end[i]):
                    raise GCodeError(f"G91 with {a} before {a} has a known place; allowed: G90 with {a} first")
                end[i] += value
            else:
                end[i] = self._absolute(i, a, value, word.how)
            if a not in self.named and (any(self.cutting) or (self.pending is not None and self.pending.cutting)):
                if self.motion != RAPID or self.cycle is not None:
                    raise GCodeError(
                        f"{a} for the first time, within the path; allowed: every axis that moves is named at the "
                        f"start point"
                    )
                self.warn(f"late {a}", f"line {self.number}: {a} is named for the first time; taken as 0 before")
                self.at = np.where(np.arange(len(self.at)) == i, 0.0, self.at)
            self.named.setdefault(a, self.number)
        return end

    def _absolute(self, i: int, a: str, value: float, how: str) -> float:
        """The position of a rotary axis that an absolute word means.

        A roll-over axis takes the short way (FANUC B-63534EN/02, 20.2; HEIDENHAIN TNC 620, 10/2017, M126; DC of
        Sinumerik, 840D sl Fundamentals, 7.6). ACP and ACN say the direction. A wrapped axis of LinuxCNC takes the sign
        for the direction (WRAPPED_ROTARY).
        """
        before = self.at[i]
        if how in ("ACP", "ACN") and a in self.chain.rotary:
            before = 0.0 if np.isnan(before) else before
            step = (value - before) % 360.0 if (how == "ACP") == (self.sign[i] > 0) else -((before - value) % 360.0)
            return before + step
        if how in ("DC", "ACP", "ACN") and a not in self.chain.rotary:
            raise GCodeError(f"{a}={how}({value:g}); allowed: {how} of {' or '.join(self.chain.rotary)}")
        short = how == "DC" or (a in self.chain.round_axes and self.rollover and how != ABSOLUTE)
        if short and not np.isnan(before):
            if self.d.name == "linuxcnc":
                away = (abs(value) - before) % 360.0
                return before + (away if np.copysign(1.0, value) > 0 else away - 360.0 * (away > 0))
            step = (value - before) % 360.0
            return before + (step if step <= 180.0 else step - 360.0)
        far = not np.isnan(before) and abs(value - before) > 180.0 and self.motion != RAPID
        if far and a in self.chain.round_axes and self.rollover is None and how == "" and self.d.name != "linuxcnc":
            short_way = before + (value - before + 180.0) % 360.0 - 180.0
            if abs(short_way - value) > 1e-9:
                self.warn(
                    f"roll-over {a}",
                    f"line {self.number}: {a} goes from {before:g}° to {value:g}° in a feed move; taken the short way "
                    f"(say --no-rollover if the control turns back by {abs(value - before):g}°)",
                )
                return short_way
        return value

    def straight(
        self, end: np.ndarray, rapid: bool, own_feed: bool, vector: np.ndarray | None = None, block: Block | None = None
    ) -> None:
        """A straight move to ``end``, program coordinates; with a direction of the tool on a great circle."""
        points = end[None]
        if vector is not None:
            for a in self.chain.rotary:
                self.named.setdefault(a, self.number)
            points = self.great_circle(end, self.turn @ vector, 1 if self.by_axes else 0)
        if rapid:
            self.move(points, None, False, stop=self.exact or self.meaning.rapid_stops)
            return
        start = self._filled(self.at)
        if np.array_equal(start, self._filled(points[-1])) and not np.isnan(self.at).any():
            self.at = points[-1]
            return
        steps = np.diff(np.vstack([np.where(np.isnan(self.at), points[0], self.at), points]), axis=0)
        minutes = self._minutes(self._filled(steps), None, own_feed) if self._fed(own_feed) else np.zeros(len(steps))
        corner = self._corner(block) if block is not None else None
        self.move(points, minutes, True, stop=self.exact or self.exact_once, corner=corner)
        self.kinds.add(self.mode)

    def _fed(self, own_feed: bool) -> bool:
        if self.mode == 93 and not own_feed:
            raise GCodeError("no F in a block of G93; allowed: F in each of its blocks")
        if self.feed is None:
            raise GCodeError("a feed block before any F of this mode; allowed: F first")
        return True

    def _minutes(self, steps: np.ndarray, ways: np.ndarray | None, own_feed: bool) -> np.ndarray:
        """Duration of each of the parts of one block.

        Args:
            steps: (k, axes) of the parts, mm and degrees.
            ways: (k,) of the linear axes on an arc, mm; ``None``: straight.
        """
        self._fed(own_feed)
        feed = self.feed
        assert feed is not None
        linear, rotary = self.chain.linear_columns, self.chain.rotary_columns
        per = 25.4 if self.feed_inch else 1.0
        way = np.linalg.norm(steps[:, linear] * (self.group * self.radius)[linear], axis=1) if ways is None else ways
        if self.mode == 93:
            shares = way if way.any() else np.abs(steps).sum(axis=1)
            return shares / shares.sum() / feed
        if self.tip and self.d.name != "linuxcnc":
            if not way.any() and steps[:, rotary].any():
                raise GCodeError(
                    "axes turn while the tool tip rests: F has no meaning with tool centre point control; allowed: G93"
                )
            return way / per / feed
        turned = steps[:, rotary] * (self.group * self.radius)[rotary]
        length = np.sqrt((way / per) ** 2 + (turned**2).sum(axis=1))
        if not length.any():
            length = np.linalg.norm(steps[:, rotary], axis=1)
        return length / feed

    def _corner(self, block: Block) -> tuple[str, float] | None:
        for word, kind in ((",R", "round"), ("RND", "round"), (",C", "chamfer"), ("CHR", "chamfer"), ("CHF", "length")):
            if word in block.words:
                size = self.millimetres(block.words[word])
                return (kind, size) if size > 0.0 else None
        return ("round", self.rounding) if self.rounding > 0.0 else None

    def _arc(self, block: Block, end: np.ndarray) -> None:
        """An arc in a plane; the other axes move along in proportion (a helix).

        The end may lie a little nearer to the centre than the start; the radius then changes evenly. Without a centre
        and a radius it is a straight line, as for Fanuc (B-64484EN, parameter 3403#5 = 0), and that is said.
        """
        letters = set(self.chain.linear)
        i, j, _ = _PLANES[self.plane]
        if not {ALONG[i], ALONG[j]} <= letters:
            self.refuse(f"an arc in the plane G{self.plane}")
        if np.isnan(self.at[[i, j]]).any() or np.isnan(end[[i, j]]).any():
            raise GCodeError(f"an arc from a place that is not known; allowed: {ALONG[i]} and {ALONG[j]} before")
        counter = self.motion == COUNTERCLOCKWISE
        start = self._filled(self.at)
        end = np.where(np.isnan(end), start, end)
        centre = self._centre(block, start, end, i, j, counter)
        if centre is None:
            self.straight(end, False, "F" in block.words, None, block)
            return
        self.arc(end, centre, counter, self.meaning.turns(block), "F" in block.words, self._corner(block))

    def arc(
        self,
        end: np.ndarray,
        centre: np.ndarray,
        counter: bool,
        turns: int = 0,
        own_feed: bool = True,
        corner: tuple[str, float] | None = None,
    ) -> None:
        """An arc in the plane of now, in chords that stay within a tenth of a micrometre of it.

        Args:
            end: (axes,) program coordinates. centre: (2,) in the plane. counter: Whether it is counter-clockwise.
            turns: Whole turns more. own_feed: Whether F stands in its block. corner: Behind it.
        """
        i, j, _ = _PLANES[self.plane]
        start = self._filled(self.at)
        a, b = start[[i, j]] - centre, end[[i, j]] - centre
        ra, rb = float(np.hypot(*a)), float(np.hypot(*b))
        if abs(ra - rb) > _ROUND:
            self.warn(
                "arc",
                f"line {self.number}: an arc whose end is {rb:.3f} mm from its centre and its start {ra:.3f} mm; read "
                "as a spiral, which the control may refuse",
            )
        sweep = (np.arctan2(b[1], b[0]) - np.arctan2(a[1], a[0])) * (1.0 if counter else -1.0) % (2 * np.pi)
        if np.hypot(*(a - b)) < 1e-6:
            sweep = 2 * np.pi
        sweep += 2 * np.pi * turns
        count = chords(max(ra, rb), sweep)
        shares = np.arange(1, count + 1) / count
        angle = np.arctan2(a[1], a[0]) + (1.0 if counter else -1.0) * sweep * shares
        radius = ra + (rb - ra) * shares
        points = start + shares[:, None] * (end - start)
        points[:, i], points[:, j] = centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)
        points[-1, [i, j]] = end[[i, j]]
        along = np.delete((end - start)[self.chain.linear_columns], [i, j])
        way = np.sqrt((0.5 * (ra + rb) * sweep) ** 2 + (along**2).sum()) / count
        steps = np.diff(np.vstack([start, points]), axis=0)
        minutes = self._minutes(steps, np.full(count, way), own_feed)
        self.move(points, minutes, True, stop=self.exact or self.exact_once, corner=corner)
        self.kinds.add(self.mode)

    def _centre(
        self, block: Block, start: np.ndarray, end: np.ndarray, i: int, j: int, counter: bool
    ) -> np.ndarray | None:
        """Centre of an arc, (2,), by R or by I, J, K."""
        word = block.words.get("CR") or block.words.get("R")
        p, q = start[[i, j]], end[[i, j]]
        if word is not None:
            r, d = self.millimetres(word), q - p
            chord = float(np.hypot(*d))
            if chord < 1e-9:
                raise GCodeError(
                    f"R{word.number:g} of an arc that ends where it begins; allowed: I, J, K for a full circle"
                )
            if abs(r) < 0.5 * chord - 0.5 * _ROUND:
                raise GCodeError(
                    f"R{word.number:g} of an arc between points {chord:g} mm apart; allowed: at least half of that"
                )
            height = np.sqrt(max(r * r - 0.25 * chord * chord, 0.0))
            left = np.array([-d[1], d[0]]) / chord
            return 0.5 * (p + q) + left * height * (1.0 if counter == (r > 0) else -1.0)
        if self.pole is not None:
            if np.isnan(self.pole[[i, j]]).any():
                raise GCodeError("a circle about a pole that is not known; allowed: its centre before")
            return self.pole[[i, j]]
        if not set(block.words) & {CENTRES[i], CENTRES[j]}:
            self.warn(
                "circle",
                f"line {self.number}: a circle without a centre or a radius; read as a straight line, as Fanuc "
                "controls do (parameter 3403#5 = 0); others refuse it",
            )
            return None
        out = p.copy()
        for n, column in enumerate((i, j)):
            given = block.words.get(CENTRES[column])
            if given is None:
                if self.centre_absolute:
                    out[n] = 0.0
                continue
            at = self.millimetres(given)
            out[n] = at if given.how == ABSOLUTE or (self.centre_absolute and given.how == "") else p[n] + at
        return out

    # -- drilling ------------------------------------------------------------------------------------------------------

    def _set_cycle(self, g: float, block: Block) -> None:
        """G73, G81 to G85, G89 and tapping: cycles that are moves along the tool.

        G76, G86 to G88 stop the spindle or shift the tool and are refused by the tables.
        """
        if self.cycle is None:
            self.cycle = {"initial": self.at[2]}
        self.cycle["kind"] = g
        self.motion = LINE

    def _holes(self, block: Block, end: np.ndarray) -> None:
        cycle = self.cycle
        assert cycle is not None
        if self.plane != 17:
            self.refuse(f"a drilling cycle in the plane G{self.plane}")
        down = self.chain.letters[2]
        if np.isnan(cycle["initial"]):
            cycle["initial"] = self.at[2]
        if np.isnan(cycle["initial"]):
            raise GCodeError(f"a cycle before {down} has a known place; allowed: a word of {down} first")
        for key in "QP":
            if key in block.words:
                cycle[key] = block.words[key].number if key == "P" else self.millimetres(block.words[key])
        if "R" in block.words:
            cycle["plane"] = self.millimetres(block.words["R"]) + (0.0 if self.absolute else cycle["initial"])
        if down in block.words:
            cycle["depth"] = self.millimetres(block.words[down]) + (
                0.0 if self.absolute else cycle.get("plane", cycle["initial"])
            )
        if "depth" not in cycle or "plane" not in cycle:
            raise GCodeError(f"a cycle without its depth {down} or its plane R; allowed: both in its first block")
        repeat = next((int(block.words[w].number) for w in "KL" if w in block.words), 1)
        step = end - self.at
        step[2] = 0.0
        for _ in range(repeat):
            place = self.at + step if not self.absolute else end.copy()
            place[2] = self.at[2]
            self.hole(
                place, cycle["plane"], cycle["depth"], cycle["kind"], cycle.get("Q", 0.0), self._cycle_dwell(cycle)
            )
            place[2] = max(cycle["initial"], cycle["plane"]) if self.high else cycle["plane"]
            self.straight(place, True, False)

    def _cycle_dwell(self, cycle: dict) -> float:
        return cycle.get("P", 0.0) * (1e-3 if self.d.name == "fanuc" else 1.0)

    def drill(self, hole: tuple[float, float, float, float]) -> None:
        """A hole where the axes are: heights of the plane where feed begins, of its bottom, of the end; dwell, s."""
        plane, depth, back, dwell = hole
        self.hole(self.at.copy(), plane, depth, 81, 0.0, dwell)
        end = self.at.copy()
        end[2] = back
        self.straight(end, True, False)

    def hole(self, place: np.ndarray, plane: float, depth: float, kind: float, peck: float, dwell: float) -> None:
        """One hole, from above to the plane where the next move begins.

        Args:
            place: (axes,) where the drill is above the hole. plane: Where feed begins. depth: Of the hole.
            kind: 81 straight; 83 pecks and goes out to the plane; 73 pecks and goes back a little; 84, 85, 89 come back
                with feed. peck: Depth of one peck, 0: all at once. dwell: At the bottom, s.
        """
        if self.mode == 93:
            self.refuse("a drilling cycle with G93")

        def to(z: float, rapid: bool) -> None:
            end = place.copy()
            end[2] = z
            self.straight(end, rapid, True)

        if not np.isnan(place[2]) and place[2] < plane:
            to(plane, True)
            place = place.copy()
            place[2] = plane
        self.straight(place, True, False)
        to(plane, True)
        pecks = kind in (73, 83) and peck > 0.0
        levels = [*np.arange(plane - peck, depth, -peck), depth] if pecks else [depth]
        back = 0.254 if self.d.name == "linuxcnc" else _PECK
        if pecks and self.d.name != "linuxcnc":
            self.warn(
                "peck",
                f"line {self.number}: a pecking cycle goes back by {back:g} mm (a parameter of the control; assumed)",
            )
        for n, level in enumerate(levels):
            if n and kind == 83:
                to(plane, True)
                to(levels[n - 1] + back, True)
            elif n:
                to(levels[n - 1] + back, True)
            to(level, False)
        if dwell > 0.0:
            self.rest(dwell)
        if kind in (74, 84, 85, 89):
            to(plane, False)
        else:
            to(plane, True)

    # -- M codes -------------------------------------------------------------------------------------------------------

    def _m(self, m: float, block: Block) -> None:
        action, _ = self.meaning.of_m(self, m)
        if action == "end":
            self.ended = True
        elif action == "rest":
            self.rest()
            self.ignore(f"M{m:g}")
        elif action == "tip":
            self.switch_tip(m in (128, 428))
        elif action == "short":
            self.rollover = m == 126
        elif action == "ignored":
            self.ignore(f"M{m:g}")
        else:
            getattr(self, f"_{action}")(m, block)
