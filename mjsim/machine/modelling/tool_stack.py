"""Solids of the tool's side of any chain, put together from the spindle back to the column."""

from __future__ import annotations

import numpy as np

from mjsim.machine.chain import Axis, Chain, usual_travel
from mjsim.machine.modelling.links import GAP, Link, Solid, box, from_axis, oriented_box, points, rod
from mjsim.machine.modelling.work_stack import BALL

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
