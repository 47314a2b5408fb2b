"""The MuJoCo model of a machine of which only the chain is known.

It is put together from links of boxes, cylinders and spheres: a stack from the table down to the bed, a stack from the
spindle back to the column, and the column between. All dimensions and masses are assumed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import product
from xml.sax.saxutils import quoteattr

import numpy as np

from mjsim.io.resources import scene_file
from mjsim.machine.chain import Axis, Chain, usual_travel

# -- what a machine is put together from -------------------------------------------------------------------------------

#: Play between parts that slide on each other or turn in each other, m: they never touch.
GAP = 0.002


@dataclass(frozen=True)
class Solid:
    """A box, cylinder or sphere, in world coordinates while all axes are at 0.

    Attributes:
        shape: ``box``, ``cylinder`` or ``sphere``.
        centre: (3,) m.
        size: half edges of a box, radius and half length of a cylinder, radius of a sphere, m.
        material: by which it is drawn.
        along: direction of a cylinder.
        name: of the geom; empty where it needs none.
    """

    shape: str
    centre: tuple[float, ...]
    size: tuple[float, ...]
    material: str = "white"
    along: tuple[float, ...] = (0.0, 0.0, 1.0)
    name: str = ""

    def corners(self) -> np.ndarray:
        """Points that enclose it, (n, 3) m."""
        centre = np.array(self.centre)
        if self.shape == "sphere":
            return centre + self.size[0] * np.vstack([np.eye(3), -np.eye(3)])
        if self.shape == "box":
            return centre + np.array(list(product((-1.0, 1.0), repeat=3))) * self.size
        radius, half = self.size
        d = np.array(self.along)
        side = np.cross(d, np.eye(3)[int(np.argmin(np.abs(d)))])
        side /= np.linalg.norm(side)
        t = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)[:, None]
        ring = radius / np.cos(np.pi / 16) * (np.cos(t) * side + np.sin(t) * np.cross(d, side))
        return np.vstack([centre + half * d + ring, centre - half * d + ring])


@dataclass
class Link:
    """What moves as one.

    Attributes:
        name: of the body.
        role: what it is on the machine: turntable, cradle, slide, ...
        axis: that moves it; ``None`` for what stands.
        sign: +1 where the axis moves it by its position, −1 where a slide carries the workpiece.
        solids: of which it consists.
    """

    name: str
    role: str
    axis: Axis | None = None
    sign: float = 1.0
    solids: list[Solid] = field(default_factory=list)

    @property
    def origin(self) -> np.ndarray:
        """Origin of its frame while all axes are at 0, (3,) m: on the centreline of its axis."""
        return np.zeros(3) if self.axis is None else self.axis.centre


def box(x: Sequence[float], y: Sequence[float], z: Sequence[float], material: str = "white") -> Solid:
    """A box between two planes along every axis, m."""
    ranges = [sorted(r) for r in (x, y, z)]
    centre = tuple(float(a + b) / 2 for a, b in ranges)
    return Solid("box", centre, tuple(float(b - a) / 2 for a, b in ranges), material)


def oriented_box(
    along: int, span: Sequence[float], across: Sequence[float], z: Sequence[float], material: str
) -> Solid:
    """A box by its extent along the horizontal coordinate ``along`` (0 or 1), across it, and in height, m."""
    return box(span, across, z, material) if along == 0 else box(across, span, z, material)


def rod(
    start: Sequence[float] | np.ndarray, end: Sequence[float] | np.ndarray, radius: float, material: str = "steel"
) -> Solid:
    """A cylinder from one point to another, m."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(b - a))
    centre, along = (a + b) / 2, (b - a) / length
    return Solid("cylinder", tuple(map(float, centre)), (radius, length / 2), material, tuple(map(float, along)))


def points(solids: Iterable[Solid]) -> np.ndarray:
    """Corners of all of them, (n, 3) m."""
    return np.vstack([s.corners() for s in solids])


def from_axis(axis: Axis, solids: Iterable[Solid]) -> tuple[np.ndarray, np.ndarray]:
    """Places along a rotary axis and distances from it of all corners, (n,) m each."""
    away = points(solids) - axis.centre
    along = away @ axis.direction
    return along, np.linalg.norm(away - along[:, None] * axis.direction, axis=1)


# -- solids of the workpiece's side of any chain, put together from the table down to the bed --------------------------

#: Table: radius, lower face and surface, m. The surface is where that of the shipped machine is.
RADIUS, BOTTOM, TOP = 0.25, 0.03, 0.08
#: Centre of the table ball above the origin while nobody moves it, m.
BALL_HEIGHT = 0.155
#: Radius of both balls, m.
BALL = 0.0127


