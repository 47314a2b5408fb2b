"""Correction tables: what is wanted, sampled at the points that a control allows, as it will hold them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mjsim.commands.saved import Known, SavedDiagnosis
from mjsim.digits import estimate, expanded
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.machine.chain import Chain
from mjsim.machine.effect import Effect, Parameter
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import BUMP, PLAY, POLYNOMIAL, SCALE, SETTLE, SINE, AxisPlant
from mjsim.simulation.axes import motor_of, time_grid
from mjsim.simulation.drive import STEP
from mjsim.units import DEG, MM

# -- which of the known errors are worth typing into a control, and why the others are not -----------------------------

#: Kinds that are part of the drive and not of its position: no table or offset changes them.
NOT_POSITION = (
    "friction",
    "viscous_friction",
    "velocity_gain",
    "torque_ripple",
    "drive_compliance",
    "velocity_feedforward",
    "servo_delay",
    "vibration",
)


@dataclass(frozen=True)
class Left:
    """An error that is not corrected, and why.

    Attributes:
        key: Of the effect.
        reason: One sentence.
    """

    key: str
    reason: str


@dataclass(frozen=True)
class Worth:
    """One effect that is worth correcting.

    Attributes:
        known: As diagnosed.
        effect: Reduced to the numbers that are larger than their uncertainty.
        uncertainty: 95 % half width of each remaining size, in the unit of its name; empty where none is known.
        sizes: The sizes themselves, by the same labels.
    """

    known: Known
    effect: Effect
    uncertainty: dict[str, float]
    sizes: dict[str, float]


def worth_typing(saved: SavedDiagnosis) -> tuple[list[Worth], list[Left]]:
    """The errors of a diagnosed machine that are worth correcting, and the others with the reason."""
    worth, left = [], []
    for known in saved.known:
        effect = known.effect
        if effect.is_neutral or effect.kind in NOT_POSITION:
            if known.origin == "found":
                left.append(Left(effect.key, _DRIVE.get(effect.kind, "it is repaired at the drive, not by a table")))
            continue
        if known.alternatives:
            left.append(Left(effect.key, f"ambiguous: the data cannot tell it from {', '.join(known.alternatives)}"))
            continue
        if not known.observable:
            left.append(Left(effect.key, "not observable: the tests say no more about it than its tolerance does"))
            continue
        reduced, small = _reduced(known)
        left += [Left(effect.key, text) for text in small]
        if reduced is not None:
            worth.append(reduced)
    return worth, left


_DRIVE = {
    "friction": "friction acts on the torque; check lubrication and preload, or tune the control's own friction "
    "compensation (compensate --friction)",
    "servo_delay": "a delay is no position error; delay the other axes by the same time where the control can",
    "velocity_feedforward": "set the feedforward of this axis as that of the others",
    "velocity_gain": "set the velocity gain of this axis as the data sheet says",
    "vibration": "a vibration has to be found at its source",
}


def _reduced(known: Known) -> tuple[Worth | None, list[str]]:
    """The effect without the sizes that are smaller than their uncertainty, and sentences on those."""
    effect = known.effect
    values, small, kept, sizes = dict(effect.values), [], {}, {}
    for p in effect.parameters_of(effect.subject):
        if p.kind == "components":
            rows = []
            for i, row in enumerate(values[p.name]):
                half = _half(known.ci95.get(p.name), i)
                label = f"order {row[0]:g}"
                if half is not None and row[1] <= half:
                    small.append(_too_small(label, row[1], half, p, effect))
                elif row[1]:
                    rows.append(row)
                    sizes[label] = row[1]
                    if half is not None:
                        kept[label] = half
            values[p.name] = rows
        elif p.neutral is not None:
            half = _half(known.ci95.get(p.name))
            size = values[p.name] - p.neutral
            if half is not None and abs(size) <= half:
                small.append(_too_small(p.name, size, half, p, effect))
                values[p.name] = p.neutral
            elif size:
                sizes[p.name] = values[p.name]
                if half is not None:
                    kept[p.name] = half
    reduced = effect.replaced(**values)
    return (None if reduced.is_neutral else Worth(known, reduced, kept, sizes)), small


def _half(interval: list | None, component: int | None = None) -> float | None:
    """Half width of a 95 % interval; of one component's amplitude where its number is given."""
    if not interval:
        return None
    low, high = interval
    if component is not None:
        return 0.5 * (high[component][1] - low[component][1])
    return 0.5 * (high - low)


