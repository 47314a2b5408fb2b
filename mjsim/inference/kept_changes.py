"""What single effects change in the readings, kept from one model of a machine to the next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjsim.machine.effect import Effect

#: Positions that differ by less, m or rad, are the same to an effect: a thousandth of a worm's tooth.
_SAME = 2e-5


class KeptChanges:
    """Changes of the readings by single effects at nearly the same positions of the axes, test by test.

    A fit asks for the same derivatives again and again, and its models move the axes by micrometres.
    """

    def __init__(self) -> None:
        self._positions: list[np.ndarray] = []
        self._changes: list[dict[tuple[str, str], np.ndarray]] = []

    def move_to(self, positions: Sequence[np.ndarray]) -> None:
        """Forget what was computed at other positions.

        Args:
            positions: Of the axes, one array (n, columns) a test, m and rad.
        """
        if not self._positions:
            self._positions, self._changes = list(positions), [{} for _ in positions]
        for k, (before, now) in enumerate(zip(self._positions, positions, strict=True)):
            if before.shape != now.shape or np.abs(now - before).max() > _SAME:
                self._positions[k], self._changes[k] = now, {}

    def of(self, k: int, effect: Effect) -> np.ndarray | None:
        """What ``effect`` alone adds to the reading of test ``k``, (n,) m, where it is kept."""
        return self._changes[k].get(_key(effect))

    def keep(self, k: int, effect: Effect, change: np.ndarray) -> None:
        """Keep what ``effect`` alone adds to the reading of test ``k``, (n,) m."""
        self._changes[k][_key(effect)] = change


def _key(effect: Effect) -> tuple[str, str]:
    return effect.id, repr(effect.values)