class WorkStack:
    """Links from the table to the bed.

    Attributes:
        links: those that an axis moves, from the table to the bed.
        table: what stands on the innermost link.
        rest: solids of the bed on which the outermost link slides or turns.
        below: height of the lower face of ``rest``, m.
    """

    def __init__(self, chain: Chain) -> None:
        self.links: list[Link] = []
        self.table = Link("table", "table", solids=_table())
        self.rest: list[Solid] = []
        self.below = BOTTOM
        self._travel = dict(zip(chain.letters, usual_travel(chain), strict=True))
        above: list[Solid] = list(self.table.solids)
        for axis in chain.work:
            link = Link(f"{axis.letter.lower()}_axis", "", axis, 1.0 if axis.rotary else -1.0, self.rest)
            self.links.append(link)
            self.rest = []
            above += link.solids
            self._stand(link, axis, above)
            above += [s for s in link.solids if s not in above]

    def _stand(self, link: Link, axis: Axis, above: list[Solid]) -> None:
        """Put under ``link`` what its axis needs, and into ``rest`` what carries that."""
        if not axis.rotary:
            (self._knee if axis.along == 2 else self._slide)(link, axis)
        elif axis.vertical:
            self._turntable(link, axis)
        elif axis.tilted:
            self._nutating(link, axis, above)
        else:
            self._cradle(link, axis, above)

    def _turntable(self, link: Link, axis: Axis) -> None:
        link.role, (x, y, _), z = "turntable", axis.point, self.below
        across = 0.15 if not link.solids else float(np.abs(points(link.solids)[:, :2] - axis.centre[:2]).max())
        if link.solids:  # something stands on it that is wider than a round table's foot
            link.solids.append(rod((x, y, z - 0.05), (x, y, z), max(0.15, across), "iron"))
            z -= 0.05
        link.solids.append(rod((x, y, z - 0.03), (x, y, z), 0.15, "steel"))
        self.rest = [rod((x, y, z - 0.09), (x, y, z - 0.03 - GAP), 0.18, "light_grey")]
        self.below = z - 0.09

    def _cradle(self, link: Link, axis: Axis, above: list[Solid]) -> None:
        """A platform between two cheeks, whose journals turn in two supports on a deck."""
        link.role, along = "cradle", axis.along
        place, across = axis.centre[along], axis.centre[1 - along]
        wide = float(np.abs(from_axis(axis, above)[0]).max()) + 0.02
        if any(k.axis is not None and k.axis.rotary and not k.axis.vertical for k in self.links[:-1]):
            wide = float(np.linalg.norm(points(above) - axis.centre, axis=1).max()) + 0.02  # it tilts as well
        link.solids.append(
            oriented_box(
                along, (place - wide, place + wide), (across - 0.16, across + 0.16), (self.below - 0.04, self.below),
                "light_grey",
            )
        )  # fmt: skip
        height, bottom = float(axis.centre[2]), self.below - 0.04
        for side in (-1.0, 1.0):
            inner, outer = place + side * wide, place + side * (wide + 0.05)
            cheek = oriented_box(
                along, (inner, outer), (across - 0.16, across + 0.16), (bottom, height + 0.09), "light_grey"
            )
            link.solids += [cheek, self._journal(axis, outer, place + side * (wide + 0.05 + GAP + 0.005), 0.08)]
        deck = height - float(from_axis(axis, [*above, *link.solids])[1].max()) - 0.03
        for side in (-1.0, 1.0):
            near, far = place + side * (wide + 0.06), place + side * (wide + 0.17)
            self.rest.append(oriented_box(along, (near, far), (across - 0.15, across + 0.15), (deck, height), "white"))
            self.rest.append(self._journal(axis, near, far, 0.15, "white"))
            self.rest.append(self._journal(axis, far, place + side * (wide + 0.2), 0.12, "blue"))
        self.rest.append(
            oriented_box(
                along, (place - wide - 0.17, place + wide + 0.17), (across - 0.2, across + 0.2), (deck - 0.07, deck),
                "white",
            )
        )  # fmt: skip
        self.below = deck - 0.07

    @staticmethod
    def _journal(axis: Axis, start: float, end: float, radius: float, material: str = "steel") -> Solid:
        """A cylinder on a horizontal axis between two places along it."""
        a, b = axis.centre, axis.centre
        a[axis.along], b[axis.along] = start, end
        return rod(a, b, radius, material)

    def _nutating(self, link: Link, axis: Axis, above: list[Solid]) -> None:
        """A flange across the tilted axis, below all that swings with it, on an inclined foot."""
        link.role = "nutating table"
        d = axis.direction * (1.0 if axis.unit[2] >= 0 else -1.0)
        low = float(((points(above) - axis.centre) @ d).min()) - 0.02
        foot = axis.centre + (low - 0.06) * d
        link.solids += [
            rod((axis.centre[0], axis.centre[1], self.below - 0.02), (*axis.centre[:2], self.below), 0.14, "steel"),
            rod(foot, axis.centre + (low - 0.02) * d, 0.21, "light_grey"),
            rod(axis.centre + (low - 0.02) * d, (*axis.centre[:2], self.below - 0.02), 0.10, "light_grey"),
        ]
        low = float(((points([*above, *link.solids]) - axis.centre) @ d).min())
        top, bottom = axis.centre + (low - GAP) * d, axis.centre + (low - 0.16) * d
        under = float(bottom[2]) - 0.16
        x, y = bottom[0], bottom[1]
        self.rest = [
            rod(bottom, top, 0.21, "white"),
            box((x - 0.2, x + 0.2), (y - 0.2, y + 0.05), (under, float(bottom[2])), "white"),
            box((-0.35, 0.35), (min(y - 0.25, -0.3), 0.3), (under - 0.07, under), "white"),
        ]
        self.below = under - 0.07

    def _slide(self, link: Link, axis: Axis) -> None:
        """A plate on two rails."""
        link.role = "slide"
        corners = points(link.solids or [box((-RADIUS, RADIUS), (-RADIUS, RADIUS), (0, 1))])
        low, high = corners.min(axis=0) - 0.04, corners.max(axis=0) + 0.04
        z = self.below
        link.solids.append(box((low[0], high[0]), (low[1], high[1]), (z - 0.09, z), "light_grey"))
        reach = max(map(abs, self._travel[axis.letter]))
        span = (low[axis.along] - reach - 0.02, high[axis.along] + reach + 0.02)
        other = 1 - axis.along
        inset = 0.08
        for rail in (low[other] + inset, high[other] - inset):
            self.rest.append(
                oriented_box(axis.along, span, (rail - 0.04, rail + 0.04), (z - 0.13, z - 0.09 - GAP), "steel")
            )
        self.rest.append(oriented_box(axis.along, span, (low[other], high[other]), (z - 0.21, z - 0.13), "white"))
        self.below = z - 0.21

    def _knee(self, link: Link, axis: Axis) -> None:
        """A beam between two uprights."""
        link.role, z = "knee", self.below
        corners = points(link.solids or [box((-RADIUS, RADIUS), (-RADIUS, RADIUS), (0, 1))])
        low, high = corners.min(axis=0), corners.max(axis=0)
        up, down = -self._travel[axis.letter][0], self._travel[axis.letter][1]
        link.solids.append(box((low[0] - 0.04, high[0] + 0.04), (low[1], high[1]), (z - 0.14, z), "light_grey"))
        bottom, middle = z - 0.14 - down - 0.03, (low[1] + high[1]) / 2
        for inner, outer in ((low[0] - 0.04, low[0] - 0.18), (high[0] + 0.04, high[0] + 0.18)):
            out = 1.0 if outer > inner else -1.0
            self.rest.append(box((inner + out * GAP, outer), (middle - 0.15, middle + 0.15), (bottom, z + up), "white"))
        self.rest.append(box((low[0] - 0.18, high[0] + 0.18), (low[1], high[1]), (bottom - 0.08, bottom), "white"))
        self.below = bottom - 0.08


