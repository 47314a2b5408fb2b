"""The plant: everything the compiled callback needs to know, collected from a machine's drives and effects."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from mjsim.machine.bodies import bodies_scale, moving_bodies
from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.machine.control import Control
from mjsim.machine.kinematics import Geometry
from mjsim.machine.temperatures import Temperatures

# -- what a plain-Python effect may depend on --------------------------------------------------------------------------


@dataclass(frozen=True)
class Motion:
    """What a plain-Python effect may depend on; arrays over n instants, which cannot be written into.

    Attributes:
        time: s from the program's start, (n,).
        clock: s on the campaign clock, (n,).
        position: load-side axis positions so far, (n, axes) m and rad, in the order of the machine's chain.
        velocity, acceleration: their rates, (n, axes).
        since_reversal: s since each axis last reversed, (n, axes); 1e9 s and more before its first reversal.
        torque: of each motor, N·m, less what gravity takes, (n, axes): J dω/dt + C ω + friction (paper, Fig. 2).
        axes: letters of the axes, one a column.
        ball: centre of the table ball in the work frame, (3,) m.
    """

    time: np.ndarray
    clock: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    since_reversal: np.ndarray
    torque: np.ndarray
    axes: tuple[str, ...]
    ball: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def column(self, axis: str) -> int:
        """Column of an axis in the arrays."""
        return self.axes.index(axis)


#: Order in which position effects act, motor side to tool (docs/theory.md).
STAGES = (
    "pitch_error",
    "worm_wear",
    "backlash",
    "scale_error",
    "gravity_windup",
    "straightness",
    "user",
    "thermal_drift",
    "thermal_expansion",
    "vibration",
)

SINE, PLAY, BUMP, POLYNOMIAL, SCALE, SETTLE, VIBRATE, FOLLOW, KNOTS = range(9)
#: Numbers of an operation.
PARAMETERS = 6
OP_SIZE = 10
#: Column of an operation's stage in its row.
STAGE = OP_SIZE - 1


@dataclass
class AxisPlant:
    """One drive with every effect that changes it. SI, motor side; names as in :class:`mjsim.machine.model.Drive`.

    ``coulomb`` = 0 is no friction; ``delay`` s; ``feedforward`` is the velocity feedforward's ratio; ``ripple`` is
    (amplitude N·m, order per motor revolution, phase rad). ``load_inertia`` kg·m² (0: rigid), ``stiffness`` N·m/rad and
    ``damping`` N·m·s/rad of an elastic transmission, all seen by the motor; ``inertia`` stays that of motor and load
    together. What only the simulation of axis logs computes: ``asymmetry`` of the friction level and ``viscous_share``
    of the viscous friction (shares by direction), ``friction_ripple`` (share of the level, order, phase), ``waves``
    (further ripples of the torque), ``by_position`` (change of the level per rad and rad² of the motor), ``rising``
    friction (N·m, rad/s at which it saturates), ``resting`` friction (share of the level that a rest adds, way after
    which it is gone, rad, time in which it forms, s), ``torque_loss`` (growth of the level per torque of the motor),
    ``encoder_error`` (rad of the motor, order, phase),
    ``hold`` (share of the level up to which the bristles are elastic), ``smoothing`` of the command (time constant of a
    lag and time of a mean, s), and ``control``. ``encoder`` says on which the position loop is closed, and ``play`` is
    half of the width of a play inside that loop, rad of the motor.
    """

    gear: float
    position_gain: float
    velocity_gain: float
    integral_time: float
    inertia: float
    viscous: float
    gravity: float
    feedforward: float = 0.0
    delay: float = 0.0
    coulomb: float = 0.0
    presliding: float = 1.0
    static_ratio: float = 1.0
    stribeck_velocity: float = 0.0
    ripple: tuple[float, float, float] = (0.0, 1.0, 0.0)
    load_inertia: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    asymmetry: float = 0.0
    rising: tuple[float, float] = (0.0, 1.0)
    hold: float = 0.0
    by_position: tuple[float, float] = (0.0, 0.0)
    friction_ripple: tuple[float, float, float] = (0.0, 1.0, 0.0)
    waves: tuple[tuple[float, float, float], ...] = ()
    viscous_share: float = 0.0
    resting: tuple[float, float, float] = (0.0, 1.0, 1.0)
    torque_loss: float = 0.0
    encoder_error: tuple[float, float, float] = (0.0, 1.0, 0.0)
    smoothing: tuple[float, float] = (0.0, 0.0)
    encoder: str = "motor"
    play: float = 0.0
    control: Control = field(default_factory=Control)

    @property
    def on_load(self) -> bool:
        """Whether the position loop is closed on an encoder at the load."""
        return self.encoder != "motor"

    def key(self) -> tuple:
        """Hashable identity of the drive's behaviour (for caching motions)."""
        return tuple(vars(self).values())

    @property
    def numbers(self) -> tuple[float, ...]:
        """All numbers that are no part of its control."""
        return tuple(flat for v in vars(self).values() if isinstance(v, float | tuple) for flat in np.ravel(v))


@dataclass(frozen=True)
class Op:
    """One elementary operation on an axis position: ``out`` is changed as a function of ``source`` (axis indices).

    ``phases`` are those of a vibration, rad at the program's start, by test name.
    """

    stage: int
    code: int
    out: int
    source: int
    parameters: tuple[float, ...]
    phases: dict[str, float] = field(default_factory=dict, compare=False)


class PythonEffect(Protocol):
    """An effect that is computed in plain Python, for a whole motion at once (:class:`mjsim.machine.effect.Effect`)."""

    @property
    def id(self) -> str: ...
    def position_error(self, motion: Motion) -> np.ndarray | None: ...


