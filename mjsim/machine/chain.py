"""A machine's kinematic chain: its axes and their order, and the names of its geometric errors.

Error names follow ISO 230-1: ``EYX`` is the straightness error of X in the direction of Y, ``EC0A`` the rotation of the
A axis' centreline about Z, ``EXC`` the radial error motion of C along X.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from mjsim.errors import InputError
from mjsim.machine.axis import (
    ABOUT,
    ALONG,
    COORDINATES,
    SENSES,
    Axis,
    Placement,
    Vector,
    axis_of,
    is_linear,
    is_rotary,
)
from mjsim.units import DEG

# -- the text that describes a machine's axes (ISO 10791-6) ------------------------------------------------------------

_EXAMPLE = "w-C'A'Y'bXZ-t"
#: More rotary axes than these cannot be moved from a wanted tool direction alone.
_MOST_ROTARY = 2
_AXIS = f"[{ALONG}{ABOUT}]"
_MACHINE = re.compile(rf"w-((?:{_AXIS}')*)b({_AXIS}*)-t")
_ALONE = re.compile(rf"{_AXIS}{{1,5}}")


def parse(
    configuration: str, placements: Mapping[str, Placement], tool_length: float
) -> tuple[tuple[Axis, ...], tuple[Axis, ...]]:
    """Axes that carry the workpiece, from the workpiece to the bed, and axes that carry the tool, from the bed.

    Args:
        configuration: axes from the workpiece to the tool, those that carry the workpiece marked by '; or axes
            alone, of which the linear ones carry the tool and the others the workpiece.
        placements: rotary axes whose direction, offset or sense is stated, by letter.
        tool_length: from the head's pivot to the spindle ball, m.

    Raises:
        InputError: it is no such text, an axis is there twice, or too many axes turn.
    """
    machine = _MACHINE.fullmatch(configuration)
    if machine:
        work, tool = machine[1].replace("'", ""), machine[2]
    else:
        work = "".join(a for a in configuration if is_rotary(a))
        tool = "".join(a for a in configuration if not is_rotary(a))
    wrong = _wrong(machine is not None, work + tool)
    if wrong:
        raise InputError(
            f"configuration {configuration[:40]!r} is unknown: {wrong}; allowed: each of {', '.join(ALONG)} and up to "
            f"two of {', '.join(ABOUT)} at most once on either side of the bed, those that carry the workpiece with ', "
            f'as in "{_EXAMPLE}", or axes alone, as in "{ALONG[:2]}" or "{ABOUT[-1]}"'
        )
    for letter in placements:
        if letter not in work + tool or not is_rotary(letter):
            turning = ", ".join(a for a in work + tool if is_rotary(a)) or "none, as no axis turns"
            raise InputError(f"axis {letter!r} cannot be placed in {configuration!r}; allowed: {turning}")
    return (
        tuple(axis_of(a, placements.get(a)) for a in work),
        tuple(axis_of(a, placements.get(a), tool_length, on_table=False) for a in tool),
    )


def _wrong(machine: bool, letters: str) -> str:
    """What is wrong with a configuration; empty where nothing is."""
    if not machine and not _ALONE.fullmatch(letters):
        return "it is not of this form"
    twice = sorted({a for a in letters if letters.count(a) > 1})
    if twice:
        return f"{twice[0]} is there twice"
    if machine and all(is_rotary(a) for a in letters):
        return "it has no linear axis"
    turning = [a for a in letters if is_rotary(a)]
    return f"{len(turning)} axes turn" if len(turning) > _MOST_ROTARY else ""


# -- geometric errors that a chain of axes can have, named as in ISO 230-1 ---------------------------------------------


class LocationError(NamedTuple):
    """A location error of a rotary axis: its centreline displaced (m) or turned (rad) in the frame that carries the
    axis.

    Attributes:
        name: as ISO 230-1 names it.
        axis: letter of the rotary axis.
        along: coordinate along which it is displaced or about which it is turned: 0, 1 or 2.
        rotation: whether it is turned.
    """

    name: str
    axis: str
    along: int
    rotation: bool


class ErrorMotion(NamedTuple):
    """A degree of freedom in which an axis errs as it moves: a displacement (m) or a tilt (rad) of what it carries, in
    the frame that carries the axis.

    Attributes:
        name: as ISO 230-1 names it.
        axis: letter of the axis.
        along: coordinate along which it is displaced or about which it is tilted: 0, 1 or 2.
        rotation: whether it is a tilt.
        axial: whether it is a displacement along the centreline of a rotary axis.
    """

    name: str
    axis: str
    along: int
    rotation: bool
    axial: bool = False


class Squareness(NamedTuple):
    """Squareness error α of two linear axes: the spindle ball moves by ``sign``·α·(position of ``axis``) along
    ``along``.

    Attributes:
        name: the two axes.
        axis: letter of the axis that is out of square.
        along: coordinate of the displacement: 0, 1 or 2.
        sign: +1 or −1.
    """

    name: str
    axis: str
    along: int
    sign: float


def location_errors_of(axis: Axis) -> list[LocationError]:
    """The four location errors of a rotary axis."""
    return [
        LocationError(f"E{letters[i]}0{axis.letter}", axis.letter, i, letters == ABOUT)
        for letters in (ALONG, ABOUT)
        for i in axis.across
    ]


__all__ = [
    "CHAINS",
    "COORDINATES",
    "FIVE_AXIS",
    "SENSES",
    "SINGULAR",
    "TOOL_LENGTH",
    "Axis",
    "Chain",
    "ErrorMotion",
    "LocationError",
    "Placement",
    "Squareness",
    "axis_of",
    "chain_of",
    "is_linear",
    "is_rotary",
]

#: From the pivot of a head to the spindle ball where nobody says, m (assumed).
TOOL_LENGTH = 0.25
#: What a control may do where a path passes a singular direction; the first is the default.
SINGULAR = ("cross", "refuse")


@dataclass(frozen=True)
class Chain:
    """The axes of a machine from the workpiece to the tool. Made by :func:`chain_of`.

    Arrays of axis positions have one column per axis: the linear axes X, Y, Z, then the rotary ones in the order of
    their letters (:attr:`letters`). A linear position is that of the spindle relative to the table, whichever of the
    two moves. A rotary axis turns what it carries by its position about its direction. Positions are those of the
    control, in whichever sense it counts.

    Attributes:
        configuration: e.g. ``"w-C'A'Y'bXZ-t"``: workpiece, axes that carry it (marked by '), bed, axes that carry the
            tool, tool.
        work: axes on the workpiece's side, from the workpiece to the bed.
        tool: axes on the tool's side, from the bed to the tool.
        tool_length: from the head's pivot to the spindle ball, m; 0 where no head turns.
        singular: what the control does where the first rotary axis would have to turn infinitely fast, as the tool is
            parallel to it: ``cross`` or ``refuse``.
        stated_points: functional points that a machine file states, by letter of the linear axis;
            :meth:`functional_point` gives that of any linear axis.
    """

    configuration: str
    work: tuple[Axis, ...] = field(repr=False)
    tool: tuple[Axis, ...] = field(repr=False)
    tool_length: float = field(default=0.0, repr=False)
    singular: str = field(default=SINGULAR[0], repr=False)
    stated_points: tuple[tuple[str, Vector], ...] = field(default=(), repr=False)

    def functional_point(self, letter: str) -> Vector:
        """Point of a linear axis' slide about which its angular errors turn what it carries, with all axes at 0, m.

        Where none is stated it is the point of the centreline of the rotary table that the workpiece lies on, and the
        origin of the work frame without such a table.
        """
        table = self.turning[0].point if self.turning else (0.0, 0.0, 0.0)
        return dict(self.stated_points).get(letter, table)

    @cached_property
    def nominal(self) -> Chain:
        """The same axes without stated functional points: bodies and programs do not depend on these."""
        return replace(self, stated_points=()) if self.stated_points else self

    @cached_property
    def placements(self) -> tuple[tuple[str, Placement], ...]:
        """Rotary axes that are tilted, offset or count clockwise, as :func:`chain_of` takes them."""
        out = []
        for axis in (a for a in self.axes if a.rotary):
            x, y, z = axis.point
            offset = (x, y, z - self.tool_length if axis in self.tool else z)
            sense = self.sense(axis.letter) if axis.ccw < 0.0 and not axis.tilted else None
            if axis.tilted or any(offset) or sense:
                out.append((axis.letter, Placement(axis.unit if axis.tilted else None, offset, sense)))
        return tuple(out)

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """All axes in the order of arrays."""
        return tuple(sorted((*self.work, *self.tool), key=lambda a: (a.rotary, a.along)))

    @cached_property
    def letters(self) -> tuple[str, ...]:
        """All axes' letters in the order of arrays."""
        return tuple(a.letter for a in self.axes)

    @cached_property
    def linear(self) -> tuple[str, ...]:
        """Letters of the linear axes."""
        return tuple(a.letter for a in self.axes if not a.rotary)

    @cached_property
    def rotary(self) -> tuple[str, ...]:
        """Letters of the rotary axes."""
        return tuple(a.letter for a in self.axes if a.rotary)

    @property
    def count(self) -> int:
        """Number of axes."""
        return len(self.axes)

    @cached_property
    def spatial(self) -> bool:
        """Whether the tool reaches any place: a ball bar needs all of X, Y and Z."""
        return self.linear == COORDINATES

    @cached_property
    def linear_columns(self) -> slice:
        """Columns of the linear axes in an array of axis positions."""
        return slice(0, len(self.linear))

    @cached_property
    def rotary_columns(self) -> slice:
        """Columns of the rotary axes in an array of axis positions."""
        return slice(len(self.linear), self.count)

    def index(self, letter: str) -> int:
        """Column of an axis in an array of axis positions."""
        return self.letters.index(letter)

    def axis(self, letter: str) -> Axis:
        """The axis with this letter."""
        return self.axes[self.index(letter)]

    def is_rotary(self, letter: str) -> bool:
        """Whether an axis of this machine turns; subjects that are no axis do not."""
        return letter in self.rotary

    def sense(self, letter: str) -> str:
        """In which sense a rotary axis counts, one of :data:`SENSES`."""
        axis = self.axis(letter)
        return axis.sense(axis in self.work)

    @cached_property
    def senses(self) -> str:
        """The senses of all rotary axes as a text: ``A iso, C opposite``; empty where no axis turns."""
        return ", ".join(f"{a} {self.sense(a)}" for a in self.rotary)

    @cached_property
    def counter_clockwise(self) -> Chain:
        """The same axes where each of them counts counter-clockwise of what it carries, seen against its coordinate."""
        work, tool = (
            tuple(a if a.ccw > 0.0 or not a.rotary else a.turned for a in side) for side in (self.work, self.tool)
        )
        return replace(self, work=work, tool=tool)

    @cached_property
    def turning(self) -> tuple[Axis, ...]:
        """The rotary axes that carry the workpiece, from the workpiece to the bed."""
        return tuple(a for a in self.work if a.rotary)

    @cached_property
    def swivelling(self) -> tuple[Axis, ...]:
        """The rotary axes that carry the tool, from the tool to the bed."""
        return tuple(a for a in reversed(self.tool) if a.rotary)

    def carrier(self, letter: str) -> str:
        """Letter of the axis on which another one stands; empty for one that stands on the bed."""
        for side in (self.work, tuple(reversed(self.tool))):  # both from the far end to the bed
            letters = [a.letter for a in side]
            if letter in letters[:-1]:
                return letters[letters.index(letter) + 1]
        return ""

    @cached_property
    def carried(self) -> tuple[str, ...]:
        """Letters of the linear axes that stand on a rotary axis and turn with it."""
        out = []
        for side in (self.work, tuple(reversed(self.tool))):  # both from the far end to the bed
            turns = [i for i, a in enumerate(side) if a.rotary]
            out += [a.letter for i, a in enumerate(side) if turns and i < turns[-1] and not a.rotary]
        return tuple(out)

    @cached_property
    def round_axes(self) -> tuple[str, ...]:
        """Letters of the rotary axes that can go round: those parallel to the spindle, and the one next to the
        workpiece.
        """
        return tuple(a.letter for a in self.axes if a.rotary and (a.vertical or a in self.turning[:1]))

    @cached_property
    def idle(self) -> str:
        """Letter of the rotary axis next to the spindle that does not tilt the tool, as it is parallel to it; empty
        where there is none.
        """
        last = [*self.swivelling[:1], *reversed(self.turning)][:1]
        return last[0].letter if last and last[0].vertical else ""

    @cached_property
    def motions(self) -> tuple[ErrorMotion, ...]:
        """Error motions of the axes: radial and tilt of every rotary axis from the workpiece to the tool, then
        straightness errors that act across a rotary axis, so that no linear axis moves the same way, then axial error
        motions, and angular errors of the linear axes last.
        """
        rotary = (*self.turning, *reversed(self.swivelling))
        out = [
            ErrorMotion(f"E{letters[i]}{a.letter}", a.letter, i, letters == ABOUT)
            for a in rotary
            for letters in (ALONG, ABOUT)
            for i in a.across
        ]
        axial = [ErrorMotion(f"E{ALONG[a.along]}{a.letter}", a.letter, a.along, False, True) for a in rotary]
        return (*out, *self._crosswise, *axial, *self._angular)

    @cached_property
    def _angular(self) -> list[ErrorMotion]:
        """Angular errors of the linear axes, three of each."""
        return [ErrorMotion(f"E{about}{a}", a, i, True) for a in self.linear for i, about in enumerate(ABOUT)]

    @cached_property
    def angular(self) -> tuple[str, ...]:
        """Angular errors of the linear axes: ``E``, about which coordinate (A, B or C), axis."""
        return tuple(m.name for m in self._angular)

    @cached_property
    def widths(self) -> tuple[int, ...]:
        """Numbers of columns that motions are computed with: models of as few sorts as possible are compiled."""
        straight = self.count + len(self.motions) - len(self.rotary) - len(self.angular)
        turning = (min(self.count + 4 * k, straight) for k in range(-(-(straight - self.count) // 4) + 1))
        axial = straight + len(self.rotary)
        slides = (axial + 3 * k for k in range(1, len(self.linear) + 1))
        return tuple(dict.fromkeys((*turning, axial, *slides)))

    def slides_turn(self, width: int) -> bool:
        """Whether motions of ``width`` columns have angular errors of linear axes among them."""
        return width > len(self.columns) - len(self.angular)

    @cached_property
    def _crosswise(self) -> list[ErrorMotion]:
        """Straightness errors whose direction turns against the linear axis along it."""
        if not self.carried:
            return []
        group = {a: self._rotary_below(a) for a in self.linear}
        return [
            ErrorMotion(name, name[2], ALONG.index(name[1]), False)
            for name in self.straightness
            if group[name[1]] != group[name[2]]
        ]

    def _rotary_below(self, letter: str) -> tuple[str, ...]:
        """Letters of the rotary axes between the bed and an axis."""
        side = self.tool if letter in [a.letter for a in self.tool] else tuple(reversed(self.work))
        at = [a.letter for a in side].index(letter)
        return tuple(a.letter for a in side[:at] if a.rotary)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Columns of a motion: the axes, then error motions, of which arrays may leave out the last ones."""
        return (*self.letters, *(m.name for m in self.motions))

    def straightness_column(self, name: str) -> str:
        """The column of a motion that a straightness error moves."""
        return name if name in [m.name for m in self.motions] else name[1]

    def error_motion(self, letter: str) -> tuple[str, ...]:
        """Radial and tilt error motion of a rotary axis, two columns each, and its axial error motion, one."""
        return tuple(m.name for m in self.motions if m.axis == letter)

    @cached_property
    def location_errors(self) -> tuple[LocationError, ...]:
        """Independent location errors of the rotary axes, from the workpiece to the bed and from there to the tool.

        A displacement of the first axis on the bed's side of the head is left out where the table has the same one:
        only the distance of the two shows.
        """
        out = [e for a in self.turning for e in location_errors_of(a)]
        outermost = {e.along for e in out if not e.rotation and e.axis == self.turning[-1].letter}
        for number, axis in enumerate(reversed(self.swivelling)):
            out += [e for e in location_errors_of(axis) if number or e.rotation or e.along not in outermost]
        return tuple(out)

    @cached_property
    def redundant_location_errors(self) -> tuple[str, ...]:
        """Names of the location errors that no ball bar can see beside :attr:`location_errors`."""
        kept = {e.name for e in self.location_errors}
        return tuple(e.name for a in self.axes if a.rotary for e in location_errors_of(a) if e.name not in kept)

    @cached_property
    def straightness(self) -> tuple[str, ...]:
        """Straightness errors of the linear axes: ``E``, direction, axis."""
        return tuple(f"E{direction}{axis}" for axis in self.linear for direction in self.linear if direction != axis)

    @cached_property
    def squareness(self) -> tuple[Squareness, ...]:
        """Squareness errors of the linear axes."""
        x, y, z = ALONG
        pairs = (Squareness(x + y, y, 0, -1.0), Squareness(y + z, z, 1, -1.0), Squareness(z + x, z, 0, 1.0))
        return tuple(s for s in pairs if set(s.name) <= set(self.linear))

    @cached_property
    def planes(self) -> tuple[str, ...]:
        """Planes of two linear axes, named by both; angles in a plane count from the first to the second."""
        return tuple(s.name for s in self.squareness)


@cache
def chain_of(
    configuration: str,
    placements: tuple[tuple[str, Placement], ...] = (),
    tool_length: float | None = None,
    singular: str = SINGULAR[0],
    functional_points: tuple[tuple[str, Vector], ...] = (),
) -> Chain:
    """The kinematic chain that a configuration describes.

    Args:
        configuration: axes from the workpiece to the tool, e.g. ``"w-C'A'Y'bXZ-t"``, or axes alone, e.g.
            ``"XY"``.
        placements: letters of rotary axes whose direction, offset or sense is stated, each with its placement.
        tool_length: from the head's pivot to the spindle ball, m; ``None`` is 0.25 m. Without a head it says nothing.
        singular: one of :data:`SINGULAR`.
        functional_points: of linear axes, by letter, in machine coordinates with all axes at 0, m.

    Raises:
        InputError: it is none, or a kind of machine that mjsim cannot compute.

    >>> chain_of("w-C'B'X'bYZ-t").letters
    ('X', 'Y', 'Z', 'B', 'C')
    """
    length = TOOL_LENGTH if tool_length is None else tool_length
    work, tool = parse(configuration, dict(placements), length)
    linear = sorted(a.letter for a in (*work, *tool) if not a.rotary)
    for letter, _ in functional_points:
        if letter not in linear:
            raise InputError(
                f"axis {letter!r} cannot have a functional point in {configuration!r}; allowed: "
                f"{', '.join(linear) or 'none, as no axis is linear'}"
            )
    tool_length = length if any(a.rotary for a in tool) else 0.0
    return Chain(configuration, work, tool, tool_length, singular, functional_points)


#: The machine whose model ships.
FIVE_AXIS = chain_of("w-C'A'Y'bXZ-t")
#: Chains that have together every axis and error that an effect may act on.
CHAINS = (FIVE_AXIS, chain_of("w-C'B'X'bYZ-t"), chain_of("w-A'B'bXYZ-t"), chain_of("w-B'bXYZA-t"))


# -- how far and how fast the axes of an ordinary machine of this size go (assumed) ------------------------------------

#: Travel of linear axes across and along the spindle, m; of a rotary axis that tilts the table, of one that swivels the
#: head, and of one that goes round, rad.
_ACROSS, _ALONG_SPINDLE = (-0.3, 0.3), (-0.1, 0.5)
#: The same where a head swivels: the slides follow the swivelling tool.
_ACROSS_HEAD, _ALONG_HEAD = (-0.5, 0.5), (-0.4, 0.5)
_TILT, _SWIVEL, _ROUND = (-30 * DEG, 110 * DEG), (-110 * DEG, 110 * DEG), (-50.0, 50.0)
#: Speed of linear axes, m/s (20 m/min); of an axis that tilts or swivels and of one that goes round, rad/s.
_LINEAR_SPEED, _TILT_SPEED, _ROUND_SPEED = 0.33, 1.0, 2.0


def usual_travel(chain: Chain) -> np.ndarray:
    """Lowest and highest position of every axis, (axes, 2) m and rad."""
    return np.array([_travel(chain, a) for a in chain.axes])


def _travel(chain: Chain, axis: Axis) -> tuple[float, float]:
    if not axis.rotary:
        if any(not a.vertical for a in chain.swivelling):
            return _ALONG_HEAD if axis.along == 2 else _ACROSS_HEAD
        return _ALONG_SPINDLE if axis.along == 2 else _ACROSS
    if axis.letter in chain.round_axes:
        return _ROUND
    return axis.ends(*(_SWIVEL if axis in chain.tool or axis.tilted else _TILT))


def usual_speed(chain: Chain) -> np.ndarray:
    """Highest speed of every axis, (axes,) m/s and rad/s."""
    return np.array(
        [
            _LINEAR_SPEED if not a.rotary else _ROUND_SPEED if a.letter in chain.round_axes else _TILT_SPEED
            for a in chain.axes
        ]
    )
