"""Nuisances: what set-up and instrument add to the readings, as blocks of the parameter vector.

Values are in standard deviations of their priors, so that every prior is a unit normal.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mjsim.inference.parameters import Block, Parameters
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.machine.chain import COORDINATES
from mjsim.machine.kinematics import BarSensitivity

#: Priors' standard deviations: offsets of the balls per coordinate, error of the bar's length (m), trigger shift (s).
TABLE_BALL, SPINDLE_BALL, LENGTH, TRIGGER = 10e-6, 2e-6, 3e-6, 20e-3
#: The same of an R-test: place of the sphere, and of the nest in the spindle (m), its angles (rad), error of a sensor's
#: unit of length.
SPHERE, NEST_PLACE, NEST_ANGLE, NEST_GAIN = 1e-3, 20e-6, 10e-3, 3e-3
#: Names of blocks.
BAR_LENGTH, TRIGGERS = "bar length", "triggers"
#: Name of the block of an R-test's nest, which is the same in all set-ups.
NEST = "nest"
#: End of the name of a set-up in which a knock has put a ball into another seat.
AFTER_KNOCK = "after a knock"
_OFFSETS = ("table ball x", "table ball y", "table ball z", "spindle ball x", "spindle ball y", "spindle ball z")


def setup_block(setup: str) -> str:
    """Name of the block that holds a set-up's six ball offsets."""
    return f"set-up {setup}"


#: Labels of a set-up and of a nest.
_SPHERE = tuple(f"sphere {c.lower()}" for c in COORDINATES)
_NEST = tuple(f"{what} {c.lower()}" for what in ("place", "angle", "gain") for c in COORDINATES)


def length_block(setup: str) -> str:
    """Name of the block that holds the error of the bar's length: one for all, but for a ball in another seat."""
    return f"{BAR_LENGTH} {setup}" if setup.endswith(AFTER_KNOCK) else BAR_LENGTH


class Nuisances(Parameters):
    """Blocks of what a set-up and an instrument add to readings, and of one trigger per recording.

    A ball bar has six ball offsets per set-up and the error of its length. An R-test has the place of the sphere per
    set-up, and of the nest its place in the spindle, its angles and its gains.
    """

    @classmethod
    def of_tests(cls, tests: Sequence[BallBarTest], trigger_limit: float) -> Nuisances:
        """The nuisances of some tests.

        Args:
            tests: Measured tests.
            trigger_limit: Largest trigger shift that is believed, prior standard deviations.
        """
        setups = {setup_block(t.setup): _SPHERE if t.component else _OFFSETS for t in tests}
        blocks = [Block.normal(name, labels) for name, labels in setups.items()]
        lengths = dict.fromkeys(length_block(t.setup) for t in tests if not t.component)
        if lengths:
            blocks += [Block.normal(name, ("length",)) for name in dict.fromkeys([BAR_LENGTH, *lengths])]
        if any(t.component for t in tests):
            blocks.append(Block.normal(NEST, _NEST))
        recordings = dict.fromkeys(t.recording for t in tests)
        return cls((*blocks, Block.normal(TRIGGERS, recordings, limit=trigger_limit)))

    def of_test(self, test: BallBarTest) -> np.ndarray:
        """Where the nuisances stand that reach one test's reading: those of :func:`set_up_columns`, its trigger."""
        instrument = NEST if test.component else length_block(test.setup)
        return np.append(self.places(setup_block(test.setup), instrument), self.place(TRIGGERS, test.recording))

    def table_ball(self, vector: np.ndarray, setup: str) -> np.ndarray:
        """Offset of the table ball, or of the sphere of an R-test, in one set-up, (3,) m."""
        own = vector[self[setup_block(setup)]]
        return (SPHERE if len(own) == len(_SPHERE) else TABLE_BALL) * own[:3]

    def spindle_ball(self, vector: np.ndarray, setup: str) -> np.ndarray:
        """Offset of the spindle ball in one set-up, or of an R-test's nest in all, (3,) m."""
        own = vector[self[setup_block(setup)]]
        return NEST_PLACE * vector[self[NEST]][:3] if len(own) == len(_SPHERE) else SPINDLE_BALL * own[3:]

    def nest(self, vector: np.ndarray) -> dict[str, float]:
        """Angles and gains of the nest of an R-test, by name with the unit; empty where there is none."""
        if not any(b.name == NEST for b in self.blocks):
            return {}
        own = vector[self[NEST]]
        angles = {f"angle_{c.lower()}_mrad": 1e3 * NEST_ANGLE * v for c, v in zip(COORDINATES, own[3:6], strict=True)}
        gains = {f"gain_{c.lower()}_percent": 1e2 * NEST_GAIN * v for c, v in zip(COORDINATES, own[6:9], strict=True)}
        return {k: float(v) for k, v in (angles | gains).items()}

    def length(self, vector: np.ndarray, setup: str = "") -> float:
        """Error of the bar's length in one set-up, m; 0 where there is no bar."""
        name = length_block(setup)
        return float(LENGTH * vector[self[name]][0]) if any(b.name == name for b in self.blocks) else 0.0

    def trigger(self, vector: np.ndarray, recording: str) -> float:
        """Trigger shift of one recording, s."""
        return float(TRIGGER * vector[self.place(TRIGGERS, recording)])


def set_up_sizes(test: BallBarTest) -> tuple[int, int]:
    """How many of :func:`set_up_columns` are of the set-up, and how many, behind these, of the instrument."""
    return (len(_SPHERE), len(_NEST)) if test.component else (len(_OFFSETS), 1)


def instrument_blocks() -> list[Block]:
    """What a ball bar and the nest of an R-test add to readings in all set-ups."""
    return [Block.normal(BAR_LENGTH, ("length",)), Block.normal(NEST, _NEST)]


def set_up_columns(test: BallBarTest, sensitivity: BarSensitivity, shown: np.ndarray | None = None) -> np.ndarray:
    """Derivatives of a reading by its nuisances but for the trigger, (n, k) m per prior standard deviation.

    A nest that is turned by a small angle shows in each coordinate what is read in the others, and one with a gain more
    of its own. What was measured is precise enough for both.

    Args:
        test: The test.
        sensitivity: Along it.
        shown: All coordinates that an R-test has read at these places, (n, 3) m.
    """
    if not test.component:
        length = np.full((len(sensitivity.table), 1), LENGTH)
        return np.hstack([sensitivity.table * TABLE_BALL, sensitivity.spindle * SPINDLE_BALL, length])
    assert shown is not None
    own = COORDINATES.index(test.component)
    turned = np.cross(np.eye(3)[:, None, :], shown[None])[:, :, own].T
    gains = np.zeros_like(shown)
    gains[:, own] = shown[:, own]
    places = [sensitivity.table * SPHERE, sensitivity.spindle * NEST_PLACE]
    return np.hstack([*places, turned * NEST_ANGLE, gains * NEST_GAIN])
