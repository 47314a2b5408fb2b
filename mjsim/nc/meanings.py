"""What the codes of each dialect mean: a table of G codes, a rule for M codes, and a few functions.

An entry is the name of what :class:`mjsim.nc.modal.Modal` does, and the words that it takes along. ``!`` marks what is
done once and uses up the axis words of its block. ``ignored`` changes no motion of a machine. A code that is in no
table is refused by its name.

Sources: FANUC 30i-B Operator's Manual B-64484EN; SINUMERIK 840D sl Programming Manuals Fundamentals 6FC5398-1BP40 and
Job Planning 6FC5398-2BP40; HEIDENHAIN TNC 620 User's Manuals 10/2017 (Klartext, DIN/ISO); LinuxCNC 2.9 G-Code
Reference.
"""

from __future__ import annotations

import numpy as np

from mjsim.machine.axis import ALONG, BESIDE
from mjsim.machine.kinematics import rotation
from mjsim.nc.modal import Modal
from mjsim.nc.words import CENTRES, INCREMENTAL, VECTOR, Block, GCodeError, Value, evaluate, shown

_IGNORED = ("ignored", "")
_CYCLE = ("set_cycle", "RQPKL")
_COMMON: dict[float, tuple[str, str]] = {
    **dict.fromkeys((0, 1, 2, 3), ("set_motion", "")),
    4: ("!dwell", "PXUFS"),
    9: ("set_exact_once", ""),
    **dict.fromkeys((17, 18, 19), ("set_plane", "")),
    40: _IGNORED,
    **dict.fromkeys((54, 55, 56, 57), ("set_zero", "")),
    64: ("set_path", ""),
    **dict.fromkeys((90, 91), ("set_absolute", "")),
    **dict.fromkeys((93, 94), ("set_feed_mode", "")),
    **dict.fromkeys((96, 97), _IGNORED),
}
_LETTERS = {
    **_COMMON,
    20: ("set_inch", ""),
    21: ("set_mm", ""),
    28: ("!elsewhere", ""),
    30: ("!elsewhere", "P"),
    43: ("set_length", "H"),
    49: ("unset_length", ""),
    52: ("!shift", ""),
    53: ("!elsewhere", ""),
    **dict.fromkeys((58, 59), ("set_zero", "")),
    61: ("set_exact", ""),
    **dict.fromkeys((73, 81, 82, 83, 85, 89), _CYCLE),
    80: ("end_cycle", ""),
    92: ("!preset", ""),
    **dict.fromkeys((98, 99), ("set_high", "")),
    91.1: ("set_centre", ""),
    68.2: ("!tilt", "IJKPQR"),
    68.4: ("!tilt_more", "IJKPQR"),
    53.1: ("!orient", "P"),
    53.6: ("!orient", "P"),
    69: ("untilt", ""),
}
_FANUC = {
    **_LETTERS,
    5: ("ignored", "P"),
    5.1: ("ignored", "QRP"),
    8: ("ignored", "P"),
    13.1: _IGNORED,
    15: _IGNORED,
    40.1: _IGNORED,
    43.4: ("set_tip", "H"),
    43.5: ("set_tip", "H"),
    50: _IGNORED,
    50.1: _IGNORED,
    54.1: ("set_zero", "P"),
    61.1: ("set_path", ""),
    67: _IGNORED,
    68: ("!rotate", "R"),
    **dict.fromkeys((74, 84), _CYCLE),
    154: ("set_zero", "P"),
    187: ("ignored", "PE"),
    234: ("set_tip", "H"),
}
_LINUXCNC = {
    **_LETTERS,
    8: _IGNORED,
    28.1: _IGNORED,
    30.1: _IGNORED,
    **dict.fromkeys((59.1, 59.2, 59.3), ("set_zero", "")),
    61.1: ("set_exact", ""),
    **dict.fromkeys((38.2, 38.3, 38.4, 38.5), ("set_probing", "")),
    64: ("set_path", "PQ"),
    90.1: ("set_centre", ""),
    92.1: ("unshift", ""),
    96: ("ignored", "D"),
}
del _LINUXCNC[9]
_SIEMENS = {
    **_COMMON,
    53: ("!elsewhere", ""),
    153: ("!elsewhere", ""),
    60: ("set_exact", ""),
    **dict.fromkeys((641, 642, 643, 644, 645), ("set_path", "")),
    **dict.fromkeys((601, 602, 603, 450, 451, 460, 461, 462, 961, 971, 962, 972, 973), _IGNORED),
    500: ("set_zero", ""),
    **dict.fromkeys(range(505, 600), ("set_zero", "")),
    70: ("set_inch_lengths", ""),
    71: ("set_mm", ""),
    700: ("set_inch", ""),
    710: ("set_mm", ""),
    74: ("!elsewhere", ""),
    75: ("!elsewhere", ""),
}
_TNC = {
    **{k: v for k, v in _COMMON.items() if k not in (9, 54, 55, 56, 57, 64, 93, 94, 96, 97)},
    4: ("!dwell", "F"),
    **dict.fromkeys((30, 31), ("!blank", "")),
    38: ("!stop", ""),
    **dict.fromkeys((50, 51, 99), ("ignored", "LR")),
    54: ("!shift", ""),
    70: ("set_inch", ""),
    71: ("set_mm", ""),
    98: ("ignored", "L"),
    247: ("ignored", ""),
    **dict.fromkeys((24, 25), ("!broken", "R")),
}


