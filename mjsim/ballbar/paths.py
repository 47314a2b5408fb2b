"""Commanded axis positions along a test as a function of its angle φ, by its kind (:mod:`mjsim.ballbar.kinds`)."""

from __future__ import annotations

from mjsim.ballbar.kinds import KINDS
from mjsim.ballbar.measurement import BallBarTest

#: Kind -> axis commands (n, axes) of a test at φ (n,) rad.
PATHS = {name: kind.path for name, kind in KINDS.items()}


def peripheral_radius(test: BallBarTest) -> float:
    """Radius (m) of the circle on which the feed F is programmed."""
    return KINDS[test.kind].radius(test)