def _table() -> list[Solid]:
    """A round table with a mark."""
    return [
        rod((0, 0, BOTTOM), (0, 0, TOP), RADIUS, "iron"),
        rod((0, 0, TOP - 0.004), (0, 0, TOP + 0.001), RADIUS - 0.01, "steel"),
        box((RADIUS - 0.08, RADIUS - 0.015), (-0.008, 0.008), (TOP - 0.003, TOP + 0.002), "mark"),
    ]


# -- solids of the tool's side of any chain, put together from the spindle back to the column --------------------------

#: Half width and rear face of a quill, m.
_QUILL = 0.08, 0.10


class ToolStack:
    """Links from the spindle to the column.

    Attributes:
        links: those that an axis moves, from the tool to the bed.
        spindle: what holds the ball; it stands on the innermost link.
        rest: solids of the column on which the outermost link slides.
        back: y of the rear face of ``rest``, m.
        low: height above which everything behind the head is, m.
        high: height of the upper end of ``rest``, m.
        wide: half width of ``rest``, m.
    """

    def __init__(self, chain: Chain) -> None:
        self.links: list[Link] = []
        self._travel = dict(zip(chain.letters, usual_travel(chain), strict=True))
        pivot = chain.swivelling[0].centre[2] if chain.swivelling else None
        self.spindle = Link("spindle", "spindle", solids=_spindle(pivot))
        self._top = float(points(self.spindle.solids)[:, 2].max())
        self.rest: list[Solid] = []
        self.back, self.low, self.high, self.wide = 0.17, 0.0, 0.0, 0.17
        above: list[Solid] = list(self.spindle.solids)
        turning = {a.letter for a in chain.swivelling}
        outermost = max((i for i, a in enumerate(reversed(chain.tool)) if a.letter in turning), default=-1)
        for number, axis in enumerate(reversed(chain.tool)):
            if number == outermost + 1:
                self._head(above, chain)
            link = Link(f"{axis.letter.lower()}_axis", "", axis, 1.0, self.rest)
            self.links.append(link)
            self.rest = []
            above += link.solids
            self._hold(link, axis, above, chain, number <= outermost)
            above += [s for s in link.solids if s not in above]
        if outermost + 1 == len(chain.tool):
            self._head(above, chain)

    def _hold(self, link: Link, axis: Axis, above: list[Solid], chain: Chain, in_head: bool) -> None:
        """Add to ``link`` what its axis needs, and to ``rest`` what carries that."""
        if axis.rotary and axis.vertical:
            self._turning_head(link, axis)
        elif axis.rotary and axis.tilted:
            self._nutating_head(link, axis, above)
        elif axis.rotary:
            fork = any(a.vertical for a in chain.swivelling)
            self._swivel_head(link, axis, above, fork)
        elif in_head:
            self._short_slide(link, axis)
        elif axis.along == 1:
            self._ram(link)
        else:
            self._plate(link, axis)

    def _turning_head(self, link: Link, axis: Axis) -> None:
        link.role, (x, y, _), z = "turning head", axis.point, self._top
        link.solids.append(rod((x, y, z), (x, y, z + 0.06), 0.15, "light_grey"))
        self.rest = [rod((x, y, z + 0.06 + GAP), (x, y, z + 0.14), 0.165, "white")]
        self._top = z + 0.14

    def _swivel_head(self, link: Link, axis: Axis, above: list[Solid], fork: bool) -> None:
        """Journals in one arm or two; the arms hang from a crown above all that swings upwards."""
        link.role = "fork head" if fork else "swivel head"
        place, distance = from_axis(axis, above)
        if any(a.axis is not None and a.axis.rotary and not a.axis.vertical for a in self.links[:-1]):
            place = np.linalg.norm(points(above) - axis.centre, axis=1)  # what hangs in it swivels as well
        higher = points(above)[:, 2] > axis.centre[2] + 0.01
        wide = float(np.abs(place).max()) + 0.01
        crown = float(axis.centre[2] + distance[higher].max(initial=0.08)) + 0.03
        at, across = axis.centre[axis.along], axis.centre[1 - axis.along]
        sides = (-1.0, 1.0) if fork else (1.0,)
        for side in sides:
            inner, outer = at + side * wide, at + side * (wide + 0.09)
            a, b, c = axis.centre, axis.centre, axis.centre
            a[axis.along], b[axis.along], c[axis.along] = at, inner + side * 0.01, outer
            if self.links[-2:-1] and self.links[-2].role == "quill":  # which slides past the journal
                a[axis.along] = at + side * self._cheek(link, axis, side)
            c_end = c.copy()
            c_end[axis.along] = outer + side * 0.012
            link.solids.append(rod(a, b, 0.05, "steel"))
            start = b.copy()
            start[axis.along] += side * GAP
            self.rest += [
                rod(start, c, 0.085, "white"),
                rod(c, c_end, 0.06, "blue"),
                oriented_box(
                    axis.along, (float(start[axis.along]), outer), (across - 0.08, across + 0.08),
                    (float(axis.centre[2]), crown + 0.08), "white",
                ),
            ]  # fmt: skip
        far = wide + 0.09
        span = (at - far, at + far) if fork else (at - 0.12, at + far)
        self.rest.append(oriented_box(axis.along, span, (across - 0.12, across + 0.12), (crown, crown + 0.08), "white"))
        self._top = crown + 0.08

    def _cheek(self, link: Link, axis: Axis, side: float) -> float:
        """Lengthen the guide of a quill to a journal beside it; distance from the quill's middle to the journal, m."""
        low, high = float(axis.centre[2]) - 0.06, self._top - 0.2
        if axis.along == 1:
            link.solids.append(box((-0.09, 0.09), sorted((side * (_QUILL[1] + GAP), side * 0.2)), (low, high), "white"))
            return _QUILL[1] + GAP
        near = _QUILL[0] + GAP
        wide = sorted((side * near, side * 0.14))
        link.solids.append(box(wide, (-0.06, 0.06), (low, low + 0.2), "white"))
        link.solids.append(box(wide, (-0.06, 0.2), (low + 0.2, high), "white"))  # clear of the table when it swivels
        return near

    def _nutating_head(self, link: Link, axis: Axis, above: list[Solid]) -> None:
        """A flange across the tilted axis, above all that swings with it, under an inclined arm."""
        link.role = "nutating head"
        d = axis.direction * (1.0 if axis.unit[2] >= 0 else -1.0)
        high = float(((points(above) - axis.centre) @ d).max())
        link.solids += [
            rod(axis.centre, axis.centre + (high + 0.01) * d, 0.055, "steel"),
            rod(axis.centre + (high + 0.01) * d, axis.centre + (high + 0.05) * d, 0.11, "light_grey"),
        ]
        start, end = axis.centre + (high + 0.05 + GAP) * d, axis.centre + (high + 0.16) * d
        top = max(float(end[2]) + 0.06, self._top + 0.03)
        x, y = float(end[0]), float(end[1])
        self.rest = [
            rod(start, end, 0.11, "white"),
            box((x - 0.09, x + 0.09), (y - 0.02, y + 0.10), (float(end[2]) - 0.02, top), "white"),
            box(
                (min(x, 0.0) - 0.13, max(x, 0.0) + 0.13), (min(y, 0.0) - 0.13, max(y, 0.0) + 0.13), (top, top + 0.06),
                "white",
            ),
        ]  # fmt: skip
        self._top = top + 0.06

    def _short_slide(self, link: Link, axis: Axis) -> None:
        """A slide inside a head: a plate under a longer one, or a quill before a guide."""
        link.role, z = "quill" if axis.along == 2 else "slide", self._top
        reach = max(map(abs, self._travel[axis.letter]))
        if axis.along == 2:
            x, y = _QUILL
            link.solids.append(box((-x, x), (-x, y), (z, z + reach + 0.15), "light_grey"))
            self.rest.append(box((-0.09, 0.09), (y + GAP, 0.2), (z + 0.02, z + 2 * reach + 0.2), "white"))
            self.rest.append(box((-0.15, 0.15), (-0.15, 0.2), (z + 2 * reach + 0.2, z + 2 * reach + 0.26), "white"))
            self._top = z + 2 * reach + 0.26
        else:
            link.solids.append(box((-0.15, 0.15), (-0.15, 0.15), (z, z + 0.06), "light_grey"))
            self.rest.append(
                oriented_box(
                    axis.along, (-0.17 - reach, 0.17 + reach), (-0.15, 0.15), (z + 0.06 + GAP, z + 0.13), "white"
                )
            )
            self._top = z + 0.13

    def _head(self, above: list[Solid], chain: Chain) -> None:
        """The headstock, from whose rear face the slides go on."""
        z = self._top
        self.back = max(0.17, float(points(above)[:, 1].max()) + 0.03)
        heads = chain.swivelling
        if any(a.along == 0 or a.tilted for a in heads) or (len(heads) > 1 and any(a.vertical for a in heads)):
            # the tool swings back, towards the slides
            reach = max(float(np.linalg.norm(points(self.spindle.solids) - a.centre, axis=1).max()) for a in heads)
            self.back = max(self.back, reach + 0.06)
        self.low, self.high = max(0.46, z), max(0.46, z) + 0.45
        self.rest.append(box((-0.15, 0.15), (-0.15, self.back), (z, z + 0.32), "white"))
        self.rest.append(box((-0.16, 0.16), (self.back - 0.12, self.back), (self.low, self.high), "light_grey"))

    def _plate(self, link: Link, axis: Axis) -> None:
        """A slide across or along the spindle: the plate behind it is as much longer as it travels."""
        link.role = "saddle" if axis.along == 0 else "headstock slide"
        y, (less, more) = self.back, self._travel[axis.letter]
        for side in (-1.0, 1.0):
            if axis.along == 0:
                z = self.low + 0.08 if side < 0 else self.high - 0.08
                shoe, rail = (z - 0.05, z + 0.05), (z - 0.03, z + 0.03)
                link.solids.append(box((-self.wide, self.wide), (y, y + 0.04), shoe, "graphite"))
                self.rest.append(box((less - self.wide, more + self.wide), (y + 0.04 + GAP, y + 0.07), rail, "steel"))
            else:
                x = side * (self.wide - 0.05)
                link.solids.append(box((x - 0.05, x + 0.05), (y, y + 0.04), (self.low, self.high), "graphite"))
                self.rest.append(
                    box((x - 0.03, x + 0.03), (y + 0.04 + GAP, y + 0.07), (self.low, self.high + more), "steel")
                )
        if axis.along == 0:
            self.wide += max(-less, more)
        else:
            self.high += more
        self.back = y + 0.19
        self.rest.append(box((-self.wide, self.wide), (y + 0.07, self.back), (self.low, self.high), "light_grey"))

    def _ram(self, link: Link) -> None:
        """A beam that slides to and fro on a deck."""
        link.role, y, z = "ram", self.back, self.high
        half = min(self.wide, 0.2)
        less, more = self._travel[link.axis.letter] if link.axis else (0.0, 0.0)
        reach = max(-less, more) + 0.03
        link.solids += [
            box((-half, half), (y, y + 0.1), (self.low, z + 0.2), "light_grey"),
            box((-half, half), (y + 0.1, y + 0.1 + 2 * reach + 0.06), (z, z + 0.2), "light_grey"),
        ]
        front, self.back = y + 0.1 + reach, y + 0.1 + 3 * reach + 0.09
        wide = max(half + 0.05, self.wide)
        rails = (0.6 * half, -0.6 * half)
        self.rest += [
            *(box((x - 0.03, x + 0.03), (front, self.back), (z - 0.03, z - GAP), "steel") for x in rails),
            box((-wide, wide), (front, self.back), (z - 0.15, z - 0.03), "white"),
            box((-wide, wide), (self.back - 0.1, self.back), (self.low, z - 0.15), "white"),
        ]
        self.wide = wide


