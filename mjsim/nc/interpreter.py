"""Programs for LinuxCNC with variables, subprograms and o-words, through LinuxCNC's own interpreter.

``rs274`` of the Debian package ``linuxcnc-uspace`` runs without a machine and prints the canonical motions of a program
(LinuxCNC, src/emc/sai). Here the program is given to it with a message before each line, which says where in the file
it is, and its motions go through the same :class:`mjsim.nc.modal.Modal` as those of any other program.

Switched kinematics and tilted planes are remapped codes. Remaps of our own stand in for those of a configuration: they
print what was commanded. After M428 and M429 they set the interpreter to the place where the axes are in the other
coordinates, as a real LinuxCNC does with the kinematics of its machine.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from mjsim.io.inputs import file_bytes
from mjsim.machine.axis import ABOUT, ALONG, BESIDE, Axis
from mjsim.machine.chain import Chain
from mjsim.machine.kinematics import rotation, tool_direction, tool_side, work_side
from mjsim.nc.modal import Modal
from mjsim.nc.words import CENTRES, GCodeError
from mjsim.units import MM

#: Longest run of the interpreter, s.
_LONGEST = 120.0
#: Where the interpreter is set to when a plane is tilted: a coordinate near it was not commanded since then, mm.
_AWAY = -100_000.0
#: Half a unit of the last decimal that the interpreter prints, mm and degrees: a shorter move is none.
_PRINTED = 5.1e-5
#: Variables, expressions, polar coordinates, o-words, offsets by program.
_BY_ITSELF = re.compile(r"[#\[@^]|^\s*(?:N\d+\s*)?o\s*[<\d].*\b(?:sub|call)\b|G\s*10(?![.\d])", re.M | re.I)
_CALL = re.compile(r"\s*\d+\s+N\S*\s+(\w+)\((.*)\)\s*$")
#: Canonical calls that change no motion.
_HARMLESS = re.compile(
    r"SET_FEED_REFERENCE|ON_RESET|COMMENT|SET_FEED_MODE|SET_NAIVECAM|SET_SPINDLE|START_SPINDLE|STOP_SPINDLE|ORIENT_|"
    r"SPINDLE|FLOOD|MIST|SELECT_TOOL|CHANGE_TOOL_NUMBER|RELOAD_TOOL|ENABLE|DISABLE|USE_TOOL|FINISH|LOG|SET_AUX|CLEAR_AUX|"
    r"SET_MOTION_OUTPUT|CLEAR_MOTION|PALLET|CLAMP|UNCLAMP|TURN_PROBE|SET_TRAVERSE|STOP_CUTTER|SET_CUTTER|STOP_SPEED|"
    r"USE_NO_SPINDLE|WAIT|SET_PLANNER|START_CHANGE"
)
_TOOLS = 200
#: Kinematics in which W is a way along the tool (LinuxCNC, src/emc/kinematics/5axiskins.c, notes 4 and 5), and those
#: that begin with tool centre point control (LinuxCNC, Switchable Kinematics: type 0).
_BRIDGE = "5axiskins"
_TIP_FIRST = (_BRIDGE, "maxkins", "xyzac-trt-kins", "xyzbc-trt-kins")
_SIDE = BESIDE[-1]
#: A comment, a name or the letter W before a number.
_SIDE_WORD = re.compile(rf"\([^()]*\)|;.*|<[^>]*>|(?<![A-Za-z_])(?P<side>{_SIDE})(?=\s*[-+\d.#\[])", re.IGNORECASE)


def needs_interpreter(text: str) -> bool:
    """Whether a program has variables, expressions, o-words or offsets that it computes itself."""
    plain = re.sub(r"\([^()]*\)|;.*", "", text)
    return bool(_BY_ITSELF.search(plain))


def carry_out(text: str, path: Path, modal: Modal, configuration: Configuration) -> None:
    """Run a program through ``rs274`` and give its motions to a control.

    Args:
        text: The program.
        path: Its file; subprograms are looked for in its folder.
        modal: The control.
        configuration: Of LinuxCNC; it says where other subprograms and the tools are.

    Raises:
        GCodeError: the interpreter is not installed, refuses the program, or does what cannot be followed.
    """
    if shutil.which("rs274") is None:
        raise GCodeError(
            "variables, subprograms or o-words; LinuxCNC's own interpreter rs274 (Debian package linuxcnc-uspace) "
            "reads them and is not installed; allowed without it: plain blocks"
        )
    _check_axes(text, modal, configuration)
    printed, error = canonical(text, path, modal.chain, configuration, modal.skip)
    reader = _Canon(modal, configuration)
    for line in printed:
        call = _CALL.match(line)
        if call:
            reader.take(call[1], call[2])
    if not modal.ended and error:
        raise GCodeError(f"LinuxCNC's interpreter refuses it: {error[:200]}; allowed: what it can run")


def canonical(
    text: str, path: Path, chain: Chain, configuration: Configuration, skip: bool = False
) -> tuple[list[str], str]:
    """What ``rs274`` prints for a program, and what it complains of.

    Args:
        text, path: The program and its file.
        chain: The machine's axes, for switched kinematics.
        configuration: Where subprograms and tools are.
        skip: Whether blocks with ``/`` are left out.

    Raises:
        GCodeError: it does not come to an end.
    """
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder)
        if configuration.moves_tool:
            text = _with_letter(text, free_letter(chain))
        (room / "program.ngc").write_text(_marked(_with_pins(text, configuration)))
        _write_remaps(room, chain)
        paths = [str(room), str(path.resolve().parent), *configuration.folders]
        (room / "settings.ini").write_text(_settings(room, paths))
        (room / "tools.tbl").write_text(_tools(configuration))
        command = ["rs274", "-g", "-i", "settings.ini", "-t", "tools.tbl", *(["-b"] if skip else []), "program.ngc"]
        try:
            done = subprocess.run(command, cwd=room, capture_output=True, timeout=_LONGEST, check=False)
        except subprocess.TimeoutExpired:
            raise GCodeError(
                f"LinuxCNC's interpreter runs longer than {_LONGEST:g} s; allowed: programs that end"
            ) from None
    error = done.stderr.decode("utf-8", "replace").replace("executing", "").strip()
    if not error and done.returncode:
        error = f"status {done.returncode}"
    return done.stdout.decode("utf-8", "replace").splitlines(), error.partition("\n")[0]


def _tools(configuration: Configuration) -> str:
    """Table of the tools. The interpreter takes its lengths for inches (src/emc/sai/saicanon.cc)."""
    if configuration.tools is None:
        return "".join(f"T{n} P{n} Z0 D0\n" for n in range(1, _TOOLS))
    data = file_bytes(configuration.tools, 1_000_000, "allowed: a tool table of LinuxCNC", "no such file")
    per = 1.0 if configuration.inch else 25.4
    return "\n".join(
        re.sub(
            rf"(?<![A-Za-z])([{ALONG}{BESIDE}D])([-+]?(?:\d+\.?\d*|\.\d+))",
            lambda word: f"{word[1]}{float(word[2]) / per:.12g}",
            line.partition(";")[0],
            flags=re.IGNORECASE,
        )
        for line in [*data.decode("utf-8", "replace").splitlines(), ""]
    )


class Configuration:
    """What an INI file of LinuxCNC says that a program needs.

    Args:
        ini: The file, or nothing.

    Attributes:
        folders: Where subprograms are.
        tools: File of the tools, or nothing.
        inch: Whether it has inches.
        pins: Values of HAL pins; nothing without a file.
        begins_at_tip: Whether tool centre point control is on before any code switches it.
        moves_tool: Whether W moves the tool along itself, by the axes that are there.
    """

    def __init__(self, ini: Path | None) -> None:
        self.folders: list[str] = []
        self.tools: Path | None = None
        self.pins: dict[str, str] | None = None
        self.inch = self.begins_at_tip = self.moves_tool = False
        if ini is None:
            return
        data = file_bytes(
            ini, 1_000_000, "allowed: an INI file of LinuxCNC", "no such file; allowed: an INI file of LinuxCNC"
        )
        signals: dict[str, str] = {}
        nets: list[tuple[str, list[str]]] = []
        self.pins = {}
        for line in data.decode("utf-8", "replace").splitlines():
            key, _, value = (part.strip() for part in line.partition("="))
            if key in ("SUBROUTINE_PATH", "PROGRAM_PREFIX"):
                self.folders += [str((ini.parent / part).resolve()) for part in value.split(":") if part]
            elif key == "TOOL_TABLE" and (ini.parent / value).is_file():
                self.tools = (ini.parent / value).resolve()
            elif key == "LINEAR_UNITS":
                self.inch = value.lower() in ("inch", "in", "imperial")
            elif key == "KINEMATICS":
                kinematics, *options = value.split() or [""]
                self.begins_at_tip = kinematics in _TIP_FIRST and "sparm=identityfirst" not in options
                self.moves_tool = kinematics == _BRIDGE
            elif key == "HALCMD":
                words = value.replace("=>", " ").replace("<=", " ").split()
                if words[:1] == ["setp"] and len(words) == 3:
                    self.pins[words[1]] = words[2]
                elif words[:1] == ["sets"] and len(words) == 3:
                    signals[words[1].lstrip(":")] = words[2]
                elif words[:1] == ["net"]:
                    nets.append((words[1].lstrip(":"), words[2:]))
        for signal, pins in nets:
            self.pins |= {pin: signals.get(signal, "0") for pin in pins}


def _with_pins(text: str, configuration: Configuration) -> str:
    """The program with the values of HAL pins that its configuration sets in place of their names."""

    def value(match: re.Match) -> str:
        if configuration.pins is None or match[1] not in configuration.pins:
            raise GCodeError(f"the HAL pin {match[1]}; allowed: pins whose value a configuration sets (--ini)")
        return f"[{configuration.pins[match[1]]}]"

    return re.sub(r"#<_hal\[([^\]]*)\]>", value, text)


def free_letter(chain: Chain) -> str:
    """A rotary letter that the machine does not have. The interpreter prints it, and it does not print W."""
    return next(a for a in ABOUT if a not in chain.letters)


def _with_letter(text: str, letter: str) -> str:
    """The program with another letter in place of W."""
    return "\n".join(
        _SIDE_WORD.sub(lambda found: letter if found["side"] else found[0], line) for line in text.splitlines()
    )


def _check_axes(text: str, modal: Modal, configuration: Configuration) -> None:
    """Refuse moves of U, V, W, which the interpreter does not print, and of a letter that stands in for W."""
    letters = BESIDE.replace(_SIDE, free_letter(modal.chain)) if configuration.moves_tool else BESIDE
    for modal.number, line in enumerate(text.splitlines(), start=1):
        plain = re.sub(r"\([^()]*\)|;.*|<[^>]*>", "", line)
        for found in re.finditer(rf"(?<![A-Za-z_])([{letters}])\s*([-+\d.#\[]+)", plain, re.IGNORECASE):
            if found[2].strip("0.+-"):
                raise GCodeError(f"a move of {found[1].upper()}; allowed: {', '.join(modal.chain.letters)}")


def _marked(text: str) -> str:
    """The program with a message before each line that says its number."""
    out = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("%"):
            out.append(f"(msg,@line {number})")
        out.append(line)
    return "\n".join([*out, ""])


def _settings(room: Path, paths: list[str]) -> str:
    codes = "".join(f"REMAP = M{n} modalgroup=10 ngc=mjsim_m{n}\n" for n in (428, 429))
    planes = "".join(f"REMAP = G{g} modalgroup=1 argspec=pqxyzijkr ngc=mjsim_g{n}\n" for g, n in _PLANES.items())
    places = f"SUBROUTINE_PATH = {':'.join(paths)}\nPARAMETER_FILE = {room}/none.var\n"
    return f"[RS274NGC]\n{places}{codes}{planes}[EMC]\nVERSION = 1.1\n"


#: Codes of tilted planes as the remapped subprograms are called.
_PLANES = {"68.2": "682", "68.4": "684", "53.1": "531", "53.3": "533", "53.6": "536", "69": "69"}


def _write_remaps(room: Path, chain: Chain) -> None:
    """Subprograms that stand in for a configuration's own."""
    for number, on in ((428, True), (429, False)):
        body = ["(msg,@sync)", *_synchronised(chain, on), f"(msg,@tip {int(on)})"]
        (room / f"mjsim_m{number}.ngc").write_text(_remap(f"mjsim_m{number}", body))
    away = "".join(f" {a}{_AWAY:g}" for a in ALONG)
    words = " ".join(f"{w}=#<{w}>" for w in "pqxyzijkr")
    for code, name in _PLANES.items():
        body = [f"(debug,@G{code} {words})", "(msg,@sync)", f"g53 g0{away}", "(msg,@away)"]
        (room / f"mjsim_g{name}.ngc").write_text(_remap(f"mjsim_g{name}", body))


