"""What a test asks of the axes, and what looks impossible about it."""

from __future__ import annotations

import numpy as np

from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import usual_speed
from mjsim.units import DEG, MM

#: Instants that are looked at.
_INSTANTS = 721


def commanded_speed(test: BallBarTest) -> tuple[np.ndarray, np.ndarray]:
    """Axis commands (n, axes) m and rad along a test, and the highest speed of each axis (axes,) m/s and rad/s."""
    program = Program(test)
    time = np.linspace(0.0, program.duration, _INSTANTS)
    q = program.commands(time)
    return q, np.abs(np.gradient(q, time, axis=0)).max(axis=0)


def speed_warnings(test: BallBarTest) -> list[str]:
    """One sentence per axis that the test moves faster than an ordinary machine can; empty where there is none."""
    _, speed = commanded_speed(test)
    out = []
    for axis, v, most in zip(test.chain.axes, speed, usual_speed(test.chain), strict=True):
        scale, unit = (DEG, "°/s") if axis.rotary else (MM / 60.0, "mm/min")
        if v > most:
            out.append(
                f"{test.name}: {axis.letter} has to move at {v / scale:.0f} {unit}; an ordinary machine reaches "
                f"{most / scale:.0f} {unit}. "
                "A lower feed or another path needs less."
            )
    return out


def range_warning(test: BallBarTest, deviation: np.ndarray, sensor_range: float) -> str:
    """A sentence where a reading (n,) m leaves the sensor's range (m); empty where it does not."""
    largest = float(np.abs(deviation).max())
    if largest <= sensor_range:
        return ""
    return (
        f"{test.name}: the reading reaches {largest / MM:.3g} mm, beyond the sensor's range of "
        f"±{sensor_range / MM:g} mm."
    )
