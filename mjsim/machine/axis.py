"""One axis of a machine: its letter, where it points and where it sits.

This module and :mod:`mjsim.machine.chain` are the only ones that spell out axis letters. Letters follow ISO 841: X, Y,
Z (and U, V, W beside them) are linear, A, B, C turn about X, Y, Z.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mjsim.errors import InputError

ALONG, BESIDE, ABOUT = "XYZ", "UVW", "ABC"
#: Machine coordinates, named like the linear axes along them.
COORDINATES = tuple(ALONG)
#: Letters of all axes that a machine may have, and of those that turn.
AXES, TURNING = tuple(ALONG + ABOUT), tuple(ABOUT)
#: A rotary axis may be turned away from the coordinate of its letter by so much: cosine of the angle (60°).
_LEAST_COSINE = 0.5

Vector = tuple[float, float, float]
_ZERO: Vector = (0.0, 0.0, 0.0)
_UNITS: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
#: In which sense a rotary axis counts: as ISO 841 says, or the other way. ISO 841 names the motion of the tool against
#: the workpiece: an axis of the head is positive counter-clockwise of what it carries, an axis of the table clockwise.
SENSES = ("iso", "opposite")


class Placement(NamedTuple):
    """How a rotary axis differs from the nominal one of its letter.

    Attributes:
        direction: along its centreline, in machine coordinates with all axes at 0; any length above 0. ``None`` is the
            coordinate that its letter names.
        offset: of a point of the centreline, m. On the workpiece's side it counts from the origin of the work frame,
            on the tool's side from the head's pivot, which lies one tool length above the spindle ball.
        sense: one of :data:`SENSES`. ``None`` leaves it to the direction, about which the axis turns what it carries
            counter-clockwise.
    """

    direction: Vector | None = None
    offset: Vector = _ZERO
    sense: str | None = None


class Axis(NamedTuple):
    """One axis.

    Attributes:
        letter: as ISO 841 names it.
        along: coordinate that its letter names: 0, 1 or 2. A linear axis moves along it, a rotary one turns about it
            unless it is tilted.
        rotary: whether it turns.
        unit: unit vector along which it moves or about which it turns, in machine coordinates with all axes at 0. A
            positive position turns what the axis carries counter-clockwise about it, so that the sense of the axis
            stands here and nowhere else.
        point: a point of the centreline of a rotary axis with all axes at 0, m; the spindle ball is then at the origin.
    """

    letter: str
    along: int
    rotary: bool
    unit: Vector
    point: Vector = _ZERO

    @property
    def direction(self) -> np.ndarray:
        """Unit vector in machine coordinates with all axes at 0, (3,)."""
        return np.array(self.unit)

    @property
    def centre(self) -> np.ndarray:
        """A point of the centreline with all axes at 0, (3,) m."""
        return np.array(self.point)

    @property
    def across(self) -> tuple[int, int]:
        """The two coordinates other than that of its letter, in their order."""
        first, second = (i for i in range(3) if i != self.along)
        return first, second

    @property
    def tilted(self) -> bool:
        """Whether it is not parallel to the coordinate of its letter."""
        return any(self.unit[i] != 0.0 for i in self.across)

    @property
    def ccw(self) -> float:
        """+1 where its position grows while it turns what it carries counter-clockwise, seen against the coordinate of
        its letter; −1 where it falls.
        """
        return 1.0 if self.unit[self.along] > 0.0 else -1.0

    @property
    def centreline(self) -> np.ndarray:
        """Unit vector along the centreline, (3,): to the positive side of the coordinate of its letter, in either sense
        of the axis. Errors along it are counted so (ISO 230-7).
        """
        return self.ccw * self.direction

    @property
    def turned(self) -> Axis:
        """The same axis, counted the other way."""
        x, y, z = (-v if v else 0.0 for v in self.unit)
        return self._replace(unit=(x, y, z))

    def sense(self, on_table: bool) -> str:
        """One of :data:`SENSES`.

        Args:
            on_table: whether it carries the workpiece.
        """
        return SENSES[0] if (self.ccw < 0.0) == on_table else SENSES[1]

    def ends(self, low: float, high: float) -> tuple[float, float]:
        """Lower and higher position of a range that counts counter-clockwise of what the axis carries."""
        return (low, high) if self.ccw > 0.0 else (-high, -low)

    @property
    def vertical(self) -> bool:
        """Whether it is parallel to the spindle."""
        return abs(self.unit[2]) > 1.0 - 1e-9


def axis_of(letter: str, placement: Placement | None = None, pivot: float = 0.0, on_table: bool = True) -> Axis:
    """The axis that ISO 841 names ``letter``.

    Args:
        letter: of the axis.
        placement: direction, offset and sense of a rotary axis; ``None`` is the nominal one.
        pivot: height of the point from which the offset counts, m.
        on_table: whether it carries the workpiece.

    Raises:
        InputError: there is no such axis, or it cannot be placed so.
    """
    letters = next((a for a in (ALONG, BESIDE, ABOUT) if letter in a), "")
    if not letters:
        raise InputError(f"axis {letter!r} is unknown; allowed: {', '.join(ALONG + BESIDE + ABOUT)}")
    along = letters.index(letter)
    if letters != ABOUT:
        return Axis(letter, along, False, _UNITS[along])
    placement = placement or Placement()
    x, y, z = placement.offset
    unit = _unit(letter, along, placement.direction)
    axis = Axis(letter, along, True, unit, (x, y, z + pivot))
    if placement.sense in (None, axis.sense(on_table)):
        return axis
    if placement.direction is None:
        return axis.turned
    way, other = ("counter-clockwise", "clockwise") if axis.ccw > 0.0 else ("clockwise", "counter-clockwise")
    where = "table" if on_table else "head"
    raise InputError(
        f"axis {letter}: direction = {[float(d) for d in placement.direction]} means that it turns what it carries "
        f"{way}, seen against {ALONG[along]}, and sense = {placement.sense!r} of an axis of the {where} means {other}; "
        f"allowed: direction = {[-float(d) or 0.0 for d in placement.direction]}, sense = {axis.sense(on_table)!r}, or "
        "one of the two keys alone"
    )


def _unit(letter: str, along: int, direction: Vector | None) -> Vector:
    """Unit vector of a rotary axis."""
    if direction is None:
        return _UNITS[along]
    length = float(np.linalg.norm(direction))
    if not np.isfinite(length) or length == 0.0 or abs(direction[along]) < _LEAST_COSINE * length:
        raise InputError(
            f"axis {letter}: direction = {[float(d) for d in direction]}; allowed: within 60° of {ALONG[along]}, "
            f"whose rotation {letter} names"
        )
    x, y, z = (float(d) / length or 0.0 for d in direction)  # no minus before a zero
    return x, y, z


def is_rotary(letter: str) -> bool:
    """Whether an axis turns. Texts that are no axis letter do not."""
    return len(letter) == 1 and letter in ABOUT


def is_linear(letter: str) -> bool:
    """Whether an axis moves along a line. Texts that are no axis letter do not."""
    return len(letter) == 1 and letter in ALONG + BESIDE


def arc_words(first: str, second: str) -> tuple[str, str]:
    """The word of an NC program for the plane of two linear axes, and the letter of a circle's centre along the first.

    Args:
        first: Letter.
        second: Letter.
    """
    i, j = (ALONG.index(letter) for letter in (first, second))
    return {1: "G17", 2: "G18", 3: "G19"}[i + j], "IJK"[i]


# -- where a ball stands about a rotary axis ---------------------------------------------------------------------------


def radius_of(axis: Axis, ball: np.ndarray) -> tuple[float, np.ndarray]:
    """Where a ball stands about a rotary axis, seen from that axis.

    Args:
        axis: Of the chain.
        ball: Centre of the ball in the work frame, (3,) m.

    Returns:
        Its angle, rad, and the unit vector (3,) from the axis to the ball; those of angle 0 for a ball on the axis.
    """
    along = axis.direction
    first = np.eye(3)[(int(np.argmax(np.abs(along))) + 1) % 3]  # x for an axis along z
    first = first - along * (along @ first)
    first /= np.linalg.norm(first)
    second = np.cross(along, first)
    arm = ball - axis.centre
    angle = float(np.arctan2(arm @ second, arm @ first))
    return angle, np.cos(angle) * first + np.sin(angle) * second
