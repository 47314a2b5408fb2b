"""What a kind of ball-bar test is: the keys that it has in a campaign, its path, and the words for it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

if TYPE_CHECKING:
    from mjsim.ballbar.measurement import BallBarTest


class Kind(ABC):
    """One kind of test. Its angle φ goes round in whole revolutions from φ = 0, except for ``rotary``.

    Class attributes: ``name`` as in campaign.toml; ``needed`` and ``optional`` keys beside the common ones; ``directions`` that
    ``sensitive_direction`` may have, empty where the key does not belong to the kind.
    """

    name: ClassVar[str]
    needed: ClassVar[tuple[str, ...]]
    optional: ClassVar[tuple[str, ...]] = ("revolutions",)
    directions: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def path(self, test: BallBarTest, phi: np.ndarray) -> np.ndarray:
        """Axis commands (n, axes) m and rad, in the order of the test's chain, at φ (n,) rad."""

    @abstractmethod
    def angle(self, test: BallBarTest, q: np.ndarray) -> np.ndarray:
        """φ (n,) rad, within a turn, at axis positions ``q`` (n, axes) on the path or near it: inverse of :meth:`path`."""

    def radius(self, test: BallBarTest) -> float:
        """Radius (m) of the circle on which the feed is programmed."""
        return test.length

    @abstractmethod
    def words(self, test: BallBarTest) -> str:
        """How the test goes, without what all kinds have: ball, bar and feed."""

    def place(self, test: BallBarTest) -> str:
        """The plane or the axis, where the kind has one."""
        return ""

    def derived(self, given: dict[str, Any]) -> dict[str, Any]:
        """Attributes of :class:`BallBarTest` that follow from the ones ``given`` in the file."""
        return {}

    def wrong(self, test: BallBarTest) -> str:
        """What is wrong with a test whose keys are right one by one; empty where nothing is."""
        return ""