def _spindle(pivot: float | None) -> list[Solid]:
    """Ball, cup, holder and housing; the housing of a head ends a little above its ``pivot``, m."""
    nose = 0.22 if pivot is None else min(0.22, 0.55 * pivot)
    end = 0.5 if pivot is None else pivot + 0.07
    return [
        Solid("sphere", (0.0, 0.0, 0.0), (BALL,), "ball", name="spindle_ball"),
        rod((0, 0, 0.008), (0, 0, 0.02), 0.010, "graphite"),
        rod((0, 0, 0.02), (0, 0, nose - 0.02), 0.014, "dark_grey"),
        rod((0, 0, nose - 0.02), (0, 0, nose), 0.032, "dark_grey"),
        rod((0, 0, nose), (0, 0, nose + 0.03), 0.045, "steel"),
        rod((0, 0, nose + 0.03), (0, 0, end), 0.062, "light_grey"),
    ]


#: Height of the floor below the lowest part that moves, m.
_BED = 0.25
#: Distance between the column and what moves before it, m.
_CLEAR = 0.08


@dataclass(frozen=True)
class Assembly:
    """A machine as links.

    Attributes:
        chain: its axes.
        bed: what stands, with the column.
        work: links from the bed to the workpiece, without the table.
        table: what stands on the innermost of them.
        tool: links from the bed to the tool, without the spindle.
        spindle: what stands on the innermost of them.
        floor: height of the floor, m.
    """

    chain: Chain
    bed: Link
    work: tuple[Link, ...]
    table: Link
    tool: tuple[Link, ...]
    spindle: Link
    floor: float


