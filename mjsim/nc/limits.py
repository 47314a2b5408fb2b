"""Travel and speed of the axes, and where a commanded motion leaves them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.commanded import Commanded
from mjsim.io.resources import model_file
from mjsim.machine.chain import FIVE_AXIS, Chain, is_rotary
from mjsim.units import DEG, MM


def scale(axis: str) -> float:
    """SI per unit of an NC program: mm or degree."""
    return DEG if is_rotary(axis) else MM


def unit(axis: str) -> str:
    """Unit of an axis in an NC program, as it follows a number."""
    return "°" if is_rotary(axis) else " mm"


@dataclass(frozen=True)
class Limits:
    """Travel and speed of every axis, infinite where there is no limit.

    Attributes:
        low, high: (axes,) m and rad.
        speed: (axes,) m/s and rad/s; empty where no axis has a limit.
        chain: the machine's axes.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    speed: tuple[float, ...] = ()
    chain: Chain = FIVE_AXIS

    def changed(self, travel: dict[str, tuple[float, float]], speed: dict[str, float]) -> Limits:
        """With other limits for some axes: ``travel`` (low, high) in mm or degrees, ``speed`` in mm/min or degrees/min.

        Raises:
            InputError: an interval is empty, or a speed is not above 0.
        """
        low, high, fast = list(self.low), list(self.high), list(self.speed or [np.inf] * self.chain.count)
        for axis, (a, b) in travel.items():
            if not a < b:
                raise InputError(f"limit of {axis}: {a:g} to {b:g}{unit(axis)} is empty; allowed: the lower end first")
            i = self.chain.index(axis)
            low[i], high[i] = a * scale(axis), b * scale(axis)
        for axis, v in speed.items():
            if not v > 0:
                raise InputError(f"speed limit of {axis}: {v:g}{unit(axis)}/min; allowed: above 0")
            fast[self.chain.index(axis)] = v * scale(axis) / 60.0
        return replace(self, low=tuple(low), high=tuple(high), speed=tuple(fast))


def model_limits(chain: Chain = FIVE_AXIS) -> Limits:
    """Joint ranges of the machine model; a joint without a range turns without end. Without limits where there is
    no model.
    """
    if chain.counter_clockwise.nominal != FIVE_AXIS:
        return Limits((-np.inf,) * chain.count, (np.inf,) * chain.count, chain=chain)
    root = ET.parse(model_file()).getroot()
    ranges = {j.get("name"): j.get("range") for j in root.iter("joint")}
    ends = [a.ends(*map(float, text.split())) if (text := ranges[a.letter]) else (-np.inf, np.inf) for a in chain.axes]
    return Limits(tuple(e[0] for e in ends), tuple(e[1] for e in ends), chain=chain)


def check_travel(motion: Commanded, limits: Limits, place: Callable[[int], str]) -> None:
    """Refuse a motion that leaves the axes' travel.

    Args:
        motion: what is commanded. limits: of the machine. place: words for point number i, as in "t.nc, line 12".

    Raises:
        InputError: names axis, place, what is reached farthest and what is allowed.
    """
    low, high = np.array(limits.low), np.array(limits.high)
    over = np.maximum(low - motion.axes, motion.axes - high)
    if over.max() <= 1e-9:
        return
    first = int(np.flatnonzero((over > 1e-9).any(axis=1))[0])
    i = int(np.argmax(over[first]))
    axis = limits.chain.letters[i]
    s = scale(axis)
    outside = motion.axes[:, i]
    worst = outside[int(np.argmax(np.maximum(low[i] - outside, outside - high[i])))]
    raise InputError(
        f"{place(first)}: {axis} = {outside[first] / s:.4f}{unit(axis)} leaves its travel (it goes to "
        f"{worst / s:.4f}{unit(axis)}); "
        f"allowed: {low[i] / s:g} to {high[i] / s:g}{unit(axis)}, or other limits (--limit {axis} LOW HIGH)"
    )


def speed_warnings(motion: Commanded, limits: Limits, place: Callable[[int], str]) -> list[str]:
    """One sentence per axis that a feed block moves faster than it can; the control would slow the whole block down."""
    out = []
    speeds = np.abs(motion.speeds()) * motion.cuts[:, None]
    slowed = "the control will slow these down"
    for i, axis in enumerate(limits.chain.letters if limits.speed else ()):
        fastest = int(np.argmax(speeds[:, i]))
        if speeds[fastest, i] > limits.speed[i] * (1 + 1e-9):
            count = int((speeds[:, i] > limits.speed[i]).sum())
            out.append(
                f"{axis} is faster than its {limits.speed[i] / scale(axis) * 60:g}{unit(axis)}/min in {count} of "
                f"{motion.cuts.sum()} blocks "
                f"(up to {speeds[fastest, i] / scale(axis) * 60:.1f}{unit(axis)}/min, {place(fastest + 1)}): {slowed}"
            )
    return out
