"""Variables that an unknown cause may depend on: how each follows from the motion of an axis, what it is called, and
how an effect file computes it. Another variable is one more row of :data:`VARIABLES`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mjsim.machine.chain import is_rotary
from mjsim.machine.plant import Motion
from mjsim.units import DEG

#: Unit of the knots of times since a reversal.
LOG_SECONDS = "log₁₀ s"


@dataclass(frozen=True)
class Variable:
    """One variable.

    Attributes:
        words: What it is of an axis: "the X axis' ...".
        its: What a cause on an axis depends on.
        knots: Of a free curve over it.
        argument: How an effect file computes it.
        units: As an effect file has it, of a linear axis and of a rotary one.
        shown: Factor on that and unit, as users read it, of a linear axis and of a rotary one.
        along: Its values along a motion, (n,), by the column of the axis; nothing where the motion does not say it.
        is_slow: Whether it changes little within a block. Of the others, a block mean says too little around a
            reversal.
        is_detailed: Whether its curve may have small details, since scales, screws and wheels have steps and teeth, and
            what turns back lets go at once. Any other curve has a bend or a jump at most.
        is_signed: Whether its curve counts with the direction of motion.
        goes_on: Whether a curve with a straight end goes on beyond what was measured.
        is_counted: Whether its values are numbers, each of which stands for itself.
        in_json: What the JSON of ``mjsim diagnose`` calls it, where that has no name of its own for it.
    """

    words: str
    its: str
    knots: int
    argument: str
    units: tuple[str, str]
    shown: tuple[tuple[float, str], tuple[float, str]]
    along: Callable[[Motion, int], np.ndarray] | None = None
    is_slow: bool = False
    is_detailed: bool = False
    is_signed: bool = False
    goes_on: bool = False
    is_counted: bool = False
    in_json: str = ""

    def unit_of(self, axis: str) -> str:
        """As an effect file has it."""
        return self.units[is_rotary(axis)]

    def shown_of(self, axis: str) -> tuple[float, str]:
        """Factor and unit, as users read it."""
        return self.shown[is_rotary(axis)]


#: The variable of what follows a reversal.
SINCE = "time_since_reversal"
#: The variable of what stays from one reversal of an axis to the next, and is another each time.
STROKE = "stroke"
#: What a mode of the structure follows: see :mod:`mjsim.inference.resonance`. No effect file has one.
SWING = "swing"

_OF_PLACE = "motion.position[:, AXIS]", ("m", "rad"), ((1e3, "mm"), (1.0 / DEG, "°"))

VARIABLES = {
    "position": Variable(
        "position",
        "its position",
        36,
        *_OF_PLACE,
        lambda m, i: m.position[:, i],
        is_slow=True,
        is_detailed=True,
        goes_on=True,
    ),
    "direction": Variable(
        "direction of motion and position",
        "its direction of motion and position",
        24,
        *_OF_PLACE,
        lambda m, i: m.position[:, i],
        is_detailed=True,
        is_signed=True,
        goes_on=True,
    ),
    "velocity": Variable(
        "velocity",
        "its velocity",
        12,
        "motion.velocity[:, AXIS]",
        ("m/s", "rad/s"),
        ((60e3, "mm/min"), (1.0 / DEG, "°/s")),
        lambda m, i: m.velocity[:, i],
        goes_on=True,
    ),
    "acceleration": Variable(
        "acceleration",
        "its acceleration",
        12,
        "motion.acceleration[:, AXIS]",
        ("m/s²", "rad/s²"),
        ((1e3, "mm/s²"), (1.0 / DEG, "°/s²")),
        lambda m, i: m.acceleration[:, i],
        goes_on=True,
    ),
    "torque": Variable(
        "motor's torque",
        "its motor's torque",
        10,
        "motion.torque[:, AXIS]",
        ("N·m", "N·m"),
        ((1.0, "N·m"), (1.0, "N·m")),
        lambda m, i: m.torque[:, i],
        goes_on=True,
    ),
    SINCE: Variable(
        "time since its last reversal",
        "the time since its last reversal",
        10,
        "np.log10(np.maximum(motion.since_reversal[:, AXIS], 0.02))",
        ("log10 of s", "log10 of s"),
        ((1.0, LOG_SECONDS), (1.0, LOG_SECONDS)),
        lambda m, i: np.log10(np.clip(m.since_reversal[:, i], 0.02, 100.0)),
        is_detailed=True,
        is_signed=True,
    ),
    "clock_time": Variable(
        "time of day",
        "the time of day",
        24,
        "motion.clock",
        ("s", "s"),
        ((1.0, "s"), (1.0, "s")),
        is_slow=True,
    ),
    STROKE: Variable(
        "stroke",
        "its last reversal, each time by another amount",
        0,  # one for each stroke
        "motion.clock",
        ("s of the campaign's clock", "s of the campaign's clock"),
        ((1.0, "number"), (1.0, "number")),
        is_counted=True,
        in_json="direction",
    ),
    SWING: Variable("acceleration", "what accelerates", 0, "", ("", ""), ((1.0, ""), (1.0, "")), is_counted=True),
}


def in_json(variable: str) -> str:
    """What the JSON of ``mjsim diagnose`` calls a variable."""
    return VARIABLES[variable].in_json or variable
