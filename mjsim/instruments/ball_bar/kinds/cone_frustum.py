"""Cone-frustum test of five axes (ISO 10791-6; paper's appendix)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Annotated

import numpy as np
from pydantic import Field

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.kinds.base import DIRECTION, REVOLUTIONS, Key, Kind, kind_of, place_name, register
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import Chain
from mjsim.machine.inverse import is_tilting_table, pose, solutions
from mjsim.machine.kinematics import spindle_in_work
from mjsim.units import DEG, MM

_HALF_APEX = Key(
    "half_apex_deg",
    "half_apex",
    DEG,
    Annotated[float, Field(gt=0, lt=90)],
    option="--half-apex",
    help="Half apex angle, °.",
)
_INCLINATION = Key(
    "inclination_deg",
    "inclination",
    DEG,
    Annotated[float, Field(ge=0, lt=90)],
    option="--inclination",
    help="Inclination, °.",
)
_SENSITIVE = Key(
    "sensitive_direction",
    "sensitive",
    words=("perpendicular", "parallel"),
    option="--sensitive",
    help="How the bar stands.",
)

#: Half apex and inclination of the cones that a plan looks at, rad: the paper's two, one that passes close to the
#: table's axis (C turns fast there), and one on which C swings to and fro.
_CONES = tuple((a * DEG, b * DEG) for a, b in ((15, 10), (45, 30), (20, 17), (10, 25)))
#: Angles at which directions are tried, rad.
_AROUND = np.linspace(0.0, 2 * np.pi, 73)
#: Inclinations that are tried where a path cannot be followed, rad.
_LEANS = tuple(np.arange(0.0, 90.0, 0.5) * DEG)
#: Offsets of the table ball that a plan looks at, m: the first round's places, then along X or Y.
_PLACES = ((0.0, 0.0), (0.1, 0.0), (0.0, 0.1), (-0.1, 0.0), (0.0, -0.1))
_OFFSETS = tuple(o * MM for o in (-200, -100, -50, 50, 100, 200))


@register
class ConeFrustum(Kind):
    name = "cone_frustum"
    keys = (_HALF_APEX, _INCLINATION, _SENSITIVE, DIRECTION, REVOLUTIONS)

    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        """Eq. A.1 to A.9."""
        return pose(test.chain, *self._cone(test, phi))

    def _cone(self, test: BallBarTest, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Spindle ball (n, 3) m and tool direction (n, 3) in the work frame; eq. A.1 to A.5."""
        L, theta, beta = test.length, test.half_apex, test.inclination
        if test.sensitive == "perpendicular":
            r = L * np.cos(theta)
            P = np.stack([r * np.cos(phi), r * np.sin(phi), np.full_like(phi, L * np.sin(theta))], 1)
            apex = np.array([0.0, 0.0, L / np.sin(theta)])
        else:
            P = np.stack([L * np.cos(phi), L * np.sin(phi), np.zeros_like(phi)], 1)
            apex = np.array([0.0, 0.0, L / np.tan(theta)])
        tilt = np.array([[np.cos(beta), 0.0, np.sin(beta)], [0.0, 1.0, 0.0], [-np.sin(beta), 0.0, np.cos(beta)]])
        OT = np.asarray(test.table_ball)
        P, apex = P @ tilt.T + OT, tilt @ apex + OT
        T = apex - P
        T /= np.linalg.norm(T, axis=1)[:, None]
        return P, T

    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        x, y, z = (spindle_in_work(test.chain, q) - test.table_ball).T
        return np.arctan2(
            y, np.cos(test.inclination) * x - np.sin(test.inclination) * z
        )  # the circle leans by β about Y

    def wrong(self, test: BallBarTest) -> str:
        if _reaches(test):
            wrong = self.out_of_reach(test) if test.chain.carried or test.chain.singular == "refuse" else ""
            return wrong + self._nearest(test) if wrong else ""
        most = test.half_apex + test.inclination
        low, high = 0.0, test.inclination
        if not _reaches(replace(test, inclination=low)):
            return (
                f"its tool directions lean up to {most / DEG:.1f}° from the spindle, further than "
                f"{' and '.join(test.chain.rotary)} turn it; allowed: a smaller half_apex_deg"
            )
        while high - low > 0.01 * DEG:
            middle = (low + high) / 2
            low, high = (middle, high) if _reaches(replace(test, inclination=middle)) else (low, middle)
        return (
            f"its tool directions lean up to {most / DEG:.1f}° from the spindle, and "
            f"{' and '.join(test.chain.rotary)} turn it by up to {(test.half_apex + low) / DEG:.1f}°; "
            f"nearest possible: inclination_deg = {low / DEG:.2f}"
        )

    def _nearest(self, test: BallBarTest) -> str:
        """The next inclination that the axes can follow; empty where there is none."""
        able = (replace(test, inclination=beta) for beta in sorted(_LEANS, key=lambda b: abs(b - test.inclination)))
        found = next((t for t in able if _reaches(t) and not self.out_of_reach(t)), None)
        return "" if found is None else f"; nearest possible: inclination_deg = {found.inclination / DEG:g}"

    def radius(self, test: BallBarTest) -> float:
        return test.length * float(np.cos(test.half_apex)) if test.sensitive == "perpendicular" else test.length

    def cannot(self, chain: Chain) -> str:
        if wrong := super().cannot(chain):
            return wrong
        if len(chain.rotary) < 2:
            return f"the tool's direction needs two rotary axes, and the machine has {len(chain.rotary) or 'none'}"
        return f"{chain.idle} is parallel to the spindle, so that it does not tilt the tool" if chain.idle else ""

    def words(self, test: BallBarTest) -> str:
        cone = f"cone frustum θ = {test.half_apex / DEG:g}°, β = {test.inclination / DEG:g}°"
        return f"{cone}, {test.sensitive}, {test.direction}"

    def short_name(self, test: BallBarTest) -> str:
        cone = f"cone{round(test.half_apex / DEG)}-{round(test.inclination / DEG)}"
        return f"{cone}-{place_name(test)}-{test.sensitive}-{test.direction.lower()}"

    def proposals(self, chain: Chain, length: float, height: float) -> Iterator[BallBarTest]:
        for (half, tilt), sensitive, (x, y) in product(_CONES, _SENSITIVE.words_of(chain), _PLACES):
            test = BallBarTest("", self.name, (x, y, height), length, 0.0, chain=chain)
            yield replace(test, half_apex=half, inclination=tilt, sensitive=sensitive)

    def variations(self, test: BallBarTest) -> Iterator[BallBarTest]:
        x, y, z = test.table_ball
        for half, tilt in _CONES:
            if (half, tilt) != (test.half_apex, test.inclination):
                yield replace(test, half_apex=half, inclination=tilt)
        yield replace(test, sensitive="parallel" if test.sensitive == "perpendicular" else "perpendicular")
        for o in _OFFSETS:
            yield replace(test, table_ball=(o, y, z))
            yield replace(test, table_ball=(x, o, z))


def _reaches(test: BallBarTest) -> bool:
    """Whether the rotary axes bring the tool into every direction of the test."""
    if is_tilting_table(test.chain):
        return True
    cone = kind_of(test)
    assert isinstance(cone, ConeFrustum)
    try:
        solutions(test.chain, cone._cone(test, _AROUND)[1])
    except InputError:
        return False
    return True