def assembled(chain: Chain) -> Assembly:
    """The machine that mjsim draws and weighs where nothing but the chain is known. All dimensions are assumed."""
    work, tool = WorkStack(chain), ToolStack(chain)
    bottom = work.below
    floor = min(bottom - _BED, -0.75)
    bed = Link("bed", "bed and column", solids=[*work.rest, *tool.rest])
    standing = points([*work.table.solids, *work.rest, *(s for k in work.links for s in k.solids)])
    low, high = standing.min(axis=0), standing.max(axis=0)
    travel = dict(zip(chain.letters, usual_travel(chain), strict=True))
    forth = [float(travel[a.letter][1]) for a in chain.work if not a.rotary and a.along == 1]
    behind = float(high[1]) + _CLEAR + max(forth, default=0.0)
    bed.solids += _column(tool, behind, floor)
    rear = float(points(bed.solids)[:, 1].max())
    half = max(-float(low[0]), float(high[0]), 0.35) - 0.02
    bed.solids += [
        box((-half, half), (float(low[1]) + 0.02, rear), (floor + 0.06, bottom), "white"),
        box((-half + 0.05, half - 0.05), (float(low[1]) + 0.06, rear - 0.04), (floor, floor + 0.06), "graphite"),
    ]
    on_bed, on_column = tuple(reversed(work.links)), tuple(reversed(tool.links))
    return Assembly(chain, bed, on_bed, work.table, on_column, tool.spindle, floor)