class Fanuc:
    """The meaning of the codes of Fanuc and alike.

    Attributes:
        g: Table of G codes.
        allowed: What the dialect allows, for messages.
        words: Addresses that are allowed in every block.
        arc_words: Addresses that an arc may have beside I, J, K.
        vector_words: Addresses of a direction of the tool.
        rapid_stops: Whether the axes come to rest at the end of a rapid move: G00 of a Fanuc ends with an in-position
            check (B-64484EN, 4.1).
        builder: M codes from here on belong to the maker of the machine, and may call programs.
    """

    g = _FANUC
    allowed = (
        "G0 to G3, G17 to G19, G90 G91, G93 G94, G20 G21, G4 G9 G61 G64, G28 G30 G53, one of G54 to G59, G43 G43.4 "
        "G43.5 G49, G68 G68.2 G53.1 G69, G52 G92, G73 G81 to G85 G89 G80 (no cutter compensation, no macros)"
    )
    words: frozenset[str] = frozenset({",R", ",C"})
    arc_words: frozenset[str] = frozenset("R")
    vector_words: frozenset[str] = frozenset()
    rapid_stops = True
    builder = 96

    def of_g(self, modal: Modal, g: float) -> tuple[str, str]:
        """What a G code does, and the words that it takes."""
        if g not in self.g:
            modal.refuse(f"G{g:g}")
        return self.g[g]

    def of_m(self, modal: Modal, m: float) -> tuple[str, str]:
        """What an M code does, and the words that it takes."""
        if m in (2, 30, 99):
            return "end", ""
        if m in (0, 1, 6, 60):
            return "rest", ""
        if m >= self.builder or m != int(m):
            raise GCodeError(
                f"M{m:g}; allowed: no calls of other programs, and no M code that the machine's maker defines"
            )
        return _IGNORED

    def prepare(self, modal: Modal, block: Block) -> None:
        """What words of the dialect do before the codes."""

    def dwell(self, modal: Modal, block: Block) -> float:
        """Duration of G4, s: P in ms, X or U in s (Fanuc)."""
        if "P" in block.words:
            return block.words["P"].number * 1e-3
        return next((block.words[w].number for w in (ALONG[0], BESIDE[0]) if w in block.words), 0.0)

    def turns(self, block: Block) -> int:
        """Whole turns of an arc beside the part of one."""
        return 0

    def vector(self, modal: Modal, block: Block) -> np.ndarray | None:
        """Direction of the tool that a block commands, (3,): I, J, K with G43.5 (Fanuc, type 2)."""
        if not modal.vectors or modal.motion > 1 or not set(block.words) & set(CENTRES):
            return None
        return _vector(modal, block, CENTRES)


