"""Geometric errors that a chain of axes can have, named as in ISO 230-1."""

from __future__ import annotations

from typing import NamedTuple

from mjsim.machine.axis import ABOUT, ALONG, Axis


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
