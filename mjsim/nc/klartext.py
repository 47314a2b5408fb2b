"""HEIDENHAIN Klartext: statements in words, which become blocks of the same modal state as G-code.

Source: HEIDENHAIN TNC 620, User's Manual Klartext Programming, 10/2017.
"""

from __future__ import annotations

import re

import numpy as np

from mjsim.machine.axis import ABOUT, ALONG
from mjsim.machine.kinematics import rotation
from mjsim.nc.modal import Modal
from mjsim.nc.words import ABSOLUTE, CENTRES, INCREMENTAL, Block, Value, evaluate, shown

_FLAGS = re.ASCII | re.IGNORECASE
_VALUE = r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+|Q[LRS]?\d+)"
_AXIS = re.compile(rf"(I?)([A-Z])\s*({_VALUE})(?![A-Z\d])", _FLAGS)
_TOOL = re.compile(rf"\bT([XYZ])\s*({_VALUE})", _FLAGS)
_NORMAL = re.compile(rf"\bN([XYZ])\s*({_VALUE})", _FLAGS)
_KEYED = re.compile(rf"\b(Q\d+)\s*=\s*({_VALUE})", _FLAGS)
_WORD = re.compile(r"\s*([A-Z][A-Z_]*)", _FLAGS)
#: Statements that change no motion of the tool.
_HARMLESS = ("BEGIN", "END", "BLK", "TOOL DEF", "LBL", "FUNCTION MODE", "FUNCTION PROG", "PRESET")
_HARMLESS_CYCLES = {247, 32, 20, 392}


def statements(lines: list[str]) -> list[tuple[int, str]]:
    """Statements with the numbers of their lines: comments and block numbers taken away, continued lines joined."""
    out: list[tuple[int, str]] = []
    joined = False
    for number, line in enumerate(lines, start=1):
        text = line.partition(";")[0].strip()
        if not joined:
            text = re.sub(r"^\d+\s*", "", text)
        continued = text.endswith("~")
        text = text.rstrip("~").strip()
        if joined:
            out[-1] = out[-1][0], f"{out[-1][1]} {text}"
        elif text:
            out.append((number, text))
        joined = continued and bool(out)
    return out