def _vector(modal: Modal, block: Block, letters: tuple[str, ...]) -> np.ndarray:
    """A direction by its three components; those left out are 0."""
    if set(block.words) & set(modal.chain.rotary):
        modal.refuse(f"a direction of the tool and {' or '.join(modal.chain.rotary)} in one block")
    out = np.array([block.words[a].number if a in block.words else 0.0 for a in letters])
    if not out.any():
        modal.refuse("a direction of the tool of length 0")
    return out


class LinuxCNC(Fanuc):
    """LinuxCNC, as far as its own interpreter is not needed (:mod:`mjsim.nc.interpreter`)."""

    g = _LINUXCNC
    allowed = (
        "G0 to G3, G38.2 to G38.5, G17 to G19, G90 G91, G90.1 G91.1, G93 G94, G20 G21, G4 G61 G64, G28 G30 G53, one "
        "of G54 to G59.3, G43 G49, G52 G92, G68.2 G53.1 G69, G73 G81 to G83 G85 G89 G80, M428 M429"
    )
    arc_words = frozenset("RP")
    rapid_stops = False
    builder = 100

    def of_m(self, modal: Modal, m: float) -> tuple[str, str]:
        """M428 and M429 switch tool centre point control on and off (its five-axis configurations)."""
        if m in (428, 429):
            return "tip", ""
        if m in (61, 62, 63, 64, 65):
            return "ignored", "PQ"
        if m == 19:  # the spindle turns to an angle
            return "ignored", "RQP"
        if m in (66, 67, 68, 72, 73, 98):
            modal.refuse(f"M{m:g}")
        return super().of_m(modal, m)

    def dwell(self, modal: Modal, block: Block) -> float:
        """P in s."""
        return block.words["P"].number if "P" in block.words else 0.0

    def turns(self, block: Block) -> int:
        """P counts the turns that are begun."""
        return max(0, int(block.words["P"].number) - 1) if "P" in block.words else 0


