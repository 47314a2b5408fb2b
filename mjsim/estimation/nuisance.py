"""Nuisances: what set-up and instrument add to the readings, as blocks of the parameter vector.

Values are in standard deviations of their priors, so that every prior is a unit normal.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjsim.estimation.parameters import Block, Parameters
from mjsim.instruments.ball_bar.measurement import BallBarTest

#: Priors' standard deviations: offsets of the balls per coordinate, error of the bar's length (m), trigger shift (s).
TABLE_BALL, SPINDLE_BALL, LENGTH, TRIGGER = 10e-6, 2e-6, 3e-6, 20e-3
#: Names of blocks.
BAR_LENGTH, TRIGGERS = "bar length", "triggers"
#: End of the name of a set-up in which a knock has put a ball into another seat.
AFTER_KNOCK = "after a knock"
_OFFSETS = ("table ball x", "table ball y", "table ball z", "spindle ball x", "spindle ball y", "spindle ball z")


def setup_block(setup: str) -> str:
    """Name of the block that holds a set-up's six ball offsets."""
    return f"set-up {setup}"


def length_block(setup: str) -> str:
    """Name of the block that holds the error of the bar's length: one for all, but for a ball in another seat."""
    return f"{BAR_LENGTH} {setup}" if setup.endswith(AFTER_KNOCK) else BAR_LENGTH


class Nuisances(Parameters):
    """Blocks of six ball offsets per set-up, of the bar's length, and of one trigger per test."""

    @classmethod
    def of_tests(cls, tests: Sequence[BallBarTest], trigger_limit: float) -> Nuisances:
        """The nuisances of some tests.

        Args:
            tests: Measured tests.
            trigger_limit: Largest trigger shift that is believed, prior standard deviations.
        """
        setups = [Block.normal(setup_block(s), _OFFSETS) for s in dict.fromkeys(t.setup for t in tests)]
        names = dict.fromkeys([BAR_LENGTH, *(length_block(t.setup) for t in tests)])
        lengths = [Block.normal(name, ("length",)) for name in names]
        triggers = Block.normal(TRIGGERS, [t.name for t in tests], limit=trigger_limit)
        return cls((*setups, *lengths, triggers))

    def of_test(self, test: BallBarTest) -> np.ndarray:
        """Where the nuisances stand that reach one test's reading, (8,): its set-up's six, the length, its trigger."""
        return np.append(
            self.places(setup_block(test.setup), length_block(test.setup)), self.place(TRIGGERS, test.name)
        )

    def table_ball(self, vector: np.ndarray, setup: str) -> np.ndarray:
        """Offset of the table ball in one set-up, (3,) m."""
        return TABLE_BALL * vector[self[setup_block(setup)]][:3]

    def spindle_ball(self, vector: np.ndarray, setup: str) -> np.ndarray:
        """Offset of the spindle ball in one set-up, (3,) m."""
        return SPINDLE_BALL * vector[self[setup_block(setup)]][3:]

    def length(self, vector: np.ndarray, setup: str = "") -> float:
        """Error of the bar's length in one set-up, m."""
        return float(LENGTH * vector[self[length_block(setup)]][0])

    def trigger(self, vector: np.ndarray, test: str) -> float:
        """Trigger shift of one test, s."""
        return float(TRIGGER * vector[self.place(TRIGGERS, test)])