def _too_small(label: str, size: float, half: float, p: Parameter, effect: Effect) -> str:
    unit = unit_text(p, effect)
    ends = size - half, size + half
    return (
        f"not worth typing: {label} is {estimate(size, ends)} {expanded(ends)}{unit}, smaller than its own uncertainty"
    )


def unit_text(p: Parameter, effect: Effect) -> str:
    """Unit of a size with a blank before it, empty for ratios."""
    from mjsim.machine.chain import is_rotary

    if p.kind == "components":
        return "°" if is_rotary(effect.subject) else " µm"
    return "°" if p.unit == "°" else f" {p.unit}" if p.unit else ""


# -- what is to be corrected, as a neutral quantity per axis -----------------------------------------------------------
# Everything is an error: where the load side is, less where it should be. A control corrects it with the other sign.


@dataclass(frozen=True)
class Term:
    """Error of one axis, or of what one axis carries, as a function of the position of one axis.

    Attributes:
        key: Of the effect that makes it.
        out: Letter of the axis that is wrong, or the name of a component error (ISO 230-1) of the source.
        source: Letter of the axis on whose position it depends.
        code: Operation of the plant: ``SINE``, ``BUMP``, ``POLYNOMIAL`` or ``SCALE``.
        parameters: Of the operation, SI.
    """

    key: str
    out: str
    source: str
    code: int
    parameters: tuple[float, ...]

    @property
    def direction(self) -> float:
        """+1 or −1 where it acts only while the source moves that way, 0 for both."""
        return self.parameters[3] if self.code in (SINE, BUMP) else 0.0

    @property
    def shortest(self) -> float:
        """Length over which it changes, m or rad: the period of a wave, four standard deviations of a worn stretch;
        infinite where any table is fine enough.
        """
        if self.code == SINE:
            return 2.0 * math.pi / self.parameters[1]
        return 4.0 * self.parameters[2] if self.code == BUMP else math.inf

    def error(self, x: np.ndarray, sign: float) -> np.ndarray:
        """Error (n,) m or rad at positions ``x`` (n,) of the source while it moves in the direction ``sign``."""
        p = self.parameters
        if self.direction not in (0.0, sign):
            return np.zeros(len(x))
        if self.code == SINE:
            return p[0] * np.sin(p[1] * x + p[2])
        if self.code == BUMP:
            away = (x - p[1] + math.pi) % (2.0 * math.pi) - math.pi
            return -p[0] * np.exp(-0.5 * (away / p[2]) ** 2)
        if self.code == POLYNOMIAL:
            u = x / p[2]
            return (p[0] + p[1] * u) * u * u
        return p[0] * x


@dataclass(frozen=True)
class Wanted:
    """Everything that could be corrected, before a control limits it.

    Attributes:
        chain: The machine's axes.
        terms: Errors that depend on position.
        play: Full width of the backlash, m or rad, by axis.
        location: Location errors of the rotary axes, m or rad, by name.
        gains: Position gain that restores the setting, 1/s, by axis; and the factor that is wrong.
        thermal: Final displacement in m and time constant in s, by axis.
        keys: Effects behind play, location errors, gains and thermal drift, by the same names.
    """

    chain: Chain
    terms: tuple[Term, ...] = ()
    play: dict[str, float] = field(default_factory=dict)
    location: dict[str, float] = field(default_factory=dict)
    gains: dict[str, tuple[float, float]] = field(default_factory=dict)
    thermal: dict[str, tuple[float, float]] = field(default_factory=dict)
    keys: dict[str, str] = field(default_factory=dict)