def _column(tool: ToolStack, behind: float, floor: float) -> list[Solid]:
    """Upper part that carries the slides, and a foot behind everything that moves on the table's side."""
    front, half = tool.back, tool.wide + 0.04
    foot = max(front, behind)
    rear = max(front + 0.35, foot + 0.3)
    low = tool.low - 0.01
    return [
        box((-half, half), (front + GAP / 2, rear), (low, tool.high + 0.05), "white"),
        box((-half, half), (foot, rear), (floor, low), "white"),
        box((-half - 0.012, half + 0.012), (foot + 0.05, rear - 0.05), (low + 0.08, tool.high - 0.08), "blue"),
    ]


def weights(assembly: Assembly) -> dict[str, tuple[float, np.ndarray, float]]:
    """Mass (kg), centre of mass (3,) m in world coordinates, and moment of inertia (kg·m², the same about all axes) of
    every link that moves.

    Rotary links are balanced: what one carries has its centre of mass on its centreline, as in the shipped model. All
    numbers are assumed.
    """
    out: dict[str, tuple[float, np.ndarray, float]] = {}
    for side in (assembly.work, assembly.tool):
        mass, centre = 0.0, np.zeros(3)
        for link in reversed(side):
            assert link.axis is not None
            if link.axis.rotary:
                own = link.axis.centre
                place = own + mass / _ROTARY_MASS * (own - centre) if mass else own
                out[link.name] = _ROTARY_MASS, place, _INERTIA
                mass, centre = mass + _ROTARY_MASS, own
            else:
                out[link.name] = _SLIDE_MASS, link.origin, _SLIDE_INERTIA
    return out


#: Mass of a slide and of a rotary link, kg; moments of inertia, kg·m² (assumed, of the size of the shipped model's).
_SLIDE_MASS, _ROTARY_MASS, _SLIDE_INERTIA, _INERTIA = 250.0, 80.0, 20.0, 2.5


_MATERIALS = {
    "white": "0.86 0.88 0.89 1",
    "light_grey": "0.63 0.66 0.69 1",
    "dark_grey": "0.38 0.41 0.44 1",
    "graphite": "0.15 0.16 0.18 1",
    "blue": "0.07 0.27 0.55 1",
    "iron": "0.36 0.37 0.38 1",
    "steel": "0.72 0.74 0.76 1",
    "ball": "0.93 0.94 0.96 1",
    "mark": "0.95 0.75 0.08 1",
    "bar": "1 0.3 0.02 1",
}
#: Length of the bar in the key frame, m.
BAR = 0.1
#: Natural frequency of a viewer's sliders, rad/s (assumed; no model of the drives).
_VIEWER = 8.0
#: Motor's share of an axis' inertia until a machine file says more: this many times that of the bodies (assumed).
_ARMATURE = 2.0
_HEAD = """<mujoco model={name}>
  <!--
       {title}
       Metres, kilograms, radians. With all axes at 0 the spindle ball is at the origin.
       Shapes and masses are assumed. Moving bodies are balanced and their weight is compensated.
       Keep the names of joints, bodies "table" and "table_fixture", and sites.
  -->
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <default>
    <geom group="2" friction="0.1"/>
    <site type="sphere" size="0.002" group="4"/>
    <joint damping="0"/>
  </default>
  <asset>
{materials}
  </asset>
  <worldbody>
"""


