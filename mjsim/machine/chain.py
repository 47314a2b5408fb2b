"""A machine's kinematic chain: its axes and their order, and the names of its geometric errors.

This is the only module that spells out axis letters. Letters follow ISO 841: X, Y, Z (and U, V, W beside them) are
linear, A, B, C turn about X, Y, Z. Error names follow ISO 230-1: ``EYX`` is the straightness error of X in the
direction of Y, ``EC0A`` the rotation of the A axis' centreline about Z, ``EXC`` the radial error motion of C along X.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from mjsim.errors import InputError

_ALONG, _BESIDE, _ABOUT = "XYZ", "UVW", "ABC"
#: Machine coordinates, named like the linear axes along them.
COORDINATES = tuple(_ALONG)
_CONFIGURATION = re.compile(rf"w-((?:[{_ALONG}{_BESIDE}{_ABOUT}]')*)b([{_ALONG}{_BESIDE}{_ABOUT}]*)-t")
#: The rotary axis that carries the workpiece, and those that may tilt it.
_TABLE, _TILTING = "C", ("A", "B")
_EXAMPLE = "w-C'A'Y'bXZ-t"


class Axis(NamedTuple):
    """One axis.

    Attributes:
        letter: as ISO 841 names it.
        along: coordinate along which it moves or about which it turns: 0, 1 or 2.
        rotary: whether it turns.
    """

    letter: str
    along: int
    rotary: bool

    @property
    def direction(self) -> np.ndarray:
        """Unit vector in machine coordinates, (3,)."""
        return np.eye(3)[self.along]

    @property
    def across(self) -> tuple[int, int]:
        """The two coordinates perpendicular to it, in their order."""
        first, second = (i for i in range(3) if i != self.along)
        return first, second


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


def axis_of(letter: str) -> Axis:
    """The axis that ISO 841 names ``letter``."""
    for letters, rotary in ((_ALONG, False), (_BESIDE, False), (_ABOUT, True)):
        if letter in letters:
            return Axis(letter, letters.index(letter), rotary)
    raise InputError(f"axis {letter!r} is unknown; allowed: {', '.join(_ALONG + _BESIDE + _ABOUT)}")


def is_rotary(letter: str) -> bool:
    """Whether an axis turns. Texts that are no axis letter do not."""
    return len(letter) == 1 and letter in _ABOUT


def is_linear(letter: str) -> bool:
    """Whether an axis moves along a line. Texts that are no axis letter do not."""
    return len(letter) == 1 and letter in _ALONG + _BESIDE


@dataclass(frozen=True)
class Chain:
    """The axes of a machine from the workpiece to the tool. Made by :func:`chain_of`.

    Arrays of axis positions have one column per axis: the linear axes X, Y, Z, then the rotary ones in the order of
    their letters (:attr:`letters`). A linear position is that of the spindle relative to the table, whichever of the
    two moves.

    Attributes:
        configuration: e.g. ``"w-C'A'Y'bXZ-t"``: workpiece, axes that carry it (marked by '), bed, axes that carry the
            tool, tool.
        work: axes on the workpiece's side, from the workpiece to the bed.
        tool: axes on the tool's side, from the bed to the tool.
    """

    configuration: str
    work: tuple[Axis, ...] = field(repr=False)
    tool: tuple[Axis, ...] = field(repr=False)

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

    @cached_property
    def turning(self) -> tuple[Axis, ...]:
        """The rotary axes from the workpiece to the bed."""
        return tuple(a for a in self.work if a.rotary)

    @cached_property
    def table_axis(self) -> str:
        """The rotary axis that carries the workpiece; it can go round."""
        return self.turning[0].letter

    @cached_property
    def tilt_axis(self) -> str:
        """The rotary axis that tilts the table."""
        return self.turning[1].letter

    @cached_property
    def table_motion(self) -> tuple[str, ...]:
        """Error motion of the rotary table: displacement along two coordinates (m), tilt about them (rad)."""
        across = self.turning[0].across
        return tuple(f"E{letters[i]}{self.table_axis}" for letters in (_ALONG, _ABOUT) for i in across)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Columns of a motion: the axes, then the error motion of the rotary table."""
        return (*self.letters, *self.table_motion)

    @cached_property
    def location_errors(self) -> tuple[LocationError, ...]:
        """Location errors of the rotary axes, from the workpiece to the bed."""
        return tuple(
            LocationError(f"E{letters[i]}0{a.letter}", a.letter, i, letters == _ABOUT)
            for a in self.turning
            for letters in (_ALONG, _ABOUT)
            for i in a.across
        )

    @cached_property
    def straightness(self) -> tuple[str, ...]:
        """Straightness errors of the linear axes: ``E``, direction, axis."""
        return tuple(f"E{direction}{axis}" for axis in self.linear for direction in self.linear if direction != axis)

    @cached_property
    def squareness(self) -> tuple[Squareness, ...]:
        """Squareness errors of the linear axes."""
        x, y, z = self.linear
        return Squareness(x + y, y, 0, -1.0), Squareness(y + z, z, 1, -1.0), Squareness(z + x, z, 0, 1.0)

    @cached_property
    def planes(self) -> tuple[str, ...]:
        """Planes of two linear axes, named by both; angles in a plane count from the first to the second."""
        return tuple(s.name for s in self.squareness)


@cache
def chain_of(configuration: str) -> Chain:
    """The kinematic chain that a configuration describes.

    Args:
        configuration: axes from the workpiece to the tool, e.g. ``"w-C'A'Y'bXZ-t"``.

    Raises:
        InputError: it is none, or a kind of machine that mjsim cannot compute.

    >>> chain_of("w-C'B'X'bYZ-t").letters
    ('X', 'Y', 'Z', 'B', 'C')
    """
    match = _CONFIGURATION.fullmatch(configuration)
    work = tuple(axis_of(a) for a in match[1].replace("'", "")) if match else ()
    tool = tuple(axis_of(a) for a in match[2]) if match else ()
    letters = [a.letter for a in (*work, *tool)]
    linear = sorted(a for a in letters if not is_rotary(a))
    turning = [a.letter for a in work[:2]]
    if not match or linear != list(_ALONG) or len(letters) != 5 or turning not in [[_TABLE, a] for a in _TILTING]:
        raise InputError(
            f"configuration {configuration[:40]!r} is unknown; allowed: a rotary table C on a tilting axis A or B, "
            f"and each of X, Y, Z "
            f'once on either side of the bed, e.g. "{_EXAMPLE}"'
        )
    return Chain(configuration, work, tool)


#: The machine whose model ships.
FIVE_AXIS = chain_of(_EXAMPLE)
#: One chain for each set of axes that a machine may have: what an effect may act on anywhere.
CHAINS = (FIVE_AXIS, chain_of("w-C'B'X'bYZ-t"))