def _remap(name: str, body: list[str]) -> str:
    """A subprogram that leaves the modal codes as they were."""
    lines = [f"o<{name}> sub", "#<_mjsim_mode> = #<_motion_mode>", "m70", "g21 g90", *body, "m72"]
    for mode, code in ((0, "g0"), (10, "g1")):
        lines += [f"o{9000 + mode} if [#<_mjsim_mode> EQ {mode}]", code, f"o{9000 + mode} endif"]
    return "\n".join([*lines, f"o<{name}> endsub", "m2", ""])


def _synchronised(chain: Chain, on: bool) -> list[str]:
    """Lines that set the interpreter to where the axes are: tip in the work frame (``on``), or axis positions."""
    lines = [f"#<_mjsim_{a}> = #<_abs_{b}>" for a, b in zip("uvw", ALONG.lower(), strict=True)]

    def turned(prefix: str, axis: Axis, sign: float) -> list[str]:
        names = [f"#<_mjsim_{prefix}{k}>" for k in "uvw"]
        angle = f"[{sign:g}*#<_abs_{axis.letter.lower()}>]"
        out = [f"{n} = [{n} - [{c / MM:.9f}]]" for n, c in zip(names, axis.point, strict=True)]
        out += [f"#<_mjsim_s> = sin{angle}", f"#<_mjsim_c> = cos{angle}"]
        (a, b, c), (x, y, z) = axis.unit, names
        out.append(f"#<_mjsim_d> = [[[{a:.12f}]*{x} + [{b:.12f}]*{y} + [{c:.12f}]*{z}] * [1 - #<_mjsim_c>]]")
        cross = (
            f"[{b:.12f}]*{z} - [{c:.12f}]*{y}",
            f"[{c:.12f}]*{x} - [{a:.12f}]*{z}",
            f"[{a:.12f}]*{y} - [{b:.12f}]*{x}",
        )
        for k, (n, u) in enumerate(zip(names, (a, b, c), strict=True)):
            out.append(f"#<_mjsim_n{k}> = [#<_mjsim_c>*{n} + #<_mjsim_s>*[{cross[k]}] + [{u:.12f}]*#<_mjsim_d>]")
        out += [
            f"{n} = [#<_mjsim_n{k}> + [{p / MM:.9f}]]" for k, (n, p) in enumerate(zip(names, axis.point, strict=True))
        ]
        return out

    lines += [f"#<_mjsim_t{k}> = 0" for k in "uvw"]
    for axis in tool_side(chain):
        lines += turned("t", axis, 1.0)
    head = [f"#<_mjsim_{k}> = [#<_mjsim_{k}> {'+' if on else '-'} #<_mjsim_t{k}>]" for k in "uvw"]
    table = work_side(chain)
    moves = [turned("", a, -1.0 if on else 1.0) for a in (reversed(table) if on else table)]
    order = [head, *moves] if on else [*moves, head]
    lines += [line for part in order for line in part]
    return [*lines, "g53 g0 " + " ".join(f"{a}[#<_mjsim_{k}>]" for a, k in zip(ALONG, "uvw", strict=True))]