def machine_xml(chain: Chain, name: str = "machine") -> str:
    """The MJCF model of a machine with these axes: bodies, joints, sites of both balls, sensors and sliders.

    Args:
        chain: the machine's axes.
        name: of the model.
    """
    return _text(assembled(chain), name)


def _text(assembly: Assembly, name: str) -> str:
    chain = assembly.chain
    materials = "\n".join(f'    <material name="{k}" rgba="{v}"/>' for k, v in _MATERIALS.items())
    out = [_HEAD.format(name=quoteattr(name), title=f"Machine {chain.configuration}.", materials=materials)]
    weigh, travel = weights(assembly), dict(zip(chain.letters, usual_travel(chain), strict=True))
    out.append('    <body name="bed">\n')
    out += [_geom(s, np.zeros(3), "      ") for s in assembly.bed.solids]
    for links, last in ((assembly.tool, assembly.spindle), (assembly.work, assembly.table)):
        out.append(_nested(links, np.zeros(3), last, chain, weigh, travel, "      "))
    out.append("    </body>\n  </worldbody>\n")
    order = [k.axis.letter for k in (*assembly.tool, *assembly.work) if k.axis]
    first = [links[0].name for links in (assembly.work, assembly.tool) if links]
    loose = [n for n, links in (("table", assembly.work), ("spindle", assembly.tool)) if not links]
    excluded = "".join(f'    <exclude body1="bed" body2="{b}"/>\n' for b in (*first, *loose))
    out.append(f"  <!-- These touch the bed always. -->\n  <contact>\n{excluded}  </contact>\n")
    out.append(_TENDON)
    carried: dict[str, float] = {}
    for links in (assembly.work, assembly.tool):
        carried |= {k.axis.letter: _carried(links[i:], weigh) for i, k in enumerate(links) if k.axis}
    out.append("  <!-- For the sliders of a viewer. They are no model of the drives. -->\n  <actuator>\n")
    for a in order:
        kp = (1 + _ARMATURE) * carried[a] * _VIEWER**2
        control = "" if a not in chain.round_axes else ' ctrlrange="-6.2832 6.2832"'
        inherit = control or ' inheritrange="1"'
        out.append(f'    <position name="{a}" joint="{a}" kp="{kp:.6g}" dampratio="1"{inherit}/>\n')
    out.append("  </actuator>\n  <sensor>\n")
    out += [f'    <jointpos name="{a}_pos" joint="{a}"/>\n' for a in order]
    out.append(_SENSORS)
    if chain.spatial:
        home = dict(zip(chain.linear, (BAR, 0.0, BALL_HEIGHT), strict=True))
        at = _numbers([home.get(a, 0.0) for a in order])
        out.append(
            f"  <keyframe>\n    <!-- In the order {' '.join(order)}. The bar is {BAR:g} m long. -->\n"
            f'    <key name="home" qpos="{at}" ctrl="{at}"/>\n  </keyframe>\n'
        )
    return "".join(out) + "</mujoco>\n"


_TENDON = """  <!-- The ball bar is drawn between the two balls. -->
  <tendon>
    <spatial name="ball_bar" width="0.0045" material="bar">
      <site site="table_ball"/>
      <site site="spindle_ball"/>
    </spatial>
  </tendon>
"""
_SENSORS = """    <framepos name="spindle_ball_pos" objtype="site" objname="spindle_ball"/>
    <framepos name="table_ball_pos" objtype="site" objname="table_ball"/>
    <tendonpos name="ball_bar_length" tendon="ball_bar"/>
  </sensor>
"""


def _nested(links: tuple[Link, ...], parent: np.ndarray, last: Link, chain: Chain, weigh, travel, pad: str) -> str:
    """Bodies of a side, each inside the one that carries it; ``parent`` (3,) is the origin of what carries them."""
    if not links:
        return _end(last, parent, pad)
    link, axis = links[0], links[0].axis
    assert axis is not None
    mass, centre, inertia = weigh[link.name]
    own = _carried(links, weigh)
    limits = "" if axis.letter in chain.round_axes else f' range="{_numbers(travel[axis.letter])}"'
    kind = "hinge" if axis.rotary else "slide"
    lines = [
        f"{pad}<!-- {link.role} -->\n"
        f'{pad}<body name="{link.name}" pos="{_numbers(link.origin - parent)}" gravcomp="1">\n',
        f'{pad}  <joint name="{axis.letter}" type="{kind}" axis="{_numbers(link.sign * axis.direction)}"{limits} '
        f'armature="{_ARMATURE * own:.6g}"/>\n',
        f'{pad}  <inertial pos="{_numbers(centre - link.origin)}" mass="{mass:g}" '
        f'diaginertia="{inertia:g} {inertia:g} {inertia:g}"/>\n',
        *(_geom(s, link.origin, pad + "  ") for s in link.solids),
        _nested(links[1:], link.origin, last, chain, weigh, travel, pad + "  "),
        f"{pad}</body>\n",
    ]
    return "".join(lines)


