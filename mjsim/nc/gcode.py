"""One line of an NC program as words: comments, line numbers and control-specific spellings taken away; what is not
understood is named.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from mjsim.machine.chain import FIVE_AXIS, Chain

_FLAGS = re.ASCII | re.IGNORECASE
_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)"
#: Largest number: more than any axis' travel, feed or code.
_LARGEST = 1e9
_WORD = re.compile(rf"\s*([A-Z])\s*=?\s*({_NUMBER})(?=[^\d.]|$)", _FLAGS)
_SHORTEST = re.compile(rf"\b([A-Z])\s*=\s*DC\s*\(\s*({_NUMBER})\s*\)", _FLAGS)
_FGROUP = re.compile(r"\bFGROUP\s*\(([^)]*)\)", _FLAGS)
_FGREF = re.compile(rf"\bFGREF\s*\[\s*([A-Z])\s*\]\s*=\s*({_NUMBER})", _FLAGS)
_KEYWORD = re.compile(r"\b(TRAORI|TRAFOOF)\b\s*(?:\(\s*\d?\s*\))?", _FLAGS)
_PROGRAM_NUMBER = re.compile(r"^[O:]\s*(?:\d+|<[^>]*>)\s*", _FLAGS)
_LINE_NUMBER = re.compile(r"^N\s*\d+\s*", _FLAGS)


class GCodeError(ValueError):
    """What was found in a line and what is allowed; the reader adds file and line."""


@dataclass
class Line:
    """Words of one line.

    Attributes:
        g, m: G and M codes in order. words: other addresses with their values, program units.
        points: addresses whose value has a decimal point. shortest: rotary axes that go the short way (Siemens ``DC``).
        tip: tool centre point control switched on or off by a keyword. group, radius: of FGROUP and FGREF.
    """

    g: list[float] = field(default_factory=list)
    m: list[float] = field(default_factory=list)
    words: dict[str, float] = field(default_factory=dict)
    points: set[str] = field(default_factory=set)
    shortest: set[str] = field(default_factory=set)
    tip: bool | None = None
    group: tuple[str, ...] | None = None
    radius: dict[str, float] = field(default_factory=dict)


def parse_line(text: str, siemens: bool = False, chain: Chain = FIVE_AXIS) -> Line:
    """Words of one line of G-code.

    Args:
        text: the line. siemens: whether ``( )`` belongs to FGROUP, DC and TRAORI; otherwise it encloses a comment.
        chain: the machine's axes.

    Raises:
        GCodeError: something in it is not understood.
    """
    line = Line()
    rest = text.strip()
    if rest.startswith("%"):
        return line
    if not siemens:
        rest = re.sub(r"\([^()]*\)", " ", rest)
    rest = rest.partition(";")[0]
    if siemens:
        rest = _take(_FGROUP, rest, lambda m: setattr(line, "group", _axes(m[1], chain)))
        rest = _take(_FGREF, rest, lambda m: _radius(line, m[1].upper(), float(m[2]), chain))
        rest = _take(_KEYWORD, rest, lambda m: setattr(line, "tip", m[1].upper() == "TRAORI"))
        rest = _take(_SHORTEST, rest, lambda m: _shortest(line, m[1].upper(), m[2], chain))
    if "(" in rest or ")" in rest:
        raise GCodeError(
            f"{_shown(rest)!r} has a bracket without its other half, or a call; allowed: comments in ( ) or after ;"
        )
    rest = rest.strip()
    if rest.startswith("/"):
        raise GCodeError("a block skip '/', which depends on a switch of the control; allowed: blocks that always run")
    rest = _LINE_NUMBER.sub("", _PROGRAM_NUMBER.sub("", rest), count=1)
    at = 0
    while rest[at:].strip():
        word = _WORD.match(rest, at)
        if not word:
            raise GCodeError(
                f"{_shown(rest[at:])!r}; allowed: words of a letter and a number such as X-1.5 (no variables, "
                f"macros, calls)"
            )
        _add(line, word[1], word[2])
        at = word.end()
    return line


def _take(pattern: re.Pattern, text: str, use) -> str:
    for match in pattern.finditer(text):
        use(match)
    return pattern.sub(" ", text)


def _axes(text: str, chain: Chain) -> tuple[str, ...]:
    names = tuple(a.strip().upper() for a in text.split(",") if a.strip())
    if not set(names) <= set(chain.letters):
        raise GCodeError(f"FGROUP({text}); allowed: axes of {', '.join(chain.letters)}")
    return names


def _radius(line: Line, axis: str, value: float, chain: Chain) -> None:
    if axis not in chain.rotary or value <= 0:
        raise GCodeError(f"FGREF[{axis}]={value:g}; allowed: a radius above 0 of {' or '.join(chain.rotary)}")
    line.radius[axis] = value


def _shortest(line: Line, axis: str, number: str, chain: Chain) -> None:
    if axis not in chain.rotary:
        raise GCodeError(f"{axis}=DC({number}); allowed: DC of {' or '.join(chain.rotary)}")
    _add(line, axis, number)
    line.shortest.add(axis)


def _add(line: Line, letter: str, number: str) -> None:
    letter, value = letter.upper(), float(number)
    if not abs(value) <= _LARGEST:
        raise GCodeError(f"{letter}{number[:20]}; allowed: numbers that a control can hold, up to {_LARGEST:g}")
    if letter == "G":
        line.g.append(value)
    elif letter == "M":
        line.m.append(value)
    else:
        if letter in line.words:
            raise GCodeError(f"the word {letter} twice; allowed: each word once in a block")
        line.words[letter] = value
        if "." in number or value == 0.0:
            line.points.add(letter)


def _shown(text: str) -> str:
    text = text.strip()
    return text if len(text) <= 40 else text[:38] + " …"