def wanted_of(machine: Machine, effects: list[Effect]) -> tuple[Wanted, list[str]]:
    """What the given effects ask to be corrected, and the keys of those that no table can take.

    Args:
        machine: The diagnosed machine.
        effects: Those of its effects that are worth correcting, reduced to what is.
    """
    chain, out, left = machine.chain, Wanted(machine.chain), []
    bare = replace(machine, effects=())
    normal = build(bare)
    terms: list[Term] = []
    for effect in effects:
        plant = build(replace(bare, effects=(effect,)))
        before = len(terms), len(out.keys)
        whole = True
        for op in plant.ops:
            component = op.out >= chain.count and op.code not in (SINE, POLYNOMIAL, SCALE)
            if component or op.source >= chain.count or op.code not in (SINE, BUMP, POLYNOMIAL, SCALE, PLAY, SETTLE):
                whole = False
            elif op.code == PLAY:
                axis = chain.letters[op.out]
                out.play[axis] = 2.0 * op.parameters[0]
                out.keys[axis] = effect.key
            elif op.code == SETTLE:
                axis = chain.letters[op.out]
                out.thermal[axis] = (op.parameters[0], op.parameters[1])
                out.keys[f"thermal {axis}"] = effect.key
            else:
                terms.append(Term(effect.key, chain.columns[op.out], chain.letters[op.source], op.code, op.parameters))
        for name, value in plant.geometry.location.items():
            out.location[name] = value
            out.keys[name] = effect.key
        for error in chain.squareness:
            if (slope := error.sign * plant.geometry.squareness.get(error.name, 0.0)) != 0.0:
                terms.append(Term(effect.key, chain.letters[error.along], error.axis, SCALE, (slope,)))
        for axis in chain.letters:
            gain, right = plant.axes[axis].position_gain, normal.axes[axis].position_gain
            if gain != right:
                out.gains[axis] = (right * right / gain, gain / right)
                out.keys[f"gain {axis}"] = effect.key
        if not whole or (len(terms), len(out.keys)) == before:
            left.append(effect.key)
    done = [t for t in terms if t.key not in left]
    return replace(out, terms=tuple(done)), left


# -- friction (quadrant) compensation ----------------------------------------------------------------------------------
# A control that has it adds ``speed · exp(−t/time)`` to the set-point of the velocity loop when an axis reverses. What
# this does is what the same pulse through the position gain would do, so it is simulated as a change of the command.

#: Times of the pulse that are tried, s.
_TIMES = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
#: Passes of the amplitude: friction makes the answer a little nonlinear.
_PASSES = 3
#: A pulse is worth typing if it takes this share of what friction does to the axis (mean square).
WORTH = 0.2
_STILL = 1e-13


@dataclass(frozen=True)
class Pulse:
    """One axis' friction compensation.

    Attributes:
        speed: Amplitude, m/s or rad/s.
        time: Of its decay, s.
        gain: Position gain of the axis, 1/s.
        feedforward: Ratio of its velocity feedforward.
        removes: Share of the mean square of what friction does to the axis in the tests that it takes away.
    """

    speed: float
    time: float
    gain: float
    feedforward: float = 0.0
    removes: float = 0.0

    def offset(self, command: np.ndarray, step: float) -> np.ndarray:
        """What added to the command (n,) has the same effect, (n,) m or rad; ``step`` s between the samples."""
        from scipy.signal import lfilter  # slow to load

        follow = 1.0 - np.exp(-self.gain * step)
        wanted = command + self.feedforward / self.gain * np.gradient(command, step)
        lagged = lfilter([follow], [1.0, follow - 1.0], wanted, zi=[(1.0 - follow) * wanted[0]])[0]
        kick = _reversals(lagged) * self.speed
        slow = np.asarray(lfilter([1.0], [1.0, -np.exp(-step / self.time)], kick))
        if self.feedforward < 1e-6:
            return slow / self.gain
        fast = np.asarray(lfilter([1.0], [1.0, -np.exp(-step * self.gain / self.feedforward)], kick))
        return (slow - fast) / (self.gain - self.feedforward / self.time)