def _carried(links: tuple[Link, ...], weigh) -> float:
    """Mass or moment of inertia that the axis of the first link moves, kg or kg·m²."""
    axis = links[0].axis
    assert axis is not None
    if not axis.rotary:
        return sum(weigh[k.name][0] for k in links)
    total = 0.0
    for link in links:
        mass, centre, inertia = weigh[link.name]
        total += inertia + mass * float(np.sum(np.cross(axis.direction, centre - axis.centre) ** 2))
    return total


def _end(last: Link, parent: np.ndarray, pad: str) -> str:
    """The table or the spindle, whose frame has the machine's origin."""
    inner = "".join(_geom(s, np.zeros(3), pad + "  ") for s in last.solids)
    if last.name == "table":
        inner += (
            f"{pad}  <!-- Origin: centre of the ball. Code moves this body. -->\n"
            f'{pad}  <body name="table_fixture" pos="0 0 {BALL_HEIGHT}">\n'
            + "".join(_geom(s, np.zeros(3), pad + "    ") for s in _fixture())
            + f'{pad}    <site name="table_ball"/>\n{pad}  </body>\n'
        )
    else:
        inner += f'{pad}  <site name="spindle_ball"/>\n'
    return f'{pad}<body name="{last.name}" pos="{_numbers(-parent)}" gravcomp="1">\n{inner}{pad}</body>\n'


def _fixture() -> list[Solid]:
    """Post with a cup under the table ball."""
    foot = TOP - BALL_HEIGHT
    return [
        Solid("cylinder", (0.0, 0.0, foot + 0.009), (0.024, 0.007), "graphite"),
        Solid("cylinder", (0.0, 0.0, (foot + 0.016 - 0.012) / 2), (0.009, (-0.012 - foot - 0.016) / 2), "steel"),
        Solid("sphere", (0.0, 0.0, 0.0), (BALL,), "ball", name="table_ball"),
    ]


def _geom(solid: Solid, origin: np.ndarray, pad: str) -> str:
    named = f' name="{solid.name}"' if solid.name else ""
    turned = ""
    if solid.shape == "cylinder" and abs(solid.along[2]) < 1.0 - 1e-12:
        turned = f' zaxis="{_numbers(solid.along)}"'
    return (
        f'{pad}<geom{named} type="{solid.shape}" size="{_numbers(solid.size)}" '
        f'pos="{_numbers(np.array(solid.centre) - origin)}"{turned} material="{solid.material}"/>\n'
    )


def _numbers(values) -> str:
    """Numbers that read back exactly; what is 0 but for rounding is 0."""
    return " ".join(repr(float(v)) if abs(v) > 1e-15 else "0" for v in values)


# -- the scene around a machine made of its chain ----------------------------------------------------------------------


def scene_xml(chain: Chain, model: str) -> str:
    """The shipped scene around another machine.

    Args:
        chain: the machine's axes.
        model: file of its model, beside the scene.
    """
    assembly = assembled(chain)
    links = (assembly.bed, *assembly.work, assembly.table, *assembly.tool, assembly.spindle)
    corners = points(s for k in links for s in k.solids)
    middle, size = (corners.min(axis=0) + corners.max(axis=0)) / 2, float(np.ptp(corners, axis=0).max())
    text = scene_file().read_text(encoding="utf-8")
    for camera, away, fovy in (("overview", (-1.05, -1.26, 0.61), 42), ("side", (-1.8, -0.48, 0.38), 37)):
        seen = _looking(middle + size * np.array(away), middle)
        text = _replaced(text, f'<camera name="{camera}"', f'{seen} fovy="{fovy}"')
    floor = f'type="plane" size="0 0 0.05" pos="0 0 {assembly.floor:g}" material="floor"'
    text = _replaced(text, '<geom name="floor"', floor)
    return text.replace('file="five_axis.xml"', f'file="{model}"').replace('"five_axis scene"', '"machine scene"')


def whole_scene(chain: Chain) -> str:
    """The scene and the machine in it as one text."""
    inside = machine_xml(chain).partition(">")[2].rpartition("</mujoco>")[0]
    scene = scene_xml(chain, "machine.xml")
    return scene.replace('<include file="machine.xml"/>', inside)


def _replaced(text: str, start: str, attributes: str) -> str:
    """``text`` with other attributes behind ``start`` of an element."""
    head, _, rest = text.partition(start)
    return f"{head}{start} {attributes}/>{rest.partition('/>')[2]}"


def _looking(eye: np.ndarray, at: np.ndarray) -> str:
    """Position and orientation of a camera that looks from one point at another."""
    back = (eye - at) / np.linalg.norm(eye - at)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.concatenate([right, np.cross(back, right)])
    return f'pos="{" ".join(f"{v:.6g}" for v in eye)}" xyaxes="{" ".join(f"{v:.6g}" for v in axes)}"'
