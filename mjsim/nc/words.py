"""Lines of an NC program as words. Comments, line numbers and blanks are taken away; what is no word is named.

Two spellings: letter and number (Fanuc, LinuxCNC, HEIDENHAIN DIN/ISO), and the words of Sinumerik, whose addresses may
have several letters, an ``=`` and an expression. HEIDENHAIN Klartext is in :mod:`mjsim.nc.klartext`.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from dataclasses import dataclass, field

from mjsim.machine.axis import ABOUT

_FLAGS = re.ASCII | re.IGNORECASE
_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)"
#: How Sinumerik says that a number is absolute or incremental.
ABSOLUTE, INCREMENTAL = "AC", "IC"
#: Letters of the place of a circle's centre, and addresses of the components of a direction.
CENTRES, VECTOR = tuple("IJK"), tuple(f"{a}3" for a in ABOUT)
#: Largest number: more than any axis' travel, feed or code.
LARGEST = 1e9
_WORD = re.compile(rf"\s*(,?[A-Z])\s*({_NUMBER})(?=[^\d.]|$)", _FLAGS)
_COMPUTED = re.compile(r"\s*(,?[A-Z])\s*([+-]?(?:#\d+|\[[^\[\]]*\]|Q\d+))", _FLAGS)
_ASSIGNMENT = re.compile(r"#(\d+)\s*=\s*(.+)$", _FLAGS)
_PROGRAM_NUMBER = re.compile(r"^[O:]\s*(?:\d+|<[^>]*>)\s*", _FLAGS)
_LINE_NUMBER = re.compile(r"^[N:]\s*\d+\s*", _FLAGS)
_CONTROL_FLOW = re.compile(r"\b(IF|WHILE|GOTO[FBC]?|DO|END|FOR|LOOP|REPEAT|UNTIL|CASE|ELSE|ENDIF|ENDWHILE)\b", _FLAGS)


class GCodeError(ValueError):
    """What was found in a line and what is allowed; the reader adds file and line."""


@dataclass
class Value:
    """A number behind an address.

    Attributes:
        number: Its value, program units.
        how: ``IC`` and the like of Sinumerik; empty for a plain number.
        exact: Whether the number says by itself what it means: it has a decimal point, is 0, or was computed.
    """

    number: float
    how: str = ""
    exact: bool = True


@dataclass
class Block:
    """Words of one line.

    Attributes:
        g, m: G and M codes in order.
        words: Other addresses with their values.
        names: Words without a value.
        calls: Words with arguments in ( ), and these arguments as text.
        skip: Whether it begins with ``/``.
    """

    g: list[float] = field(default_factory=list)
    m: list[float] = field(default_factory=list)
    words: dict[str, Value] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    calls: list[tuple[str, list[str]]] = field(default_factory=list)
    skip: bool = False

    def add(self, address: str, value: float, exact: bool = True, how: str = "") -> None:
        """Add one word.

        Raises:
            GCodeError: no control can hold the number, or the word is there already.
        """
        if not abs(value) <= LARGEST:
            raise GCodeError(f"{address}{value:.6g}; allowed: numbers that a control can hold, up to {LARGEST:g}")
        if address == "G":
            self.g.append(value)
        elif address == "M":
            self.m.append(value)
        elif address in self.words:
            raise GCodeError(f"the word {address} twice; allowed: each word once in a block")
        else:
            self.words[address] = Value(value, how, exact or value == 0.0)


def letter_block(text: str, variables: dict[str, float], end: str = "") -> Block:
    """Words of a line of letters and numbers.

    Args:
        text: The line.
        variables: Values of ``#1`` and so on by name, which a line may set or use.
        end: A sign that ends a block and counts for nothing (``*`` of HEIDENHAIN DIN/ISO).

    Raises:
        GCodeError: something in it is not understood.
    """
    block = Block()
    rest = text.strip()
    if rest.startswith("%"):
        return block
    if "(" in rest or ")" in rest:
        rest = _without_comments(rest)
    rest = rest.partition(";")[0].replace(end or ";", " ").strip().removesuffix("%")
    rest, block.skip = _skipped(rest)
    rest = _PROGRAM_NUMBER.sub("", rest)
    rest = _LINE_NUMBER.sub("", rest, count=1)
    rest, skipped = _skipped(rest)  # some posts write the line number first
    block.skip |= skipped
    if rest.startswith("%") or (rest.startswith("<") and rest.endswith(">")):  # the name of a program
        return block
    if _CONTROL_FLOW.match(rest):
        raise GCodeError(f"{shown(rest)!r}, which the reader does not carry out; allowed: programs without branches")
    if rest.startswith("#"):
        assignment = _ASSIGNMENT.match(rest)
        if not assignment:
            raise GCodeError(f"{shown(rest)!r}; allowed: a variable and its value, as #100=5.")
        variables[f"#{int(assignment[1])}"] = evaluate(assignment[2], variables)
        return block
    at = 0
    while rest[at:].strip():
        word = _WORD.match(rest, at)
        if word:
            block.add(word[1].upper(), float(word[2]), "." in word[2])
        else:
            word = _COMPUTED.match(rest, at)
            if not word:
                raise GCodeError(
                    f"{shown(rest[at:])!r}; allowed: words of a letter and a number such as X-1.5, variables that were "
                    "given a value, no macros and calls"
                )
            block.add(word[1].upper(), evaluate(word[2], variables))
        at = word.end()
    return block


def _without_comments(text: str) -> str:
    """The line without comments in ( ), which may be in each other."""
    out, depth = [], 0
    for character in text:
        depth += character == "("
        if not depth and character != ")":
            out.append(character)
        depth -= character == ")"
        if depth < 0 or (character == ";" and not depth):
            break
    if depth:
        raise GCodeError(f"{shown(text)!r} has a bracket without its other half; allowed: comments in ( ) or after ;")
    return "".join(out)


def _skipped(text: str) -> tuple[str, bool]:
    """A line without the ``/`` or ``/2`` at its beginning, and whether it had one."""
    without = re.sub(r"^/\s*\d?\s*", "", text) if text.startswith("/") else text
    return without, without != text


# -- Sinumerik ---------------------------------------------------------------------------------------------------------

_NAME = re.compile(r"\s*(\$?[A-Z_][A-Z_0-9$]*)", _FLAGS)
_PLAIN = re.compile(rf"\s*([A-Z])\s*({_NUMBER})(?![\d.A-Z_(=]*=)", _FLAGS)
_HOW = re.compile(r"(AC|IC|DC|ACP|ACN)\((.*)\)$", _FLAGS)


def siemens_block(text: str, variables: dict[str, float]) -> Block:
    """Words of a line for Sinumerik (Programming Manual Fundamentals, 6FC5398-1BP40, chapter 2).

    Args:
        text: The line.
        variables: Values of R parameters by name, which a line may set or use.

    Raises:
        GCodeError: something in it is not understood.
    """
    block = Block()
    rest = _before_comment(text).strip()
    if rest.startswith("%"):
        return block
    rest, block.skip = _skipped(rest)
    rest = _LINE_NUMBER.sub("", rest, count=1)
    rest, skipped = _skipped(rest)
    block.skip |= skipped
    if _CONTROL_FLOW.match(rest):
        raise GCodeError(f"{shown(rest)!r}, which the reader does not carry out; allowed: programs without branches")
    at = 0
    while rest[at:].strip():
        plain = _PLAIN.match(rest, at)
        if plain and not re.match(r"\s*[A-Z]\d+\s*=", rest[at:], _FLAGS):
            block.add(plain[1].upper(), float(plain[2]), "." in plain[2])
            at = plain.end()
            continue
        name = _NAME.match(rest, at)
        if not name:
            raise GCodeError(f"{shown(rest[at:])!r}; allowed: words such as X-1.5, X=IC(2), TRAORI, RND=1")
        at = name.end()
        address = name[1].upper()
        index = ""
        if rest[at : at + 1] == "[":
            close = _closing(rest, at)
            index, at = rest[at : close + 1], close + 1
        follows = rest[at:].lstrip()
        at = len(rest) - len(follows)
        if follows.startswith("="):
            at, value = _value(rest, at + 1)
            _assign(block, address + index.upper(), value, variables)
        elif follows.startswith("("):
            close = _closing(rest, at)
            block.calls.append((address, _arguments(rest[at + 1 : close])))
            at = close + 1
        else:
            block.names.append(address)
    return block


def _assign(block: Block, address: str, text: str, variables: dict[str, float]) -> None:
    """What ``address = text`` does: a variable gets its value, or a word is added."""
    if re.fullmatch(r"R\d+", address):
        variables[address] = evaluate(text, variables)
    elif address == "T" or text.startswith('"'):
        block.words[address] = Value(0.0)
    elif "[" in address and not address.startswith("FGREF"):
        block.calls.append((address, [text]))
    else:
        how = _HOW.match(text)
        block.add(address, evaluate(how[2] if how else text, variables), how=how[1].upper() if how else "")


def _value(text: str, at: int) -> tuple[int, str]:
    """Where the value that begins at ``at`` ends, and the value: up to a blank outside brackets and strings."""
    rest = text[at:]
    at += len(rest) - len(rest.lstrip())
    depth, quoted, end = 0, False, at
    while end < len(text):
        c = text[end]
        if c == '"':
            quoted = not quoted
        elif not quoted:
            depth += (c in "([") - (c in ")]")
            if depth == 0 and c.isspace() and not re.match(r"\s*[-+*/]", text[end:]):
                break
            if depth == 0 and c.isalpha() and end > at and text[end - 1].isdigit() and not text[at].isalpha():
                break
        end += 1
    return end, text[at:end].strip()


def _closing(text: str, at: int) -> int:
    """Where the bracket that opens at ``at`` closes."""
    depth, quoted = 0, False
    for i in range(at, len(text)):
        if text[i] == '"':
            quoted = not quoted
        elif not quoted:
            depth += (text[i] in "([") - (text[i] in ")]")
            if depth == 0:
                return i
    raise GCodeError(f"{shown(text[at:])!r} has a bracket without its other half; allowed: both")


def _arguments(text: str) -> list[str]:
    """Arguments of a call; those left out are empty."""
    out, depth, quoted, begin = [], 0, False, 0
    for i, c in enumerate(text):
        if c == '"':
            quoted = not quoted
        elif not quoted:
            depth += (c in "([") - (c in ")]")
            if c == "," and depth == 0:
                out.append(text[begin:i].strip())
                begin = i + 1
    return [*out, text[begin:].strip()]


def _before_comment(text: str) -> str:
    quoted = False
    for i, c in enumerate(text):
        if c == '"':
            quoted = not quoted
        elif c == ";" and not quoted:
            return text[:i]
    return text


# -- values ------------------------------------------------------------------------------------------------------------

_OPERATORS = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
_FUNCTIONS = {
    "SIN": lambda x: math.sin(math.radians(x)),
    "COS": lambda x: math.cos(math.radians(x)),
    "TAN": lambda x: math.tan(math.radians(x)),
    "SQRT": math.sqrt,
    "ABS": abs,
}


def evaluate(text: str, variables: dict[str, float]) -> float:
    """The value of an expression of numbers, variables that have a value, + - * / and SIN COS TAN SQRT ABS (degrees).

    Raises:
        GCodeError: it is something else, or a variable has no value.
    """
    plain = re.sub(r"#(\d+)", r"_N\1", text.strip().upper().replace("[", "(").replace("]", ")"))
    plain = re.sub(r"(?<![\w.])0+(?=\d)", "", plain)  # 007 is no number of Python
    try:
        return float(_worth(ast.parse(plain, mode="eval").body, variables))
    except GCodeError:
        raise
    except (SyntaxError, ValueError, ZeroDivisionError, OverflowError, RecursionError, MemoryError):
        raise GCodeError(
            f"{shown(text)!r}; allowed: numbers, variables that were given a value, + - * / and SIN COS TAN SQRT ABS"
        ) from None


def _worth(node: ast.expr, variables: dict[str, float]) -> float:
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        return node.value
    if isinstance(node, ast.Name):
        name = node.id.replace("_N", "#") if node.id.startswith("_N") else node.id
        if name not in variables:
            raise GCodeError(f"the variable {name}, which has no value here; allowed: variables set before in the file")
        return variables[name]
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_worth(node.left, variables), _worth(node.right, variables))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        return _worth(node.operand, variables) * (-1.0 if isinstance(node.op, ast.USub) else 1.0)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS:
        (argument,) = node.args
        return _FUNCTIONS[node.func.id](_worth(argument, variables))
    raise ValueError


def shown(text: str) -> str:
    """A text short enough for a message."""
    text = text.strip()
    return text if len(text) <= 40 else text[:38] + " …"
