"""An axis log: which axes a control recorded, and what it recorded of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import ClassVar

import numpy as np

from mjsim.errors import InputError
from mjsim.machine.chain import FIVE_AXIS, Chain


@dataclass(frozen=True)
class Circle:
    """A full circle that is part of the commanded motion.

    Attributes:
        axes: The two axes of its plane.
        centre: (2,) m.
        radius: m.
        direction: ``CCW`` or ``CW``.
    """

    axes: tuple[str, str]
    centre: tuple[float, float]
    radius: float
    direction: str = "CCW"


@dataclass(frozen=True)
class LogTest:
    """One axis log; names as in ``campaign.toml``.

    Attributes:
        name: Unique in the campaign.
        axes: Letters of the recorded axes.
        controller: Name of the controller that ran; ``None``: the drives as the machine file has them.
        setup: Tests of one set-up share the encoders' zeros and the screws' angles at the start.
        trace: File of the recording, relative to the campaign.
        circle: A circle in the motion, where one is stated.
        chain: Axes of the machine.
        span: Part of the recording that is used, from and to, s; nothing: all of it.
    """

    __test__ = False
    instrument: ClassVar[str] = "axis_log"

    name: str
    axes: tuple[str, ...]
    controller: str | None = None
    setup: str = ""
    trace: str | None = None
    circle: Circle | None = None
    chain: Chain = FIVE_AXIS
    span: tuple[float, float] | None = None


@dataclass(frozen=True)
class AxisRecord:
    """What was recorded of one axis; m, rad and their rates, (n,) each.

    Attributes:
        command: What the position loop got.
        actual: Encoder of the motor, load-side units.
        load: Second encoder, at the load.
        torque: Of the motor, N·m.
        force: Of the axis, N.
        control: Output of the control, V.
        current: A.
        velocity_command: What the velocity loop got, per s.
        velocity: Actual velocity, per s.
        torque_share: Torque over the rated one.
        current_share: Current over the rated one.
        control_share: Output of the control over its largest.
    """

    command: np.ndarray
    actual: np.ndarray
    load: np.ndarray | None = None
    torque: np.ndarray | None = None
    force: np.ndarray | None = None
    control: np.ndarray | None = None
    current: np.ndarray | None = None
    velocity_command: np.ndarray | None = None
    velocity: np.ndarray | None = None
    torque_share: np.ndarray | None = None
    current_share: np.ndarray | None = None
    control_share: np.ndarray | None = None

    @property
    def channels(self) -> dict[str, np.ndarray]:
        """Everything that was recorded, by name of the attribute."""
        return {f.name: x for f in fields(self) if (x := getattr(self, f.name)) is not None}

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """Channels that are the motor's torque times a number, (n,) each by name, the one that says most first."""
        names = ("torque", "force", "current", "torque_share", "current_share", "control", "control_share")
        return {n: x for n in names if (x := getattr(self, n)) is not None}

    @property
    def output(self) -> tuple[str, np.ndarray] | None:
        """The first of them, and its values (n,); nothing without one."""
        return next(iter(self.outputs.items()), None)

    def motor_torque(self, gear: float) -> np.ndarray | None:
        """Recorded torque of the motor, (n,) N·m, from the force where that was recorded; nothing without both.

        Args:
            gear: Motor angle per axis position.
        """
        if self.torque is not None:
            return self.torque
        return None if self.force is None else self.force / gear


@dataclass(frozen=True)
class Recording:
    """What one log holds.

    Attributes:
        time: (n,) s, growing.
        axes: What was recorded of each axis, by letter.
        held: Axis and channel that kept each value for several samples, and for how many.
    """

    time: np.ndarray
    axes: Mapping[str, AxisRecord]
    held: Mapping[tuple[str, str], int] = field(default_factory=dict)

    @cached_property
    def step(self) -> float:
        """Usual time between two samples, s."""
        return float(np.median(np.diff(self.time)))


@dataclass(frozen=True)
class Recorder:
    """The recorder.

    Attributes:
        rate: Samples per second as stated, Hz.
        resolution: Encoder step of the linear axes, m.
        resolution_rotary: Encoder step of the rotary axes, rad.
        found: Encoder steps that the recordings show, m or rad by axis.
    """

    rate: float = 1000.0
    resolution: float = 0.1e-6
    resolution_rotary: float = 1e-6
    found: Mapping[str, float] = field(default_factory=dict)

    def step_of(self, chain: Chain, axis: str) -> float:
        """Encoder step of one axis, m or rad: as stated, or as the recordings show it where that is larger."""
        return max(self.stated_step_of(chain, axis), self.found.get(axis, 0.0))

    def stated_step_of(self, chain: Chain, axis: str) -> float:
        """Encoder step of one axis that the campaign states, m or rad."""
        return self.resolution_rotary if chain.is_rotary(axis) else self.resolution


def recorded_axes(tests: Sequence[LogTest]) -> tuple[str, ...]:
    """Letters of all recorded axes, in the order of the chain.

    Args:
        tests: Recorded logs.
    """
    there = {a for t in tests for a in t.axes}
    return tuple(a for a in tests[0].chain.letters if a in there) if tests else ()


# -- the circle inside an axis log, as a ball bar would see it ---------------------------------------------------------

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