@dataclass
class Plant:
    """Drives, transmission operations in acting order, geometry, and the effects that are plain Python.

    ``temperatures`` are those of the campaign; ``None`` where none were recorded.
    """

    axes: dict[str, AxisPlant]
    ops: list[Op] = field(default_factory=list)
    geometry: Geometry = field(default_factory=Geometry)
    python_effects: list[PythonEffect] = field(default_factory=list)
    chain: Chain = FIVE_AXIS
    temperatures: Temperatures | None = field(default=None, compare=False)

    @property
    def width(self) -> int:
        """Columns of a motion: the axes, and error motions up to the last one that an effect has, one of
        :attr:`~mjsim.machine.chain.Chain.widths`.
        """
        needed = max((op.out + 1 for op in self.ops), default=0)
        return next(w for w in self.chain.widths if w >= needed)

    def whole_inertia(self) -> np.ndarray:
        """J·gear² of every axis, (axes,) kg and kg·m²: motor and moving bodies together."""
        return np.array([self.axes[a].inertia * self.axes[a].gear ** 2 for a in self.chain.letters])

    def add_spring(self, axis: str, stiffness: float, damping_ratio: float) -> None:
        """Put the moving bodies of one axis behind a spring, ``stiffness`` N/m or N·m/rad at the load.

        ``damping_ratio`` is that of the bodies on the spring with the motor held.
        """
        drive = self.axes[axis]
        bodies = moving_bodies(self.chain)
        load = bodies[self.chain.index(axis)] * bodies_scale(bodies, self.whole_inertia())
        drive.load_inertia = load / drive.gear**2
        drive.stiffness = stiffness / drive.gear**2
        drive.damping = 2.0 * damping_ratio * float(np.sqrt(drive.stiffness * drive.load_inertia))

    def add_op(
        self, stage: str, code: int, out: str, *parameters: float, source: str | None = None, phases: dict | None = None
    ) -> None:
        """Append an operation; operations of one stage keep the order of the effects."""
        column = self.chain.columns.index
        self.ops.append(
            Op(
                STAGES.index(stage),
                code,
                column(out),
                column(source or out),
                tuple(map(float, parameters)),
                phases or {},
            )
        )

    def follow(self, stage: str, out: str, factor: float, time: np.ndarray, value: np.ndarray) -> None:
        """Append an operation that displaces an axis by ``factor`` times a function of the campaign clock.

        Its row in the table of operations is followed by rows that do nothing but hold the function.

        Args:
            stage: Where it acts.
            out: The axis.
            factor: m or rad per unit of the function.
            time: (n,) s, growing; between them the function is a line, beyond the ends it stays.
            value: (n,) of the function.
        """
        knots = np.column_stack([time, value])
        short = -len(knots) % (PARAMETERS // 2)
        knots = np.vstack([knots, np.repeat(knots[-1:], short, axis=0)])
        self.add_op(stage, FOLLOW, out, factor, float(len(knots)))
        for row in knots.reshape(-1, PARAMETERS):
            self.add_op(stage, KNOTS, out, *row)

    def close_loops_on_loads(self) -> None:
        """Put the plays of axes whose position loop is closed on the load into that loop: such a drive gives the
        position of its load.
        """
        for letter, axis in self.axes.items():
            if not axis.on_load:
                continue
            column = self.chain.index(letter)
            inside = [op for op in self.ops if op.code == PLAY and op.out == op.source == column]
            self.ops = [op for op in self.ops if op not in inside]
            axis.play += axis.gear * sum(op.parameters[0] for op in inside)

    def sorted_ops(self) -> list[Op]:
        """Operations in the order in which they act."""
        return sorted(self.ops, key=lambda op: op.stage)

    def unusable(self) -> str:
        """What in here no simulation can use, for a message; empty where all is well. For what a user's own effect
        has put in.
        """
        for name, axis in self.axes.items():
            for key, value in vars(axis).items():
                if isinstance(value, Control | str) or (key == "integral_time" and value == np.inf):
                    continue
                numbers = value if isinstance(value, tuple) else (value,)
                if not np.all(np.isfinite(np.asarray(numbers, float))):
                    return f"{key} = {value!r} into the {name} drive"
            above = ("gear", "position_gain", "velocity_gain", "integral_time", "inertia", "presliding")
            if wrong := [k for k in above if getattr(axis, k) <= 0.0]:
                return f"{wrong[0]} = {getattr(axis, wrong[0]):g} into the {name} drive"
        for op in self.ops:
            if (
                op.code not in range(KNOTS + 1)
                or len(op.parameters) > PARAMETERS
                or not np.all(np.isfinite(op.parameters))
            ):
                return f"an operation with code {op.code!r} and parameters {op.parameters!r} into the transmission"
        return ""

    def op_table(self, test: str = "", started: float = 0.0) -> np.ndarray:
        """Operations as (n, OP_SIZE) numbers for the compiled code: code, out, source, parameters, stage.

        Vibrations have the phases of ``test``, which began at ``started`` s on the campaign clock.
        """
        ops = self.sorted_ops()
        table = np.zeros((len(ops), OP_SIZE))
        for row, op in zip(table, ops, strict=True):
            row[:3] = op.code, op.out, op.source
            row[3 : 3 + len(op.parameters)] = op.parameters
            row[STAGE] = op.stage
            if op.code == VIBRATE and test:
                row[5] = op.phases.get(test, 0.0) - op.parameters[1] * started
        return table