class Siemens(Fanuc):
    """Sinumerik 840D and later."""

    g = _SIEMENS
    allowed = (
        "G0 to G3, G17 to G19, G90 G91, G93 G94, G70 G71 G700 G710, G4 G9 G60 G64 G641 to G645, one of G54 to G599, "
        "SUPA, TRANS ATRANS ROT AROT, TRAORI TRAFOOF, CYCLE800 CYCLE832 CYCLE81 CYCLE82, FGROUP FGREF, RND CHR CHF"
    )
    words = frozenset(
        {"RND", "RNDM", "CHR", "CHF", "ADIS", "ADISPOS", "CTOL", "OTOL", "ATOL", "LIMS", "SPOS", "DL", "FP", "RPL"}
    )
    arc_words = frozenset({"CR", "TURN"})
    vector_words = frozenset(VECTOR)
    rapid_stops = False
    builder = 100
    #: Words that change no motion of an ideal control.
    harmless = frozenset(
        "ORIWKS ORIMKS ORISON ORISOF ORIEULER ORIRPY COMPOF COMPON COMPCURV COMPCAD COMPSURF SOFT BRISK DRIVE FFWON "
        "FFWOF UPATH SPATH STOPRE FIFOCTRL STARTFIFO STOPFIFO CUT2D CUT2DF CUT3DC CUT3DF CUT3DFS CUT3DFF DIAMOF NORM "
        "KONT CFC CFTCP CFIN WALIMON WALIMOF RTLION SAVE DISPLOF DISPLON DYNNORM DYNPOS DYNROUGH DYNSEMIFIN DYNFINISH "
        "CDOF CDON GFRAME0 TOFFOF PTPG0 CP CUTMOD".split()
    )
    harmless_calls = frozenset(
        "MSG WORKPIECE SETMS CYCLE832 STOPRE GROUP_BEGIN GROUP_END SETAL F_HEAD E_HEAD TCARR G_HEAD".split()
    )

    def of_m(self, modal: Modal, m: float) -> tuple[str, str]:
        """M17 ends a program, too."""
        return ("end", "") if m == 17 else super().of_m(modal, m)

    def prepare(self, modal: Modal, block: Block) -> None:
        """Words without G codes: frames, transformations, cycles."""
        for name, arguments in block.calls:
            self._call(modal, block, name, arguments)
        for name in block.names:
            self._name(modal, block, name)
        for word in [w for w in block.words if w.startswith("FGREF")]:
            axis, radius = word[6:-1], block.words.pop(word).number
            if axis not in modal.chain.rotary or radius <= 0:
                raise GCodeError(f"{word}={radius:g}; allowed: a radius above 0 of {' or '.join(modal.chain.rotary)}")
            modal.radius[modal.chain.index(axis)] = radius * np.pi / 180.0
        if "RNDM" in block.words:
            modal.rounding = block.words["RNDM"].number
        for word in ("CTOL", "OTOL", "ATOL", "LIMS", "SPOS", "DL"):
            if word in block.words:
                modal.ignore(word)
        if "L" in block.words:
            raise GCodeError(f"L{block.words['L'].number:g}, a call; allowed: no calls of other programs")

    def _call(self, modal: Modal, block: Block, name: str, arguments: list[str]) -> None:
        if name == "FGROUP":
            names = tuple(a.strip().upper() for a in arguments if a.strip())
            if not set(names) <= set(modal.chain.letters):
                raise GCodeError(f"FGROUP({','.join(arguments)}); allowed: axes of {', '.join(modal.chain.letters)}")
            modal.group = np.array([1.0 if a in names or not names else 0.0 for a in modal.chain.letters])
        elif name == "TRAORI":
            if any(a not in ("", "0", "1") for a in arguments):
                modal.refuse(f"TRAORI({','.join(arguments)})")
            modal.switch_tip(True)
        elif name == "TRAFOOF":
            modal.switch_tip(False)
        elif name == "CYCLE800":
            swivel(modal, arguments)
        elif name in ("CYCLE81", "CYCLE82"):
            self._drill(modal, block, name, arguments)
        elif name in self.harmless_calls:
            modal.ignore(f"{name}({','.join(arguments)})" if name == "CYCLE832" else name)
        else:
            modal.refuse(
                f"{name}({shown(','.join(arguments))})" if "[" not in name else f"{name}={shown(arguments[0])}"
            )

    def _drill(self, modal: Modal, block: Block, name: str, arguments: list[str]) -> None:
        """CYCLE81(RTP, RFP, SDIS, DP, DPR) and CYCLE82 with the dwell DTB at the bottom; MCALL repeats it."""
        rtp, rfp, sdis, dp, dpr, dtb = (_number(modal, a) for a in [*arguments, *[""] * 6][:6])
        if rtp is None or (dp is None and dpr is None):
            modal.refuse(f"{name} without its retraction plane or its depth")
        top = rfp or 0.0
        depth = dp if dp is not None else top - abs(dpr or 0.0)
        hole = (top + abs(sdis or 0.0), depth, rtp or 0.0, (dtb or 0.0) if name == "CYCLE82" else 0.0)
        if "MCALL" in block.names:
            modal.repeated = hole
        else:
            modal.drill(hole)

    def _name(self, modal: Modal, block: Block, name: str) -> None:
        if name in ("TRANS", "ATRANS", "ROT", "AROT"):
            self._frame(modal, block, name)
        elif name in ("TRAORI", "TRAFOOF"):
            modal.switch_tip(name == "TRAORI")
        elif name == "SUPA":
            modal.rest()
            letters = tuple(a for a in modal.chain.letters if block.words.pop(a, None) is not None)
            for a in letters:
                modal.named.setdefault(a, modal.number)
            modal.lose(letters)
        elif name in ("ORIAXES", "ORIVECT", "ORIPLANE"):
            modal.by_axes = name == "ORIAXES"
            modal.ignore(name)
        elif name == "RET":
            modal.ended = True
        elif name == "MCALL":
            if not block.calls:
                modal.repeated = None
        elif name in ("SCALE", "ASCALE", "MIRROR", "AMIRROR") and set(block.words) & set(modal.chain.letters):
            modal.refuse(name)
        elif name in self.harmless or name in ("SCALE", "MIRROR"):
            modal.ignore(name)
        else:
            modal.refuse(name)

    def _frame(self, modal: Modal, block: Block, name: str) -> None:
        """TRANS, ATRANS, ROT, AROT: frames; those without A begin anew (Fundamentals, chapter 12).

        Rotations about several axes in one block turn about Z, then the new Y, then the new X (RPY).
        """
        words = {a: block.words.pop(a) for a in modal.chain.linear if a in block.words}
        if set(block.words) & set(modal.chain.rotary):
            modal.refuse(f"{name} of a rotary axis")
        turn, origin = (modal.base_turn, modal.base_origin) if name in ("ATRANS", "AROT") else (np.eye(3), np.zeros(3))
        if "TRANS" in name:
            shift = np.array([modal.millimetres(words[a]) if a in words else 0.0 for a in ALONG])
            origin = origin + turn @ shift
        else:
            angles = [words[a].number if a in words else 0.0 for a in ALONG]
            if "RPL" in block.words:
                angles[{17: 2, 18: 1, 19: 0}[modal.plane]] += block.words["RPL"].number
            for along in (2, 1, 0):
                turn = turn @ rotation(along, np.radians(angles[along]))
        modal.base_turn, modal.base_origin = turn, origin
        modal.change(turn, origin)

    def dwell(self, modal: Modal, block: Block) -> float:
        """F in s, S in revolutions of the spindle."""
        if "F" in block.words:
            return block.words["F"].number
        if modal.spindle <= 0.0:
            modal.refuse("a dwell in revolutions of a spindle whose speed the program does not say")
        return 60.0 * block.words["S"].number / modal.spindle if "S" in block.words else 0.0

    def turns(self, block: Block) -> int:
        """TURN: additional whole turns."""
        return int(block.words["TURN"].number) if "TURN" in block.words else 0

    def vector(self, modal: Modal, block: Block) -> np.ndarray | None:
        """A3, B3, C3: from the tool's tip to its holder (840D Job Planning, 03/2006, 7-20)."""
        if not set(block.words) & set(VECTOR):
            return None
        if not modal.tcp:
            modal.refuse("a direction of the tool without TRAORI")
        return _vector(modal, block, VECTOR)


