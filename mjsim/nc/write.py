"""Writing a test as the five-axis NC program that a shop would run."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.io.files import write_whole
from mjsim.machine.chain import SENSES, Chain
from mjsim.machine.kinematics import spindle_in_work
from mjsim.nc.dialects import FEEDS, Dialect, dialect
from mjsim.nc.limits import Limits, check_travel, model_limits, scale, speed_warnings
from mjsim.units import DEG, MM

#: Signs of :meth:`mjsim.instruments.ball_bar.kinds.base.Kind.words` that controls do not know.
_PLAIN = {ord("°"): " deg", ord("θ"): "half apex", ord("β"): "inclination"}
#: Angle from block to block, degrees (the paper's programs have "minute line segments"; assumed).
STEP_DEG = 0.1
#: Most blocks of one program; five digits number them.
MOST_BLOCKS = 99_998
#: How far a block has to last above whole cycles of a control that rounds down: LinuxCNC turns exactly 10 ms into 9.96.
_ABOVE = 2e-4


@dataclass(frozen=True)
class Options:
    """How a program is written.

    Attributes:
        dialect: ``fanuc``, ``siemens`` or ``linuxcnc``. feed: ``a11``, ``inverse`` or ``tcp``; empty: the dialect's
            usual one.
        step_deg: angle φ from block to block, degrees. decimals, feed_decimals: of positions and of F; ``None``: the
            dialect's.
        reversed: rotary axes that this program counts in the other sense than the machine file says.
        rollover: the table axis written within 0 to 360°, short way round.
        number: program number (fanuc).
        whole_cycles: whether the step is made so much shorter that a control that rounds block times down to its
            cycles (LinuxCNC) keeps the feed.
    """

    dialect: str = "fanuc"
    feed: str = ""
    step_deg: float = STEP_DEG
    decimals: int | None = None
    feed_decimals: int | None = None
    reversed: tuple[str, ...] = ()
    rollover: bool = False
    number: int = 1
    whole_cycles: bool = True


@dataclass(frozen=True)
class Written:
    """An NC program as text.

    Attributes:
        text: the file. motion: what its printed numbers command, block times as meant (not yet rounded by F).
        feed: F convention. warnings: sentences on axis speeds.
    """

    text: str
    motion: Commanded
    feed: str
    warnings: list[str]


def nc_program(
    test: BallBarTest, options: Options | None = None, limits: Limits | None = None, machine: str = ""
) -> Written:
    """The NC program of a test. The same test and options give the same text.

    Args:
        test: what to run. options: how to write it. limits: of the axes; ``None``: the machine model's joint ranges.
        machine: name of the machine, for the comments.

    Raises:
        InputError: a limit is passed, or the options do not fit each other or the test.
    """
    o = options or Options()
    d = dialect(o.dialect)
    feed = _feed(o, d, test)
    decimals = d.decimals if o.decimals is None else o.decimals
    phi, motion, printed = _blocks(test, o, d, feed, decimals)

    def place(i: int) -> str:
        return f'test "{test.name}", block N{max(i, 1)} (φ = {phi[i] / DEG:.2f}°)'

    limits = limits or model_limits(test.chain)
    check_travel(motion, limits, place)
    words = _feed_words(printed, motion.seconds, o, d, feed, test)
    rows = _positions(printed, test.chain, o, d, decimals)
    head = _comment_lines(test, o, d, feed, decimals, phi, motion, machine)
    body = [
        f"N{i} G1 {rows[i]}{words[i - 1]}" if i == 1 else f"N{i} {rows[i]}{words[i - 1]}" for i in range(1, len(rows))
    ]
    text = "\n".join([*head, *_start(rows[0], test.chain, d, feed), *body, *_end(d, feed), ""])
    return Written(text, motion, feed, speed_warnings(motion, limits, place))


def write_nc(
    test: BallBarTest,
    path: Path | str,
    options: Options | None = None,
    limits: Limits | None = None,
    machine: str = "",
    force: bool = False,
) -> Written:
    """Write the NC program of a test into a file, whole or not at all.

    Args:
        path: the file. force: replace one that is there. The others as for :func:`nc_program`.

    Raises:
        InputError: as :func:`nc_program`; or the file is there already or cannot be written.
    """
    written = nc_program(test, options, limits, machine)
    write_whole(Path(path), written.text, force)
    return written


def zipped_programs(
    tests: Iterable[BallBarTest], options: Options, limits: Limits | None = None, machine: str = ""
) -> bytes:
    """The programs of some tests as a ZIP file, numbered one after the other; of one recording one.

    Args:
        tests: what to run. The others as for :func:`nc_program`.

    Raises:
        InputError: as :func:`nc_program`.
    """
    out = io.BytesIO()
    by_name: dict[str, BallBarTest] = {}
    for test in tests:
        by_name.setdefault(test.recording, test)
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, (name, test) in enumerate(by_name.items(), start=options.number):
            written = nc_program(test, replace(options, number=number), limits, machine)
            archive.writestr(f"{name}{dialect(options.dialect).ending}", written.text)
    return out.getvalue()


def _feed(o: Options, d: Dialect, test: BallBarTest) -> str:
    feed = o.feed or d.feeds[0]
    if feed not in FEEDS:
        raise InputError(f"unknown F convention {feed!r}; allowed: {', '.join(FEEDS)}")
    if feed not in d.feeds:
        why = " (its G94 counts the linear axes only)" if feed == "a11" else ""
        raise InputError(
            f"F convention {feed!r} does not exist in the dialect {d.name}{why}; allowed: {', '.join(d.feeds)}"
        )
    if feed == "tcp" and not kind_of(test).moves_on_table:
        raise InputError(
            f'test "{test.name}": the spindle ball rests relative to the table, so that F has no meaning with tool '
            f"centre "
            "point control; allowed: a11, inverse"
        )
    if o.rollover and d.name == "linuxcnc":
        raise InputError(
            f"{' and '.join(test.chain.round_axes)} within 0 to 360° is not written for linuxcnc, whose wrapped axes "
            "take the sign for the direction; leave it out"
        )
    if not 1e-3 <= o.step_deg <= 10.0:
        raise InputError(f"angle step {o.step_deg:g}°; allowed: 0.001 to 10")
    if not 1 <= o.number <= 9999:
        raise InputError(f"program number {o.number}; allowed: 1 to 9999")
    for name, value, low in (("decimals", o.decimals, 1), ("decimals of F", o.feed_decimals, 0)):
        if value is not None and not low <= value <= 9:
            raise InputError(f"{value} {name}; allowed: {low} to 9")
    return feed


def _blocks(
    test: BallBarTest, o: Options, d: Dialect, feed: str, decimals: int
) -> tuple[np.ndarray, Commanded, np.ndarray]:
    """φ of the points, the motion of the printed numbers, and these numbers (n + 1, axes) in mm and degrees."""
    program = Program(test)
    first, last = program.ends
    count = max(1, int(np.ceil(abs(last - first) / (o.step_deg * DEG) - 1e-9)))
    length = abs(last - first) * kind_of(test).radius(test)
    if o.whole_cycles:
        count = _in_whole_cycles(count, length / test.feed, d.cycle, program.path(np.linspace(first, last, 5)), test)
    if count > MOST_BLOCKS:
        raise InputError(
            f'test "{test.name}": {count} blocks of {o.step_deg:g}°; allowed: up to {MOST_BLOCKS}, by a larger step'
        )
    phi = np.linspace(first, last, count + 1)
    q = program.path(phi)
    if feed == "tcp":
        q[:, test.chain.linear_columns] = spindle_in_work(test.chain, q)
    units = np.array([scale(a) for a in test.chain.letters])
    printed = np.round(q / units, decimals)
    if (np.diff(printed, axis=0) == 0).all(axis=1).any():
        raise InputError(
            f'test "{test.name}": with {decimals} decimals, a block of {o.step_deg:g}° moves no axis; allowed: a '
            "larger step"
        )
    seconds = np.full(count, length / count / test.feed)
    return phi, Commanded(seconds, printed * units, feed == "tcp", test.chain), printed


def _in_whole_cycles(count: int, seconds: float, cycle: float, q: np.ndarray, test: BallBarTest) -> int:
    """At least so many blocks that each lasts just above whole cycles, so that a control which rounds down does not
    shorten them; the same count where the control does not, or where no rotary axis moves.
    """
    if cycle == 0.0 or not np.ptp(q[:, test.chain.rotary_columns], axis=0).any():
        return count
    whole = max(1, int(seconds / count / cycle))
    return max(1, int(seconds / (whole * cycle * (1.0 + _ABOVE))))


def _feed_words(
    printed: np.ndarray, seconds: np.ndarray, o: Options, d: Dialect, feed: str, test: BallBarTest
) -> list[str]:
    digits = d.feed_decimals if o.feed_decimals is None else o.feed_decimals
    if feed == "tcp":  # modal: one F for the whole path
        return [f" F{test.feed / MM * 60:.{digits}f}", *[""] * (len(seconds) - 1)]
    if feed == "inverse":
        values = 60.0 / seconds
        if values.max() > d.largest_inverse:
            step = np.ceil(1e3 * o.step_deg * values.max() / d.largest_inverse) / 1e3
            raise InputError(
                f'test "{test.name}": blocks of {seconds.min() * 1e3:.3g} ms need F{values.max():.0f} with G93; '
                f"allowed for {d.name}: "
                f"up to {d.largest_inverse:.7g} 1/min, by a step of at least {step:g}°"
            )
    else:  # A.11 on the printed positions, so that rounding them does not change the time of a block
        values = np.linalg.norm(np.diff(printed, axis=0), axis=1) / (seconds / 60.0)
    if (np.round(values, digits) <= 0).any():
        raise InputError(
            f'test "{test.name}": with {digits} decimals, F{values.min():.3g} becomes F0; allowed: more decimals of F'
        )
    return [f" F{v:.{digits}f}" for v in values]


def _positions(printed: np.ndarray, chain: Chain, o: Options, d: Dialect, decimals: int) -> list[str]:
    values = printed.copy()
    strange = sorted(set(o.reversed) - set(chain.rotary))
    if strange:
        raise InputError(
            f"reversed axis {strange[0]!r}; allowed: {', '.join(chain.rotary) or 'none, as no axis turns'}"
        )
    for axis in o.reversed:
        values[:, chain.index(axis)] *= -1.0
    number = f"{{:.{decimals}f}}"
    words = [a + number for a in chain.letters]
    for axis in chain.round_axes if o.rollover else ():
        i = chain.index(axis)
        values[:, i] = np.round(values[:, i] % 360.0, decimals) % 360.0
        if d.name == "siemens":
            words[i] = f"{axis}=DC({number})"
    form = " ".join(words)
    return [form.format(*(row + 0.0)) for row in np.where(values == 0.0, 0.0, values)]  # no minus before a zero


def _comment_lines(
    test, o: Options, d: Dialect, feed: str, decimals: int, phi, motion: Commanded, machine: str
) -> list[str]:
    x, y, z = (f"{v / MM:g}" for v in test.table_ball)
    words = kind_of(test).words(test)
    if test.component:  # one program for all coordinates
        words = words.rpartition(", ")[0]
    kind = words.translate(_PLAIN).encode("ascii", "replace").decode()
    senses = ", ".join(f"{a} {_sense(test.chain, a, o)}" for a in test.chain.rotary)
    axes, table = test.chain.letters, " and ".join(test.chain.round_axes)
    said = {
        "a11": f"path of {' '.join(axes)}, mm and deg alike, per min",
        "inverse": "1/min of each block",
        "tcp": f"tool tip on workpiece, {test.feed / MM * 60:g} mm/min",
    }[feed]
    where = "tool tip in table coordinates" if feed == "tcp" else "axis positions"
    ball, bar = ("sphere", "") if test.component else ("table ball", f"bar {test.length / MM:g} mm, ")
    centre = "centre of the sphere" if test.component else "spindle ball centre"
    lines = [
        f"mjsim {'R-test' if test.component else 'ball-bar test'} {test.recording}",
        *([f"machine {machine}"] if machine else []),
        kind,
        *([f"hold the spindle at {test.spindle / DEG:g} deg"] if test.spindle else []),
        f"{ball} X{x} Y{y} Z{z} mm, {bar}feed {test.feed / MM * 60:g} mm/min",
        f"phi {phi[0] / DEG:g} to {phi[-1] / DEG:g} deg, {len(phi) - 1} blocks, step "
        f"{abs(phi[1] - phi[0]) / DEG:.6g} deg, "
        f"{decimals} decimals, {motion.duration:.3f} s",
        f"{_zero_point(test.chain)}. {' '.join(test.chain.linear)}: {centre}, {where}",
        f"F: {said}. {table} {'0 to 360' if o.rollover else 'unwrapped'}",
        *([f"sense of the rotary axes, iso is that of ISO 841: {senses}"] if senses else []),
        "not tried on a real control: run it clear of everything first",
    ]
    begin, end = d.comment
    plain = [t.encode("ascii", "replace").decode().replace("(", "[").replace(")", "]") for t in lines]
    out = [f"{begin}{t.upper() if d.upper else t}{end}" for t in plain]
    return ["%", f"O{o.number:04d}", *out] if d.name == "fanuc" else out


def _sense(chain: Chain, letter: str, o: Options) -> str:
    """In which sense the words of an axis count."""
    own = chain.sense(letter)
    return SENSES[own == SENSES[0]] if letter in o.reversed else own


def _zero_point(chain: Chain) -> str:
    """Where all axes are 0, for a comment."""
    if not chain.swivelling and len(chain.rotary) == 2:
        return f"zero point: where the {' and '.join(chain.rotary)} centrelines meet"
    table = f", on the {chain.turning[0].letter} centreline" if chain.turning else ""
    pivot = f", the pivot of the head {chain.tool_length / MM:g} mm above it" if chain.swivelling else ""
    return f"zero point: spindle ball with all axes at 0{table}{pivot}"


def _start(first: str, chain: Chain, d: Dialect, feed: str) -> list[str]:
    """Modal words, start point, a stop to put the ball bar in."""
    mode = "G93" if feed == "inverse" else "G94"
    if d.name == "siemens":
        lines = [f"G90 G17 G{d.units[0]} G40 G54", *d.path, mode]
        if feed == "a11":
            radii = " ".join(f"FGREF[{a}]={180 / np.pi:.9f}" for a in chain.rotary)
            lines += [f"FGROUP({','.join(chain.letters)})", radii]
    else:
        lines = [f"G90 G17 G{d.units[0]} G40 G49 G80 G54", *d.path, mode]
    tip = [f"G0 {' '.join(a + '0.' for a in chain.rotary)}", d.tip_on] if feed == "tcp" else []
    return [*lines, "M5", *tip, f"G0 {first}", "M0"]


def _end(d: Dialect, feed: str) -> list[str]:
    after = ["M0", *([d.tip_off] if feed == "tcp" else []), *(["G94"] if feed == "inverse" else []), "M30"]
    return [*after, "%"] if d.name == "fanuc" else after
