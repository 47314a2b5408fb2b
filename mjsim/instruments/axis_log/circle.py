"""The circle inside an axis log, as a ball bar would see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjsim.errors import InputError
from mjsim.instruments.axis_log.measurement import Circle, LogTest, Recording

#: How far a command may lie off the circle and still belong to it, m (assumed: interpolation error of a control).
_NEAR = 20e-6


@dataclass(frozen=True)
class CirclePart:
    """The samples of a log in which the command runs round its circle.

    Attributes:
        samples: Their places in the recording, (n,).
        phi: Angles of the command, unwrapped, (n,) rad.
    """

    samples: np.ndarray
    phi: np.ndarray


def circle_part(test: LogTest, recording: Recording) -> CirclePart:
    """The samples on the stated circle, without those where the command stands still.

    Raises:
        InputError: The command does not run round that circle, or the other way.
    """
    circle = test.circle
    assert circle is not None
    x, y = (recording.axes[a].command - c for a, c in zip(circle.axes, circle.centre, strict=True))
    radius = np.hypot(x, y)
    moving = np.hypot(np.gradient(x), np.gradient(y)) > 1e-3 * circle.radius * 2.0 * np.pi / len(x)
    on = np.flatnonzero((np.abs(radius - circle.radius) < _NEAR) & moving)
    on = _longest_run(on, max(3, int(0.01 / recording.step)))
    phi = np.unwrap(np.arctan2(y[on], x[on])) if len(on) else np.zeros(0)
    turned = float(phi[-1] - phi[0]) if len(phi) else 0.0
    place = f'test "{test.name}": the command'
    if abs(turned) < 1.8 * np.pi:
        stated = f"centre {', '.join(f'{1e3 * c:g}' for c in circle.centre)} mm, radius {1e3 * circle.radius:g} mm"
        raise InputError(
            f"{place} turns {np.degrees(abs(turned)):.0f}° on the circle of {stated}; allowed: a full circle, check "
            f"centre_mm and radius_mm"
        )
    if (turned > 0.0) != (circle.direction == "CCW"):
        other = "CCW" if circle.direction == "CW" else "CW"
        raise InputError(f"{place} runs round its circle {other}; campaign.toml states {circle.direction}")
    return CirclePart(on, phi)


def _longest_run(samples: np.ndarray, gap: int) -> np.ndarray:
    """The longest stretch of sample numbers without a hole of more than ``gap``."""
    if not len(samples):
        return samples
    parts = np.split(samples, np.flatnonzero(np.diff(samples) > gap) + 1)
    return max(parts, key=len)


def radial_deviation(circle: Circle, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Distance from the centre less the radius, (n,) m, with the least-squares centre and radius taken out.

    Args:
        circle: As commanded.
        x: Positions of the first axis, (n,) m.
        y: Positions of the second axis, (n,) m.
    """
    u, v = x - circle.centre[0], y - circle.centre[1]
    deviation = np.hypot(u, v) - circle.radius
    phi = np.arctan2(v, u)
    design = np.column_stack([np.cos(phi), np.sin(phi), np.ones(len(phi))])
    return deviation - design @ np.linalg.lstsq(design, deviation, rcond=None)[0]