def _number(modal: Modal, text: str) -> float | None:
    """An argument of a cycle; nothing where it is left out."""
    return evaluate(text, modal.variables) if text else None


def swivel(modal: Modal, arguments: list[str]) -> None:
    """CYCLE800: a tilted plane, and the rotary axes turned to it.

    CYCLE800(FR, TC, ST, MODE, X0, Y0, Z0, A, B, C, X1, Y1, Z1, DIR, FR_I, DMODE). MODE is bit-coded: bits 6 and 7 say
    how (0: axis by axis), bits 0 to 5 the axes of the three rotations, each about the axes as the rotations before have
    turned them (SINUMERIK Operate, Milling, CYCLE800). The units of ST say whether the plane is a new one or added to
    the present one; DIR, whether the first rotary axis is to be above 0 or below, or whether nothing turns.

    Raises:
        GCodeError: another swivel mode, or text where a number belongs.
    """
    if not any(arguments):
        modal.unset_frames()
        return
    texts = [*arguments, *[""] * 16][:16]
    numbers = [0.0 if i == 1 else _number(modal, a) or 0.0 for i, a in enumerate(texts)]
    mode, kind = int(numbers[3]), int(numbers[3]) >> 6
    if kind != 0:
        modal.refuse(f"CYCLE800 with MODE {mode} (its angles are not axis by axis)")
    about = [(mode >> shift & 3) - 1 for shift in (0, 2, 4)]
    if -1 in about:
        modal.refuse(f"CYCLE800 with MODE {mode}")
    before, turned, after = (np.array(numbers[i : i + 3]) for i in (4, 7, 10))
    turn, origin = (modal.base_turn, modal.base_origin) if int(numbers[2]) % 10 == 1 else (np.eye(3), np.zeros(3))
    origin = origin + turn @ before
    for along, angle in zip(about, turned, strict=True):
        turn = turn @ rotation(along, np.radians(angle))
    modal.set_tilt(turn, origin + turn @ after)
    direction = int(numbers[13])
    if direction not in (-1, 0, 1):
        modal.refuse(f"CYCLE800 with DIR {direction}")
    if direction:
        first = modal.chain.turning[-1] if modal.chain.turning else modal.chain.swivelling[-1]
        side = int(modal.sign[modal.chain.index(first.letter)])
        modal.orient(sign=direction * side)