class _Canon:
    """Canonical calls as moves of a control.

    Args:
        modal: The control.
        configuration: Of LinuxCNC.
    """

    def __init__(self, modal: Modal, configuration: Configuration) -> None:
        self.modal, self.tools = modal, configuration.tools is not None
        self.side = free_letter(modal.chain) if configuration.moves_tool else ""  # the letter that stands for W
        self.drawn = 0.0  # W: how far the tool is drawn back along itself, mm
        self.feed_mode, self.kinds = 94, set()
        self.letters: tuple[str, ...] = tuple(f"{a}" for a in ALONG + ABOUT)
        self.offset, self.preset, self.angle = np.zeros(6), np.zeros(6), 0.0
        self.silent = False
        self.away = False
        self.rotary = np.zeros(modal.chain.count)  # as the interpreter has them: a tilted plane turns them without it
        modal.mode = 94
        modal.at = np.zeros(modal.chain.count)
        for a in modal.chain.letters:
            modal.named.setdefault(a, 1)
        modal.number = 1

    def take(self, name: str, text: str) -> None:
        """Carry out one call."""
        modal = self.modal
        if name == "MESSAGE":
            self._message(text.strip('"'))
        elif name == "USE_LENGTH_UNITS":
            modal.inch = modal.feed_inch = "INCHES" in text
        elif self.silent and name == "STRAIGHT_TRAVERSE":
            pass
        elif name in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED"):
            end = self._drawn_back(self._end(_floats(text)), _floats(text), name == "STRAIGHT_FEED")
            if np.abs(end - modal.at).max() > _PRINTED:
                modal.straight(end, name == "STRAIGHT_TRAVERSE", True)
                self._count(name == "STRAIGHT_FEED")
        elif name == "ARC_FEED":
            self._arc(_floats(text))
        elif name == "SET_FEED_RATE":
            rate = _floats(text)[0]
            modal.feed = rate if rate > 0.0 else modal.feed
        elif name == "COMMENT" and "feed mode set to" in text:
            self.feed_mode = 93 if "inverse" in text else 94
        elif name == "SELECT_PLANE":
            normal = (set(ALONG) - set(text.rpartition("_")[2])).pop()
            modal.plane = (19, 18, 17)[ALONG.index(normal)]
        elif name in ("SET_G5X_OFFSET", "SET_G92_OFFSET", "SET_XY_ROTATION"):
            self._offset(name, _floats(text))
        elif name == "SET_MOTION_CONTROL_MODE":
            modal.exact = "EXACT" in text
        elif name == "DWELL":
            modal.rest(_floats(text)[0])
        elif name in ("PROGRAM_STOP", "OPTIONAL_PROGRAM_STOP", "CHANGE_TOOL"):
            modal.rest()
        elif name == "PROGRAM_END":
            modal.ended = True
        elif name == "START_CUTTER_RADIUS_COMPENSATION" and self.tools:
            modal.warn(
                "radius", f"line {modal.number}: the radius of the tool is that of the configuration's tool table"
            )
        elif not _HARMLESS.match(name):
            raise GCodeError(f"{name} of LinuxCNC's interpreter; allowed: straight moves, arcs, dwells, cycles")

    def _count(self, cutting: bool) -> None:
        """Feed modes of the program: the interpreter gives F of G93 as a feed along the path."""
        if cutting:
            self.kinds.add(self.feed_mode)
        self.modal.kinds = self.kinds

    def _message(self, text: str) -> None:
        modal = self.modal
        if text.startswith("@line "):
            modal.number = int(text[6:])
        elif text == "@sync":
            self.silent = True
        elif text.startswith("@tip "):
            self.silent = False
            modal.switch_tip(text.endswith("1"))
        elif text == "@away":
            self.silent, self.away = False, True
        elif text.startswith("@G"):
            self._plane(text)

    def _plane(self, text: str) -> None:
        """A tilted plane, or the rotary axes turned to it."""
        modal = self.modal
        code, *given = text[2:].split()
        words = {k.upper(): float(v) for k, _, v in (w.partition("=") for w in given) if "#" not in v}
        if code == "69":
            modal.unset_frames()
            self._offset("", [])
        elif code in ("53.1", "53.3", "53.6"):
            if not modal.follows:
                modal.refuse(f"G{code} without a tilted plane")
            goal = np.array([words.get(a, np.nan) for a in ALONG]) if code == "53.3" else None
            modal.orient(keep_tip=code == "53.6", goal=goal)
        else:
            origin = np.array([words.get(a, 0.0) for a in ALONG])
            angles = np.radians([words.get(a, 0.0) for a in CENTRES])
            order = f"{int(words.get('Q', 313)):d}"
            if words.get("P", 0.0) or len(order) != 3 or set(order) - set("123"):
                modal.refuse(f"G{code} P{words.get('P', 0):g} Q{order}")
            turns = [rotation(int(c) - 1, v) for c, v in zip(order, angles, strict=True)]
            turn = turns[0] @ turns[1] @ turns[2]
            first, zero = (modal.base_turn, modal.base_origin) if code == "68.4" else (np.eye(3), self._zero())
            modal.set_tilt(first @ turn, zero + first @ origin)

    def _zero(self) -> np.ndarray:
        c, s = np.cos(np.radians(self.angle)), np.sin(np.radians(self.angle))
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return self.offset[:3] + turn @ self.preset[:3]

    def _offset(self, name: str, values: list[float]) -> None:
        """Offsets of the zero point; the interpreter's motions count from there."""
        per = 25.4 if self.modal.inch else 1.0
        scaled = np.array([v * (per if i < 3 else 1.0) for i, v in enumerate(values[-6:])])
        if name == "SET_G5X_OFFSET":
            self.offset = scaled
        elif name == "SET_G92_OFFSET":
            self.preset = scaled
        elif name == "SET_XY_ROTATION":
            self.angle = values[0]
        modal = self.modal
        if modal.follows:
            return
        turn = rotation(2, np.radians(self.angle)) if self.angle else np.eye(3)
        modal.base_turn, modal.base_origin = turn, self._zero()
        if not np.array_equal(turn, modal.turn) or not np.array_equal(modal.base_origin, modal.origin):
            modal.change(turn, modal.base_origin)
            modal.warn(
                "zero",
                f"line {modal.number}: the program moves its zero point; places count from where it is at the start",
            )

    def _end(self, values: list[float]) -> np.ndarray:
        """The end of a move, program coordinates (axes,)."""
        modal, per = self.modal, 25.4 if self.modal.inch else 1.0
        end = modal.at.copy()
        given: dict[str, float] = dict(zip(self.letters, values, strict=True))
        for i, a in enumerate(modal.chain.letters):
            if a in modal.chain.rotary:
                end[i] = modal.sign[i] * (given[a] + (self.offset + self.preset)[self.letters.index(a)])
                stale, self.rotary[i] = self.away and end[i] == self.rotary[i], end[i]
                if stale:
                    end[i] = modal.at[i]
            else:
                end[i] = given[a] * per
                if self.away and self._kept(end[i]):
                    end[i] = modal.at[i]
        for a in self.letters:
            if a not in modal.chain.letters and a != self.side and abs(given[a]) > 1e-9:
                raise GCodeError(f"a move of {a}; allowed: {', '.join(modal.chain.letters)}")
        return end

    def _drawn_back(self, end: np.ndarray, values: list[float], cutting: bool) -> np.ndarray:
        """The end of a move with the way W of the tool along itself, which X, Y and Z carry out."""
        modal, chain = self.modal, self.modal.chain
        if not self.side:
            return end
        column = self.letters.index(self.side)
        drawn = values[column] + (self.offset + self.preset)[column]
        if not (drawn or self.drawn):
            return end
        if modal.inch or not modal.tcp or self.away:
            modal.refuse(f"{_SIDE} in inches, without tool centre point control or in a tilted plane")
        linear, step = chain.linear_columns, end - modal.at
        step[linear] += self.drawn * self._along(modal.at)
        if np.abs(step[chain.rotary_columns]).max() > _PRINTED or (
            cutting and drawn != self.drawn and np.abs(step[linear]).max() > _PRINTED
        ):
            modal.refuse(f"{_SIDE} and another axis in one block")
        self.drawn = drawn
        end = end.copy()
        end[linear] += drawn * self._along(end)
        return end

    def _along(self, place: np.ndarray) -> np.ndarray:
        """Direction from the tip to the spindle, in the coordinates of the program, (3,)."""
        return self.modal.turn.T @ tool_direction(self.modal.chain, np.radians(place)[None])[0]

    def _kept(self, value: float) -> bool:
        return value < 0.5 * _AWAY

    def _arc(self, values: list[float]) -> None:
        modal, per = self.modal, 25.4 if self.modal.inch else 1.0
        first, second, one, two, turns, along, *rotary = values
        if self.away and min(first, second, one, two) * per < 0.5 * _AWAY:
            raise GCodeError("an arc behind a tilted plane before its start is said; allowed: a straight move first")
        i, j, k = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}[modal.plane]
        place = [0.0, 0.0, 0.0]
        place[i], place[j], place[k] = first, second, along
        end = self._end([*place, *rotary])
        modal.arc(end, np.array([one, two]) * per, turns > 0, int(abs(turns)) - 1)
        self._count(True)


def _floats(text: str) -> list[float]:
    return [float(v) for v in text.split(",")]