def _reversals(position: np.ndarray) -> np.ndarray:
    """±1 at the instants at which a position (n,) turns, the sign of the new direction; 0 elsewhere, (n,)."""
    step = np.diff(position, prepend=position[0])
    sign = np.sign(np.where(np.abs(step) > _STILL, step, 0.0))
    moving = np.flatnonzero(sign)
    out = np.zeros(len(position))
    turned = moving[1:][sign[moving[1:]] != sign[moving[:-1]]]
    out[turned] = sign[turned]
    return out


def tuned(machine: Machine, axis: str, tests: Sequence[BallBarTest], speed_digit: float = 0.0) -> Pulse | None:
    """The pulse that takes most of what an axis' friction does in the tests; ``None`` where none is worth typing.

    Args:
        machine: As diagnosed.
        axis: Letter of an axis with friction.
        tests: What was measured.
        speed_digit: Multiple of which the amplitude is, m/s or rad/s.
    """
    with_friction = build(machine).axes[axis]
    free = build(machine.without(f"friction.{axis}")).axes[axis]
    runs = [run for t in tests if (run := _run(t, axis, with_friction, free)) is not None]
    if not runs:
        return None
    best: Pulse | None = None
    for time in _TIMES:
        pulse = _amplitude(with_friction, runs, time, speed_digit)
        if pulse is not None and (best is None or pulse.removes > best.removes):
            best = pulse
    return best if best is not None and best.removes >= WORTH else None


@dataclass(frozen=True)
class _Run:
    """One test of one axis: time, command, motor with friction and without, measured part."""

    time: np.ndarray
    command: np.ndarray
    now: np.ndarray
    wanted: np.ndarray
    span: slice


def _run(test: BallBarTest, axis: str, with_friction: AxisPlant, free: AxisPlant) -> _Run | None:
    program = Program(test)
    time = time_grid(program)
    command = program.commands(time)[:, test.chain.index(axis)]
    low, high = program.measured_span
    span = slice(int(np.ceil(low / STEP)), int(high / STEP) + 1)
    if not _reversals(command[span]).any():
        return None
    now, wanted = (motor_of(d, time, command) for d in (with_friction, free))
    return _Run(time, command, now, wanted, span)


def _amplitude(drive: AxisPlant, runs: list[_Run], time: float, digit: float) -> Pulse | None:
    """The best amplitude for one decay time; ``None`` where a pulse does harm."""
    missing = np.concatenate([(r.wanted - r.now)[r.span] for r in runs])
    speed = drive.position_gain * float(np.abs(missing).max())
    pulse = Pulse(speed, time, drive.position_gain, drive.feedforward)
    left = missing
    for _ in range(_PASSES):
        made = np.concatenate(
            [(motor_of(drive, r.time, r.command + pulse.offset(r.command, STEP)) - r.now)[r.span] for r in runs]
        )
        left = missing - made
        speed *= float(missing @ made) / max(float(made @ made), 1e-30)
        if digit:
            speed = round(speed / digit) * digit
        if speed <= 0.0:
            return None
        if abs(speed / pulse.speed - 1.0) < 0.02:
            break
        pulse = Pulse(speed, time, drive.position_gain, drive.feedforward)
    removed = 1.0 - float(left @ left) / max(float(missing @ missing), 1e-30)
    return Pulse(pulse.speed, time, pulse.gain, pulse.feedforward, removed)


#: Points per shortest wave that a table gets where it may have them, and fewest with which a wave is still written.
FINE, COARSE = 16, 4
#: Points of a table without waves.
_SMOOTH = 33
_TURN = 2.0 * math.pi