class Klartext:
    """Statements carried out by a control.

    Args:
        modal: The control.
    """

    def __init__(self, modal: Modal) -> None:
        self.modal = modal
        modal.motion = 1
        self.cycle: dict[str, float] | None = None

    def take(self, text: str, number: int) -> None:
        """Carry out one statement.

        Raises:
            GCodeError: it cannot be carried out without guessing.
        """
        modal = self.modal
        modal.number = number
        if text.startswith("/"):
            if modal.skipped():
                return
            text = text[1:].strip()
        if text.startswith(("*", "%")):
            return
        if re.match(r"Q\d+\s*=", text, _FLAGS) or re.match(r"FN\s*0\s*:", text, _FLAGS):
            self._assign(text)
            return
        word = _WORD.match(text)
        name = word[1].upper() if word else ""
        rest = text[word.end() :].strip() if word else text
        if name == "BEGIN":
            if re.search(r"\bINCH\b", text, _FLAGS):
                modal.inch = modal.feed_inch = True
            return
        if any(text.upper().startswith(h) for h in _HARMLESS):
            if name not in ("BEGIN", "END"):
                modal.ignore(" ".join(text.split()[: 1 if name in ("BLK", "LBL") else 2]).upper())
            modal.ended = modal.ended or name == "END"
            return
        handler = {
            "L": self._line, "LN": self._line, "LP": self._polar, "CC": self._pole, "C": self._circle,
            "CR": self._circle, "CP": self._polar_circle, "RND": self._corner, "CHF": self._corner,
            "TOOL": self._tool, "CYCL": self._cycle,
            "PLANE": self._plane, "FUNCTION": self._function, "STOP": self._stop, "M": None,
        }.get(name)  # fmt: skip
        if name == "M" or re.match(r"M\d", text, _FLAGS):
            self._block([], text)
        elif handler is None:
            modal.refuse(shown(text))
        else:
            handler(name, rest)

    # -- words ---------------------------------------------------------------------------------------------------------

    def _worth(self, text: str) -> float:
        return evaluate(text.replace(",", "."), self.modal.variables)

    def _assign(self, text: str) -> None:
        name, _, value = re.sub(r"^FN\s*0\s*:\s*", "", text, flags=_FLAGS).partition("=")
        self.modal.variables[name.strip().upper()] = self._worth(value)

    def _block(self, g: list[float], text: str) -> None:
        """One block of G-code from the axis words, feed and M codes of a statement."""
        modal, block = self.modal, Block(g=list(g))
        rest = re.sub(r"\bR[0LR]\b", self._compensation, f" {text} ", flags=_FLAGS)
        rest, fast = re.subn(r"\bFMAX\b", " ", rest, flags=_FLAGS)
        rest = re.sub(r"\bFAUTO\b", " ", rest, flags=_FLAGS)
        rest = re.sub(r"\bDR\s*[+-]", " ", rest, flags=_FLAGS)
        for m in re.finditer(r"\bM\s*(\d+)", rest, _FLAGS):
            block.m.append(float(m[1]))
        if 128.0 in block.m:  # the feed behind it is that of the compensating moves
            rest = re.sub(r"(\bM\s*128\s*)F\s*[\d.]+", r"\1", rest, flags=_FLAGS)
        rest = re.sub(r"\bM\s*\d+(\s+MB\s*\S+)?", " ", rest, flags=_FLAGS)
        for word in _AXIS.finditer(rest):
            absolute = ABSOLUTE if word[2].upper() in modal.chain.linear else ""
            how = INCREMENTAL if word[1] else absolute
            block.add(word[2].upper(), self._worth(word[3]), how=how)
        left = _AXIS.sub(" ", rest).strip()
        if left:
            modal.refuse(shown(left))
        if fast:
            block.words.pop("F", None)
            block.g = [0.0 if v == 1.0 else v for v in block.g]
        modal.take(block, modal.number)
        modal.motion = 1

    def _compensation(self, match: re.Match) -> str:
        if match[0].upper() in ("RL", "RR"):
            self.modal.refuse(f"{match[0].upper()}, the compensation of the tool's radius")
        return " "

    # -- statements ----------------------------------------------------------------------------------------------------

    def _line(self, name: str, rest: str) -> None:
        """L, and LN with the direction of the tool TX, TY, TZ (for M128)."""
        if name == "LN":
            tool = {m[1].upper(): self._worth(m[2]) for m in _TOOL.finditer(rest)}
            rest = _NORMAL.sub(" ", _TOOL.sub(" ", rest))
            if tool:
                self._vector(rest, np.array([tool.get(a, 0.0) for a in self.modal.chain.linear]))
                return
        self._block([1.0], rest)

    def _vector(self, rest: str, direction: np.ndarray) -> None:
        """A straight line with a direction of the tool at its end; the axes turn in proportion."""
        modal = self.modal
        if not modal.tcp:
            modal.refuse("a direction of the tool without M128 or FUNCTION TCPM")
        target = modal.aimed(modal.turn @ direction)
        words = " ".join(
            f"{a}{modal.sign[i] * target[i]:+.9f}" for i, a in enumerate(modal.chain.letters) if a in modal.chain.rotary
        )
        self._block([1.0], f"{rest} {words}")

    def _pole(self, name: str, rest: str) -> None:
        modal, block = self.modal, Block()
        for word in _AXIS.finditer(rest):
            if word[2].upper() not in modal.chain.linear:
                modal.refuse(f"CC {shown(rest)}")
            centre = CENTRES[modal.chain.index(word[2].upper())]
            block.add(centre, self._worth(word[3]), how=INCREMENTAL if word[1] else ABSOLUTE)
        if not rest.strip():
            modal.pole = modal.at[:3].copy()
        modal.meaning.prepare(modal, block)

    def _circle(self, name: str, rest: str) -> None:
        """C about the pole, CR by its radius."""
        direction = re.search(r"\bDR\s*([+-])", rest, _FLAGS)
        if not direction:
            self.modal.refuse(f"{name} {shown(rest)} without DR+ or DR-")
            return
        pole = self.modal.pole
        if name == "CR":
            self.modal.pole = None
        elif pole is None:
            self.modal.refuse("C without its centre CC")
        self._block([3.0 if direction[1] == "+" else 2.0], rest)
        self.modal.pole = pole

    def _polar_words(self, rest: str) -> tuple[dict[str, float], str]:
        found = {m[1].upper(): self._worth(m[2]) for m in re.finditer(rf"\b(I?P[RA])\s*({_VALUE})", rest, _FLAGS)}
        return found, re.sub(rf"\bI?P[RA]\s*{_VALUE}", " ", rest, flags=_FLAGS)

    def _at_pole(self, radius: float, angle: float) -> str:
        modal = self.modal
        (i, j), pole = {17: (0, 1), 18: (2, 0), 19: (1, 2)}[modal.plane], modal.pole
        assert pole is not None
        names, per = modal.chain.letters, 25.4 if modal.inch else 1.0
        first, second = pole[i] + radius * np.cos(angle), pole[j] + radius * np.sin(angle)
        return f"{names[i]}{first / per:+.9f} {names[j]}{second / per:+.9f}"

    def _from_pole(self) -> tuple[float, float]:
        """Distance from the pole and angle about it, mm and rad."""
        (i, j), pole = {17: (0, 1), 18: (2, 0), 19: (1, 2)}[self.modal.plane], self.modal.pole
        if pole is None:
            self.modal.refuse("polar coordinates without a pole CC")
        away = (self.modal.at[:3] - pole)[[i, j]]
        return float(np.hypot(*away)), float(np.arctan2(away[1], away[0]))

    def _polar(self, name: str, rest: str) -> None:
        words, rest = self._polar_words(rest)
        radius, angle = self._from_pole()
        per = 25.4 if self.modal.inch else 1.0
        radius = words["PR"] * per if "PR" in words else radius + words.get("IPR", 0.0) * per
        angle = np.radians(words["PA"]) if "PA" in words else angle + np.radians(words.get("IPA", 0.0))
        self._block([1.0], f"{self._at_pole(radius, angle)} {rest}")

    def _polar_circle(self, name: str, rest: str) -> None:
        """CP: an arc about the pole by its angle; with another axis a helix, of several turns where IPA says so."""
        words, rest = self._polar_words(rest)
        direction = re.search(r"\bDR\s*([+-])", rest, _FLAGS)
        radius, start = self._from_pole()
        if not direction or not set(words) & {"PA", "IPA"}:
            self.modal.refuse(f"CP {shown(rest)} without its angle or DR+ or DR-")
            return
        counter = direction[1] == "+"
        if "IPA" in words:
            sweep, end = abs(np.radians(words["IPA"])), start + np.radians(words["IPA"])
        else:
            end = np.radians(words["PA"])
            sweep = (end - start) * (1.0 if counter else -1.0) % (2 * np.pi)
        whole = int(np.ceil(sweep / (2 * np.pi) - 1e-9)) - 1
        meaning = self.modal.meaning
        meaning.more_turns = max(0, whole)  # type: ignore[attr-defined]
        try:
            self._block([3.0 if counter else 2.0], f"{self._at_pole(radius, end)} {rest}")
        finally:
            meaning.more_turns = 0  # type: ignore[attr-defined]

    def _corner(self, name: str, rest: str) -> None:
        size = re.match(rf"R?\s*({_VALUE})", rest, _FLAGS)
        if not size:
            self.modal.refuse(f"{name} {shown(rest)}")
            return
        self.modal.break_corner(
            "round" if name == "RND" else "chamfer", self.modal.millimetres(Value(self._worth(size[1])))
        )

    def _tool(self, name: str, rest: str) -> None:
        """TOOL CALL: a stop; F and S for what follows; the plane of circles by the tool's axis."""
        modal = self.modal
        modal.rest()
        modal.ignore("TOOL CALL")
        axis = re.search(r"CALL\s+\S+\s+([XYZ])\b", rest, _FLAGS)
        if axis:
            modal.plane = (19, 18, 17)[ALONG.index(axis[1].upper())]
        feed = re.search(rf"\bF\s*({_VALUE})", rest, _FLAGS)
        if feed:
            modal.feed = self._worth(feed[1])

    def _stop(self, name: str, rest: str) -> None:
        self.modal.rest()

    def _function(self, name: str, rest: str) -> None:
        """FUNCTION TCPM: as M128, with the feed of the tip and axes that turn in proportion."""
        modal = self.modal
        words = rest.upper().split()
        if words[:2] == ["RESET", "TCPM"]:
            modal.switch_tip(False)
        elif words[:1] == ["TCPM"] and not set(words) & {"CONT", "SPAT", "VECTOR"}:
            modal.switch_tip(True)
        else:
            modal.refuse(f"FUNCTION {shown(rest)}")

    def _plane(self, name: str, rest: str) -> None:
        """PLANE: a tilted plane by space angles, Euler angles or vectors.

        SPA, SPB, SPC turn about X, then Y, then Z as they are without a tilt. EULPR, EULNU, EULROT turn about Z, the
        new X, the new Z. STAY leaves the axes, TURN turns them, MOVE turns them and keeps the tip where it is. SEQ+
        and SEQ- choose the sign of the axis next to the bed; without it the shorter way is taken.
        """
        modal, upper = self.modal, rest.upper()
        kind = upper.split()[0] if upper.split() else ""
        values = {m[1]: self._worth(m[2]) for m in re.finditer(rf"\b([A-Z]{{2,6}})\s*({_VALUE})(?![A-Z])", upper)}
        if kind == "RESET":
            modal.unset_frames()
            turn = None
        elif kind == "SPATIAL":
            a, b, c = (np.radians(values.get(k, 0.0)) for k in ("SPA", "SPB", "SPC"))
            turn = rotation(2, c) @ rotation(1, b) @ rotation(0, a)
        elif kind == "EULER":
            a, b, c = (np.radians(values.get(k, 0.0)) for k in ("EULPR", "EULNU", "EULROT"))
            turn = rotation(2, a) @ rotation(0, b) @ rotation(2, c)
        elif kind == "VECTOR":
            normal, base = (np.array([values.get(f"{p}{a}", 0.0) for a in modal.chain.linear]) for p in "NB")
            if not normal.any() or not np.cross(normal, base).any():
                modal.refuse(f"PLANE {shown(rest)}")
            normal = normal / np.linalg.norm(normal)
            base = base - (base @ normal) * normal
            base = base / np.linalg.norm(base)
            turn = np.column_stack([base, np.cross(normal, base), normal])
        else:
            modal.refuse(f"PLANE {shown(rest)}")
            return
        if turn is not None:
            modal.set_tilt(turn, modal.local)
        sign = 1 if re.search(r"\bSEQ\s*\+", upper) else -1 if re.search(r"\bSEQ\s*-", upper) else 0
        if re.search(r"\b(MOVE|TURN)\b", upper):
            modal.orient(sign=sign, keep_tip="MOVE" in upper)

    def _cycle(self, name: str, rest: str) -> None:
        upper = rest.upper()
        if upper.startswith("CALL"):
            self._drill()
            self._block(
                [], re.sub(r"^CALL(\s+POS)?", " ", rest, flags=_FLAGS)
            ) if "POS" not in upper else self.modal.refuse(f"CYCL {shown(rest)}")
            return
        number = re.match(r"DEF\s+(\d+)(?:\.(\d+))?", upper)
        if not number:
            self.modal.refuse(f"CYCL {shown(rest)}")
            return
        kind, part = int(number[1]), number[2]
        body = rest[number.end() :]
        if kind in _HARMLESS_CYCLES:
            self.modal.ignore(f"CYCL DEF {kind}")
        elif kind == 200:
            self.cycle = {m[1].upper(): self._worth(m[2]) for m in _KEYED.finditer(rest)}
        elif kind in (7, 9, 10, 19) and part == "0":
            return
        elif kind == 7:
            block = Block(g=[54.0])  # as DIN/ISO has it
            for m in _AXIS.finditer(body):
                block.add(m[2].upper(), self._worth(m[3]), how=INCREMENTAL if m[1] else ABSOLUTE)
            self.modal.take(block, self.modal.number)
        elif kind == 9:
            self.modal.rest(self._worth(re.sub(r"[^\d.,+-]", "", body)))
        elif kind == 10:
            turned = re.search(rf"ROT\s*({_VALUE})", body, _FLAGS)
            if not turned:
                self.modal.refuse(f"CYCL {shown(rest)}")
            else:
                turn = rotation(2, np.radians(self._worth(turned[1])))
                self.modal.change(self.modal.base_turn @ turn, self.modal.base_origin)
        elif kind == 19:
            angles = {m[2].upper(): np.radians(self._worth(m[3])) for m in _AXIS.finditer(body)}
            a, b, c = (angles.get(k, 0.0) for k in ABOUT)
            self.modal.set_tilt(rotation(2, c) @ rotation(1, b) @ rotation(0, a), self.modal.local)
            if not angles:
                self.modal.unset_frames()
        else:
            self.modal.refuse(f"CYCL DEF {kind}")

    def _drill(self) -> None:
        """Cycle 200: pecks, each time out to the set-up clearance (TNC 620, Cycle Programming, 4.3)."""
        q, modal = self.cycle, self.modal
        if q is None or not {"Q200", "Q201", "Q206", "Q202", "Q203"} <= set(q):
            modal.refuse("CYCL CALL without a CYCL DEF 200 that is complete")
            return
        top, feed = q["Q203"], modal.feed
        modal.feed = q["Q206"]
        modal.hole(modal.at.copy(), top + q["Q200"], top + q["Q201"], 83, abs(q["Q202"]), q.get("Q211", 0.0))
        modal.feed = feed
        end = modal.at.copy()
        end[2] = top + max(q["Q200"], q.get("Q204", 0.0))
        modal.straight(end, True, False)
