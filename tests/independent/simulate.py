"""One test's noise-free motion and bar reading: program, drives, transmission, unlisted causes, kinematics."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from . import drives, transmission
from .kinematics import AXES, bar_reading
from .programs import Program

#: Simulated beyond the program's end, s; a shifted clock may look there.
TAIL = 0.2
#: Travel after which a change of direction counts as a reversal: 0.2 µm, and 0.2 arcsec on a rotary axis.
REVERSAL_TRAVEL = (2e-7, 2e-7, 2e-7, 1e-6, 1e-6)


def grid(program: Program) -> np.ndarray:
    """The instants at which motions are kept, s."""
    return np.arange(int(np.ceil((program.duration + TAIL) / drives.GRID)) + 1) * drives.GRID


@njit(cache=True, nogil=True)
def _directions(x, travel, dt):
    """Sign of motion and time since it last changed (1e9 before the first change), with hysteresis."""
    n = len(x)
    sign, since = np.zeros(n), np.full(n, 1e9)
    extreme, at, way, count = x[0], 0, 0.0, 1e9
    for i in range(n):
        count += dt
        if way == 0.0:
            if abs(x[i] - extreme) > travel:
                way = 1.0 if x[i] > extreme else -1.0
                extreme, at = x[i], i
        elif (x[i] - extreme) * way >= 0.0:
            extreme, at = x[i], i
        elif (extreme - x[i]) * way > travel:
            way, count = -way, (i - at) * dt
            extreme, at = x[i], i
        sign[i], since[i] = way, count
    return sign, since


@dataclass
class State:
    """What a cause may depend on, all on the grid: (n,) or (n, 5) in the order of ``axes``; SI units.

    ``torque`` is the motor's, ``since_reversal`` is 1e9 s before an axis' first reversal.
    """

    time: np.ndarray
    clock: np.ndarray
    position: np.ndarray
    torque: np.ndarray
    axes: str = AXES
    velocity: np.ndarray = field(init=False)
    acceleration: np.ndarray = field(init=False)
    direction: np.ndarray = field(init=False)
    since_reversal: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        dt = self.time[1] - self.time[0]
        self.velocity = np.gradient(self.position, dt, axis=0)
        self.acceleration = np.gradient(self.velocity, dt, axis=0)
        both = [
            _directions(np.ascontiguousarray(x), h, dt) for x, h in zip(self.position.T, REVERSAL_TRAVEL, strict=True)
        ]
        self.direction = np.column_stack([b[0] for b in both])
        self.since_reversal = np.column_stack([b[1] for b in both])


def cubic(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Rows of y between its grid points: x in grid steps, cubic through the four neighbours."""
    last = len(y) - 1
    i = np.clip(np.floor(x).astype(int), 0, last - 1)
    u = np.clip(x - i, 0.0, 1.0)[:, None]
    p, a, b, n = y[np.maximum(i - 1, 0)], y[i], y[i + 1], y[np.minimum(i + 2, last)]
    return a + 0.5 * u * ((b - p) + u * ((2 * p - 5 * a + 4 * b - n) + u * (3 * (a - b) + n - p)))


def motion(
    program: Program, started: float, drive: dict, effects: dict, unlisted: tuple = (), axes: str = AXES
) -> tuple[np.ndarray, np.ndarray | None]:
    """Load-side positions (n, axes) on the grid of a program ``started`` at that instant of the campaign's clock, and
    what unlisted causes displace the table ball by, (n, 3) or None.
    """
    time = grid(program)
    clock = started + time
    motor, torque = drives.run(drive, effects, program, time, axes)
    own = transmission.slides(motor, drive, effects, axes)
    load = transmission.displaced(own, clock, effects, axes)
    if not unlisted:
        return load, None
    # an axis that others displace has not moved: nothing sticks or turns back there
    state = State(time, clock, own, torque, axes)
    load = load + sum(u.displacement(state) for u in unlisted)
    return load, sum(u.table(state, program.ball) for u in unlisted) + np.zeros((len(time), 3))


def reading(
    test: dict,
    drive: dict,
    effects: dict,
    instants: np.ndarray,
    *,
    unlisted: tuple = (),
    phases: dict[str, float] | None = None,
    ball_shift: np.ndarray | float = 0.0,
    spindle_shift: np.ndarray | None = None,
) -> np.ndarray:
    """Bar reading in m at the given instants (s from the program's start), noise-free.

    Args:
        drive: numbers by axis. effects: id -> parameters. unlisted: causes outside the catalogue.
        phases: this test's vibration phases, rad. ball_shift, spindle_shift: set-up errors, m.
    """
    program = Program(test)
    load, extra = motion(program, test["started_s"], drive, effects, unlisted)
    at = cubic(instants / drives.GRID, load)
    if phases:
        at = at + transmission.vibration(instants, effects, phases)
    if extra is not None:
        extra = cubic(instants / drives.GRID, extra)
    return bar_reading(at, program.ball + ball_shift, program.length, effects, spindle_shift, extra)
