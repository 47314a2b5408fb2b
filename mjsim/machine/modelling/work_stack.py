"""Solids of the workpiece's side of any chain, put together from the table down to the bed."""

from __future__ import annotations

import numpy as np

from mjsim.machine.chain import Axis, Chain, usual_travel
from mjsim.machine.modelling.links import GAP, Link, Solid, box, from_axis, oriented_box, points, rod

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