@dataclass(frozen=True)
class Table:
    """Correction of one axis, or of one component error, as a function of the commanded position of one axis.

    Attributes:
        out: Letter of the corrected axis, or the name of a component error (ISO 230-1) of the source.
        source: Letter of the axis on whose position the correction depends.
        positions: Rising positions of the source, (n,) m or rad.
        forward: What is added to the command of ``out`` while the source moves towards larger positions, (n,) m or
            rad.
        reverse: The same for the other direction.
        modulo: Whether the table repeats every turn of the source.
        keys: Effects that it corrects.
    """

    out: str
    source: str
    positions: np.ndarray
    forward: np.ndarray
    reverse: np.ndarray
    modulo: bool = False
    keys: tuple[str, ...] = ()

    @property
    def two_sided(self) -> bool:
        """Whether both directions of motion have values of their own."""
        return not np.array_equal(self.forward, self.reverse)


@dataclass(frozen=True)
class Corrections:
    """What a control is told, as it will hold it: every number is rounded to the digits of its file.

    Attributes:
        chain: The machine's axes.
        backlash: Full width, m or rad, by axis.
        tables: Position-dependent corrections.
        kinematics: Location errors of the rotary axes, m or rad, by name.
        gains: New position gain, 1/s, by axis.
        pulses: Friction (quadrant) compensation, by axis.
        left: What is not corrected, and why.
        notes: Sentences for who types it.
    """

    chain: Chain
    backlash: dict[str, float] = field(default_factory=dict)
    tables: tuple[Table, ...] = ()
    kinematics: dict[str, float] = field(default_factory=dict)
    gains: dict[str, float] = field(default_factory=dict)
    pulses: dict[str, Pulse] = field(default_factory=dict)
    left: tuple[Left, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def empty(self) -> bool:
        """Whether nothing is corrected."""
        return not (self.backlash or self.tables or self.kinematics or self.gains or self.pulses)

    def table(self, out: str, source: str) -> Table | None:
        """The table of one axis by another, or ``None``."""
        return next((t for t in self.tables if (t.out, t.source) == (out, source)), None)


@dataclass(frozen=True)
class Grid:
    """What a control allows of one table.

    Attributes:
        most: Most points.
        decimals: Of values, in mm or degrees.
        place_decimals: Of positions, in mm or degrees.
        modulo: Whether tables of a rotary axis may repeat every turn.
        held: Multiple of which values are, in mm or degrees; 0 for ``decimals``.
    """

    most: int
    decimals: int = 6
    place_decimals: int = 4
    modulo: bool = True
    held: float = 0.0


def scale(chain: Chain, axis: str) -> float:
    """SI per unit of a control's file, mm or degree, of an axis or a component error."""
    return DEG if chain.is_rotary(axis) or any(m.rotation for m in chain.motions if m.name == axis) else MM


def ranges_of(
    tests: Iterable[BallBarTest], chain: Chain, points: Sequence[np.ndarray] = ()
) -> dict[str, tuple[float, float]]:
    """Lowest and highest commanded position of every axis, m and rad: where errors were measured.

    Args:
        tests: Ball-bar tests.
        chain: The machine's axes.
        points: Positions (n, axes) at which the machine stood, m and rad.
    """
    ends = [(q.min(axis=0), q.max(axis=0)) for q in points]
    for test in tests:
        program = Program(test)
        q = program.commands(np.linspace(0.0, program.duration, 1441))
        ends.append((q.min(axis=0), q.max(axis=0)))
    low, high = np.min([e[0] for e in ends], axis=0), np.max([e[1] for e in ends], axis=0)
    return {a: (float(low[i]), float(high[i])) for i, a in enumerate(chain.letters)}


def sampled(
    chain: Chain,
    terms: Sequence[Term],
    range_: tuple[float, float],
    grid: Grid,
    extra: tuple[float, float] = (0.0, 0.0),
) -> tuple[Table | None, list[Left]]:
    """One table of the terms of one pair of axes, and the terms for which its points are too few.

    Args:
        chain: The machine's axes.
        terms: All with the same ``out`` and ``source``.
        range_: Positions of the source that the table covers, m or rad.
        grid: What the control allows.
        extra: Added to the forward and to the reverse values, m or rad, as for a backlash that the table takes over.
    """
    out, source = terms[0].out, terms[0].source
    unit, own = scale(chain, source), scale(chain, out)
    rotary = chain.is_rotary(source)
    modulo = rotary and grid.modulo and all(_repeats(t) for t in terms)
    low, high = (0.0, _TURN) if modulo else range_
    if high - low < 1e-9:
        return None, [Left(t.key, f"{source} stands still in all tests: nothing is known along it") for t in terms]
    shape = _Shape(low / unit, high / unit, grid, modulo)
    finest = shape.places(0.0)
    apart = float(finest[1] - finest[0]) * unit
    kept = [t for t in terms if apart * COARSE <= t.shortest * (1 + 1e-9)]
    left = [
        Left(
            t.key,
            f"a wave of {t.shortest / unit:.4g} {'°' if rotary else 'mm'} is too short for the table: "
            f"its points are {apart / unit:.3g} {'°' if rotary else 'mm'} apart at best, and {COARSE} a wave are "
            f"needed",
        )
        for t in terms
        if t not in kept
    ]
    if not kept:
        return None, left
    shortest = min(t.shortest for t in kept)
    wanted = shortest / FINE if math.isfinite(shortest) else (high - low) / (_SMOOTH - 1)
    places = shape.places(wanted / unit)
    x = places * unit
    values = []
    for sign, more in zip((1.0, -1.0), extra, strict=True):
        v = more - _nodes(kept, x, sign)
        values.append(rounded(v / own, grid) * own)
    if not (values[0].any() or values[1].any()):
        keys = dict.fromkeys(t.key for t in kept)
        return None, left + [Left(k, "smaller than the last digit that the control holds") for k in keys]
    keys = tuple(dict.fromkeys(t.key for t in kept))
    return Table(out, source, x, values[0], values[1], modulo, keys), left


@dataclass(frozen=True)
class _Shape:
    """Where the points of a table may lie: ends in mm or degrees, what the control allows, whether it repeats."""

    low: float
    high: float
    grid: Grid
    modulo: bool

    def places(self, step: float) -> np.ndarray:
        """Points at least ``step`` apart, as near to that as the control allows, (n,) mm or degrees. Zero is one of
        them, so that the reference position can be a point.
        """
        digit = 10.0**-self.grid.place_decimals
        most = self.grid.most - 1
        k = max(1, math.ceil(max(step, (self.high - self.low) / most) / digit - 1e-6))
        if self.modulo:
            turn = round(360.0 / digit)
            while turn % k:
                k += 1
            return np.arange(turn // k + 1) * (k * digit)
        if most < 8:  # so few that the ends matter more than round numbers
            return np.round(np.linspace(self.low, self.high, most + 1), self.grid.place_decimals)
        while True:
            first, last = math.floor(self.low / (k * digit) + 1e-9), math.ceil(self.high / (k * digit) - 1e-9)
            if last - first <= most:
                return np.round(np.arange(first, last + 1) * (k * digit), self.grid.place_decimals)
            k += 1


def _nodes(terms: Sequence[Term], x: np.ndarray, sign: float) -> np.ndarray:
    """Values at the points ``x`` (n,) whose straight lines come nearest to the sum of the errors, (n,)."""
    if len(x) > _SMOOTH:
        return sum((t.error(x, sign) for t in terms), np.zeros(len(x)))
    fine = np.linspace(x[0], x[-1], 20 * (len(x) - 1) + 1)
    hats = np.column_stack([np.interp(fine, x, e) for e in np.eye(len(x))])
    return np.linalg.lstsq(hats, sum((t.error(fine, sign) for t in terms), np.zeros(len(fine))), rcond=None)[0]


def rounded(values: np.ndarray, grid: Grid) -> np.ndarray:
    """Values (n,) in mm or degrees as the control holds them."""
    return np.round(values / grid.held) * grid.held if grid.held else np.round(values, grid.decimals)


def _repeats(t: Term) -> bool:
    """Whether a term has a whole number of periods in a turn of its rotary source."""
    order = t.parameters[1] if math.isfinite(t.shortest) and t.code == 0 else 1.0
    return math.isfinite(t.shortest) and abs(order - round(order)) < 1e-9
