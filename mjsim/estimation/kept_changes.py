"""What single effects change in the readings, kept from one model of a machine to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence

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

    def change(self, k: int, effect: Effect, compute: Callable[[], np.ndarray], keep: bool) -> np.ndarray:
        """What ``effect`` alone adds to the reading of test ``k``, (n,) m; computed where it is not kept."""
        key = effect.id, repr(effect.values)
        found = self._changes[k].get(key)
        if found is None:
            found = compute()
            if keep:
                self._changes[k][key] = found
        return found