class TNC(Fanuc):
    """HEIDENHAIN, programs in DIN/ISO. :mod:`mjsim.nc.klartext` has the other language, with the same M codes."""

    g = _TNC
    allowed = (
        "G00 to G03 with I, J or R, G17 to G19, G90 G91, G70 G71, G04, G24 G25, G30 G31, G40, G54, G247, M126 to "
        "M129 (no cycles, no radius compensation)"
    )
    words = frozenset({"Q339"})
    arc_words = frozenset("R")
    rapid_stops = False
    more_turns = 0

    def of_m(self, modal: Modal, m: float) -> tuple[str, str]:
        """M codes of the TNC; those from 90 on are the control's own."""
        if m in (0, 1, 6):
            return "rest", ""
        if m in (2, 30):
            return "end", ""
        if m in (128, 129):
            return "tip", ""
        if m in (126, 127):
            return "short", ""
        if m in (97, 98, 107, 108, 111, 117, 121, 131, 137, 141, 143, 148, 149) or m < 89 or 90 <= m <= 90:
            return _IGNORED
        raise GCodeError(
            f"M{m:g}; allowed: M0 to M90, M91 M92, M126 M127, M128 M129, and M codes that change no motion"
        )

    def prepare(self, modal: Modal, block: Block) -> None:
        """The pole of circles (I, J, K), and places of the machine (M91, M92)."""
        centre = {w: block.words.pop(w) for w in CENTRES if w in block.words}
        if centre:
            pole = modal.at[:3].copy() if modal.pole is None else modal.pole
            for i, w in enumerate(CENTRES):
                if w in centre:
                    relative = centre[w].how == INCREMENTAL or (not modal.absolute and centre[w].how == "")
                    pole[i] = modal.millimetres(centre[w]) + (modal.at[i] if relative else 0.0)
            modal.pole = pole
        if set(block.m) & {91.0, 92.0}:
            block.m = [m for m in block.m if m not in (91.0, 92.0)]
            letters = tuple(a for a in modal.chain.letters if block.words.pop(a, None) is not None)
            for a in letters:
                modal.named.setdefault(a, modal.number)
            modal.rest()
            modal.lose(letters)

    def dwell(self, modal: Modal, block: Block) -> float:
        """F in s."""
        return block.words.get("F", Value(0.0)).number

    def turns(self, block: Block) -> int:
        """Of a helix of Klartext (CP with IPA)."""
        return self.more_turns


MEANINGS = {"fanuc": Fanuc, "siemens": Siemens, "linuxcnc": LinuxCNC, "heidenhain": TNC}
