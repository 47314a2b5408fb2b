"""Travel and speed of the axes, and where a commanded motion leaves them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mjsim.ballbar.commanded import Commanded
from mjsim.errors import InputError
from mjsim.io.resources import model_file
from mjsim.machine.chain import AXES, INDEX, LINEAR
from mjsim.units import DEG, MM


def scale(axis: str) -> float:
    """SI per unit of an NC program: mm or degree."""
    return MM if axis in LINEAR else DEG


def unit(axis: str) -> str:
    """Unit of an axis in an NC program, as it follows a number."""
    return " mm" if axis in LINEAR else "°"


@dataclass(frozen=True)
class Limits:
    """``low`` and ``high`` (5,) m and rad, ``speed`` (5,) m/s and rad/s; infinite where there is no limit."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    speed: tuple[float, ...] = (np.inf,) * 5

    def changed(self, travel: dict[str, tuple[float, float]], speed: dict[str, float]) -> Limits:
        """With other limits for some axes: ``travel`` (low, high) in mm or degrees, ``speed`` in mm/min or degrees/min.

        Raises:
            InputError: an interval is empty, or a speed is not above 0.
        """
        low, high, fast = list(self.low), list(self.high), list(self.speed)
        for axis, (a, b) in travel.items():
            if not a < b:
                raise InputError(f"limit of {axis}: {a:g} to {b:g}{unit(axis)} is empty; allowed: the lower end first")
            low[INDEX[axis]], high[INDEX[axis]] = a * scale(axis), b * scale(axis)
        for axis, v in speed.items():
            if not v > 0:
                raise InputError(f"speed limit of {axis}: {v:g}{unit(axis)}/min; allowed: above 0")
            fast[INDEX[axis]] = v * scale(axis) / 60.0
        return replace(self, low=tuple(low), high=tuple(high), speed=tuple(fast))


def model_limits() -> Limits:
    """Joint ranges of the machine model; a joint without a range turns without end."""
    root = ET.parse(model_file()).getroot()
    ranges = {j.get("name"): j.get("range") for j in root.iter("joint")}
    ends = [tuple(map(float, text.split())) if (text := ranges[a]) else (-np.inf, np.inf) for a in AXES]
    return Limits(tuple(e[0] for e in ends), tuple(e[1] for e in ends))


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
    axis, s = AXES[i], scale(AXES[i])
    outside = motion.axes[:, i]
    worst = outside[int(np.argmax(np.maximum(low[i] - outside, outside - high[i])))]
    raise InputError(
        f"{place(first)}: {axis} = {outside[first] / s:.4f}{unit(axis)} leaves its travel (it goes to {worst / s:.4f}{unit(axis)}); "
        f"allowed: {low[i] / s:g} to {high[i] / s:g}{unit(axis)}, or other limits (--limit {axis} LOW HIGH)"
    )


def speed_warnings(motion: Commanded, limits: Limits, place: Callable[[int], str]) -> list[str]:
    """One sentence per axis that a block moves faster than it can; the control would slow the whole block down."""
    out = []
    speeds = np.abs(motion.speeds())
    slowed = "the control will slow these down"
    for i, axis in enumerate(AXES):
        fastest = int(np.argmax(speeds[:, i]))
        if speeds[fastest, i] > limits.speed[i] * (1 + 1e-9):
            count = int((speeds[:, i] > limits.speed[i]).sum())
            out.append(
                f"{axis} is faster than its {limits.speed[i] / scale(axis) * 60:g}{unit(axis)}/min in {count} of {len(speeds)} blocks "
                f"(up to {speeds[fastest, i] / scale(axis) * 60:.1f}{unit(axis)}/min, {place(fastest + 1)}): {slowed}"
            )
    return out
