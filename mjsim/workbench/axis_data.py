"""What a residual is drawn over: angle, time, or an axis' position or speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.units import DEG, MM
from mjsim.workbench.opened import OpenCampaign
from mjsim.workbench.overlay import Trace

ANGLE, TIME = "angle", "time"


@dataclass(frozen=True)
class Abscissa:
    """Values of the horizontal axis of a plot.

    Attributes:
        label: With the unit.
        value: (n,) in that unit.
        forward: (n,) bool, whether the axis moves towards greater values; ``None`` where that has no meaning.
    """

    label: str
    value: np.ndarray
    forward: np.ndarray | None = None


def choices(opened: OpenCampaign, name: str) -> dict[str, str]:
    """What a test can be drawn over, by key, with the words for it."""
    motion, chain = opened.motions[name], opened.test(name).chain
    out = {ANGLE: "angle φ" if kind_of(opened.test(name)).goes_round else "angle", TIME: "time"}
    for i, letter in enumerate(chain.letters):
        if motion.moves[i]:
            out[f"{letter} position"] = f"{letter} position, by direction"
            out[f"{letter} speed"] = f"{letter} speed"
    return out


def abscissa(opened: OpenCampaign, trace: Trace, key: str) -> Abscissa:
    """The horizontal axis of a trace.

    Args:
        opened: The campaign.
        trace: Of one test.
        key: Of :func:`choices`.
    """
    if key == TIME:
        return Abscissa("time in s", trace.time)
    letter, _, what = key.partition(" ")
    chain = trace.test.chain
    if letter not in chain.letters:
        return Abscissa("angle φ in °", np.degrees(trace.phi))
    program, i = opened.motions[trace.test.name].program, chain.index(letter)
    unit, size, per_s = ("°", DEG, "°/s") if chain.is_rotary(letter) else ("mm", MM, "mm/s")
    step = 0.01
    now, later = program.commands(trace.time)[:, i], program.commands(trace.time + step)[:, i]
    speed = (later - now) / step
    if what == "speed":
        return Abscissa(f"{letter} speed in {per_s}", speed / size)
    return Abscissa(f"{letter} position in {unit}", now / size, speed >= 0.0)
